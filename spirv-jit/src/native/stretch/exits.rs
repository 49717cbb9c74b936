//! Ends of loops. All lanes come to one at once where the condition is the same in all of them:
//! code jumps, and lanes need no mask. Where lanes leave one after another, code jumps once all
//! have left, so that no turn goes on without a lane. The steps of a turn in the order in which
//! they are written.

use super::turns::{Lanes, Turns};
use super::weave::in_turn;
use super::{Class, Form, Held, IrOperand, Stretch, ValueRow, Virtual};
use crate::native::allocate::{Exit, Left, MOVE, Step, TURNS_TOGETHER};
use crate::native::encode::{Constant, Encoding, Memory};
use crate::native::opcodes::*;

/// Steps that an exit without lanes saves, at least, to pay for its test.
const LEAST_SAVED: usize = 16;

impl Turns {
    /// The number of the next exit of a turn, which is `new` in the first subgroup's code.
    pub(super) fn next_exit(&mut self, new: Exit) -> usize {
        let index = self.exits_so_far;
        self.exits_so_far += 1;
        if index == self.exits.len() {
            self.exits.push(new);
        }
        index
    }

    /// Ends the loop where no lane of any subgroup is in it any more. `lanes`: all that may be.
    pub fn end_without(&mut self, lanes: Lanes) {
        let index = self.next_exit(Exit::Without(Vec::new()));
        self.test_lanes(index, Form::ExitWithout(index), lanes);
    }

    /// Writes a step that tests whether there are lanes, in any subgroup.
    pub(super) fn test_lanes(&mut self, index: usize, form: Form, lanes: Lanes) {
        let lanes = &lanes.0[..self.sides()];
        let s = &mut self.stretch;
        s.step(Class::Vector, MOVE, form, lanes);
        s.step(Class::Vector, MOVE, Form::Hold, lanes);
        if let Exit::Without(all) = &mut self.exits[index] {
            all.extend(lanes);
        }
    }

    /// Drops exits without lanes that save too little, or that are too late: all subgroups and
    /// halves come there before one goes on, so that more values live at once. Returns whether
    /// there is always a lane for the next turn then.
    pub(super) fn settle_exits(&mut self, is_constant: bool) -> bool {
        let is_first = |step: &&Step| matches!(step.subgroup, 0 | TURNS_TOGETHER);
        let of_first = self.stretch.steps.iter().filter(is_first);
        let total = of_first.clone().count();
        let places: Vec<(usize, usize)> = (of_first.enumerate())
            .filter_map(|(at, step)| match step.form {
                Form::ExitWithout(index) => Some((at, index)),
                _ => None,
            })
            .collect();
        let is_alone = self.subgroups == 1 && !self.is_paired;
        let (mut kept, mut next) = (Vec::new(), total);
        for (at, index) in places.into_iter().rev() {
            let is_early = is_alone || 2 * at <= total;
            if !is_constant && is_early && next - at >= LEAST_SAVED {
                kept.push(index);
                next = at;
            }
        }
        drop_exits(&mut self.stretch.steps, |form| match form {
            Form::ExitWithout(index) => !kept.contains(&index),
            _ => false,
        });
        let stay = |index: &usize| match &self.exits[*index] {
            Exit::Without(lanes) => (self.carried.iter())
                .all(|value| value.lanes.is_none() || lanes.contains(&value.after)),
            Exit::All(_) => false,
        };
        kept.iter().any(stay)
    }

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
        let index = self.next_exit(Exit::All(Vec::new()));
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
        if let Exit::All(all) = &mut self.exits[index] {
            all.extend(left);
        }
        true
    }

    /// Whether the lanes that take the loop stay the same from turn to turn. If so, exits take them
    /// from memory.
    pub(super) fn settle_lanes(&mut self) -> bool {
        let is_constant =
            (self.carried.iter()).all(|value| value.lanes.is_none() || value.before == value.after);
        if is_constant {
            let mut is_behind = false;
            for step in &mut self.stretch.steps {
                match step.form {
                    Form::Hold if is_behind => step.count = 1,
                    Form::Hold => {}
                    form => is_behind = matches!(form, Form::Exit { .. }),
                }
            }
            let left = self.exits.iter_mut().flat_map(Exit::left_mut);
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

/// Drops some steps that all subgroups come to at once.
pub(super) fn drop_exits(steps: &mut Vec<Step>, drops: impl Fn(Form) -> bool) {
    let mut is_dropped = false;
    steps.retain(|step| {
        is_dropped = match step.form {
            Form::Hold => is_dropped,
            form => drops(form),
        };
        !is_dropped
    });
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
            let is_before = |step: &Step| !step.form.is_common();
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
