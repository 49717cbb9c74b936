//! Memory limit of the process's control group. Containers and CI jobs have less memory than the
//! machine.
//!
//! cgroups(7); the files are those of Documentation/admin-guide/cgroup-v2.rst and
//! cgroup-v1/memory.rst of Linux.

#![forbid(unsafe_code)]

use std::fs::File;
use std::io;
use std::path::Path;

/// Reads from an offset of a file, and leaves the file's position alone (pread(2)). The caller
/// passes it, so that this crate names no system.
pub type ReadAt = fn(&File, &mut [u8], u64) -> io::Result<usize>;

/// The names that one version of control groups gives its files.
struct Files {
    /// Where the hierarchy is mounted, by the convention that all distributions and container
    /// engines keep.
    mount: &'static str,
    limit: &'static str,
    used: &'static str,
    /// The line of `memory.stat` that counts what can be given back at once: files that were read
    /// and not used lately.
    reclaimable: &'static str,
}

const UNIFIED: Files = Files {
    mount: "sys/fs/cgroup",
    limit: "memory.max",
    used: "memory.current",
    reclaimable: "inactive_file",
};

const LEGACY: Files = Files {
    mount: "sys/fs/cgroup/memory",
    limit: "memory.limit_in_bytes",
    used: "memory.usage_in_bytes",
    reclaimable: "total_inactive_file",
};

/// Memory of a control group and of those around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// The least limit, in bytes.
    pub limit_bytes: u64,
    /// Bytes that can still be taken before one of the limits is reached.
    pub free_bytes: u64,
}

/// The groups that limit the process. Their files stay open, so that a sandbox entered later can
/// refuse to open any.
#[derive(Debug)]
pub struct Groups {
    groups: Vec<Group>,
    read_at: ReadAt,
}

impl Groups {
    /// The process's group and the groups around it, those with a limit.
    pub fn open(read_at: ReadAt) -> Self {
        Self::below(Path::new("/"), read_at)
    }

    /// As [`Self::open`], with the files below `root`.
    fn below(root: &Path, read_at: ReadAt) -> Self {
        let groups = std::fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
        let groups = groups.lines();
        let groups = groups.filter_map(|line| of_line(root, line, read_at));
        Self {
            groups: groups.flatten().collect(),
            read_at,
        }
    }

    /// The tightest limits now; `None` where there are none.
    pub fn memory(&self) -> Option<Memory> {
        let groups = self.groups.iter();
        let limits = groups.filter_map(|group| group.memory(self.read_at));
        limits.reduce(tighter)
    }
}

/// The groups of one line of `/proc/self/cgroup`: `hierarchy:controllers:path`.
fn of_line(root: &Path, line: &str, read_at: ReadAt) -> Option<Vec<Group>> {
    let mut fields = line.splitn(3, ':');
    let (hierarchy, controllers, path) = (fields.next()?, fields.next()?, fields.next()?);
    let files = match (hierarchy, controllers) {
        ("0", "") => &UNIFIED,
        (_, controllers) if controllers.split(',').any(|name| name == "memory") => &LEGACY,
        _ => return None,
    };
    let mount = root.join(files.mount);
    // A container may see its own group as the mount's root, by a path that is the host's: groups
    // that are not there say nothing.
    let own = mount.join(path.trim_start_matches('/'));
    let groups = own
        .ancestors()
        .take_while(|group| group.starts_with(&mount))
        .filter_map(|group| Group::open(group, files, read_at));
    Some(groups.collect())
}

/// The files of a group that has a limit.
#[derive(Debug)]
struct Group {
    limit: File,
    used: Option<File>,
    stat: Option<File>,
    reclaimable: &'static str,
}

impl Group {
    fn open(group: &Path, files: &'static Files, read_at: ReadAt) -> Option<Self> {
        let open = |name: &str| File::open(group.join(name)).ok();
        let limit = open(files.limit)?;
        limit_bytes(&limit, read_at)?;
        Some(Self {
            limit,
            used: open(files.used),
            stat: open("memory.stat"),
            reclaimable: files.reclaimable,
        })
    }

    fn memory(&self, read_at: ReadAt) -> Option<Memory> {
        let limit_bytes = limit_bytes(&self.limit, read_at)?;
        let used = self.used.as_ref().and_then(|file| number(file, read_at));
        let reclaimable = self.reclaimable_bytes(read_at).unwrap_or(0);
        let used = used.unwrap_or(0).saturating_sub(reclaimable);
        Some(Memory {
            limit_bytes,
            free_bytes: limit_bytes.saturating_sub(used),
        })
    }

