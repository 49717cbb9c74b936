//! The rays: three kinds, made once and the same for every engine.

use fastrand::Rng;
use glam::Vec3;
use traversal::{Ray, ray_flags};

use super::scene::{Scene, direction};
use super::tuff::Tuff;

/// A kind of rays.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum RayKind {
    /// From the eye through a picture's pixels, in tiles of 4 × 4; closest hits.
    Primary,
    /// From their hits to a light; any hit.
    Shadow,
    /// From their hits, over the hemisphere with a cosine; closest hits.
    Diffuse,
}

impl RayKind {
    pub const ALL: [RayKind; 3] = [RayKind::Primary, RayKind::Shadow, RayKind::Diffuse];

    pub fn name(self) -> &'static str {
        match self {
            RayKind::Primary => "primary",
            RayKind::Shadow => "shadow",
            RayKind::Diffuse => "diffuse",
        }
    }
}

const TILE: u32 = 4;

/// Rays of a picture of `size` × `size` pixels, tile by tile.
pub fn primary(scene: &Scene, size: u32) -> Vec<Ray> {
    let forward = (scene.target - scene.eye).normalize();
    let right = forward.cross(Vec3::Y).normalize();
    let up = right.cross(forward);
    let mut rays = Vec::new();
    for tile in 0..(size / TILE) * (size / TILE) {
        let (tile_x, tile_y) = (tile % (size / TILE), tile / (size / TILE));
        for pixel in 0..TILE * TILE {
            let at = |tile: u32, pixel: u32| {
                2.0 * ((TILE * tile + pixel) as f32 + 0.5) / size as f32 - 1.0
            };
            let (x, y) = (at(tile_x, pixel % TILE), at(tile_y, pixel / TILE));
            rays.push(Ray {
                origin: scene.eye.into(),
                t_min: 0.0,
                direction: (forward + 0.55 * x * right - 0.55 * y * up).into(),
                t_max: f32::INFINITY,
                flags: 0,
                cull_mask: 0xFF,
            });
        }
    }
    rays
}

/// Shadow rays and diffuse rays from where primary rays end.
pub fn secondary(scene: &Scene, tuff: &Tuff, primary: &[Ray]) -> (Vec<Ray>, Vec<Ray>) {
    let mut random = Rng::with_seed(17);
    let (mut shadow, mut diffuse) = (Vec::new(), Vec::new());
    for (ray, hit) in primary.iter().zip(tuff.hits(primary)) {
        let Some(hit) = hit else { continue };
        let [a, b, c] = scene
            .mesh
            .triangle(hit.primitive_index as usize)
            .map(Vec3::from);
        let normal = (b - a).cross(c - a).normalize();
        let direction_in = Vec3::from(ray.direction);
        let normal = match normal.dot(direction_in) > 0.0 {
            true => -normal,
            false => normal,
        };
        if !normal.is_finite() {
            continue;
        }
        let point = Vec3::from(ray.origin) + hit.t * direction_in;
        let origin = point + 1e-4 * point.abs().max_element().max(1.0) * normal;
        let toward = |direction: Vec3, t_max: f32, flags: u32| Ray {
            origin: origin.into(),
            t_min: 0.0,
            direction: direction.into(),
            t_max,
            flags,
            cull_mask: 0xFF,
        };
        let to_light = scene.light - origin;
        shadow.push(toward(to_light, 1.0, ray_flags::TERMINATE_ON_FIRST_HIT));
        let bounce = normal + 0.999 * direction(&mut random);
        diffuse.push(toward(bounce.normalize(), f32::INFINITY, 0));
    }
    (shadow, diffuse)
}
