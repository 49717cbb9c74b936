//! Loads and stores in buffers, in workgroup memory and through physical pointers.
//!
//! Lanes of a subgroup that share memory have their addresses checked together ([`gather`]); lanes
//! outside are masked. Scalars are checked one by one only for lanes that share no memory with
//! others, and for lanes whose access straddles the end of the memory.

use std::marker::PhantomData;

use lanes::{LaneMask, Row, Tier as TierKind};

use super::code::AccessPlan;
use super::gather::{self, Gather, Layout};
use super::kernels::Lane;
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::region::{read_scalar, region};
use super::tier::{Kernel, Portable};
use crate::SUBGROUP_SIZE;
use crate::ir::{Space, Type};

/// The handler that loads or stores so many scalars of a type in a tier. Not for private memory.
pub(super) fn handler(tier: TierKind, ty: Type, count: usize, store: bool) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<super::tier::Avx2>(ty, count, store),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<super::tier::Avx512>(ty, count, store),
        _ => in_tier::<Portable>(ty, count, store),
    }
}

/// The handler of strided accesses.
pub(super) fn strided(tier: TierKind, ty: Type, store: bool) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => strided_in::<super::tier::Avx2>(ty, store),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => strided_in::<super::tier::Avx512>(ty, store),
        _ => strided_in::<Portable>(ty, store),
    }
}

fn strided_in<G: Gather>(ty: Type, store: bool) -> Handler {
    match (ty.size_bytes(), store) {
        (1, false) => G::handler::<Strided<In, G, u8>>(),
        (2, false) => G::handler::<Strided<In, G, u16>>(),
        (_, false) => G::handler::<Strided<In, G, u32>>(),
        (1, true) => G::handler::<Strided<Out, G, u8>>(),
        (2, true) => G::handler::<Strided<Out, G, u16>>(),
        (_, true) => G::handler::<Strided<Out, G, u32>>(),
    }
}

fn in_tier<G: Gather>(ty: Type, count: usize, store: bool) -> Handler {
    match (ty.size_bytes(), store) {
        (1, false) => of_count::<In, G, u8>(count),
        (2, false) => of_count::<In, G, u16>(count),
        (4, false) => of_count::<In, G, u32>(count),
        (_, false) => of_count::<In, G, u64>(count),
        (1, true) => of_count::<Out, G, u8>(count),
        (2, true) => of_count::<Out, G, u16>(count),
        (4, true) => of_count::<Out, G, u32>(count),
        (_, true) => of_count::<Out, G, u64>(count),
    }
}

fn of_count<C: Copying, G: Gather, T: Lane>(count: usize) -> Handler {
    match count {
        1 => G::handler::<Accessing<C, G, T, 1>>(),
        2 => G::handler::<Accessing<C, G, T, 2>>(),
        3 => G::handler::<Accessing<C, G, T, 3>>(),
        4 => G::handler::<Accessing<C, G, T, 4>>(),
        _ => G::handler::<Accessing<C, G, T, 0>>(),
    }
}

/// A plan's address operands and scalars.
#[inline(always)]
pub(super) fn operands<'c>(m: &Machine<'c>, plan: &AccessPlan) -> (&'c [Operand], &'c [Operand]) {
    let all = &m.code.operands[plan.operands as usize..];
    let (address, rest) = all.split_at(plan.space.address_operands());
    (address, &rest[..plan.scalars as usize])
}

/// The buffer that all lanes of an access share, if they do: first byte and size.
///
/// # Safety
/// As [`Kernel::run`].
#[inline(always)]
unsafe fn uniform_buffer(
    m: &Machine<'_>,
    plan: &AccessPlan,
    address: &[Operand],
) -> Option<(*mut u8, u64)> {
    let is_uniform = plan.space == Space::Buffer && address[0].is_uniform();
    is_uniform.then(|| {
        // SAFETY: the caller keeps the contract of `Kernel::run`; a uniform operand is the same in
        // the first lane.
        let region = unsafe { region(m, plan.space, address, m.list[0], 0) };
        (region.base, region.size_bytes)
    })
}

