//! Maps of a command: for each invocation its rays, their work, the shaders that ran, and time.
//!
//! `maps.json` in the folder of `TUFF_CAPTURE` lists the commands; the numbers of each map are a
//! file beside it, written whole before the list names it. So a program that dies leaves a list of
//! files that are complete.

#![forbid(unsafe_code)]

use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use parking_lot::Mutex;
use serde_json::{Value, json};
use spirv_jit::Program;

use super::Recording;
use super::npy::{self, Width};
use super::output::FOLDER;
use super::structures::{DescribedStructure, KnownStructures};
use crate::settings::{CaptureSettings, settings};
use crate::timeline::file::ArrayFile;
use crate::wave::launch_counts::{
    Counter, FinishedCounts, KeptInvocations, LaunchCounts, MOST_INVOCATIONS, SpareCounts,
};
use crate::wave::observer::Observer;

/// Commands of a kind that are captured, at most.
const MAX_COMMANDS: u64 = 64;
/// Invocations whose counts leave their memory to the next command, at most.
const MOST_SPARE: usize = 1 << 20;
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
    /// Traces and dispatches within the wanted frames, and passes.
    commands: [u64; 2],
    dropped: u64,
    /// Of the files.
    bytes: u64,
    structures: KnownStructures,
    spare: SpareCounts,
    /// Memory for files.
    file: Vec<u8>,
}

impl MapProgress {
    /// Notes behind all elements how many commands are dropped, if any are.
    fn note_dropped(&mut self) {
        if self.dropped > 0 {
            let note = json!({ "dropped_commands": self.dropped });
            self.list.note(&format!(",\n{note}"));
        }
    }
}

/// A kind of command that is captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandKind {
    Trace,
    Dispatch,
    Pass,
}

impl CommandKind {
    fn is_pass(self) -> bool {
        self == Self::Pass
    }

    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trace => "trace",
            Self::Dispatch => "dispatch",
            Self::Pass => "pass",
        }
    }
}

/// A command whose invocations are counted.
pub struct MapRecording {
    counts: LaunchCounts,
    number: u64,
    frame: u64,
    kind: CommandKind,
}

impl Observer for MapRecording {
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
                commands: [0; 2],
                dropped: 0,
                bytes: 0,
                structures: KnownStructures::default(),
                spare: SpareCounts::default(),
                file: Vec::new(),
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
        kind: CommandKind,
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
        let commands = &mut progress.commands[usize::from(kind.is_pass())];
        let number = *commands;
        *commands += 1;
        let kept = KeptInvocations::new(first, extent, MOST_INVOCATIONS);
        let has_room = number < MAX_COMMANDS && progress.bytes < MAX_BYTES;
        let spare = std::mem::take(&mut progress.spare);
        let made = || LaunchCounts::new(kept, !kind.is_pass(), spare);
        let Some(counts) = has_room.then(made).flatten() else {
            progress.dropped += 1;
            progress.note_dropped();
            return None;
        };
        Some(Recording::Maps(MapRecording {
            counts,
            number,
            frame,
            kind,
        }))
    }
}

/// Writes the maps of a command that is complete, or `stopped`. `describe`: the top level at an
/// address.
pub fn finish<'a>(
    recording: MapRecording,
    programs: impl Iterator<Item = &'a Program>,
    describe: impl Fn(&mut KnownStructures, u64) -> Option<DescribedStructure>,
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
        kind,
    } = recording;
    let addresses = counts.structures();
    let described = (addresses.into_iter())
        .filter_map(|address| describe(&mut progress.structures, address))
        .collect();
    let counts = counts.finish();
    let written = write_all(maps, &mut progress, &counts, (kind, number), described);
    let WrittenCommand {
        maps: entries,
        structures,
        first_rays,
    } = match written {
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
        "kind": kind.name(),
        "pipeline": pipeline.as_deref(),
        "first": first,
        "extent": extent,
        "step": step,
        "size": size,
        "stopped": stopped,
        "structures": structures,
        "maps": entries,
        "first_rays": first_rays,
    });
    progress.list.append(&format!(",\n{command}"));
    progress.note_dropped();
    if counts.kept.count() <= MOST_SPARE {
        progress.spare = counts.into_spare();
    }
}

/// Entries of a command in the list, whose files are written.
struct WrittenCommand {
    maps: Vec<Value>,
    structures: Vec<Value>,
    first_rays: Value,
}

/// Writes the files of a command.
fn write_all(
    maps: &Maps,
    progress: &mut MapProgress,
    counts: &FinishedCounts,
    (kind, number): (CommandKind, u64),
    described: Vec<DescribedStructure>,
) -> io::Result<WrittenCommand> {
    let (name, counters) = match kind.is_pass() {
        true => ("pass", &Counter::OF_PASSES[..]),
        false => ("command", &Counter::OF_LAUNCHES[..]),
    };
    let folder = format!("{name}-{number:04}");
    std::fs::create_dir_all(maps.folder.join(&folder))?;
    let mut entries = Vec::new();
    for &counter in counters {
        let (entry, bytes) = write(maps, &folder, counts, counter, &mut progress.file)?;
        entries.push(entry);
        progress.bytes += bytes;
    }
    let mut first_rays = Value::Null;
    if let Some(first) = counts.first_rays() {
        let [x, y, z] = first.kept.size;
        npy::floats(&mut progress.file, &[z, y, x], &first.lines);
        let file = format!("{folder}/first_rays.npy");
        write_whole(&maps.folder.join(&file), &progress.file)?;
        progress.bytes += progress.file.len() as u64;
        first_rays = json!({ "file": file, "step": first.kept.step, "size": first.kept.size });
    }
    let mut structures = Vec::new();
    for DescribedStructure { facts, files } in described {
        for (name, file) in files {
            write_whole(&maps.folder.join(&name), &file)?;
            progress.bytes += file.len() as u64;
        }
        structures.push(facts);
    }
    Ok(WrittenCommand {
        maps: entries,
        structures,
        first_rays,
    })
}

/// Writes one map, made in `bytes`; returns its entry in the list, and how many bytes were written.
/// One of zeros has no file.
fn write(
    maps: &Maps,
    folder: &str,
    counts: &FinishedCounts,
    counter: Counter,
    bytes: &mut Vec<u8>,
) -> io::Result<(Value, u64)> {
    let values = counts.values(counter);
    let (most, sum) = counts.most_and_sum(counter);
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
    npy::file(bytes, [z, y, x], width, values);
    let file = format!("{folder}/{name}.npy");
    write_whole(&maps.folder.join(&file), bytes)?;
    entry["file"] = file.into();
    Ok((entry, bytes.len() as u64))
}

/// Writes a file that is whole once it has its name.
fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let partial = path.with_extension("part");
    let written = std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        // A full disk has room for something else again.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

/// Counts of each ray or pixel by itself.
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
        Counter::Primitives => ("primitives", ALONE),
        Counter::FailedTests => ("failed_tests", ALONE),
        Counter::FragmentShaders => ("fragment_shaders", ALONE),
    }
}
