//! Loads and stores in buffers, in workgroup memory and through physical pointers.
//!
//! The addresses of a subgroup's lanes are found and checked together. Where one of them is not inside, that subgroup's scalars are
//! checked one by one, as robustness has it.

use std::marker::PhantomData;

use lanes::{LaneMask, Tier as TierKind};

use super::code::AccessPlan;
use super::gather::{self, Gather};
use super::kernels::Lane;
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::region::{Region, read_scalar, region};
use super::tier::{Kernel, Portable};
use crate::SUBGROUP_SIZE;
use crate::ir::{Space, Type};
use crate::row::Row;

/// What loads scalars of a type, or stores them, so many of them, in a tier. Not for private memory.
pub(super) fn handler(tier: TierKind, ty: Type, count: usize, store: bool) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<super::tier::Avx2>(ty, count, store),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<super::tier::Avx512>(ty, count, store),
        _ => in_tier::<Portable>(ty, count, store),
    }
}

fn in_tier<T: Gather>(ty: Type, count: usize, store: bool) -> Handler {
    match (ty.size_bytes(), store) {
        (1, false) => load::<T, u8>(count),
        (2, false) => load::<T, u16>(count),
        (4, false) => load::<T, u32>(count),
        (_, false) => load::<T, u64>(count),
        (1, true) => T::handler::<Store<u8>>(),
        (2, true) => T::handler::<Store<u16>>(),
        (4, true) => T::handler::<Store<u32>>(),
        (_, true) => T::handler::<Store<u64>>(),
    }
}

fn load<T: Gather, S: Lane>(count: usize) -> Handler {
    match count {
        1 => T::handler::<Load<T, S, 1>>(),
        2 => T::handler::<Load<T, S, 2>>(),
        3 => T::handler::<Load<T, S, 3>>(),
        4 => T::handler::<Load<T, S, 4>>(),
        _ => T::handler::<Load<T, S, 0>>(),
    }
}

/// A plan's address operands and scalars.
#[inline(always)]
pub(super) fn operands<'c>(m: &Machine<'c>, plan: &AccessPlan) -> (&'c [Operand], &'c [Operand]) {
    let all = &m.code.operands[plan.operands as usize..];
    let (address, rest) = all.split_at(plan.space.address_operands());
    (address, &rest[..plan.scalars as usize])
}

/// Where the lanes of a subgroup have their scalars, if all of those that access memory have them all.
///
/// # Safety
/// As [`Kernel::run`]; the subgroup is one of the wave's, and `shared` is what [`shared_region`] gave.
#[inline(always)]
unsafe fn places(
    m: &Machine<'_>,
    space: Space,
    shared: &Option<Region>,
    address: &[Operand],
    subgroup: u16,
    active: LaneMask,
    size_bytes: u64,
) -> Option<[u64; SUBGROUP_SIZE]> {
    // SAFETY: as the caller promises.
    unsafe {
        if let Some(region) = shared {
            let offsets = &*m.block::<u32>(address[address.len() - 1], subgroup);
            let base = region.base as u64;
            let mut addresses = [0; SUBGROUP_SIZE];
            for k in 0..SUBGROUP_SIZE {
                addresses[k] = base.wrapping_add(offsets[k] as u64);
            }
            // Offsets are 32 bits wide: what lies behind those would wrap.
            let last = region.size_bytes.min(1 << 32).checked_sub(size_bytes)?;
            return all_within(&addresses, active, base, last).then_some(addresses);
        }
        if space == Space::Global {
            let near = m.near.get();
            let addresses = *m.block::<u64>(address[0], subgroup);
            let last = near.size_bytes.checked_sub(size_bytes)?;
            return all_within(&addresses, active, near.start, last).then_some(addresses);
        }
        let mut addresses = [0; SUBGROUP_SIZE];
        for lane in active {
            let region = region(m, space, address, subgroup, lane);
            addresses[lane] = region.run_at(0, size_bytes)? as u64;
        }
        Some(addresses)
    }
}

/// Whether the addresses of active lanes are at most `last` past `first`.
#[inline(always)]
fn all_within(addresses: &[u64; SUBGROUP_SIZE], active: LaneMask, first: u64, last: u64) -> bool {
    let mut outside = [0u32; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        let is_outside = addresses[k].wrapping_sub(first) > last;
        outside[k] = if is_outside { 1 << k } else { 0 };
    }
    outside.iter().fold(0, |all, bit| all | bit) as u16 & active.bits() == 0
}

/// The memory that all lanes of an access share, if they do.
///
/// # Safety
/// As [`Kernel::run`].
#[inline(always)]
unsafe fn shared_region(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand]) -> Option<Region> {
    let uniform_buffer = plan.space == Space::Buffer && address[0].is_uniform();
    // SAFETY: as the caller promises; a uniform operand is the same in the first lane.
    (uniform_buffer || plan.space == Space::Shared)
        .then(|| unsafe { region(m, plan.space, address, m.list[0], 0) })
}

