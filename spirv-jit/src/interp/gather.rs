//! Loads and stores of scalars for a whole subgroup, in memory that its lanes share, in each
//! instruction set.
//!
//! All lanes are checked together: which of their accesses are inside, and how they lie. Lanes that
//! load the same address, and lanes with consecutive scalars, load once. Otherwise words are
//! assembled four lanes at a time and stored in registers as wide as the tier's, so the next reader
//! of the rows need not wait for sixteen single stores. Lanes outside are masked, so
//! they do not slow the other lanes.

use lanes::{LaneMask, Row};

use super::kernels::Lane;
use super::tier::{Portable, Tier};
use crate::SUBGROUP_SIZE;

#[cfg(target_arch = "x86_64")]
mod x86;

/// Where scalars go: rows of lanes of 32 bits, for scalars of 64 bits of 64 bits.
pub(super) type RowPointers<const N: usize> = [*mut u8; N];

/// How the offsets of a subgroup's lanes lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// Some offsets are above the limit. The mask has the lanes whose offsets are not.
    Outside(LaneMask),
    /// All are equal.
    Same,
    /// Each is as far behind the one before as the scalars are long.
    Run,
    Apart,
}

/// Loads and stores of a whole subgroup in a tier.
///
/// # Safety
/// Of all functions: the machine has the tier.
pub(super) trait Gather: Tier + Sized {
    /// [`load`], in the tier's instructions.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn load<T: Lane, const N: usize>(
        memory: (*const u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load::<Self, T, N>(memory, offsets, active, rows) }
    }

    /// [`store`], in the tier's instructions.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn store<T: Lane, const N: usize>(
        memory: (*mut u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store::<Self, T, N>(memory, offsets, active, rows) }
    }

    /// How offsets lie, of which none may be above `last`, of scalars of `size_bytes` together;
    /// `last + size_bytes` is at most 2³².
    unsafe fn layout(offsets: &Row, last: u32, size_bytes: u32) -> Layout;

    /// The offsets of active lanes, of which there are some; in other lanes the first active one's.
    unsafe fn fill(offsets: &Row, active: LaneMask) -> Row;

    /// The distances of addresses from `start`; `u32::MAX` for larger ones and for addresses before
    /// `start`.
    unsafe fn distances(addresses: &[u64; SUBGROUP_SIZE], start: u64) -> Row;

    /// Loads `N` scalars for each lane, which lie one behind another at the lane's offset from
    /// `base`.
    ///
    /// # Safety
    /// There are as many scalars at each place, and the rows are a frame's.
    unsafe fn load_apart<T: Lane, const N: usize>(
        base: *const u8,
        offsets: &Row,
        rows: RowPointers<N>,
    );

    /// Stores `N` scalars of each lane, one behind another at the lane's offset from `base`, in the
    /// lanes' order.
    ///
    /// # Safety
    /// As [`Self::load_apart`].
    unsafe fn store_apart<T: Lane, const N: usize>(
        base: *mut u8,
        offsets: &Row,
        rows: RowPointers<N>,
    );

    /// Loads two or four words for each lane, which lie one behind another, one lane's behind
    /// another's. False if the tier has nothing better than [`Self::load_apart`].
    ///
    /// # Safety
    /// There are as many words at the address; the rows are a frame's.
    #[inline(always)]
    unsafe fn load_neighbours<const N: usize>(_at: *const u8, _rows: RowPointers<N>) -> bool {
        false
    }

    /// Stores two or four words of each lane in that order. False as above.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn store_neighbours<const N: usize>(_at: *mut u8, _rows: RowPointers<N>) -> bool {
        false
    }
}

/// Whether scalars of neighbouring lanes are words that [`Gather::load_neighbours`] and
/// [`Gather::store_neighbours`] take.
const fn are_neighbours<T>(count: usize) -> bool {
    size_of::<T>() == 4 && matches!(count, 2 | 4)
}

/// The highest offset that scalars of `total` bytes together may have in `size_bytes` bytes.
#[inline(always)]
fn last(size_bytes: u64, total: u32) -> Option<u32> {
    // Offsets are 32 bits wide: what lies behind those would wrap.
    let last = size_bytes.min(1 << 32).checked_sub(total.into())?;
    Some(last as u32)
}

