//! Loads and stores of whole subgroups, in every tier, against copies of single bytes.

use lanes::{LaneMask, Tier as TierKind};
use shaders::sparse::Sparse;

use crate::SUBGROUP_SIZE;
use crate::interp::gather::{self, Gather};
use crate::interp::kernels::Lane;
use crate::interp::tier::Portable;
#[cfg(target_arch = "x86_64")]
use crate::interp::tier::{Avx2, Avx512};
use crate::row::Row;

/// Bytes that lanes load from.
const SIZE_BYTES: usize = 203;

/// The byte that fills rows beforehand.
const BEFORE: u8 = 0xa5;

/// Numbers that look random (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (x ^ x >> 31) % bound
    }

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
        if self.below(3) == 0 {
            let lane = self.below(SUBGROUP_SIZE as u64) as usize;
            offsets[lane] = [last as u32 + 1, SIZE_BYTES as u32, u32::MAX][self.below(3) as usize];
        }
        offsets
    }

    fn active(&mut self) -> LaneMask {
        match self.below(2) {
            0 => LaneMask::ALL,
            _ => LaneMask::from_bits(1 + self.below(u16::MAX as u64) as u16),
        }
    }
}

fn accesses_of<G: Gather, T: Lane, const N: usize>(random: &mut Random) {
    let memory: Vec<u8> = (0..SIZE_BYTES).map(|_| random.below(256) as u8).collect();
    let (size, slot) = (size_of::<T>(), size_of::<T::Slot>());
    for _ in 0..400 {
        let (offsets, active) = (random.offsets(N * size), random.active());
        let end = |lane: usize| offsets[lane] as usize + N * size;
        let is_inside = active.iter().all(|lane| end(lane) <= SIZE_BYTES);

        let mut rows = [[BEFORE; 8 * SUBGROUP_SIZE]; N];
        let to = rows.each_mut().map(|row| row.as_mut_ptr());
        let from = (memory.as_ptr(), SIZE_BYTES as u64);
        // SAFETY: the machine has the tier; rows are as long as those of 64-bit lanes.
        let is_done = unsafe { gather::load::<G, T, N>(from, &offsets, active, to) };
        assert_eq!(is_done, is_inside, "{offsets:?}, {active:?}");
        for (k, row) in rows.iter().enumerate() {
            for lane in active {
                let given = &row[lane * slot..][..slot];
                let mut expected = vec![BEFORE; slot];
                if is_inside {
                    expected.fill(0);
                    let at = offsets[lane] as usize + k * size;
                    expected[..size].copy_from_slice(&memory[at..at + size]);
                }
                assert_eq!(
                    given, expected,
                    "scalar {k} of {N}, lane {lane}, {size} bytes"
                );
            }
        }

        for byte in rows.as_flattened_mut() {
            *byte = random.below(256) as u8;
        }
        let from = rows.each_mut().map(|row| row.as_mut_ptr());
        let (mut given, mut expected) = (memory.clone(), memory.clone());
        let to = (given.as_mut_ptr(), SIZE_BYTES as u64);
        // SAFETY: as above.
        let is_done = unsafe { gather::store::<G, T, N>(to, &offsets, active, from) };
        assert_eq!(is_done, is_inside, "{offsets:?}, {active:?}");
        if is_inside {
            for lane in active {
                for (k, row) in rows.iter().enumerate() {
                    let at = offsets[lane] as usize + k * size;
                    expected[at..at + size].copy_from_slice(&row[lane * slot..][..size]);
                }
            }
        }
        assert_eq!(given, expected, "{N} of {size} bytes, {active:?}");
    }
}

fn accesses<G: Gather>() {
    let random = &mut Random(7);
    macro_rules! of_all_counts {
        ($($scalar:ty)*) => {$(
            accesses_of::<G, $scalar, 1>(random);
            accesses_of::<G, $scalar, 2>(random);
            accesses_of::<G, $scalar, 3>(random);
            accesses_of::<G, $scalar, 4>(random);
        )*};
    }
    of_all_counts!(u8 u16 u32 u64);
}

