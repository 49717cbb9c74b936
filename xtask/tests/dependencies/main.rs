//! Dependencies between the folders of a crate point one way, and no files use each other.
//!
//! Each crate's folders (and files at its root) stand in an order; a folder may use those behind it
//! in the order, never one before it, and some must not use others at all. Paths are taken from the
//! parsed sources: `use` trees, paths inside expressions and types, and `crate::` inside macros.
//! Modules called `tests` may use what they like.

mod files;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

/// A crate's folders, from users to used ones.
struct House {
    name: &'static str,
    order: &'static [&'static str],
    /// Folders that must not use others behind them: the first of each pair the second.
    apart: &'static [(&'static str, &'static str)],
    /// Arrows back that are still there: each entry must be found, so that none outlives its
    /// reason.
    still_back: &'static [(&'static str, &'static str)],
}

const HOUSES: [House; 4] = [
    House {
        name: "icd",
        order: &[
            "entry",
            "decode",
            "device",
            "queue",
            "present",
            "execute",
            "raster",
            "compute",
            "trace",
            "structures",
            "transfer",
            "validate",
            "capture",
            "command",
            "object",
            "format",
            "wave",
            "capabilities",
            "settings",
            "timeline",
            "guard",
            "float_environment",
            "handle",
            "logger",
            "ffi",
            "os",
        ],
        // Work of one kind needs no work of another kind: the code that they share is in `wave`.
        apart: &[
            ("raster", "compute"),
            ("raster", "trace"),
            ("raster", "structures"),
            ("compute", "trace"),
            ("compute", "structures"),
            ("compute", "transfer"),
            ("trace", "structures"),
            ("trace", "transfer"),
            ("structures", "transfer"),
        ],
        still_back: &[],
    },
    House {
        name: "spirv-jit",
        order: &[
            "program",
            "interp",
            "native",
            "plan",
            "pass",
            "lower",
            "request",
            "descriptor_heap",
            "accuracy",
            "parse",
            "origin",
            "ir",
            "state",
            "environment",
            "abort",
            "descriptor",
            "views",
            "reach",
            "printf",
            "query",
            "hit_object",
            "facts",
            "eval",
            "half_vectors",
            "error",
            "types",
        ],
        apart: &[],
        still_back: &[],
    },
    House {
        name: "spirv-jit/images",
        order: &[
            "execute",
            "ycbcr",
            "block",
            "wave",
            "stores",
            "loads",
            "plain",
            "axes",
            "fast",
            "sample",
            "access",
            "texels",
            "chunk",
            "decode",
            "lod",
            "cube",
            "address",
            "derivatives",
            "operands",
            "rows",
            "residency",
            "halve",
            "format",
            "compressed",
            "srgb",
        ],
        apart: &[],
        still_back: &[],
    },
    House {
        name: "traversal",
        order: &[
            "ray_report",
            "cost",
            "transfer",
            "build",
            "walk",
            "structure",
            "input",
            "micromap",
            "motion",
            "ray",
            "layout",
            "live",
            "error",
            "memory",
            "pool",
        ],
        apart: &[],
        still_back: &[],
    },
];

#[test]
fn folders_use_only_what_stands_behind_them() {
    for house in &HOUSES {
        let arrows = arrows(&source_of(house));
        let place = |folder: &str| house.order.iter().position(|other| *other == folder);
        let mut back = BTreeMap::new();
        for ((from, to), files) in &arrows {
            let (from, to) = (from.as_str(), to.as_str());
            let places = (place(from), place(to));
            let (Some(from_place), Some(to_place)) = places else {
                panic!("{}: {from} -> {to}: not in the order", house.name);
            };
            assert!(
                !house.apart.contains(&(from, to)),
                "{}: {from} -> {to} in {files:?}",
                house.name
            );
            if from_place > to_place {
                back.insert((from, to), files);
            }
        }
        let known: BTreeSet<_> = house.still_back.iter().copied().collect();
        for (arrow, files) in &back {
            assert!(
                known.contains(arrow),
                "{}: {arrow:?} in {files:?}",
                house.name
            );
        }
        for arrow in known {
            assert!(
                back.contains_key(&arrow),
                "{}: {arrow:?} is gone",
                house.name
            );
        }
    }
}

fn source_of(house: &House) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.join(house.name).join("src")
}

