//! A file of events that is a whole JSON array after each write, so that a process that dies leaves
//! one that can be opened.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// Behind the last event.
const TAIL: &str = "\n]\n";

/// The file, until a write fails.
pub struct TraceFile {
    path: String,
    file: Option<File>,
    /// Bytes before the tail.
    size_bytes: u64,
}

impl TraceFile {
    /// An array of one event, in place of any file of that name.
    pub fn new(path: &str, first: &str) -> Self {
        let mut made = Self {
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

    /// Whether events can be added.
    pub fn is_open(&self) -> bool {
        self.file.is_some()
    }

    /// Adds events, each behind a comma; whether more are wanted.
    pub fn append(&mut self, events: &str) -> bool {
        let Some(file) = &mut self.file else {
            return false;
        };
        let written = put(file, self.size_bytes, &format!("{events}{TAIL}"));
        match written {
            Ok(()) => self.size_bytes += events.len() as u64,
            Err(why) => {
                // The disk is full: the old end has its place already.
                let _ = file.set_len(self.size_bytes);
                let _ = put(file, self.size_bytes, TAIL);
                self.give_up(&why);
            }
        }
        self.file.is_some()
    }

    fn give_up(&mut self, why: &io::Error) {
        log::error!("TUFF_TRACE: {}: {why}; the timeline ends here", self.path);
        self.file = None;
    }
}

fn put(file: &mut File, at: u64, text: &str) -> io::Result<()> {
    if at > 0 {
        file.seek(SeekFrom::Start(at))?;
    }
    file.write_all(text.as_bytes())
}
