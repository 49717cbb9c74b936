//! Samples as stacks of functions, and whose time they are.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use pprof::{Report, Symbol};

/// The driver's parts, by where their sources lie; the first that fits counts.
const PARTS: &[(&str, &[&str])] = &[
    (
        "walks: packets of coherent rays",
        &["traversal/src/walk/packet"],
    ),
    (
        "builds of structures",
        &["traversal/src/build", "traversal/src/micromap"],
    ),
    ("walks", &["traversal/src/"]),
    (
        "interpreter of shaders",
        &[
            "spirv-jit/src/interp",
            "spirv-jit/src/eval",
            "spirv-jit/src/program",
            "spirv-jit/src/environment",
            "spirv-jit/src/reach",
        ],
    ),
    ("images in shaders", &["spirv-jit/images/src"]),
    (
        "ray queries and hit objects in shaders",
        &["spirv-jit/src/query", "spirv-jit/src/hit_object"],
    ),
    ("compiler of shaders", &["spirv-jit/src/"]),
    (
        "scheduler: rays to walks, hits to shaders",
        &[
            "icd/src/trace/walks",
            "icd/src/trace/rays",
            "icd/src/trace/answers",
            "icd/src/trace/queries",
        ],
    ),
    ("scheduler: the rest", &["icd/src/trace"]),
    (
        "commands",
        &[
            "icd/src/execute",
            "icd/src/compute",
            "icd/src/structures",
            "icd/src/transfer",
            "icd/src/command",
        ],
    ),
    ("objects, queues, entry points", &["icd/src/"]),
    (
        "handing out work (rayon)",
        &["/rayon-", "/rayon-core-", "/crossbeam-"],
    ),
];

/// The label of frames that belong to no part.
const ELSEWHERE: &str = "elsewhere";

/// A function as samples name it.
#[derive(Clone, Debug)]
struct Frame {
    name: String,
    /// Its source file; none for what has no lines, as the C library.
    file: Option<String>,
}

/// How often each stack of names was found, from the root, and each part's innermost function.
#[derive(Default)]
pub struct Stacks {
    folded: BTreeMap<String, usize>,
    parts: BTreeMap<&'static str, usize>,
}

impl Stacks {
    pub fn of(report: &Report) -> Stacks {
        let mut stacks = Stacks::default();
        for (sample, count) in &report.data {
            // From the leaf, what was inlined first.
            let frames: Vec<Frame> = sample.frames.iter().flatten().map(Frame::of).collect();
            let thread = sample
                .thread_name
                .trim_end_matches(|last: char| !last.is_alphabetic());
            stacks.add(thread, &frames, usize::try_from(*count).unwrap_or(0));
        }
        stacks
    }

    fn add(&mut self, thread: &str, frames: &[Frame], count: usize) {
        let part = frames.iter().find_map(Frame::part).unwrap_or(ELSEWHERE);
        *self.parts.entry(part).or_default() += count;
        let mut labels: Vec<String> = Vec::new();
        for frame in frames {
            // A library's work for a function counts as the function's own time.
            if frame.is_ours() || frame.file.is_none() && labels.is_empty() {
                labels.push(frame.label());
            }
        }
        labels.push(thread.into());
        labels.reverse();
        // Closures in closures, and whatever calls itself.
        labels.dedup();
        *self.folded.entry(labels.join(";")).or_default() += count;
    }

    pub fn samples(&self) -> usize {
        self.parts.values().sum()
    }

    /// One line a stack, from the root, as `inferno` reads them.
    pub fn folded(&self) -> Vec<String> {
        let lines = self.folded.iter();
        lines
            .map(|(names, count)| format!("{names} {count}"))
            .collect()
    }

    /// The share of each part as a Markdown table, largest first.
    pub fn table(&self) -> String {
        let mut parts: Vec<_> = self.parts.iter().collect();
        parts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        let mut text = String::from("| part | share |\n| --- | ---: |\n");
        for (name, count) in parts {
            let share = 100.0 * *count as f64 / self.samples() as f64;
            let _ = writeln!(text, "| {name} | {share:.1} % |");
        }
        let _ = writeln!(text, "\n{} samples", self.samples());
        text
    }
}

