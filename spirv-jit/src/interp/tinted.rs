//! The sample of a program that does little else ([`Tinted`]), computed from the program's inputs:
//! the same bits as the program's.

use super::descriptors::Entries;
use super::images::resolve;
use crate::environment::Environment;
use crate::ir::tinted::{Bound, Tinted};
use images::fast::Fast;
use images::wave::{self, Rows, Wave};
use lanes::vector::Vector;
use lanes::{LANES, LaneMask};

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
    pub unsafe fn new(tinted: &'a Tinted, environment: &'a Environment) -> Option<Self> {
        let address = |bound: &Bound| Entries::of(environment, &bound.binding).address(bound.index);
        let descriptors = (address(&tinted.image), address(&tinted.sampler));
        // SAFETY: the addresses are of descriptors of the environment; for what they point to, the
        // caller's promise.
        let fast = unsafe { resolve(environment, &tinted.op, tinted.wanted, descriptors) }?;
        Some(Self { fast })
    }

    /// Whether lanes have to be quads, whose coordinates choose the level and the samples.
    pub fn takes_derivatives(&self) -> bool {
        self.fast.takes_derivatives()
    }

    /// The texels at sixteen coordinates, of which those of `active` lanes are looked at: there are
    /// some. Components that the program does not want are anything.
    ///
    /// # Safety
    /// As [`Self::new`].
    #[inline(always)]
    pub unsafe fn texels<V: Vector>(&self, v: V, [s, t]: [V::F; 2], active: u16) -> [V::F; 4] {
        let mut coordinates = [[0; LANES]; 2];
        v.store(s, &mut coordinates[0]);
        v.store(t, &mut coordinates[1]);
        let mut texels = [[0; LANES]; 4];
        let one = |first| Rows {
            first,
            step_bytes: 0,
        };
        let [s, t] = coordinates.each_mut().map(|row| one(&raw mut *row));
        let wave = Wave {
            subgroups: &[0],
            lanes: &[LaneMask::from_bits(active)],
            operands: &[s, t, s, t, s, t],
            results: texels.each_mut().map(|row| one(&raw mut *row)),
            derives: true,
        };
        // SAFETY: the rows are the coordinates', in the places of derivatives, too, and those of
        // the texels; for the rest, the caller's promise.
        unsafe { wave::sample(V::TIER, &self.fast, &wave) };
        [
            v.load(&texels[0]),
            v.load(&texels[1]),
            v.load(&texels[2]),
            v.load(&texels[3]),
        ]
    }
}
