//! Whether rays are lost: `cargo xtask watertight`.
//!
//! Rays at the edges and vertices of closed meshes, by every tier and in every way of walking, and
//! pairs of triangles whose common edge a ray meets as nearly as numbers can say, against whole
//! numbers. The program needs no file and no driver.

mod triples;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Parser;

use scenes::closed::{self, FAMILIES, Faults, LENGTHS, PLACEMENTS};

#[derive(Parser)]
#[command(
    name = "cargo xtask watertight",
    about = "Counts rays that are lost at seams"
)]
struct Options {
    /// Rays for each kind: a mesh, a placement, and a side; spread over all lengths
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    rays: usize,
    /// Rays at the common edge of two triangles, against whole numbers
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    triples: usize,
    /// How many threads work; all that the machine has by default
    #[arg(long)]
    threads: Option<usize>,
    /// Only meshes with one of these in their names
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Starts no more work after N minutes; by then all kinds have had about equally many rays
    #[arg(long, value_name = "N")]
    minutes: Option<f64>,
    /// Other rays
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

/// A piece of work.
struct Job {
    /// The name under which its outcome is summed.
    name: String,
    /// How many pieces of that name come before it.
    earlier: usize,
    run: Box<dyn Fn(u64) -> Faults + Sync + Send>,
}

/// Rays of one piece of work.
const PIECE: usize = 1 << 16;

/// So many rays of a name, in pieces; `run` takes how many, and a seed.
fn pieces(
    name: &str,
    count: usize,
    run: impl Fn(usize, u64) -> Faults + Copy + Sync + Send + 'static,
) -> impl Iterator<Item = Job> {
    (0..count).step_by(PIECE).map(move |done| Job {
        name: name.to_owned(),
        earlier: done / PIECE,
        run: Box::new(move |seed| run(PIECE.min(count - done), seed)),
    })
}

/// All work, so ordered that no name is far ahead of another.
fn jobs(options: &Options) -> Vec<Job> {
    let mut jobs = Vec::new();
    let each = options.rays.div_ceil(LENGTHS.len());
    let is_meant =
        |name: &str| options.only.is_empty() || options.only.iter().any(|part| name.contains(part));
    for family in FAMILIES.iter().filter(|family| is_meant(family.name)) {
        for placement in &PLACEMENTS {
            for inside in [true, false] {
                for length in LENGTHS {
                    let side = if inside { "inside" } else { "outside" };
                    let name = format!("{}, {}, {side}, {length}", family.name, placement.name);
                    jobs.extend(pieces(&name, each, move |count, seed| {
                        closed::faults(family, length, placement, inside, seed, count)
                    }));
                }
            }
        }
    }
    for (kind, name) in triples::KINDS.iter().enumerate() {
        let name = format!("pairs: {name}");
        if is_meant(&name) {
            let each = options.triples.div_ceil(triples::KINDS.len());
            jobs.extend(pieces(&name, each, move |count, seed| {
                triples::faults(kind, seed, count)
            }));
        }
    }
    jobs.sort_by_key(|job| job.earlier);
    jobs
}

/// A state of the generator of random numbers, for a piece of work: SplitMix64.
fn scramble(seed: u64, piece: usize) -> u64 {
    let mut z = (seed << 32 | piece as u64)
        .wrapping_add(1)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ z >> 31).max(1)
}

fn main() -> ExitCode {
    let options = Options::parse();
    let jobs = jobs(&options);
    let threads = options
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get));
    let next = AtomicUsize::new(0);
    let rows: Mutex<BTreeMap<&str, Faults>> = Mutex::default();
    let start = std::time::Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let piece = next.fetch_add(1, Ordering::Relaxed);
                    let minutes = start.elapsed().as_secs_f64() / 60.0;
                    let late = options.minutes.is_some_and(|end| minutes >= end);
                    let Some(Job { name, run, .. }) = jobs.get(piece).filter(|_| !late) else {
                        return;
                    };
                    let faults = run(scramble(options.seed, piece));
                    let mut rows = rows.lock().expect("no thread panics with it");
                    *rows.entry(name).or_default() += faults;
                    if piece % 256 == 255 {
                        eprintln!(
                            "{} of {} pieces begun, {:.0?}",
                            piece + 1,
                            jobs.len(),
                            start.elapsed()
                        );
                    }
                }
            });
        }
    });
    let rows = rows.into_inner().expect("threads have ended");
    let tiers: Vec<_> = scenes::ways::walkers()
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    println!(
        "walkers: {}; {threads} threads, {:.0?}",
        tiers.join("; "),
        start.elapsed()
    );
    println!(
        "| kind | rays | lost | candidates other than crossings | unequal ways | wrong by whole numbers | of rays | faces beyond f64 |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
    let mut all = Faults::default();
    for (name, faults) in &rows {
        let Faults {
            rays,
            lost,
            miscounted,
            unequal,
            wrong,
            checked,
            whole,
        } = faults;
        println!(
            "| {name} | {rays} | {lost} | {miscounted} | {unequal} | {wrong} | {checked} | {whole} |"
        );
        all += *faults;
    }
    println!("{all:?}");
    match all.none() && all.rays > 0 {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
