//! Variables `TUFF_…` of the driver are read in one place, and each stands in the documentation.

use std::fs;
use std::path::{Path, PathBuf};

/// Where the driver asks the environment.
const SETTINGS: &str = "icd/src/settings.rs";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Whether a file is a module of tests.
fn is_test(file: &Path) -> bool {
    file.iter().any(|part| part == "tests") || file.ends_with("tests.rs")
}

#[test]
fn the_environment_is_asked_in_one_place() {
    let mut asking = Vec::new();
    for name in ["icd", "spirv-jit", "spirv-jit/images", "traversal"] {
        let mut files = Vec::new();
        collect(&root().join(name).join("src"), &mut files);
        asking.extend(files.into_iter().filter(|file| {
            let text = fs::read_to_string(file).expect("a source file can be read");
            !is_test(file) && (text.contains("env::var") || text.contains("getenv"))
        }));
    }
    assert_eq!(asking, [root().join(SETTINGS)]);
}

#[test]
fn each_variable_is_documented() {
    let settings = fs::read_to_string(root().join(SETTINGS)).expect("the settings");
    let readme = fs::read_to_string(root().join("README.md")).expect("the README");
    let adding = fs::read_to_string(root().join("docs/adding.md")).expect("docs/adding.md");
    let mut names: Vec<&str> = (settings.split('"'))
        .filter(|text| text.starts_with("TUFF_"))
        .filter(|text| {
            text.bytes()
                .all(|byte| byte == b'_' || byte.is_ascii_uppercase())
        })
        .collect();
    names.sort_unstable();
    names.dedup();
    assert!(names.len() > 9, "{names:?}");
    for name in names {
        let in_table = readme.contains(&format!("| `{name}` | "));
        // Variables that only developers need are documented elsewhere.
        let for_developers = adding.contains(&format!("`{name}="));
        assert!(in_table || for_developers, "{name} is not documented");
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}
