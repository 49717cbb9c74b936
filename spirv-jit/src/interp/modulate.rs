//! The sample of a program that does little else ([`Modulated`]), computed from the program's
//! inputs: the same bits as the program's.

use super::descriptors::Entries;
use super::images::resolve;
use crate::environment::Environment;
use crate::ir::modulate::{Bound, Modulated};
use images::fast::Fast;
use images::wave::{self, Rows, Wave};
use lanes::{LaneMask, Row, Tier};

/// How many times sixteen texels are sampled in one call, at most.
pub const TOGETHER: usize = 4;

/// An image and a sampler that the common way of sampling serves for.
#[derive(Clone, Copy)]
pub struct Sampling<'a> {
    fast: Fast<'a>,
}

impl<'a> Sampling<'a> {
    /// The sample of a program in an environment; none if the program has to run.
    ///
    /// # Safety
    /// The data that the environment points to stays valid for the lifetime, as
    /// [`Program::run`](crate::Program::run) requires.
    pub unsafe fn new(modulated: &'a Modulated, environment: &'a Environment) -> Option<Self> {
        let address = |bound: &Bound| Entries::of(environment, &bound.binding).address(bound.index);
        let descriptors = (address(&modulated.image), address(&modulated.sampler));
        // SAFETY: the addresses are of descriptors of the environment; for what they point to; the
        // caller guarantees that the data that the environment points to stays valid for the
        // lifetime, as `Program::run` requires.
        let fast = unsafe { resolve(environment, &modulated.op, modulated.wanted, descriptors) }?;
        Some(Self { fast })
    }

    /// Whether lanes have to be quads, whose coordinates choose the level and the samples.
    pub fn takes_derivatives(&self) -> bool {
        self.fast.takes_derivatives()
    }

    /// The texels at sixteen coordinates each, of which those of `active` lanes are looked at: each
    /// has some. Components that the program does not want are anything.
    ///
    /// # Safety
    /// As [`Self::new`].
    pub unsafe fn texels(
        &self,
        tier: Tier,
        at: &mut [[Row; 2]; TOGETHER],
        active: &[LaneMask],
        texels: &mut [[Row; 4]; TOGETHER],
    ) {
        const NUMBERS: [u16; TOGETHER] = [0, 1, 2, 3];
        let coordinate = |axis: usize| Rows {
            first: at.as_mut_ptr().cast::<Row>().wrapping_add(axis),
            step_bytes: size_of::<[Row; 2]>(),
        };
        let texels = texels.as_mut_ptr().cast::<Row>();
        let result = |component: usize| Rows {
            first: texels.wrapping_add(component),
            step_bytes: size_of::<[Row; 4]>(),
        };
        let [s, t] = [0, 1].map(coordinate);
        let count = active.len().min(TOGETHER);
        let wave = Wave {
            subgroups: &NUMBERS[..count],
            lanes: active,
            operands: &[s, t, s, t, s, t],
            results: [0, 1, 2, 3].map(result),
            derives: true,
        };
        // SAFETY: the rows are the coordinates', in the places of derivatives, too, and those of
        // the texels; the caller keeps the contract of `Self::new`.
        unsafe { wave::sample(tier, &self.fast, &wave) };
    }
}
