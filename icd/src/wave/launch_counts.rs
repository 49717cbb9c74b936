//! Counts of each invocation of a command, where a capture keeps them.

#![deny(unsafe_code)]

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use spirv_jit::SUBGROUP_SIZE;
use traversal::{Hit, Live, Ray, RayCost, Walker};

/// Invocations of a command that are kept, at most: of more, one in a few is.
pub const MOST_INVOCATIONS: u64 = 1 << 22;

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
}

impl Counter {
    /// All, in the order of their numbers.
    pub const ALL: [Counter; 15] = [
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
}

/// The place of an invocation among those that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell(u32);

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
            if place >= self.extent[axis] || !place.is_multiple_of(self.step[axis]) {
                return None;
            }
            cell = cell * self.size[axis] + place / self.step[axis];
        }
        Some(Cell(cell))
    }
}

/// Counts of the invocations of one command. One thread at a time counts for an invocation.
#[derive(Debug)]
pub struct LaunchCounts {
    pub kept: KeptInvocations,
    /// Counter by counter.
    counts: Vec<AtomicU32>,
    /// Addresses of the top levels that rays name.
    structures: Mutex<BTreeSet<u64>>,
    /// The one that was added last: most rays name it, too.
    latest_structure: AtomicU64,
}

impl LaunchCounts {
    /// Zeros; `None` where there is no memory for them.
    pub fn new(kept: KeptInvocations) -> Option<Self> {
        let length = kept.count().checked_mul(Counter::ALL.len())?;
        let mut counts = Vec::new();
        counts.try_reserve_exact(length).ok()?;
        counts.resize_with(length, AtomicU32::default);
        Some(Self {
            kept,
            counts,
            structures: Mutex::default(),
            latest_structure: AtomicU64::new(0),
        })
    }

    fn count(&self, counter: Counter, cell: Cell) -> &AtomicU32 {
        &self.counts[counter as usize * self.kept.count() + cell.0 as usize]
    }

    /// Adds to a count.
    #[inline]
    pub fn add(&self, counter: Counter, cell: Cell, number: u32) {
        let count = self.count(counter, cell);
        let sum = count.load(Ordering::Relaxed).saturating_add(number);
        count.store(sum, Ordering::Relaxed);
    }

    /// Adds time that invocations have taken together.
    pub fn add_time(&self, time: Duration, cells: impl Iterator<Item = Cell>, lanes: u32) {
        let each = time.as_nanos() / u128::from(lanes.max(1));
        let each = u32::try_from(each).unwrap_or(u32::MAX);
        for cell in cells {
            self.add(Counter::Nanoseconds, cell, each);
        }
    }

    /// A ray begins, of an invocation that so many others wait for.
    pub fn start_ray(&self, cell: Cell, ray: &Ray, depth: u32) {
        self.add(Counter::Rays, cell, 1);
        let highest = self.count(Counter::Depth, cell);
        if depth > highest.load(Ordering::Relaxed) {
            highest.store(depth, Ordering::Relaxed);
        }
        let ends = [ray.t_min, ray.t_max];
        let line = ray.origin.iter().chain(&ray.direction);
        if line.clone().chain(&ends).any(|number| number.is_nan()) {
            self.add(Counter::NanRays, cell, 1);
        } else if line.clone().any(|number| number.is_infinite()) || ray.t_min.is_infinite() {
            self.add(Counter::InfiniteRays, cell, 1);
        }
    }

    /// Walks a ray once more, by itself. Returns its steps.
    ///
    /// # Safety
    /// As for [`RayCost::new`].
    #[expect(unsafe_code, reason = "passed on to its caller")]
    pub unsafe fn add_walk(&self, walked: &WalkedRay, walker: &mut Walker, live: &Live) -> u32 {
        let &WalkedRay {
            cell,
            structure,
            ref ray,
            time,
            ref hit,
        } = walked;
        // SAFETY: the caller's promise.
        let cost = unsafe { RayCost::new(walker, structure, ray, time, live, hit.as_ref()) };
        for (counter, number) in [
            (Counter::Steps, cost.steps),
            (Counter::BoxTests, cost.box_tests),
            (Counter::PrimitiveTests, cost.primitive_tests),
            (Counter::AnyHitCandidates, cost.any_hit_candidates),
            (Counter::BoxCandidates, cost.box_candidates),
        ] {
            self.add(counter, cell, number);
        }
        cost.steps
    }

    /// Notes the top levels that rays name.
    pub fn note_structures(&self, addresses: impl Iterator<Item = u64>) {
        for address in addresses {
            if address == self.latest_structure.load(Ordering::Relaxed) {
                continue;
            }
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

    /// A count of all invocations that are kept, x fastest.
    pub fn values(&self, counter: Counter) -> impl ExactSizeIterator<Item = u32> + Clone + '_ {
        let length = self.kept.count();
        let counts = &self.counts[counter as usize * length..][..length];
        counts.iter().map(|count| count.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_stand_in_the_order_of_their_numbers() {
        for (number, counter) in Counter::ALL.into_iter().enumerate() {
            assert_eq!(counter as usize, number);
        }
    }

    #[test]
    fn large_launches_are_sampled() {
        let all = KeptInvocations::new([0; 3], [640, 480, 1], MOST_INVOCATIONS);
        assert_eq!((all.step, all.size), ([1; 3], [640, 480, 1]));
        let cell = |kept: &KeptInvocations, at| kept.cell(at).map(|cell| cell.0);
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
        let counts = LaunchCounts::new(kept).expect("there is memory");
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
        for (ray, depth) in [(ray, 1), (nan, 3), (infinite, 2)] {
            counts.start_ray(cell, &ray, depth);
        }
        let of = |counter| counts.values(counter).collect::<Vec<_>>();
        assert_eq!(of(Counter::Rays), [0, 3]);
        assert_eq!(of(Counter::Depth), [0, 3]);
        assert_eq!(
            (of(Counter::NanRays), of(Counter::InfiniteRays)),
            (vec![0, 1], vec![0, 1])
        );
    }
}
