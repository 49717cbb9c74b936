//! Captures. `TUFF_CAPTURE_PIXEL` writes the path of one invocation of each command that traces:
//! its rays, the primitives on their lines, their shaders, and the binding table, as text and JSON.
//! `TUFF_CAPTURE` alone writes [maps], which count the work of all invocations.
//!
//! A [`Recording`] observes one command and writes when it is complete. Without the settings a
//! command costs one comparison, and its rays nothing. What is on a ray's line is looked up after
//! the command, in the structures as they are then: no command changes them while it traces.

mod binding_table;
mod gltf;
mod json;
mod maps;
mod meeting;
mod npy;
mod output;
mod path;
mod recorder;
mod structures;
mod text;

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use spirv_jit::Program;
use spirv_jit::program::SiteKind;
use traversal::{Live, Ray, RayReport, ray_flags};

use crate::settings::{CaptureSettings, settings};
use crate::wave::binding_table::{self as binding, Shaders, Tables};
use crate::wave::observer::{Observer, TableKind};
use binding_table::ReadRegion;
use maps::{CommandKind, MapRecording};
use meeting::{Meetings, meetings};
use output::Output;
use path::Path;
use recorder::Recorder;
use structures::KnownStructures;
pub use structures::{note_build, note_copy, start_build};

/// Commands that are captured, at most.
const MAX_COMMANDS: u64 = 64;
/// Bytes of text and JSON after which no command is captured any more.
const MAX_BYTES: usize = 64 << 20;
/// Primitives on a ray's line that are looked at, at most.
const MAX_MET: usize = 4096;

static CAPTURE: OnceLock<Option<Capture>> = OnceLock::new();
/// Presents so far.
static FRAME: AtomicU64 = AtomicU64::new(0);

/// The captures of a pixel.
struct Capture {
    invocation: [u32; 3],
    process: u32,
    state: Mutex<CaptureProgress>,
}

struct CaptureProgress {
    output: Output,
    /// Commands that trace, within the wanted frames.
    commands: u64,
    captured: u64,
    dropped: u64,
    /// That a command is too small for the pixel is said once.
    told_outside: bool,
}

/// A frame ends: images are presented.
pub fn end_frame() {
    FRAME.fetch_add(1, Ordering::Relaxed);
}

/// The capture of a pixel, if the settings ask for one.
fn capture() -> Option<&'static Capture> {
    let settings = settings().capture?;
    let invocation = settings.invocation?;
    let made = || {
        Some(Capture {
            invocation,
            process: std::process::id(),
            state: Mutex::new(CaptureProgress {
                output: Output::new(&settings, invocation),
                commands: 0,
                captured: 0,
                dropped: 0,
                told_outside: false,
            }),
        })
    };
    // A fork has a copy of this, and the same files.
    (CAPTURE.get_or_init(made).as_ref()).filter(|capture| capture.process == std::process::id())
}

/// A command that is being captured.
pub enum Recording {
    Pixel(PixelRecording),
    Maps(MapRecording),
}

/// A command of which one invocation is captured.
pub struct PixelRecording {
    recorder: Recorder,
    number: u64,
    frame: u64,
    what: &'static str,
    extent: [u32; 3],
}

/// A captured command.
pub struct CapturedCommand<'a> {
    number: u64,
    frame: u64,
    what: &'static str,
    extent: [u32; 3],
    invocation: [u32; 3],
    programs: Vec<&'a Program>,
    shaders: Option<&'a Shaders>,
    path: Path,
    /// By ray.
    meetings: Vec<Meetings>,
    table: Option<Vec<ReadRegion>>,
    stopped: bool,
}

/// The binding table of a trace.
pub struct Traced<'a> {
    pub shaders: &'a Shaders,
    pub given: &'a Tables,
    pub live: &'a Tables<binding::Live>,
}

/// Begins to record a trace of so many invocations, if it is to be captured.
pub fn trace(shaders: &Shaders, extent: [u32; 3]) -> Option<Recording> {
    let settings = settings().capture?;
    let programs = shaders.programs.iter().map(|program| &**program);
    begin(&settings, CommandKind::Trace, [0; 3], extent, programs)
}

