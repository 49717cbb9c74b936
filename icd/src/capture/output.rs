//! Where captures go: text to standard error, or to `pixel.txt` in the folder of `TUFF_CAPTURE`,
//! and JSON to `pixel.json` beside it. Each command is written whole, so that a program that dies
//! leaves all that were complete.

#![forbid(unsafe_code)]

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::settings::CaptureSettings;
use crate::timeline::file::ArrayFile;

/// The setting of the folder, for messages.
pub const FOLDER: &str = "TUFF_CAPTURE";

/// The place of the text.
enum Text {
    StandardError,
    /// The file and the bytes of whole commands in it.
    File(PathBuf, File, u64),
    /// It could not be written.
    Nowhere,
}

/// The files, until a write fails.
pub struct Output {
    text: Text,
    json: Option<ArrayFile>,
    bytes: usize,
}

impl Output {
    /// Makes the files, in place of earlier ones. Those that cannot be made are reported.
    pub fn new(settings: &CaptureSettings, invocation: [u32; 3]) -> Self {
        let Some(folder) = settings.folder.map(Path::new) else {
            return Self {
                text: Text::StandardError,
                json: None,
                bytes: 0,
            };
        };
        if let Err(why) = std::fs::create_dir_all(folder) {
            log::error!("{FOLDER}: {}: {why}; nothing is captured", folder.display());
            return Self {
                text: Text::Nowhere,
                json: None,
                bytes: 0,
            };
        }
        let path = folder.join("pixel.txt");
        let text = match File::create(&path) {
            Ok(file) => Text::File(path, file, 0),
            Err(why) => {
                log::error!("{FOLDER}: {}: {why}; there is no text", path.display());
                Text::Nowhere
            }
        };
        let path = folder.join("pixel.json");
        let first = json!({ "version": 1, "invocation": invocation });
        let file = ArrayFile::new(
            (FOLDER, "the capture"),
            &path.to_string_lossy(),
            &first.to_string(),
        );
        Self {
            text,
            json: file.is_open().then_some(file),
            bytes: 0,
        }
    }

    /// Whether anything can be written.
    pub fn is_open(&self) -> bool {
        !matches!(self.text, Text::Nowhere) || self.json.is_some()
    }

    /// Bytes that were written.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Adds a command.
    pub fn write(&mut self, text: &str, json: &Value) {
        self.write_text(text);
        if let Some(file) = &mut self.json {
            let element = format!(",\n{json}");
            self.bytes += element.len();
            if !file.append(&element) {
                self.json = None;
            }
        }
    }

    /// Counts a command that is past the limits. The first is told in the text.
    pub fn drop_command(&mut self, dropped: u64, captured: u64) {
        if dropped == 1 {
            self.say(&format!(
                "{captured} commands are captured; those that follow are only counted"
            ));
        }
        if let Some(file) = &mut self.json {
            file.note(&format!(",\n{}", json!({ "dropped_commands": dropped })));
        }
    }

    /// Says something about the capture.
    pub fn say(&mut self, message: &str) {
        self.write_text(&format!("TUFF_CAPTURE_PIXEL: {message}\n"));
    }

    fn write_text(&mut self, text: &str) {
        match &mut self.text {
            Text::Nowhere => {}
            // A closed standard error is no reason to end the process.
            Text::StandardError => drop(std::io::stderr().write_all(text.as_bytes())),
            Text::File(path, file, size_bytes) => match file.write_all(text.as_bytes()) {
                Ok(()) => *size_bytes += text.len() as u64,
                Err(why) => {
                    // The disk is full: what was written of this text does not stay.
                    let _ = file.set_len(*size_bytes);
                    log::error!("{FOLDER}: {}: {why}; the text ends here", path.display());
                    self.text = Text::Nowhere;
                }
            },
        }
        self.bytes += text.len();
    }
}
