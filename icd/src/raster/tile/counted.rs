//! Counts of each pixel, where a capture keeps them. All fragments with a program run it then.
//! Nothing here runs otherwise.

#![forbid(unsafe_code)]

use super::coarse::Of;
use super::coverage::Block;
use super::pack::{Origin, Pack};
use super::pass_through::Part;
use super::pixels::{cells_of, count_lanes};
use super::places::Places;
use super::samples::any;
use super::visit::{Current, Visit};
use crate::object::shading_rate::Rate;
use crate::raster::Chunk;
use crate::raster::primitive::{Bounds, Shape};
use crate::wave::Stopped;
use crate::wave::launch_counts::{Counter, LaunchCounts};
use crate::wave::runner::SeenSubgroups;

impl<'a> Visit<'a> {
    /// Works a shape off with counts.
    #[cold]
    pub(super) fn counted_shape(
        &mut self,
        current: Current<'a>,
        chunk: &Chunk,
        origin: Origin,
        shape: &Shape,
        clip: &Bounds,
    ) -> Result<(), Stopped> {
        let record = &chunk.records[shape.record as usize];
        let plan = current.plan;
        let mut covered = std::mem::take(&mut self.worker.covered);
        covered.clear();
        self.cover(chunk, shape, clip, &plan.locations, &mut covered);
        covered.split(plan.samples);
        let layer = record.layer.into();
        if let Some(counts) = self.round.context.counts {
            for block in &covered.blocks {
                self.count_block(counts, Counter::Primitives, block, layer, any(&block.masks));
            }
        }
        let result = match (&plan.program, &plan.coarse) {
            (None, _) if plan.pass_through.is_some() => {
                // Tests are all that there is.
                self.test::<true>(current, false, record, &mut covered.blocks);
                Ok(())
            }
            (Some(_), Some(coarse)) => {
                let corner = [self.bounds.left, self.bounds.top];
                let part = Part::new(chunk, record, corner, &self.round.area);
                let of = Of { origin, layer };
                self.coarse_fragments::<true>(current, coarse, of, &part, &mut covered)
            }
            _ => self.fragments::<true>(current, origin, record, &mut covered),
        };
        self.worker.covered = covered;
        result
    }

    /// Counts pixels of blocks none of whose samples is left; `before`: their covered pixels.
    #[cold]
    pub(super) fn count_failed(&self, blocks: &[Block], before: &[u16], layer: u32) {
        let Some(counts) = self.round.context.counts else {
            return;
        };
        for (block, before) in blocks.iter().zip(before) {
            let failed = before & !any(&block.masks);
            self.count_block(counts, Counter::FailedTests, block, layer, failed);
        }
    }

    fn count_block(
        &self,
        counts: &LaunchCounts,
        counter: Counter,
        block: &Block,
        layer: u32,
        lanes: u16,
    ) {
        let place = block.place([self.bounds.left, self.bounds.top]);
        let places = Places::block(place, layer, &self.round.area);
        count_lanes(counts, counter, &places, lanes);
    }

    /// Counts the program's invocations in packs, at the first pixels of their fragments, and
    /// returns where those are for what the program does.
    #[cold]
    pub(super) fn seen_packs(
        &self,
        packs: &[Pack],
        rate: Option<Rate>,
    ) -> Option<SeenSubgroups<'a>> {
        let counts = self.round.context.counts?;
        let logs = rate.map_or([0; 2], |rate| rate.logs);
        let cells = packs.iter().map(|pack| {
            let cells = cells_of(counts, &pack.places, logs, pack.covered());
            for cell in cells.into_iter().flatten() {
                counts.add(Counter::FragmentShaders, cell, 1);
            }
            cells
        });
        Some(SeenSubgroups {
            one: None,
            counted: Some((counts, cells.collect())),
        })
    }
}
