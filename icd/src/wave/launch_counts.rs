//! Counts of each invocation of a command, where a capture keeps them.

#![deny(unsafe_code)]

use std::collections::BTreeSet;
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use lanes::{LaneMask, Tier, by_lane};
use parking_lot::Mutex;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::Row;
use traversal::{Hit, PACKET, Ray, RayCost, RayCosts, RayRows};

/// Invocations of a command that are kept, at most: of more, one in a few is.
pub const MOST_INVOCATIONS: u64 = 1 << 22;

/// Invocations whose first rays are kept, at most.
const MOST_LINES: u64 = 1 << 15;

/// Numbers of a line: origin and direction.
const LINE: usize = 6;

/// Structures that are told apart, at most.
const MAX_STRUCTURES: usize = 256;

/// A count of an invocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counter {
    Rays,
    Steps,
    BoxTests,
    PrimitiveTests,
    AnyHitCandidates,
    BoxCandidates,
    Depth,
    ClosestHits,
    Misses,
    Callables,
    NanRays,
    InfiniteRays,
    AnyHitShaders,
    IntersectionShaders,
    Nanoseconds,
    /// Primitives that cover a sample of the pixel.
    Primitives,
    /// Fragments none of whose samples passes the depth and stencil tests.
    FailedTests,
    FragmentShaders,
}

/// Counts of an invocation.
const SLOTS: usize = 15;

impl Counter {
    /// Those of traces and dispatches.
    pub const OF_LAUNCHES: [Counter; SLOTS] = [
        Counter::Rays,
        Counter::Steps,
        Counter::BoxTests,
        Counter::PrimitiveTests,
        Counter::AnyHitCandidates,
        Counter::BoxCandidates,
        Counter::Depth,
        Counter::ClosestHits,
        Counter::Misses,
        Counter::Callables,
        Counter::NanRays,
        Counter::InfiniteRays,
        Counter::AnyHitShaders,
        Counter::IntersectionShaders,
        Counter::Nanoseconds,
    ];

    /// Those of passes.
    pub const OF_PASSES: [Counter; 12] = [
        Counter::Primitives,
        Counter::FailedTests,
        Counter::FragmentShaders,
        Counter::Rays,
        Counter::Steps,
        Counter::BoxTests,
        Counter::PrimitiveTests,
        Counter::AnyHitCandidates,
        Counter::BoxCandidates,
        Counter::NanRays,
        Counter::InfiniteRays,
        Counter::Nanoseconds,
    ];

    /// The place among the counts of an invocation. Those of passes alone take the places of those
    /// that passes do without.
    #[inline(always)]
    const fn slot(self) -> usize {
        match self {
            Counter::Primitives => Counter::ClosestHits as usize,
            Counter::FailedTests => Counter::Misses as usize,
            Counter::FragmentShaders => Counter::Callables as usize,
            _ => self as usize,
        }
    }
}

/// The place of an invocation among those that are kept, plus one: so 16 optional ones are a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell(NonZeroU32);

impl Cell {
    fn at(place: u32) -> Self {
        Self(NonZeroU32::MIN.saturating_add(place))
    }

    #[inline(always)]
    fn place(self) -> u32 {
        self.0.get() - 1
    }
}

/// The cells of the lanes of a subgroup.
pub type Cells = [Option<Cell>; SUBGROUP_SIZE];

/// A ray whose walk is over.
#[derive(Clone, Copy, Debug)]
pub struct WalkedRay {
    pub cell: Cell,
    pub structure: u64,
    pub ray: Ray,
    pub time: f32,
    pub hit: Option<Hit>,
}

/// The invocations of a command that are kept: those whose indices, less the first one's, are
/// multiples of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptInvocations {
    pub first: [u32; 3],
    pub extent: [u32; 3],
    /// Powers of two.
    pub step: [u32; 3],
    /// How many there are, in each direction.
    pub size: [u32; 3],
}