/// Loads `N` consecutive scalars for each active lane of a subgroup, at the lane's offset in
/// `size_bytes` bytes from `base`. Lanes with a scalar outside load zeros; returns those that are
/// active.
///
/// # Safety
/// As for [`Gather`]; as many bytes may be read at `base`, some lane is active, and the rows are a
/// frame's.
#[inline(always)]
pub(super) unsafe fn load<G: Gather, T: Lane, const N: usize>(
    (base, size_bytes): (*const u8, u64),
    offsets: &Row,
    active: LaneMask,
    rows: RowPointers<N>,
) -> LaneMask {
    let total = (N * size_of::<T>()) as u32;
    // SAFETY: the caller keeps the contract of `Gather`; as many bytes may be read at `base`, some
    // lane is active, and the rows are a frame's; offsets are checked.
    unsafe {
        let Some(last) = last(size_bytes, total) else {
            clear::<T, N>(rows, LaneMask::NONE);
            return active;
        };
        let filled;
        let offsets = match active {
            LaneMask::ALL => offsets,
            _ => {
                filled = G::fill(offsets, active);
                &filled
            }
        };
        match G::layout(offsets, last, total) {
            Layout::Outside(inside) => {
                if !inside.is_empty() {
                    let filled = G::fill(offsets, inside);
                    // As below.
                    let offsets = std::hint::black_box(&raw const filled);
                    G::load_apart::<T, N>(base, &*offsets, rows);
                }
                clear::<T, N>(rows, inside);
                return active - inside;
            }
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
            Layout::Run
                if are_neighbours::<T>(N)
                    && G::load_neighbours(base.add(offsets[0] as usize), rows) => {}
            Layout::Run | Layout::Apart => {
                // Hidden: single offsets would be taken out of the vectors that were looked at,
                // which costs more than to load them again.
                let offsets = std::hint::black_box(offsets as *const Row);
                G::load_apart::<T, N>(base, &*offsets, rows);
            }
        }
    }
    LaneMask::NONE
}

/// Stores `N` scalars of the active lanes of a subgroup, one behind another at each lane's offset
/// in `size_bytes` bytes from `base`, in the lanes' order. Returns the active lanes whose scalars
/// are not all inside: none of them is stored.
///
/// # Safety
/// As [`load`]; as many bytes may be written at `base`.
#[inline(always)]
pub(super) unsafe fn store<G: Gather, T: Lane, const N: usize>(
    (base, size_bytes): (*mut u8, u64),
    offsets: &Row,
    active: LaneMask,
    rows: RowPointers<N>,
) -> LaneMask {
    let total = (N * size_of::<T>()) as u32;
    let Some(last) = last(size_bytes, total) else {
        return active;
    };
    // SAFETY: the caller keeps the contract of `load`; as many bytes may be written at `base`;
    // offsets are checked.
    unsafe {
        let filled;
        let offsets = match active {
            LaneMask::ALL => offsets,
            _ => {
                filled = G::fill(offsets, active);
                &filled
            }
        };
        let layout = G::layout(offsets, last, total);
        let inside = match layout {
            Layout::Outside(lanes) => active & lanes,
            _ => active,
        };
        match layout {
            _ if inside != LaneMask::ALL => {
                store_singly::<T, N>(base, offsets, rows, inside);
            }
            Layout::Run if N == 1 => store_run::<T>(base.add(offsets[0] as usize), rows[0]),
            Layout::Run
                if are_neighbours::<T>(N)
                    && G::store_neighbours(base.add(offsets[0] as usize), rows) => {}
            _ => {
                // As in `load`.
                let offsets = std::hint::black_box(offsets as *const Row);
                G::store_apart::<T, N>(base, &*offsets, rows);
            }
        }
        active - inside
    }
}

/// The lanes of `outside` that may still have a scalar inside `size_bytes` bytes: their access of
/// `total` bytes begins inside, or wraps, since each scalar's offset is modulo 2³².
///
/// # Safety
/// As for [`Gather`].
#[inline(always)]
pub(super) unsafe fn straddling<G: Gather>(
    offsets: &Row,
    outside: LaneMask,
    (size_bytes, total): (u64, u64),
) -> LaneMask {
    // If the first scalar is past the end and the last does not wrap, no scalar is inside.
    let Some(span) = (1u64 << 32).checked_sub(size_bytes.saturating_add(total)) else {
        return outside;
    };
    let mut behind = *offsets;
    for offset in &mut behind {
        *offset = offset.wrapping_sub(size_bytes as u32);
    }
    // SAFETY: the caller keeps the contract of this function.
    match unsafe { G::layout(&behind, span as u32, 0) } {
        Layout::Outside(behind) => outside - behind,
        _ => LaneMask::NONE,
    }
}

