//! Maps of a command: for each invocation its rays, their work, the shaders that ran, and time.
//!
//! `maps.json` in the folder of `TUFF_CAPTURE` lists the commands; the numbers of each map are a
//! file beside it, written whole before the list names it. So a program that dies leaves a list of
//! files that are complete.

#![forbid(unsafe_code)]

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use parking_lot::Mutex;
use serde_json::{Value, json};
use spirv_jit::Program;
use xxhash_rust::xxh3::xxh3_64;

use super::Recording;
use super::npy::{self, Width};
use super::output::FOLDER;
use super::structures::DescribedStructure;
use crate::settings::{CaptureSettings, settings};
use crate::timeline::file::ArrayFile;
use crate::wave::launch_counts::{Counter, KeptInvocations, LaunchCounts, MOST_INVOCATIONS};
use crate::wave::observer::{LookupPurpose, Observation, Observer, TableKind};

/// Commands that are captured, at most.
const MAX_COMMANDS: u64 = 64;
/// Bytes of files after which no command is captured any more.
const MAX_BYTES: u64 = 2 << 30;

static MAPS: OnceLock<Option<Maps>> = OnceLock::new();

/// The maps of the process.
pub struct Maps {
    folder: PathBuf,
    process: u32,
    progress: Mutex<MapProgress>,
}

struct MapProgress {
    list: ArrayFile,
    /// Commands within the wanted frames.
    commands: u64,
    captured: u64,
    dropped: u64,
    /// Of the files.
    bytes: u64,
    /// Hashes of the structures that are written.
    structures: BTreeSet<u64>,
}

/// A command whose invocations are counted.
pub struct MapRecording {
    counts: LaunchCounts,
    number: u64,
    frame: u64,
    what: &'static str,
}

impl MapRecording {
    /// Addresses of the top levels that rays have named.
    pub fn structures(&self) -> Vec<u64> {
        self.counts.structures()
    }
}

impl Observer for MapRecording {
    fn invocation(&self) -> Option<[u32; 3]> {
        None
    }

    fn observe(&self, _: Observation) {}

    fn look_up(&self, _: TableKind, _: u32, _: LookupPurpose, _: u32) {}

    fn counts(&self) -> Option<&LaunchCounts> {
        Some(&self.counts)
    }
}

/// The maps, if the settings ask for them and the folder can be written.
pub fn maps(settings: &CaptureSettings) -> Option<&'static Maps> {
    let folder = Path::new(settings.folder?);
    let made = || {
        if let Err(why) = std::fs::create_dir_all(folder) {
            log::error!("{FOLDER}: {}: {why}; nothing is captured", folder.display());
            return None;
        }
        let path = folder.join("maps.json");
        let program = std::env::current_exe().ok();
        let name = program.as_ref().and_then(|path| path.file_name());
        let first = json!({
            "version": 1,
            "program": name.map(|name| name.to_string_lossy()),
        });
        let subject = (FOLDER, "the capture");
        let list = ArrayFile::new(subject, &path.to_string_lossy(), &first.to_string());
        list.is_open().then(|| Maps {
            folder: folder.into(),
            process: std::process::id(),
            progress: Mutex::new(MapProgress {
                list,
                commands: 0,
                captured: 0,
                dropped: 0,
                bytes: 0,
                structures: BTreeSet::new(),
            }),
        })
    };
    // A fork has a copy of this, and the same files.
    (MAPS.get_or_init(made).as_ref()).filter(|maps| maps.process == std::process::id())
}

impl Maps {
    /// Begins to count the invocations of a command, if it is to be captured.
    pub fn begin(
        &self,
        frame: u64,
        what: &'static str,
        first: [u32; 3],
        extent: [u32; 3],
    ) -> Option<Recording> {
        if extent.contains(&0) {
            return None;
        }
        let mut progress = self.progress.lock();
        if !progress.list.is_open() {
            return None;
        }
        let number = progress.commands;
        progress.commands += 1;
        let kept = KeptInvocations::new(first, extent, MOST_INVOCATIONS);
        let has_room = progress.captured < MAX_COMMANDS && progress.bytes < MAX_BYTES;
        let Some(counts) = has_room.then(|| LaunchCounts::new(kept)).flatten() else {
            progress.dropped += 1;
            let dropped = progress.dropped;
            let note = json!({ "dropped_commands": dropped });
            progress.list.note(&format!(",\n{note}"));
            return None;
        };
        progress.captured += 1;
        Some(Recording::Maps(MapRecording {
            counts,
            number,
            frame,
            what,
        }))
    }
}