/// Copies scalars between memory and rows.
trait Copying: 'static {
    /// From memory to rows.
    const LOADS: bool;
    /// The lanes of a subgroup that access memory.
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask;
    /// [`Gather::load`] or [`Gather::store`].
    ///
    /// # Safety
    /// As there.
    unsafe fn copy_all<G: Gather, T: Lane, const N: usize>(
        memory: (*mut u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: gather::RowPointers<N>,
    ) -> LaneMask;
    /// A scalar of each lane, side by side in memory.
    ///
    /// # Safety
    /// As for [`Kernel::run`]: the address is of so many scalars, and the row one of the frame's.
    unsafe fn copy_line<T: Lane>(at: *mut u8, row: *mut u8);
    /// # Safety
    /// As for [`Kernel::run`]: the address is of a scalar, and the row one of the frame's.
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize);
    /// The result for a scalar outside the memory.
    ///
    /// # Safety
    /// As [`Self::copy`].
    unsafe fn miss<T: Lane>(row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize);
}

struct In;
struct Out;

impl Copying for In {
    const LOADS: bool = true;

    #[inline(always)]
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask {
        m.active[subgroup as usize]
    }

    #[inline(always)]
    unsafe fn copy_all<G: Gather, T: Lane, const N: usize>(
        (base, size_bytes): (*mut u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: gather::RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { G::load::<T, N>((base, size_bytes), offsets, active, rows) }
    }

    #[inline(always)]
    unsafe fn copy_line<T: Lane>(at: *mut u8, row: *mut u8) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { gather::load_run::<T, 1>(at, [row]) }
    }

    #[inline(always)]
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { (*row)[lane] = at.read_unaligned().write() };
    }
    #[inline(always)]
    unsafe fn miss<T: Lane>(row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { (*row)[lane] = T::Slot::default() };
    }
}

impl Copying for Out {
    const LOADS: bool = false;

    #[inline(always)]
    fn lanes(m: &Machine<'_>, subgroup: u16) -> LaneMask {
        m.effective(subgroup)
    }

    #[inline(always)]
    unsafe fn copy_all<G: Gather, T: Lane, const N: usize>(
        memory: (*mut u8, u64),
        offsets: &Row,
        active: LaneMask,
        rows: gather::RowPointers<N>,
    ) -> LaneMask {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { G::store::<T, N>(memory, offsets, active, rows) }
    }

    #[inline(always)]
    unsafe fn copy_line<T: Lane>(at: *mut u8, row: *mut u8) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { gather::store_run::<T>(at, row) }
    }

    #[inline(always)]
    unsafe fn copy<T: Lane>(at: *mut T, row: *mut [T::Slot; SUBGROUP_SIZE], lane: usize) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { at.write_unaligned(T::read((*row)[lane])) };
    }
    #[inline(always)]
    unsafe fn miss<T: Lane>(_: *mut [T::Slot; SUBGROUP_SIZE], _: usize) {}
}

/// A load or store by plan `x`, of `N` scalars of `T`'s size; 0: of any number.
struct Accessing<C, G, T, const N: usize>(PhantomData<(C, G, T)>);

