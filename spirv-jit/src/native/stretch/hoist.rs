//! Steps of loops that give the same in each turn: they are taken before the first one, and their
//! results are on the stack. Operations of the shader's that do so were moved by passes; these are
//! parts of others, such as conversions of an operand.

use super::turns::Turns;
use super::{Class, Info, Step, Virtual};
use crate::native::allocate::{Exit, allocate};
use crate::native::encode::{Assembler, Base, Memory};

/// Results that are kept on the stack, at most.
const MOST: usize = 16;

/// Steps that are taken before the first turn, and those of a turn.
struct Hoisted {
    before: Vec<Step>,
    turn: Vec<Step>,
    /// Results by the equal one that is kept.
    equal: Vec<(Virtual, Virtual)>,
}

impl Hoisted {
    /// `is_fixed`: by value, whether it is from outside of the loop. `must_stay`: whether it is
    /// handed on to the next turn.
    fn new(steps: &[Step], mut is_fixed: Vec<bool>, must_stay: &[bool]) -> Hoisted {
        let mut hoisted = Hoisted {
            before: Vec::new(),
            turn: Vec::with_capacity(steps.len()),
            equal: Vec::new(),
        };
        for &step in steps {
            let step = hoisted.renamed(step);
            let from = &step.from[..step.count];
            let gives_same = step.form.only_computes()
                && step.count > 0
                && !must_stay[step.to as usize]
                && from.iter().all(|&value| is_fixed[value as usize]);
            let known = hoisted.before.iter().find(|other| {
                (other.op, other.form, other.immediate) == (step.op, step.form, step.immediate)
                    && other.from[..other.count] == *from
            });
            match known.map(|known| known.to) {
                Some(known) if gives_same => hoisted.equal.push((step.to, known)),
                None if gives_same && hoisted.before.len() < MOST => {
                    is_fixed[step.to as usize] = true;
                    hoisted.before.push(Step { ends: true, ..step });
                }
                _ => {
                    hoisted.turn.push(step);
                    continue;
                }
            }
            if let (true, Some(last)) = (step.ends, hoisted.turn.last_mut()) {
                last.ends = true;
            }
        }
        hoisted
    }

    fn kept(&self, value: Virtual) -> Virtual {
        let known = self.equal.iter().find(|(other, _)| *other == value);
        known.map_or(value, |&(_, kept)| kept)
    }

    fn renamed(&self, step: Step) -> Step {
        Step {
            from: step.from.map(|value| self.kept(value)),
            ..step
        }
    }
}

impl Turns {
    /// Writes the steps that give the same in each turn. Gives the others, and how many bytes of
    /// the stack their results have.
    pub(super) fn hoist(&mut self, steps: Vec<Step>, a: &mut Assembler) -> (Vec<Step>, i32) {
        let infos = &self.stretch.infos;
        let mut is_fixed: Vec<bool> = infos.iter().map(|info| info.is_home).collect();
        // A mask register's place in memory costs more than a comparison.
        let stays = |info: &Info| info.keep || info.class == Class::Mask;
        let mut must_stay: Vec<bool> = infos.iter().map(stays).collect();
        for value in &self.carried {
            is_fixed[value.before as usize] = false;
            must_stay[value.after as usize] = true;
        }
        let hoisted = Hoisted::new(&steps, is_fixed, &must_stay);
        if hoisted.before.is_empty() {
            return (steps, 0);
        }
        let bytes = self.stretch.encoding.vector_bytes();
        let mut infos = infos.clone();
        for (k, step) in (0..).zip(&hoisted.before) {
            infos[step.to as usize] = Info {
                class: Class::Vector,
                home: Some(Memory::At(Base::Stack, k * bytes)),
                is_home: false,
                keep: true,
            };
        }
        let mut attempt = a.clone();
        if allocate(&hoisted.before, infos.clone(), &mut attempt).is_err() {
            return (steps, 0);
        }
        *a = attempt;
        for step in &hoisted.before {
            let info = &mut infos[step.to as usize];
            (info.is_home, info.keep) = (true, false);
        }
        self.stretch.infos = infos;
        for left in self.exits.iter_mut().flat_map(Exit::left_mut) {
            left.value = hoisted.kept(left.value);
        }
        let stack_bytes = hoisted.before.len() as i32 * bytes;
        (hoisted.turn, stack_bytes)
    }
}
