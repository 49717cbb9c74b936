//! The measurements: for programs as JSON and CSV, for people as charts and tables.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use canvas::{Axis, Mark, Point, Scatter, dominated, save, short};
use serde::Serialize;

/// One method on one chart.
#[derive(Clone, Debug, Serialize)]
pub struct Method {
    pub chart: String,
    pub name: String,
    /// `default`, `ours` or `other`.
    pub kind: &'static str,
    pub cost: f64,
    pub error: f64,
    /// A method that is at least as good in both, and better in one.
    pub dominated_by: Option<String>,
}

/// One cell of a map of failures, or of a table.
#[derive(Clone, Debug, Serialize)]
pub struct Number {
    pub table: String,
    pub row: String,
    pub column: String,
    pub value: f64,
}

/// All that one call measured.
#[derive(Debug, Serialize)]
pub struct Report {
    pub machine: String,
    pub date: String,
    pub methods: Vec<Method>,
    pub numbers: Vec<Number>,
    /// The printed text, in Markdown.
    #[serde(skip)]
    tables: String,
}

/// The contents of a chart of methods.
pub struct Chart<'a> {
    pub name: &'a str,
    pub title: &'a str,
    pub cost: &'a str,
    pub error: &'a str,
}

impl Report {
    pub fn new() -> Report {
        Report {
            machine: canvas::machine(),
            date: canvas::date(),
            methods: Vec::new(),
            numbers: Vec::new(),
            tables: String::new(),
        }
    }

    /// Prints Markdown, which [`Self::write`] writes too.
    pub fn say(&mut self, text: &str) {
        println!("{text}");
        self.tables += text;
        self.tables.push('\n');
    }

    /// A table of which each row begins with a name.
    pub fn table(&mut self, title: &str, columns: &[&str], rows: &[Vec<String>]) {
        let mut text = format!("{title}\n\n| | {} |\n| --- |", columns.join(" | "));
        text += &" ---: |".repeat(columns.len());
        for row in rows {
            let _ = write!(text, "\n| {} |", row.join(" | "));
        }
        self.say(&(text + "\n"));
    }

    pub fn foot(&self) -> String {
        format!("{} · {}", self.machine, self.date)
    }

    /// Notes a number.
    pub fn number(&mut self, table: &str, row: &str, column: &str, value: f64) {
        self.numbers.push(Number {
            table: table.into(),
            row: row.into(),
            column: column.into(),
            value,
        });
    }

    /// Notes methods, draws them, and prints the dominated ones.
    pub fn frontier(&mut self, out: &Path, chart: &Chart<'_>, points: Vec<Point>) -> Result<()> {
        let pairs: Vec<_> = points.iter().map(|point| (point.x, point.y)).collect();
        let mut rows = Vec::new();
        for (point, beaten) in points.iter().zip(dominated(&pairs)) {
            let by = beaten.map(|index| points[index].label.clone());
            rows.push(vec![
                point.label.clone(),
                short(point.x),
                short(point.y),
                by.clone().unwrap_or_default(),
            ]);
            self.methods.push(Method {
                chart: chart.name.into(),
                name: point.label.clone(),
                kind: match point.mark {
                    Mark::Default => "default",
                    Mark::Ours => "ours",
                    Mark::Other => "other",
                },
                cost: point.x,
                error: point.y,
                dominated_by: by,
            });
        }
        let columns = [chart.cost, chart.error, "dominated by"];
        self.table(chart.title, &columns, &rows);
        let scatter = Scatter {
            title: chart.title.into(),
            x: Axis::of(chart.cost, points.iter().map(|point| point.x)),
            y: Axis::of(chart.error, points.iter().map(|point| point.y)),
            points,
            groups: Vec::new(),
            foot: self.foot(),
        };
        save(&scatter, out, chart.name)
    }

    /// `results.json`, `results.csv` and `tables.md`.
    pub fn write(&self, out: &Path) -> Result<()> {
        std::fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
        let json = serde_json::to_string_pretty(self)?;
        let mut csv = String::from("table,row,column,value,dominated_by\n");
        for method in &self.methods {
            let by = method.dominated_by.as_deref().unwrap_or_default();
            for (column, value) in [("cost", method.cost), ("error", method.error)] {
                let (chart, name) = (&method.chart, &method.name);
                let _ = writeln!(csv, "{chart},\"{name}\",{column},{value},\"{by}\"");
            }
        }
        for number in &self.numbers {
            let (table, row, column) = (&number.table, &number.row, &number.column);
            let _ = writeln!(csv, "{table},\"{row}\",\"{column}\",{},", number.value);
        }
        let tables = format!("{}\n\n{}", self.foot(), self.tables);
        let files = [
            ("results.json", json),
            ("results.csv", csv),
            ("tables.md", tables),
        ];
        for (name, text) in files {
            let path = out.join(name);
            std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
        }
        println!("\n{}", out.display());
        Ok(())
    }
}
