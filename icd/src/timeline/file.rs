//! A file that is a whole JSON array after each write, so that a process that dies leaves one that
//! can be opened.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// Behind the last element.
const TAIL: &str = "\n]\n";

/// The file, until a write fails.
pub struct ArrayFile {
    /// The setting that asks for it, and what the file is, for messages.
    subject: (&'static str, &'static str),
    path: String,
    file: Option<File>,
    /// Bytes before the tail, or before the last note.
    size_bytes: u64,
}

impl ArrayFile {
    /// An array of one element, in place of any file of that name. `subject`: the setting that asks
    /// for it, and what the file is.
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

    /// Adds elements, each behind a comma; whether more are wanted.
    pub fn append(&mut self, elements: &str) -> bool {
        let Some(file) = &mut self.file else {
            return false;
        };
        let written = put(file, self.size_bytes, &format!("{elements}{TAIL}"));
        match written {
            Ok(()) => self.size_bytes += elements.len() as u64,
            Err(why) => {
                // The disk is full: the old end has its place already.
                let _ = file.set_len(self.size_bytes);
                let _ = put(file, self.size_bytes, TAIL);
                self.give_up(&why);
            }
        }
        self.file.is_some()
    }

    /// Replaces the last note, which only the next note follows: elements are not added behind it.
    pub fn note(&mut self, element: &str) -> bool {
        let size_bytes = self.size_bytes;
        let kept = self.append(element);
        self.size_bytes = size_bytes;
        kept
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
