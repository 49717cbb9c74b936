//! Loads and stores of whole subgroups, in every tier, against copies of single bytes.

use effort::sparse::Sparse;
use lanes::{LaneMask, Row, Tier as TierKind};

use super::numbers::Random;
use crate::SUBGROUP_SIZE;
use crate::interp::gather::{self, Gather};
use crate::interp::kernels::Lane;
use crate::interp::tier::Portable;
#[cfg(target_arch = "x86_64")]
use crate::interp::tier::{Avx2, Avx512};

/// Bytes that lanes load from.
const SIZE_BYTES: usize = 311;

/// Scalars of one access, at most.
const MOST: usize = 16;

/// The byte that fills rows beforehand.
const BEFORE: u8 = 0xa5;

impl Random {
    /// Offsets of lanes that load so many bytes: of all layouts, mostly inside.
    fn offsets(&mut self, total: usize) -> Row {
        let last = (SIZE_BYTES - total) as u64;
        let mut offsets = [0; SUBGROUP_SIZE];
        let first = self.below(last + 1) as u32;
        match self.below(4) {
            0 => offsets.fill(first),
            1 => {
                // The last of them ends with the memory, or wraps.
                let length = (total * SUBGROUP_SIZE) as u32;
                let start = (SIZE_BYTES as u32).wrapping_sub(length);
                for (k, offset) in offsets.iter_mut().enumerate() {
                    *offset = start.wrapping_add((k * total) as u32);
                }
            }
            _ => {
                for offset in &mut offsets {
                    *offset = self.below(last + 1) as u32;
                }
            }
        }
        for _ in 0..self.below(3) * self.below(9) {
            let lane = self.below(SUBGROUP_SIZE as u64) as usize;
            offsets[lane] = [last as u32 + 1, SIZE_BYTES as u32, u32::MAX][self.below(3) as usize];
        }
        offsets
    }

    fn some_lanes(&mut self) -> LaneMask {
        match self.below(2) {
            0 => LaneMask::ALL,
            _ => LaneMask::from_bits(1 + self.below(u16::MAX as u64) as u16),
        }
    }
}

/// Rows of lanes of 64 bits at most, aligned like those of a frame for scalars of any size.
#[repr(align(64))]
struct RowBuffer([[u8; 8 * SUBGROUP_SIZE]; MOST]);

/// Loads and stores of `count` scalars of a type in a tier: one body tests all of them.
struct AccessKind {
    count: usize,
    size: usize,
    slot: usize,
    load: unsafe fn((*const u8, u64), &Row, LaneMask, &mut RowBuffer) -> LaneMask,
    store: unsafe fn((*mut u8, u64), &Row, LaneMask, &mut RowBuffer) -> LaneMask,
}

impl AccessKind {
    fn of<G: Gather, T: Lane, const N: usize>() -> AccessKind {
        /// # Safety
        /// As [`gather::load`].
        unsafe fn load<G: Gather, T: Lane, const N: usize>(
            from: (*const u8, u64),
            offsets: &Row,
            active: LaneMask,
            rows: &mut RowBuffer,
        ) -> LaneMask {
            let to = std::array::from_fn(|k| rows.0[k].as_mut_ptr());
            // SAFETY: the caller keeps the contract of `gather::load`; rows are as long as those of
            // 64-bit lanes.
            unsafe { gather::load::<G, T, N>(from, offsets, active, to) }
        }
        /// # Safety
        /// As [`gather::store`].
        unsafe fn store<G: Gather, T: Lane, const N: usize>(
            to: (*mut u8, u64),
            offsets: &Row,
            active: LaneMask,
            rows: &mut RowBuffer,
        ) -> LaneMask {
            let from = std::array::from_fn(|k| rows.0[k].as_mut_ptr());
            // SAFETY: as for `load`.
            unsafe { gather::store::<G, T, N>(to, offsets, active, from) }
        }
        AccessKind {
            count: N,
            size: size_of::<T>(),
            slot: size_of::<T::Slot>(),
            load: load::<G, T, N>,
            store: store::<G, T, N>,
        }
    }

    /// All of a tier.
    fn all<G: Gather>() -> Vec<AccessKind> {
        macro_rules! of_all_counts {
            ($($scalar:ty)*) => {
                vec![$(
                    AccessKind::of::<G, $scalar, 1>(),
                    AccessKind::of::<G, $scalar, 2>(),
                    AccessKind::of::<G, $scalar, 3>(),
                    AccessKind::of::<G, $scalar, 4>(),
                )*]
            };
        }
        let mut all = of_all_counts!(u8 u16 u32 u64);
        // As many as fill four words.
        all.extend([AccessKind::of::<G, u8, 16>(), AccessKind::of::<G, u16, 8>()]);
        all
    }
}

