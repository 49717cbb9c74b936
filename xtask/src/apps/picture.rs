//! Pictures of applications: PNG, and PPM of 8 bits.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, Result, bail};

/// Rows of pixels, their channels between 0 and 255.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    pub name: String,
    size: [u32; 2],
    channels: Vec<u8>,
}

impl Picture {
    /// The mean difference of channels, as a fraction of their range; `None` for pictures of
    /// different sizes.
    pub fn distance(&self, other: &Picture) -> Option<f64> {
        if self.size != other.size || self.channels.len() != other.channels.len() {
            return None;
        }
        let pairs = self.channels.iter().zip(&other.channels);
        let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        Some(sum as f64 / (255.0 * self.channels.len().max(1) as f64))
    }
}

/// The pictures in a folder that are newer than a time, by name.
pub fn written_since(folder: &Path, time: SystemTime) -> Result<Vec<Picture>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        let read = match path.extension().and_then(|it| it.to_str()) {
            Some("png") => png,
            Some("ppm") => ppm,
            _ => continue,
        };
        if entry.metadata()?.modified()? < time {
            continue;
        }
        let (size, channels) = read(&path).with_context(|| format!("{}", path.display()))?;
        found.push(Picture {
            name: entry.file_name().to_string_lossy().into_owned(),
            size,
            channels,
        });
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

type Pixels = ([u32; 2], Vec<u8>);

fn png(path: &Path) -> Result<Pixels> {
    let mut decoder = png::Decoder::new(BufReader::new(File::open(path)?));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let mut channels = vec![0; reader.output_buffer_size().context("it is too large")?];
    let frame = reader.next_frame(&mut channels)?;
    channels.truncate(frame.buffer_size());
    Ok(([frame.width, frame.height], channels))
}

fn ppm(path: &Path) -> Result<Pixels> {
    let bytes = std::fs::read(path)?;
    let mut rest = &bytes[..];
    let mut words = Vec::new();
    while words.len() < 4 {
        let word = next_word(&mut rest).context("it has no header")?;
        words.push(word);
    }
    let number = |word: &str| word.parse::<u32>().context("a number of the header");
    let size = [number(&words[1])?, number(&words[2])?];
    if words[0] != "P6" || words[3] != "255" {
        bail!("not one of 8 bits a channel");
    }
    let length = size[0] as usize * size[1] as usize * 3;
    let channels = rest.get(..length).context("it is cut off")?;
    Ok((size, channels.to_vec()))
}

/// A word of the header and the white space after it; comments are skipped.
fn next_word(rest: &mut &[u8]) -> Option<String> {
    loop {
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        *rest = &rest[start..];
        if rest[0] != b'#' {
            break;
        }
        let end = rest.iter().position(|&byte| byte == b'\n')?;
        *rest = &rest[end..];
    }
    let end = rest.iter().position(|byte| byte.is_ascii_whitespace())?;
    let word = String::from_utf8_lossy(&rest[..end]).into_owned();
    *rest = &rest[end + 1..];
    Some(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_read_and_compared() {
        let folder = std::env::temp_dir().join(format!("tuff-pictures-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let before = SystemTime::UNIX_EPOCH;
        std::fs::write(
            folder.join("a.ppm"),
            b"P6 # remark\n2 1\n255\n\x00\x01\x02\x0a\x20\xff",
        )
        .unwrap();
        let found = written_since(&folder, before).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].size, [2, 1]);
        assert_eq!(found[0].channels, [0, 1, 2, 10, 32, 255]);
        let mut other = found[0].clone();
        assert_eq!(found[0].distance(&other), Some(0.0));
        other.channels[0] = 255;
        assert_eq!(found[0].distance(&other), Some(1.0 / 6.0));
        other.size = [1, 2];
        assert_eq!(found[0].distance(&other), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
