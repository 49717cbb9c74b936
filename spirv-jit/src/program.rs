//! Compiled shaders, and how they are run: the seam between the compiler and the scheduler.

use std::collections::TryReserveError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use lanes::{LaneMask, Tier};

use crate::SUBGROUP_SIZE;
use crate::error::Error;
use crate::interp;
use crate::ir::modulate::{Modulated, modulated};
use crate::ir::workgroups::{looks_at_lanes, may_share_subgroups, may_wait_for_workgroups};
use crate::ir::{self, pass_through::pass_through};
use crate::native;
use crate::origin::{CodeLocation, Origin, line_at};
use crate::plan::{self, Plan};
use crate::printf::Record;
use crate::query::QueryWord;

pub use crate::interp::{Frame, MAX_SUBGROUPS};
pub use crate::ir::interface::{
    Barycentric, DepthMode, Emits, FragmentFacts, GeometryFacts, Interlock, OutputRow, Position,
    Varying, VaryingMode, VaryingPlace,
};
pub use crate::ir::mesh::MeshFacts;
pub use crate::ir::module::InputRow;
pub use crate::ir::pass_through::PassThrough;
pub use crate::ir::stage::{Builtin, Stage};
pub use crate::ir::tessellation::{
    ControlFacts, Domain, MAX_PATCH_VERTICES, PatchWord, Spacing, TessellationFacts,
    TessellationModes, Width,
};
pub use crate::ir::transform_feedback::{
    FeedbackBuffer, FeedbackFacts, FeedbackWidth, FeedbackWord, MAX_FEEDBACK_BUFFERS, MAX_STREAMS,
};
pub use crate::native::NativeCounts;
pub use crate::request::CompileRequest;
pub use crate::state::{Event, IO_DATA_ROW, ResumePoint, SiteId, SiteKind, StateLayout, Wave};
pub use crate::types::Trace;
pub use lanes::{AlignedRow, Row};

/// Compiles one entry point.
///
/// # Errors
/// See [`ErrorKind`](crate::error::ErrorKind). Never panics, whatever the words are; time and
/// memory are bounded in proportion to the module.
pub fn compile(request: &CompileRequest<'_>) -> Result<Arc<Program>, Error> {
    Program::new(&compile_module(request)?).map(Arc::new)
}

/// Compiles one entry point by the steps of [`compile`] that do not depend on the machine. Caches
/// store the result.
///
/// # Errors
/// As [`compile`].
pub fn compile_module(request: &CompileRequest<'_>) -> Result<ir::Module, Error> {
    let parsed = crate::parse::parse(request.words)?;
    let mut module = crate::lower::lower_module(&parsed, request)?;
    crate::pass::optimize(&mut module)?;
    Ok(module)
}

/// A program from the bytes of an optimised module ([`ir::binary::encode`]).
///
/// # Errors
/// Bytes that are no valid module. Never panics.
pub fn from_bytes(bytes: &[u8]) -> Result<Arc<Program>, Error> {
    let module = ir::binary::decode(bytes).map_err(Error::not_a_module)?;
    ir::verify(&module).map_err(Error::not_a_module)?;
    Program::new(&module).map(Arc::new)
}

/// A compiled shader: the data for all tiers, and the interpreter's code. Immutable and shared
/// between threads.
pub struct Program {
    /// Differs from every other program's in the process, and is not 0.
    number: u64,
    plan: Plan,
    code: interp::Code,
    stage: Stage,
    inputs: Vec<InputRow>,
    query_words: Vec<QueryWord>,
    local_size: [u32; 3],
    quads: bool,
    shared_size_bytes: u32,
    workgroups_may_share_subgroups: bool,
    workgroups_may_wait: bool,
    output_rows: u32,
    outputs: Vec<OutputRow>,
    pass_through: Option<Vec<PassThrough>>,
    modulated: Option<Modulated>,
    looks_at_lanes: bool,
    tessellation: Option<TessellationFacts>,
    geometry: Option<GeometryFacts>,
    mesh: Option<MeshFacts>,
    feedback: Option<FeedbackFacts>,
    fragment: Option<FragmentFacts>,
    origin: OnceLock<Origin>,
}

