//! The test of single triangles by itself, for those who measure it.

use super::edge_side::Rim;
use super::level_ray::LevelRay;
use super::options::Accuracy;
use super::triangle::intersect;
use crate::ray::Ray;

/// A ray, set up for tests of triangles as walks do them.
#[derive(Clone, Copy)]
pub struct TriangleTest {
    level_ray: LevelRay,
}

impl TriangleTest {
    /// Sets up a finite ray.
    pub fn new(ray: &Ray, accuracy: Accuracy) -> TriangleTest {
        let mut level_ray = LevelRay::EMPTY;
        level_ray.tolerance = accuracy.tolerance();
        level_ray.set(ray.origin, ray.direction, ray.t_min, 0.0);
        TriangleTest { level_ray }
    }

    /// Where the ray's line meets an opaque triangle: the distance, and the weights of the second
    /// and the third vertex.
    #[inline]
    pub fn intersect_triangle(&self, triangle: &[[f32; 3]; 3]) -> Option<(f32, [f32; 2])> {
        intersect(&self.level_ray, triangle, Rim::Included).map(|hit| (hit.t, hit.barycentrics))
    }
}
