//! The timeline (`TUFF_TRACE`): the driver's activities by time and thread, in Chrome's trace event
//! format, which Perfetto opens.
//!
//! A [`Span`] becomes one event (`X`) when it is dropped. Spans of a thread nest, since they are
//! dropped in the reverse of their order; each thread has a track of its own. Without a timeline a
//! span costs one atomic load.

#![forbid(unsafe_code)]

pub mod file;

use std::cell::Cell;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use parking_lot::Mutex;
use serde_json::{Value, json};

use file::ArrayFile;

static ON: AtomicBool = AtomicBool::new(false);
static TIMELINE: OnceLock<Timeline> = OnceLock::new();

/// Largest size of buffered events.
const WAITING_BYTES: usize = 32 << 10;

struct Timeline {
    start: Instant,
    process: u32,
    written: Mutex<Written>,
    names: Mutex<HashMap<u64, Arc<str>>>,
}

struct Written {
    file: ArrayFile,
    /// Events that are not in the file yet, each after a comma.
    waiting: String,
}

/// Starts the timeline of the process. If the file cannot be created, that is reported once and
/// there is no timeline.
pub fn start(path: &str) {
    TIMELINE.get_or_init(|| {
        let process = std::process::id();
        let first = json!({
            "ph": "M", "name": "process_name", "pid": process, "tid": 0,
            "args": { "name": "Tuff" },
        });
        let subject = ("TUFF_TRACE", "the timeline");
        let file = ArrayFile::new(subject, path, &first.to_string());
        ON.store(file.is_open(), Ordering::Relaxed);
        Timeline {
            start: Instant::now(),
            process,
            written: Mutex::new(Written {
                file,
                waiting: String::new(),
            }),
            names: Mutex::default(),
        }
    });
}

/// Whether there is a timeline.
#[inline]
pub fn is_on() -> bool {
    ON.load(Ordering::Relaxed)
}

impl Timeline {
    /// Adds an event; with `now`, writes it and all events before it to the file.
    fn write(&self, event: &Value, now: bool) {
        if std::process::id() != self.process {
            // A forked child has a copy of this state and the same open file.
            return;
        }
        let written = &mut *self.written.lock();
        written.waiting += ",\n";
        written.waiting += &event.to_string();
        if now || written.waiting.len() > WAITING_BYTES {
            let kept = written.file.append(&written.waiting);
            written.waiting.clear();
            ON.store(kept, Ordering::Relaxed);
        }
    }

    /// The number of the calling thread's track. Its first call names the track.
    fn track(&self) -> u32 {
        thread_local!(static TRACK: Cell<u32> = const { Cell::new(0) });
        static TRACKS: AtomicU32 = AtomicU32::new(1);
        let track = TRACK.get();
        if track != 0 {
            return track;
        }
        let track = TRACKS.fetch_add(1, Ordering::Relaxed);
        TRACK.set(track);
        let event = json!({
            "ph": "M", "name": "thread_name", "pid": self.process, "tid": track,
            "args": { "name": thread_name(track) },
        });
        self.write(&event, false);
        track
    }

    /// Nanoseconds since the start of the timeline.
    fn nanoseconds(&self, at: Instant) -> u64 {
        at.duration_since(self.start).as_nanos() as u64
    }
}

/// The thread's name: threads of the application have one from the system.
fn thread_name(track: u32) -> String {
    let thread = std::thread::current();
    let name = (thread.name().map(str::to_owned)).or_else(crate::os::thread::name);
    match name.as_deref().map(str::trim) {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => format!("thread {track}"),
    }
}

/// The kind of work of a span, which is its category in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Submission,
    CommandBuffer,
    Label,
    Dispatch,
    Trace,
    Build,
    Pass,
    Draws,
    Present,
    Compilation,
    /// A thread's part of a command.
    Work,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Submission => "submission",
            Self::CommandBuffer => "command buffer",
            Self::Label => "label",
            Self::Dispatch => "dispatch",
            Self::Trace => "trace",
            Self::Build => "build",
            Self::Pass => "pass",
            Self::Draws => "draws",
            Self::Present => "present",
            Self::Compilation => "compilation",
            Self::Work => "work",
        }
    }

    /// The event is written at once, so that a crashing program loses at most its current
    /// submission.
    fn is_written_now(self) -> bool {
        matches!(self, Self::Submission | Self::Present | Self::Compilation)
    }
}