/// Copies scalars between memory and rows.
trait Copying {
    /// The lanes of a subgroup that access memory.
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask;
    /// # Safety
    /// As for [`Kernel::run`]: the address is of a scalar, and the row one of the frame's.
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize);
    /// What becomes of a scalar that is not there.
    ///
    /// # Safety
    /// As [`Self::copy`].
    unsafe fn miss<T: Lane>(row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize);
}

struct In;
struct Out;

impl Copying for In {
    #[inline(always)]
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask {
        m.active[subgroup as usize]
    }

    #[inline(always)]
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: as the caller promises.
        unsafe { (*row)[lane] = at.read_unaligned().write() };
    }
    #[inline(always)]
    unsafe fn miss<T: Lane>(row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: as the caller promises.
        unsafe { (*row)[lane] = T::Slot::default() };
    }
}

impl Copying for Out {
    #[inline(always)]
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask {
        m.effective(subgroup)
    }

    #[inline(always)]
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: as the caller promises.
        unsafe { at.write_unaligned(T::read((*row)[lane])) };
    }
    #[inline(always)]
    unsafe fn miss<T: Lane>(_: *mut [T::Slot; SUBGROUP_SIZE], _: usize) {}
}

/// One lane's scalars.
///
/// # Safety
/// As [`copy_inside`].
#[inline(always)]
unsafe fn copy_lane<C: Copying, T: Lane, const N: usize>(
    addresses: &[u64; SUBGROUP_SIZE],
    rows: &[*mut [T::Slot; SUBGROUP_SIZE]; N],
    lane: usize,
) {
    for k in 0..N {
        // SAFETY: as the caller promises.
        unsafe { C::copy((addresses[lane] as *mut T).add(k), rows[k], lane) };
    }
}

/// The scalars of an access, all of whose active lanes are inside: lane by lane, so that the order of stores is that of the lanes.
///
/// # Safety
/// The addresses of active lanes are of as many scalars as there are rows, and the rows are the frame's.
// Not inlined: the addresses would be taken apart into more registers than there are.
#[inline(never)]
unsafe fn copy_inside<C: Copying, T: Lane, const N: usize>(
    addresses: &[u64; SUBGROUP_SIZE],
    rows: [*mut [T::Slot; SUBGROUP_SIZE]; N],
    active: LaneMask,
) {
    // SAFETY: as the caller promises.
    unsafe {
        if active == LaneMask::ALL {
            for lane in 0..SUBGROUP_SIZE {
                copy_lane::<C, T, N>(addresses, &rows, lane);
            }
        } else {
            for lane in active {
                copy_lane::<C, T, N>(addresses, &rows, lane);
            }
        }
    }
}

/// One subgroup's part of an access.
///
/// # Safety
/// As [`Kernel::run`]; the subgroup is one of the wave's, and `shared` is what [`shared_region`] gave.
#[inline(always)]
unsafe fn access_block<C: Copying, T: Lane>(
    m: &Machine<'_>,
    plan: &AccessPlan,
    shared: &Option<Region>,
    (address, scalars): (&[Operand], &[Operand]),
    subgroup: u16,
) {
    let active = C::lanes(m, subgroup);
    let size = size_of::<T>() as u64;
    // SAFETY: as the caller promises; addresses are checked, and rows of results are apart from those of addresses.
    unsafe {
        let total = size * scalars.len() as u64;
        let row = |k: usize| m.block::<T::Slot>(scalars[k], subgroup);
        let Some(at) = &places(m, plan.space, shared, address, subgroup, active, total) else {
            return access_scalars::<C, T>(m, plan.space, (address, scalars), subgroup);
        };
        match scalars.len() {
            1 => copy_inside::<C, T, 1>(at, [row(0)], active),
            2 => copy_inside::<C, T, 2>(at, [row(0), row(1)], active),
            3 => copy_inside::<C, T, 3>(at, [row(0), row(1), row(2)], active),
            4 => copy_inside::<C, T, 4>(at, [row(0), row(1), row(2), row(3)], active),
            count => {
                for lane in active {
                    for k in 0..count {
                        C::copy((at[lane] as *mut T).add(k), row(k), lane);
                    }
                }
            }
        }
    }
}

/// As [`access_block`], for any addresses: every scalar is checked.
///
/// # Safety
/// As [`access_block`].
#[cold]
#[inline(never)]
unsafe fn access_scalars<C: Copying, T: Lane>(
    m: &Machine<'_>,
    space: Space,
    (address, scalars): (&[Operand], &[Operand]),
    subgroup: u16,
) {
    let size = size_of::<T>() as u64;
    for lane in C::lanes(m, subgroup) {
        // SAFETY: as the caller promises; addresses are checked.
        unsafe {
            let region = region(m, space, address, subgroup, lane);
            for (k, &scalar) in scalars.iter().enumerate() {
                let row = m.block::<T::Slot>(scalar, subgroup);
                match region.at(k as u64 * size, size) {
                    Some(at) => C::copy(at.cast::<T>(), row, lane),
                    None => C::miss::<T>(row, lane),
                }
            }
        }
    }
}

