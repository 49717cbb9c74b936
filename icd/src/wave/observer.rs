//! Observers of a command: validation, statistics, captures, and the list of invalid addresses.
//! Schedulers call an observer where there is one; without, they do not take those paths.

use spirv_jit::Program;
use spirv_jit::origin::CodeLocation;
use spirv_jit::reach::Stray;
use traversal::{Hit, Kind, Ray};

use super::binding_table::{Group, Handle, ProgramIndex, Region};
use super::launch_counts::LaunchCounts;

/// An observer of a command. Each takes some events and leaves out the others.
pub trait Observer: Send + Sync {
    /// Events of all invocations that are prepared for it.
    fn interests(&self) -> Interests {
        Interests::default()
    }

    /// The invocation whose events are observed: launch index, or global invocation index.
    fn invocation(&self) -> Option<[u32; 3]> {
        None
    }

    /// Something happens to that invocation, its rays or the shaders that they call. Calls come in
    /// the invocation's order, from one thread.
    fn observe(&self, _: Observation) {}

    /// Counts of all invocations, where they are kept.
    fn counts(&self) -> Option<&LaunchCounts> {
        None
    }

    /// A ray starts ([`Interests::rays`]).
    fn ray(&self, _: &StartedRay) {}

    /// An intersection shader reports a hit kind ([`Interests::rays`]). `place` is the number of
    /// its program.
    fn hit_kind(&self, _place: u64, _kind: u32) {}

    /// A shader is about to be called ([`Interests::rays`]).
    fn call(&self, _: &ShaderCall) {}

    /// Rays look up a record of a table ([`Interests::lookups`]).
    fn look_up(&self, _: &RecordLookup<'_>) {}

    /// A wave of a ray tracing pipeline is about to run ([`Interests::waves`]).
    fn wave(&self, _: &StartedWave) {}

    /// The command is complete, and these accesses of its programs went wrong.
    fn strays(&self, _: &[Stray], _: &[&Program]) {}

    /// Whether it takes events of rays: schedulers then do without lines. Counts are none.
    fn watches_rays(&self) -> bool {
        let Interests { rays, lookups, .. } = self.interests();
        rays || lookups || self.invocation().is_some()
    }
}

/// Kinds of events of all invocations. What no observer takes is not prepared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interests {
    /// Rays, reported hit kinds and calls of shaders.
    pub rays: bool,
    /// Records that rays look up.
    pub lookups: bool,
    /// Waves of ray tracing pipelines.
    pub waves: bool,
}

/// A ray that a shader starts.
#[derive(Clone, Copy, Debug)]
pub struct StartedRay {
    pub instruction: Instruction,
    /// The instruction has a time.
    pub has_time: bool,
    /// The number of the shader's program.
    pub place: u64,
    /// As given.
    pub ray: Ray,
    pub time: f32,
    /// The address of a structure, as given.
    pub structure: u64,
    /// The kind of the structure there.
    pub kind: Option<Kind>,
}

/// A call of a shader.
#[derive(Clone, Copy, Debug)]
pub struct ShaderCall {
    /// The number of its program.
    pub place: u64,
    /// Depth of recursion.
    pub depth: u32,
    /// Stack of it and of its callers.
    pub stack_bytes: u64,
}

/// A wave that is about to run.
#[derive(Clone, Copy, Debug)]
pub struct StartedWave {
    pub program: ProgramIndex,
    pub subgroups: u32,
    /// Active lanes.
    pub lanes: u32,
}

/// A record that rays look up.
pub struct RecordLookup<'a> {
    pub purpose: LookupPurpose,
    pub region: &'a Region,
    pub index: u32,
    /// The record's handle, if the index is in the region, and the group that it names.
    pub record: Option<(Handle, Option<&'a Group>)>,
    /// Whether a hit is on a box. Spheres count as triangles.
    pub is_box: bool,
    /// How many rays do so at once.
    pub rays: u32,
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
    /// For the shader that decides on a triangle or a round primitive.
    AnyHit,
    /// For the shader that looks for hits in a box.
    Intersection,
    /// For the shader that decides on a hit that an intersection shader has reported.
    AnyHitOfReport,
    ClosestHit,
    /// The ray skips its closest-hit shader.
    SkippedClosestHit,
    Miss,
    Callable,
}

impl LookupPurpose {
    /// The region of the record.
    pub fn table(self) -> TableKind {
        match self {
            Self::Miss => TableKind::Miss,
            Self::Callable => TableKind::Callable,
            _ => TableKind::Hit,
        }
    }
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
