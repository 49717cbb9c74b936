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

use crate::case::Case;
use crate::world::World;

/// A kind of nonsense.
pub struct Target {
    pub name: &'static str,
    pub run: fn(&World, &Case),
}

const TARGETS: [Target; 12] = [
    Target {
        name: "modules",
        run: modules::run,
    },
    Target {
        name: "structures",
        run: structures::run,
    },
    Target {
        name: "blobs",
        run: structures::run_serialized,
    },
    Target {
        name: "scribbles",
        run: scribbles::run,
    },
    Target {
        name: "caches",
        run: caches::run,
    },
    Target {
        name: "transfers",
        run: transfers::run,
    },
    Target {
        name: "builds",
        run: builds::run,
    },
    Target {
        name: "micromaps",
        run: micromaps::run,
    },
    Target {
        name: "descriptors",
        run: descriptors::run,
    },
    Target {
        name: "heaps",
        run: heaps::run,
    },
    Target {
        name: "draws",
        run: draws::run,
    },
    Target {
        name: "tables",
        run: tables::run,
    },
];

/// Targets by name; all if none is named.
pub fn named(names: &[String]) -> Result<Vec<&'static Target>> {
    static ALL: &[Target] = &TARGETS;
    if names.is_empty() {
        return Ok(ALL.iter().collect());
    }
    let find = |name: &String| {
        let all: Vec<&str> = ALL.iter().map(|target| target.name).collect();
        ALL.iter()
            .find(|target| target.name == name)
            .with_context(|| format!("{name} is none of {}", all.join(", ")))
    };
    names.iter().map(find).collect()
}
