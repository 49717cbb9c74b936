//! The sample of a program that does little else ([`Tinted`]), computed from the program's inputs:
//! the same bits as the program's.

use lanes::vector::Vector;

use super::descriptors::Entries;
use super::images::{derivatives, put_derivatives, resolve};
use crate::SUBGROUP_SIZE;
use crate::environment::Environment;
use crate::image::fast::Fast;
use crate::image::operands::Operands;
use crate::ir::tinted::{Bound, Tinted};

/// An image and a sampler that the common way of sampling serves for.
#[derive(Clone, Copy)]
pub struct Sampling<'a> {
    tinted: &'a Tinted,
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
        Some(Self { tinted, fast })
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
        let op = &self.tinted.op;
        let mut coordinates = [[0; SUBGROUP_SIZE]; 2];
        v.store(s, &mut coordinates[0]);
        v.store(t, &mut coordinates[1]);
        let [s, t] = &coordinates;
        let mut rows = [s, t, s, t, s, t];
        let derived;
        if self.fast.takes_derivatives() {
            derived = derivatives(v, op, &rows, active);
            put_derivatives(op, &derived, &mut rows);
        }
        let operands = Operands::new(op, &rows);
        // SAFETY: the caller's promise.
        unsafe { self.fast.values(v, &operands, active) }
    }
}