impl KeptInvocations {
    /// Those of a launch, at most `most`.
    pub fn new(first: [u32; 3], extent: [u32; 3], most: u64) -> Self {
        let mut step = [1u32; 3];
        let sizes = |step: [u32; 3]| [0, 1, 2].map(|axis: usize| extent[axis].div_ceil(step[axis]));
        let count = |size: [u32; 3]| {
            let sizes = size.map(u64::from);
            sizes[0].saturating_mul(sizes[1]).saturating_mul(sizes[2])
        };
        while count(sizes(step)) > most.max(1) {
            let size = sizes(step);
            let longest = (0..3).rev().max_by_key(|&axis| size[axis]).unwrap_or(0);
            step[longest] *= 2;
        }
        Self {
            first,
            extent,
            step,
            size: sizes(step),
        }
    }

    /// How many are kept.
    pub fn count(&self) -> usize {
        self.size.iter().map(|&size| size as usize).product()
    }

    /// Where an invocation is kept, if it is.
    #[inline]
    pub fn cell(&self, invocation: [u32; 3]) -> Option<Cell> {
        let mut cell = 0;
        for axis in [2, 1, 0] {
            let place = invocation[axis].wrapping_sub(self.first[axis]);
            let step = self.step[axis];
            if place >= self.extent[axis] || place & (step - 1) != 0 {
                return None;
            }
            cell = cell * self.size[axis] + (place >> step.trailing_zeros());
        }
        Some(Cell::at(cell))
    }

    /// Where lanes are kept, plus one; 0 of lanes that are not. `layer`: where the first invocation
    /// of their layer is, plus one. Without branches, for all lanes at once.
    #[inline(always)]
    fn places(&self, x: &Row, y: &Row, layer: u32) -> Row {
        let [width, ..] = self.size;
        let shift = self.step.map(u32::trailing_zeros);
        let mut places = [0; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            let across = x[lane].wrapping_sub(self.first[0]);
            let down = y[lane].wrapping_sub(self.first[1]);
            let is_inside = (across < self.extent[0]) & (down < self.extent[1]);
            let between = across & (self.step[0] - 1) | down & (self.step[1] - 1);
            let place = (down >> shift[1])
                .wrapping_mul(width)
                .wrapping_add(across >> shift[0])
                .wrapping_add(layer);
            places[lane] = if is_inside & (between == 0) { place } else { 0 };
        }
        places
    }
}

lanes::vectors! {
    /// [`KeptInvocations::places`].
    fn places_of<V>(_v, kept: &KeptInvocations, x: &Row, y: &Row, layer: u32) -> Row {
        kept.places(x, y, layer)
    }
}

lanes::vectors! {
    /// The bits without a sign of the number of each ray that is farthest from 0; all bits where
    /// one is NaN. Infinite ends of intervals do not count.
    fn extremes<V>(_v, rays: &RayRows) -> Row {
        let mut most = [0; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            most[lane] = if rays.t_max[lane].is_nan() { u32::MAX } else { 0 };
        }
        let [ox, oy, oz] = &rays.origin;
        let [dx, dy, dz] = &rays.direction;
        for row in [&rays.t_min, ox, oy, oz, dx, dy, dz] {
            for lane in 0..SUBGROUP_SIZE {
                most[lane] = most[lane].max(row[lane].to_bits() & 0x7FFF_FFFF);
            }
        }
        most
    }
}

lanes::vectors! {
    /// The largest of some numbers, and their sum.
    fn most_and_sum<V>(_v, numbers: &[u32]) -> (u32, u64) {
        let (mut most, mut sum) = (0, 0);
        for &number in numbers {
            most = most.max(number);
            sum += u64::from(number);
        }
        (most, sum)
    }
}

/// Counts of the invocations of one command. One thread at a time counts for an invocation.
#[derive(Debug)]
pub struct LaunchCounts {
    pub kept: KeptInvocations,
    tier: Tier,
    /// How many are kept.
    length: usize,
    /// Slot by slot.
    counts: Vec<AtomicU32>,
    /// Slots with numbers other than 0.
    used: [AtomicBool; SLOTS],
    /// Where the first rays of some invocations are kept, by cell.
    kept_lines: KeptInvocations,
    /// Bits of their origins and directions; NaN before there is one.
    lines: Vec<[AtomicU32; LINE]>,
    /// Addresses of the top levels that rays name.
    structures: Mutex<BTreeSet<u64>>,
    /// The one that was added last: most rays name it, too.
    latest_structure: AtomicU64,
}

