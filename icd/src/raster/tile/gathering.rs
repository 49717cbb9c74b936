//! A worker's way with fragments of several pixels: blocks to fragments, fragments to waves.

use super::coarse::{Coarse, Of, block_at};
use super::coverage::Covered;
use super::pack::Found;
use super::pass_through::Part;
use super::samples::MAX_SAMPLES;
use super::visit::{Current, TileWorker, Visit};
use crate::wave::Stopped;

impl<'a> Visit<'a> {
    /// As [`Self::fragments`], of several pixels.
    pub(super) fn coarse_fragments<const COUNTED: bool>(
        &mut self,
        current: Current<'a>,
        coarse: &Coarse,
        of: Of,
        part: &Part<'_>,
        covered: &mut Covered,
    ) -> Result<(), Stopped> {
        let Some(fragment) = &current.plan.program else {
            return Ok(());
        };
        if self.worker.gather.of != Some(of) {
            self.pass_gathered()?;
            // Those that see what earlier ones left: all that a primitive's fragments may lie on.
            if fragment.is_serial {
                self.run_wave()?;
            }
            self.worker.gather.of = Some(of);
        }
        covered.split(current.plan.samples);
        self.test::<COUNTED>(
            current,
            coarse.sees_untested,
            part.record,
            &mut covered.blocks,
        );
        let TileWorker {
            gather, coverage, ..
        } = &mut *self.worker;
        gather.add(coarse, part, covered, coverage);
        Ok(())
    }

    /// Adds the fragments of the primitive that is gathered to the wave.
    pub(super) fn pass_gathered(&mut self) -> Result<(), Stopped> {
        let gather = &mut self.worker.gather;
        let mut blocks = std::mem::take(&mut gather.blocks);
        for block in &blocks {
            gather.places[block_at(block.first)] = 0;
        }
        let (of, current) = (gather.of.take(), self.current);
        let (Some(of), Some(Current { plan, .. })) = (of, current) else {
            return Ok(());
        };
        let (Some(coarse), Some(fragment)) = (&plan.coarse, &plan.program) else {
            return Ok(());
        };
        if coarse.kinds.len() > 1 {
            blocks.sort_by_key(|block| block.kind);
        }
        for block in &blocks {
            let kind = usize::from(block.kind);
            let rate = coarse.kinds[kind].rate;
            let lanes = block.lanes(rate);
            if lanes == 0 {
                continue;
            }
            if self.worker.gather.kind != kind {
                self.run_wave()?;
                self.worker.gather.kind = kind;
            }
            let mut masks = [0; MAX_SAMPLES];
            masks[0] = lanes;
            let corner = [self.bounds.left, self.bounds.top];
            let place =
                |axis: usize| (corner[axis] + i32::from(block.first[axis])) >> rate.logs[axis];
            let found = Found {
                origin: of.origin,
                place: [place(0), place(1)],
                layer: of.layer,
                area: &self.round.area,
                sample: 0,
                lanes,
                masks: &masks,
                coverage: &masks,
            };
            let TileWorker { gather, packs, .. } = &mut *self.worker;
            gather.pack(coarse, block, &found, packs);
            if packs.packs.len() >= fragment.subgroups {
                self.run_wave()?;
            }
        }
        blocks.clear();
        self.worker.gather.blocks = blocks;
        Ok(())
    }
}
