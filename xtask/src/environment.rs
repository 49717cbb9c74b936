//! The user's environment. Cargo and rustup change it before `cargo xtask` starts, and programs
//! that this one starts must not see the changes.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Variables, in any order.
type Variables = Vec<(OsString, OsString)>;

/// The variables that cargo and rustup had set.
static OF_CARGO: OnceLock<Variables> = OnceLock::new();

/// The search path of libraries.
const LIBRARIES: &str = "LD_LIBRARY_PATH";

/// Removes the changes of cargo and rustup from this process's environment. `target` is cargo's
/// target directory.
///
/// # Safety
/// No other thread runs, so nothing else accesses the environment.
pub unsafe fn restore(target: &Path) {
    let found: Variables = std::env::vars_os().collect();
    let users = users(&found, target);
    let changed = found.into_iter().filter(|it| !users.contains(it));
    let changed: Variables = changed.collect();
    for (name, _) in &changed {
        let before = users.iter().find(|(user, _)| user == name);
        // SAFETY: the caller says that no other thread runs.
        unsafe {
            match before {
                Some((_, value)) => std::env::set_var(name, value),
                None => std::env::remove_var(name),
            }
        }
    }
    // The function is called once, at the start.
    let _ = OF_CARGO.set(changed);
}

/// Restores cargo's own variables, above all the toolchain. Without them a build may find another
/// compiler.
pub fn give_back(cargo: &mut Command) {
    cargo.envs(OF_CARGO.get().into_iter().flatten().cloned());
}

/// A variable as cargo set it.
pub fn of_cargo(name: &str) -> Option<&'static OsStr> {
    let mut set = OF_CARGO.get()?.iter();
    set.find(|(set, _)| set == name).map(|(_, value)| &**value)
}

/// The user's variables, with their original values, from the environment under `cargo run`.
///
/// `cargo run` sets all that is taken out here (The Cargo Book, "Environment Variables", and
/// rustup's `Toolchain::set_env`). Two things cannot be told from the user's own and stay:
/// `SSL_CERT_FILE` and `SSL_CERT_DIR`, by which cargo names the system's certificates if the user
/// does not, and rustup's folder of programs at the front of `PATH`.
fn users(found: &Variables, target: &Path) -> Variables {
    let value = |name: &str| {
        let mut found = found.iter();
        found.find(|(it, _)| it == name).map(|(_, value)| &**value)
    };
    // A program started by its path has the user's environment already.
    if value("CARGO_PKG_NAME") != Some(OsStr::new(env!("CARGO_PKG_NAME"))) {
        return found.clone();
    }
    let is_default = |name: &str, folder: &str| match (value(name), value("HOME")) {
        (Some(set), Some(home)) => Path::new(set) == Path::new(home).join(folder),
        _ => false,
    };
    let toolchain = value("RUSTUP_TOOLCHAIN");
    let by_rustup = value("RUST_RECURSION_COUNT").is_some();
    let keep = |(name, set): &(OsString, OsString)| -> Option<(OsString, OsString)> {
        let same = || Some((name.clone(), set.clone()));
        match name.to_str() {
            Some("CARGO" | "CARGO_MANIFEST_DIR" | "CARGO_MANIFEST_PATH") => None,
            Some(name) if name.starts_with("CARGO_PKG_") => None,
            // Rustup names both folders. Those that it would take anyhow mean nothing; others are
            // the user's.
            Some(name @ "CARGO_HOME") if by_rustup && is_default(name, ".cargo") => None,
            Some(name @ "RUSTUP_HOME") if by_rustup && is_default(name, ".rustup") => None,
            Some("RUSTUP_TOOLCHAIN_SOURCE") => None,
            // The toolchain is the user's if rustup says that it found it in the environment.
            Some("RUSTUP_TOOLCHAIN") if by_rustup => match value("RUSTUP_TOOLCHAIN_SOURCE") {
                Some(source) if source == "env" => same(),
                _ => None,
            },
            // A count of rustup's programs that started one another; the user's shell may be one of
            // them.
            Some("RUST_RECURSION_COUNT") => match set.to_str().and_then(|set| set.parse().ok()) {
                Some(2u32..) => {
                    let outer = set.to_str()?.parse::<u32>().ok()? - 1;
                    Some((name.clone(), outer.to_string().into()))
                }
                _ => None,
            },
            Some(LIBRARIES) => {
                let rest = users_libraries(set, target, toolchain.is_some());
                rest.map(|rest| (name.clone(), rest))
            }
            _ => same(),
        }
    };
    found.iter().filter_map(keep).collect()
}

