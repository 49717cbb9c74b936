//! Observers of a command: of the rays of one invocation and of the records that all rays look up,
//! or of counts of all invocations. Schedulers call an observer where there is one; without, they
//! do not take those paths.

use spirv_jit::origin::CodeLocation;
use traversal::{Hit, Ray};

use super::launch_counts::LaunchCounts;
use super::table::ProgramIndex;

/// An observer of one command. Its calls about one invocation come in the invocation's order, from
/// one thread.
pub trait Observer: Send + Sync {
    /// The invocation whose events are observed: launch index, or global invocation index.
    fn invocation(&self) -> Option<[u32; 3]>;

    /// Something happens to the invocation, its rays or the shaders that they call.
    fn observe(&self, event: Observation);

    /// Rays of any invocations look up a record of a table.
    fn look_up(&self, table: TableKind, index: u32, purpose: LookupPurpose, rays: u32);

    /// Counts of all invocations, where they are kept.
    fn counts(&self) -> Option<&LaunchCounts>;
}

/// A region of a binding table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TableKind {
    RayGeneration,
    Miss,
    Hit,
    Callable,
}

/// The reason for which a record is looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LookupPurpose {
    /// For the shader that decides on a candidate.
    Candidate,
    /// For the shader at the end of a ray, or for a callable; rays that skip the closest-hit shader
    /// count, too.
    Call,
}

/// The instruction that a ray comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instruction {
    TraceRay,
    /// Fills a hit object.
    HitObjectTrace,
    /// Calls the shader of a hit object; nothing is traversed.
    HitObjectExecute,
    /// A ray query, by the place of its object.
    RayQuery(u32),
}

/// Operands that choose records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableOperands {
    pub offset: u32,
    pub stride: u32,
    pub miss_index: u32,
}

/// A ray that begins.
#[derive(Clone, Debug)]
pub struct RayStart {
    pub instruction: Instruction,
    /// The shader that traces it.
    pub place: CodeLocation,
    /// As given.
    pub ray: Ray,
    /// Flags that the pipeline adds.
    pub pipeline_flags: u32,
    pub time: f32,
    /// The address of the top level.
    pub structure: u64,
    /// None of ray queries and executed hit objects.
    pub operands: Option<TableOperands>,
    /// Words.
    pub payload: Vec<u32>,
}

/// A hit that an intersection shader reports.
#[derive(Clone, Debug)]
pub struct Reported {
    pub t: f32,
    pub hit_kind: u8,
    /// Words.
    pub attributes: Vec<u32>,
    pub verdict: ReportVerdict,
}

/// The answer to a report, before an any-hit shader has run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportVerdict {
    OutsideInterval,
    Committed,
    /// The any-hit shader is asked.
    Asked,
}

/// The decision of a shader on the candidate of a ray query, before it proceeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum QueryDecision {
    /// Nothing: the candidate is ignored.
    Ignored,
    Confirmed,
    /// An intersection at this distance; whether it counts.
    Generated(f32, bool),
}

/// An event of an invocation. What it belongs to follows from the order: a ray ends when its last
/// shader has.
#[derive(Clone, Debug)]
pub enum Observation {
    Ray(Box<RayStart>),
    /// Traversal has stopped at a candidate; the shader of its record decides, if there is one.
    Candidate {
        hit: Hit,
        record: u32,
        shader: Option<ProgramIndex>,
    },
    Report(Box<Reported>),
    /// Traversal is over.
    Settled {
        hit: Option<Hit>,
        /// Words, of hits that an intersection shader reported.
        attributes: Vec<u32>,
        /// Index of the hit or miss record.
        record: u32,
        /// The closest-hit or miss shader that runs now.
        shader: Option<ProgramIndex>,
    },
    /// A callable is called.
    Callable {
        index: u32,
        shader: Option<ProgramIndex>,
    },
    /// A called shader begins. Data are the words of its payload or callable data.
    Begin {
        program: ProgramIndex,
        /// Address of its record.
        record: u64,
        data: Vec<u32>,
    },
    /// The shader that began last and has not ended yet ends. `decision` is that of an any-hit
    /// shader: 0 accepts, 1 ignores, others accept and end the ray.
    End {
        data: Vec<u32>,
        decision: u32,
    },
    /// A ray query stands at a candidate.
    QueryCandidate {
        object: u32,
        hit: Hit,
    },
    QueryDecision {
        object: u32,
        decision: QueryDecision,
    },
    /// A ray query has found all that it will find.
    QueryOver {
        object: u32,
        hit: Option<Hit>,
    },
}
