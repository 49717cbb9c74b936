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
mod forming;
mod grid;
mod hit_object;
mod inputs;
mod line;
mod rays;
mod ready;
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

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use lanes::Tier;
use parking_lot::Mutex;
use rayon::prelude::*;
use smallvec::SmallVec;
use spirv_jit::environment::Environment;
use spirv_jit::program::SiteKind;

use crate::timeline;
use crate::wave::costs::Costs;
use crate::wave::mask::LiveMask;
use crate::wave::observer::Observer;
use crate::wave::table::{self, Live, Shaders, Tables};
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

/// Batches of a dispatch whose order follows from their times, at most.
const SORTED_BATCHES: usize = 1 << 16;

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
        let tasks = count.min(workers.current_num_threads());
        let key = (dispatch.extent, std::ptr::from_ref(dispatch.shaders).addr());
        let is_sorted = tasks > 1 && count <= SORTED_BATCHES;
        let mut order: Vec<usize> = Vec::new();
        if is_sorted {
            order.extend(0..count);
            self.costs.sort(key, &mut order);
        }
        let next = AtomicUsize::new(0);
        let work = || {
            let mut worker = self.lease();
            let mut measured: SmallVec<[(usize, u32); 64]> = SmallVec::new();
            let mut begin = Instant::now();
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                if index >= count {
                    break;
                }
                let batch = order.get(index).copied().unwrap_or(index);
                run(&mut worker, batch).inspect_err(|_| next.store(count, Ordering::Relaxed))?;
                if is_sorted {
                    let end = Instant::now();
                    measured.push((batch, (end - begin).as_nanos() as u32));
                    begin = end;
                }
            }
            if is_sorted {
                self.costs.keep(key, count, &measured);
            }
            Ok(())
        };
        match tasks {
            0 => Ok(()),
            1 => work(),
            _ => workers.install(|| {
                (0..tasks)
                    .into_par_iter()
                    .with_max_len(1)
                    .try_for_each(|_| work())
            }),
        }
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
    fn raygen(&self) -> Option<(table::ProgramIndex, u64)> {
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
