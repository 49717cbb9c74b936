//! Loads, stores and descriptors.
//!
//! Every access goes through [`Region`]: first byte, size, and the offset in it, checked per scalar.

use super::code::AccessPlan;
use super::kernels::Lane;
use super::machine::{Instr, Machine, Operand, lanes_of};
use crate::SUBGROUP_SIZE;
use crate::environment::Descriptor;
use crate::ir::{Space, Type};

/// Descriptors are never below this: what is, is none.
const LOWEST_ADDRESS: u64 = 1 << 16;

/// Where an access lies.
#[derive(Clone, Copy)]
pub(super) struct Region {
    base: *mut u8,
    size_bytes: u64,
    offset: u64,
}

impl Region {
    const NOWHERE: Region = Region {
        base: std::ptr::null_mut(),
        size_bytes: 0,
        offset: 0,
    };

    /// The address of `size_bytes` bytes at `skip` past the offset, if they are inside.
    #[inline(always)]
    pub(super) fn at(&self, skip: u64, size_bytes: u64) -> Option<*mut u8> {
        // Offsets are 32 bits wide and wrap, also between the scalars of one access.
        let first = (self.offset + skip) as u32 as u64;
        // SAFETY: the access is inside the region.
        (first + size_bytes <= self.size_bytes).then(|| unsafe { self.base.add(first as usize) })
    }

    /// The address of a run of scalars of `size_bytes` in all, if it is inside and does not wrap.
    #[inline(always)]
    fn run_at(&self, skip: u64, size_bytes: u64) -> Option<*mut u8> {
        let first = (self.offset + skip) as u32 as u64;
        let inside = first + size_bytes <= self.size_bytes.min(1 << 32);
        // SAFETY: the access is inside the region.
        inside.then(|| unsafe { self.base.add(first as usize) })
    }
}

/// The descriptor at an address that `Op::Descriptor` gave.
///
/// # Safety
/// The address is such a one, or zero.
#[inline(always)]
pub(super) unsafe fn descriptor_at(address: u64) -> Descriptor {
    if address < LOWEST_ADDRESS {
        return Descriptor::NULL;
    }
    // SAFETY: as the caller promises; sets outlive the dispatch.
    unsafe { *(address as *const Descriptor) }
}

/// The memory that one lane's address operands mean; not for private memory.
///
/// # Safety
/// Operands are the program's, and the lane is active.
#[inline(always)]
pub(super) unsafe fn region(
    m: &Machine<'_>,
    space: Space,
    address: &[Operand],
    offset: u16,
    lane: usize,
) -> Region {
    // SAFETY: as the caller promises.
    unsafe {
        match space {
            Space::Private => Region::NOWHERE,
            Space::Shared => Region {
                base: m.shared,
                size_bytes: m.program.shared_size_bytes as u64,
                offset: m.lane(address[0], offset, lane, false),
            },
            Space::Buffer => {
                let descriptor = descriptor_at(m.lane(address[0], offset, lane, true));
                Region {
                    base: descriptor.address as *mut u8,
                    size_bytes: descriptor.size_bytes,
                    offset: m.lane(address[1], offset, lane, false),
                }
            }
            Space::Global => {
                let address = m.lane(address[0], offset, lane, true);
                let near = m.near.get().bytes_from(address);
                Region {
                    base: address as *mut u8,
                    size_bytes: if near > 0 { near } else { look_up(m, address) },
                    offset: 0,
                }
            }
        }
    }
}

/// How much memory there is from an address on that is not near the last one. An address that leads nowhere is counted.
#[cold]
#[inline(never)]
fn look_up(m: &Machine<'_>, address: u64) -> u64 {
    match m.environment.reach.find(address) {
        Some(range) => {
            m.near.set(range);
            range.bytes_from(address)
        }
        None => {
            if let Some(strays) = &m.environment.strays {
                strays.count(m.program.number(), m.pc, address, 0);
            }
            0
        }
    }
}

