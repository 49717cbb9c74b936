//! Where an access to a buffer, to workgroup memory or through a physical pointer lies.
//!
//! Every access goes through [`Region`]: first byte, size, and the offset in it, checked per
//! scalar.

use super::machine::Machine;
use super::operand::Operand;
use crate::ir::Space;

/// Where an access lies.
#[derive(Clone, Copy)]
pub(super) struct Region {
    pub(super) base: *mut u8,
    pub(super) size_bytes: u64,
    offset: u64,
    /// The bits of an offset: 32 or 64 bits wide.
    mask: u64,
}

/// The mask of offsets of 32 bits.
const WORD: u64 = u32::MAX as u64;

impl Region {
    const NOWHERE: Region = Region {
        base: std::ptr::null_mut(),
        size_bytes: 0,
        offset: 0,
        mask: WORD,
    };

    /// The address of `size_bytes` bytes at `skip` past the offset, if they are inside.
    #[inline(always)]
    pub(super) fn at(&self, skip: u64, size_bytes: u64) -> Option<*mut u8> {
        // Offsets wrap, also between the scalars of one access.
        let first = self.offset.wrapping_add(skip) & self.mask;
        let end = first.checked_add(size_bytes)?;
        // SAFETY: the access is inside the region.
        (end <= self.size_bytes).then(|| unsafe { self.base.add(first as usize) })
    }

    /// The same without wrapping, for what lies within so many bytes of the offset.
    #[inline(always)]
    pub(super) fn bytes(&self, skip: u64, size_bytes: usize) -> Option<*const u8> {
        let first = self.offset.checked_add(skip)?;
        let end = first.checked_add(size_bytes as u64)?;
        // SAFETY: the access is inside the region.
        (end <= self.size_bytes).then(|| unsafe { self.base.add(first as usize).cast_const() })
    }
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
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match space {
            Space::Private => Region::NOWHERE,
            Space::Shared => {
                let (base, size_bytes) = m.workgroup_memory(offset);
                Region {
                    base,
                    size_bytes,
                    offset: m.lane(address[0], offset, lane, false),
                    mask: WORD,
                }
            }
            Space::Buffer => {
                let descriptor = m
                    .environment
                    .descriptor(m.lane(address[0], offset, lane, true));
                Region {
                    base: descriptor.address as *mut u8,
                    size_bytes: descriptor.size_bytes,
                    offset: m.lane(address[1], offset, lane, false),
                    mask: WORD,
                }
            }
            Space::Buffer64 => {
                let descriptor = m
                    .environment
                    .descriptor(m.lane(address[0], offset, lane, true));
                Region {
                    base: descriptor.address as *mut u8,
                    size_bytes: descriptor.size_bytes,
                    offset: m.lane(address[1], offset, lane, true),
                    mask: u64::MAX,
                }
            }
            Space::Global => {
                let address = m.lane(address[0], offset, lane, true);
                let near = m.near.get().bytes_from(address);
                Region {
                    base: address as *mut u8,
                    size_bytes: if near > 0 { near } else { look_up(m, address) },
                    offset: 0,
                    mask: WORD,
                }
            }
        }
    }
}

/// How much memory there is from an address on that is not near the last one. An address that leads
/// nowhere is counted.
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
                strays.count(m.program, m.pc, address, 0);
            }
            0
        }
    }
}

/// One scalar from memory, extended with zeros.
///
/// # Safety
/// `at` may be read for the type's size. Another thread may write meanwhile: the value is then any
/// mix of old and new, as the memory model of the shader language has it.
#[inline(always)]
pub(super) unsafe fn read_scalar(at: *const u8, size_bytes: u32) -> u64 {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match size_bytes {
            1 => at.read() as u64,
            2 => at.cast::<u16>().read_unaligned() as u64,
            4 => at.cast::<u32>().read_unaligned() as u64,
            _ => at.cast::<u64>().read_unaligned(),
        }
    }
}
