//! A file that holds a complete JSON array after each write, so that the file of a crashed process
//! can be opened.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// The text after the last element.
const TAIL: &str = "\n]\n";

/// The file, until a write fails.
pub struct ArrayFile {
    /// The setting that asks for the file and the file's purpose, for messages.
    subject: (&'static str, &'static str),
    path: String,
    file: Option<File>,
    /// The offset of the tail, or of the last note.
    size_bytes: u64,
}

impl ArrayFile {
    /// Creates an array of one element, and replaces any file of that name. `subject` is the
    /// setting that asks for it, and the file's purpose.
    pub fn new(subject: (&'static str, &'static str), path: &str, first: &str) -> Self {
        let mut made = Self {
            subject,
            path: path.to_owned(),
            file: None,
            size_bytes: 0,
        };
        match File::create(path) {
            Ok(file) => {
                made.file = Some(file);
                made.append(&format!("[\n{first}"));
            }
            Err(why) => made.give_up(&why),
        }
        made
    }

    /// Whether elements can be added.
    pub fn is_open(&self) -> bool {
        self.file.is_some()
    }

    /// Adds elements, each after a comma. Returns whether the file accepts more.
    pub fn append(&mut self, elements: &str) -> bool {
        let Some(file) = &mut self.file else {
            return false;
        };
        let written = put(file, self.size_bytes, &format!("{elements}{TAIL}"));
        match written {
            Ok(()) => self.size_bytes += elements.len() as u64,
            Err(why) => {
                // The disk is full. The space of the old end is still allocated.
                let _ = file.set_len(self.size_bytes);
                let _ = put(file, self.size_bytes, TAIL);
                self.give_up(&why);
            }
        }
        self.file.is_some()
    }

    /// Replaces the last note. Another note or elements that follow take its place, and must not be
    /// shorter.
    pub fn note(&mut self, element: &str) -> bool {
        let size_bytes = self.size_bytes;
        let kept = self.append(element);
        self.size_bytes = size_bytes;
        kept
    }

    /// Ends the file as it is, for a reason that is told.
    pub fn end(&mut self, why: &str) {
        log::error!("{}: {why}", self.subject.0);
        self.file = None;
    }

    fn give_up(&mut self, why: &io::Error) {
        let (setting, what) = self.subject;
        log::error!("{setting}: {}: {why}; {what} ends here", self.path);
        self.file = None;
    }
}

fn put(file: &mut File, at: u64, text: &str) -> io::Result<()> {
    if at > 0 {
        file.seek(SeekFrom::Start(at))?;
    }
    file.write_all(text.as_bytes())
}
