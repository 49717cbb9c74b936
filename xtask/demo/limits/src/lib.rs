//! The demo's options, and the errors in invalid ones: checked before anything is built or
//! rendered, by the demo and by the commands that build it.

use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};

/// The longest side of a picture, in pixels.
const MAX_SIDE: u32 = 16384;
/// The most samples per pixel: sums of so many stay far from where `f32` loses counts.
const MAX_SPP: u32 = 65536;

/// A picture's width and height, from `WIDTHxHEIGHT`.
///
/// # Errors
/// The form of a size.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').ok_or("a size is like 1280x720")?;
    let side = |text: &str| match text.parse() {
        Ok(side @ 1..=MAX_SIDE) => Ok(side),
        _ => Err(format!("a side is 1 to {MAX_SIDE} pixels")),
    };
    Ok((side(width)?, side(height)?))
}

/// A number of samples per pixel.
///
/// # Errors
/// The form of such a number.
pub fn parse_spp(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(spp @ 1..=MAX_SPP) => Ok(spp),
        _ => Err(format!("samples per pixel are 1 to {MAX_SPP}")),
    }
}

/// One of the equal bands that a picture is rendered in: `index` of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    pub index: u32,
    pub count: u32,
}

/// A tile, from `INDEX/COUNT`.
///
/// # Errors
/// The form of a tile.
pub fn parse_tile(text: &str) -> Result<Tile, String> {
    let numbers = text.split_once('/').and_then(|(index, count)| {
        let (index, count) = (index.parse().ok()?, count.parse().ok()?);
        (index < count).then_some(Tile { index, count })
    });
    numbers.ok_or_else(|| "a tile is like 0/4: its number from 0, and how many there are".into())
}

impl Tile {
    /// The tile's rows of a picture of this height: the first, and how many.
    pub fn rows(self, height: u32) -> (u32, u32) {
        let edge =
            |index: u32| (u64::from(height) * u64::from(index) / u64::from(self.count)) as u32;
        let first = edge(self.index);
        (first, edge(self.index + 1) - first)
    }
}

/// A file that a picture can be written to: tried, as rendering it may take hours.
///
/// # Errors
/// Why it cannot be written.
pub fn try_out(path: &Path) -> Result<(), String> {
    let is_png = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    if !is_png {
        let name = path.display();
        return Err(format!(
            "{name}: the demo writes PNG files: name one that ends in .png"
        ));
    }
    let wrong = |path: &Path, error| format!("{} cannot be written: {error}", path.display());
    if let Some(folder) = parent(path) {
        fs::create_dir_all(&folder).map_err(|error| wrong(&folder, error))?;
    }
    let existed = path.exists();
    let opened = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        .open(path);
    opened.map_err(|error| wrong(path, error))?;
    if !existed {
        // A file that rendering may fail to fill is removed.
        let _ = fs::remove_file(path);
    }
    Ok(())
}

/// The folder of a file, if it names one.
pub fn parent(path: &Path) -> Option<PathBuf> {
    let folder = path.parent()?;
    (!folder.as_os_str().is_empty()).then(|| folder.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_samples_have_limits() {
        assert_eq!(parse_size("1280x720"), Ok((1280, 720)));
        assert_eq!(parse_size("1x16384"), Ok((1, 16384)));
        for wrong in ["1280", "0x5", "5x16385", "x", "-1x4", "99999999999x1"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_spp("65536"), Ok(65536));
        for wrong in ["0", "65537", "-4", "many", ""] {
            assert!(parse_spp(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn tiles_cover_each_row_once() {
        for (height, count) in [(720, 4), (7, 3), (2, 5), (1, 1)] {
            let mut next = 0;
            for index in 0..count {
                let (first, rows) = Tile { index, count }.rows(height);
                assert_eq!(first, next);
                next += rows;
            }
            assert_eq!(next, height);
        }
        assert_eq!(parse_tile("3/4"), Ok(Tile { index: 3, count: 4 }));
        for wrong in ["4/4", "1", "a/2", "0/0", "-1/2"] {
            assert!(parse_tile(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn only_what_can_be_written_is_taken() {
        let folder = std::env::temp_dir().join(format!("tuff-out-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let new = folder.join("deeper/picture.png");
        assert_eq!(try_out(&new), Ok(()));
        assert!(!new.exists(), "trying leaves nothing");
        let old = folder.join("old.PNG");
        fs::write(&old, "a picture").unwrap();
        assert_eq!(try_out(&old), Ok(()));
        assert_eq!(
            fs::read(&old).unwrap(),
            b"a picture",
            "trying takes nothing"
        );
        let message = try_out(&folder.join("picture.jpg")).unwrap_err();
        assert!(message.contains("ends in .png"), "{message}");
        let message = try_out(&old.join("picture.png")).unwrap_err();
        assert!(message.contains("cannot be written"), "{message}");
        fs::create_dir_all(folder.join("folder.png")).unwrap();
        let message = try_out(&folder.join("folder.png")).unwrap_err();
        assert!(message.contains("cannot be written"), "{message}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
