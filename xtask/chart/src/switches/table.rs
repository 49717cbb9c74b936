//! Gains of switches by workload, and the gains that are too small.

use std::fmt::Write as _;

use super::columns::Column;

/// A switch with smaller gains on every workload is not worth its code.
const WORTH: f64 = 0.02;

/// How much more time it takes without.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    pub median: f64,
    /// Half the range of the middle half of the pairs.
    pub spread: f64,
}

impl Gain {
    pub fn of(mut ratios: Vec<f64>) -> Gain {
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share).round() as usize];
        Gain {
            median: at(0.5) - 1.0,
            spread: (at(0.75) - at(0.25)) / 2.0,
        }
    }
}

/// A row a switch, a column a workload.
pub struct Table<'a> {
    pub columns: Vec<&'a Column>,
    pub names: Vec<&'static str>,
    /// Row by row.
    pub gains: Vec<Gain>,
}

impl Table<'_> {
    fn rows(&self) -> impl Iterator<Item = (&'static str, &[Gain])> {
        let rows = self.gains.chunks(self.columns.len());
        self.names.iter().copied().zip(rows)
    }

    pub fn cells(&self) -> impl Iterator<Item = (&'static str, &Column, Gain)> {
        self.rows().flat_map(|(name, gains)| {
            let cells = self.columns.iter().zip(gains);
            cells.map(move |(column, gain)| (name, *column, *gain))
        })
    }

    /// The switches that gain too little everywhere.
    pub fn idle(&self) -> Vec<&'static str> {
        self.rows()
            .filter(|(_, gains)| gains.iter().all(|gain| gain.median < WORTH))
            .map(|(name, _)| name)
            .collect()
    }

    /// Percent, with the spread.
    pub fn markdown(&self) -> String {
        let mut text = String::from("| % |");
        for column in &self.columns {
            let _ = write!(text, " {} |", column.name);
        }
        text += "\n| --- |";
        text += &" ---: |".repeat(self.columns.len());
        text.push('\n');
        for (name, gains) in self.rows() {
            let _ = write!(text, "| `{name}` |");
            for Gain { median, spread } in gains {
                let _ = write!(text, " {} ±{:.0} |", signed(*median), 100.0 * spread);
            }
            text.push('\n');
        }
        text
    }

    pub fn coloured(&self) -> Vec<(String, Vec<Option<canvas::Cell>>)> {
        let cell = |gain: &Gain| {
            let badness = match gain.median.abs() < WORTH {
                true => 0.0,
                false => (gain.median * 1.5).clamp(0.05, 1.0),
            };
            Some((format!("{} %", signed(gain.median)), badness))
        };
        self.rows()
            .map(|(name, gains)| (name.to_string(), gains.iter().map(cell).collect()))
            .collect()
    }
}

/// Percent with a sign, zero excepted.
fn signed(share: f64) -> String {
    match (100.0 * share).round() {
        0.0 => "0".into(),
        percent => format!("{percent:+}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::switches::columns::COLUMNS;

    #[test]
    fn the_median_and_the_middle_half_count() {
        let gain = Gain::of(vec![1.5, 1.0, 1.02, 1.04, 1.03]);
        assert!((gain.median - 0.03).abs() < 1e-9);
        assert!((gain.spread - 0.01).abs() < 1e-9);
    }

    #[test]
    fn what_gains_nothing_is_named() {
        let gain = |median| Gain {
            median,
            spread: 0.0,
        };
        let table = Table {
            columns: COLUMNS[..2].iter().collect(),
            names: vec!["useful", "idle"],
            gains: vec![gain(0.001), gain(0.3), gain(-0.2), gain(0.01)],
        };
        assert_eq!(table.idle(), ["idle"]);
        let rows = table.markdown();
        assert!(
            rows.ends_with("| `useful` | 0 ±0 | +30 ±0 |\n| `idle` | -20 ±0 | +1 ±0 |\n"),
            "{rows}"
        );
    }
}
