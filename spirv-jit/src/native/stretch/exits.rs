//! Ends of loops that all lanes come to at once: the condition is the same in all of them, so that
//! code jumps, and lanes need no mask. The steps of a turn in the order in which they are written.

use super::turns::{Lanes, Turns};
use super::weave::in_turn;
use super::{Class, Form, Held, IrOperand, Stretch, ValueRow, Virtual};
use crate::native::allocate::{Exit, Left, MOVE, Step, TURNS_TOGETHER};
use crate::native::encode::{Constant, Encoding, Memory};
use crate::native::opcodes::*;

impl Turns {
    /// All lanes leave the loop where a condition that is the same in all of them, and in all
    /// subgroups, is `when`; they take values along to rows. False if there is no such code: lanes
    /// have parted before, or masks are cheaper.
    pub fn leave_together(
        &mut self,
        lanes: Lanes,
        (condition, when): (&IrOperand, bool),
        values: &[(IrOperand, ValueRow)],
    ) -> bool {
        let entered = self.lanes.expect("a turn has begun");
        if lanes.0 != entered.0 {
            return false;
        }
        let index = self.exits_so_far;
        self.exits_so_far += 1;
        if index == self.exits.len() {
            self.exits.push(Exit::default());
        }
        let sides = self.sides();
        let s = &mut self.stretch;
        s.half = (sides == 2).then_some(0);
        let Held::One(condition) = s.operand(condition) else {
            return false;
        };
        s.half = None;
        let (condition, when) = match s.complement(condition) {
            Some(other) => (other, !when),
            None => (condition, when),
        };
        let mut left = Vec::new();
        for (half, &lanes) in lanes.0.iter().enumerate().take(sides) {
            s.half = (sides == 2).then_some(half as i32);
            for (value, row) in values {
                let held = s.operand(value);
                let place = IrOperand {
                    row: *row,
                    ..*value
                };
                let is_wide = matches!(held, Held::Two(..));
                for (k, part) in held.parts().enumerate() {
                    left.push(Left {
                        value: part,
                        row: s.home(&place, k as i32).expect("a row"),
                        mask: 2 * s.subgroup as i32 + half as i32,
                        lanes: Some(lanes),
                        part: is_wide.then_some(k),
                    });
                }
            }
        }
        s.half = None;
        let op = match s.encoding {
            Encoding::Vex => TESTPS,
            Encoding::Evex => KORTESTW,
        };
        s.step(Class::Vector, op, Form::Exit { index, when }, &[condition]);
        for left in &left {
            let lanes = left.lanes.expect("as above");
            s.step(Class::Vector, MOVE, Form::Hold, &[left.value, lanes]);
        }
        s.operations += 1;
        self.exits[index].left.extend(left);
        true
    }

    /// Whether the lanes that take the loop stay the same from turn to turn. If so, exits take them
    /// from memory.
    pub(super) fn settle_lanes(&mut self) -> bool {
        let is_constant =
            (self.carried.iter()).all(|value| value.lanes.is_none() || value.before == value.after);
        if is_constant {
            for step in &mut self.stretch.steps {
                if step.form == Form::Hold {
                    step.count = 1;
                }
            }
            let left = self.exits.iter_mut().flat_map(|exit| &mut exit.left);
            left.for_each(|left| left.lanes = None);
        }
        is_constant
    }
}

impl Stretch {
    /// The condition that another one is the complement of.
    fn complement(&self, condition: Virtual) -> Option<Virtual> {
        let step = self.steps.iter().rev().find(|step| step.to == condition)?;
        let is_ones = |value: Virtual| {
            let ones = self
                .pool
                .iter()
                .position(|c| *c == Constant::Word(u32::MAX));
            let home = self.infos[value as usize].home;
            ones.is_some_and(|ones| home == Some(Memory::Pool(ones as u32)))
        };
        let is_not = match step.op {
            PXOR => step.form == Form::Commutative && is_ones(step.from[1]),
            op => op == KNOT,
        };
        is_not.then_some(step.from[0])
    }
}

/// The steps of a turn of so many subgroups in the order in which they are written: those of
/// subgroups and halves alternating by operation where `is_woven`, else all of one half before
/// those of the other. Where all lanes may leave, all subgroups come to the same point. `None` if a
/// step would come before the one whose result it takes.
pub(super) fn ordered(
    steps: &[Step],
    values: usize,
    subgroups: usize,
    is_woven: bool,
) -> Option<Vec<Step>> {
    let of_subgroup = |subgroup: usize| {
        let is_own = move |step: &&Step| match step.subgroup {
            TURNS_TOGETHER => subgroup == 0,
            own => own as usize == subgroup,
        };
        steps.iter().filter(is_own).copied().peekable()
    };
    let mut copies: Vec<_> = (0..subgroups).map(of_subgroup).collect();
    let mut all: Vec<Step> = Vec::with_capacity(steps.len());
    loop {
        let mut segments: Vec<Vec<Step>> = Vec::new();
        for copy in &mut copies {
            let is_before = |step: &Step| !matches!(step.form, Form::Exit { .. });
            segments.push(std::iter::from_fn(|| copy.next_if(is_before)).collect());
        }
        match is_woven {
            true => all.extend(in_turn(&segments)),
            false => all.extend(halves_apart(segments.concat())),
        }
        let mut exits = copies.iter_mut().map(|copy| copy.next());
        let Some(exit) = exits.next().flatten() else {
            break;
        };
        exits.for_each(drop);
        all.push(exit);
        for copy in &mut copies {
            all.extend(std::iter::from_fn(|| {
                copy.next_if(|step| step.form == Form::Hold)
            }));
        }
    }
    let mut is_ahead = vec![false; values];
    for step in &all {
        is_ahead[step.to as usize] = true;
        (step.more.iter().flatten()).for_each(|&value| is_ahead[value as usize] = true);
    }
    for step in &all {
        if (step.from[..step.count].iter()).any(|&value| is_ahead[value as usize]) {
            return None;
        }
        is_ahead[step.to as usize] = false;
        (step.more.iter().flatten()).for_each(|&value| is_ahead[value as usize] = false);
    }
    Some(all)
}

/// All that one half does before what the other does, up to each step that takes both.
fn halves_apart(steps: Vec<Step>) -> Vec<Step> {
    let mut apart = Vec::with_capacity(steps.len());
    let mut second = Vec::new();
    for step in steps {
        match step.half {
            Some(0) => apart.push(step),
            Some(_) => second.push(step),
            None => {
                apart.append(&mut second);
                apart.push(step);
            }
        }
    }
    apart.append(&mut second);
    apart
}
