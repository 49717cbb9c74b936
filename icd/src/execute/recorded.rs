//! The capture of a pass, from its first draw to its end.

use std::sync::Arc;

use spirv_jit::Program;

use super::engine::Engine;
use crate::capture::{self, Recording};
use crate::raster::{Batch, Targets, Work};
use crate::wave::launch_counts::LaunchCounts;

/// The pass, if it is captured.
#[derive(Default)]
pub struct RecordedPass {
    recording: Option<Recording>,
    /// The pass has drawn, and is captured or not.
    has_begun: bool,
    /// Programs of its first draw.
    programs: Vec<Arc<Program>>,
}

impl RecordedPass {
    /// Draws of a batch come. Passes without draws are not captured.
    #[cold]
    pub fn begin(&mut self, targets: &Targets, batch: &Batch) {
        let first = batch.work.iter().find_map(|work| match work {
            Work::Draw(draw) => Some(draw),
            Work::Clear(_) => None,
        });
        let Some(draw) = first.filter(|_| !self.has_begun) else {
            return;
        };
        self.has_begun = true;
        let area = &targets.area;
        let (offset, size) = (area.offset, area.extent);
        let first = [offset.x, offset.y, 0].map(|at| at.max(0) as u32);
        let extent = [size.width, size.height, targets.layers];
        self.recording = capture::pass(first, extent);
        self.programs = draw.stages.iter().cloned().collect();
    }

    /// Counts of its pixels.
    pub fn counts(&self) -> Option<&LaunchCounts> {
        self.recording.as_ref()?.observer().counts()
    }

    /// The pass is complete, or `stopped`.
    pub fn finish(&mut self, engine: &Engine, stopped: bool) {
        self.has_begun = false;
        let programs = std::mem::take(&mut self.programs);
        if let Some(recording) = self.recording.take() {
            let live = engine.memory.structures();
            let programs = programs.iter().map(|program| &**program);
            // SAFETY: the application keeps the structures that shaders use until its commands are
            // complete.
            unsafe { recording.finish(programs, None, &live, stopped) };
        }
    }
}
