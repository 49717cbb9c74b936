//! `vkCmdDispatch*`: workgroups over the workers.
//!
//! Sixteen invocations with consecutive `LocalInvocationIndex` are a subgroup. All subgroups of a workgroup run until each has ended or
//! stands at a barrier; then those go on. Workgroups that share no memory are taken several at a time, to fill waves.

use ash::vk;
use rayon::prelude::*;
use spirv_jit::environment::{Environment, uniform};
use spirv_jit::interp::Frame;
use spirv_jit::program::{AlignedRow, Builtin, Event, InputRow, ResumePoint, Wave};
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::Engine;
use super::bindings::Bindings;
use crate::object::pipeline::PipelineKind;
use crate::trace::{Limits, Stopped};

/// Loop iterations of a wave between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// A worker's memory, kept warm from dispatch to dispatch.
#[derive(Default)]
pub struct Worker {
    frame: Frame,
    rows: Vec<AlignedRow>,
    shared: Vec<AlignedRow>,
    ready: Vec<(ResumePoint, Vec<usize>)>,
    at_barrier: Vec<usize>,
}

/// One dispatch.
struct Dispatch<'a> {
    program: &'a Program,
    environment: &'a Environment,
    limits: &'a Limits,
    base: [u32; 3],
    count: [u32; 3],
    workgroup_count: u64,
    invocations: u32,
    subgroups_per_workgroup: usize,
    /// Workgroups that are run together.
    together: u64,
}

/// Runs the bound compute pipeline.
///
/// # Errors
/// When a limit stopped it.
pub fn dispatch(
    engine: &Engine,
    bindings: &Bindings<'_>,
    base: [u32; 3],
    count: [u32; 3],
) -> Result<(), Stopped> {
    let Some(PipelineKind::Compute(program)) =
        bindings.compute.pipeline.map(|pipeline| &pipeline.kind)
    else {
        return Ok(());
    };
    let mut environment = bindings.environment(vk::PipelineBindPoint::COMPUTE);
    environment.uniforms[uniform::NUM_WORKGROUPS as usize..][..3].copy_from_slice(&count);
    let limits = engine.limits();
    let dispatch = Dispatch::new(program, &environment, &limits, base, count);
    let batches = dispatch.workgroup_count.div_ceil(dispatch.together);
    match batches {
        0 => Ok(()),
        1 => dispatch.run_batch(engine.lease_worker().worker(), 0),
        _ => engine
            .install(|| {
                (0..batches as usize).into_par_iter().try_for_each_init(
                    || engine.lease_worker(),
                    |lease, batch| dispatch.run_batch(lease.worker(), batch as u64),
                )
            })
            .unwrap_or(Ok(())),
    }
}

impl<'a> Dispatch<'a> {
    fn new(
        program: &'a Program,
        environment: &'a Environment,
        limits: &'a Limits,
        base: [u32; 3],
        count: [u32; 3],
    ) -> Self {
        let [x, y, z] = program.local_size();
        let invocations = x.saturating_mul(y).saturating_mul(z).max(1);
        let subgroups_per_workgroup = (invocations as usize).div_ceil(SUBGROUP_SIZE);
        let together = if program.shared_size_bytes() == 0 {
            (program.max_wave_subgroups() / subgroups_per_workgroup).max(1) as u64
        } else {
            1
        };
        Self {
            program,
            environment,
            limits,
            base,
            count,
            workgroup_count: count
                .iter()
                .fold(1u64, |product, &n| product.saturating_mul(u64::from(n))),
            invocations,
            subgroups_per_workgroup,
            together,
        }
    }

    /// Runs the workgroups of one batch to their end.
    fn run_batch(&self, worker: &mut Worker, batch: u64) -> Result<(), Stopped> {
        let first = batch * self.together;
        let last = (first + self.together).min(self.workgroup_count);
        let layout = self.program.layout();
        let subgroups = (last - first) as usize * self.subgroups_per_workgroup;
        worker
            .rows
            .resize(subgroups * layout.rows, AlignedRow::default());
        let shared_rows =
            (self.program.shared_size_bytes() as usize).div_ceil(size_of::<AlignedRow>());
        worker.shared.clear();
        worker.shared.resize(shared_rows, AlignedRow::default());
        worker.ready.clear();
        worker.at_barrier.clear();
        for (workgroup, states) in (first..last).zip(
            worker
                .rows
                .chunks_mut(self.subgroups_per_workgroup * layout.rows),
        ) {
            let id = self.workgroup_id(workgroup);
            for (subgroup, state) in states.chunks_mut(layout.rows).enumerate() {
                self.start(state, id, subgroup as u32);
            }
        }
        for state in 0..subgroups {
            worker.make_ready(self.program, state);
        }
        loop {
            while let Some((_, states)) = worker.take_fullest() {
                for wave in states.chunks(self.program.max_wave_subgroups().max(1)) {
                    self.run_wave(worker, wave)?;
                }
            }
            if worker.at_barrier.is_empty() {
                return Ok(());
            }
            for state in std::mem::take(&mut worker.at_barrier) {
                worker.make_ready(self.program, state);
            }
        }
    }