impl<C: Copying, G: Gather, T: Lane, const N: usize> Kernel for Accessing<C, G, T, N> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.accesses[i.x as usize];
        let (address, scalars) = operands(m, plan);
        // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and the
        // machine runs its program; rows of results are apart from those of addresses.
        unsafe {
            if plan.alignment != 0 {
                check_alignment(m, plan, address);
            }
            if C::LOADS && address.iter().all(|operand| operand.is_uniform()) {
                return load_once(m, plan, address, scalars);
            }
            let buffer = uniform_buffer(m, plan, address);
            let from = m.row(address[address.len() - 1]);
            let rows: [_; N] = std::array::from_fn(|k| m.row(scalars[k]));
            for &subgroup in m.listed() {
                let s = subgroup as usize;
                let active = C::lanes(m, subgroup);
                if !C::LOADS && active.is_empty() {
                    continue;
                }
                let from = from.0.add(s * from.1);
                let rows = rows.map(|(row, step)| row.add(s * step));
                let all = (scalars.len(), |k: usize| {
                    m.block::<T::Slot>(scalars[k], subgroup).cast()
                });
                let memory = match plan.space {
                    Space::Shared => Some(m.workgroup_memory(subgroup)),
                    _ => buffer,
                };
                let distances;
                let (memory, offsets) = match (memory, plan.space) {
                    (Some(memory), _) => (memory, &*from.cast()),
                    (None, Space::Global) => {
                        let near = m.near.get();
                        distances = G::distances(&*from.cast(), near.start);
                        // `u32::MAX` stands for all larger distances, so it must be outside.
                        let size_bytes = near.size_bytes.min(u32::MAX.into());
                        ((near.start as *mut u8, size_bytes), &distances)
                    }
                    (None, Space::Buffer64) => {
                        let start;
                        (start, distances) =
                            match offsets_in_64_bits::<G>(m, address, subgroup, active) {
                                Some(found) => found,
                                None => {
                                    copy_scalars::<C, T>(
                                        m,
                                        plan,
                                        (address, scalars),
                                        subgroup,
                                        active,
                                    );
                                    continue;
                                }
                            };
                        (start, &distances)
                    }
                    // Descriptors that lanes may differ in, but mostly do not.
                    _ => match m.common(address[0], subgroup, active) {
                        Some(descriptor) => {
                            let descriptor = m.environment.descriptor(descriptor);
                            let memory = (descriptor.address as *mut u8, descriptor.size_bytes);
                            (memory, &*from.cast())
                        }
                        None => {
                            copy_scalars::<C, T>(m, plan, (address, scalars), subgroup, active);
                            continue;
                        }
                    },
                };
                let mut left = copy_block::<C, G, T, N>(memory, offsets, active, rows, all);
                let is_whole = matches!(plan.space, Space::Shared | Space::Buffer);
                if is_whole && !left.is_empty() {
                    // Outside this memory there is none. Scalars may still be inside one by one.
                    let total = (scalars.len() * size_of::<T>()) as u64;
                    left = gather::straddling::<G>(offsets, left, (memory.1, total));
                }
                if !left.is_empty() {
                    copy_scalars::<C, T>(m, plan, (address, scalars), subgroup, left);
                }
            }
        }
    }
}

/// A part of the buffer that the lanes share, and how far behind its start each accesses it: the
/// part from the first lane's offset less 2 GiB on. `u32::MAX` stands for offsets outside the part.
///
/// # Safety
/// As [`Kernel::run`]; the access is to a buffer with offsets of 64 bits.
#[inline(always)]
unsafe fn offsets_in_64_bits<G: Gather>(
    m: &Machine<'_>,
    address: &[Operand],
    subgroup: u16,
    active: LaneMask,
) -> Option<((*mut u8, u64), Row)> {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let descriptor = m.common(address[0], subgroup, active)?;
        let descriptor = m.environment.descriptor(descriptor);
        let offsets = &*m.block::<u64>(address[1], subgroup);
        let first = offsets[active.first() & (SUBGROUP_SIZE - 1)];
        let start = first.saturating_sub(1 << 31).min(descriptor.size_bytes);
        let distances = G::distances(offsets, start);
        // `u32::MAX` must be outside.
        let size_bytes = (descriptor.size_bytes - start).min(u32::MAX.into());
        let base = (descriptor.address as *mut u8).wrapping_add(start as usize);
        Some(((base, size_bytes), distances))
    }
}

/// A strided load or store by plan `x`: of a matrix, mostly, of which each lane has a column.
struct Strided<C, G, T>(PhantomData<(C, G, T)>);

