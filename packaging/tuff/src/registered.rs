//! Entries of Tuff in Windows' registry; other systems have none.

use std::path::Path;

/// An entry.
pub struct Registered {
    pub manifest: String,
    pub is_for_all_users: bool,
}

impl Registered {
    /// Whether the entry is for this manifest, which may be registered by its folder's short name.
    pub fn is_of(&self, manifest: &Path) -> bool {
        let real = |path: &Path| std::fs::canonicalize(path).ok();
        let own = real(Path::new(&self.manifest));
        own.is_some() && own == real(manifest)
    }
}

#[cfg(not(windows))]
pub fn all() -> Vec<Registered> {
    Vec::new()
}

#[cfg(windows)]
pub fn all() -> Vec<Registered> {
    let found = crate::registration::of_tuff(&crate::registration::System);
    let entry = |(hive, manifest)| Registered {
        manifest,
        is_for_all_users: hive == crate::os::Hive::Machine,
    };
    found.into_iter().map(entry).collect()
}