fn accesses_of(access: &AccessKind, random: &mut Random) {
    let memory: Vec<u8> = (0..SIZE_BYTES).map(|_| random.below(256) as u8).collect();
    let &AccessKind {
        count, size, slot, ..
    } = access;
    for _ in 0..400 {
        let (offsets, active) = (random.offsets(count * size), random.some_lanes());
        // Some memory is smaller than one lane's access.
        let size_bytes = match random.below(8) {
            0 => random.below((count * size) as u64) as usize,
            _ => SIZE_BYTES,
        };
        let is_inside = |lane: usize| offsets[lane] as usize + count * size <= size_bytes;
        let outside = active - LaneMask::from_fn(is_inside);

        let mut rows = RowBuffer([[BEFORE; 8 * SUBGROUP_SIZE]; MOST]);
        let from = (memory.as_ptr(), size_bytes as u64);
        // SAFETY: the machine has the tier.
        let left = unsafe { (access.load)(from, &offsets, active, &mut rows) };
        assert_eq!(left, outside, "{offsets:?}, {active:?}");
        for (k, row) in rows.0[..count].iter().enumerate() {
            for lane in active {
                let given = &row[lane * slot..][..slot];
                let mut expected = vec![0; slot];
                if is_inside(lane) {
                    let at = offsets[lane] as usize + k * size;
                    expected[..size].copy_from_slice(&memory[at..at + size]);
                }
                assert_eq!(
                    given, expected,
                    "scalar {k} of {count}, lane {lane}, {size} bytes"
                );
            }
        }

        for byte in rows.0.as_flattened_mut() {
            *byte = random.below(256) as u8;
        }
        let (mut given, mut expected) = (memory.clone(), memory.clone());
        let to = (given.as_mut_ptr(), size_bytes as u64);
        // SAFETY: the machine has the tier.
        let left = unsafe { (access.store)(to, &offsets, active, &mut rows) };
        assert_eq!(left, outside, "{offsets:?}, {active:?}");
        for lane in active - outside {
            for (k, row) in rows.0[..count].iter().enumerate() {
                let at = offsets[lane] as usize + k * size;
                expected[at..at + size].copy_from_slice(&row[lane * slot..][..size]);
            }
        }
        assert_eq!(given, expected, "{count} of {size} bytes, {active:?}");
    }
}

fn accesses<G: Gather>() {
    let random = &mut Random(7);
    for access in AccessKind::all::<G>() {
        accesses_of(&access, random);
    }
}

/// Scalars in 4 GiB, at offsets of all 32 bits.
fn far_accesses_of(access: &AccessKind, memory: &Sparse, random: &mut Random) {
    let &AccessKind {
        count, size, slot, ..
    } = access;
    let total = (count * size) as u32;
    let last = (memory.size_bytes() - u64::from(total)) as u32;
    let run = |first: u32| std::array::from_fn(|k| first + k as u32 * total);
    let apart = |k: usize| (k as u32 % 4) * (1 << 30) + (last % (1 << 30)) / 16 * k as u32;
    let layouts: [Row; 5] = [
        [last; SUBGROUP_SIZE],
        [1 << 31; SUBGROUP_SIZE],
        run((1 << 31) - 8 * total),
        run(last - 15 * total),
        std::array::from_fn(apart),
    ];
    for offsets in layouts {
        for active in [LaneMask::ALL, random.some_lanes()] {
            let mut rows = RowBuffer([[0; 8 * SUBGROUP_SIZE]; MOST]);
            for byte in rows.0.as_flattened_mut() {
                *byte = random.below(256) as u8;
            }
            let at = (memory.as_mut_ptr(), memory.size_bytes());
            // SAFETY: the machine has the tier.
            let left = unsafe { (access.store)(at, &offsets, active, &mut rows) };
            assert!(left.is_empty(), "{offsets:x?}");
            let mut loaded = RowBuffer([[BEFORE; 8 * SUBGROUP_SIZE]; MOST]);
            let from = (at.0.cast_const(), at.1);
            // SAFETY: the machine has the tier.
            let left = unsafe { (access.load)(from, &offsets, active, &mut loaded) };
            assert!(left.is_empty(), "{offsets:x?}");
            for lane in active {
                // Of lanes at one place the last one's stays.
                let same = active
                    .iter()
                    .filter(|&other| offsets[other] == offsets[lane]);
                let writer = same.last().expect("the lane itself");
                for k in 0..count {
                    let stored = &rows.0[k][writer * slot..][..size];
                    for (byte, &stored) in stored.iter().enumerate() {
                        let place = u64::from(offsets[lane]) + (k * size + byte) as u64;
                        assert_eq!(memory.read(place), [stored], "{offsets:x?} {lane}");
                    }
                    assert_eq!(
                        &loaded.0[k][lane * slot..][..size],
                        stored,
                        "{offsets:x?} {lane}"
                    );
                }
            }
            let mut outside = offsets;
            outside[active.first()] = last.wrapping_add(1);
            // SAFETY: the machine has the tier.
            let left = unsafe { (access.store)(at, &outside, active, &mut rows) };
            // One byte is inside up to the last offset.
            let all_inside = last == u32::MAX;
            assert_eq!(left.is_empty(), all_inside, "{offsets:x?}");
        }
    }
}

