//! The primitives of a wave's fragments: which lanes of which subgroups are of which one.

use smallvec::SmallVec;

use super::inputs::{Inputs, Steps};
use super::lanes::lanes_of;
use super::pack::{Joined, Origin, Pack};
use crate::raster::Chunk;
use crate::raster::primitive::Record;

/// Lanes of a subgroup that are of one primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    pub subgroup: usize,
    pub lanes: u16,
    pub origin: Origin,
    /// The first of the primitive's [`Steps`].
    steps: usize,
}

/// The shares of a wave. All lanes of a subgroup are of its first share, except those of the shares
/// that follow.
#[derive(Default)]
pub struct Shares {
    pub list: Vec<Share>,
    steps: Vec<Steps>,
}

/// The record of a primitive, and its chunk.
#[inline(always)]
pub fn record_of(chunks: &[Chunk], origin: Origin) -> (&Record, &Chunk) {
    let chunk = &chunks[origin.chunk as usize];
    (&chunk.records[origin.record as usize], chunk)
}

impl Shares {
    /// Becomes those of a wave's packs. `joined`: of the packs.
    pub fn collect(
        &mut self,
        inputs: &Inputs,
        chunks: &[Chunk],
        packs: &[Pack],
        joined: &[Joined],
    ) {
        self.list.clear();
        self.steps.clear();
        for (subgroup, pack) in packs.iter().enumerate() {
            let mut add = |origin, lanes| self.add(inputs, chunks, subgroup, (origin, lanes));
            add(pack.origins[0], u16::MAX);
            if !pack.is_uniform {
                for (origin, lanes) in others(&pack.origins) {
                    add(origin, lanes);
                }
            }
            let mut next = pack.joined;
            while let Some(it) = joined.get((next as usize).wrapping_sub(1)) {
                add(it.origin, it.lanes);
                next = it.next;
            }
        }
    }

    fn add(
        &mut self,
        inputs: &Inputs,
        chunks: &[Chunk],
        subgroup: usize,
        (origin, lanes): (Origin, u16),
    ) {
        // Of the two primitives before: most of a wave is of few.
        let mut before = self.list.iter().rev().take(2);
        let steps = match before.find(|share| share.origin == origin) {
            Some(share) => share.steps,
            None => {
                let (record, chunk) = record_of(chunks, origin);
                inputs.steps(record, chunk, &mut self.steps)
            }
        };
        self.list.push(Share {
            subgroup,
            lanes,
            origin,
            steps,
        });
    }

    /// The steps of a share's varyings, as [`Inputs::varyings`] lists them.
    #[inline(always)]
    pub fn steps(&self, share: &Share) -> &[Steps] {
        &self.steps[share.steps..]
    }
}

/// The origins of a subgroup's quads that are not the first one's, with their lanes.
fn others(origins: &[Origin; 4]) -> SmallVec<[(Origin, u16); 3]> {
    let mut found: SmallVec<[(Origin, u16); 3]> = SmallVec::new();
    for (quad, origin) in origins.iter().enumerate().skip(1) {
        let lanes = lanes_of(1 << quad);
        match found.iter_mut().find(|(other, _)| other == origin) {
            Some((_, others)) => *others |= lanes,
            None if *origin != origins[0] => found.push((*origin, lanes)),
            None => {}
        }
    }
    found
}
