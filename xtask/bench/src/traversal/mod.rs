//! `cargo xtask bench traversal`: builds and walks, single-threaded, against Embree.
//!
//! Every engine gets the same meshes and the same rays. Engines take turns many times over, and
//! what is compared is processor time of the same turn, so that a busy machine troubles all alike.
//! Before anything is printed, engines must agree on the number of hits and on their distances.

mod rays;
mod scene;
mod table;
mod tuff;

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use traversal::{BuildFlags, Ray, Tier};

use embree::{Embree, Quality};
use rays::RayKind;
use scene::{RECIPES, Recipe};
use scenes::Mesh;
use table::{EngineRates, Table};
use tuff::{How, StructureMemory, Tuff};

#[derive(Args)]
pub struct Options {
    /// Embree 4's library, if it is not found by itself
    #[arg(long, value_name = "PATH")]
    embree: Option<PathBuf>,
    /// Leave Embree out
    #[arg(long)]
    alone: bool,
    /// Only these scenes: bunny, interior, grid, soup, needles
    #[arg(long, value_name = "NAME")]
    scene: Vec<String>,
    /// Only these engines, by a part of their names, or "=" and the whole
    #[arg(long, value_name = "NAME")]
    engine: Vec<String>,
    /// Use no better instruction set than this: portable, avx2, avx512
    #[arg(long, value_name = "NAME")]
    tier: Option<Tier>,
    /// Only these kinds of rays
    #[arg(long, value_name = "NAME")]
    rays: Vec<String>,
    /// Width and height of the picture whose pixels are the primary rays
    #[arg(long, value_name = "N", default_value_t = 384)]
    size: u32,
    /// Turns that each engine takes
    #[arg(long, value_name = "N", default_value_t = 9)]
    turns: usize,
    /// Builds of each engine; 0: no times of builds
    #[arg(long, value_name = "N", default_value_t = 3)]
    builds: usize,
    /// Write the rows as comma-separated values, too
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write every sample and ratio as JSON, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Who takes part.
#[derive(Clone, Copy)]
enum Contestant {
    Embree(Quality, bool),
    /// In streams of one batch's rays.
    Tuff(u32),
    /// By packets of rays where they cohere.
    Packets(u32),
    /// In lists of one subgroup's rays, one ray after the other.
    Lists(u32),
    /// Each ray by a call of its own.
    Singly(u32),
}

/// The first of those that are there is what the others are compared with.
const CONTESTANTS: [(&str, Contestant); 10] = [
    ("embree robust", Contestant::Embree(Quality::Medium, true)),
    ("embree", Contestant::Embree(Quality::Medium, false)),
    ("embree low", Contestant::Embree(Quality::Low, true)),
    ("tuff", Contestant::Tuff(0)),
    ("tuff packets", Contestant::Packets(0)),
    ("tuff lists", Contestant::Lists(0)),
    ("tuff singly", Contestant::Singly(0)),
    (
        "tuff trace",
        Contestant::Tuff(BuildFlags::PREFER_FAST_TRACE),
    ),
    (
        "tuff build",
        Contestant::Tuff(BuildFlags::PREFER_FAST_BUILD),
    ),
    ("tuff memory", Contestant::Tuff(BuildFlags::LOW_MEMORY)),
];

/// A structure that was built, ready for rays.
enum Engine<'a> {
    Embree(embree::Built<'a>),
    Tuff(Box<Tuff>, How),
    Singly(Box<Tuff>),
}

impl Engine<'_> {
    fn trace(&self, kind: RayKind, rays: &[Ray]) -> (usize, f64) {
        match self {
            Engine::Embree(built) if kind == RayKind::Shadow => built.occluded(rays),
            Engine::Embree(built) => built.closest(rays),
            Engine::Tuff(tuff, how) => tuff.trace(rays, *how),
            Engine::Singly(tuff) => tuff.trace_singly(rays),
        }
    }
}

pub fn run(options: &Options) -> Result<()> {
    if let Some(tier) = options.tier {
        tier.limit();
    }
    let embree = match options.alone {
        true => None,
        false => Embree::open(options.embree.as_deref())?,
    };
    match &embree {
        Some(embree) => println!("Embree {}, one thread", embree.version()),
        None => println!("without Embree (--embree PATH names its library)"),
    }
    let mut table = Table::default();
    for recipe in &RECIPES {
        if options.scene.is_empty() || options.scene.iter().any(|name| name == recipe.name) {
            run_scene(options, embree.as_ref(), recipe, &mut table)?;
        }
    }
    table.print_means();
    if let Some(path) = &options.csv {
        table.write_csv(path)?;
    }
    if let Some(path) = &options.json {
        table.write_json(path)?;
    }
    Ok(())
}