/// Begins to record a dispatch of workgroups, if it is to be captured: if its shader has ray
/// queries.
pub fn dispatch(program: &Program, base: [u32; 3], count: [u32; 3]) -> Option<Recording> {
    let settings = settings().capture?;
    if !program.sites().contains(&SiteKind::RayQueryProceed) {
        return None;
    }
    let size = program.local_size();
    let invocations =
        |groups: [u32; 3]| [0, 1, 2].map(|i: usize| groups[i].saturating_mul(size[i]));
    let (first, extent) = (invocations(base), invocations(count));
    begin(
        &settings,
        CommandKind::Dispatch,
        first,
        extent,
        std::iter::once(program),
    )
}

/// Whether passes are captured.
pub fn takes_passes() -> bool {
    settings().capture.is_some_and(|it| it.invocation.is_none())
}

/// Begins to record a pass that draws to some pixels and layers, if it is to be captured.
pub fn pass(first: [u32; 3], extent: [u32; 3]) -> Option<Recording> {
    let settings = settings().capture.filter(|_| takes_passes())?;
    begin(
        &settings,
        CommandKind::Pass,
        first,
        extent,
        std::iter::empty(),
    )
}

fn begin<'a>(
    settings: &CaptureSettings,
    kind: CommandKind,
    first: [u32; 3],
    extent: [u32; 3],
    programs: impl Iterator<Item = &'a Program>,
) -> Option<Recording> {
    let frame = FRAME.load(Ordering::Relaxed);
    let is_wanted = settings.frames().contains(&frame);
    // The files are made even if no command is written to them.
    match settings.invocation {
        Some(_) => {
            let capture = capture()?;
            is_wanted.then(|| capture.begin(frame, kind.name(), first, extent, programs))?
        }
        None => {
            let maps = maps::maps(settings)?;
            is_wanted.then(|| maps.begin(frame, kind, first, extent))?
        }
    }
}

impl Capture {
    fn begin<'a>(
        &self,
        frame: u64,
        what: &'static str,
        first: [u32; 3],
        extent: [u32; 3],
        programs: impl Iterator<Item = &'a Program>,
    ) -> Option<Recording> {
        let state = &mut *self.state.lock();
        if !state.output.is_open() {
            return None;
        }
        let invocation = self.invocation;
        let is_inside = (0..3).all(|axis| {
            let place = invocation[axis].checked_sub(first[axis]);
            place.is_some_and(|place| place < extent[axis])
        });
        if !is_inside {
            if !std::mem::replace(&mut state.told_outside, true) {
                let ([x, y, z], [w, h, d]) = (invocation, extent);
                state.output.say(&format!(
                    "invocation ({x}, {y}, {z}) is outside of a {what} of {w} x {h} x {d}"
                ));
            }
            return None;
        }
        let number = state.commands;
        state.commands += 1;
        if state.captured == MAX_COMMANDS || state.output.bytes() > MAX_BYTES {
            state.dropped += 1;
            state.output.drop_command(state.dropped, state.captured);
            return None;
        }
        state.captured += 1;
        let stages = programs.map(|program| program.stage()).collect();
        Some(Recording::Pixel(PixelRecording {
            recorder: Recorder::new(invocation, stages),
            number,
            frame,
            what,
            extent,
        }))
    }
}

impl Recording {
    /// The observer for the command.
    pub fn observer(&self) -> &dyn Observer {
        match self {
            Self::Pixel(recording) => &recording.recorder,
            Self::Maps(recording) => recording,
        }
    }