impl<C: Copying, G: Gather, T: Lane> Kernel for Strided<C, G, T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.accesses[i.x as usize];
        let (address, scalars) = operands(m, plan);
        let size_bytes = size_of::<T>() as u32;
        // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and the
        // machine runs its program; rows of results are apart from those of addresses.
        unsafe {
            for &subgroup in m.listed() {
                let active = C::lanes(m, subgroup);
                if active.is_empty() {
                    continue;
                }
                let memory = match plan.space {
                    Space::Shared => Some(m.workgroup_memory(subgroup)),
                    _ => m.common(address[0], subgroup, active).map(|descriptor| {
                        let descriptor = m.environment.descriptor(descriptor);
                        (descriptor.address as *mut u8, descriptor.size_bytes)
                    }),
                };
                let Some(memory) = memory else {
                    copy_scalars::<C, T>(m, plan, (address, scalars), subgroup, active);
                    continue;
                };
                let mut offsets = *m.block::<u32>(address[address.len() - 1], subgroup);
                let strides = &*m.block::<u32>(plan.stride, subgroup);
                let stride = u64::from(strides[0]);
                // Lines of which each is a run of scalars, all inside.
                let last = u64::from(offsets[0])
                    + stride * (scalars.len() as u64 - 1)
                    + (SUBGROUP_SIZE as u32 * size_bytes) as u64;
                if active == LaneMask::ALL
                    && last <= memory.1.min(1 << 32)
                    && G::layout(&offsets, u32::MAX - size_bytes, size_bytes) == Layout::Run
                    && G::layout(strides, u32::MAX, 0) == Layout::Same
                {
                    let mut at = memory.0.add(offsets[0] as usize);
                    for &scalar in scalars {
                        C::copy_line::<T>(at, m.block::<u32>(scalar, subgroup).cast());
                        at = at.wrapping_add(stride as usize);
                    }
                    continue;
                }
                for &scalar in scalars {
                    let row = m.block::<T::Slot>(scalar, subgroup).cast();
                    // Nothing is left to do for lanes outside: scalars are inside or not.
                    C::copy_all::<G, T, 1>(memory, &offsets, active, [row]);
                    for lane in 0..SUBGROUP_SIZE {
                        offsets[lane] = offsets[lane].wrapping_add(strides[lane]);
                    }
                }
            }
        }
    }
}

/// A subgroup's part of an access to memory that its lanes share: of `N` scalars, whose rows are
/// `rows`, or if `N` is 0 of the count and rows that the last argument gives. Returns the active
/// lanes that have a scalar outside. Loads give zeros there.
///
/// # Safety
/// As [`gather::load`].
#[inline(always)]
unsafe fn copy_block<C: Copying, G: Gather, T: Lane, const N: usize>(
    (base, size_bytes): (*mut u8, u64),
    offsets: &Row,
    active: LaneMask,
    rows: gather::RowPointers<N>,
    (count, row): (usize, impl Fn(usize) -> *mut u8),
) -> LaneMask {
    if N != 0 {
        // SAFETY: the caller keeps the contract of this function.
        return unsafe { C::copy_all::<G, T, N>((base, size_bytes), offsets, active, rows) };
    }
    // Offsets past 32 bits would wrap.
    let size_bytes = size_bytes.min(1 << 32);
    let mut outside = LaneMask::NONE;
    // Shorter scalars as many at once as fill four words.
    let most = (16 / size_of::<T>()).max(4);
    let mut done = 0;
    // A loop without closures: those have no tier, and its instructions would be calls in them.
    while done < count {
        let k = done;
        let skip = k * size_of::<T>();
        done += if count - k < most { 4 } else { most };
        // SAFETY: the caller keeps the contract of this function.
        outside |= unsafe {
            let rest = size_bytes.saturating_sub(skip as u64);
            let memory = (base.wrapping_add(skip), rest);
            match count - k {
                _ if size_of::<T>() == 1 && done - k == 16 => {
                    let rows = std::array::from_fn(|scalar| row(k + scalar));
                    C::copy_all::<G, T, 16>(memory, offsets, active, rows)
                }
                _ if size_of::<T>() == 2 && done - k == 8 => {
                    let rows = std::array::from_fn(|scalar| row(k + scalar));
                    C::copy_all::<G, T, 8>(memory, offsets, active, rows)
                }
                1 => C::copy_all::<G, T, 1>(memory, offsets, active, [row(k)]),
                2 => C::copy_all::<G, T, 2>(memory, offsets, active, [row(k), row(k + 1)]),
                3 => {
                    let rows = [row(k), row(k + 1), row(k + 2)];
                    C::copy_all::<G, T, 3>(memory, offsets, active, rows)
                }
                _ => {
                    let rows = [row(k), row(k + 1), row(k + 2), row(k + 3)];
                    C::copy_all::<G, T, 4>(memory, offsets, active, rows)
                }
            }
        };
    }
    outside
}

