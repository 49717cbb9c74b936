//! A ray by its own axes, as tests of triangles take it, wherever it lies.

use super::level_rays::LevelRays;

/// Numbers of a ray; see [`LevelRays`].
pub(crate) trait TriangleRay: Copy {
    fn origin(self, axis: usize) -> f32;
    fn near_inverse(self, axis: usize) -> f32;
    fn far_inverse(self, axis: usize) -> f32;
    /// Offset in bytes of an axis in a vertex.
    fn axis(self, axis: usize) -> usize;
    fn shear(self, axis: usize) -> f32;
    fn inverse_z(self) -> f32;
    /// The third component of the direction, with the opposite sign.
    fn direction_z(self) -> f32;
    fn tolerance(self) -> f32;
    /// Origin and direction as given, by the axes of space.
    fn world_ray(self) -> ([f32; 3], [f32; 3]);
}

/// A ray of a list.
#[derive(Clone, Copy)]
pub(crate) struct LaneOf<'a> {
    pub level_rays: &'a LevelRays,
    pub lane: usize,
}

impl TriangleRay for LaneOf<'_> {
    #[inline(always)]
    fn origin(self, axis: usize) -> f32 {
        self.level_rays.origin[axis][self.lane]
    }

    #[inline(always)]
    fn near_inverse(self, axis: usize) -> f32 {
        self.level_rays.near_inverse[axis][self.lane]
    }

    #[inline(always)]
    fn far_inverse(self, axis: usize) -> f32 {
        self.level_rays.far_inverse[axis][self.lane]
    }

    #[inline(always)]
    fn axis(self, axis: usize) -> usize {
        self.level_rays.axes[axis][self.lane] as usize
    }

    #[inline(always)]
    fn shear(self, axis: usize) -> f32 {
        self.level_rays.shear[axis][self.lane]
    }

    #[inline(always)]
    fn inverse_z(self) -> f32 {
        self.level_rays.inverse_z[self.lane]
    }

    #[inline(always)]
    fn direction_z(self) -> f32 {
        self.level_rays.direction_z[self.lane]
    }

    #[inline(always)]
    fn tolerance(self) -> f32 {
        self.level_rays.tolerance
    }

    #[inline(always)]
    fn world_ray(self) -> ([f32; 3], [f32; 3]) {
        self.level_rays.world_ray(self.lane)
    }
}
