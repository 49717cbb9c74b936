//! Stores of a loop's words to buffers and workgroup memory.

use super::turns::{Lanes, Turns};
use super::{Class, Form, Held, IrOperand};
use crate::native::encode::{Base, Constant, Encoding, Memory};
use crate::native::opcodes::*;
use crate::native::{LoopContext, WORKGROUP};

/// Bytes of a word.
const WORD_BYTES: u32 = 4;

impl Turns {
    /// Stores a word of each lane at an offset of a region, in the lanes' order; those that are not
    /// inside as a whole are dropped. `distance`: how far neighbouring lanes' words may be apart.
    /// `None` where there is no code: with AVX2, where halves take turns of their own.
    pub fn store(
        &mut self,
        lanes: Lanes,
        region: usize,
        (offset, distance): (&IrOperand, u32),
        value: &IrOperand,
    ) -> Option<()> {
        if self.stretch.encoding == Encoding::Vex && self.sides() == 1 {
            return None;
        }
        self.takes_own |= region == WORKGROUP;
        self.by_halves(|s, half| {
            let (Held::One(offset), Held::One(value)) = (s.operand(offset), s.operand(value))
            else {
                return None;
            };
            let at = Memory::At(Base::Context, LoopContext::last(region));
            let last = s.value(Class::Vector, Some(at), true);
            // Signed numbers in the order of unsigned ones.
            let start = s.words(1 << 31);
            let place = s.commutative(PADDD, offset, start);
            let inside = s.inside(place, last, lanes.0[half]);
            let steps = (distance == WORD_BYTES).then(|| {
                let steps = std::array::from_fn(|lane| distance * lane as u32);
                s.constant_index(Constant::Words(steps))
            });
            s.step(
                Class::Vector,
                PSCATTERDD,
                Form::Scatter(steps),
                &[place, inside, value],
            );
            let step = s.steps.last_mut().expect("pushed");
            step.immediate = Some(region as u8);
            // Of both halves: steps of either stay before it or behind it.
            step.half = None;
            s.operations += 1;
            s.end_operation();
            Some(())
        })?;
        Some(())
    }
}
