//! Live ranges over the tree in its textual order, and rows for them.
//!
//! Control flow being structured, a range is one interval of positions, and that is exact enough for lanes that wait: a value that
//! parked or pending lanes still need has its use at a later position. Three rules make it so: a value used inside a loop but defined outside
//! lives until the loop's end; results of a construct live from the construct's start, since lanes write them while
//! others are still inside; parameters of a loop live through all of it.
//!
//! What a descriptor that is live where a wave can be suspended was made of is live there, too.
//!
//! Position `p` has two half-steps: operands that may share a row with the result are used at `2p`, others at `2p + 1`; results
//! are defined at `2p + 1`.

use super::coalesce::{Candidate, candidates};
use super::fusion::Fusion;
use crate::ir::op::Signature;
use crate::ir::{Body, Function, Inst, Node, Op, Terminator, Type, Value};

/// A value's first and last half-step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub value: Value,
    pub start: u32,
    pub end: u32,
}

/// Rows of a function's vector values.
pub(super) struct Slots {
    /// By value: first row, relative to the function's; `u32::MAX` for values without one.
    pub row: Vec<u32>,
    /// By value: something uses it.
    pub used: Vec<bool>,
    /// In order of their starts, for finding what lives at a position.
    ranges: Vec<Range>,
    /// Rows used.
    pub rows: u32,
}

impl Slots {
    /// Values that live across a position: defined before it and used after it.
    pub fn live_across(&self, position: u32) -> impl Iterator<Item = Value> + '_ {
        self.live(2 * position, 2 * position + 1)
    }

    /// Parameters that the function uses.
    pub fn live_at_start(&self) -> impl Iterator<Item = Value> + '_ {
        self.live(1, 1)
    }

    fn live(&self, before: u32, after: u32) -> impl Iterator<Item = Value> + '_ {
        let begun = self.ranges.partition_point(|range| range.start <= before);
        self.ranges[..begun]
            .iter()
            .filter(move |range| range.end > after)
            .map(|range| range.value)
    }
}

/// Walks a function in the order that gives nodes their positions. The emitter must count in the same way: one position for each
/// instruction and terminator; a `block` has one at its start and one at its end, an `if` also one at its `else`, a loop as a block.
struct Walk<'f> {
    uniform: &'f [bool],
    fusion: &'f Fusion,
    ranges: Vec<Option<(u32, u32)>>,
    /// By value: its last use's half-step, or 0. A range may be longer.
    last_use: Vec<u32>,
    position: u32,
    /// Open loops: position, and values from outside that are used inside.
    loops: Vec<(u32, Vec<Value>)>,
    /// Positions where the wave can be suspended, ascending.
    suspensions: Vec<u32>,
    /// Descriptors, and what they are made of.
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
        let outermost = self.loops.iter_mut().find(|(at, _)| 2 * *at + 1 > start);
        if let Some((_, values)) = outermost
            && values.last() != Some(&value)
        {
            values.push(value);
        }
    }

    fn body(&mut self, body: &Body) {
        for node in &body.nodes {
            self.node(node);
            if matches!(node, Node::Loop { .. }) {
                // Nothing comes out of a loop's end: what follows it is not reached.
                return;
            }
        }
        let position = self.position;
        self.position += 1;
        let args = match &body.end {
            Terminator::Br(_, args) | Terminator::Return(args) | Terminator::End(args) => args,
            Terminator::Unreachable => return,
        };
        for &arg in args {
            self.use_at(arg, 2 * position + 1);
        }
    }

    fn node(&mut self, node: &Node) {
        let position = self.position;
        self.position += 1;
        match node {
            Node::Inst(inst) if self.fusion.absorbs(inst) => {}
            Node::Inst(inst) => {
                if let Some(fused) = self.fusion.of(inst) {
                    for &arg in fused.operands.iter().flatten() {
                        self.use_at(arg, 2 * position);
                    }
                    self.define(inst.results[0], position);
                    return;
                }
                let late = !shares_rows(inst);
                for arg in self.fusion.reads(inst) {
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
            Node::Block { results, body, .. } => {
                for &result in results {
                    self.define(result, position);
                }
                self.body(body);
                self.close(results);
            }
            Node::If {
                condition,
                results,
                then_body,
                else_body,
                ..
            } => {
                self.use_at(*condition, 2 * position + 1);
                for &result in results {
                    self.define(result, position);
                }
                self.body(then_body);
                self.position += 1;
                self.body(else_body);
                self.close(results);
            }
            Node::Loop {
                params, init, body, ..
            } => {
                for &value in init {
                    self.use_at(value, 2 * position + 1);
                }
                self.loops.push((position, Vec::new()));
                for &param in params {
                    self.define(param, position);
                }
                self.body(body);
                let end = 2 * self.position + 2;
                self.suspensions.push(self.position);
                self.position += 1;
                let (_, inside) = self.loops.pop().expect("pushed above");
                for value in inside.into_iter().chain(params.iter().copied()) {
                    if let Some((_, last)) = &mut self.ranges[value.index()] {
                        *last = end.max(*last);
                    }
                }
            }
        }
    }

    /// A descriptor that lives across a suspension is made again there: what it is made of lives as long.
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
        self.position += 1;
    }
}

