//! Drivers against each other, format by format, and the table of their ratios.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use indicatif::ProgressBar;
use serde::Serialize;

use super::table;
use super::{ACCESSES, Access, Cell, Measured, SHAPES, Shape, disagreement};
use crate::child::{answer, child};

/// The first driver against the second in one cell.
#[derive(Clone, Debug, Serialize)]
struct Ratio {
    format: String,
    access: Access,
    shape: Shape,
    /// Processor time of each driver's fastest turn.
    seconds: [f64; 2],
    /// Why the ratio does not count, where results differ.
    disagreement: Option<String>,
}

impl Ratio {
    fn value(&self) -> f64 {
        self.seconds[1] / self.seconds[0]
    }
}

/// Cells below this are listed.
const LEAST: f64 = 0.95;

/// Measures the first driver against the second. `only` has names of formats and of accesses.
pub fn compare(
    icds: &[PathBuf],
    only: &[String],
    rounds: usize,
    threads: u32,
    json: Option<&Path>,
) -> Result<()> {
    ensure!(icds.len() == 2, "formats are compared between two drivers");
    let accesses = ACCESSES.map(Access::name);
    let names: Vec<String> = table::ALL.iter().map(table::FormatEntry::name).collect();
    let (wanted_accesses, wanted): (Vec<_>, Vec<_>) = only
        .iter()
        .cloned()
        .partition(|name| accesses.contains(name));
    for name in &wanted {
        ensure!(
            names.contains(name),
            "there is no format or access «{name}»"
        );
    }
    let formats = names
        .iter()
        .filter(|name| wanted.is_empty() || wanted.contains(name));
    let formats: Vec<&String> = formats.collect();
    let bar = ProgressBar::new((formats.len() * rounds * 2) as u64);
    let (mut ratios, mut drivers) = (Vec::new(), [const { String::new() }; 2]);
    for format in formats {
        let mut least: [BTreeMap<(Access, Shape), Cell>; 2] = Default::default();
        for round in 0..rounds {
            // The order alternates.
            for turn in 0..2 {
                let driver = (round + turn) % 2;
                let measured = run(&icds[driver], format, &wanted_accesses, threads)
                    .with_context(|| format!("{format} with {}", icds[driver].display()))?;
                drivers[driver] = measured.driver;
                for cell in measured.cells {
                    let best = least[driver].entry((cell.access, cell.shape));
                    let best = best.or_insert_with(|| cell.clone());
                    best.seconds = best.seconds.min(cell.seconds);
                }
                bar.inc(1);
            }
        }
        for (&(access, shape), first) in &least[0] {
            let Some(second) = least[1].get(&(access, shape)) else {
                continue;
            };
            ratios.push(Ratio {
                format: format.clone(),
                access,
                shape,
                seconds: [first.seconds, second.seconds],
                disagreement: disagreement(format, first, second)
                    .err()
                    .map(|why| why.to_string()),
            });
        }
    }
    bar.finish_and_clear();
    println!("{} · {}", canvas::machine(), canvas::date());
    println!("0: {}\n1: {}\n", drivers[0], drivers[1]);
    print!("{}", report(&ratios));
    if let Some(path) = json {
        let text = serde_json::to_string_pretty(&ratios)?;
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

/// One process with one driver.
fn run(icd: &Path, format: &str, accesses: &[String], threads: u32) -> Result<Measured> {
    let mut child = child(icd, Some(threads))?;
    child.args(["format", format]);
    if !accesses.is_empty() {
        child.args(["--accesses", &accesses.join(",")]);
    }
    answer(child)
}

/// The geometric mean.
fn mean<'r>(ratios: impl IntoIterator<Item = &'r Ratio>) -> Option<f64> {
    let counted = ratios
        .into_iter()
        .filter(|ratio| ratio.disagreement.is_none());
    let logarithms: Vec<f64> = counted.map(|ratio| libm::log(ratio.value())).collect();
    let sum: f64 = logarithms.iter().sum();
    (!logarithms.is_empty()).then(|| libm::exp(sum / logarithms.len() as f64))
}

/// A table with a row for each format, a column for each access and a number for each shape; then
/// means, slow cells and differences.
fn report(ratios: &[Ratio]) -> String {
    let number =
        |ratio: Option<f64>| ratio.map_or("–".to_string(), |ratio| format!("{ratio:.2}"));
    let mut text = String::from("| format |");
    let mut rule = String::from("| --- |");
    for access in ACCESSES {
        let _ = write!(text, " {} |", access.name());
        rule += " --- |";
    }
    let _ = writeln!(text, " mean |\n{rule} ---: |");
    for of_format in ratios.chunk_by(|a, b| a.format == b.format) {
        let _ = write!(text, "| {} |", of_format[0].format);
        for access in ACCESSES {
            let shapes = access.shapes().iter().map(|&shape| {
                let found = of_format
                    .iter()
                    .find(|it| (it.access, it.shape) == (access, shape));
                match found {
                    Some(ratio) if ratio.disagreement.is_some() => "≠".into(),
                    found => number(found.map(Ratio::value)),
                }
            });
            let shapes: Vec<String> = shapes.collect();
            let _ = write!(text, " {} |", shapes.join(" "));
        }
        let _ = writeln!(text, " {} |", number(mean(of_format)));
    }
    let _ = writeln!(text, "\nNumbers of a column: {}.\n", columns());
    text += "| access | 2D | 3D | cube | array |\n| --- | ---: | ---: | ---: | ---: |\n";
    for access in ACCESSES {
        let _ = write!(text, "| {} |", access.name());
        for shape in SHAPES {
            let cells = ratios
                .iter()
                .filter(|it| (it.access, it.shape) == (access, shape));
            let _ = write!(text, " {} |", number(mean(cells)));
        }
        text += "\n";
    }
    let _ = writeln!(
        text,
        "\nGeometric mean of {} cells: {}",
        ratios.len(),
        number(mean(ratios))
    );
    let mut slow: Vec<&Ratio> = ratios
        .iter()
        .filter(|ratio| ratio.value() < LEAST)
        .collect();
    slow.sort_by(|a, b| a.value().total_cmp(&b.value()));
    let _ = writeln!(text, "\n{} cells are below {LEAST}:\n", slow.len());
    for ratio in slow {
        let [a, b] = ratio.seconds.map(|seconds| seconds * 1e3);
        let (name, value) = (title(ratio), ratio.value());
        let _ = writeln!(text, "* {name}: {value:.2} ({a:.2} and {b:.2} ms)");
    }
    for ratio in ratios {
        if let Some(why) = &ratio.disagreement {
            let _ = writeln!(text, "* {}: {why}", title(ratio));
        }
    }
    text
}

fn title(ratio: &Ratio) -> String {
    let (access, shape) = (ratio.access.name(), ratio.shape.name());
    format!("{} {access} {shape}", ratio.format)
}

/// The shapes whose numbers the columns have.
fn columns() -> String {
    let several = ACCESSES
        .into_iter()
        .filter(|access| access.shapes().len() > 1);
    let of_access = |access: Access| {
        let shapes: Vec<&str> = access.shapes().iter().map(|shape| shape.name()).collect();
        format!("{} {}", access.name(), shapes.join(", "))
    };
    several.map(of_access).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(format: &str, access: Access, seconds: [f64; 2]) -> Ratio {
        Ratio {
            format: format.into(),
            access,
            shape: Shape::Flat,
            seconds,
            disagreement: None,
        }
    }

    #[test]
    fn slow_cells_are_listed_and_different_ones_do_not_count() {
        let mut ratios = vec![
            ratio("R8_UNORM", Access::Fetch, [1e-3, 4e-3]),
            ratio("R8_UNORM", Access::Nearest, [2e-3, 1e-3]),
            ratio("R8_SNORM", Access::Fetch, [1e-3, 9e-3]),
        ];
        ratios[2].disagreement = Some("results differ by 7 %".into());
        let text = report(&ratios);
        assert!(
            text.contains("| R8_UNORM | 4.00 – – | 0.50 – – – |"),
            "{text}"
        );
        assert!(text.contains("| R8_SNORM | ≠ – – |"), "{text}");
        assert!(text.contains("Geometric mean of 3 cells: 1.41"), "{text}");
        assert!(
            text.contains("* R8_UNORM nearest 2D: 0.50 (2.00 and 1.00 ms)"),
            "{text}"
        );
        assert!(
            text.contains("* R8_SNORM fetch 2D: results differ by 7 %"),
            "{text}"
        );
    }
}