/// One scalar from memory, extended with zeros.
///
/// # Safety
/// `at` may be read for the type's size. Another thread may write meanwhile: the value is then any mix of old and new, as the memory model
/// of the shader language has it.
#[inline(always)]
pub(super) unsafe fn read_scalar(at: *const u8, size_bytes: u32) -> u64 {
    // SAFETY: as the caller promises.
    unsafe {
        match size_bytes {
            1 => at.read() as u64,
            2 => at.cast::<u16>().read_unaligned() as u64,
            4 => at.cast::<u32>().read_unaligned() as u64,
            _ => at.cast::<u64>().read_unaligned(),
        }
    }
}

/// A plan's address operands and scalars.
#[inline(always)]
fn operands<'c>(m: &Machine<'c>, plan: &AccessPlan) -> (&'c [Operand], &'c [Operand]) {
    let all = &m.program.code.operands[plan.operands as usize..];
    let (address, rest) = all.split_at(plan.space.address_operands());
    (address, &rest[..plan.scalars as usize])
}

/// Most scalars whose rows are looked up once for all lanes of a subgroup.
const SCALARS_AT_ONCE: usize = 16;

/// Counts device addresses that are less aligned than their access says.
///
/// # Safety
/// As [`load`]; the space is that of device addresses.
#[cold]
unsafe fn check_alignment(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand]) {
    let Some(strays) = &m.environment.strays else {
        return;
    };
    let alignment = 1u64 << plan.alignment.min(63);
    for &offset in m.listed() {
        for lane in lanes_of(m.active[offset as usize / 64]) {
            // SAFETY: as the caller promises.
            let address = unsafe { m.lane(address[0], offset, lane, true) };
            if !address.is_multiple_of(alignment) {
                strays.count(m.program.number(), m.pc, address, alignment);
            }
        }
    }
}

/// A load by plan `x`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn load(m: &mut Machine<'_>, i: &Instr) {
    let plan = m.program.code.accesses[i.x as usize];
    let (address, results) = operands(m, &plan);
    // SAFETY: as the caller promises.
    unsafe {
        if plan.alignment != 0 {
            check_alignment(m, &plan, address);
        }
        if address.iter().all(|operand| operand.is_uniform()) {
            load_once(m, &plan, address, results);
            return;
        }
        match plan.ty.size_bytes() {
            1 => load_lanes::<u8>(m, &plan, address, results),
            2 => load_lanes::<u16>(m, &plan, address, results),
            4 => load_lanes::<u32>(m, &plan, address, results),
            _ => load_lanes::<u64>(m, &plan, address, results),
        }
    }
}

/// The memory that all lanes of an access share: base and size.
///
/// # Safety
/// As [`load`].
unsafe fn shared_region(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand]) -> Option<Region> {
    let uniform_buffer = plan.space == Space::Buffer && address[0].is_uniform();
    // SAFETY: as the caller promises; a uniform operand is the same in the first lane.
    (uniform_buffer || plan.space == Space::Shared)
        .then(|| unsafe { region(m, plan.space, address, m.list[0], 0) })
}

/// The region of one lane, given what all lanes share.
///
/// # Safety
/// As [`load`]; the lane is active.
#[inline(always)]
unsafe fn lane_region(
    m: &Machine<'_>,
    plan: &AccessPlan,
    shared: &Option<Region>,
    address: &[Operand],
    offset: u16,
    lane: usize,
) -> Region {
    // SAFETY: as the caller promises.
    unsafe {
        match shared {
            Some(region) => Region {
                offset: m.lane(address[address.len() - 1], offset, lane, false),
                ..*region
            },
            None => region(m, plan.space, address, offset, lane),
        }
    }
}

/// # Safety
/// As [`load`]; `T` has the scalars' size.
unsafe fn load_lanes<T: Lane>(
    m: &Machine<'_>,
    plan: &AccessPlan,
    address: &[Operand],
    results: &[Operand],
) {
    let size = size_of::<T>() as u64;
    // SAFETY: as the caller promises; addresses are checked, and rows of results are apart from those of addresses.
    unsafe {
        let shared = shared_region(m, plan, address);
        for &offset in m.listed() {
            let mask = m.active[offset as usize / 64];
            for (n, results) in results.chunks(SCALARS_AT_ONCE).enumerate() {
                let mut rows = [std::ptr::null_mut(); SCALARS_AT_ONCE];
                for (row, &result) in rows.iter_mut().zip(results) {
                    *row = m.block::<T::Slot>(result, offset);
                }
                let rows = &rows[..results.len()];
                let skip = (n * SCALARS_AT_ONCE) as u64 * size;
                for lane in lanes_of(mask) {
                    let region = lane_region(m, plan, &shared, address, offset, lane);
                    let whole = region.run_at(skip, size * rows.len() as u64);
                    for (k, &row) in rows.iter().enumerate() {
                        let at = match whole {
                            Some(at) => Some(at.add(k * size as usize)),
                            None => region.at(skip + k as u64 * size, size),
                        };
                        (*row)[lane] = match at {
                            Some(at) => at.cast::<T>().read_unaligned().write(),
                            None => T::Slot::default(),
                        };
                    }
                }
            }
        }
    }
}

