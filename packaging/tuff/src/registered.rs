//! Entries of Tuff in Windows' registry; other systems have none.

/// An entry.
pub struct Registered {
    pub manifest: String,
    pub is_for_all_users: bool,
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
