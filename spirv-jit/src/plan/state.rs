//! Subgroups' states: their start, their control rows, and moves of lanes between them.
//!
//! A state's control rows hold, as words: the resume id, the active lanes, the helper lanes, the
//! [`HeldOperands`] that its io rows hold, then the masks in use, two to a word.

use lanes::{AlignedRow, LaneMask};

use super::{CallSite, Plan, SavePoint};
use crate::SUBGROUP_SIZE;

/// Words of control before the masks.
pub(crate) const CONTROL_WORDS: usize = HELD_OPERANDS + size_of::<HeldOperands>() / 4;

/// The control word where [`HeldOperands`] begin.
const HELD_OPERANDS: usize = 4;

/// The yield whose operands that are uniform in a dispatch stand in a state's io rows, in all
/// lanes. The default is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub(crate) struct HeldOperands {
    /// Number of the program.
    pub program: u64,
    /// Number of the environment.
    pub environment: u64,
    /// Of the plan's points.
    pub point: u64,
}

impl HeldOperands {
    /// The place in a state.
    ///
    /// # Safety
    /// `state` is the first word of a state, which is aligned like rows.
    #[inline(always)]
    pub unsafe fn of<'s>(state: *mut u32) -> &'s mut HeldOperands {
        // SAFETY: the caller guarantees that `state` is the first word of a state, which is aligned
        // like rows; any bits are operands, and every state has these words.
        unsafe { &mut *state.add(HELD_OPERANDS).cast() }
    }
}

impl Plan {
    /// The save point of a resume id, and the call path's number.
    pub fn point_of(&self, id: u32) -> (usize, u32) {
        let after = self.bases.partition_point(|&base| base <= id);
        let index = after.saturating_sub(1);
        (index, id - self.bases[index])
    }

    /// Functions of the module, reached or not.
    pub fn functions(&self) -> usize {
        self.callers.len()
    }

    /// One past the last resume id.
    pub fn points_end(&self) -> u32 {
        self.end_of_points
    }

    /// The numbers of the call sites on the path to `function`, innermost first.
    pub fn path(&self, function: u32, context: u32) -> Path<'_> {
        Path {
            plan: self,
            function,
            context,
        }
    }

    /// Sets a state to the entry of program `number`, whose plan this is, with these active lanes,
    /// of which `helpers` are helper invocations, and zeroes its first `outputs` output rows, or
    /// all of them.
    #[inline]
    pub fn start(
        &self,
        number: u64,
        state: &mut [AlignedRow],
        (active, helpers): (LaneMask, LaneMask),
        outputs: usize,
    ) {
        let state = &mut state[..self.layout.rows];
        // SAFETY: a state's first row.
        let held = unsafe { HeldOperands::of(state.as_mut_ptr().cast()) };
        if held.program != number || self.output_rows != 0 {
            *held = HeldOperands::default();
        }
        // The first control row by itself: mostly it is the only one.
        let (lanes, masks) = state[0].0.split_at_mut(HELD_OPERANDS);
        lanes.copy_from_slice(&[0, active.bits().into(), helpers.bits().into(), 0]);
        masks[CONTROL_WORDS - HELD_OPERANDS..].fill(0);
        // Rows that a program may read or return without writing them are initialized, so that runs
        // are repeatable. Operands and results of yields are written before the columns of their
        // lanes are read.
        let outputs = self.output_rows.min(outputs);
        if (self.layout.inputs, outputs, self.private_rows) != (1, 0, 0) {
            zero(&mut state[1..self.layout.inputs]);
            zero(&mut state[self.layout.io..][..outputs]);
            zero(&mut state[self.private..][..self.private_rows]);
        }
    }

    /// The save point of a state.
    pub fn save_point_of(&self, state: &[AlignedRow]) -> &SavePoint {
        &self.points[self.point_of(state[0].0[0]).0]
    }

    /// Whether a lane is parked or pending in a construct around a state's save point.
    pub fn has_parked_lanes(&self, state: &[AlignedRow]) -> bool {
        (0..self.save_point_of(state).masks as usize).any(|k| {
            let word = CONTROL_WORDS + k / 2;
            state[word / SUBGROUP_SIZE].0[word % SUBGROUP_SIZE] >> (k % 2 * 16) & 0xffff != 0
        })
    }

    /// See [`Program::gather_lanes`](crate::Program::gather_lanes).
    pub fn gather_lanes(
        &self,
        state: &mut [AlignedRow],
        active: LaneMask,
        from: &[(&[AlignedRow], usize); SUBGROUP_SIZE],
    ) {
        let inputs = self.layout.inputs;
        state[..inputs].fill(AlignedRow::default());
        state[0].0[0] = from[0].0[0].0[0];
        state[0].0[1] = active.bits().into();
        let from = from.map(|(source, lane)| (&source[..self.layout.rows], lane));
        for (row, to) in state[..self.layout.rows]
            .iter_mut()
            .enumerate()
            .skip(inputs)
        {
            to.0 = from.map(|(source, lane)| source[row].0[lane]);
        }
        // Values of 64 bits take two rows.
        let (point, context) = self.point_of(state[0].0[0]);
        let point = &self.points[point];
        let callers = self.path(point.function, context);
        let callers = callers.map(|(_, site)| &site.live);
        for value in std::iter::once(&point.live)
            .chain(callers)
            .flat_map(|live| self.kept.values.of(live.saved))
            .filter(|value| value.wide)
        {
            let place = |word: usize| {
                (
                    value.row as usize + word / SUBGROUP_SIZE,
                    word % SUBGROUP_SIZE,
                )
            };
            for (k, (source, lane)) in from.iter().enumerate() {
                for half in 0..2 {
                    let (row, column) = place(2 * lane + half);
                    let word = source[row].0[column];
                    let (row, column) = place(2 * k + half);
                    state[row].0[column] = word;
                }
            }
        }
    }
}

/// Zeroes rows: few of them without a call.
#[inline(always)]
fn zero(rows: &mut [AlignedRow]) {
    const ZERO: AlignedRow = AlignedRow([0; SUBGROUP_SIZE]);
    match rows {
        [] => {}
        [a] => *a = ZERO,
        [a, b] => (*a, *b) = (ZERO, ZERO),
        [a, b, c] => (*a, *b, *c) = (ZERO, ZERO, ZERO),
        [a, b, c, d] => (*a, *b, *c, *d) = (ZERO, ZERO, ZERO, ZERO),
        _ => rows.fill(ZERO),
    }
}

/// See [`Plan::path`].
pub(crate) struct Path<'p> {
    plan: &'p Plan,
    function: u32,
    context: u32,
}

impl<'p> Iterator for Path<'p> {
    type Item = (usize, &'p CallSite);

    fn next(&mut self) -> Option<Self::Item> {
        let calls = &self.plan.calls;
        let sites = &self.plan.callers[self.function as usize];
        let after = sites.partition_point(|&s| calls[s as usize].context <= self.context);
        let index = *sites.get(after.checked_sub(1)?)? as usize;
        let site = &calls[index];
        self.context -= site.context;
        self.function = site.caller;
        Some((index, site))
    }
}
