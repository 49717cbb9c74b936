//! One choice of instruction set, which `TUFF_TIER` limits: nothing asks the processor past it. And
//! what is for one architecture alone.

use std::fs;
use std::path::{Path, PathBuf};

/// Where it is asked.
const ASKING: [&str; 1] = ["traversal/lanes/src/tier.rs"];

#[test]
fn the_processor_is_asked_in_one_place() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut asking = Vec::new();
    for name in [
        "icd",
        "spirv-jit",
        "spirv-jit/images",
        "traversal",
        "traversal/lanes",
    ] {
        collect(&root.join(name).join("src"), &mut asking);
    }
    let mut found: Vec<String> = asking
        .iter()
        .filter(|file| {
            let text = fs::read_to_string(file).expect("a source file can be read");
            text.contains("is_x86_feature_detected!") || text.contains("__cpuid")
        })
        .map(|file| {
            let inside = file.strip_prefix(&root).expect("found below the root");
            inside.display().to_string()
        })
        .collect();
    found.sort();
    assert_eq!(found, ASKING);
}

/// An attribute that was left behind takes away what follows on other architectures, and nothing
/// here would tell.
#[test]
fn what_is_for_one_architecture_follows_its_attribute() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for name in [
        "icd",
        "spirv-jit",
        "spirv-jit/images",
        "traversal",
        "traversal/lanes",
    ] {
        collect(&root.join(name).join("src"), &mut files);
    }
    let mut seen = 0;
    for file in &files {
        let text = fs::read_to_string(file).expect("a source file can be read");
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for (number, pair) in lines.windows(2).enumerate() {
            if pair[0].starts_with("#[cfg(target_arch") {
                seen += 1;
                let follows = !pair[1].is_empty() && pair[1] != pair[0];
                assert!(follows, "{}:{}", file.display(), number + 1);
            }
        }
    }
    assert!(seen > 20);
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