/// An access of some lanes with a check of each scalar: lanes that straddle the end of the memory,
/// or share no memory with others.
///
/// # Safety
/// As [`Kernel::run`]; the subgroup is one of the wave's.
#[inline(never)]
unsafe fn copy_scalars<C: Copying, T: Lane>(
    m: &Machine<'_>,
    plan: &AccessPlan,
    (address, scalars): (&[Operand], &[Operand]),
    subgroup: u16,
    lanes: LaneMask,
) {
    let size = size_of::<T>() as u64;
    for lane in lanes {
        // SAFETY: the caller keeps the contract of `Kernel::run`; the subgroup is one of the
        // wave's; addresses are checked.
        unsafe {
            let region = region(m, plan.space, address, subgroup, lane);
            let stride = match plan.stride {
                Operand::NONE => size,
                stride => m.lane(stride, subgroup, lane, false),
            };
            for (k, &scalar) in scalars.iter().enumerate() {
                let row = m.block::<T::Slot>(scalar, subgroup);
                match region.at(k as u64 * stride, size) {
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
            // SAFETY: the caller keeps the contract of this function.
            let address = unsafe { m.lane(address[0], subgroup, lane, true) };
            if !address.is_multiple_of(alignment) {
                strays.count(m.program, m.pc, address, alignment);
            }
        }
    }
}

/// A load whose address is the same in all lanes.
///
/// # Safety
/// As [`Kernel::run`].
unsafe fn load_once(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand], results: &[Operand]) {
    // Subgroups may be of several workgroups, each of which has its memory.
    let together = match plan.space {
        Space::Shared => 1,
        _ => m.list_len.max(1),
    };
    for subgroups in m.listed().chunks(together) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load_for(m, plan, (address, results), subgroups) };
    }
}

/// [`load_once`] for subgroups that share the memory.
///
/// # Safety
/// As [`Kernel::run`]; the subgroups are some of the wave's, at least one.
unsafe fn load_for(
    m: &Machine<'_>,
    plan: &AccessPlan,
    (address, results): (&[Operand], &[Operand]),
    subgroups: &[u16],
) {
    let size = plan.ty.size_bytes();
    // SAFETY: the caller keeps the contract of `Kernel::run`; the subgroups are some of the wave's,
    // at least one; uniform rows serve every subgroup.
    unsafe {
        let region = region(m, plan.space, address, subgroups[0], 0);
        for (k, &result) in results.iter().enumerate() {
            let at = region.at(k as u64 * size as u64, size as u64);
            let value = at.map_or(0, |at| read_scalar(at, size));
            for &subgroup in subgroups {
                if plan.ty.rows() == 2 {
                    *m.block::<u64>(result, subgroup) = [value; SUBGROUP_SIZE];
                } else {
                    *m.block::<u32>(result, subgroup) = [value as u32; SUBGROUP_SIZE];
                }
            }
        }
    }
}
