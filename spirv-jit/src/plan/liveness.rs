//! Live ranges over the tree in its textual order.
//!
//! Control flow is structured, so a range is one interval of positions. That is exact enough for
//! waiting lanes: a value that parked or pending lanes still need has a use at a later position.
//! Three rules ensure this: a value defined outside of a loop and used inside lives until the
//! loop's end; results of a construct live from its start, since lanes write them while others are
//! still inside; parameters of a loop live through the whole loop.
//!
//! Values from which a descriptor is computed live wherever the descriptor lives and a wave can be
//! suspended.
//!
//! Position `p` has two half-steps: operands that may share a row with the result are used at `2p`,
//! others at `2p + 1`; results are defined at `2p + 1`.

use std::ops::Range;

use crate::ir::op::Signature;
use crate::ir::{Body, Function, Inst, Node, Op, Step, Value};

/// The live ranges of a function's values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Liveness {
    /// By value: first and last half-step; `None` for uniform and for unused values.
    pub ranges: Vec<Option<(u32, u32)>>,
    /// By value: its last use's half-step, or 0. A range may be longer.
    pub last_use: Vec<u32>,
    /// Values with a range in the order of their starts.
    pub by_start: Vec<Value>,
}

impl Liveness {
    /// Computes the ranges of a function, whose uniform values live everywhere.
    pub fn of(function: &Function, uniform: &[bool]) -> Liveness {
        let mut walk = Walk {
            uniform,
            ranges: vec![None; function.value_types.len()],
            last_use: vec![0; function.value_types.len()],
            position: 1,
            loops: Vec::new(),
            suspensions: Vec::new(),
            descriptors: Vec::new(),
        };
        for &param in &function.params {
            walk.define(param, 0);
        }
        walk.body(&function.body);
        walk.extend_origins();
        let values = (0..walk.ranges.len() as u32).map(Value);
        let mut by_start: Vec<Value> = values
            .filter(|value| walk.ranges[value.index()].is_some())
            .collect();
        by_start.sort_by_key(|value| walk.ranges[value.index()].map(|(start, _)| start));
        Liveness {
            ranges: walk.ranges,
            last_use: walk.last_use,
            by_start,
        }
    }

    /// The start of a function, where its parameters live.
    pub const START: HalfSteps = HalfSteps {
        before: 1,
        after: 1,
    };

    /// Values that are defined before a position and used after it live across it.
    pub fn across(position: u32) -> HalfSteps {
        HalfSteps {
            before: 2 * position,
            after: 2 * position + 1,
        }
    }

    /// The points, in the order of a function, at which a value lives.
    pub fn places(&self, value: Value, places: &[HalfSteps]) -> Range<usize> {
        let Some((start, end)) = self.ranges[value.index()] else {
            return 0..0;
        };
        let first = places.partition_point(|place| place.before < start);
        let last = places.partition_point(|place| place.after < end);
        first..last.max(first)
    }
}

/// A point in a function. A value lives there if it starts at the first half-step or before, and
/// ends after the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HalfSteps {
    pub before: u32,
    pub after: u32,
}

/// Walks a function in the order that gives nodes their positions: one for each instruction and
/// terminator; a `block` has one at its start and one at its end, an `if` also one at its `else`, a
/// loop as a block. [`save_points`](super::save_points) counts in the same way.
struct Walk<'f> {
    uniform: &'f [bool],
    ranges: Vec<Option<(u32, u32)>>,
    last_use: Vec<u32>,
    position: u32,
    /// Open loops: position, and values from outside that are used inside.
    loops: Vec<(u32, Vec<Value>)>,
    /// Positions where the wave can be suspended, ascending.
    suspensions: Vec<u32>,
    /// Descriptors, and the values that they are made of.
    descriptors: Vec<(Value, Value)>,
}

