//! The files of an installation, before they go into a package.

use std::collections::{BTreeMap, BTreeSet};

/// A file's bytes, and whether it is executable.
#[derive(Clone, Debug)]
pub struct Entry {
    pub bytes: Vec<u8>,
    pub is_program: bool,
}

impl Entry {
    pub fn file(bytes: Vec<u8>) -> Entry {
        Entry {
            bytes,
            is_program: false,
        }
    }

    pub fn program(bytes: Vec<u8>) -> Entry {
        Entry {
            bytes,
            is_program: true,
        }
    }

    /// Unix permissions.
    pub fn mode(&self) -> u32 {
        match self.is_program {
            true => 0o755,
            false => 0o644,
        }
    }
}

/// Files by their paths, with `/` between folders and none at the start.
#[derive(Clone, Debug, Default)]
pub struct Tree(BTreeMap<String, Entry>);

impl Tree {
    pub fn add(&mut self, path: &str, entry: Entry) {
        assert!(!path.starts_with('/') && !path.contains(".."), "{path}");
        let before = self.0.insert(path.into(), entry);
        assert!(before.is_none(), "{path} comes twice");
    }

    /// All files, in order.
    pub fn files(&self) -> impl Iterator<Item = (&str, &Entry)> {
        self.0.iter().map(|(path, entry)| (path.as_str(), entry))
    }

    /// All folders of files, each before its contents.
    pub fn folders(&self) -> BTreeSet<&str> {
        let above = |path: &'_ str| {
            path.rmatch_indices('/')
                .map(|(at, _)| at)
                .collect::<Vec<_>>()
        };
        (self.0.keys())
            .flat_map(|path| above(path).into_iter().map(move |at| &path[..at]))
            .collect()
    }

    /// A tree with only the file of this path, if it exists.
    pub fn only(&self, path: &str) -> Tree {
        let file = self.0.get_key_value(path);
        Tree(
            file.map(|(path, entry)| (path.clone(), entry.clone()))
                .into_iter()
                .collect(),
        )
    }

    /// The same below a folder.
    pub fn below(&self, folder: &str) -> Tree {
        let files = self.0.iter();
        Tree(
            files
                .map(|(path, entry)| (format!("{folder}/{path}"), entry.clone()))
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_before_what_is_inside() {
        let mut tree = Tree::default();
        tree.add("b/c/d", Entry::file(vec![]));
        tree.add("a", Entry::program(vec![]));
        let tree = tree.below("top");
        let folders: Vec<&str> = tree.folders().into_iter().collect();
        assert_eq!(folders, ["top", "top/b", "top/b/c"]);
        let files: Vec<_> = tree
            .files()
            .map(|(path, entry)| (path, entry.mode()))
            .collect();
        assert_eq!(files, [("top/a", 0o755), ("top/b/c/d", 0o644)]);
    }
}
