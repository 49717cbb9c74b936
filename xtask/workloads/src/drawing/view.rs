//! The camera of drawn scenes, and rays through its pixels.

use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Mat4, Vec3};
use rayon::prelude::*;
use tuff_tests::{Rng, vk};

use super::size;
use crate::scene::Mesh;
use crate::world::{Scale, camera};

const NEAR: f32 = 0.1;
const FAR: f32 = 200.0;

/// From the world to clip space.
pub fn projection(scale: &Scale) -> Mat4 {
    let [eye, right, up, ahead] = camera(scale).map(Vec3::from);
    let depth = FAR / (FAR - NEAR);
    // Rows: x and y of the picture (down is positive), depth, distance.
    let right = right / right.length_squared();
    let down = -up / up.length_squared();
    let row = |axis: Vec3, offset: f32| axis.extend(offset - axis.dot(eye));
    let distance = row(ahead, 0.0);
    let depth = distance * depth - glam::Vec4::W * (NEAR * depth);
    Mat4::from_cols(row(right, 0.0), row(down, 0.0), depth, distance).transpose()
}

/// A depth test that keeps the nearest fragment.
pub fn nearer() -> vk::PipelineDepthStencilStateCreateInfo<'static> {
    vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS)
}

/// Rays from the camera through centres of pixels.
#[derive(Clone, Copy)]
pub struct View {
    pub eye: DVec3,
    axes: [DVec3; 3],
    size: [u32; 2],
}

impl View {
    pub fn of(scale: &Scale) -> View {
        let [eye, right, up, ahead] = camera(scale).map(|it| Vec3::from(it).as_dvec3());
        View {
            eye,
            axes: [right, up, ahead],
            size: size(scale),
        }
    }

    /// The direction of a pixel's ray, one unit ahead.
    pub fn ray(&self, x: u32, y: u32) -> DVec3 {
        let [right, up, ahead] = self.axes;
        let [across, down] = [(x, 0), (y, 1)]
            .map(|(at, i)| (f64::from(at) + 0.5) / f64::from(self.size[i]) * 2.0 - 1.0);
        ahead + right * across - up * down
    }

    /// How far along its ray a pixel of this depth is; none where nothing was drawn.
    pub fn distance(depth: f32) -> Option<f64> {
        let [near, far, depth] = [NEAR, FAR, depth].map(f64::from);
        (depth < 1.0).then(|| near * far / (far - depth * (far - near)))
    }

    /// Some pixels, the same each time.
    pub fn pixels(&self, count: usize) -> impl Iterator<Item = (u32, u32)> {
        let [width, height] = self.size;
        let mut random = Rng::with_seed(17);
        (0..count).map(move |_| (random.u32(..width), random.u32(..height)))
    }

    /// Holds how far some pixels are against rays that are cast at all triangles: the first place
    /// has the first mesh, the others the second one.
    pub fn check(
        &self,
        meshes: &[Mesh; 2],
        places: &[Affine3A],
        found: impl Fn(u32, u32) -> Option<f64>,
    ) -> Result<()> {
        const PIXELS: usize = 24;
        let mut right_ones = 0;
        for (x, y) in self.pixels(PIXELS) {
            let direction = self.ray(x, y);
            let nearest = (0..places.len())
                .into_par_iter()
                .filter_map(|at| {
                    let mesh = &meshes[usize::from(at > 0)];
                    nearest(mesh, &places[at], self.eye, direction)
                })
                .reduce_with(f64::min);
            let fits = match (nearest, found(x, y)) {
                (None, None) => true,
                (Some(t), Some(found)) => {
                    (found - t).abs() * direction.length() < 1e-3 * t.max(1.0)
                }
                _ => false,
            };
            right_ones += usize::from(fits);
        }
        // Vertices are snapped to a grid: at a silhouette a ray may see what is behind.
        ensure!(
            right_ones + 2 >= PIXELS,
            "{right_ones} of {PIXELS} pixels show what is there"
        );
        Ok(())
    }
}

/// How far along a ray the first triangle of a mesh is.
fn nearest(mesh: &Mesh, place: &Affine3A, origin: DVec3, direction: DVec3) -> Option<f64> {
    let corners: Vec<DVec3> = mesh
        .corners
        .iter()
        .map(|&corner| place.transform_point3(corner.into()).as_dvec3())
        .collect();
    let hit = |triangle: &[u32]| {
        let [a, b, c] = [0, 1, 2].map(|i| corners[triangle[i] as usize]);
        let (ab, ac) = (b - a, c - a);
        let normal = direction.cross(ac);
        let volume = ab.dot(normal);
        let from = origin - a;
        let u = from.dot(normal) / volume;
        let across = from.cross(ab);
        let v = direction.dot(across) / volume;
        let t = ac.dot(across) / volume;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.1).then_some(t)
    };
    mesh.indices
        .chunks_exact(3)
        .filter_map(hit)
        .reduce(f64::min)
}
