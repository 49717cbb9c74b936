//! A function has at most 80 lines, outside tests. Longer ones are on lists, each with its reason.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Lines of a function, from its first to its last one.
const MOST: usize = 80;

/// Tables: a `match` or a list with a line or a few for each case.
const TABLES: [(&str, &str); 8] = [
    ("icd/src/object/setting.rs", "set"),
    ("icd/src/capabilities/limits.rs", "limits"),
    ("spirv-jit/shaders/src/samples.rs", "samples"),
    ("spirv-jit/src/interp/emit/inst.rs", "emit_operation"),
    ("spirv-jit/src/ir/signature.rs", "check"),
    ("spirv-jit/src/lower/fold.rs", "fold_operation"),
    ("spirv-jit/src/lower/instruction.rs", "lower_instruction"),
    ("xtask/bench/src/shader/large.rs", "text"),
];

/// Inner loops of walks, samples and loads. Each is compiled for an instruction set as a whole,
/// with its values in registers.
const LOOPS: [(&str, &str); 7] = [
    ("spirv-jit/src/interp/access.rs", "run"),
    ("spirv-jit/src/interp/gather/x86.rs", "load_quarters"),
    ("traversal/src/walk/boxes.rs", "go"),
    ("traversal/src/walk/descend.rs", "run"),
    ("traversal/src/walk/stream/leaf.rs", "visit"),
    ("traversal/src/walk/stream/nodes.rs", "intersect_node_with"),
    ("traversal/src/walk/walk_opaque.rs", "run"),
];

/// The name of the function whose definition starts in a line.
fn defined(line: &str) -> Option<&str> {
    let mut words = line.trim_start();
    loop {
        let (word, rest) = words.split_once(' ')?;
        match word {
            "fn" => return rest.split(['(', '<']).next(),
            "pub" | "const" | "async" | "unsafe" | "extern" | "\"C\"" | "\"system\"" => {}
            _ if word.starts_with("pub(") || word == "super)" || word == "crate)" => {}
            _ => return None,
        }
        words = rest;
    }
}

/// The functions of a formatted source that are longer than allowed, with their lines. Its tests do
/// not count.
fn long_functions(text: &str) -> Vec<(&str, usize)> {
    let source = text.split("\n#[cfg(test)]\nmod tests {").next();
    let lines: Vec<&str> = source.unwrap_or_default().lines().collect();
    let mut long = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let Some(name) = defined(line) else {
            continue;
        };
        let indent = &line[..line.len() - line.trim_start().len()];
        // A definition without a body ends before one opens.
        let signature = lines[first..]
            .iter()
            .position(|line| line.ends_with(['{', ';', '}']));
        let has_body = signature.is_some_and(|last| lines[first + last].ends_with('{'));
        let is_end = |line: &&str| line.strip_prefix(indent) == Some("}");
        let end = lines[first..].iter().position(is_end).filter(|_| has_body);
        let count = end.map_or(0, |last| last + 1);
        if count > MOST {
            long.push((name, count));
        }
    }
    long
}

#[test]
fn functions_have_eighty_lines() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let list = Command::new("git")
        .args(["ls-files", "*.rs"])
        .current_dir(&root)
        .output()
        .expect("git lists the files");
    let list = String::from_utf8(list.stdout).expect("paths are UTF-8");
    let is_test = |path: &str| {
        path.starts_with("tests/") || path.contains("/tests/") || path.ends_with("tests.rs")
    };
    let mut findings = Vec::new();
    let listed = TABLES.iter().chain(&LOOPS);
    let mut listed: Vec<(&str, &str)> = listed.copied().collect();
    let (mut files, mut functions) = (0, 0);
    for path in list.lines().filter(|path| !is_test(path)) {
        // A file that is deleted, and not yet in a commit, is still listed.
        let Ok(text) = fs::read_to_string(root.join(path)) else {
            continue;
        };
        files += 1;
        functions += text.lines().filter(|line| defined(line).is_some()).count();
        for (name, count) in long_functions(&text) {
            let before = listed.len();
            listed.retain(|entry| *entry != (path, name));
            if listed.len() == before {
                findings.push(format!("{path}: {name} has {count} lines"));
            }
        }
    }
    assert!(
        files > 500 && functions > 5 * files,
        "the sources are found"
    );
    let done = listed.iter();
    findings.extend(done.map(|(path, name)| format!("{path}: {name}: take it off the list")));
    assert!(findings.is_empty(), "{}", findings.join("\n"));
}

#[test]
fn lengths_are_those_of_bodies() {
    let body = "        x();\n".repeat(MOST);
    let text = format!(
        "trait T {{\n    fn none(&self);\n    fn short(&self) {{\n        x();\n    }}\n}}\n\
         impl T for U {{\n    pub(super) unsafe fn long<A>(\n        a: A,\n    ) {{\n{body}    }}\n}}\n"
    );
    assert_eq!(long_functions(&text), [("long", MOST + 4)]);
}
