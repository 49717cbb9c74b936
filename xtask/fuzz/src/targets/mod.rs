//! The parts of the driver that the fuzzer feeds.

mod builds;
mod caches;
mod descriptors;
mod draws;
mod heaps;
mod micromaps;
mod modules;
mod scribbles;
mod structures;
mod tables;
mod transfers;

use anyhow::{Context, Result};

use crate::case::FuzzTarget;

const TARGETS: [FuzzTarget; 12] = [
    FuzzTarget {
        name: "modules",
        run: modules::run,
    },
    FuzzTarget {
        name: "structures",
        run: structures::run,
    },
    FuzzTarget {
        name: "blobs",
        run: structures::run_serialized,
    },
    FuzzTarget {
        name: "scribbles",
        run: scribbles::run,
    },
    FuzzTarget {
        name: "caches",
        run: caches::run,
    },
    FuzzTarget {
        name: "transfers",
        run: transfers::run,
    },
    FuzzTarget {
        name: "builds",
        run: builds::run,
    },
    FuzzTarget {
        name: "micromaps",
        run: micromaps::run,
    },
    FuzzTarget {
        name: "descriptors",
        run: descriptors::run,
    },
    FuzzTarget {
        name: "heaps",
        run: heaps::run,
    },
    FuzzTarget {
        name: "draws",
        run: draws::run,
    },
    FuzzTarget {
        name: "tables",
        run: tables::run,
    },
];

static ALL: &[FuzzTarget] = &TARGETS;

/// Targets by name; all if none is named.
pub fn all_named(names: &[String]) -> Result<Vec<&'static FuzzTarget>> {
    match names {
        [] => Ok(ALL.iter().collect()),
        names => names.iter().map(|name| named(name)).collect(),
    }
}

/// The target of this name.
pub fn named(name: &str) -> Result<&'static FuzzTarget> {
    let all: Vec<&str> = ALL.iter().map(|target| target.name).collect();
    (ALL.iter().find(|target| target.name == name))
        .with_context(|| format!("{name} is none of {}", all.join(", ")))
}