    fn run_wave(&self, worker: &mut Worker, wave: &[usize]) -> Result<(), Stopped> {
        let row_count = self.program.layout().rows;
        let mut fuel = FUEL;
        let event = {
            let mut chunks: Vec<Option<&mut [AlignedRow]>> =
                worker.rows.chunks_mut(row_count).map(Some).collect();
            let mut states: Vec<&mut [AlignedRow]> = wave
                .iter()
                .filter_map(|&state| chunks[state].take())
                .collect();
            self.program.run(
                &mut worker.frame,
                &mut Wave {
                    states: &mut states,
                    shared: worker.shared.as_mut_ptr().cast(),
                    environment: self.environment,
                },
                &mut fuel,
            )
        };
        match event {
            Event::End => {}
            Event::OutOfFuel => {
                self.limits.check()?;
                for &state in wave {
                    worker.make_ready(self.program, state);
                }
            }
            // The one event that compute has.
            Event::Yield(_) => worker.at_barrier.extend_from_slice(wave),
        }
        Ok(())
    }

    /// Puts a subgroup at the program's entry and fills its inputs.
    fn start(&self, state: &mut [AlignedRow], workgroup: [u32; 3], subgroup: u32) {
        let first = subgroup * SUBGROUP_SIZE as u32;
        let lanes = (self.invocations - first).min(SUBGROUP_SIZE as u32);
        self.program.start(
            state,
            (u16::MAX as u32 >> (SUBGROUP_SIZE as u32 - lanes)) as u16,
        );
        let inputs = self.program.layout().inputs;
        let local_size = self.program.local_size();
        for (index, input) in self.program.inputs().iter().enumerate() {
            let &InputRow::Builtin(builtin, component) = input else {
                continue;
            };
            let component = (component as usize).min(2);
            for (lane, word) in state[inputs + index].0.iter_mut().enumerate() {
                let local_index = first + lane as u32;
                let local = [
                    local_index % local_size[0],
                    local_index / local_size[0] % local_size[1],
                    local_index / local_size[0] / local_size[1],
                ];
                *word = match builtin {
                    Builtin::WorkgroupId => workgroup[component],
                    Builtin::LocalInvocationId => local[component],
                    Builtin::LocalInvocationIndex => local_index,
                    Builtin::GlobalInvocationId => workgroup[component]
                        .wrapping_mul(local_size[component])
                        .wrapping_add(local[component]),
                    Builtin::SubgroupId => subgroup,
                    Builtin::NumSubgroups => self.subgroups_per_workgroup as u32,
                    _ => 0,
                };
            }
        }
    }

    fn workgroup_id(&self, index: u64) -> [u32; 3] {
        let [x, y] = [u64::from(self.count[0]), u64::from(self.count[1])];
        [
            self.base[0].wrapping_add((index % x) as u32),
            self.base[1].wrapping_add((index / x % y) as u32),
            self.base[2].wrapping_add((index / x / y) as u32),
        ]
    }
}

impl Worker {
    fn make_ready(&mut self, program: &Program, state: usize) {
        let row_count = program.layout().rows;
        let point = program.resume_point(&self.rows[state * row_count..][..row_count]);
        match self.ready.iter_mut().find(|ready| ready.0 == point) {
            Some(ready) => ready.1.push(state),
            None => self.ready.push((point, vec![state])),
        }
    }

    fn take_fullest(&mut self) -> Option<(ResumePoint, Vec<usize>)> {
        let fullest = (0..self.ready.len()).max_by_key(|&index| self.ready[index].1.len())?;
        Some(self.ready.swap_remove(fullest))
    }
}