/// `N` scalars a lane in 4 GiB, at offsets of all 32 bits.
fn far_accesses_of<G: Gather, T: Lane, const N: usize>(memory: &Sparse, random: &mut Random) {
    let (size, slot) = (size_of::<T>(), size_of::<T::Slot>());
    let total = (N * size) as u32;
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
        for active in [LaneMask::ALL, random.active()] {
            let mut rows = [[0; 8 * SUBGROUP_SIZE]; N];
            for byte in rows.as_flattened_mut() {
                *byte = random.below(256) as u8;
            }
            let at = (memory.as_mut_ptr(), memory.size_bytes());
            let from = rows.each_mut().map(|row| row.as_mut_ptr());
            // SAFETY: the machine has the tier; rows are as long as those of 64-bit lanes.
            let is_done = unsafe { gather::store::<G, T, N>(at, &offsets, active, from) };
            assert!(is_done, "{offsets:x?}");
            let mut loaded = [[BEFORE; 8 * SUBGROUP_SIZE]; N];
            let to = loaded.each_mut().map(|row| row.as_mut_ptr());
            let from = (at.0.cast_const(), at.1);
            // SAFETY: as above.
            let is_done = unsafe { gather::load::<G, T, N>(from, &offsets, active, to) };
            assert!(is_done, "{offsets:x?}");
            for lane in active {
                // Of lanes at one place the last one's stays.
                let same = active
                    .iter()
                    .filter(|&other| offsets[other] == offsets[lane]);
                let writer = same.last().expect("the lane itself");
                for k in 0..N {
                    let stored = &rows[k][writer * slot..][..size];
                    for (byte, &stored) in stored.iter().enumerate() {
                        let place = u64::from(offsets[lane]) + (k * size + byte) as u64;
                        assert_eq!(memory.read(place), [stored], "{offsets:x?} {lane}");
                    }
                    assert_eq!(
                        &loaded[k][lane * slot..][..size],
                        stored,
                        "{offsets:x?} {lane}"
                    );
                }
            }
            let mut outside = offsets;
            outside[active.first()] = last.wrapping_add(1);
            let from = rows.each_mut().map(|row| row.as_mut_ptr());
            // SAFETY: as above.
            let is_done = unsafe { gather::store::<G, T, N>(at, &outside, active, from) };
            // One byte is inside up to the last offset.
            assert_eq!(is_done, last == u32::MAX, "{offsets:x?}");
        }
    }
}

fn far_accesses<G: Gather>() {
    let memory = &Sparse::new(1 << 32);
    let random = &mut Random(13);
    macro_rules! of_all_counts {
        ($($scalar:ty)*) => {$(
            far_accesses_of::<G, $scalar, 1>(memory, random);
            far_accesses_of::<G, $scalar, 2>(memory, random);
            far_accesses_of::<G, $scalar, 3>(memory, random);
            far_accesses_of::<G, $scalar, 4>(memory, random);
        )*};
    }
    of_all_counts!(u8 u16 u32 u64);
}

fn distances<G: Gather>() {
    let random = &mut Random(11);
    for _ in 0..2000 {
        let start = random.below(u64::MAX);
        let active = random.active();
        let mut addresses = [start; SUBGROUP_SIZE];
        for address in &mut addresses {
            *address = start.wrapping_add(random.below(1 << 32));
        }
        if random.below(2) == 0 {
            let lane = random.below(SUBGROUP_SIZE as u64) as usize;
            let far = [1 << 32, 1 << 63, u64::MAX, u64::MAX << 32];
            addresses[lane] = start.wrapping_add(far[random.below(4) as usize]);
        }
        let distance = |lane: usize| match active.contains(lane) {
            true => addresses[lane].wrapping_sub(start),
            false => 0,
        };
        let is_near = (0..SUBGROUP_SIZE).all(|lane| distance(lane) < 1 << 32);
        // SAFETY: the machine has the tier.
        let given = unsafe { G::distances(&addresses, start, active) };
        let expected: Vec<u32> = (0..SUBGROUP_SIZE).map(|k| distance(k) as u32).collect();
        assert_eq!(given.map(Vec::from), is_near.then_some(expected));
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
fn distances_are_less_than_32_bits_long_or_none() {
    in_all_tiers!(distances);
}
