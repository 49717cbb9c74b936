//! The way of lanes through a turn of a loop, while its native code is written.

use foldhash::{HashMap, HashSet};

use crate::interp::operand::Operand;
use crate::ir::{Label, Value};
use crate::native::{Lanes, Merged, Turns};

/// A construct inside the loop.
pub(super) struct Open<'m> {
    pub label: Label,
    pub results: &'m [Value],
    /// Lanes that have come to its end, and what its results are then.
    pub joined: Option<(Lanes, Vec<Merged>)>,
    /// Lanes for the second body.
    pub pending: Option<Lanes>,
    /// The number of the body that is being written, which may be jumped over, and its lanes.
    pub body: Option<(usize, Lanes)>,
}

/// The way of lanes through a turn.
pub(super) struct Ways<'m> {
    pub turns: Turns,
    pub open: Vec<Open<'m>>,
    /// Where lanes are; `None`: there are none.
    pub lanes: Option<Lanes>,
    pub branches: usize,
    /// Mask of the label that lanes leave to.
    pub left_to: Option<u32>,
    /// Lanes have left the loop, and code has not tested whether others are in it.
    pub has_left: bool,
    /// As [`LoopPlan`](crate::interp::code::LoopPlan) has them.
    pub regions: Vec<(Operand, bool)>,
    /// Values that are the same in all lanes that come to them.
    pub alike: HashSet<Value>,
    /// Those of them that are the same in all subgroups that take the loop together.
    pub shared: HashSet<Value>,
    /// Products with constants, and what lanes have in common added: how far apart the values of
    /// neighbouring lanes are, if those were multiplied that are one apart.
    pub distances: HashMap<Value, u32>,
    /// Words that are not greater than a number.
    pub bounds: HashMap<Value, u32>,
    /// Values that operations and branches take.
    pub used: HashSet<Value>,
}

impl Ways<'_> {
    /// Whether there may be lanes in the loop that are elsewhere.
    fn are_elsewhere(&self) -> bool {
        let mut open = self.open.iter();
        open.any(|open| open.joined.is_some() || open.pending.is_some())
    }

    /// Ends the loop where all lanes have left it, if those that are here are all others.
    pub fn end_without(&mut self) {
        if let Some(lanes) = self.lanes
            && self.has_left
            && !self.are_elsewhere()
        {
            self.has_left = false;
            self.turns.end_without(lanes);
        }
    }

    /// Begins a body of the innermost branch, over which code may jump.
    pub fn begin_body(&mut self) {
        if let Some(lanes) = self.lanes
            && self.are_elsewhere()
        {
            let number = self.turns.begin_body(lanes);
            if let Some(open) = self.open.last_mut() {
                open.body = Some((number, lanes));
            }
        }
    }

    /// Ends the innermost construct's body. Takes the lanes that have come to its end.
    pub fn end_body(&mut self) -> Option<Lanes> {
        let lanes = self.lanes.take();
        match self.open.last_mut().and_then(|open| open.body.take()) {
            Some((number, entered)) => self.turns.end_body(number, entered, lanes),
            None => lanes,
        }
    }

    /// Lanes are about to join others at a construct's end: the bodies inside it that they come
    /// from are written for all turns.
    pub fn join_outside(&mut self, depth: usize) {
        for open in &mut self.open[depth..] {
            if let Some((number, _)) = open.body.take() {
                self.turns.keep_body(number);
            }
        }
    }
}
