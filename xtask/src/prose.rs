//! The house style of comments and pages, as far as a program can check it: lines of 100 columns,
//! and no phrases that readers have to read twice.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::workspace;

/// Columns of a comment line, indentation included.
const COLUMNS: usize = 100;

/// Banned phrases, in lower case.
const PHRASES: [&str; 8] = [
    "whoever",
    "whomever",
    "whom",
    "nobody",
    "in whose",
    "but for",
    "no numbers",
    "which of them",
];

/// Whole SAFETY comments that do not name the promise, in lower case.
const UNNAMED: [&str; 4] = [
    "the caller's promise",
    "as the caller promises",
    "as above",
    "likewise",
];

/// Findings in all sources and pages of the project, each with file and line.
///
/// # Errors
///
/// A folder or a file cannot be read.
pub fn findings() -> Result<Vec<String>> {
    let mut files = Vec::new();
    collect(workspace::root(), &mut files)?;
    files.sort_unstable();
    let mut findings = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
        let is_page = is_of_kind(&file, "md");
        let name = file.strip_prefix(workspace::root()).unwrap_or(&file);
        let mut is_diagram = false;
        for (index, line) in text.lines().enumerate() {
            // Diagrams and code between fences have their own columns.
            let is_fence = line.trim_start_matches([' ', '/', '!']).starts_with("```");
            is_diagram ^= is_fence;
            if is_fence || is_diagram {
                continue;
            }
            let mut faults = faults(line, is_page);
            if names_no_promise(line) {
                faults.push("a SAFETY comment that does not name the promise".to_owned());
            }
            for fault in faults {
                findings.push(format!("{}:{}: {fault}", name.display(), index + 1));
            }
        }
    }
    Ok(findings)
}

/// Adds the sources and pages below a folder, except build outputs and hidden folders.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry?;
        let name = entry.file_name();
        let is_skipped = name == "target" || name.to_string_lossy().starts_with('.');
        let (path, kind) = (entry.path(), entry.file_type()?);
        if kind.is_dir() && !is_skipped {
            collect(&path, files)?;
        } else if kind.is_file() && (is_of_kind(&path, "rs") || is_of_kind(&path, "md")) {
            files.push(path);
        }
    }
    Ok(())
}

fn is_of_kind(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found == extension)
}

/// The faults of a line. In sources only comments count.
fn faults(line: &str, is_page: bool) -> Vec<String> {
    let trimmed = line.trim_start();
    let (prose, is_comment_line) = match (is_page, trimmed.strip_prefix("//")) {
        (true, _) => (trimmed, false),
        (false, Some(comment)) => (comment.trim_start_matches(['/', '!']).trim_start(), true),
        (false, None) => return Vec::new(),
    };
    let mut faults = Vec::new();
    let columns = line.chars().count();
    // A link or a table row cannot be broken.
    if is_comment_line && columns > COLUMNS && !prose.contains("://") && !prose.starts_with('|') {
        faults.push(format!("a comment of {columns} columns"));
    }
    if is_comment_line && prose.starts_with("What ") {
        faults.push("a comment that begins with \"What\" instead of its subject".to_owned());
    }
    let words = prose.to_lowercase();
    for phrase in PHRASES {
        if holds(&words, phrase) {
            faults.push(format!("\"{phrase}\""));
        }
    }
    faults
}

/// Whether a line is a whole SAFETY comment that refers to a promise instead of naming it.
fn names_no_promise(line: &str) -> bool {
    let comment = line.trim_start().strip_prefix("// SAFETY: ");
    comment.is_some_and(|text| {
        let text = text.trim_end_matches('.').to_lowercase();
        UNNAMED.contains(&&text[..])
    })
}

/// Whether a text holds a phrase as whole words.
fn holds(text: &str, phrase: &str) -> bool {
    let is_word = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_alphanumeric);
    text.match_indices(phrase).any(|(start, _)| {
        let bytes = text.as_bytes();
        let before = start.checked_sub(1).and_then(|index| bytes.get(index));
        !is_word(before) && !is_word(bytes.get(start + phrase.len()))
    })
}

#[cfg(test)]
mod tests {
    use super::{COLUMNS, faults, findings, names_no_promise};

    #[test]
    fn comments_and_pages_keep_the_style() {
        let findings = findings().expect("the tree can be read");
        assert!(findings.is_empty(), "{}", findings.join("\n"));
    }

    #[test]
    fn only_prose_counts() {
        let wide = format!("// {}", "word ".repeat(COLUMNS / 5));
        assert_eq!(faults(&wide, false).len(), 1, "{wide}");
        assert!(faults(&format!("{wide} https://example.org"), false).is_empty());
        assert!(faults(&wide.replace("//", "let"), false).is_empty());
        assert_eq!(faults("/// What it holds.", false).len(), 1);
        let phrase = format!("frees it {} the head", ["but", "for"].join(" "));
        assert_eq!(faults(&format!("    // {phrase}"), false).len(), 1);
        assert_eq!(faults(&phrase, true).len(), 1);
        assert!(faults(&format!("let text = \"{phrase}\";"), false).is_empty());
        assert!(faults("Butter is for bread", true).is_empty());
    }

    #[test]
    fn promises_have_names() {
        let comment = |text: &str| format!("    // {}: {text}", "SAFETY");
        assert!(names_no_promise(&comment("as above.")));
        assert!(names_no_promise(&comment("The caller's promise")));
        assert!(!names_no_promise(&comment(
            "the caller keeps the contract of `load`."
        )));
        assert!(!names_no_promise(&comment(
            "as above, and the lane is active."
        )));
    }
}
