//! A ray by its own axes, as tests of triangles take it, wherever it lies.

use super::beams::Beams;
use super::space::Space;

/// Numbers of a ray; see [`Beams`].
pub(crate) trait Sight: Copy {
    fn origin(self, axis: usize) -> f32;
    fn near_inverse(self, axis: usize) -> f32;
    fn far_inverse(self, axis: usize) -> f32;
    /// Offset in bytes of an axis in a vertex.
    fn axis(self, axis: usize) -> usize;
    fn shear(self, axis: usize) -> f32;
    fn inverse_z(self) -> f32;
    fn t_min(self) -> f32;
    fn reach(self) -> f32;
    /// The ray as it is set up by itself.
    fn space(self) -> Space;
}

/// A ray of a list.
#[derive(Clone, Copy)]
pub(crate) struct LaneOf<'a> {
    pub beams: &'a Beams,
    pub lane: usize,
}

impl Sight for LaneOf<'_> {
    #[inline(always)]
    fn origin(self, axis: usize) -> f32 {
        self.beams.origin[axis][self.lane]
    }

    #[inline(always)]
    fn near_inverse(self, axis: usize) -> f32 {
        self.beams.near_inverse[axis][self.lane]
    }

    #[inline(always)]
    fn far_inverse(self, axis: usize) -> f32 {
        self.beams.far_inverse[axis][self.lane]
    }

    #[inline(always)]
    fn axis(self, axis: usize) -> usize {
        self.beams.axes[axis][self.lane] as usize
    }

    #[inline(always)]
    fn shear(self, axis: usize) -> f32 {
        self.beams.shear[axis][self.lane]
    }

    #[inline(always)]
    fn inverse_z(self) -> f32 {
        self.beams.inverse_z[self.lane]
    }

    #[inline(always)]
    fn t_min(self) -> f32 {
        self.beams.t_min[self.lane]
    }

    #[inline(always)]
    fn reach(self) -> f32 {
        self.beams.reach
    }

    #[inline(always)]
    fn space(self) -> Space {
        self.beams.space(self.lane)
    }
}
