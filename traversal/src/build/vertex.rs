//! Reads positions, indices and triangles from the caller's memory.

use lanes::prefetch_line;

use crate::input::{TriangleGeometry, VertexFormat};
use crate::layout::Bounds;
use crate::memory::{IndexType, Memory};

impl VertexFormat {
    /// Bytes of one position.
    pub fn size_bytes(self) -> usize {
        use VertexFormat::*;
        match self {
            Snorm8x2 | Unorm8x2 => 2,
            Snorm8x3 | Unorm8x3 => 3,
            Snorm8x4 | Unorm8x4 | F16x2 | Snorm16x2 | Unorm16x2 | Unorm10x3A2 | Snorm10x3A2 => 4,
            F16x3 | Snorm16x3 | Unorm16x3 => 6,
            F32x2 | F16x4 | Snorm16x4 | Unorm16x4 => 8,
            F32x3 => 12,
            F32x4 | F64x2 => 16,
            F64x3 => 24,
            F64x4 => 32,
        }
    }

    /// The position in the first [`Self::size_bytes`] bytes of `bytes`.
    fn decode(self, bytes: &[u8]) -> [f32; 3] {
        use VertexFormat::*;
        let f32_at = |i: usize| f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
        let f64_at =
            |i: usize| f64::from_le_bytes(bytes[8 * i..8 * i + 8].try_into().unwrap()) as f32;
        let u16_at = |i: usize| u16::from_le_bytes(bytes[2 * i..2 * i + 2].try_into().unwrap());
        let f16_at = |i: usize| half_to_f32(u16_at(i));
        let snorm16_at = |i: usize| (f32::from(u16_at(i) as i16) / 32767.0).max(-1.0);
        let unorm16_at = |i: usize| f32::from(u16_at(i)) / 65535.0;
        let snorm8_at = |i: usize| (f32::from(bytes[i] as i8) / 127.0).max(-1.0);
        let unorm8_at = |i: usize| f32::from(bytes[i]) / 255.0;
        let bits10_at = |i: usize| {
            let word = u32::from_le_bytes(bytes[..4].try_into().unwrap());
            word << (22 - 10 * i)
        };
        let unorm10_at = |i: usize| (bits10_at(i) >> 22) as f32 / 1023.0;
        let snorm10_at = |i: usize| ((bits10_at(i) as i32 >> 22) as f32 / 511.0).max(-1.0);
        match self {
            F32x3 | F32x4 => [f32_at(0), f32_at(1), f32_at(2)],
            F32x2 => [f32_at(0), f32_at(1), 0.0],
            F16x3 | F16x4 => [f16_at(0), f16_at(1), f16_at(2)],
            F16x2 => [f16_at(0), f16_at(1), 0.0],
            F64x3 | F64x4 => [f64_at(0), f64_at(1), f64_at(2)],
            F64x2 => [f64_at(0), f64_at(1), 0.0],
            Snorm16x3 | Snorm16x4 => [snorm16_at(0), snorm16_at(1), snorm16_at(2)],
            Snorm16x2 => [snorm16_at(0), snorm16_at(1), 0.0],
            Unorm16x3 | Unorm16x4 => [unorm16_at(0), unorm16_at(1), unorm16_at(2)],
            Unorm16x2 => [unorm16_at(0), unorm16_at(1), 0.0],
            Snorm8x3 | Snorm8x4 => [snorm8_at(0), snorm8_at(1), snorm8_at(2)],
            Snorm8x2 => [snorm8_at(0), snorm8_at(1), 0.0],
            Unorm8x3 | Unorm8x4 => [unorm8_at(0), unorm8_at(1), unorm8_at(2)],
            Unorm8x2 => [unorm8_at(0), unorm8_at(1), 0.0],
            Unorm10x3A2 => [unorm10_at(0), unorm10_at(1), unorm10_at(2)],
            Snorm10x3A2 => [snorm10_at(0), snorm10_at(1), snorm10_at(2)],
        }
    }
}

