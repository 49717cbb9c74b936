//! Executing `vkCmdTraceRays*`: a dispatch's grid in batches, each turned by one worker until it is
//! empty.
//!
//! ```text
//! grid ──> batches ──> Batch::run, in rounds:
//!                        walk rays to their ends, with the shaders that decide on their candidates
//!                        form subgroups of the hit and miss shaders and callables, and run them ──> rays, calls
//!                        run ray generation shaders ──> rays, calls
//!                      nothing left but subgroups at a reorder instruction: sort their lanes
//! ```
//!
//! Waves that need no partners do all of that at once, within a round: [`direct`].
//!
//! Shader code never calls traversal and traversal never calls shader code: both return here with
//! an event. Recursion therefore costs heap, never native stack, and callees are repacked across
//! all waves of the batch.

mod batch;
mod batch_memory;
mod calls;
mod counted;
mod direct;
mod every_ray;
mod fill_plan;
mod grid;
mod hit_object;
mod inputs;
mod line;
mod rays;
mod ready;
mod regroup;
mod reorder;
mod slab;
pub mod stats;
mod stopped;
mod subgroup;
#[cfg(test)]
mod tests;
mod walk_lists;
mod walked;
mod walks;
mod watched;
mod yields;

use lanes::Tier;
use parking_lot::Mutex;
use spirv_jit::environment::Environment;
use spirv_jit::program::SiteKind;

use crate::timeline;
use crate::wave::binding_table::{self, Live, Shaders, Tables};
use crate::wave::costs::Costs;
use crate::wave::mask::LiveMask;
use crate::wave::observer::Observer;
use crate::wave::{Limits, Stopped, Workers};
pub use grid::Grid;

/// One `vkCmdTraceRays*`, whatever command it came from.
pub struct Dispatch<'a> {
    pub shaders: &'a Shaders,
    /// The instruction set for work on rows.
    pub tier: Tier,
    pub tables: Tables<Live>,
    /// Width, height, depth.
    pub extent: [u32; 3],
    pub environment: &'a Environment,
    /// Ray flags that the pipeline adds to every ray (`SKIP_TRIANGLES`, `SKIP_AABBS`).
    pub pipeline_ray_flags: u32,
    /// Non-opaque geometry counts as opaque if no flag distinguishes them: there is no any-hit
    /// shader. Rays through an edge may then name the other triangle.
    pub takes_all_hits: bool,
    pub mask: Option<LiveMask>,
    pub limits: &'a Limits,
    /// Validation, captures and statistics, where they are on.
    pub observer: Option<&'a dyn Observer>,
}

/// The workers' memory, kept from one dispatch to the next.
#[derive(Default)]
pub struct Tracer {
    idle: Mutex<Vec<Box<batch::Worker>>>,
    /// Of batches, by the extent and the shaders' address.
    costs: Costs<([u32; 3], usize)>,
}

impl Tracer {
    /// Executes a dispatch and returns when it is complete. What is too small to be shared runs on
    /// the current thread.
    ///
    /// # Errors
    /// When a limit stopped it; what it wrote so far stays written.
    pub fn trace_rays(&self, dispatch: &Dispatch<'_>, workers: &Workers) -> Result<(), Stopped> {
        let Some((raygen, record)) = dispatch.raygen() else {
            return Ok(());
        };
        let program = &dispatch.shaders.programs[raygen as usize];
        let state_bytes = program.layout().rows * 64;
        let reorders = program.sites().contains(&SiteKind::ReorderThread);
        let grid = Grid::new(dispatch.extent, state_bytes, reorders);
        let run = |worker: &mut Lease<'_>, index| {
            let _span = timeline::work("batch of rays");
            // Batches that are soon over have no other occasion, however many there are.
            dispatch.limits.check()?;
            batch::Batch::new(dispatch, &grid, worker.worker()).run(raygen, record, index)
        };
        let count = grid.batch_count();
        if count == 0 {
            return Ok(());
        }
        let threads = workers.current_num_threads();
        let key = (dispatch.extent, std::ptr::from_ref(dispatch.shaders).addr());
        let queue = self.costs.queue(key, count, None, threads);
        workers.share(count.min(threads), || {
            let mut worker = self.lease();
            queue.work_off(|index| run(&mut worker, index))
        })
    }

    fn lease(&self) -> Lease<'_> {
        let idle = self.idle.lock().pop();
        Lease {
            worker: Some(idle.unwrap_or_default()),
            tracer: self,
        }
    }
}

impl Dispatch<'_> {
    /// The ray generation shader and its record.
    fn raygen(&self) -> Option<(binding_table::ProgramIndex, u64)> {
        let (record, handle) = self.tables.raygen.handle(0)?;
        let group = self.shaders.group(&handle)?;
        Some((group.general?, record))
    }
}

/// A worker on loan from its tracer. A worker that panicked is not given back.
struct Lease<'a> {
    worker: Option<Box<batch::Worker>>,
    tracer: &'a Tracer,
}

impl Lease<'_> {
    fn worker(&mut self) -> &mut batch::Worker {
        self.worker.as_mut().expect("held until dropped")
    }
}

impl Drop for Lease<'_> {
    fn drop(&mut self) {
        if let Some(worker) = self.worker.take()
            && !std::thread::panicking()
        {
            self.tracer.idle.lock().push(worker);
        }
    }
}