impl Program {
    /// Compiles a verified, optimised module.
    ///
    /// # Errors
    /// Budget; operations on types that have none.
    pub fn new(module: &ir::Module) -> Result<Program, Error> {
        Self::with_tier(module, Tier::best())
    }

    /// As [`Self::new`], for a tier that is not the best: for tests and measurements. The tier is
    /// one that the machine has.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_tier(module: &ir::Module, tier: Tier) -> Result<Program, Error> {
        Self::emitted(module, tier, native::encoding(tier))
    }

    /// As [`Self::with_tier`], without native code.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_tier_interpreted(module: &ir::Module, tier: Tier) -> Result<Program, Error> {
        Self::emitted(module, tier, None)
    }

    fn emitted(
        module: &ir::Module,
        tier: Tier,
        native: Option<native::Encoding>,
    ) -> Result<Program, Error> {
        assert!(Tier::available().contains(&tier), "not on this machine");
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let mut grouped;
        let mut module = module;
        if let Some(encoding) = native {
            grouped = module.clone();
            native::group(&mut grouped, encoding);
            module = &grouped;
        }
        let planned = plan::plan(module)?;
        Ok(Program {
            number: NUMBER.fetch_add(1, Ordering::Relaxed),
            code: interp::emit(&planned, tier, native)?,
            plan: planned.plan,
            stage: module.stage,
            inputs: module.inputs.clone(),
            query_words: module.query_words.clone(),
            local_size: module.local_size,
            quads: module.quads,
            shared_size_bytes: module.shared_size_bytes,
            workgroups_may_share_subgroups: may_share_subgroups(module),
            workgroups_may_wait: may_wait_for_workgroups(module),
            output_rows: module.output_rows,
            outputs: match &module.mesh {
                Some(facts) => facts.rows(),
                None => module.outputs.clone(),
            },
            pass_through: pass_through(module),
            modulated: modulated(module),
            looks_at_lanes: looks_at_lanes(module),
            tessellation: module.tessellation.clone(),
            geometry: module.geometry,
            mesh: module.mesh.clone(),
            feedback: module.feedback.clone(),
            fragment: module.fragment,
            origin: OnceLock::new(),
        })
    }

    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Input rows the program reads, in order; row `i` of the state's inputs is `inputs()[i]`.
    #[inline]
    pub fn inputs(&self) -> &[InputRow] {
        &self.inputs
    }

    /// Compute, task and mesh: the workgroup's size per dimension.
    pub fn local_size(&self) -> [u32; 3] {
        self.local_size
    }

    /// Compute, task and mesh: four consecutive lanes are two by two invocations of the workgroup,
    /// instead of four in a row.
    pub fn quads(&self) -> bool {
        self.quads
    }

    /// Stages with workgroups: workgroup memory in bytes.
    pub fn shared_size_bytes(&self) -> u32 {
        self.shared_size_bytes
    }

    /// Compute: subgroups may be filled with invocations of several workgroups, since none of them
    /// can tell.
    pub fn workgroups_may_share_subgroups(&self) -> bool {
        self.workgroups_may_share_subgroups
    }

    /// Compute: a workgroup may wait in a loop for what another one does.
    pub fn workgroups_may_wait(&self) -> bool {
        self.workgroups_may_wait
    }

    /// Rows of a subgroup's state.
    #[inline]
    pub fn layout(&self) -> StateLayout {
        self.plan.layout
    }

    /// Subgroups that one run may take (wave length / 16).
    pub fn max_wave_subgroups(&self) -> usize {
        self.code.max_wave_subgroups()
    }

    /// Bytes of rows that a [`Frame`] needs to run a wave of that many subgroups.
    pub fn frame_bytes(&self, subgroups: usize) -> usize {
        self.code.frame_bytes(subgroups)
    }

    /// The requests of yields, by `SiteId`.
    #[inline]
    pub fn sites(&self) -> &[SiteKind] {
        &self.plan.sites
    }

    /// The contents of its ray query objects after their fixed rows.
    pub fn query_words(&self) -> &[QueryWord] {
        &self.query_words
    }

    /// The per-lane memory of a state.
    ///
    /// # Panics
    /// The state is smaller than [`StateLayout::rows`].
    pub fn private_rows<'s>(&self, state: &'s mut [AlignedRow]) -> &'s mut [AlignedRow] {
        &mut state[self.plan.private..self.plan.private + self.plan.private_rows]
    }

    /// Words the program leaves in the `io` rows at its end (see `ir::Module::output_rows`).
    #[inline]
    pub fn output_rows(&self) -> u32 {
        self.output_rows
    }

    /// Vertex, evaluation and fragment: what each word is that the program leaves. Geometry: what
    /// each word of an emitted vertex is. Mesh: see [`MeshFacts::rows`].
    #[inline]
    pub fn outputs(&self) -> &[OutputRow] {
        &self.outputs
    }

    /// Vertex and fragment: where each of those words comes from, if the program computes none of
    /// them.
    #[inline]
    pub fn pass_through(&self) -> Option<&[PassThrough]> {
        self.pass_through.as_deref()
    }

    /// Tessellation: what the rasterizer must know.
    #[inline]
    pub fn tessellation(&self) -> Option<&TessellationFacts> {
        self.tessellation.as_ref()
    }

    /// Geometry: what the rasterizer must know. The one word that an invocation leaves is the
    /// number of vertices that it emitted.
    #[inline]
    pub fn geometry(&self) -> Option<&GeometryFacts> {
        self.geometry.as_ref()
    }

    /// Task and mesh: what the rasterizer must know, and where it finds what workgroups leave.
    #[inline]
    pub fn mesh(&self) -> Option<&MeshFacts> {
        self.mesh.as_ref()
    }

    /// Vertex, tessellation evaluation and geometry: the outputs for transform feedback.
    #[inline]
    pub fn transform_feedback(&self) -> Option<&FeedbackFacts> {
        self.feedback.as_ref()
    }

    /// Geometry: a word of the vertices that the invocations of an ended state emitted, a row a
    /// vertex. Word 0 is 1 where a strip starts, plus twice the number of the vertex's stream. The
    /// others are [`Self::outputs`].
    ///
    /// # Panics
    /// The state is smaller than [`StateLayout::rows`], or there is no such word.
    pub fn emitted_rows<'s>(&self, state: &'s [AlignedRow], word: usize) -> &'s [AlignedRow] {
        let slots = self.plan.emitted_slots;
        &state[self.plan.emitted + word * slots..][..slots]
    }

    /// Fragment: what it does, if it samples one image and does little else.
    #[inline]
    pub fn modulated(&self) -> Option<&Modulated> {
        self.modulated.as_ref()
    }

    /// Whether lanes look at others of their quad or subgroup.
    #[inline]
    pub fn looks_at_lanes(&self) -> bool {
        self.looks_at_lanes
    }

    /// Fragment: what the rasterizer must know.
    #[inline]
    pub fn fragment(&self) -> Option<&FragmentFacts> {
        self.fragment.as_ref()
    }

    /// Bytes of one lane's state: what `vkGetRayTracingShaderGroupStackSizeKHR` reports.
    pub fn stack_size_bytes(&self) -> u32 {
        ((self.plan.private_rows + self.plan.live_rows) * 4) as u32
    }

    /// Puts a state at the program's entry with these lanes active. Inputs may be filled before or
    /// after; outputs are zeroed.
    ///
    /// # Panics
    /// The state is smaller than [`StateLayout::rows`].
    pub fn start(&self, state: &mut [AlignedRow], active: LaneMask) {
        let lanes = (active, LaneMask::NONE);
        self.plan.start(self.number, state, lanes, usize::MAX);
    }

    /// As [`Self::start`], for outputs that go elsewhere ([`Wave::outputs_to`]): none are zeroed.
    ///
    /// # Panics
    /// As [`Self::start`].
    pub fn start_without_outputs(&self, state: &mut [AlignedRow], active: LaneMask) {
        self.plan
            .start(self.number, state, (active, LaneMask::NONE), 0);
    }

    /// As [`Self::start`] for a fragment program: `helpers`, some of the active lanes, are helper
    /// invocations. No output is zeroed: an invocation that ends writes all of its own, unless it
    /// has become a helper.
    ///
    /// # Panics
    /// As [`Self::start`].
    #[inline]
    pub fn start_fragments(&self, state: &mut [AlignedRow], active: LaneMask, helpers: LaneMask) {
        self.plan.start(self.number, state, (active, helpers), 0);
    }

    /// Lanes of a fragment program's ended state that are helper invocations: from the start, or
    /// since they were demoted or killed.
    #[inline]
    pub fn helpers(&self, state: &[AlignedRow]) -> LaneMask {
        LaneMask::from_bits(state[0].0[2] as u16)
    }

    /// Where a state stands.
    #[inline]
    pub fn resume_point(&self, state: &[AlignedRow]) -> ResumePoint {
        ResumePoint(state[0].0[0])
    }

    /// Lanes of a yielded state that take part in its event (may be none: such a subgroup is ready
    /// at once). Only their columns of the `io` rows are the event's: the others may hold outputs
    /// of lanes that have ended.
    #[inline]
    pub fn event_mask(&self, state: &[AlignedRow]) -> LaneMask {
        LaneMask::from_bits(state[0].0[1] as u16)
    }

    /// Whether stretches of it are native code.
    pub fn has_native_code(&self) -> bool {
        self.code.has_native_code()
    }

    /// Counts of its native code; zeros if it has none.
    pub fn native_counts(&self) -> NativeCounts {
        self.code.native_counts()
    }

    /// The instructions of its native code as text, if it has any: a heading for each stretch and
    /// loop, then a line for each instruction.
    pub fn native_text(&self) -> Option<String> {
        self.code.native_text()
    }

    /// Loops that are native code.
    #[cfg(test)]
    pub(crate) fn native_loops(&self) -> usize {
        self.code.native_loops()
    }

    /// Differs from every other program's in the process.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Says what the program was compiled from, for reports. The first word counts: who shares a
    /// program through a cache compiled the same.
    pub fn set_origin(&self, origin: Origin) {
        let _ = self.origin.set(origin);
    }

    /// The origin of the program, as far as it is known.
    pub fn origin(&self) -> Option<&Origin> {
        self.origin.get()
    }

    /// The place of a state, for a report: where it was suspended, to the line if that is known. An
    /// empty state is nowhere in particular.
    pub fn place_of(&self, state: &[AlignedRow]) -> CodeLocation {
        let source = (state.first()).map(|_| self.plan.save_point_of(state).source);
        self.place_in_source(source.unwrap_or(0))
    }

    /// The place of an access that a [`Stray`](crate::reach::Stray) of this program is of, and
    /// whether it writes.
    pub fn place_of_access(&self, site: usize) -> Option<(CodeLocation, bool)> {
        let (source, writes) = self.code.physical_access(site)?;
        Some((self.place_in_source(source), writes))
    }

    /// Whether its shader prints messages.
    #[inline]
    pub fn prints(&self) -> bool {
        !self.code.prints().is_empty()
    }

    /// A message of this program as text: the invocation, the place, and the message.
    pub fn printed(&self, record: &Record) -> Option<String> {
        let plan = self.code.prints().get(record.site as usize)?;
        let invocation = self.stage.name_invocation(&record.key[1..]);
        let place = self.place_in_source(plan.source);
        let text = plan.message.text(&record.words);
        let text = text.strip_suffix('\n').unwrap_or(&text);
        Some(format!("{invocation}, {place}: {text}"))
    }

    /// The place of the SPIR-V instruction at a word offset, or of none in particular (0).
    pub fn place_in_source(&self, source: u32) -> CodeLocation {
        let origin = self.origin();
        let words = origin.and_then(|origin| origin.words.as_ref());
        let line = words.filter(|_| source != 0);
        CodeLocation {
            stage: self.stage,
            entry_point: origin.map(|origin| origin.entry_point.clone()),
            name: origin.and_then(|origin| origin.name.text()),
            pipeline: origin.and_then(|origin| origin.pipeline.text()),
            line: line.and_then(|words| line_at(words, source)),
        }
    }

    /// The request at a state's position; `None` at the entry and where fuel ran out.
    pub fn site_of(&self, point: ResumePoint) -> Option<SiteKind> {
        let (point, _) = self.plan.point_of(point.0);
        (self.plan.points[point].site).map(|site| self.plan.sites[site.0 as usize])
    }

    /// The rows of a request that are the same in all states of a dispatch that stand at a point: a
    /// bit for each uniform operand.
    pub fn uniform_operands(&self, point: ResumePoint) -> u16 {
        let (point, _) = self.plan.point_of(point.0);
        self.code.uniform_operands(point)
    }

    /// Whether lanes of a yielded state wait in an enclosing construct for those that take part in
    /// the event.
    pub fn has_parked_lanes(&self, state: &[AlignedRow]) -> bool {
        self.plan.has_parked_lanes(state)
    }

    /// Makes up a yielded state from lanes of other states, all of which stand at one point: lane
    /// `k` is column `from[k].1` of `from[k].0`. Lanes that are not `active` may be anything; lanes
    /// that wait for others in enclosing constructs stay behind.
    ///
    /// # Panics
    /// A state is smaller than [`StateLayout::rows`].
    pub fn gather_lanes(
        &self,
        state: &mut [AlignedRow],
        active: LaneMask,
        from: &[(&[AlignedRow], usize); SUBGROUP_SIZE],
    ) {
        self.plan.gather_lanes(state, active, from);
    }

    /// Takes the lanes of a yielded state's event out of it: they go on elsewhere, those that wait
    /// for them go on without them.
    pub fn leave_parked_lanes(&self, state: &mut [AlignedRow]) {
        state[0].0[1] = 0;
    }

    /// Runs a wave of subgroups, all at one resume point, until each has an event. `fuel` is burnt
    /// at loop back-edges and calls, by the length of the code and for the whole wave.
    ///
    /// # Safety
    /// Until it returns, each of `wave.shared` points to [`Self::shared_size_bytes`] bytes, and in
    /// `wave.environment` every table has as many descriptors as it says, each of them as
    /// [`Descriptor`](crate::environment::Descriptor) has it, with memory, images and samplers that
    /// are there; `reach` holds memory that may be read and written. Other threads may write all
    /// that meanwhile, except descriptors. Each of `wave.outputs_to` that is not null points to
    /// [`Self::output_rows`] rows, of which nothing else uses the subgroup's lanes. [`Self::start`]
    /// and earlier runs of this program have written the states; the caller has added inputs and
    /// answers.
    ///
    /// # Errors
    /// The frame's memory was refused; nothing was run.
    ///
    /// # Panics
    /// The wave is empty or longer than [`Self::max_wave_subgroups`], a state is too small or
    /// stands elsewhere, or a subgroup has no workgroup memory and the program has.
    pub unsafe fn run(
        &self,
        frame: &mut Frame,
        wave: &mut Wave<'_>,
        fuel: &mut u64,
    ) -> Result<Events, TryReserveError> {
        let count = wave.states.len();
        assert!((1..=MAX_SUBGROUPS).contains(&count), "wave length");
        assert!(
            self.shared_size_bytes == 0 || wave.shared.len() >= count,
            "no workgroup memory"
        );
        let point = wave.states[0][0].0[0];
        for state in wave.states.iter() {
            assert!(state.len() >= self.plan.layout.rows, "state too small");
            assert_eq!(state[0].0[0], point, "subgroups at different points");
        }
        assert!(point < self.plan.points_end(), "state of another program");
        let program = (self.number, self.shared_size_bytes);
        // SAFETY: the caller keeps the contract of this function; the states were looked at above.
        let event = unsafe { self.code.run(&self.plan, program, frame, wave, fuel)? };
        // The interpreter keeps a wave together until its event.
        Ok(Events { all: event, count })
    }
}

/// The events of a run's subgroups, by their index in the wave.
#[derive(Clone, Copy, Debug)]
pub struct Events {
    all: Event,
    count: usize,
}

impl Events {
    /// One for each subgroup.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = Event> {
        std::iter::repeat_n(self.all, self.count)
    }

    /// The event that all subgroups came to: a wave stays together.
    #[inline]
    pub fn all(&self) -> Event {
        self.all
    }

    /// Whether a subgroup came to an event.
    #[inline]
    pub fn contains(&self, event: Event) -> bool {
        self.all == event
    }
}