/// Writes the maps of a command that is complete, or `stopped`.
pub fn finish<'a>(
    recording: MapRecording,
    programs: impl Iterator<Item = &'a Program>,
    structures: impl Iterator<Item = DescribedStructure>,
    stopped: bool,
) {
    let Some(maps) = settings().capture.as_ref().and_then(maps) else {
        return;
    };
    let mut progress = maps.progress.lock();
    if !progress.list.is_open() {
        return;
    }
    let MapRecording {
        counts,
        number,
        frame,
        what,
    } = recording;
    let written = write_all(maps, &mut progress, &counts, number, structures);
    let (entries, structures) = match written {
        Ok(written) => written,
        Err(why) => {
            let said = format!("{}: {why}; the capture ends here", maps.folder.display());
            return progress.list.end(&said);
        }
    };
    let mut programs = programs.filter_map(|program| program.origin());
    let pipeline = programs.find_map(|origin| origin.pipeline.text());
    let KeptInvocations {
        first,
        extent,
        step,
        size,
    } = counts.kept;
    let command = json!({
        "command": number,
        "frame": frame,
        "kind": what,
        "pipeline": pipeline.as_deref(),
        "first": first,
        "extent": extent,
        "step": step,
        "size": size,
        "stopped": stopped,
        "structures": structures,
        "maps": entries,
    });
    progress.list.append(&format!(",\n{command}"));
}

/// Writes the files of a command; returns the entries of its maps and structures.
fn write_all(
    maps: &Maps,
    progress: &mut MapProgress,
    counts: &LaunchCounts,
    number: u64,
    structures: impl Iterator<Item = DescribedStructure>,
) -> io::Result<(Vec<Value>, Vec<Value>)> {
    let folder = format!("command-{number:04}");
    let mut entries = Vec::new();
    for counter in Counter::ALL {
        let (entry, bytes) = write(maps, &folder, counts, counter)?;
        entries.push(entry);
        progress.bytes += bytes;
    }
    let mut described = Vec::new();
    for DescribedStructure { mut facts, file } in structures {
        // One that has not changed since another command is the same file.
        let hash = xxh3_64(&file);
        let name = format!("structure-{hash:016x}.glb");
        if progress.structures.insert(hash) {
            write_whole(&maps.folder.join(&name), &file)?;
            progress.bytes += file.len() as u64;
        }
        facts["file"] = name.into();
        described.push(facts);
    }
    Ok((entries, described))
}

/// Writes one map; returns its entry in the list, and how many bytes were written. One of zeros
/// has no file.
fn write(
    maps: &Maps,
    folder: &str,
    counts: &LaunchCounts,
    counter: Counter,
) -> io::Result<(Value, u64)> {
    let values = counts.values(counter);
    let most = values.clone().max().unwrap_or(0);
    let sum: u64 = values.clone().map(u64::from).sum();
    let (name, of) = described(counter);
    let width = Width::of(most);
    let mut entry = json!({
        "name": name,
        "of": of,
        "most": most,
        "sum": sum,
        "type": width.name(),
        "file": null,
    });
    if most == 0 {
        return Ok((entry, 0));
    }
    let [x, y, z] = counts.kept.size;
    let bytes = npy::file([z, y, x], width, values);
    let file = format!("{folder}/{name}.npy");
    write_whole(&maps.folder.join(&file), &bytes)?;
    entry["file"] = file.into();
    Ok((entry, bytes.len() as u64))
}

/// Writes a file that is whole once it has its name.
fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let partial = path.with_extension("part");
    let written = std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        // A full disk has room for something else again.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

/// Counts of each ray by itself.
const ALONE: &str = "ray";
/// Counts and times of the way that was taken.
const RUN: &str = "run";

/// A map's name, and what it is of.
fn described(counter: Counter) -> (&'static str, &'static str) {
    match counter {
        Counter::Rays => ("rays", ALONE),
        Counter::Steps => ("steps", ALONE),
        Counter::BoxTests => ("box_tests", ALONE),
        Counter::PrimitiveTests => ("primitive_tests", ALONE),
        Counter::AnyHitCandidates => ("any_hit_candidates", ALONE),
        Counter::BoxCandidates => ("box_candidates", ALONE),
        Counter::Depth => ("depth", ALONE),
        Counter::ClosestHits => ("closest_hit_shaders", ALONE),
        Counter::Misses => ("miss_shaders", ALONE),
        Counter::Callables => ("callable_shaders", ALONE),
        Counter::NanRays => ("nan_rays", ALONE),
        Counter::InfiniteRays => ("infinite_rays", ALONE),
        Counter::AnyHitShaders => ("any_hit_shaders", RUN),
        Counter::IntersectionShaders => ("intersection_shaders", RUN),
        Counter::Nanoseconds => ("nanoseconds", RUN),
    }
}