fn far_accesses<G: Gather>() {
    let memory = &Sparse::new(1 << 32);
    let random = &mut Random(13);
    for access in AccessKind::all::<G>() {
        far_accesses_of(&access, memory, random);
    }
}

fn straddling<G: Gather>() {
    let random = &mut Random(5);
    for _ in 0..2000 {
        let sizes = [
            0,
            1,
            3,
            4,
            15,
            16,
            200,
            311,
            (1 << 32) - 3,
            1 << 32,
            1 << 40,
        ];
        let size_bytes: u64 = sizes[random.below(sizes.len() as u64) as usize];
        let size = 1 << random.below(4);
        let count = 1 + random.below(6);
        let mut offsets = [0u32; SUBGROUP_SIZE];
        for offset in &mut offsets {
            let near = [0, size_bytes as u32, u32::MAX][random.below(3) as usize];
            *offset = near.wrapping_add(random.below(65) as u32).wrapping_sub(32);
        }
        let is_inside = |lane: usize, k: u64| {
            let first = (offsets[lane] as u64 + k * size) as u32 as u64;
            first + size <= size_bytes
        };
        let all = |lane: usize| (0..count).all(|k| is_inside(lane, k));
        let any = |lane: usize| (0..count).any(|k| is_inside(lane, k));
        let outside = random.some_lanes() - LaneMask::from_fn(all);
        // SAFETY: the machine has the tier.
        let given =
            unsafe { gather::straddling::<G>(&offsets, outside, (size_bytes, count * size)) };
        assert_eq!(given - outside, LaneMask::NONE);
        assert_eq!((outside & LaneMask::from_fn(any)) - given, LaneMask::NONE);
        // Lanes past the end that do not wrap are never left.
        let ends = |lane: usize| offsets[lane] as u64 + count * size;
        let is_behind = |lane: usize| offsets[lane] as u64 >= size_bytes && ends(lane) <= 1 << 32;
        assert_eq!(given & LaneMask::from_fn(is_behind), LaneMask::NONE);
    }
}

fn distances<G: Gather>() {
    let random = &mut Random(11);
    for _ in 0..2000 {
        let start = random.below(u64::MAX);
        let mut addresses = [start; SUBGROUP_SIZE];
        for address in &mut addresses {
            *address = start.wrapping_add(random.below(1 << 32));
        }
        for _ in 0..random.below(4) {
            let lane = random.below(SUBGROUP_SIZE as u64) as usize;
            let far = [1 << 32, 1 << 63, u64::MAX, u64::MAX << 32];
            addresses[lane] = start.wrapping_add(far[random.below(4) as usize]);
        }
        // SAFETY: the machine has the tier.
        let given = unsafe { G::distances(&addresses, start) };
        let distance = |lane: usize| addresses[lane].wrapping_sub(start);
        let expected = |lane| u32::try_from(distance(lane)).unwrap_or(u32::MAX);
        assert_eq!(given, std::array::from_fn(expected));
    }
}

/// Runs a function in all tiers that the machine has.
macro_rules! in_all_tiers {
    ($function:ident) => {
        for &tier in TierKind::available() {
            match tier {
                TierKind::Portable => $function::<Portable>(),
                #[cfg(target_arch = "x86_64")]
                TierKind::Avx2 => $function::<Avx2>(),
                #[cfg(target_arch = "x86_64")]
                TierKind::Avx512 => $function::<Avx512>(),
                #[cfg(not(target_arch = "x86_64"))]
                _ => unreachable!("other processors have no such tier"),
            }
        }
    };
}

#[test]
fn accesses_are_to_the_bytes_at_each_offset() {
    in_all_tiers!(accesses);
}

#[test]
fn offsets_have_all_32_bits() {
    in_all_tiers!(far_accesses);
}

#[test]
fn distances_end_with_32_bits() {
    in_all_tiers!(distances);
}

#[test]
fn scalars_that_straddle_the_end_are_left() {
    in_all_tiers!(straddling);
}