impl Frame {
    fn of(symbol: &Symbol) -> Frame {
        let file = symbol.filename.as_deref().map(Path::to_string_lossy);
        Frame {
            name: symbol.name(),
            file: file.map(String::from),
        }
    }

    fn part(&self) -> Option<&'static str> {
        let file = self.file.as_ref()?;
        let here = |path: &&str| file.contains(*path);
        let found = PARTS.iter().find(|(_, paths)| paths.iter().any(here));
        found.map(|(part, _)| *part)
    }

    fn is_ours(&self) -> bool {
        const OURS: [&str; 4] = [
            "traversal/src/",
            "spirv-jit/src/",
            "spirv-jit/images/src/",
            "icd/src/",
        ];
        let file = self.file.as_deref().unwrap_or_default();
        OURS.iter().any(|path| file.contains(path))
    }

    /// The module and the function, without what it is generic over.
    fn label(&self) -> String {
        let function = last_segment(&self.name);
        let Some((root, inside)) = self
            .file
            .as_deref()
            .and_then(|file| file.rsplit_once("/src/"))
        else {
            return function.replace(';', ":");
        };
        let krate = root.rsplit('/').next().unwrap_or_default();
        let module = inside.trim_end_matches(".rs").trim_end_matches("/mod");
        format!("{krate}/{module} {function}").replace(';', ":")
    }
}

/// A function's name without its path and its generic arguments.
fn last_segment(name: &str) -> String {
    let mut depth = 0i32;
    let mut plain = String::new();
    for character in name.replace("->", "").chars() {
        match character {
            '<' => depth += 1,
            '>' => depth -= 1,
            _ if depth == 0 => plain.push(character),
            _ => {}
        }
    }
    let last = plain.rsplit("::").find(|part| !part.is_empty());
    match last {
        Some(closure) if closure.contains("closure") => "closure".into(),
        Some(function) => function.into(),
        None => name.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(name: &str, file: &str) -> Frame {
        Frame {
            name: name.into(),
            file: (!file.is_empty()).then(|| file.into()),
        }
    }

    #[test]
    fn time_belongs_to_the_innermost_part() {
        let mut stacks = Stacks::default();
        let frames = [
            frame(
                "next<traversal::build::Bin>",
                "/rustc/library/core/src/iter.rs",
            ),
            frame("step<true>", "/home/it/traversal/src/walk/avx.rs"),
            frame("turn", "/home/it/icd/src/trace/mod.rs"),
            frame("join", "/cargo/rayon-core-1.13/src/lib.rs"),
        ];
        stacks.add("tuff-worker", &frames, 3);
        stacks.add("tuff-worker", &frames[3..], 1);
        stacks.add(
            "tuff-worker",
            &[frame("__memmove", ""), frames[2].clone()],
            2,
        );
        assert_eq!(
            stacks.folded(),
            [
                "tuff-worker 1",
                "tuff-worker;icd/trace turn;__memmove 2",
                "tuff-worker;icd/trace turn;traversal/walk/avx step 3",
            ]
        );
        assert!(stacks.table().contains("| walks | 50.0 % |"));
        assert!(
            stacks
                .table()
                .contains("| handing out work (rayon) | 16.7 % |")
        );
    }

    #[test]
    fn names_are_short() {
        let cases = [
            ("<traversal::walk::Walk as core::ops::Drop>::drop", "drop"),
            ("run<traversal::walk::avx::Avx<true>, false>", "run"),
            ("icd::trace::{impl#0}::run::{closure_env#3}", "closure"),
            ("call_once<fn(&mut u32) -> u32>", "call_once"),
            ("__memmove_avx512", "__memmove_avx512"),
        ];
        for (name, short) in cases {
            assert_eq!(last_segment(name), short);
        }
    }
}