/// Memory of counts that are written, for those of the next command.
#[derive(Default)]
pub struct SpareCounts {
    counts: Vec<AtomicU32>,
    /// Slots with numbers other than 0.
    used: [bool; SLOTS],
    lines: Vec<[AtomicU32; LINE]>,
}

impl LaunchCounts {
    /// Zeros; `None` where there is no memory for them. `has_lines`: first rays are kept, too.
    pub fn new(kept: KeptInvocations, has_lines: bool, spare: SpareCounts) -> Option<Self> {
        let length = kept.count();
        let numbers = length.checked_mul(SLOTS)?;
        let SpareCounts {
            mut counts,
            used,
            mut lines,
        } = spare;
        if counts.len() == numbers {
            let slots = counts.chunks_exact_mut(length.max(1)).zip(used);
            for (slot, _) in slots.filter(|(_, used)| *used) {
                slot.fill_with(AtomicU32::default);
            }
        } else {
            counts.clear();
            counts.try_reserve_exact(numbers).ok()?;
            counts.resize_with(numbers, AtomicU32::default);
        }
        let kept_lines = KeptInvocations::new([0; 3], kept.size, MOST_LINES);
        let none = || [0; LINE].map(|_| AtomicU32::new(f32::NAN.to_bits()));
        lines.clear();
        lines.resize_with(if has_lines { kept_lines.count() } else { 0 }, none);
        Some(Self {
            kept,
            tier: Tier::best(),
            length,
            counts,
            used: Default::default(),
            kept_lines,
            lines,
            structures: Mutex::default(),
            latest_structure: AtomicU64::new(0),
        })
    }

    /// A count of all invocations that are kept, which is added to.
    #[inline(always)]
    fn of(&self, counter: Counter) -> &[AtomicU32] {
        let used = &self.used[counter.slot()];
        // Threads read it more often than they write it.
        if !used.load(Ordering::Relaxed) {
            used.store(true, Ordering::Relaxed);
        }
        &self.counts[counter.slot() * self.length..][..self.length]
    }

    /// Where the lanes of a subgroup are kept: invocations of one layer.
    pub fn cells(&self, x: &Row, y: &Row, z: u32) -> Cells {
        let [first_x, first_y, _] = self.kept.first;
        let Some(Cell(layer)) = self.kept.cell([first_x, first_y, z]) else {
            return [None; SUBGROUP_SIZE];
        };
        let places = places_of(self.tier, &self.kept, x, y, layer.get());
        by_lane(|lane| NonZeroU32::new(places[lane]).map(Cell))
    }

    /// Adds to a count.
    #[inline]
    pub fn add(&self, counter: Counter, cell: Cell, number: u32) {
        add_to(self.of(counter), cell, number);
    }

    /// Adds 1 for each of some lanes.
    pub fn add_one(&self, counter: Counter, cells: &Cells, lanes: LaneMask) {
        self.add_to_lanes(counter, 1, cells, lanes);
    }

    fn add_to_lanes(&self, counter: Counter, number: u32, cells: &Cells, lanes: LaneMask) {
        let counts = self.of(counter);
        for cell in lanes.iter().filter_map(|lane| cells[lane]) {
            add_to(counts, cell, number);
        }
    }

    /// Adds a number for each of some lanes.
    fn add_row(&self, counter: Counter, numbers: &Row, cells: &Cells, lanes: LaneMask) {
        if numbers.iter().fold(0, |any, number| any | number) == 0 {
            return;
        }
        let counts = self.of(counter);
        for lane in lanes {
            if let Some(cell) = cells[lane] {
                add_to(counts, cell, numbers[lane]);
            }
        }
    }

