//! Reads spheres and linear swept spheres from the caller's memory.

use crate::input::{EndCaps, Indexing, RadiusFormat, SweptGeometry};
use crate::layout::{Bounds, SweptEntry, swept_flags};
use crate::memory::IndexType;

use super::vertex::half_to_f32;
use super::words::word;

/// A primitive in the structure's space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SweptPrimitive {
    pub positions: [[f32; 3]; 2],
    pub radii: [f32; 2],
    /// Bits of [`swept_flags`].
    pub flags: u32,
}

impl SweptGeometry {
    /// Primitive `index`. `None` if it is inactive: a component or a radius is NaN, or a part is
    /// outside the memory.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    pub(crate) unsafe fn primitive(&self, index: u32) -> Option<SweptPrimitive> {
        let index = u64::from(index);
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        let end = |i: u64| unsafe { self.end(i) };
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        let number = |i: u64| unsafe { self.number(i) };
        let (first, second, flags) = match self.indexing {
            Indexing::Spheres => {
                let it = end(number(index)?)?;
                (it, it, swept_flags::SPHERE)
            }
            Indexing::Pairs => (
                end(number(2 * index)?)?,
                end(number(2 * index + 1)?)?,
                match self.end_caps {
                    EndCaps::None => 0,
                    EndCaps::Chained => swept_flags::FIRST_CAP | swept_flags::SECOND_CAP,
                },
            ),
            Indexing::Successive => {
                let start = number(index)?;
                let follows = index > 0 && number(index - 1)?.checked_add(1) == Some(start);
                let flags = match self.end_caps {
                    EndCaps::None => 0,
                    EndCaps::Chained if follows => swept_flags::SECOND_CAP,
                    EndCaps::Chained => swept_flags::FIRST_CAP | swept_flags::SECOND_CAP,
                };
                (end(start)?, end(start + 1)?, flags)
            }
        };
        let it = SweptPrimitive {
            positions: [first.0, second.0],
            radii: [first.1, second.1],
            flags,
        };
        let is_nan = |c: &f32| c.is_nan();
        let inactive =
            it.positions.as_flattened().iter().any(is_nan) || it.radii.iter().any(is_nan);
        (!inactive).then_some(it)
    }

    /// The vertex and radius number of element `index` of the list.
    ///
    /// # Safety
    /// As [`Self::primitive`].
    unsafe fn number(&self, index: u64) -> Option<u64> {
        let offset = index.checked_mul(self.index_stride_bytes)?;
        // SAFETY: the caller keeps the promises of `Self::primitive`.
        let number = unsafe {
            match self.index_type {
                IndexType::None => index,
                IndexType::U8 => self.indices.read::<1>(offset)?[0].into(),
                IndexType::U16 => u16::from_le_bytes(self.indices.read(offset)?).into(),
                IndexType::U32 => u32::from_le_bytes(self.indices.read(offset)?).into(),
            }
        };
        Some(number + u64::from(self.first_vertex))
    }

    /// Position and radius.
    ///
    /// # Safety
    /// As [`Self::primitive`].
    unsafe fn end(&self, number: u64) -> Option<([f32; 3], f32)> {
        let offset = number.checked_mul(self.vertex_stride_bytes)?;
        let radius_offset = number.checked_mul(self.radius_stride_bytes)?;
        // SAFETY: the caller keeps the promises of `Self::primitive`.
        unsafe {
            let position = self.vertices.read_position(self.vertex_format, offset)?;
            let radius = match self.radius_format {
                RadiusFormat::F32 => f32::from_le_bytes(self.radii.read(radius_offset)?),
                RadiusFormat::F16 => {
                    half_to_f32(u16::from_le_bytes(self.radii.read(radius_offset)?))
                }
            };
            Some((position, radius))
        }
    }
}

impl SweptPrimitive {
    /// A primitive that no ray hits.
    pub const NOTHING: SweptPrimitive = SweptPrimitive {
        positions: [[0.0; 3]; 2],
        radii: [0.0; 2],
        flags: swept_flags::SPHERE,
    };

    /// The box around both spheres, rounded outwards, without infinities.
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for (position, &radius) in self.positions.iter().zip(&self.radii) {
            let radius = f64::from(radius.max(0.0));
            bounds = bounds.union(Bounds {
                min: position.map(|c| {
                    ((f64::from(c) - radius) as f32)
                        .next_down()
                        .clamp(f32::MIN, f32::MAX)
                }),
                max: position.map(|c| {
                    ((f64::from(c) + radius) as f32)
                        .next_up()
                        .clamp(f32::MIN, f32::MAX)
                }),
            });
        }
        bounds
    }

    /// Whether a ray can meet it.
    pub fn is_finite(&self) -> bool {
        let mut numbers = self.positions.as_flattened().iter().chain(&self.radii);
        numbers.all(|c| c.is_finite())
    }

    /// The structure's entry for it.
    pub fn entry(&self, primitive: u32, geometry: u32, of: &SweptGeometry) -> SweptEntry {
        SweptEntry {
            positions: self.positions,
            radii: self.radii,
            primitive,
            geometry: word(geometry, of.flags),
            flags: self.flags,
            reserved: [0; 5],
        }
    }
}

/// The box of an active primitive. A primitive with an infinite extent can never be hit, so it is
/// left out, unless an update might move it.
///
/// # Safety
/// The geometry's memory must be readable and unchanged.
pub(crate) unsafe fn swept_bounds(
    geometry: &SweptGeometry,
    index: u32,
    updatable: bool,
) -> Option<Bounds> {
    // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
    let primitive = unsafe { geometry.primitive(index) }?;
    (primitive.is_finite() || updatable).then(|| primitive.bounds())
}