/// The rest of a list of folders without those that cargo and rustup put before it: of the
/// target directory, and of the toolchain.
fn users_libraries(list: &OsStr, target: &Path, by_rustup: bool) -> Option<OsString> {
    let real = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let target = real(target);
    let mut libraries = None;
    let mut folders = std::env::split_paths(list).peekable();
    while let Some(folder) = folders.peek() {
        if let Some(of_toolchain) = around_the_standard_library(folder) {
            libraries = Some(of_toolchain.to_path_buf());
        } else if !(real(folder).starts_with(&target)
            || by_rustup && libraries.as_ref() == Some(folder))
        {
            break;
        }
        folders.next();
    }
    let rest: Vec<PathBuf> = folders.collect();
    // Folders of one list are free of its separator.
    let rest = std::env::join_paths(rest).ok()?;
    (!rest.is_empty()).then_some(rest)
}

/// The toolchain's folder `lib`, which rustup names too, if a folder is its
/// `lib/rustlib/PLATFORM/lib`.
fn around_the_standard_library(folder: &Path) -> Option<&Path> {
    let above = folder.ancestors().nth(2)?;
    let is_it = folder.ends_with("lib") && above.ends_with("rustlib");
    above.parent().filter(|_| is_it)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variables(list: &[(&str, &str)]) -> Variables {
        let mut list: Variables = list.iter().map(|(a, b)| (a.into(), b.into())).collect();
        list.sort();
        list
    }

    /// The variables that `cargo run` adds where rustup is, as it was seen there.
    const ADDED: [(&str, &str); 9] = [
        ("CARGO", "/home/ada/.rustup/toolchains/stable/bin/cargo"),
        ("CARGO_HOME", "/home/ada/.cargo"),
        ("CARGO_MANIFEST_DIR", "/tuff/xtask"),
        ("CARGO_MANIFEST_PATH", "/tuff/xtask/Cargo.toml"),
        ("CARGO_PKG_NAME", "xtask"),
        ("CARGO_PKG_VERSION", "0.1.0"),
        ("RUSTUP_HOME", "/home/ada/.rustup"),
        ("RUSTUP_TOOLCHAIN", "stable"),
        ("RUST_RECURSION_COUNT", "1"),
    ];

    /// The folders that cargo and rustup put before the user's.
    const FOLDERS: &str = "/tuff/target/debug/build/zstd/out:/tuff/target/debug:/tuff/target/debug/deps:\
        /toolchains/stable/lib/rustlib/x86_64-unknown-linux-gnu/lib:/toolchains/stable/lib";

    #[track_caller]
    fn expect(own: &[(&str, &str)], libraries: Option<&str>, changed: &[(&str, &str)]) {
        let list = match libraries {
            Some(list) => format!("{FOLDERS}:{list}"),
            None => FOLDERS.into(),
        };
        let mut found: Vec<_> = own.to_vec();
        let set = |name: &str| own.iter().chain(changed).any(|(own, _)| *own == name);
        found.extend(ADDED.iter().filter(|(name, _)| !set(name)));
        found.extend_from_slice(changed);
        found.push((LIBRARIES, &list));
        let mut expected: Vec<_> = own.to_vec();
        expected.extend(libraries.map(|list| (LIBRARIES, list)));
        let mut users = users(&variables(&found), Path::new("/tuff/target"));
        users.sort();
        assert_eq!(users, variables(&expected));
    }

    #[test]
    fn what_cargo_and_rustup_set_is_taken_out() {
        let own = [("HOME", "/home/ada"), ("PATH", "/usr/bin")];
        expect(&own, None, &[]);
        expect(&own, Some("/opt/lib:/opt/more"), &[]);
        // Only those at the front: here the user names the toolchain's folder, too.
        expect(&own, Some("/opt/lib:/toolchains/stable/lib"), &[]);
        expect(
            &own,
            Some("/opt/lib"),
            &[("RUSTUP_TOOLCHAIN_SOURCE", "default")],
        );
    }

    #[test]
    fn what_the_user_set_stays() {
        let home = ("HOME", "/home/ada");
        // As in a container of Rust's.
        let folders = [
            home,
            ("CARGO_HOME", "/usr/local/cargo"),
            ("RUSTUP_HOME", "/usr/local/rustup"),
            ("CARGO_TARGET_DIR", "/tmp/target"),
            ("CARGO_TERM_COLOR", "always"),
        ];
        expect(&folders, Some("/opt/lib"), &[]);
        let toolchain = [home, ("RUSTUP_TOOLCHAIN", "nightly")];
        expect(&toolchain, None, &[("RUSTUP_TOOLCHAIN_SOURCE", "env")]);
    }

    #[test]
    fn a_shell_that_rustup_started_keeps_its_count() {
        let found = variables(&[("CARGO_PKG_NAME", "xtask"), ("RUST_RECURSION_COUNT", "3")]);
        let users = users(&found, Path::new("/tuff/target"));
        assert_eq!(users, variables(&[("RUST_RECURSION_COUNT", "2")]));
    }

    #[test]
    fn started_by_its_path_it_changes_nothing() {
        let found = variables(&[
            ("CARGO_MANIFEST_DIR", "/other"),
            ("CARGO_PKG_NAME", "other"),
            (LIBRARIES, "/tuff/target/debug"),
        ]);
        assert_eq!(users(&found, Path::new("/tuff/target")), found);
    }
}
