//! One room for the operating system: nothing that ships names `libc` or `std::os` outside of it.
//! Tests may.

use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The sources that ship, and the room of each: a folder or a file, if there is one.
const SHIPPED: [(&str, Option<&str>); 7] = [
    ("icd/src", Some("icd/src/os")),
    ("icd/cgroup/src", None),
    ("packaging/tuff/src", Some("packaging/tuff/src/os")),
    ("spirv-jit/src", None),
    ("spirv-jit/images/src", None),
    ("traversal/src", None),
    ("traversal/lanes/src", None),
];

/// Crates that are interfaces of systems.
const CRATES: [&str; 6] = [
    "libc",
    "nix",
    "rustix",
    "winapi",
    "windows_registry",
    "windows_sys",
];

#[test]
fn the_system_is_asked_in_its_room() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut outside = Vec::new();
    for (sources, room) in SHIPPED {
        let mut files = Vec::new();
        collect(&root.join(sources), &mut files);
        assert!(!files.is_empty(), "no sources in {sources}");
        let mut is_asked_inside = false;
        for file in files {
            let inside = file.strip_prefix(&root).expect("found below the root");
            let text = fs::read_to_string(&file).expect("a source file can be read");
            let names = system_names(&text);
            if names.is_empty() {
                continue;
            }
            if room.is_some_and(|room| inside.starts_with(room)) {
                is_asked_inside = true;
            } else {
                outside.push(format!("{}: {names:?}", inside.display()));
            }
        }
        assert_eq!(is_asked_inside, room.is_some(), "the room of {sources}");
    }
    outside.sort();
    assert!(
        outside.is_empty(),
        "outside of the room:\n{}",
        outside.join("\n")
    );
}

#[test]
fn names_of_the_system_are_found_wherever_they_stand() {
    let named = [
        "use libc;",
        "use libc::{mmap, munmap};",
        "use std::os::fd::OwnedFd;",
        "use std::{fs::File, os::unix::fs::FileExt};",
        "use {std::{os::fd}, core::mem};",
        "use ::std::os;",
        "fn f() -> std::os::fd::RawFd { 0 }",
        "table! { fn f() { libc::close(0); } }",
        "#[cfg(unix)] use std::os::fd::OwnedFd;",
        "#[cfg(test)] mod tests { use super::*; } fn f() { libc::close(0); }",
        "#[cfg(test)] use std::fs; use libc::close;",
    ];
    for text in named {
        assert!(!system_names(text).is_empty(), "{text}");
    }
    let unnamed = [
        "use std::ffi::c_void;",
        "use crate::os::handle::Handle; use std::{fmt, ops::Range};",
        "/// As libc::mmap and `std::os`.\nfn f() { g(\"libc\"); os(1); }",
        "#[cfg(test)] mod tests { fn f() { libc::close(0); } }",
        "#[cfg(test)] #[allow(unused)] use std::os::fd::OwnedFd;",
        "#[cfg(all(test, unix))] fn f() { libc::close(0); }",
    ];
    for text in unnamed {
        assert_eq!(system_names(text), [""; 0], "{text}");
    }
}

/// The names of system interfaces in a source, those of tests left out.
fn system_names(source: &str) -> Vec<String> {
    let tokens = source.parse().expect("a source file is tokens");
    let mut names = Vec::new();
    note(tokens, &mut names);
    names
}

fn note(tokens: TokenStream, names: &mut Vec<String>) {
    let mut before: Vec<TokenTree> = Vec::new();
    let mut tokens = tokens.into_iter();
    while let Some(token) = tokens.next() {
        match &token {
            TokenTree::Group(group) if is_attribute_of_tests(&before, group) => {
                skip_item(&mut tokens);
                continue;
            }
            TokenTree::Group(group) => {
                // `std::{os::…}`
                if is_behind(&before, "std") {
                    let of_std = group.stream().into_iter().collect::<Vec<_>>();
                    let mut parts = of_std.split(|token| is_punct(token, ','));
                    if parts.any(|part| part.first().is_some_and(|first| is_ident(first, "os"))) {
                        names.push("std::os".into());
                    }
                }
                note(group.stream(), names);
            }
            TokenTree::Ident(ident) if CRATES.iter().any(|name| ident == name) => {
                names.push(ident.to_string());
            }
            TokenTree::Ident(ident) if ident == "os" && is_behind(&before, "std") => {
                names.push("std::os".into());
            }
            _ => {}
        }
        before.push(token);
    }
}

/// Whether `name::` comes before.
fn is_behind(before: &[TokenTree], name: &str) -> bool {
    matches!(before, [.., path, first, second]
        if is_ident(path, name) && is_punct(first, ':') && is_punct(second, ':'))
}

fn is_ident(token: &TokenTree, name: &str) -> bool {
    matches!(token, TokenTree::Ident(ident) if ident == name)
}

fn is_punct(token: &TokenTree, sign: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == sign)
}

/// Whether a group is that of `#[cfg(test)]` or `#[cfg(all(test, …))]`.
fn is_attribute_of_tests(before: &[TokenTree], group: &proc_macro2::Group) -> bool {
    let text: String = group.to_string().split_whitespace().collect();
    before.last().is_some_and(|sign| is_punct(sign, '#'))
        && (text == "[cfg(test)]" || text.starts_with("[cfg(all(test,"))
}

/// Skips an item: up to its body, or to its semicolon.
fn skip_item(tokens: &mut impl Iterator<Item = TokenTree>) {
    let mut is_import = false;
    for token in tokens {
        is_import |= is_ident(&token, "use");
        let is_body =
            matches!(&token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace);
        if is_punct(&token, ';') || is_body && !is_import {
            return;
        }
    }
}

/// The files below a folder, those of tests left out.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources can be listed") {
        let path = entry.expect("an entry can be read").path();
        let name = path.file_stem().expect("a name");
        if name == "tests" {
            continue;
        }
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
}
