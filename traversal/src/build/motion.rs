//! Reads triangles with motion.

use crate::input::{MotionGeometry, TriangleGeometry};
use crate::layout::{Bounds, MotionEntry};

use super::vertex::sanitized_triangle_bounds;
use super::words::triangle_word;

impl MotionGeometry {
    /// A triangle at times 0 and 1. `None` if it is inactive at either.
    ///
    /// # Safety
    /// The geometry's memory must be readable and unchanged.
    pub(crate) unsafe fn triangles(&self, index: u32) -> Option<[[[f32; 3]; 3]; 2]> {
        let end = TriangleGeometry {
            vertices: self.end_vertices,
            ..self.start
        };
        // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
        unsafe { Some([self.start.triangle(index)?, end.triangle(index)?]) }
    }

    /// The structure's entry for a triangle; an inactive triangle has no position.
    ///
    /// # Safety
    /// As [`Self::triangles`].
    pub(crate) unsafe fn entry(&self, primitive: u32, geometry: u32) -> MotionEntry {
        MotionEntry {
            // SAFETY: the caller keeps the promises of `Self::triangles`.
            triangles: unsafe { self.triangles(primitive) }.unwrap_or([[[f32::NAN; 3]; 3]; 2]),
            primitive,
            geometry: triangle_word(geometry, &self.start),
        }
    }
}

/// The bounds of all positions between two triangles.
pub(crate) fn motion_bounds(triangles: &[[[f32; 3]; 3]; 2]) -> Bounds {
    sanitized_triangle_bounds(&triangles[0]).union(sanitized_triangle_bounds(&triangles[1]))
}