/// Which folder names which other one, and in which files.
fn arrows(source: &Path) -> BTreeMap<(String, String), BTreeSet<PathBuf>> {
    let mut files = Vec::new();
    collect(source, &mut files);
    assert!(!files.is_empty(), "no sources in {}", source.display());
    let mut arrows: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
    for file in files {
        let inside = file.strip_prefix(source).expect("found below the folder");
        let module = module_of(inside);
        let Some(from) = module.first().cloned() else {
            // The crate's root names everything.
            continue;
        };
        if module.iter().any(|name| name == "tests") {
            continue;
        }
        let text = fs::read_to_string(&file).expect("a source file can be read");
        let parsed = syn::parse_file(&text).expect("a source file can be parsed");
        let mut names = Names {
            module,
            found: BTreeSet::new(),
        };
        names.visit_file(&parsed);
        for to in names.found {
            if to != from {
                arrows
                    .entry((from.clone(), to))
                    .or_default()
                    .insert(inside.to_path_buf());
            }
        }
    }
    // Names of the root itself, such as a type of `lib.rs`, are no folders.
    arrows
        .retain(|(_, to), _| source.join(to).is_dir() || source.join(format!("{to}.rs")).is_file());
    arrows
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources can be listed") {
        let path = entry.expect("an entry can be read").path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
}

/// The module that a file is: `a/b.rs` and `a/b/mod.rs` are `a::b`, `lib.rs` and a program's
/// `main.rs` are the root.
fn module_of(file: &Path) -> Vec<String> {
    let without_ending = file.with_extension("");
    let mut module: Vec<String> = without_ending
        .iter()
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    if module
        .last()
        .is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str()))
    {
        module.pop();
    }
    module
}

/// The top-level modules that a file names.
struct Names {
    /// The module being read, inner ones included.
    module: Vec<String>,
    found: BTreeSet<String>,
}

impl Names {
    /// A path by its segments, if it starts from the crate or from a parent module.
    fn note(&mut self, segments: &[String]) {
        let mut at = match segments.first().map(String::as_str) {
            Some("crate") => Vec::new(),
            Some("super") => self.module[..self.module.len().saturating_sub(1)].to_vec(),
            _ => return,
        };
        for segment in &segments[1..] {
            if segment == "super" {
                at.pop();
            } else {
                at.push(segment.clone());
            }
        }
        self.found.extend(at.into_iter().next());
    }

    fn note_tree(&mut self, before: &mut Vec<String>, tree: &syn::UseTree) {
        match tree {
            syn::UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.note_tree(before, &path.tree);
                before.pop();
            }
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.note_tree(before, tree);
                }
            }
            syn::UseTree::Name(syn::UseName { ident })
            | syn::UseTree::Rename(syn::UseRename { ident, .. }) => {
                before.push(ident.to_string());
                self.note(before);
                before.pop();
            }
            syn::UseTree::Glob(_) => self.note(before),
        }
    }

    /// `crate::name` in a macro's tokens.
    fn note_tokens(&mut self, tokens: TokenStream) {
        let trees: Vec<TokenTree> = tokens.into_iter().collect();
        for (index, tree) in trees.iter().enumerate() {
            match tree {
                TokenTree::Group(group) => self.note_tokens(group.stream()),
                TokenTree::Ident(ident) if ident == "crate" => {
                    if let Some(TokenTree::Ident(name)) = trees.get(index + 3) {
                        self.note(&["crate".into(), name.to_string()]);
                    }
                }
                _ => {}
            }
        }
    }
}

impl<'ast> Visit<'ast> for Names {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if module.ident == "tests" {
            return;
        }
        self.module.push(module.ident.to_string());
        visit::visit_item_mod(self, module);
        self.module.pop();
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.note_tree(&mut Vec::new(), &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments = path.segments.iter();
        let segments: Vec<_> = segments.map(|segment| segment.ident.to_string()).collect();
        self.note(&segments);
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'ast syn::Macro) {
        self.visit_path(&mac.path);
        self.note_tokens(mac.tokens.clone());
    }
}

/// The `src` folders of all crates in the repository.
fn all_sources() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let list = Command::new("git")
        .args(["ls-files", "Cargo.toml", "*/Cargo.toml"])
        .current_dir(&root)
        .output()
        .expect("git lists the files");
    let list = String::from_utf8(list.stdout).expect("paths are UTF-8");
    let folders = list
        .lines()
        .filter_map(|manifest| Path::new(manifest).parent());
    let sources = folders.map(|folder| root.join(folder).join("src"));
    sources.filter(|source| source.is_dir()).collect()
}

#[test]
fn no_files_use_each_other() {
    let mut circles = String::new();
    let sources = all_sources();
    assert!(sources.len() > 20, "the crates are found");
    for source in &sources {
        let files = files::Files::read(source);
        for circle in files.circles() {
            circles += &format!("{}, {}", source.display(), files.describe(&circle));
        }
    }
    assert!(circles.is_empty(), "files that use each other:\n{circles}");
}