    fn reclaimable_bytes(&self, read_at: ReadAt) -> Option<u64> {
        let text = text(self.stat.as_ref()?, read_at)?;
        let mut lines = text.lines().filter_map(|line| line.split_once(' '));
        let (_, bytes) = lines.find(|(key, _)| *key == self.reclaimable)?;
        bytes.trim().parse().ok()
    }
}

/// A limit; "max", and in the older version a number near 2^63, mean that there is none.
fn limit_bytes(file: &File, read_at: ReadAt) -> Option<u64> {
    number(file, read_at).filter(|&limit| limit < 1 << 60)
}

fn number(file: &File, read_at: ReadAt) -> Option<u64> {
    text(file, read_at)?.trim().parse().ok()
}

/// The current contents of a file, from its start.
fn text(file: &File, read_at: ReadAt) -> Option<String> {
    let mut text = Vec::new();
    loop {
        let mut part = [0; 4096];
        match read_at(file, &mut part, text.len() as u64).ok()? {
            0 => return String::from_utf8(text).ok(),
            length => text.extend_from_slice(&part[..length]),
        }
    }
}

fn tighter(a: Memory, b: Memory) -> Memory {
    Memory {
        limit_bytes: a.limit_bytes.min(b.limit_bytes),
        free_bytes: a.free_bytes.min(b.free_bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::FileExt;
    use std::path::PathBuf;

    /// A folder with the files that a kernel would show.
    struct Root(PathBuf);

    impl Root {
        fn new(name: &str, files: &[(&str, &str)]) -> Root {
            let name = format!("tuff-cgroup-{}-{name}", std::process::id());
            let root = Root(std::env::temp_dir().join(name));
            for (path, text) in files {
                let path = root.0.join(path);
                std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
                std::fs::write(path, text).expect("written");
            }
            root
        }

        fn memory(&self) -> Option<Memory> {
            Groups::below(&self.0, FileExt::read_at).memory()
        }
    }

    impl Drop for Root {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn the_tightest_group_counts() {
        let root = Root::new(
            "unified",
            &[
                ("proc/self/cgroup", "0::/jobs/one\n"),
                ("sys/fs/cgroup/jobs/one/memory.max", "max\n"),
                ("sys/fs/cgroup/jobs/memory.max", "1000000\n"),
                ("sys/fs/cgroup/jobs/memory.current", "700000\n"),
                (
                    "sys/fs/cgroup/jobs/memory.stat",
                    "anon 1\ninactive_file 100000\n",
                ),
                ("sys/fs/cgroup/memory.max", "2000000\n"),
                ("sys/fs/cgroup/memory.current", "1900000\n"),
            ],
        );
        let expected = Memory {
            limit_bytes: 1_000_000,
            free_bytes: 100_000,
        };
        assert_eq!(root.memory(), Some(expected));
    }

    #[test]
    fn a_container_with_the_hosts_path_sees_its_own_group_at_the_mount() {
        let root = Root::new(
            "legacy",
            &[
                (
                    "proc/self/cgroup",
                    "5:cpu,cpuacct:/docker/a\n4:memory:/docker/a\n",
                ),
                ("sys/fs/cgroup/memory/memory.limit_in_bytes", "536870912\n"),
                ("sys/fs/cgroup/memory/memory.usage_in_bytes", "36870912\n"),
            ],
        );
        let expected = Memory {
            limit_bytes: 536_870_912,
            free_bytes: 500_000_000,
        };
        assert_eq!(root.memory(), Some(expected));
    }

    #[test]
    fn what_is_used_is_read_anew() {
        let current = "sys/fs/cgroup/memory.current";
        let files = [
            ("proc/self/cgroup", "0::/\n"),
            ("sys/fs/cgroup/memory.max", "1000000\n"),
            (current, "700000\n"),
        ];
        let root = Root::new("anew", &files);
        let groups = Groups::below(&root.0, FileExt::read_at);
        let free = |groups: &Groups| groups.memory().map(|memory| memory.free_bytes);
        assert_eq!(free(&groups), Some(300_000));
        // Nothing is opened again: the file that names the groups may be gone.
        std::fs::write(root.0.join(current), "900000\n").expect("written");
        std::fs::remove_file(root.0.join("proc/self/cgroup")).expect("removed");
        assert_eq!(free(&groups), Some(100_000));
    }

    #[test]
    fn no_limit_is_none() {
        let unlimited = Root::new(
            "unlimited",
            &[
                ("proc/self/cgroup", "4:memory:/\n"),
                (
                    "sys/fs/cgroup/memory/memory.limit_in_bytes",
                    "9223372036854771712\n",
                ),
            ],
        );
        assert_eq!(unlimited.memory(), None);
        assert_eq!(Root::new("nothing", &[]).memory(), None);
    }
}
