//! A name has one meaning: no type name in three files of a crate, and none of the names that say
//! nothing about the thing (`Place`, `Known`, `meet`).

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use syn::visit::{self, Visit};

/// Files of one crate that may have a type of one name.
const MOST: usize = 2;

/// Type names that may be in any number of files, with the reason.
const SHARED: [(&str, &str); 5] = [
    ("Arguments", "the command line of a program"),
    ("Command", "the subcommands of a program"),
    ("Options", "the options of a command, named with its module"),
    ("F", "the floats of an instruction set, one file a set"),
    ("I", "the integers of an instruction set, one file a set"),
];

/// Type names that say nothing about the thing.
const RETIRED_TYPES: [&str; 12] = [
    "Bell", "Finder", "Given", "Known", "Nowhere", "Painter", "Place", "Row", "Shown", "Standing",
    "State", "Told",
];

const RETIRED_FUNCTIONS: [&str; 7] = [
    "bell", "given", "glaze", "meet", "meets", "standing", "told",
];

/// A retired name that is the field's own word in its file, with the reason.
const RIGHT: [(&str, &str, &str); 1] = [(
    "traversal/lanes/src/lib.rs",
    "Row",
    "a row of lanes: see docs/glossary.md",
)];

/// The names that a file defines.
#[derive(Default)]
struct Names {
    types: BTreeSet<String>,
    functions: BTreeSet<String>,
}

impl<'ast> Visit<'ast> for Names {
    fn visit_item_struct(&mut self, item: &'ast syn::ItemStruct) {
        self.types.insert(item.ident.to_string());
        visit::visit_item_struct(self, item);
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        self.types.insert(item.ident.to_string());
        visit::visit_item_enum(self, item);
    }

    fn visit_item_union(&mut self, item: &'ast syn::ItemUnion) {
        self.types.insert(item.ident.to_string());
        visit::visit_item_union(self, item);
    }

    fn visit_item_trait(&mut self, item: &'ast syn::ItemTrait) {
        self.types.insert(item.ident.to_string());
        visit::visit_item_trait(self, item);
    }

    fn visit_item_type(&mut self, item: &'ast syn::ItemType) {
        self.types.insert(item.ident.to_string());
        visit::visit_item_type(self, item);
    }

    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        self.functions.insert(signature.ident.to_string());
        visit::visit_signature(self, signature);
    }
}

/// The names of each source file of the repository, by its path in there. Both tests share them.
static FILES: LazyLock<BTreeMap<String, Names>> = LazyLock::new(read);

fn read() -> BTreeMap<String, Names> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let list = Command::new("git")
        .args(["ls-files", "*.rs"])
        .current_dir(&root)
        .output()
        .expect("git lists the files");
    let list = String::from_utf8(list.stdout).expect("paths are UTF-8");
    let mut files = BTreeMap::new();
    for path in list.lines() {
        // A file that is deleted, and not yet in a commit, is still listed.
        let Ok(text) = fs::read_to_string(root.join(path)) else {
            continue;
        };
        let mut names = Names::default();
        names.visit_file(&syn::parse_file(&text).unwrap_or_else(|error| panic!("{path}: {error}")));
        files.insert(path.to_owned(), names);
    }
    assert!(files.len() > 100, "the repository has sources");
    files
}

#[test]
fn no_type_name_is_in_three_files_of_a_crate() {
    let mut places: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
    for (path, names) in &*FILES {
        let (top, _) = path.split_once('/').expect("sources lie in folders");
        // One type, a file for each system.
        let place = path.replace("/os/windows/", "/os/unix/");
        for name in &names.types {
            places
                .entry((top.to_owned(), name.clone()))
                .or_default()
                .insert(place.clone());
        }
    }
    let is_shared = |name: &str| SHARED.iter().any(|(shared, _)| *shared == name);
    let findings: Vec<String> = (places.iter())
        .filter(|((_, name), files)| files.len() > MOST && !is_shared(name))
        .map(|((top, name), files)| format!("{top}: {name} in {files:?}"))
        .collect();
    assert!(findings.is_empty(), "{}", findings.join("\n"));
}

#[test]
fn retired_names_are_gone() {
    let mut findings = Vec::new();
    for (path, names) in &*FILES {
        let types = names.types.iter();
        let types = types.filter(|name| RETIRED_TYPES.contains(&name.as_str()));
        let functions = names.functions.iter();
        let functions = functions.filter(|name| RETIRED_FUNCTIONS.contains(&name.as_str()));
        for name in types.chain(functions) {
            if !RIGHT
                .iter()
                .any(|(file, right, _)| file == path && right == name)
            {
                findings.push(format!("{path}: {name}"));
            }
        }
    }
    assert!(findings.is_empty(), "{}", findings.join("\n"));
}

#[test]
fn entry_points_give_the_guard_their_own_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut count = 0;
    for path in FILES.keys() {
        let Some(file) = path.strip_prefix("icd/src/entry/") else {
            continue;
        };
        let text = fs::read_to_string(root.join(path)).expect("a source file can be read");
        for rest in text.split("extern \"system\" fn ").skip(1) {
            let name = rest.split('(').next().expect("a part, if an empty one");
            // A function without a body has no guard.
            let Some((_, body)) = rest.split_once(" {\n") else {
                continue;
            };
            if let Some(guarded) = body.split('"').nth(1) {
                assert_eq!(name, guarded, "{file}");
                count += 1;
            }
        }
    }
    assert!(count > 400, "the entry points are found: {count}");
}