impl Walk<'_> {
    fn define(&mut self, value: Value, position: u32) {
        if !self.uniform[value.index()] {
            let at = 2 * position + 1;
            self.ranges[value.index()] = Some((at, at));
        }
    }

    fn use_at(&mut self, value: Value, half_step: u32) {
        let last = &mut self.last_use[value.index()];
        *last = half_step.max(*last);
        let Some((start, end)) = &mut self.ranges[value.index()] else {
            return;
        };
        *end = half_step.max(*end);
        let start = *start;
        let outermost = self.loops.partition_point(|(at, _)| 2 * *at < start);
        if let Some((_, values)) = self.loops.get_mut(outermost)
            && values.last() != Some(&value)
        {
            values.push(value);
        }
    }

    fn body(&mut self, body: &Body) {
        let mut steps = body.steps();
        while let Some(step) = steps.next() {
            let position = self.position;
            match step {
                Step::Inst(inst) => self.inst(inst, position),
                Step::Open(node) => self.open(node, position),
                Step::Else(_) => {}
                Step::End(body) => {
                    for &arg in body.end.operands() {
                        self.use_at(arg, 2 * position + 1);
                    }
                }
                Step::Close(Node::Loop { params, .. }) => {
                    self.close_loop(params);
                    // The end of a loop is unreachable.
                    steps.skip_rest();
                }
                Step::Close(node) => self.close(node.definitions()),
            }
            self.position += 1;
        }
    }

    fn inst(&mut self, inst: &Inst, position: u32) {
        let late = !shares_rows(inst);
        for &arg in &inst.args {
            self.use_at(arg, 2 * position + late as u32);
        }
        for &result in &inst.results {
            self.define(result, position);
        }
        if inst.op.is_yield() || matches!(inst.op, Op::Call(_)) {
            self.suspensions.push(position);
        }
        if inst.op.gives_descriptor()
            && let Some(&from) = inst.args.first()
        {
            self.descriptors.push((inst.results[0], from));
        }
    }

    fn open(&mut self, node: &Node, position: u32) {
        for &value in node.operands() {
            self.use_at(value, 2 * position + 1);
        }
        if let Node::Loop { .. } = node {
            self.loops.push((position, Vec::new()));
        }
        for &value in node.definitions() {
            self.define(value, position);
        }
    }

    fn close_loop(&mut self, params: &[Value]) {
        let end = 2 * self.position + 2;
        self.suspensions.push(self.position);
        let (_, inside) = self.loops.pop().expect("an open loop");
        for value in inside.into_iter().chain(params.iter().copied()) {
            if let Some((_, last)) = &mut self.ranges[value.index()] {
                *last = end.max(*last);
            }
        }
    }

    /// A descriptor that lives across a suspension is recomputed there, so its operands live as
    /// long.
    fn extend_origins(&mut self) {
        for &(descriptor, from) in &self.descriptors {
            let Some((start, end)) = self.ranges[descriptor.index()] else {
                continue;
            };
            let after = self.suspensions.partition_point(|&at| 2 * at < start);
            let next = self.suspensions.get(after);
            if next.is_none_or(|&at| 2 * at + 1 >= end) {
                continue;
            }
            if let Some((_, last)) = &mut self.ranges[from.index()] {
                *last = end.max(*last);
            }
            let last = &mut self.last_use[from.index()];
            *last = end.max(*last);
        }
    }

    /// The end of a construct: its results live at least until here.
    fn close(&mut self, results: &[Value]) {
        for result in results {
            if let Some((_, end)) = &mut self.ranges[result.index()] {
                *end = (2 * self.position + 2).max(*end);
            }
        }
    }
}

/// Whether a result may reuse the row of an operand that dies here: elementwise operations with one
/// width.
fn shares_rows(inst: &Inst) -> bool {
    matches!(
        inst.op.signature(),
        Signature::BitsUnary
            | Signature::BitsBinary
            | Signature::IntUnary
            | Signature::IntBinary
            | Signature::FloatUnary
            | Signature::FloatFunction
            | Signature::FloatBinary
            | Signature::FloatTernary
    )
}