/// A load whose address is the same in all lanes.
///
/// # Safety
/// As [`load`].
unsafe fn load_once(m: &Machine<'_>, plan: &AccessPlan, address: &[Operand], results: &[Operand]) {
    let size = plan.ty.size_bytes();
    // SAFETY: as the caller promises; uniform operands have no offset.
    unsafe {
        let region = region(m, plan.space, address, 0, 0);
        for (k, &result) in results.iter().enumerate() {
            let at = region.at(k as u64 * size as u64, size as u64);
            let value = at.map_or(0, |at| read_scalar(at, size));
            for &offset in m.listed() {
                if plan.ty.rows() == 2 {
                    *m.block::<u64>(result, offset) = [value; SUBGROUP_SIZE];
                } else {
                    *m.block::<u32>(result, offset) = [value as u32; SUBGROUP_SIZE];
                }
            }
        }
    }
}

/// A store by plan `x`.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn store(m: &mut Machine<'_>, i: &Instr) {
    let plan = m.program.code.accesses[i.x as usize];
    let (address, values) = operands(m, &plan);
    // SAFETY: as the caller promises.
    unsafe {
        if plan.alignment != 0 {
            check_alignment(m, &plan, address);
        }
        match plan.ty.size_bytes() {
            1 => store_lanes::<u8>(m, &plan, address, values),
            2 => store_lanes::<u16>(m, &plan, address, values),
            4 => store_lanes::<u32>(m, &plan, address, values),
            _ => store_lanes::<u64>(m, &plan, address, values),
        }
    }
}

/// # Safety
/// As [`load`]; `T` has the scalars' size.
unsafe fn store_lanes<T: Lane>(
    m: &Machine<'_>,
    plan: &AccessPlan,
    address: &[Operand],
    values: &[Operand],
) {
    let size = size_of::<T>() as u64;
    // SAFETY: as the caller promises; addresses are checked.
    unsafe {
        let shared = shared_region(m, plan, address);
        for &offset in m.listed() {
            let mask = m.active[offset as usize / 64];
            for (n, values) in values.chunks(SCALARS_AT_ONCE).enumerate() {
                let mut rows = [std::ptr::null_mut(); SCALARS_AT_ONCE];
                for (row, &value) in rows.iter_mut().zip(values) {
                    *row = m.block::<T::Slot>(value, offset);
                }
                let rows = &rows[..values.len()];
                let skip = (n * SCALARS_AT_ONCE) as u64 * size;
                for lane in lanes_of(mask) {
                    let region = lane_region(m, plan, &shared, address, offset, lane);
                    let whole = region.run_at(skip, size * rows.len() as u64);
                    for (k, &row) in rows.iter().enumerate() {
                        let at = match whole {
                            Some(at) => Some(at.add(k * size as usize)),
                            None => region.at(skip + k as u64 * size, size),
                        };
                        if let Some(at) = at {
                            at.cast::<T>().write_unaligned(T::read((*row)[lane]));
                        }
                    }
                }
            }
        }
    }
}

/// A load from private memory by plan `x`: row numbers count from the first private row; past the end they read zero.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn load_private(m: &mut Machine<'_>, i: &Instr) {
    let plan = m.program.code.accesses[i.x as usize];
    let (address, results) = operands(m, &plan);
    let rows = plan.ty.rows() as u64;
    for &offset in m.listed() {
        let s = offset as usize / 64;
        for lane in lanes_of(m.active[s]) {
            // SAFETY: as the caller promises; rows are checked.
            unsafe {
                let first = m.lane(address[0], offset, lane, false);
                for (k, &result) in results.iter().enumerate() {
                    let value =
                        read_private(m, s, (first + k as u64 * rows) as u32 as u64, lane, plan.ty);
                    m.set_lane(result, offset, lane, rows == 2, value);
                }
            }
        }
    }
}

