//! Runs the files in `filetests/`: a module, what to do with it, and what must come out.
//!
//! ```text
//! ; What this case shows.
//! pass promote_variables, eliminate_dead_code
//!
//! module compute
//! …
//!
//! expect
//!
//! module compute
//! …
//! ```
//!
//! `TUFF_BLESS=1 cargo test -p spirv-jit --test filetests` rewrites the expectations; read the difference before you commit it.

use std::path::{Path, PathBuf};

use spirv_jit::ir::text::{parse_module, print_module};
use spirv_jit::ir::verify;
use spirv_jit::pass::run_pass;

fn files() -> Vec<PathBuf> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("filetests");
    let mut files: Vec<PathBuf> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ir"))
        .collect();
    files.sort();
    files
}

/// A case's parts: comment and `pass` line, input, expectation.
struct Case<'a> {
    head: &'a str,
    passes: Vec<&'a str>,
    input: &'a str,
    expectation: &'a str,
}

fn split_case(text: &str) -> Result<Case<'_>, String> {
    let line_start = text
        .lines()
        .scan(0, |at, line| {
            let start = *at;
            *at += line.len() + 1;
            Some((start, line))
        })
        .find(|(_, line)| line.starts_with("pass "));
    let (start, line) = line_start.ok_or("no `pass` line")?;
    let head_end = start + line.len() + 1;
    let rest = text.get(head_end..).unwrap_or("");
    let (input, expectation) = match rest.split_once("\nexpect\n") {
        Some((input, expectation)) => (input, expectation.trim_start()),
        None => (rest, ""),
    };
    Ok(Case {
        head: &text[..head_end],
        passes: line["pass ".len()..].split(',').map(str::trim).collect(),
        input,
        expectation,
    })
}

/// The module after the passes, as text.
fn apply(case: &Case<'_>) -> Result<String, String> {
    let mut module = parse_module(case.input)?;
    verify(&module)?;
    for pass in &case.passes {
        if !run_pass(pass, &mut module) {
            return Err(format!("no pass `{pass}`"));
        }
        verify(&module).map_err(|message| format!("after {pass}: {message}"))?;
    }
    Ok(print_module(&module))
}

#[test]
fn files_give_what_they_expect() {
    let bless = std::env::var_os("TUFF_BLESS").is_some();
    let mut failures = Vec::new();
    let files = files();
    assert!(!files.is_empty());
    for path in &files {
        let text = std::fs::read_to_string(path).unwrap();
        let outcome = split_case(&text).and_then(|case| Ok((apply(&case)?, case)));
        let (output, case) = match outcome {
            Ok(outcome) => outcome,
            Err(message) => {
                failures.push(format!("{}: {message}", path.display()));
                continue;
            }
        };
        if output == case.expectation {
            continue;
        }
        if bless {
            let input = case.input.trim_end();
            let blessed = format!("{}{input}\n\nexpect\n\n{output}", case.head);
            std::fs::write(path, blessed).unwrap();
        } else {
            failures.push(format!(
                "{}: gives\n{output}\ninstead of\n{}",
                path.display(),
                case.expectation
            ));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}
