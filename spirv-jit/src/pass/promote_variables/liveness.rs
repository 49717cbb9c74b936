//! The cells that a construct must pass on: those that are stored inside it and may be read after
//! it (or, for a loop, in its next iteration).

use super::cells::{Cells, Promotion};
use crate::ir::{Body, Label, Node, Op, Step, Terminator};

/// A function's control flow and promoted accesses as a list, so that it can be read in both
/// directions.
#[derive(Clone, Copy)]
enum Event {
    Load(u32),
    Store(u32),
    EnterBlock,
    LeaveBlock(Label),
    EnterLoop(Label),
    LeaveLoop(Label),
    EnterIf,
    Else,
    LeaveIf(Label),
    Br(Label),
    /// Leaves the function.
    Exit,
}

/// Candidates that a construct may have to pass on.
#[derive(Clone, Default)]
pub struct Candidates {
    /// Cells stored inside, in order.
    pub stored: Vec<u32>,
    /// For each, whether it may be read after the construct (in a loop: from its head), without
    /// another iteration of an enclosing loop.
    pub live: Vec<bool>,
}

/// Finds the candidates of each construct, by label.
///
/// The cost is the number of bodies times the number of cells over 64. A cell that lives around an
/// enclosing loop is the caller's to add: it is a parameter of that loop.
pub fn find_candidates(body: &Body, labels: u32, cells: &Cells) -> Vec<Candidates> {
    let events = list_events(body, cells);
    let mut candidates = collect_stored(&events, labels);
    mark_live(&events, cells.types.len(), &mut candidates);
    candidates
}

fn list_events(body: &Body, cells: &Cells) -> Vec<Event> {
    let mut events = Vec::new();
    let mut promotions = cells.promotions.iter();
    for step in body.steps() {
        let event = match step {
            Step::Inst(inst) => {
                let event: fn(u32) -> Event = match inst.op {
                    Op::VarLoad(..) => Event::Load,
                    Op::VarStore(..) => Event::Store,
                    _ => continue,
                };
                match promotions.next().copied().unwrap_or(Promotion::Keep) {
                    Promotion::Keep => continue,
                    Promotion::Cell(cell) => event(cell),
                    Promotion::Pair(cell) => {
                        events.push(event(cell));
                        event(cell + 1)
                    }
                }
            }
            Step::Open(Node::If { .. }) => Event::EnterIf,
            Step::Open(Node::Loop { label, .. }) => Event::EnterLoop(*label),
            Step::Open(_) => Event::EnterBlock,
            Step::Else(_) => Event::Else,
            Step::Close(Node::If { label, .. }) => Event::LeaveIf(*label),
            Step::Close(Node::Loop { label, .. }) => Event::LeaveLoop(*label),
            Step::Close(Node::Block { label, .. }) => Event::LeaveBlock(*label),
            Step::Close(Node::Inst(_)) => continue,
            Step::End(body) => match &body.end {
                Terminator::Br(label, _) => Event::Br(*label),
                _ => Event::Exit,
            },
        };
        events.push(event);
    }
    events
}

fn collect_stored(events: &[Event], labels: u32) -> Vec<Candidates> {
    let mut candidates = vec![Candidates::default(); labels as usize];
    let mut open: Vec<Vec<u32>> = vec![Vec::new()];
    for event in events {
        match *event {
            Event::Store(cell) => open.last_mut().expect("a body is open").push(cell),
            Event::EnterBlock | Event::EnterIf | Event::EnterLoop(_) => open.push(Vec::new()),
            Event::LeaveBlock(label) | Event::LeaveIf(label) | Event::LeaveLoop(label) => {
                let mut stored = open.pop().expect("entered");
                stored.sort_unstable();
                stored.dedup();
                open.last_mut().expect("a body is open").extend(&stored);
                candidates[label.index()] = Candidates {
                    live: vec![false; stored.len()],
                    stored,
                };
            }
            _ => {}
        }
    }
    candidates
}

fn mark_live(events: &[Event], cell_count: usize, candidates: &mut [Candidates]) {
    let mut live = CellSet::empty(cell_count);
    let mut at_label: Vec<Option<CellSet>> = vec![None; candidates.len()];
    let mut at_else = Vec::new();
    for event in events.iter().rev() {
        match *event {
            Event::Load(cell) => live.insert(cell),
            Event::Store(cell) => live.remove(cell),
            Event::LeaveBlock(label) | Event::LeaveIf(label) => {
                candidates[label.index()].mark(&live);
                at_label[label.index()] = Some(live.clone());
            }
            // The loop-carried cells are unknown yet; see `EnterLoop`.
            Event::LeaveLoop(label) => {
                at_label[label.index()] = Some(CellSet::empty(cell_count));
            }
            // Liveness at the head is exact now: the back-edge adds only cells that pass through
            // from the head itself.
            Event::EnterLoop(label) => candidates[label.index()].mark(&live),
            Event::EnterBlock => {}
            Event::Else => at_else.push(live.clone()),
            Event::EnterIf => live.union(&at_else.pop().expect("an else before its if")),
            Event::Br(label) => live.copy_from(at_label[label.index()].as_ref()),
            Event::Exit => live.copy_from(None),
        }
    }
}

impl Candidates {
    fn mark(&mut self, live: &CellSet) {
        for (cell, is_live) in self.stored.iter().zip(&mut self.live) {
            *is_live = live.contains(*cell);
        }
    }
}

#[derive(Clone)]
struct CellSet {
    words: Vec<u64>,
}

impl CellSet {
    fn empty(count: usize) -> Self {
        Self {
            words: vec![0; count.div_ceil(64)],
        }
    }

    fn insert(&mut self, cell: u32) {
        self.words[cell as usize / 64] |= 1 << (cell % 64);
    }

    fn remove(&mut self, cell: u32) {
        self.words[cell as usize / 64] &= !(1 << (cell % 64));
    }

    fn contains(&self, cell: u32) -> bool {
        self.words[cell as usize / 64] >> (cell % 64) & 1 != 0
    }

    fn union(&mut self, other: &CellSet) {
        for (word, other) in self.words.iter_mut().zip(&other.words) {
            *word |= other;
        }
    }

    fn copy_from(&mut self, other: Option<&CellSet>) {
        match other {
            Some(other) => self.words.copy_from_slice(&other.words),
            None => self.words.fill(0),
        }
    }
}
