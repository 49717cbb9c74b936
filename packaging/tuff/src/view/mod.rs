//! `tuff view`: makes a page of a capture (`TUFF_CAPTURE`), and a picture of each of its maps.

mod capture;
mod colours;
mod page;
mod picture;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, Result};

use capture::Capture;

/// The page's name in the folder.
const PAGE: &str = "index.html";

/// Writes the page and the pictures of a capture, and opens the page if there is a browser.
///
/// # Errors
/// There is no capture, or its folder cannot be written.
pub fn view(folder: &Path, opens: bool) -> Result<ExitCode> {
    let capture = Capture::read(folder)?;
    for command in &capture.commands {
        for map in &command.maps {
            let Some(file) = &map.file else {
                continue;
            };
            let path = folder.join(file).with_extension("png");
            let picture = picture::of(map, command.size)?;
            write(&path, &picture)?;
        }
    }
    let page = std::path::absolute(folder.join(PAGE)).context("the folder's path")?;
    write(&page, page::of(&capture, folder)?.as_bytes())?;
    crate::print(format!("{}\n", page.display()).as_bytes());
    if opens {
        open(&page);
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes a file atomically: under another name first, which is then changed.
fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut partial = PathBuf::from(path);
    partial.set_extension("part");
    let written = std::fs::File::create(&partial)
        .and_then(|mut file| file.write_all(bytes))
        .and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        let _ = std::fs::remove_file(&partial);
    }
    written.with_context(|| format!("writing {}", path.display()))
}

/// Opens a page if there is a program for that. A failure is not reported, because the path is
/// printed.
fn open(page: &Path) {
    let mut program = match cfg!(windows) {
        true => {
            let mut program = Command::new("explorer");
            program.arg(page);
            program
        }
        false => {
            let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"]
                .iter()
                .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
            if !has_screen {
                return;
            }
            let mut program = Command::new("xdg-open");
            program.arg(page);
            program
        }
    };
    let quiet = program.stdin(Stdio::null()).stdout(Stdio::null());
    let _ = quiet.stderr(Stdio::null()).spawn();
}