    /// Adds time that so many lanes have taken together. `which` gives the lanes of each subgroup.
    pub fn add_time(
        &self,
        time: Duration,
        lanes: u32,
        which: impl FnOnce(&mut dyn FnMut(&Cells, LaneMask)),
    ) {
        let each = nanoseconds(time) / u64::from(lanes.max(1));
        let each = u32::try_from(each).unwrap_or(u32::MAX);
        which(&mut |cells, lanes| self.add_to_lanes(Counter::Nanoseconds, each, cells, lanes));
    }

    /// Adds the costs of rays that walked together in some time, which they share by their steps.
    /// Other lanes have no costs.
    pub fn add_walks(
        &self,
        time: Duration,
        cells: &Cells,
        lanes: LaneMask,
        costs: &[RayCost; PACKET],
    ) {
        let mut rows = [[0; PACKET]; OF_RAYS.len()];
        for (lane, cost) in costs.iter().enumerate() {
            for (row, number) in rows.iter_mut().zip(numbers(cost)) {
                row[lane] = number;
            }
        }
        for (counter, row) in OF_RAYS.into_iter().zip(&rows) {
            self.add_row(counter, row, cells, lanes);
        }
        // Each takes the time of a step at least.
        let steps = by_lane(|lane| u64::from(costs[lane].steps) + 1);
        let all: u64 = lanes.iter().map(|lane| steps[lane]).sum();
        // In 1/256 of a nanosecond. No ray's share is more than the time of all.
        let each = (nanoseconds(time) << 8) / all.max(1);
        let times = by_lane(|lane| (each.wrapping_mul(steps[lane]) >> 8) as u32);
        self.add_row(Counter::Nanoseconds, &times, cells, lanes);
    }

    /// Adds the cost of a ray by itself.
    fn add_cost(&self, cell: Cell, cost: &RayCost) {
        for (counter, number) in OF_RAYS.into_iter().zip(numbers(cost)) {
            if number != 0 {
                self.add(counter, cell, number);
            }
        }
    }

    /// Rays of lanes begin; `depth` tells how many others the invocation of each waits for.
    pub fn start_rays(
        &self,
        cells: &Cells,
        lanes: LaneMask,
        rays: &RayRows,
        depth: impl Fn(usize) -> u32,
    ) {
        let most = extremes(self.tier, rays);
        // Of the bits without a sign, those of infinities are the least that are not finite.
        let infinite = f32::INFINITY.to_bits();
        let (counts, depths) = (self.of(Counter::Rays), self.of(Counter::Depth));
        for lane in lanes {
            let Some(cell) = cells[lane] else {
                continue;
            };
            let count = &counts[cell.place() as usize];
            let before = count.load(Ordering::Relaxed);
            if before == 0 && !self.lines.is_empty() {
                self.keep_line(cell, rays, lane);
            }
            count.store(before.saturating_add(1), Ordering::Relaxed);
            let (depth, deepest) = (depth(lane), &depths[cell.place() as usize]);
            if depth > deepest.load(Ordering::Relaxed) {
                deepest.store(depth, Ordering::Relaxed);
            }
            if most[lane] > infinite {
                self.add(Counter::NanRays, cell, 1);
            } else if most[lane] == infinite {
                self.add(Counter::InfiniteRays, cell, 1);
            }
        }
    }

    /// Keeps the line of an invocation's first ray, if its cell is one of some.
    fn keep_line(&self, cell: Cell, rays: &RayRows, lane: usize) {
        let [width, height, _] = self.kept.size;
        let [step, down, deep] = self.kept_lines.step;
        // Rows of whole steps: most cells need no division.
        let is_whole = width & (step - 1) == 0;
        if is_whole && cell.place() & (step - 1) != 0 {
            return;
        }
        let line = if is_whole && (down, deep) == (1, 1) {
            Some(cell.place() >> step.trailing_zeros())
        } else {
            let (row, x) = (cell.place() / width, cell.place() % width);
            let kept = self.kept_lines.cell([x, row % height, row / height]);
            kept.map(Cell::place)
        };
        if let Some(line) = line.and_then(|line| self.lines.get(line as usize)) {
            for (to, from) in line.iter().zip(rays.origin.iter().chain(&rays.direction)) {
                to.store(from[lane].to_bits(), Ordering::Relaxed);
            }
        }
    }

