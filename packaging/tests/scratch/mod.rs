//! Folders of tests.

use std::fs;
use std::path::PathBuf;

/// A folder of a test, which is removed at the end.
pub struct Scratch(pub PathBuf);

impl Scratch {
    /// Creates a folder whose name contains `name`.
    pub fn new(name: &str) -> Scratch {
        let name = format!("tuff-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder).expect("a folder can be made");
        Scratch(folder)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