/// IEEE half to single precision: exact, NaN stays NaN.
pub(crate) fn half_to_f32(half: u16) -> f32 {
    let sign = u32::from(half >> 15) << 31;
    let magnitude = u32::from(half & 0x7FFF);
    let bits = match magnitude {
        0x7C00.. => 0x7F80_0000 | (magnitude & 0x3FF) << 13,
        0x400.. => (magnitude << 13) + ((127 - 15) << 23),
        // Subnormal: a multiple of 2⁻²⁴.
        _ => (magnitude as f32 * 2f32.powi(-24)).to_bits(),
    };
    f32::from_bits(sign | bits)
}

impl Memory {
    /// The position at `offset`, if it is inside.
    ///
    /// # Safety
    /// The memory must be readable and unchanged.
    #[inline(always)]
    pub(crate) unsafe fn read_position(
        &self,
        format: VertexFormat,
        offset: u64,
    ) -> Option<[f32; 3]> {
        if format == VertexFormat::F32x3 {
            // SAFETY: the caller guarantees that the memory is readable and unchanged.
            let [x, y, z] = unsafe { self.read_integers::<3, u32>(offset) }?;
            return Some([x, y, z].map(|bits| f32::from_bits(u32::from_le(bits))));
        }
        // SAFETY: the caller guarantees that the memory is readable and unchanged.
        unsafe { self.read_other_position(format, offset) }
    }

    /// As [`Self::read_position`].
    ///
    /// # Safety
    /// As there.
    unsafe fn read_other_position(&self, format: VertexFormat, offset: u64) -> Option<[f32; 3]> {
        let end = offset.checked_add(format.size_bytes() as u64)?;
        if end > self.bytes as u64 {
            return None;
        }
        let base = self.base.wrapping_add(offset as usize);
        // SAFETY: inside the memory.
        let bytes = unsafe { std::slice::from_raw_parts(base, format.size_bytes()) };
        Some(format.decode(bytes))
    }
}

/// A position transformed by a row-major 3 × 4 matrix. The order of operations is the same for
/// every vertex, so vertices that were equal stay equal.
#[inline]
pub(crate) fn transform_point(matrix: &[f32; 12], point: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &matrix[4 * row..4 * row + 4];
        m[0] * point[0] + m[1] * point[1] + m[2] * point[2] + m[3]
    })
}

/// Smaller memory stays in the cache without prefetching.
#[cfg(target_arch = "x86_64")]
const FAR_BYTES: usize = 1 << 20;

impl TriangleGeometry {
    /// A vertex in the structure's space; `None` outside the memory.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    #[inline(always)]
    unsafe fn vertex(&self, index: u64) -> Option<[f32; 3]> {
        let offset = index.checked_mul(self.vertex_stride_bytes)?;
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        let position = unsafe { self.vertices.read_position(self.vertex_format, offset) }?;
        // A transform could create or hide a NaN, so activity is decided before it.
        if position[0].is_nan() {
            return None;
        }
        Some(match &self.transform {
            Some(matrix) => transform_point(matrix, position),
            None => position,
        })
    }

    /// The vertices of a triangle; `None` if an index lies outside the memory.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    #[inline(always)]
    unsafe fn corners(&self, index: u32) -> Option<[u64; 3]> {
        let first = 3 * u64::from(index);
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        let corners = unsafe {
            match self.index_type {
                IndexType::None => [first, first + 1, first + 2],
                IndexType::U8 => self.indices.read_integers::<3, u8>(first)?.map(u64::from),
                IndexType::U16 => (self.indices.read_integers::<3, u16>(2 * first)?)
                    .map(|index| u16::from_le(index).into()),
                IndexType::U32 => (self.indices.read_integers::<3, u32>(4 * first)?)
                    .map(|index| u32::from_le(index).into()),
            }
        };
        Some(corners.map(|corner| corner + u64::from(self.first_vertex)))
    }