    /// Walks a ray once more, by itself. Returns its steps.
    ///
    /// # Safety
    /// As for [`RayCosts::of`].
    #[expect(unsafe_code, reason = "passed on to its caller")]
    pub unsafe fn add_walk(&self, walked: &WalkedRay, costs: &mut RayCosts<'_>) -> u32 {
        let &WalkedRay {
            cell,
            structure,
            ref ray,
            time,
            ref hit,
        } = walked;
        // SAFETY: the caller keeps the contract of `RayCosts::of`.
        let cost = unsafe { costs.of(structure, ray, time, hit.as_ref()) };
        self.add_cost(cell, &cost);
        cost.steps
    }

    /// Notes the top levels that rays name.
    pub fn note_structures(&self, addresses: impl Iterator<Item = u64>) {
        let mut latest = self.latest_structure.load(Ordering::Relaxed);
        for address in addresses {
            if address == latest {
                continue;
            }
            latest = address;
            let mut structures = self.structures.lock();
            if structures.len() < MAX_STRUCTURES {
                structures.insert(address);
            }
            self.latest_structure.store(address, Ordering::Relaxed);
        }
    }

    /// The top levels that rays have named.
    pub fn structures(&self) -> Vec<u64> {
        self.structures.lock().iter().copied().collect()
    }

    /// The counts of all invocations that are kept.
    pub fn finish(self) -> FinishedCounts {
        FinishedCounts {
            kept: self.kept,
            used: self.used.map(AtomicBool::into_inner),
            counts: self.counts.into_iter().map(AtomicU32::into_inner).collect(),
            first_rays: FirstRays {
                kept: self.kept_lines,
                lines: (self.lines.into_iter())
                    .map(|line| line.map(|bits| f32::from_bits(bits.into_inner())))
                    .collect(),
            },
        }
    }
}

/// Counts of a ray by itself.
const OF_RAYS: [Counter; 5] = [
    Counter::Steps,
    Counter::BoxTests,
    Counter::PrimitiveTests,
    Counter::AnyHitCandidates,
    Counter::BoxCandidates,
];

/// The numbers of [`OF_RAYS`].
#[inline(always)]
fn numbers(cost: &RayCost) -> [u32; OF_RAYS.len()] {
    [
        cost.steps,
        cost.box_tests,
        cost.primitive_tests,
        cost.any_hit_candidates,
        cost.box_candidates,
    ]
}