    /// Writes what was seen of a command that is complete, or `stopped`. Structures lie in `live`.
    ///
    /// # Safety
    /// The structures that the command's rays name are still there.
    pub unsafe fn finish<'a>(
        self,
        programs: impl Iterator<Item = &'a Program>,
        traced: Option<Traced<'a>>,
        live: &Live,
        stopped: bool,
    ) {
        match self {
            // SAFETY: the caller keeps the structures of the command's rays.
            Self::Pixel(recording) => unsafe { recording.finish(programs, traced, live, stopped) },
            Self::Maps(recording) => {
                // SAFETY: the caller keeps the structures of the command's rays.
                let describe =
                    |known: &mut KnownStructures, at| unsafe { known.describe(at, live) };
                maps::finish(recording, programs, describe, stopped);
            }
        }
    }
}

impl PixelRecording {
    /// # Safety
    /// As for [`Recording::finish`].
    unsafe fn finish<'a>(
        self,
        programs: impl Iterator<Item = &'a Program>,
        traced: Option<Traced<'a>>,
        live: &Live,
        stopped: bool,
    ) {
        let Some(capture) = capture() else {
            return;
        };
        let invocation = self.recorder.observed();
        let (path, lookups) = self.recorder.finish();
        let mut walker = settings().walker();
        let reports = path.rays.iter().map(|ray| {
            if !ray.is_traversed() {
                return Meetings::default();
            }
            let start = &ray.start;
            let line = Ray {
                flags: start.ray.flags | start.pipeline_flags,
                ..start.ray
            };
            let (at, time) = (start.structure, start.time);
            // SAFETY: the caller keeps the structures of the command's rays.
            let report = unsafe { RayReport::new(&mut walker, at, &line, time, live, MAX_MET) };
            meetings(ray, report)
        });
        let meetings = reports.collect();
        let launched = self.extent.into_iter().map(u64::from).product();
        let captured = CapturedCommand {
            number: self.number,
            frame: self.frame,
            what: self.what,
            extent: self.extent,
            invocation,
            programs: programs.collect(),
            shaders: traced.as_ref().map(|traced| traced.shaders),
            path,
            meetings,
            table: (traced.as_ref()).map(|traced| {
                let Traced {
                    shaders,
                    given,
                    live,
                } = traced;
                binding_table::read(given, live, shaders, &lookups, launched)
            }),
            stopped,
        };
        let (text, json) = (text::command(&captured), json::command(&captured));
        capture.state.lock().output.write(&text, &json);
    }
}

/// The name of a region, as in JSON.
fn kind_name(kind: TableKind) -> &'static str {
    match kind {
        TableKind::RayGeneration => "ray_generation",
        TableKind::Miss => "miss",
        TableKind::Hit => "hit",
        TableKind::Callable => "callable",
    }
}

/// SPIR-V's names of ray flags.
const FLAGS: [(u32, &str); 11] = [
    (ray_flags::OPAQUE, "OpaqueKHR"),
    (ray_flags::NO_OPAQUE, "NoOpaqueKHR"),
    (ray_flags::TERMINATE_ON_FIRST_HIT, "TerminateOnFirstHitKHR"),
    (
        ray_flags::SKIP_CLOSEST_HIT_SHADER,
        "SkipClosestHitShaderKHR",
    ),
    (
        ray_flags::CULL_BACK_FACING_TRIANGLES,
        "CullBackFacingTrianglesKHR",
    ),
    (
        ray_flags::CULL_FRONT_FACING_TRIANGLES,
        "CullFrontFacingTrianglesKHR",
    ),
    (ray_flags::CULL_OPAQUE, "CullOpaqueKHR"),
    (ray_flags::CULL_NO_OPAQUE, "CullNoOpaqueKHR"),
    (ray_flags::SKIP_TRIANGLES, "SkipTrianglesKHR"),
    (ray_flags::SKIP_AABBS, "SkipAABBsKHR"),
    (
        ray_flags::FORCE_OPACITY_MICROMAP_2_STATE,
        "ForceOpacityMicromap2StateEXT",
    ),
];

/// The names of the ray flags that are set.
fn flags(flags: u32) -> Vec<&'static str> {
    let set = FLAGS.iter().filter(|(bit, _)| flags & bit != 0);
    set.map(|(_, name)| *name).collect()
}
