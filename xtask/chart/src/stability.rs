//! Where methods start to fail: heat maps over what makes a scene hard.

mod crossings;
mod starts;
mod transforms;

use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Result;
use canvas::{Cell, HeatMap, save, short};
use traversal::{Accuracy, Ray};

use crate::Options;
use crate::report::Report;
use crate::triangles::Test;
use crate::walks::Engine;
use embree::{Embree, Quality};
use scenes::hard::{CASES, Hard, HardSeries, fault};

/// A share of wrong answers, as a cell.
fn cell(wrong: usize, all: usize) -> Option<Cell> {
    let share = wrong as f64 / all.max(1) as f64;
    let label = match share {
        0.0 => "0".to_string(),
        share if share < 0.001 => "<0.1 %".to_string(),
        share if share < 0.1 => format!("{:.1} %", share * 100.0),
        share => format!("{:.0} %", share * 100.0),
    };
    // From one in a thousand to all: by orders of magnitude.
    let badness = if wrong == 0 {
        0.0
    } else {
        0.15 + 0.85 * (1.0 + share.log10() / 3.0).max(0.0)
    };
    (all > 0).then_some((label, badness))
}

/// The method that answers rays.
enum Method {
    /// Every triangle is tested.
    Tests(Test),
    Walk(fn(&scenes::Mesh) -> Engine),
    /// Embree, robust or not; left out where it is not there.
    Embree(bool),
}

const METHODS: [(&str, Method); 11] = [
    ("Möller–Trumbore f32", Method::Tests(Test::MollerTrumbore)),
    (
        "Möller–Trumbore f64",
        Method::Tests(Test::MollerTrumboreWide),
    ),
    ("WBW f32", Method::Tests(Test::Woop)),
    ("Tuff's test", Method::Tests(Test::Ours(Accuracy::Spec))),
    (
        "Tuff's test, exact",
        Method::Tests(Test::Ours(Accuracy::Exact)),
    ),
    ("walk: obvhs Bvh2", Method::Walk(Engine::bvh2)),
    ("walk: obvhs CwBvh", Method::Walk(Engine::cwbvh)),
    ("walk: Embree", Method::Embree(false)),
    ("walk: Embree robust", Method::Embree(true)),
    (
        "walk: Tuff",
        Method::Walk(|mesh| Engine::accurate(mesh, Accuracy::Spec)),
    ),
    (
        "walk: Tuff exact",
        Method::Walk(|mesh| Engine::accurate(mesh, Accuracy::Exact)),
    ),
];

impl Method {
    /// How many answers are wrong; `None` if it fails altogether.
    fn wrong(&self, hard: &Hard, embree: Option<&Embree>) -> Option<usize> {
        let faults = |answer: &mut dyn FnMut(&Ray) -> Option<f32>| {
            let wrong = |(ray, truth): &&(Ray, Option<f64>)| fault(answer(ray), *truth).is_some();
            hard.rays.iter().filter(wrong).count()
        };
        match self {
            Method::Tests(test) => {
                let mesh = &hard.mesh;
                let triangles: Vec<_> = (0..mesh.indices.len()).map(|i| mesh.triangle(i)).collect();
                Some(faults(&mut |ray| {
                    let found = test.nearest(ray, triangles.iter());
                    found.map(|(_, (t, _))| t)
                }))
            }
            Method::Walk(make) => catch_unwind(AssertUnwindSafe(|| {
                let mut engine = make(&hard.mesh);
                faults(&mut |ray| engine.closest(ray))
            }))
            .ok(),
            Method::Embree(robust) => {
                let mut mesh = hard.mesh.clone();
                // Embree may read some bytes behind the last vertex.
                mesh.vertices.push([0.0; 3]);
                let built = embree?.build(&mesh, Quality::Medium, *robust).ok()?;
                Some(faults(&mut |ray| match built.closest(&[*ray]) {
                    (0, _) => None,
                    (_, t) => Some(t as f32),
                }))
            }
        }
    }
}

/// A map to be filled column by column.
struct Map {
    name: &'static str,
    map: HeatMap,
}

impl Map {
    fn new(name: &'static str, title: &str, across: &str, rows: &[&str]) -> Map {
        let rows = rows.iter().map(|row| ((*row).to_string(), Vec::new()));
        Map {
            name,
            map: HeatMap {
                title: title.into(),
                across: across.into(),
                columns: Vec::new(),
                rows: rows.collect(),
                foot: String::new(),
            },
        }
    }

    /// Adds a column: for each row, wrong answers of how many; `None`: it fails altogether.
    fn column(&mut self, report: &mut Report, label: String, found: &[Option<(usize, usize)>]) {
        for ((row, cells), found) in self.map.rows.iter_mut().zip(found) {
            cells.push(match *found {
                Some((wrong, all)) => cell(wrong, all),
                None => Some(("fails".into(), 1.0)),
            });
            let share = found.map_or(1.0, |(wrong, all)| wrong as f64 / all.max(1) as f64);
            let table = format!("stability-{}", self.name);
            report.number(&table, row, &label, share);
        }
        self.map.columns.push(label);
    }

    fn save(mut self, options: &Options, report: &Report) -> Result<()> {
        println!("\n{} ({})", self.map.title, self.map.across);
        print!("{:<24}", "");
        for column in &self.map.columns {
            print!("{column:>9}");
        }
        println!();
        for (row, cells) in &self.map.rows {
            print!("{row:<24}");
            for cell in cells {
                print!("{:>9}", cell.as_ref().map_or("", |cell| cell.0.as_str()));
            }
            println!();
        }
        self.map.foot = format!("share of wrong answers · {}", report.foot());
        save(&self.map, &options.out, &format!("stability-{}", self.name))
    }
}

fn case(
    case: &HardSeries,
    options: &Options,
    embree: Option<&Embree>,
    report: &mut Report,
) -> Result<()> {
    let rays = if options.quick { 100 } else { 1_000 };
    let is_there = |method: &Method| embree.is_some() || !matches!(method, Method::Embree(_));
    let methods: Vec<_> = METHODS
        .iter()
        .filter(|(_, method)| is_there(method))
        .collect();
    let names: Vec<&str> = methods.iter().map(|(name, _)| *name).collect();
    let mut map = Map::new(case.name, case.title, case.across, &names);
    for &column in case.columns {
        let hard = case.make(column, rays);
        let found: Vec<Option<(usize, usize)>> = methods
            .iter()
            .map(|(_, method)| Some((method.wrong(&hard, embree)?, hard.rays.len())))
            .collect();
        map.column(report, short(column), &found);
    }
    map.save(options, report)
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    // A library's panic is a result here, and needs no text of its own.
    let quiet = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let embree = Embree::open(options.embree.as_deref())?;
    let done = CASES
        .iter()
        .try_for_each(|one| case(one, options, embree.as_ref(), report));
    std::panic::set_hook(quiet);
    done?;
    crossings::measure(options, report)?;
    transforms::measure(options, report)?;
    starts::measure(options, report)
}