/// Adds to a count of an invocation.
#[inline(always)]
fn add_to(counts: &[AtomicU32], cell: Cell, number: u32) {
    let count = &counts[cell.place() as usize];
    let sum = count.load(Ordering::Relaxed).saturating_add(number);
    count.store(sum, Ordering::Relaxed);
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// Counts that no longer change.
pub struct FinishedCounts {
    pub kept: KeptInvocations,
    /// Slots with numbers other than 0.
    used: [bool; SLOTS],
    counts: Vec<u32>,
    first_rays: FirstRays,
}

/// Lines of the first rays of some cells.
pub struct FirstRays {
    /// Which cells, counted from the first.
    pub kept: KeptInvocations,
    /// Origin and direction; NaN of invocations without a ray.
    pub lines: Vec<[f32; LINE]>,
}

impl FinishedCounts {
    /// A count of all invocations, x fastest.
    pub fn values(&self, counter: Counter) -> &[u32] {
        let length = self.kept.count();
        &self.counts[counter.slot() * length..][..length]
    }

    /// The largest number of a count, and the sum of all.
    pub fn most_and_sum(&self, counter: Counter) -> (u32, u64) {
        match self.used[counter.slot()] {
            true => most_and_sum(Tier::best(), self.values(counter)),
            false => (0, 0),
        }
    }

    /// The first rays, if any invocation has traced one and they are kept.
    pub fn first_rays(&self) -> Option<&FirstRays> {
        let is_there = |line: &[f32; LINE]| line.iter().any(|number| !number.is_nan());
        let has_any = self.first_rays.lines.iter().any(is_there);
        has_any.then_some(&self.first_rays)
    }

    /// The memory, for other counts.
    pub fn into_spare(self) -> SpareCounts {
        let atomic = |number: f32| AtomicU32::new(number.to_bits());
        let lines = self.first_rays.lines.into_iter();
        SpareCounts {
            used: self.used,
            counts: self.counts.into_iter().map(AtomicU32::new).collect(),
            lines: lines.map(|line| line.map(atomic)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_counter_of_a_command_has_a_slot() {
        for counters in [&Counter::OF_LAUNCHES[..], &Counter::OF_PASSES] {
            let slots: BTreeSet<usize> = counters.iter().map(|counter| counter.slot()).collect();
            assert_eq!(slots.len(), counters.len());
            assert!(slots.iter().all(|&slot| slot < SLOTS));
        }
    }

    #[test]
    fn large_launches_are_sampled() {
        let all = KeptInvocations::new([0; 3], [640, 480, 1], MOST_INVOCATIONS);
        assert_eq!((all.step, all.size), ([1; 3], [640, 480, 1]));
        let cell = |kept: &KeptInvocations, at| kept.cell(at).map(Cell::place);
        assert_eq!(cell(&all, [3, 2, 0]), Some(1283));
        assert_eq!(cell(&all, [640, 2, 0]), None);
        let one = [1 << 30, 1, 1];
        let some = KeptInvocations::new([0; 3], one, MOST_INVOCATIONS);
        assert_eq!((some.step, some.size), ([256, 1, 1], [1 << 22, 1, 1]));
        assert_eq!(cell(&some, [512, 0, 0]), Some(2));
        assert_eq!(cell(&some, [513, 0, 0]), None);
        let most = KeptInvocations::new([5, 0, 0], [u32::MAX; 3], 64);
        assert!(most.count() <= 64 && most.size.iter().all(|&size| size > 0));
        assert_eq!(cell(&most, [5, 0, 0]), Some(0));
        assert_eq!(cell(&most, [4, 0, 0]), None);
        let none = KeptInvocations::new([0; 3], [0, 4, 4], 64);
        assert_eq!((none.count(), cell(&none, [0; 3])), (0, None));
    }

    #[test]
    fn rays_without_a_place_are_told_apart() {
        let kept = KeptInvocations::new([0; 3], [2, 1, 1], 8);
        let counts =
            LaunchCounts::new(kept, true, SpareCounts::default()).expect("there is memory");
        let cell = kept.cell([1, 0, 0]).expect("it is kept");
        let ray = Ray {
            t_max: f32::INFINITY,
            ..Ray::default()
        };
        let nan = Ray {
            t_min: f32::NAN,
            ..ray
        };
        let infinite = Ray {
            origin: [0.0, f32::NEG_INFINITY, 0.0],
            ..ray
        };
        let mut cells: Cells = [None; SUBGROUP_SIZE];
        cells[5] = Some(cell);
        for (ray, depth) in [(ray, 1), (nan, 3), (infinite, 2)] {
            let mut rays = RayRows::NONE;
            rays.set(5, 0, &ray, 0.0);
            counts.start_rays(&cells, LaneMask::ALL, &rays, |_| depth);
        }
        let counts = counts.finish();
        let first = counts.first_rays().expect("a ray was traced");
        let first = &first.lines;
        assert_eq!(first[1], [0.0; 6]);
        assert!(first[0].iter().all(|number| number.is_nan()));
        let of = |counter| counts.values(counter);
        assert_eq!(of(Counter::Rays), [0, 3]);
        assert_eq!(of(Counter::Depth), [0, 3]);
        assert_eq!(
            (of(Counter::NanRays), of(Counter::InfiniteRays)),
            (&[0, 1][..], &[0, 1][..])
        );
    }
}