/// Whether a result may lie where an operand that dies here lay: elementwise, and all of one width.
fn shares_rows(inst: &Inst) -> bool {
    matches!(
        inst.op.signature(),
        Signature::IntUnary
            | Signature::IntBinary
            | Signature::FloatUnary
            | Signature::FloatBinary
            | Signature::FloatTernary
    )
}

/// Gives each vector value of a function its rows.
pub(super) fn allocate(function: &Function, uniform: &[bool], fusion: &Fusion) -> Slots {
    let mut walk = Walk {
        uniform,
        fusion,
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
    let into = coalesce(function, &walk);

    let mut ranges: Vec<Range> = walk
        .ranges
        .iter()
        .enumerate()
        .filter_map(|(index, range)| {
            range.map(|(start, end)| Range {
                value: Value(index as u32),
                start,
                end,
            })
        })
        .collect();
    ranges.sort_by_key(|range| range.start);

    let mut slots = Slots {
        used: walk.last_use.iter().map(|&at| at != 0).collect(),
        row: vec![u32::MAX; function.value_types.len()],
        ranges: Vec::new(),
        rows: 0,
    };
    let mut free = FreeRows::default();
    let mut ending = Ending::new(&ranges);
    for (index, range) in ranges.iter().enumerate() {
        if into[range.value.index()].is_some() {
            continue;
        }
        ending.take_before(range.start, |index| {
            let value = ranges[index].value;
            free.release(slots.row[value.index()], rows_of(function, value));
        });
        slots.row[range.value.index()] = free.take(rows_of(function, range.value));
        ending.push(index, range.end);
    }
    for range in &ranges {
        let mut owner = range.value;
        while let Some(next) = into[owner.index()] {
            owner = next;
        }
        slots.row[range.value.index()] = slots.row[owner.index()];
    }
    slots.rows = free.taken.len() as u32;
    slots.ranges = ranges;
    slots
}

/// By value: whose row it shares, where that row is free when the value is defined (see [`super::coalesce`]). The other value's range
/// covers its own.
fn coalesce(function: &Function, walk: &Walk<'_>) -> Vec<Option<Value>> {
    let mut into = vec![None; function.value_types.len()];
    let mut taken = vec![false; function.value_types.len()];
    for Candidate {
        from,
        to,
        is_parameter,
    } in candidates(&function.body)
    {
        let (Some((start, end)), Some((to_start, to_end))) =
            (walk.ranges[from.index()], walk.ranges[to.index()])
        else {
            continue;
        };
        let free = !is_parameter || walk.last_use[to.index()] < start;
        let covered = to_start <= start && end <= to_end;
        if covered
            && free
            && into[from.index()].is_none()
            && !taken[to.index()]
            && rows_of(function, from) == rows_of(function, to)
        {
            into[from.index()] = Some(to);
            taken[to.index()] = true;
        }
    }
    into
}

fn rows_of(function: &Function, value: Value) -> u32 {
    Type::rows(function.ty(value))
}

/// Ranges by the half-step that they end at.
struct Ending {
    /// By half-step: the newest of its ranges, plus one.
    newest: Vec<u32>,
    /// By range: the one before it in its half-step, plus one.
    before: Vec<u32>,
    /// What ends before this half-step has been taken.
    taken: u32,
}

impl Ending {
    fn new(ranges: &[Range]) -> Self {
        let last = ranges.iter().map(|range| range.end).max();
        Self {
            newest: vec![0; last.map_or(0, |last| last as usize + 1)],
            before: vec![0; ranges.len()],
            taken: 0,
        }
    }

    fn push(&mut self, index: usize, end: u32) {
        let newest = &mut self.newest[end as usize];
        self.before[index] = std::mem::replace(newest, index as u32 + 1);
    }

    /// Takes the ranges that end before a half-step.
    fn take_before(&mut self, half_step: u32, mut take: impl FnMut(usize)) {
        for at in self.taken..half_step.min(self.newest.len() as u32) {
            let mut next = self.newest[at as usize];
            while let Some(index) = next.checked_sub(1) {
                take(index as usize);
                next = self.before[index as usize];
            }
        }
        self.taken = self.taken.max(half_step);
    }
}

/// First-fit allocation of one row or two neighbours.
#[derive(Default)]
struct FreeRows {
    taken: Vec<bool>,
    /// No free row lies below.
    lowest: usize,
}

impl FreeRows {
    fn take(&mut self, count: u32) -> u32 {
        let count = count as usize;
        let mut row = self.lowest;
        while (row..row + count).any(|r| self.taken.get(r).copied().unwrap_or(false)) {
            row += 1;
        }
        if self.taken.len() < row + count {
            self.taken.resize(row + count, false);
        }
        self.taken[row..row + count].fill(true);
        while self.taken.get(self.lowest).copied().unwrap_or(false) {
            self.lowest += 1;
        }
        row as u32
    }

    fn release(&mut self, row: u32, count: u32) {
        let (row, count) = (row as usize, count as usize);
        self.taken[row..row + count].fill(false);
        self.lowest = self.lowest.min(row);
    }
}