    /// Triangle `index` in the structure's space. `None` if it is inactive: the first component of
    /// a vertex is NaN, or a vertex or an index lies outside the memory.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    #[inline(always)]
    pub(crate) unsafe fn triangle(&self, index: u32) -> Option<[[f32; 3]; 3]> {
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        unsafe {
            let [a, b, c] = self.corners(index)?;
            Some([self.vertex(a)?, self.vertex(b)?, self.vertex(c)?])
        }
    }

    /// Prefetches the vertices of a triangle, if the machine can.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    #[inline(always)]
    pub(crate) unsafe fn prefetch(&self, index: u32) {
        if self.vertices.bytes < FAR_BYTES {
            return;
        }
        let size = self.vertex_format.size_bytes() - 1;
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        let corners = unsafe { self.corners(index) };
        for corner in corners.into_iter().flatten() {
            let offset = corner.wrapping_mul(self.vertex_stride_bytes) as usize;
            let start = self.vertices.base.wrapping_add(offset);
            prefetch_line(start);
            prefetch_line(start.wrapping_add(size));
        }
    }
}

/// Bounds without NaN of a triangle that has one, or an infinity.
pub(crate) fn sanitized_triangle_bounds(triangle: &[[f32; 3]; 3]) -> Bounds {
    let clean = triangle.map(|vertex| {
        vertex.map(|c| {
            if c.is_nan() {
                0.0
            } else {
                c.clamp(f32::MIN, f32::MAX)
            }
        })
    });
    Bounds::of_triangle(&clean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_floats() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x3C00, 1.0),
            (0xC000, -2.0),
            (0x0001, 2f32.powi(-24)),
            (0x03FF, 1023.0 * 2f32.powi(-24)),
            (0x0400, 2f32.powi(-14)),
            (0x7BFF, 65504.0),
            (0x7C00, f32::INFINITY),
            (0xFC00, f32::NEG_INFINITY),
        ] {
            assert_eq!(half_to_f32(bits), value, "{bits:#x}");
        }
        assert!(half_to_f32(0x7E00).is_nan());
        assert!(half_to_f32(0xFC01).is_nan());
    }

    #[test]
    fn formats() {
        let snorm16: Vec<u8> = [-32768i16, 32767, 16384, 0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        assert_eq!(
            VertexFormat::Snorm16x4.decode(&snorm16),
            [-1.0, 1.0, 16384.0 / 32767.0]
        );
        assert_eq!(VertexFormat::Snorm16x2.decode(&snorm16), [-1.0, 1.0, 0.0]);
        assert_eq!(
            VertexFormat::Unorm8x4.decode(&[0, 255, 51, 9]),
            [0.0, 1.0, 0.2]
        );
        let packed = 1023u32 | 0x200 << 10 | 0x1FF << 20;
        assert_eq!(
            VertexFormat::Snorm10x3A2.decode(&packed.to_le_bytes()),
            [-1.0 / 511.0, -1.0, 1.0]
        );
    }

    #[test]
    fn reads_stay_inside() {
        let vertices = [[0f32; 3]; 3];
        let indices = [0u16, 1, 2, 0, 1, 3];
        let geometry = TriangleGeometry {
            vertices: Memory {
                base: vertices.as_ptr().cast(),
                bytes: 36,
            },
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            first_vertex: 0,
            index_type: IndexType::U16,
            indices: Memory {
                base: indices.as_ptr().cast(),
                bytes: 12,
            },
            transform: None,
            primitive_count: 3,
            flags: crate::GeometryFlags(0),
            micromap: None,
        };
        // SAFETY: both arrays are alive.
        unsafe {
            assert!(geometry.triangle(0).is_some());
            assert!(geometry.triangle(1).is_none(), "vertex 3 is outside");
            assert!(geometry.triangle(2).is_none(), "indices are outside");
        }
    }
}