/// A piece of work of the calling thread, from its start until this is dropped on the same thread.
#[must_use]
pub struct Span(Option<Box<Open>>);

struct Open {
    timeline: &'static Timeline,
    kind: Kind,
    name: String,
    arguments: Value,
    begin: Instant,
}

/// Begins a span, which `describe` gives a name and arguments (an object).
#[inline]
pub fn span(kind: Kind, describe: impl FnOnce() -> (String, Value)) -> Span {
    if !is_on() {
        return Span(None);
    }
    Span::open(kind, describe)
}

/// Begins a thread's part of a command.
#[inline]
pub fn work(name: &'static str) -> Span {
    span(Kind::Work, || (name.into(), json!({})))
}

impl Span {
    #[cold]
    fn open(kind: Kind, describe: impl FnOnce() -> (String, Value)) -> Span {
        let (name, arguments) = describe();
        Span(TIMELINE.get().map(|timeline| {
            Box::new(Open {
                timeline,
                kind,
                name,
                arguments,
                begin: Instant::now(),
            })
        }))
    }

    #[cold]
    fn close(open: &Open) {
        let timeline = open.timeline;
        let begin = timeline.nanoseconds(open.begin);
        let duration = timeline.nanoseconds(Instant::now()) - begin;
        let microseconds = |nanoseconds: u64| nanoseconds as f64 / 1e3;
        let event = json!({
            "ph": "X",
            "name": open.name,
            "cat": open.kind.name(),
            "ts": microseconds(begin),
            "dur": microseconds(duration),
            "pid": timeline.process,
            "tid": timeline.track(),
            "args": open.arguments,
        });
        timeline.write(&event, open.kind.is_written_now());
    }
}

impl Drop for Span {
    fn drop(&mut self) {
        if let Some(open) = self.0.take() {
            Self::close(&open);
        }
    }
}

/// Spans that commands begin and end. Labels may overlap but spans must nest: the end of one ends
/// those that began inside of it, and their own ends do nothing.
#[derive(Default)]
pub struct Stack {
    open: Vec<(Kind, Span)>,
    /// Pending ends of labels and passes whose spans have ended already.
    ended: [u32; 2],
}

impl Stack {
    /// Begins a span.
    pub fn begin(&mut self, kind: Kind, describe: impl FnOnce() -> (String, Value)) {
        if is_on() {
            self.open.push((kind, span(kind, describe)));
        }
    }

    /// Ends the innermost span of a kind.
    pub fn end(&mut self, kind: Kind) {
        if let Some(ended) = self.ended(kind).filter(|ended| **ended > 0) {
            *ended -= 1;
            return;
        }
        if let Some(index) = self.open.iter().rposition(|(other, _)| *other == kind) {
            self.close_from(index + 1);
            drop(self.open.pop());
        }
    }

    fn ended(&mut self, kind: Kind) -> Option<&mut u32> {
        match kind {
            Kind::Label => Some(&mut self.ended[0]),
            Kind::Pass => Some(&mut self.ended[1]),
            _ => None,
        }
    }

    /// The number of open spans, for [`Self::close_from`].
    pub fn depth(&self) -> usize {
        self.open.len()
    }

    /// Ends all spans except the outer ones.
    pub fn close_from(&mut self, depth: usize) {
        while self.open.len() > depth {
            if let Some((kind, span)) = self.open.pop() {
                if let Some(ended) = self.ended(kind) {
                    *ended += 1;
                }
                drop(span);
            }
        }
    }
}

impl Drop for Stack {
    fn drop(&mut self) {
        self.close_from(0);
    }
}

/// Records the name of an object by its handle (`vkSetDebugUtilsObjectNameEXT`).
pub fn name_object(handle: u64, name: &str) {
    if let Some(timeline) = TIMELINE.get().filter(|_| is_on()) {
        let mut names = timeline.names.lock();
        match name.is_empty() {
            true => names.remove(&handle),
            false => names.insert(handle, name.into()),
        };
    }
}

/// The name of an object.
pub fn object_name(handle: u64) -> Option<Arc<str>> {
    let timeline = TIMELINE.get()?;
    timeline.names.lock().get(&handle).cloned()
}
