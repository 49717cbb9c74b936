//! A capture that the driver has written: `maps.json` with the files that it names, and
//! `pixel.json`. docs/debugging.md describes both.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path};

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

/// The contents of a folder.
#[derive(Debug, Default)]
pub struct Capture {
    /// The program's name, if it is known.
    pub program: Option<String>,
    pub commands: Vec<MapCommand>,
    /// The number of commands beyond the driver's limits.
    pub dropped: u64,
    /// Elements of `pixel.json`.
    pub paths: Vec<Value>,
    /// Files of floats that commands name: first rays and boxes. Little endian.
    pub floats: BTreeMap<String, Vec<u8>>,
}

/// A command and its maps.
#[derive(Debug)]
pub struct MapCommand {
    /// Its entry in `maps.json`, without the maps.
    pub entry: Value,
    /// The counts of numbers in x, y and z.
    pub size: [u32; 3],
    pub maps: Vec<Map>,
}

/// A map: a number for each recorded invocation.
#[derive(Debug)]
pub struct Map {
    pub name: String,
    /// `ray`: for each ray by itself; `run`: for the launch as it ran.
    pub of: String,
    /// The map's file in the folder; a map of zeros has none.
    pub file: Option<String>,
    /// The size of a number in bytes.
    pub width: usize,
    /// Little endian, x fastest.
    pub bytes: Vec<u8>,
}

impl Map {
    /// The numbers.
    pub fn values(&self) -> impl Iterator<Item = u32> + '_ {
        self.bytes.chunks_exact(self.width).map(|bytes| {
            let mut word = [0; 4];
            word[..bytes.len()].copy_from_slice(bytes);
            u32::from_le_bytes(word)
        })
    }
}

impl Capture {
    /// # Errors
    /// The folder has no capture, or an invalid one.
    pub fn read(folder: &Path) -> Result<Capture> {
        let mut capture = Capture::default();
        let (maps, pixel) = (folder.join("maps.json"), folder.join("pixel.json"));
        if !maps.exists() && !pixel.exists() {
            bail!(
                "{} has no capture: run the program with TUFF_CAPTURE={0}",
                folder.display()
            );
        }
        if maps.exists() {
            let context = || format!("reading {}", maps.display());
            capture.read_maps(folder, &maps).with_context(context)?;
        }
        if pixel.exists() {
            let elements = elements(&pixel).with_context(|| format!("reading {}", pixel.display()));
            capture.paths = elements?;
        }
        Ok(capture)
    }

    fn read_maps(&mut self, folder: &Path, list: &Path) -> Result<()> {
        for mut entry in elements(list)? {
            if let Some(program) = entry["program"].as_str() {
                self.program = Some(program.to_owned());
            }
            if let Some(dropped) = entry["dropped_commands"].as_u64() {
                self.dropped = dropped;
            }
            let Value::Array(maps) = entry["maps"].take() else {
                continue;
            };
            let size: [u32; 3] =
                serde_json::from_value(entry["size"].clone()).context("the size of a command")?;
            self.read_floats(folder, &entry)?;
            let maps = maps.iter().map(|map| read_map(folder, map, size));
            self.commands.push(MapCommand {
                maps: maps.collect::<Result<_>>()?,
                size,
                entry,
            });
        }
        Ok(())
    }
}

impl Capture {
    /// Reads the files of floats that a command's entry names.
    fn read_floats(&mut self, folder: &Path, entry: &Value) -> Result<()> {
        let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
        let mut files = vec![entry["first_rays"]["file"].clone()];
        for top in list(&entry["structures"]) {
            files.push(top["boxes"]["file"].clone());
            let bottoms = list(&top["bottom_levels"]);
            files.extend(bottoms.iter().map(|bottom| bottom["boxes"]["file"].clone()));
        }
        for file in files.iter().filter_map(Value::as_str) {
            if self.floats.contains_key(file) {
                continue;
            }
            let bytes = read_file(folder, file)?;
            let data = data(&bytes).filter(|data| data.len().is_multiple_of(4));
            let data = data.with_context(|| format!("{file} has no floats"))?;
            self.floats.insert(file.to_owned(), data.to_vec());
        }
        Ok(())
    }
}

/// A file inside of the folder.
fn read_file(folder: &Path, file: &str) -> Result<Vec<u8>> {
    let inside = |part| matches!(part, Component::Normal(_));
    ensure!(
        Path::new(file).components().all(inside),
        "{file} is outside"
    );
    let path = folder.join(file);
    fs::read(&path).with_context(|| format!("reading {}", path.display()))
}

/// The elements of a file that is an array.
fn elements(path: &Path) -> Result<Vec<Value>> {
    Ok(serde_json::from_slice(&fs::read(path)?)?)
}

fn read_map(folder: &Path, entry: &Value, size: [u32; 3]) -> Result<Map> {
    let text = |key: &str| entry[key].as_str().map(str::to_owned);
    let name = text("name").context("the name of a map")?;
    let count = (size.iter()).try_fold(1usize, |product, &size| product.checked_mul(size as usize));
    let count = count.context("the size of a map")?;
    let file = text("file");
    let width = match text("type").as_deref() {
        Some("|u1") => 1,
        Some("<u2") => 2,
        Some("<u4") => 4,
        other => bail!("{name} has the type {other:?}"),
    };
    let bytes = match &file {
        None => Vec::new(),
        Some(file) => numbers(&read_file(folder, file)?, width * count)
            .with_context(|| format!("{file} differs from its description in maps.json"))?,
    };
    Ok(Map {
        of: text("of").context("what a map is of")?,
        name,
        file,
        width,
        bytes,
    })
}

/// This many bytes after the header of a file in NumPy's format.
fn numbers(file: &[u8], length: usize) -> Option<Vec<u8>> {
    let data = data(file).filter(|data| data.len() == length)?;
    Some(data.to_vec())
}

/// The numbers behind the head of a file in NumPy's format.
fn data(file: &[u8]) -> Option<&[u8]> {
    let (magic, rest) = file.split_at_checked(8)?;
    let (head, rest) = rest.split_at_checked(2)?;
    let head = usize::from(u16::from_le_bytes([head[0], head[1]]));
    let data = rest.get(head..)?;
    (magic == b"\x93NUMPY\x01\x00").then_some(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_cut_off_are_found_out() {
        let whole = b"\x93NUMPY\x01\x00\x04\x00 {}\n\x07\x08";
        assert_eq!(numbers(whole, 2), Some(vec![7, 8]));
        for length in 0..whole.len() {
            assert_eq!(numbers(&whole[..length], 2), None);
        }
        assert_eq!(numbers(b"\x93NUMPY\x02\x00\x00\x00\x07\x08", 2), None);
    }
}
