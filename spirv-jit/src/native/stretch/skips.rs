//! Bodies of branches that no lane comes to: code jumps over long ones.

use super::exits::drop_exits;
use super::turns::{Lanes, Turns};
use super::{Class, Form, Step};
use crate::native::allocate::{Exit, MOVE, TURNS_TOGETHER};
use crate::native::opcodes::*;

/// Cost of a body, at least, that pays for the test and for a jump that is foretold wrong.
const LEAST_COST: usize = 64;

/// About as much as so many simple instructions.
fn cost(step: &Step) -> usize {
    match (step.form, step.op) {
        (Form::InOrder, _) => 16,
        (Form::Gather(_) | Form::LoadFours | Form::Scatter(_), _) => 12,
        (Form::GatherRows | Form::ScatterRows, _) => 12,
        (_, DIVPS | SQRTPS | DIVPD | SQRTPD) => 8,
        _ => 1,
    }
}

/// Whether a step begins or ends a region that may be jumped over.
pub(super) fn bounds_skip(form: Form) -> bool {
    matches!(form, Form::Skip(_) | Form::EndSkip(_))
}

impl Turns {
    /// Begins a body that lanes come to, if there are any. Gives its number.
    pub fn begin_body(&mut self, lanes: Lanes) -> usize {
        let index = self.next_exit(Exit::Without(Vec::new()));
        self.test_lanes(index, Form::Skip(index), lanes);
        index
    }

    /// Ends a body; what follows is performed whether lanes came to the body or not. `entered`: the
    /// lanes that did. Gives those of `lanes`, which are at its end.
    pub fn end_body(
        &mut self,
        index: usize,
        entered: Lanes,
        lanes: Option<Lanes>,
    ) -> Option<Lanes> {
        let s = &mut self.stretch;
        s.step(Class::Vector, MOVE, Form::EndSkip(index), &[]);
        let begins = |step: &Step| step.form == Form::Skip(index);
        if let Some(start) = s.steps.iter().rposition(begins) {
            // These are there only if lanes came to the body.
            s.forget_half_forms(start);
        }
        match lanes {
            Some(lanes) if lanes.0 != entered.0 => self.common(entered, lanes),
            lanes => lanes,
        }
    }

    /// A body is never jumped over: lanes inside join others outside of it.
    pub fn keep_body(&mut self, index: usize) {
        self.kept_bodies.insert(index);
    }

    /// Lanes that are in both.
    fn common(&mut self, a: Lanes, b: Lanes) -> Option<Lanes> {
        let both = self.by_halves(|s, half| {
            let both = s.both(a.0[half], b.0[half]);
            s.end_operation();
            Some(both)
        });
        both.map(Lanes)
    }

    /// Leaves jumps over long bodies alone.
    pub(super) fn settle_skips(&mut self) {
        let is_first = |step: &&Step| matches!(step.subgroup, 0 | TURNS_TOGETHER);
        let (mut open, mut all, mut long) = (Vec::new(), 0, Vec::new());
        for step in self.stretch.steps.iter().filter(is_first) {
            match step.form {
                Form::Skip(index) => open.push((index, all)),
                Form::EndSkip(index) => {
                    while let Some((begun, before)) = open.pop() {
                        if begun == index {
                            if all - before >= LEAST_COST && !self.kept_bodies.contains(&index) {
                                long.push(index);
                            }
                            break;
                        }
                    }
                }
                _ => all += cost(step),
            }
        }
        drop_exits(&mut self.stretch.steps, |form| match form {
            Form::Skip(index) | Form::EndSkip(index) => !long.contains(&index),
            _ => false,
        });
    }
}
