//! Rows for a function's values, by their live ranges.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::ir::{Function, Type, Value};
use crate::plan::{Candidate, Liveness, candidates};

/// Rows of a function's vector values.
pub(super) struct Slots {
    /// By value: first row, relative to the function's; `u32::MAX` for values without one.
    pub row: Vec<u32>,
    /// By value: something uses it.
    pub used: Vec<bool>,
    /// Rows used.
    pub rows: u32,
}

/// Gives each vector value of a function its rows.
pub(super) fn allocate(function: &Function, liveness: &Liveness) -> Slots {
    let into = coalesce(function, liveness);

    let mut slots = Slots {
        used: liveness.last_use.iter().map(|&at| at != 0).collect(),
        row: vec![u32::MAX; function.value_types.len()],
        rows: 0,
    };
    let ranges: Vec<(Value, u32, u32)> = (liveness.by_start.iter())
        .filter_map(|&value| liveness.ranges[value.index()].map(|(start, end)| (value, start, end)))
        .collect();
    // Rows of 32-bit lanes and pairs of rows lie apart, so that native code may compute one half of
    // the lanes after the other: neither then overwrites what the other's half reads.
    let mut free = [FreeRows::default(), FreeRows::default()];
    let mut ending = Ending::new(&ranges);
    for (index, &(value, start, end)) in ranges.iter().enumerate() {
        if into[value.index()].is_some() {
            continue;
        }
        ending.take_before(start, |index| {
            let (value, ..) = ranges[index];
            let rows = rows_of(function, value);
            free[rows as usize - 1].release(slots.row[value.index()]);
        });
        let rows = rows_of(function, value);
        slots.row[value.index()] = free[rows as usize - 1].take(rows);
        ending.push(index, end);
    }
    let [single, double] = free.map(|free| free.end);
    for &(value, ..) in &ranges {
        if into[value.index()].is_none() && rows_of(function, value) == 2 {
            slots.row[value.index()] += single;
        }
    }
    for &(value, ..) in &ranges {
        let mut owner = value;
        while let Some(next) = into[owner.index()] {
            owner = next;
        }
        slots.row[value.index()] = slots.row[owner.index()];
    }
    slots.rows = single + double;
    slots
}

/// By value: whose row it shares, where that row is free when the value is defined (see
/// [`candidates`]). The other value's range covers its own.
fn coalesce(function: &Function, liveness: &Liveness) -> Vec<Option<Value>> {
    let mut into = vec![None; function.value_types.len()];
    let mut taken = vec![false; function.value_types.len()];
    for Candidate {
        from,
        to,
        is_parameter,
    } in candidates(&function.body)
    {
        let (Some((start, end)), Some((to_start, to_end))) =
            (liveness.ranges[from.index()], liveness.ranges[to.index()])
        else {
            continue;
        };
        let free = !is_parameter || liveness.last_use[to.index()] < start;
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
    /// Intervals that end before this half-step have been taken.
    taken: u32,
}

impl Ending {
    fn new(ranges: &[(Value, u32, u32)]) -> Self {
        let last = ranges.iter().map(|&(_, _, end)| end).max();
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

/// First-fit allocation of rows, or of pairs of rows.
#[derive(Default)]
struct FreeRows {
    /// Rows below the end that nothing has, the first one on top.
    free: BinaryHeap<Reverse<u32>>,
    end: u32,
}

impl FreeRows {
    /// `count`: the same each time.
    fn take(&mut self, count: u32) -> u32 {
        if let Some(Reverse(row)) = self.free.pop() {
            return row;
        }
        self.end += count;
        self.end - count
    }

    fn release(&mut self, row: u32) {
        self.free.push(Reverse(row));
    }
}