/// # Safety
/// The subgroup is one of the wave's.
#[inline(always)]
unsafe fn read_private(m: &Machine<'_>, subgroup: usize, row: u64, lane: usize, ty: Type) -> u64 {
    if row + ty.rows() as u64 > m.program.private_rows as u64 {
        return 0;
    }
    // SAFETY: the row is a private one.
    unsafe {
        let row = m.program.private + row as usize;
        let low = (*m.state_row(subgroup, row))[lane] as u64;
        if ty.rows() == 2 {
            low | ((*m.state_row(subgroup, row + 1))[lane] as u64) << 32
        } else {
            low
        }
    }
}

/// # Safety
/// As [`read_private`].
#[inline(always)]
unsafe fn write_private(
    m: &Machine<'_>,
    subgroup: usize,
    row: u64,
    lane: usize,
    ty: Type,
    value: u64,
) {
    if row + ty.rows() as u64 > m.program.private_rows as u64 {
        return;
    }
    // SAFETY: the row is a private one.
    unsafe {
        let row = m.program.private + row as usize;
        (*m.state_row(subgroup, row))[lane] = value as u32;
        if ty.rows() == 2 {
            (*m.state_row(subgroup, row + 1))[lane] = (value >> 32) as u32;
        }
    }
}

/// A store to private memory by plan `x`.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn store_private(m: &mut Machine<'_>, i: &Instr) {
    let plan = m.program.code.accesses[i.x as usize];
    let (address, values) = operands(m, &plan);
    let rows = plan.ty.rows() as u64;
    for &offset in m.listed() {
        let s = offset as usize / 64;
        for lane in lanes_of(m.active[s]) {
            // SAFETY: as the caller promises; rows are checked.
            unsafe {
                let first = m.lane(address[0], offset, lane, false);
                for (k, &value) in values.iter().enumerate() {
                    let value = m.lane(value, offset, lane, rows == 2);
                    write_private(
                        m,
                        s,
                        (first + k as u64 * rows) as u32 as u64,
                        lane,
                        plan.ty,
                        value,
                    );
                }
            }
        }
    }
}

/// Reads a variable at the fixed private row `x` into `d`; `y`: 64 bits.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn variable_load(m: &mut Machine<'_>, i: &Instr) {
    let row = m.program.private + i.x as usize;
    for &offset in m.listed() {
        let s = offset as usize / 64;
        // SAFETY: as the caller promises; the emitter checked the row.
        unsafe {
            let low = *m.state_row(s, row);
            if i.y == 0 {
                *m.block::<u32>(i.d, offset) = low;
            } else {
                let high = *m.state_row(s, row + 1);
                let d = &mut *m.block::<u64>(i.d, offset);
                for k in 0..SUBGROUP_SIZE {
                    d[k] = low[k] as u64 | (high[k] as u64) << 32;
                }
            }
        }
    }
}

/// Writes active lanes of `a` to the fixed private row `x`; `y`: 64 bits.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn variable_store(m: &mut Machine<'_>, i: &Instr) {
    let row = m.program.private + i.x as usize;
    for &offset in m.listed() {
        let s = offset as usize / 64;
        let mask = m.active[s];
        // SAFETY: as the caller promises; the emitter checked the row.
        unsafe {
            let low = &mut *m.state_row(s, row);
            if i.y == 0 {
                let a = &*m.block::<u32>(i.a, offset);
                for k in 0..SUBGROUP_SIZE {
                    low[k] = if mask & 1 << k != 0 { a[k] } else { low[k] };
                }
            } else {
                let high = &mut *m.state_row(s, row + 1);
                let a = &*m.block::<u64>(i.a, offset);
                for k in 0..SUBGROUP_SIZE {
                    if mask & 1 << k != 0 {
                        low[k] = a[k] as u32;
                        high[k] = (a[k] >> 32) as u32;
                    }
                }
            }
        }
    }
}

