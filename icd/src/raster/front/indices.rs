//! Index buffers, read as far as there is memory.

use ash::vk;
use spirv_jit::reach::Reach;

use crate::raster::IndexBuffer;
use crate::wave::reachable::readable;

/// The indices of a draw.
#[derive(Clone, Copy)]
pub struct Indices {
    base: *const u8,
    bytes: u64,
    /// Bytes of an index, as a power of two.
    shift: u32,
    /// The index that ends a segment, where restart is on.
    pub restart: u32,
}

// SAFETY: a place in memory that the application keeps, and does not write, for the time of the
// draw.
unsafe impl Send for Indices {}
// SAFETY: a place in memory that the application keeps, and does not write, for the time of the
// draw.
unsafe impl Sync for Indices {}

impl Indices {
    /// Of a bound index buffer.
    pub fn new(buffer: &IndexBuffer, reach: &Reach) -> Self {
        let memory = readable(reach, buffer.address, buffer.size_bytes);
        let shift = match buffer.ty {
            vk::IndexType::UINT8_KHR => 0,
            vk::IndexType::UINT16 => 1,
            _ => 2,
        };
        Self {
            base: memory.base,
            bytes: memory.bytes as u64,
            shift,
            restart: buffer.restart.unwrap_or(u32::MAX >> (32 - (8 << shift))),
        }
    }

    /// An index; 0 past the buffer's end.
    #[inline(always)]
    pub fn at(&self, place: u64) -> u32 {
        let offset = place << self.shift;
        if offset + (1 << self.shift) > self.bytes {
            return 0;
        }
        let address = self.base.wrapping_add(offset as usize);
        // SAFETY: the bytes are in memory that there is while the draw runs; they may be anything.
        unsafe {
            match self.shift {
                0 => address.read().into(),
                1 => address.cast::<u16>().read_unaligned().into(),
                _ => address.cast::<u32>().read_unaligned(),
            }
        }
    }
}
