//! 16-bit floats in the forms that operations on 32-bit floats take.
//!
//! A value of 16-bit floats holds each in the lower half of a lane of 32 bits. Arithmetic takes
//! them as 32-bit floats, and rounding gives them packed in half a register. Both forms of a value
//! are remembered for the operations that follow soon. A chain of operations then waits for the
//! rounding alone, not for the way to lanes of 32 bits and back.

use super::lower::float;
use super::{Stretch, Virtual};
#[cfg(doc)]
use crate::eval::narrow;
use crate::native::allocate::{Class, Form};
use crate::native::encode::{DOWN, Encoding, TOWARDS_ZERO, UP};
use crate::native::opcodes::*;

/// Steps of a half between two uses of a form, at most: more would occupy too many registers.
const NEAR: usize = 12;

/// Forms of a value of 16-bit floats.
pub(super) struct HalfForms {
    /// The value.
    value: Virtual,
    /// Its half and its subgroup: steps of other halves may move before those that made the forms.
    side: (Option<i32>, usize),
    /// Packed in half a register.
    packed: Option<Virtual>,
    /// As 32-bit floats.
    wide: Option<Virtual>,
    /// Number of the step behind the last one that made or used a form.
    step: usize,
}

impl Stretch {
    pub(super) fn half_to_float(&mut self, a: Virtual) -> Virtual {
        let (side, now) = ((self.half, self.subgroup), self.steps.len());
        // Steps of both halves alternate where code takes both.
        let near = NEAR << self.half.is_some() as usize;
        self.half_forms.retain(|forms| now - forms.step <= near);
        let is_known = |forms: &&HalfForms| (forms.value, forms.side) == (a, side);
        let known = self.half_forms.iter().find(is_known);
        // The row of a form that is a result may hold another value by now.
        let has_no_row = |form: &Virtual| self.infos[*form as usize].home.is_none();
        let wide = known.and_then(|forms| forms.wide).filter(has_no_row);
        let packed = known.and_then(|forms| forms.packed);
        let wide = wide.unwrap_or_else(|| {
            let packed = packed.unwrap_or_else(|| self.packed_halves(a));
            self.step(Class::Vector, CVTPH2PS, Form::Registers, &[packed])
        });
        self.note_half_forms(a, packed, Some(wide));
        wide
    }

    pub(super) fn float_to_half(&mut self, a: Virtual) -> Virtual {
        // 0: to nearest even.
        let packed = self.step_with(CVTPS2PH, Form::Reverse, &[a], 0);
        let value = self.step(Class::Vector, PMOVZXWD, Form::Registers, &[packed]);
        self.note_half_forms(value, Some(packed), None);
        value
    }

    /// `a * b + c` rounded to odd, of numbers that 16-bit floats hold, as [`narrow::odd_fma`] is.
    /// `None` with AVX2, which needs so many dependent steps that the interpreter is faster.
    pub(super) fn odd_fma(&mut self, [a, b, c]: [Virtual; 3]) -> Option<Virtual> {
        if self.encoding == Encoding::Vex {
            return None;
        }
        let product = self.commutative(MULPS, a, b);
        let sums = [DOWN, UP, TOWARDS_ZERO]
            .map(|how| self.step(Class::Vector, ADDPS, Form::Rounding(how), &[product, c]));
        let [down, up, near_zero] = sums;
        let is_inexact = self.condition(CMPPS, down, up, float::NE);
        let one = self.words(1);
        let odd = self.commutative(POR, near_zero, one);
        Some(self.select(is_inexact, odd, near_zero))
    }

    fn packed_halves(&mut self, a: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => self.step(Class::Vector, PMOVDW, Form::Reverse, &[a]),
            Encoding::Vex => {
                let upper = self.upper(a);
                self.step(Class::Vector, PACKUSDW, Form::Registers, &[a, upper])
            }
        }
    }

    fn note_half_forms(&mut self, value: Virtual, packed: Option<Virtual>, wide: Option<Virtual>) {
        let side = (self.half, self.subgroup);
        self.half_forms
            .retain(|forms| (forms.value, forms.side) != (value, side));
        self.half_forms.push(HalfForms {
            value,
            side,
            packed,
            wide,
            step: self.steps.len(),
        });
    }

    /// Forgets forms that steps from a number on made or used.
    pub(super) fn forget_half_forms(&mut self, from: usize) {
        self.half_forms.retain(|forms| forms.step <= from);
    }
}