/// Zeroes private rows `x..y` in active lanes.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn zero_private(m: &mut Machine<'_>, i: &Instr) {
    for row in i.x..i.y {
        for &offset in m.listed() {
            let s = offset as usize / 64;
            // SAFETY: as the caller promises; the emitter checked the rows.
            let words = unsafe { &mut *m.state_row(s, m.program.private + row as usize) };
            for (k, word) in words.iter_mut().enumerate() {
                *word = if m.active[s] & 1 << k != 0 { 0 } else { *word };
            }
        }
    }
}

/// `descriptor`: addresses of binding `x`'s entries, by the indices in `a`.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn descriptor(m: &mut Machine<'_>, i: &Instr) {
    static NULL: Descriptor = Descriptor::NULL;
    let binding = m.program.code.bindings[i.x as usize];
    let environment = m.environment;
    let (entries, count) = if binding.dynamic {
        (environment.dynamic, environment.dynamic_count)
    } else {
        match environment.sets.get(binding.set as usize) {
            Some(set) => (set.entries, set.count),
            None => (std::ptr::null(), 0),
        }
    };
    let end = (binding.first as u64).saturating_add(binding.count as u64);
    let end = if binding.count == u32::MAX {
        count as u64
    } else {
        end.min(count as u64)
    };
    let end = if entries.is_null() { 0 } else { end };
    for &offset in m.listed() {
        // SAFETY: as the caller promises.
        unsafe {
            let index = *m.block::<u32>(i.a, offset);
            let d = &mut *m.block::<u64>(i.d, offset);
            for k in 0..SUBGROUP_SIZE {
                let entry = binding.first as u64 + index[k] as u64;
                d[k] = if entry < end {
                    entries as u64 + entry * size_of::<Descriptor>() as u64
                } else {
                    &raw const NULL as u64
                };
            }
        }
    }
}

/// The descriptor of the push constants.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn push_constants(m: &mut Machine<'_>, i: &Instr) {
    let address = &raw const m.environment.push_constants as u64;
    for &offset in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u64>(i.d, offset) = [address; SUBGROUP_SIZE] };
    }
}

/// A descriptor's address field.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn descriptor_address(m: &mut Machine<'_>, i: &Instr) {
    for &offset in m.listed() {
        for lane in lanes_of(m.active[offset as usize / 64]) {
            // SAFETY: as the caller promises; active lanes hold addresses of descriptors.
            unsafe {
                let descriptor = descriptor_at(m.lane(i.a, offset, lane, true));
                m.set_lane(i.d, offset, lane, true, descriptor.address);
            }
        }
    }
}

/// A descriptor's size, saturated.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn buffer_size(m: &mut Machine<'_>, i: &Instr) {
    for &offset in m.listed() {
        for lane in lanes_of(m.active[offset as usize / 64]) {
            // SAFETY: as the caller promises; active lanes hold addresses of descriptors.
            unsafe {
                let descriptor = descriptor_at(m.lane(i.a, offset, lane, true));
                let size = descriptor.size_bytes.min(u32::MAX as u64);
                m.set_lane(i.d, offset, lane, false, size);
            }
        }
    }
}

/// A dispatch-wide word.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn uniform(m: &mut Machine<'_>, i: &Instr) {
    let uniforms = &m.environment.uniforms;
    let word = uniforms.get(i.x as usize).copied().unwrap_or(0);
    for &offset in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u32>(i.d, offset) = [word; SUBGROUP_SIZE] };
    }
}

/// The lane's number.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn lane_index(m: &mut Machine<'_>, i: &Instr) {
    for &offset in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u32>(i.d, offset) = std::array::from_fn(|k| k as u32) };
    }
}

/// Nanoseconds since the first reading in this process.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn read_clock(m: &mut Machine<'_>, i: &Instr) {
    use std::sync::OnceLock;
    use std::time::Instant;
    static START: OnceLock<Instant> = OnceLock::new();
    let now = START.get_or_init(Instant::now).elapsed().as_nanos() as u64;
    for &offset in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u64>(i.d, offset) = [now; SUBGROUP_SIZE] };
    }
}

/// Orders memory between invocations.
///
/// # Safety
/// As [`load`].
pub(super) unsafe fn memory_barrier(_: &mut Machine<'_>, _: &Instr) {
    std::sync::atomic::fence(std::sync::atomic::Ordering::SeqCst);
}
