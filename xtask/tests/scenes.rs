//! Scenes are the same bits on every system: the code that makes them takes sines, powers and the
//! like from the crate `libm`. The standard library calls the C library, and those differ.

use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};

/// Folders and files that make scenes.
const MAKERS: [&str; 5] = [
    "traversal/scenes/src",
    "xtask/bench/src/traversal/scene.rs",
    "xtask/chart/src/walks.rs",
    "xtask/demo/src",
    "xtask/workloads/src",
];

/// Methods of `f32` and `f64` with "unspecified precision" (std, "Primitive Type f64"), without
/// `powi`, which calls no C library. `mul_add` is exact, but a call on some systems.
const METHODS: [&str; 28] = [
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "exp",
    "exp2", "exp_m1", "gamma", "hypot", "ln", "ln_1p", "ln_gamma", "log", "log10", "log2",
    "mul_add", "powf", "sin", "sin_cos", "sinh", "tan", "tanh",
];

/// Beginnings of the names of functions by which `glam` calls them.
const OF_GLAM: [&str; 7] = [
    "angle_",
    "from_angle",
    "from_axis_angle",
    "from_euler",
    "from_rotation_",
    "perspective_",
    "slerp",
];

#[test]
fn scenes_call_no_function_of_the_c_library() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut calls = Vec::new();
    for maker in MAKERS {
        let mut files = Vec::new();
        collect(root.join(maker), &mut files);
        assert!(!files.is_empty(), "no sources in {maker}");
        for file in files {
            let text = fs::read_to_string(&file).expect("a source file can be read");
            let found = calls_in(&text);
            if !found.is_empty() {
                let inside = file.strip_prefix(&root).expect("found below the root");
                calls.push(format!("{}: {found:?}", inside.display()));
            }
        }
    }
    calls.sort();
    assert!(calls.is_empty(), "take `libm::…`:\n{}", calls.join("\n"));
}

#[test]
fn calls_are_found_in_each_form() {
    for (text, expected) in [
        ("fn f(x: f32) -> f32 { x.sin() }", "sin"),
        ("fn f(x: f32) -> f32 { g![(x + 1.0).powf(2.0)] }", "powf"),
        ("fn f() { x.map(f32::cos); }", "cos"),
        ("fn f() { x.map(f64::atan2); }", "atan2"),
        ("fn f() { Quat::from_rotation_y(1.0); }", "from_rotation_y"),
        ("fn f() { a.angle_between(b); }", "angle_between"),
    ] {
        assert_eq!(calls_in(text), [expected], "{text}");
    }
    for text in [
        "fn f(x: f32) -> f32 { libm::sinf(x) * libm::pow(x, 2.0) }",
        "fn f() { let sin = 1.0; g(sin, x.exp, \"y.cos()\"); } // x.sin()",
        "fn f(n: u32) -> u32 { n.ilog2() + n.pow(2) }",
        "use libm::sin; mod log {}",
    ] {
        assert_eq!(calls_in(text), [""; 0], "{text}");
    }
}

/// The names of functions that a source takes from the C library.
fn calls_in(source: &str) -> Vec<String> {
    let mut calls = Vec::new();
    note(source.parse().expect("a source is tokens"), &mut calls);
    calls
}

fn note(tokens: TokenStream, calls: &mut Vec<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (place, token) in tokens.iter().enumerate() {
        match token {
            TokenTree::Group(group) => note(group.stream(), calls),
            TokenTree::Ident(ident) => {
                let name = ident.to_string();
                let before = &tokens[..place];
                let is_called = matches!(tokens.get(place + 1), Some(TokenTree::Group(_)));
                let is_method = is_punct(before.last(), '.') && is_called;
                let is_number = METHODS.contains(&&*name) && (is_method || is_of_float(before));
                let is_vector = OF_GLAM.iter().any(|start| name.starts_with(start));
                if is_number || is_vector && (is_method || is_punct(before.last(), ':')) {
                    calls.push(name);
                }
            }
            _ => {}
        }
    }
}

/// Whether `f32::` or `f64::` comes before.
fn is_of_float(before: &[TokenTree]) -> bool {
    matches!(before, [.., TokenTree::Ident(float), first, second]
        if (float == "f32" || float == "f64")
            && is_punct(Some(first), ':')
            && is_punct(Some(second), ':'))
}

fn is_punct(token: Option<&TokenTree>, sign: char) -> bool {
    matches!(token, Some(TokenTree::Punct(punct)) if punct.as_char() == sign)
}

/// The sources below a folder, or the file.
fn collect(path: PathBuf, files: &mut Vec<PathBuf>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("a folder of sources can be listed") {
            collect(entry.expect("an entry can be read").path(), files);
        }
    } else if path.extension().is_some_and(|ending| ending == "rs") {
        files.push(path);
    }
}
