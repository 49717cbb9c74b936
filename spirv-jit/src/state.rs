//! Subgroups that run: their states, why a run comes back, and what a yield asks for.
//!
//! A *subgroup state* is one contiguous, 64-byte-aligned block of rows, each row 16 lanes of one
//! 32-bit word:
//!
//! ```text
//! [ control | inputs | io | emitted vertices | private memory | live values ]
//!                      io: operands and results of a yield, or outputs
//! ```
//!
//! The scheduler owns the block, fills `inputs`, calls [`Program::start`](crate::Program::start),
//! then [`Program::run`](crate::Program::run) with one or more subgroups that stand at the same
//! [`ResumePoint`]. At a yield it reads operands from the `io` rows and writes results over them;
//! at the end it reads outputs there. It uses no other rows of the block, and other crates do not
//! depend on the tier.

use lanes::AlignedRow;

use crate::environment::Environment;
use crate::facts::Fact;
use crate::types::Trace;

/// Where subgroups go on: subgroups of one program at equal points may run in one wave.
/// The default is the entry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ResumePoint(pub u32);

/// The event of a subgroup's run. Lanes that take part in the event are those of
/// [`Program::event_mask`](crate::Program::event_mask).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// All lanes have ended; outputs stand in the `io` rows.
    End,
    /// Suspended at a yield.
    Yield(SiteId),
    /// Fuel ran out at a loop back-edge: run again to go on.
    OutOfFuel,
}

/// A yield in the program text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SiteId(pub u32);

/// The request of a yield. Rows count from the start of the `io` rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SiteKind {
    /// Rows 0..15: the ray (see `Op::TraceRay`); row 15: its time, if it has one; rows 16..16+n:
    /// payload, in and out. To a hit object, up to the hit or miss: rows 0..16 of the answer are
    /// the words that [`TRACED`](crate::hit_object::TRACED) lists.
    TraceRay { trace: Trace, payload_words: u32 },
    /// Row 0: t; row 1: hit kind; rows 16..16+n: attribute. The verdict goes to row 0: 0 rejected,
    /// 1 accepted, 2 accepted and the search is over: the invocation ends here instead of going on
    /// (as after `OpTerminateRayKHR` in its any-hit shader).
    ReportIntersection { attribute_words: u32 },
    /// Row 0: callable index; rows 16..16+n: data, in and out.
    ExecuteCallable { data_words: u32 },
    /// Rows 0..16: the first words of the hit object; rows 16..16+n: payload, in and out; then the
    /// hit object's other words.
    HitObjectExecute { payload_words: u32 },
    /// Rows 0..9: the words that [`IDENTITY`](crate::hit_object::IDENTITY) lists; the answer goes
    /// to the rows from 0 on.
    HitObjectGet { fact: Fact },
    /// Row 0: hint; row 1: its bits; row 2: kind of the hit object, or all ones without one; row 3:
    /// its record index.
    ReorderThread,
    /// Workgroup barrier. Not an event if the wave is whole ([`Wave::is_whole`]) and all its
    /// subgroups arrive at it.
    Barrier,
    /// The first half of a split barrier: the subgroup has come, and goes on. No event where the
    /// wave is whole, as above.
    BarrierArrive,
    /// The second half: the subgroup waits until each one of its workgroup has come as often as it
    /// has, or has ended. No event where the wave is whole, as above.
    BarrierWait,
    /// Row 0: the first private row of a ray query's object ([`crate::query`]), which is read and
    /// rewritten there; then, over it, 1 if the query stands at a candidate, or 0. The lanes'
    /// memory is [`Program::private_rows`](crate::Program::private_rows).
    RayQueryProceed,
}

/// First `io` row of payload, attribute and callable data at every site.
pub const IO_DATA_ROW: usize = 16;

/// Sizes, in rows of 16 × 32 bits, of the parts of a subgroup's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct StateLayout {
    /// First input row.
    pub inputs: usize,
    /// First `io` row.
    pub io: usize,
    /// Total.
    pub rows: usize,
}

/// A wave to run: the states of its subgroups, and what their workgroups share.
pub struct Wave<'a> {
    /// Each has [`StateLayout::rows`] rows. At most
    /// [`Program::max_wave_subgroups`](crate::Program::max_wave_subgroups).
    pub states: &'a mut [&'a mut [AlignedRow]],
    /// Compute: the first byte of each subgroup's workgroup memory; subgroups of one workgroup have
    /// the same. Empty for programs without workgroup memory.
    pub shared: &'a [*mut u8],
    /// Compute: for each workgroup with a subgroup in the wave, all live subgroups are in the wave,
    /// and have arrived at split barriers equally often. Barriers that all of them come to are no
    /// events then: the wave goes on in place.
    pub is_whole: bool,
    /// Rows that take the outputs of each subgroup's lanes, as many as the program has outputs,
    /// instead of its `io` rows; subgroups with different lanes may share rows. Null: its `io`
    /// rows. Empty: those of each subgroup.
    pub outputs_to: &'a [*mut AlignedRow],
    pub environment: &'a Environment,
}
