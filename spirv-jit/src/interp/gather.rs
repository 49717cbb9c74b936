//! Loads of scalars for a whole subgroup, from memory that its lanes share, in each instruction set.
//!
//! All lanes are looked at together: whether what they load is inside, and how it lies. Lanes that load the same, and lanes whose scalars lie
//! one behind another, load once; else words of four lanes at a time are put together, and stored in registers as wide as the tier has:
//! whoever reads the rows next need not wait for sixteen single stores.

use lanes::LaneMask;

use super::kernels::Lane;
use super::tier::{Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::row::Row;

#[cfg(target_arch = "x86_64")]
mod x86;

/// Where scalars go: rows of lanes of 32 bits, for scalars of 64 bits of 64 bits.
pub(super) type Rows<const N: usize> = [*mut u8; N];

/// How the offsets of a subgroup's lanes lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// Some of them are beyond the last that may be.
    Outside,
    /// All are equal.
    Same,
    /// Each is as far behind the one before as the scalars are long.
    Run,
    Apart,
}

/// Loads of a whole subgroup in a tier.
///
/// # Safety
/// Of all functions: the machine has the tier.
pub(super) trait Gather: Tier {
    /// How offsets lie, of which none may be above `last`, of scalars of `size_bytes` together; `last + size_bytes` is at most 2³².
    unsafe fn layout(offsets: &Row, last: u32, size_bytes: u32) -> Layout;

    /// The offsets of active lanes, of which there are some; in other lanes the first active one's.
    unsafe fn fill(offsets: &Row, active: LaneMask) -> Row;

    /// How far active lanes' addresses are behind `start`, if that is less than 2³² in all of them; in other lanes 0.
    unsafe fn distances(
        addresses: &[u64; SUBGROUP_SIZE],
        start: u64,
        active: LaneMask,
    ) -> Option<Row>;

    /// Loads `N` scalars for each lane, which lie one behind another at the lane's offset from `base`.
    ///
    /// # Safety
    /// There are as many scalars at each place, and the rows are a frame's.
    unsafe fn load_apart<T: Lane, const N: usize>(base: *const u8, offsets: &Row, rows: Rows<N>);
}

/// Loads `N` scalars of the active lanes of a subgroup, one behind another at each lane's offset in `size_bytes` bytes from `base`; false,
/// and nothing is done, if one is not inside.
///
/// # Safety
/// As for [`Gather`]; as many bytes may be read at `base`, some lane is active, and the rows are a frame's.
#[inline(always)]
pub(super) unsafe fn load<G: Gather, T: Lane, const N: usize>(
    (base, size_bytes): (*const u8, u64),
    offsets: &Row,
    active: LaneMask,
    rows: Rows<N>,
) -> bool {
    let total = (N * size_of::<T>()) as u32;
    // Offsets are 32 bits wide: what lies behind those would wrap.
    let Some(last) = size_bytes.min(1 << 32).checked_sub(total.into()) else {
        return false;
    };
    // SAFETY: as the caller promises; offsets are checked.
    unsafe {
        let filled;
        let offsets = match active {
            LaneMask::ALL => offsets,
            _ => {
                filled = G::fill(offsets, active);
                &filled
            }
        };
        match G::layout(offsets, last as u32, total) {
            Layout::Outside => return false,
            Layout::Same => {
                let at = base.add(offsets[0] as usize).cast::<T>();
                for (k, row) in rows.into_iter().enumerate() {
                    let scalar = at.add(k).read_unaligned().write();
                    *row.cast::<[T::Slot; SUBGROUP_SIZE]>() = [scalar; SUBGROUP_SIZE];
                }
            }
            Layout::Run if N == 1 || total == 4 => {
                load_run::<T, N>(base.add(offsets[0] as usize), rows);
            }
            Layout::Run | Layout::Apart => {
                // Hidden: single offsets would be taken out of the vectors that were looked at, which costs more than to load them again.
                let offsets = std::hint::black_box(offsets as *const Row);
                G::load_apart::<T, N>(base, &*offsets, rows);
            }
        }
    }
    true
}

