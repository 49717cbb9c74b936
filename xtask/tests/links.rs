//! Links between the pages, and from pages to files, lead somewhere.

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The targets of links `[text](target)`, outside of code.
fn targets(page: &str) -> impl Iterator<Item = &str> {
    let prose = page.split("```").step_by(2);
    prose.flat_map(|text| {
        let after = text.split("](").skip(1);
        after.filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
    })
}

/// Whether a target is another site's.
fn is_elsewhere(target: &str) -> bool {
    target.contains("://") || target.starts_with("mailto:")
}

#[test]
fn links_lead_to_files() {
    let mut pages = vec![root().join("README.md")];
    for folder in ["docs", "docs/measurements"] {
        let docs = fs::read_dir(root().join(folder)).expect("a folder of pages");
        pages.extend(docs.map(|entry| entry.expect("a page").path()));
    }
    pages.retain(|page| page.extension().is_some_and(|extension| extension == "md"));
    assert!(pages.len() > 10, "the pages are found");
    let (mut links, mut lost) = (0, Vec::new());
    for page in &pages {
        let text = fs::read_to_string(page).expect("a page can be read");
        for target in targets(&text).filter(|target| !is_elsewhere(target)) {
            let (path, _) = target.split_once('#').unwrap_or((target, ""));
            let folder = page.parent().expect("a page lies in a folder");
            links += 1;
            if !folder.join(path).exists() {
                lost.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(
        lost.is_empty(),
        "links that lead nowhere:\n{}",
        lost.join("\n")
    );
    assert!(links > 50, "the links are found");
}

/// Code in a page: what stands between single backticks.
fn code(page: &str) -> impl Iterator<Item = &str> {
    let prose = page.split("```").step_by(2);
    prose.flat_map(|text| text.split('`').skip(1).step_by(2))
}

#[test]
fn files_that_additions_take_are_there() {
    let page = fs::read_to_string(root().join("docs/adding.md")).expect("docs/adding.md");
    let is_path = |text: &&str| text.contains('/') && !text.contains(' ');
    let paths: Vec<&str> = code(&page).filter(is_path).collect();
    let lost: Vec<_> = (paths.iter())
        .filter(|path| !root().join(path).exists())
        .collect();
    assert!(lost.is_empty(), "there are no {lost:?}");
    assert!(paths.len() > 40, "the paths are found");
}

/// The stops of a way: the items of a numbered list.
fn stops(way: &str) -> Vec<String> {
    let mut stops: Vec<String> = Vec::new();
    for line in way.lines() {
        let number = line.split_once(". ").map(|(number, _)| number);
        if number.is_some_and(|number| number.parse::<usize>().is_ok()) {
            stops.push(String::new());
        }
        if let Some(stop) = stops.last_mut() {
            *stop += line.trim_start();
            stop.push(' ');
        }
    }
    stops
}

/// Whether a source has a name as a whole word.
fn has_word(source: &str, name: &str) -> bool {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    source.match_indices(name).any(|(at, _)| {
        let (before, after) = (&source[..at], &source[at + name.len()..]);
        !before.ends_with(is_word) && !after.starts_with(is_word)
    })
}

#[test]
fn walks_through_the_folders_name_what_is_there() {
    let page = fs::read_to_string(root().join("docs/walk-through.md")).expect("a page");
    let ways: Vec<&str> = page.split("\n## ").skip(1).collect();
    let mut lost = Vec::new();
    let mut names = 0;
    for way in &ways {
        let stops = stops(way);
        let title = way.lines().next().unwrap_or_default();
        assert!((2..=10).contains(&stops.len()), "{title}: {}", stops.len());
        for stop in &stops {
            let sources: Vec<String> = targets(stop)
                .map(|target| root().join("docs").join(target))
                .map(|file| fs::read_to_string(file).expect("a link leads to a file"))
                .collect();
            for name in code(stop).flat_map(|name| name.split("::")) {
                names += 1;
                if !sources.iter().any(|source| has_word(source, name)) {
                    lost.push(format!("{title}: `{name}`"));
                }
            }
        }
    }
    assert!(
        lost.is_empty(),
        "names that no file of their stop has: {lost:#?}"
    );
    assert!(ways.len() > 4 && names > 40, "{names} names are found");
}