/// Counts device addresses that are less aligned than their access says.
///
/// # Safety
/// As [`Kernel::run`]; the space is that of device addresses.
#[cold]
#[inline(never)]
unsafe fn check_alignment(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand]) {
    let Some(strays) = &m.environment.strays else {
        return;
    };
    let alignment = 1u64 << plan.alignment.min(63);
    for &subgroup in m.listed() {
        for lane in m.active[subgroup as usize] {
            // SAFETY: as the caller promises.
            let address = unsafe { m.lane(address[0], subgroup, lane, true) };
            if !address.is_multiple_of(alignment) {
                strays.count(m.program, m.pc, address, alignment);
            }
        }
    }
}

/// A load by plan `x`, of `N` scalars of `T`'s size; 0: of any number.
struct Load<G, T, const N: usize>(PhantomData<(G, T)>);

impl<G: Gather, T: Lane, const N: usize> Kernel for Load<G, T, N> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.accesses[i.x as usize];
        let (address, results) = operands(m, plan);
        // SAFETY: as the caller promises; rows of results are apart from those of addresses.
        unsafe {
            if plan.alignment != 0 {
                check_alignment(m, plan, address);
            }
            if address.iter().all(|operand| operand.is_uniform()) {
                return load_once(m, plan, address, results);
            }
            let shared = shared_region(m, plan, address);
            let from = m.row(address[address.len() - 1]);
            let rows: [_; N] = std::array::from_fn(|k| m.row(results[k]));
            for &subgroup in m.listed() {
                let s = subgroup as usize;
                let active = m.active[s];
                let from = from.0.add(s * from.1);
                let to = rows.map(|(row, step)| row.add(s * step));
                let many = (results.len(), |k: usize| {
                    m.block::<T::Slot>(results[k], subgroup).cast()
                });
                let is_done = match (&shared, plan.space) {
                    (Some(region), _) => {
                        let memory = (region.base.cast_const(), region.size_bytes);
                        load_block::<G, T, N>(memory, &*from.cast(), active, to, many)
                    }
                    (None, Space::Global) => {
                        let near = m.near.get();
                        let memory = (near.start as *const u8, near.size_bytes);
                        match G::distances(&*from.cast(), near.start, active) {
                            Some(distances) => {
                                let all = LaneMask::ALL;
                                load_block::<G, T, N>(memory, &distances, all, to, many)
                            }
                            None => false,
                        }
                    }
                    _ => false,
                };
                if !is_done {
                    load_slowly::<T>(m, plan, &shared, (address, results), subgroup);
                }
            }
        }
    }
}

/// A subgroup's part of a load from memory that its lanes share: `N` scalars, if that is 0 as many as it says behind; false if one is not
/// inside.
///
/// # Safety
/// As [`gather::load`].
#[inline(always)]
unsafe fn load_block<G: Gather, T: Lane, const N: usize>(
    memory: (*const u8, u64),
    offsets: &Row,
    active: LaneMask,
    rows: gather::Rows<N>,
    many: (usize, impl Fn(usize) -> *mut u8),
) -> bool {
    // SAFETY: as the caller promises.
    unsafe {
        match N {
            0 => gather::load_many::<G, T>(memory, offsets, active, many),
            _ => gather::load::<G, T, N>(memory, offsets, active, rows),
        }
    }
}

/// A subgroup's part of a load, some of which is outside, or whose lanes share no memory.
///
/// # Safety
/// As [`access_block`].
#[inline(never)]
unsafe fn load_slowly<T: Lane>(
    m: &Machine<'_>,
    plan: &AccessPlan,
    shared: &Option<Region>,
    operands: (&[Operand], &[Operand]),
    subgroup: u16,
) {
    // SAFETY: as the caller promises.
    unsafe { access_block::<In, T>(m, plan, shared, operands, subgroup) };
}

/// A store by plan `x`, of scalars of `T`'s size.
struct Store<T>(PhantomData<T>);

impl<T: Lane> Kernel for Store<T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.accesses[i.x as usize];
        let (address, values) = operands(m, &plan);
        // SAFETY: as the caller promises.
        unsafe {
            if plan.alignment != 0 {
                check_alignment(m, &plan, address);
            }
            let shared = shared_region(m, &plan, address);
            for &subgroup in m.listed() {
                access_block::<Out, T>(m, &plan, &shared, (address, values), subgroup);
            }
        }
    }
}

/// A load whose address is the same in all lanes.
///
/// # Safety
/// As [`Kernel::run`].
unsafe fn load_once(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand], results: &[Operand]) {
    let size = plan.ty.size_bytes();
    // SAFETY: as the caller promises; uniform rows serve every subgroup.
    unsafe {
        let region = region(m, plan.space, address, 0, 0);
        for (k, &result) in results.iter().enumerate() {
            let at = region.at(k as u64 * size as u64, size as u64);
            let value = at.map_or(0, |at| read_scalar(at, size));
            for &subgroup in m.listed() {
                if plan.ty.rows() == 2 {
                    *m.block::<u64>(result, subgroup) = [value; SUBGROUP_SIZE];
                } else {
                    *m.block::<u32>(result, subgroup) = [value as u32; SUBGROUP_SIZE];
                }
            }
        }
    }
}