/// [`load`] of any number of scalars, whose rows are given by their numbers.
///
/// # Safety
/// As there. Where a scalar is not inside, rows of others may have been written.
#[inline(always)]
pub(super) unsafe fn load_many<G: Gather, T: Lane>(
    (base, size_bytes): (*const u8, u64),
    offsets: &Row,
    active: LaneMask,
    (count, row): (usize, impl Fn(usize) -> *mut u8),
) -> bool {
    // What lies behind 32 bits would wrap.
    let size_bytes = size_bytes.min(1 << 32);
    // A loop without closures: those have no tier, and its instructions would be calls in them.
    for k in (0..count).step_by(4) {
        let skip = k * size_of::<T>();
        let Some(rest) = size_bytes.checked_sub(skip as u64) else {
            return false;
        };
        // SAFETY: as the caller promises.
        let is_done = unsafe {
            let memory = (base.add(skip), rest);
            match count - k {
                1 => load::<G, T, 1>(memory, offsets, active, [row(k)]),
                2 => load::<G, T, 2>(memory, offsets, active, [row(k), row(k + 1)]),
                3 => {
                    let rows = [row(k), row(k + 1), row(k + 2)];
                    load::<G, T, 3>(memory, offsets, active, rows)
                }
                _ => {
                    let rows = [row(k), row(k + 1), row(k + 2), row(k + 3)];
                    load::<G, T, 4>(memory, offsets, active, rows)
                }
            }
        };
        if !is_done {
            return false;
        }
    }
    true
}

/// Loads `N` scalars for each lane, one lane's behind another's: a single one, or as many as fill 32 bits.
///
/// # Safety
/// There are as many scalars at the address; the rows are a frame's.
#[inline(always)]
unsafe fn load_run<T: Lane, const N: usize>(at: *const u8, rows: Rows<N>) {
    // SAFETY: as the caller promises.
    unsafe {
        if N == 1 {
            let from = at.cast::<[T; SUBGROUP_SIZE]>().read_unaligned();
            let to = &mut *rows[0].cast::<[T::Slot; SUBGROUP_SIZE]>();
            for k in 0..SUBGROUP_SIZE {
                to[k] = from[k].write();
            }
            return;
        }
        let from = at.cast::<Row>().read_unaligned();
        let bits = 8 * size_of::<T>() as u32;
        for (k, row) in rows.into_iter().enumerate() {
            let to = &mut *row.cast::<Row>();
            for lane in 0..SUBGROUP_SIZE {
                to[lane] = from[lane] >> (k as u32 * bits) & ((1 << bits) - 1);
            }
        }
    }
}

impl Gather for Portable {
    #[inline(always)]
    unsafe fn layout(offsets: &Row, last: u32, size_bytes: u32) -> Layout {
        let first = offsets[0];
        let (mut highest, mut others, mut apart) = (*offsets, 0, 0);
        for k in 0..SUBGROUP_SIZE {
            others |= offsets[k] ^ first;
            apart |= offsets[k] ^ first.wrapping_add(k as u32 * size_bytes);
        }
        for step in [8, 4, 2, 1] {
            for k in 0..step {
                highest[k] = highest[k].max(highest[k + step]);
            }
        }
        match () {
            _ if highest[0] > last => Layout::Outside,
            _ if others == 0 => Layout::Same,
            _ if apart == 0 && first < offsets[SUBGROUP_SIZE - 1] => Layout::Run,
            _ => Layout::Apart,
        }
    }

    #[inline(always)]
    unsafe fn fill(offsets: &Row, active: LaneMask) -> Row {
        let first = offsets[active.first()];
        let mut filled = [first; SUBGROUP_SIZE];
        for k in 0..SUBGROUP_SIZE {
            filled[k] = if active.contains(k) {
                offsets[k]
            } else {
                first
            };
        }
        filled
    }

    #[inline(always)]
    unsafe fn distances(
        addresses: &[u64; SUBGROUP_SIZE],
        start: u64,
        active: LaneMask,
    ) -> Option<Row> {
        let (mut distances, mut far) = ([0; SUBGROUP_SIZE], 0);
        for k in 0..SUBGROUP_SIZE {
            let distance = addresses[k].wrapping_sub(start);
            let distance = if active.contains(k) { distance } else { 0 };
            far |= distance >> 32;
            distances[k] = distance as u32;
        }
        (far == 0).then_some(distances)
    }

    #[inline(always)]
    unsafe fn load_apart<T: Lane, const N: usize>(base: *const u8, offsets: &Row, rows: Rows<N>) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as the caller promises; every x86-64 processor has SSE2.
        unsafe {
            x86::load_apart::<std::arch::x86_64::__m128i, T, N>(base, offsets, rows)
        };
        #[cfg(not(target_arch = "x86_64"))]
        // SAFETY: as the caller promises.
        unsafe {
            load_singly::<T, N>(base, offsets, rows)
        };
    }
}

/// [`Gather::load_apart`], scalar by scalar.
///
/// # Safety
/// As there.
#[inline(always)]
unsafe fn load_singly<T: Lane, const N: usize>(base: *const u8, offsets: &Row, rows: Rows<N>) {
    for (lane, &offset) in offsets.iter().enumerate() {
        for (scalar, row) in rows.into_iter().enumerate() {
            // SAFETY: as the caller promises.
            unsafe {
                let at = base.add(offset as usize).cast::<T>().add(scalar);
                *row.cast::<T::Slot>().add(lane) = at.read_unaligned().write();
            }
        }
    }
}
