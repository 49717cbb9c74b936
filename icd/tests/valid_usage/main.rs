//! `docs/valid-usage.md`: who looks after each valid-usage statement of the ray tracing chapter.
//! The table is made here, by `cargo xtask vuids`; as a test this holds it against the rules that
//! the driver reports.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};

use vulkan_tuff::validate::Rule;

/// Set where the table is to be written.
const WRITE: &str = "TUFF_WRITE_DOCS";

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

fn lines(file: &str) -> Vec<String> {
    let path = docs().join("valid-usage").join(file);
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(str::to_owned).collect()
}

/// A statement's name without its command: `*` before it stands for all that have it.
fn any(name: &str) -> Option<String> {
    let (_, rest) = name.strip_prefix("VUID-")?.split_once('-')?;
    Some(format!("*-{rest}"))
}

/// Who looks after a statement.
struct StatementCoverage {
    name: String,
    tuff: Option<Rule>,
    layers: bool,
    reason: Option<String>,
}

fn rows() -> Vec<StatementCoverage> {
    let rules: BTreeMap<String, Rule> = Rule::ALL
        .iter()
        .flat_map(|&rule| rule.vuids().into_iter().map(move |name| (name, rule)))
        .collect();
    let layers: BTreeSet<String> = lines("layers.txt").into_iter().collect();
    let reasons: BTreeMap<String, String> = lines("reasons.txt")
        .iter()
        .map(|line| line.split_once(' ').expect("a name and a reason"))
        .map(|(name, reason)| (name.to_owned(), reason.to_owned()))
        .collect();
    let chapter = lines("chapter.txt").into_iter();
    chapter
        .map(|name| {
            let all = any(&name).expect("a command and a rule");
            let traces = name.starts_with("VUID-vkCmdTraceRays");
            StatementCoverage {
                tuff: rules.get(&name).copied(),
                layers: layers.contains(&name) || traces && layers.contains(&all),
                reason: reasons.get(&name).or_else(|| reasons.get(&all)).cloned(),
                name,
            }
        })
        .collect()
}

fn table(rows: &[StatementCoverage]) -> String {
    let count =
        |has: &dyn Fn(&StatementCoverage) -> bool| rows.iter().filter(|row| has(row)).count();
    let mut text = format!(
        "# Valid usage\n\n\
        Who looks after each of the {} valid-usage statements of the ray tracing chapter: the driver's own validation reports {}\n\
        (`TUFF_VALIDATE=1`, or the feature `rayTracingValidation` of `VK_NV_ray_tracing_validation`), the Khronos validation layers\n\
        report {} (1.4.360; not those that only execution can see), and for {} there is a reason why neither does.\n\
        `cargo xtask vuids` writes this file from the table of rules in `icd/src/validate/rules.rs` and the lists in `docs/valid-usage`.\n\n\
        What the driver reports it survives, with validation and without; so it does most of what the layers report. An\n\
        application that is not valid otherwise (a handle that is none, a pointer of the host that leads nowhere) may still crash.\n\n\
        | statement | driver | layers | why neither |\n| --- | --- | --- | --- |\n",
        rows.len(),
        count(&|row| row.tuff.is_some()),
        count(&|row| row.layers),
        count(&|row| row.tuff.is_none() && !row.layers),
    );
    for row in rows {
        let tuff = row.tuff.map_or(String::new(), |rule| format!("`{rule:?}`"));
        let layers = if row.layers { "yes" } else { "" };
        let reason = row.reason.as_deref().unwrap_or_default();
        writeln!(text, "| `{}` | {tuff} | {layers} | {reason} |", row.name).expect("a string");
    }
    text += "\n## Rules beyond the chapter\n\nWhat the driver reports besides.\n\n| name | rule | what must hold |\n| --- | --- | --- |\n";
    let chapter: BTreeSet<&str> = rows.iter().map(|row| &row.name[..]).collect();
    for rule in Rule::ALL {
        for name in rule.vuids() {
            if !chapter.contains(&name[..]) {
                writeln!(text, "| `{name}` | `{rule:?}` | {} |", rule.text()).expect("a string");
            }
        }
    }
    text
}

#[test]
fn every_statement_is_looked_after_or_has_a_reason() {
    let rows = rows();
    for row in &rows {
        let looked_after = row.tuff.is_some() || row.layers;
        assert_eq!(looked_after, row.reason.is_none(), "{}", row.name);
    }
    // Lists without dead lines.
    let known: BTreeSet<String> = rows
        .iter()
        .flat_map(|row| [Some(row.name.clone()), any(&row.name)])
        .flatten()
        .collect();
    for line in lines("layers.txt").iter().chain(&lines("reasons.txt")) {
        let name = line.split(' ').next().expect("a name");
        assert!(known.contains(name), "{name} is not in the chapter");
    }
    // Names of the commands are the chapter's own.
    for name in Rule::ALL.iter().flat_map(|rule| rule.vuids()) {
        let of_chapter = ["VUID-vkCmdTraceRays", "VUID-VkTraceRays"];
        if of_chapter.iter().any(|prefix| name.starts_with(prefix)) {
            assert!(known.contains(&name), "{name} is not in the chapter");
        }
    }
}

#[test]
fn the_table_is_up_to_date() {
    let path = docs().join("valid-usage.md");
    let text = table(&rows());
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, text).expect("the table can be written");
        return;
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == text,
        "docs/valid-usage.md is out of date: cargo xtask vuids"
    );
}