/// Zeroes the rows except in the kept lanes.
///
/// # Safety
/// The rows are a frame's.
#[inline(always)]
unsafe fn clear<T: Lane, const N: usize>(rows: RowPointers<N>, kept: LaneMask) {
    for row in rows {
        // SAFETY: the caller keeps the contract of this function.
        let row = unsafe { &mut *row.cast::<[T::Slot; SUBGROUP_SIZE]>() };
        let mut cleared = [T::Slot::default(); SUBGROUP_SIZE];
        for k in 0..SUBGROUP_SIZE {
            cleared[k] = match kept.contains(k) {
                true => row[k],
                false => T::Slot::default(),
            };
        }
        *row = cleared;
    }
}

/// Loads `N` scalars for each lane, one lane's behind another's: a single one, or as many as fill
/// 32 bits.
///
/// # Safety
/// There are as many scalars at the address; the rows are a frame's.
#[inline(always)]
pub(super) unsafe fn load_run<T: Lane, const N: usize>(at: *const u8, rows: RowPointers<N>) {
    // SAFETY: the caller keeps the contract of this function.
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

/// Stores a scalar of each lane, one lane's behind another's.
///
/// # Safety
/// There are as many scalars at the address; the row is a frame's.
#[inline(always)]
pub(super) unsafe fn store_run<T: Lane>(at: *mut u8, row: *mut u8) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let from = &*row.cast::<[T::Slot; SUBGROUP_SIZE]>();
        let mut scalars = [T::read(from[0]); SUBGROUP_SIZE];
        for k in 0..SUBGROUP_SIZE {
            scalars[k] = T::read(from[k]);
        }
        at.cast::<[T; SUBGROUP_SIZE]>().write_unaligned(scalars);
    }
}

/// On x86-64 few processors need it, and its size counts more than its speed: its functions are
/// shared instead of being part of each kernel.
impl Gather for Portable {
    #[cfg_attr(target_arch = "x86_64", inline(never))]
    unsafe fn load<T: Lane, const N: usize>(
        memory: (*const u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load::<Self, T, N>(memory, offsets, active, rows) }
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    unsafe fn store<T: Lane, const N: usize>(
        memory: (*mut u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store::<Self, T, N>(memory, offsets, active, rows) }
    }

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
            _ if highest[0] > last => {
                Layout::Outside(LaneMask::from_fn(|lane| offsets[lane] <= last))
            }
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
    unsafe fn distances(addresses: &[u64; SUBGROUP_SIZE], start: u64) -> Row {
        let mut distances = [0; SUBGROUP_SIZE];
        for k in 0..SUBGROUP_SIZE {
            let distance = addresses[k].wrapping_sub(start);
            let is_near = distance >> 32 == 0;
            distances[k] = if is_near { distance as u32 } else { u32::MAX };
        }
        distances
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    unsafe fn load_apart<T: Lane, const N: usize>(
        base: *const u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller guarantees that there are as many scalars at each place, and the rows
        // are a frame's; every x86-64 processor has SSE2.
        unsafe {
            x86::load_apart::<std::arch::x86_64::__m128i, T, N>(base, offsets, rows)
        };
        #[cfg(not(target_arch = "x86_64"))]
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            load_singly::<T, N>(base, offsets, rows)
        };
    }

    #[cfg_attr(target_arch = "x86_64", inline(never))]
    unsafe fn store_apart<T: Lane, const N: usize>(
        base: *mut u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller guarantees that there are as many scalars at each place, and the rows
        // are a frame's; every x86-64 processor has SSE2.
        unsafe {
            x86::store_apart::<std::arch::x86_64::__m128i, T, N>(base, offsets, rows)
        };
        #[cfg(not(target_arch = "x86_64"))]
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            store_singly::<T, N>(base, offsets, rows, LaneMask::ALL)
        };
    }
}

/// [`Gather::store_apart`], scalar by scalar, of active lanes.
///
/// # Safety
/// As there.
#[inline(always)]
unsafe fn store_singly<T: Lane, const N: usize>(
    base: *mut u8,
    offsets: &Row,
    rows: RowPointers<N>,
    active: LaneMask,
) {
    for lane in active {
        for (scalar, row) in rows.into_iter().enumerate() {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                let at = base.add(offsets[lane] as usize).cast::<T>().add(scalar);
                at.write_unaligned(T::read(*row.cast::<T::Slot>().add(lane)));
            }
        }
    }
}

/// [`Gather::load_apart`], scalar by scalar.
///
/// # Safety
/// As there.
#[inline(always)]
unsafe fn load_singly<T: Lane, const N: usize>(
    base: *const u8,
    offsets: &Row,
    rows: RowPointers<N>,
) {
    for (lane, &offset) in offsets.iter().enumerate() {
        for (scalar, row) in rows.into_iter().enumerate() {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                let at = base.add(offset as usize).cast::<T>().add(scalar);
                *row.cast::<T::Slot>().add(lane) = at.read_unaligned().write();
            }
        }
    }
}
