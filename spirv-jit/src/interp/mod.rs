//! The vector interpreter: each operation runs over the lanes of a wave.

use crate::Error;
use crate::ir::{self, InputRow};
use crate::program::{AlignedRow, Event, ResumePoint, SiteKind, Stage, StateLayout, Wave};

/// A worker's hot memory: slots of the program that is running. One per thread, reused for every program.
#[derive(Default)]
pub struct Frame {}

/// A compiled shader. Immutable and shared between threads.
pub struct Program {
    stage: Stage,
}

impl Program {
    /// Compiles a verified, optimised module.
    ///
    /// # Errors
    /// Budget.
    pub fn new(module: &ir::Module) -> Result<Program, Error> {
        let _ = module;
        Err(Error::unsupported(0, "no interpreter yet"))
    }

    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Input rows the program reads, in order; row `i` of the state's inputs is `inputs()[i]`.
    pub fn inputs(&self) -> &[InputRow] {
        &[]
    }

    /// Compute: the workgroup's size per dimension.
    pub fn local_size(&self) -> [u32; 3] {
        [1; 3]
    }

    /// Compute: workgroup memory in bytes.
    pub fn shared_size_bytes(&self) -> u32 {
        0
    }

    /// Rows of a subgroup's state.
    pub fn layout(&self) -> StateLayout {
        StateLayout::default()
    }

    /// Subgroups that one run may take (wave length / 16): follows from the frame's size.
    pub fn max_wave_subgroups(&self) -> usize {
        1
    }

    /// What yields ask for, by `SiteId`.
    pub fn sites(&self) -> &[SiteKind] {
        &[]
    }

    /// Words the program leaves in the `io` rows at its end (see `ir::Module::output_rows`).
    pub fn output_rows(&self) -> u32 {
        0
    }

    /// Bytes of one lane's state: what `vkGetRayTracingShaderGroupStackSizeKHR` reports.
    pub fn stack_size_bytes(&self) -> u32 {
        0
    }

    /// Puts a state at the program's entry with these lanes active. Inputs may be filled before or after; `io` rows are zeroed.
    pub fn start(&self, state: &mut [AlignedRow], active: u16) {
        let _ = (state, active);
    }

    /// Where a state stands.
    pub fn resume_point(&self, state: &[AlignedRow]) -> ResumePoint {
        let _ = state;
        ResumePoint(0)
    }

    /// Lanes of a yielded state that take part in its event (may be none: such a subgroup is ready at once).
    pub fn event_mask(&self, state: &[AlignedRow]) -> u16 {
        let _ = state;
        0
    }

    /// Runs a wave of subgroups that stand at one resume point until the next event. `fuel` is burnt at loop back-edges, one per wave.
    pub fn run(&self, frame: &mut Frame, wave: &mut Wave<'_>, fuel: &mut u64) -> Event {
        let _ = (frame, wave, fuel);
        Event::End
    }
}