fn run_scene(
    options: &Options,
    embree: Option<&Embree>,
    recipe: &Recipe,
    table: &mut Table,
) -> Result<()> {
    let scene = recipe.make();
    let triangles = scene.mesh.indices.len();
    let contestants: Vec<_> = CONTESTANTS
        .iter()
        .filter(|(name, who)| {
            let is_meant = |part: &String| match part.strip_prefix('=') {
                Some(whole) => *name == whole,
                None => name.contains(part.as_str()),
            };
            let chosen = options.engine.is_empty() || options.engine.iter().any(is_meant);
            chosen && (embree.is_some() || !matches!(who, Contestant::Embree(..)))
        })
        .collect();

    let mut rows: Vec<EngineRates> = contestants
        .iter()
        .map(|(name, _)| EngineRates::new(recipe.name, recipe.counts, name))
        .collect();
    for _ in 0..options.builds {
        for (row, (_, who)) in rows.iter_mut().zip(&contestants) {
            if let Some(seconds) = build_seconds(who, embree, &scene.mesh) {
                row.build.push(triangles as f64 / seconds);
            }
        }
    }
    let mut engines = Vec::new();
    for (row, (_, who)) in rows.iter_mut().zip(&contestants) {
        engines.extend(engine(who, embree, &scene.mesh, row)?);
    }
    let reference = Tuff::new(&scene.mesh, StructureMemory::new(&scene.mesh, 0))?;
    let primary = rays::primary(&scene, options.size);
    let (shadow, diffuse) = rays::secondary(&scene, &reference, &primary);
    for (kind, rays) in RayKind::ALL.into_iter().zip([primary, shadow, diffuse]) {
        if !options.rays.is_empty() && !options.rays.iter().any(|name| name == kind.name()) {
            continue;
        }
        let expected = reference.trace(&rays, How::Lists);
        for turn in 0..=options.turns {
            for (row, engine) in rows.iter_mut().zip(&engines) {
                let (seconds, found) = timed(|| engine.trace(kind, &rays));
                check(row.engine, recipe.name, kind, expected, found)?;
                // The first turn warms caches up.
                if turn > 0 {
                    row.rays[kind as usize].push(rays.len() as f64 / seconds);
                }
            }
        }
    }
    table.add(scene.name, triangles, rows);
    Ok(())
}

/// The time of one build; `None` for Embree without the library.
fn build_seconds(who: &Contestant, embree: Option<&Embree>, mesh: &Mesh) -> Option<f64> {
    Some(match (who, embree) {
        (Contestant::Embree(quality, robust), Some(embree)) => {
            timed(|| embree.build(mesh, *quality, *robust)).0
        }
        (
            Contestant::Tuff(flags)
            | Contestant::Packets(flags)
            | Contestant::Lists(flags)
            | Contestant::Singly(flags),
            _,
        ) => {
            let mut place = StructureMemory::new(mesh, *flags);
            timed(|| place.build(mesh)).0
        }
        _ => return None,
    })
}

/// An engine with the mesh built, and its sizes in `row`; `None` for Embree without the library.
fn engine<'e>(
    who: &Contestant,
    embree: Option<&'e Embree>,
    mesh: &'e Mesh,
    row: &mut EngineRates,
) -> Result<Option<Engine<'e>>> {
    let triangles = mesh.indices.len() as f64;
    match (who, embree) {
        (Contestant::Embree(quality, robust), Some(embree)) => {
            let before = embree.bytes();
            let built = embree.build(mesh, *quality, *robust)?;
            row.bytes = (embree.bytes() - before) as f64 / triangles;
            Ok(Some(Engine::Embree(built)))
        }
        (
            Contestant::Tuff(flags)
            | Contestant::Packets(flags)
            | Contestant::Lists(flags)
            | Contestant::Singly(flags),
            _,
        ) => {
            let tuff = Tuff::new(mesh, StructureMemory::new(mesh, *flags))?;
            row.bytes = tuff.bytes as f64 / triangles;
            row.reported = tuff.reported.map(|bytes| bytes as f64 / triangles);
            Ok(Some(match who {
                Contestant::Packets(_) => Engine::Tuff(Box::new(tuff), How::Packets),
                Contestant::Lists(_) => Engine::Tuff(Box::new(tuff), How::Lists),
                Contestant::Singly(_) => Engine::Singly(Box::new(tuff)),
                _ => Engine::Tuff(Box::new(tuff), How::Streams),
            }))
        }
        _ => Ok(None),
    }
}

/// Engines may differ in rays along edges: one in ten thousand.
fn check(
    engine: &str,
    scene: &str,
    kind: RayKind,
    (hits, sum): (usize, f64),
    (found_hits, found_sum): (usize, f64),
) -> Result<()> {
    let slack = 2 + hits / 10_000;
    ensure!(
        hits.abs_diff(found_hits) <= slack,
        "{engine} finds {found_hits} hits of {} rays in {scene}, not {hits}",
        kind.name()
    );
    ensure!(
        kind == RayKind::Shadow || (sum - found_sum).abs() <= 1e-3 * sum.abs(),
        "{engine}: distances of {} rays in {scene} add up to {found_sum}, not {sum}",
        kind.name()
    );
    Ok(())
}

/// Processor time of this process, in seconds.
fn processor_time() -> f64 {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: a clock that there is, and a place for its time.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = processor_time();
    let result = work();
    (processor_time() - start, result)
}
