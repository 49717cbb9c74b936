//! The end of fragments of several pixels: outputs copied to their pixels, part by part.

use lanes::{LaneMask, Tier};
use spirv_jit::Program;

use super::coarse::{Gather, PartOf};
use super::lanes::lanes_where;
use super::pack::Pack;
use super::places::{Pattern, Places};
use super::plan::Plan;
use super::samples::{Counts, MAX_SAMPLES, any};
use super::shading::finish;
use crate::object::shading_rate::Rate;
use crate::raster::Chunk;
use crate::raster::primitive::Bounds;
use crate::wave::launch_counts::LaunchCounts;
use crate::wave::runner::{Runner, Subgroups};
use crate::wave::{Limits, Stopped};

/// A wave whose fragments are of several pixels.
pub struct Wave<'a> {
    pub tier: Tier,
    pub chunks: &'a [Chunk],
    pub plan: &'a Plan<'a>,
    pub program: &'a Program,
    pub rate: Rate,
    pub area: &'a Bounds,
    pub limits: &'a Limits,
    /// Counts of each pixel, where a capture keeps them.
    pub counted: Option<&'a LaunchCounts>,
}

impl Gather {
    /// Finishes the fragments of a wave whose program has run, part by part: parts have no pixel in
    /// common.
    ///
    /// # Safety
    /// As [`finish`].
    pub unsafe fn finish(
        &mut self,
        wave: &Wave<'_>,
        packs: &[Pack],
        runner: &mut Runner,
        counts: &mut Counts,
    ) -> Result<(), Stopped> {
        let (plan, program) = (wave.plan, wave.program);
        let (io, outputs) = (program.layout().io, plan.output.rows);
        let [width, height] = wave.rate.pixels();
        for part in 0..width * height {
            self.parts.clear();
            self.sources.clear();
            let at = PartOf::new(wave.rate, part);
            for (index, (pack, spread)) in packs.iter().zip(&self.packs).enumerate() {
                if any(&spread.masks[part]) != 0 {
                    self.parts
                        .push(at.of_pack(pack, &spread.masks[part], wave.area));
                    self.sources.push(index);
                }
            }
            if self.parts.is_empty() {
                continue;
            }
            let subgroups = Subgroups::apart(self.parts.len());
            self.states.begin(program, subgroups, wave.limits)?;
            let fragments: [_; 16] = std::array::from_fn(|lane| at.fragment(lane % 4));
            let sources: [_; 16] = std::array::from_fn(|lane| lane / 4 * 4 + fragments[lane].0);
            for (state, &index) in self.states.states().zip(&self.sources) {
                let from = runner.state(index);
                let helpers = program.helpers(from).bits();
                let helpers = lanes_where(|lane| helpers >> sources[lane] & 1 != 0);
                let (all, helpers) = (LaneMask::from_bits(u16::MAX), LaneMask::from_bits(helpers));
                program.start_fragments(state, all, helpers);
                for (to, from) in state[io..][..outputs].iter_mut().zip(&from[io..]) {
                    to.0 = std::array::from_fn(|lane| from.0[sources[lane]]);
                }
                // Its bits are of all pixels of a fragment.
                if let Some(row) = plan.output.sample_mask {
                    for (word, (_, number)) in state[io + row].0.iter_mut().zip(fragments) {
                        *word >>= number * plan.samples as usize;
                    }
                }
            }
            let (tier, chunks, states) = (wave.tier, wave.chunks, &mut self.states);
            // SAFETY: the caller keeps the contract of `finish`; the masks are those of blocks.
            unsafe {
                finish(
                    tier,
                    chunks,
                    plan,
                    program,
                    states,
                    &mut self.parts,
                    counts,
                    wave.counted,
                );
            }
        }
        Ok(())
    }
}

impl PartOf {
    /// The pixels of the part, of fragments in a pack whose places are pixels.
    fn of_pack(&self, pack: &Pack, masks: &[u16; MAX_SAMPLES], area: &Bounds) -> Pack {
        let [x, y] = self.at.map(|at| 2 * at as i32);
        let (x, y) = (
            pack.places.x.map(|it| it + x),
            pack.places.y.map(|it| it + y),
        );
        let is_inside = x.iter().all(|&x| x >= area.left && x + 2 <= area.right)
            && y.iter().all(|&y| y >= area.top && y + 2 <= area.bottom);
        Pack {
            places: Places {
                x,
                y,
                layer: pack.places.layer,
                pattern: match is_inside {
                    true => Pattern::Inside,
                    false => Pattern::Quads,
                },
            },
            masks: *masks,
            ..*pack
        }
    }
}
