//! Operations across the lanes of a subgroup: the result in each active lane. Results in other
//! lanes are undefined. Lanes combine in ascending order.

use lanes::LaneMask;

use crate::SUBGROUP_SIZE;

/// A scalar of each lane.
pub type Lanes<T> = [T; SUBGROUP_SIZE];

/// True in the first active lane.
pub fn elect(active: LaneMask) -> Lanes<bool> {
    std::array::from_fn(|lane| lane == active.first())
}

pub fn all(conditions: &Lanes<bool>, active: LaneMask) -> bool {
    active.iter().all(|lane| conditions[lane])
}

pub fn any(conditions: &Lanes<bool>, active: LaneMask) -> bool {
    active.iter().any(|lane| conditions[lane])
}

/// Whether all active lanes equal the first active one.
pub fn all_equal<T: Copy>(
    scalars: &Lanes<T>,
    active: LaneMask,
    equal: impl Fn(T, T) -> bool,
) -> bool {
    let first = scalars[active.first()];
    active.iter().all(|lane| equal(scalars[lane], first))
}

/// One bit for each active lane whose condition holds.
pub fn ballot(conditions: &Lanes<bool>, active: LaneMask) -> u32 {
    (active & LaneMask::from_fn(|lane| conditions[lane]))
        .bits()
        .into()
}

/// One bit for each active lane with the same scalar.
pub fn matching<T: Copy + PartialEq>(scalars: &Lanes<T>, active: LaneMask) -> Lanes<u32> {
    std::array::from_fn(|lane| {
        let same = LaneMask::from_fn(|other| scalars[other] == scalars[lane]);
        (active & same).bits().into()
    })
}

/// The scalars of the lanes that `from` names; zero for numbers past the last lane.
pub fn shuffle<T: Copy + Default>(scalars: &Lanes<T>, from: &Lanes<u32>) -> Lanes<T> {
    from.map(|lane| scalars.get(lane as usize).copied().unwrap_or_default())
}

/// The scalars of the lanes that `from` names; the lane's own scalar if that lane is inactive.
pub fn quad_shuffle<T: Copy>(scalars: &Lanes<T>, from: &Lanes<u32>, active: LaneMask) -> Lanes<T> {
    std::array::from_fn(|lane| {
        let other = from[lane] as usize;
        match other < SUBGROUP_SIZE && active.contains(other) {
            true => scalars[other],
            false => scalars[lane],
        }
    })
}

/// The scalar of the first active lane.
pub fn broadcast_first<T: Copy>(scalars: &Lanes<T>, active: LaneMask) -> T {
    scalars[active.first()]
}

/// A combining operation with its identity.
#[derive(Clone, Copy)]
pub struct Combination<T> {
    pub combine: fn(T, T) -> T,
    pub identity: T,
}

impl<T: Copy> Combination<T> {
    /// The combination of some lanes, from the first on; the identity for no lanes.
    fn of(self, scalars: &Lanes<T>, some: LaneMask) -> T {
        (some.iter().map(|lane| scalars[lane]))
            .reduce(self.combine)
            .unwrap_or(self.identity)
    }

    /// The combination of the active lanes in each cluster of `cluster` lanes.
    pub fn reduce(self, scalars: &Lanes<T>, active: LaneMask, cluster: usize) -> Lanes<T> {
        std::array::from_fn(|lane| {
            let cluster = LaneMask::from_fn(|other| other / cluster == lane / cluster);
            self.of(scalars, active & cluster)
        })
    }

    /// The combination of the active lanes up to and including each lane.
    pub fn inclusive_scan(self, scalars: &Lanes<T>, active: LaneMask) -> Lanes<T> {
        std::array::from_fn(|lane| self.of(scalars, active & LaneMask::full(lane + 1)))
    }

    /// The combination of the active lanes before each lane.
    pub fn exclusive_scan(self, scalars: &Lanes<T>, active: LaneMask) -> Lanes<T> {
        std::array::from_fn(|lane| self.of(scalars, active & LaneMask::full(lane)))
    }

    /// The combination of the active lanes in each lane's part, restricted to `seen` of the lane.
    /// A part has one bit for each lane.
    pub fn partitioned(
        self,
        scalars: &Lanes<T>,
        parts: &Lanes<u32>,
        active: LaneMask,
        seen: impl Fn(usize) -> LaneMask,
    ) -> Lanes<T> {
        std::array::from_fn(|lane| {
            let part = LaneMask::from_bits(parts[lane] as u16);
            self.of(scalars, active & part & seen(lane))
        })
    }
}
