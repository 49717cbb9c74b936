//! The rays: three kinds, made once and the same for every engine.

use traversal::{Ray, ray_flags};

use super::random::Random;
use super::scene::Scene;
use super::tuff::Tuff;
use super::vector::{Vector, add, cross, dot, normalize, scale, subtract};

/// A kind of rays.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// From the eye through a picture's pixels, in tiles of 4 × 4; closest hits.
    Primary,
    /// From their hits to a light; any hit.
    Shadow,
    /// From their hits, over the hemisphere with a cosine; closest hits.
    Diffuse,
}

impl Kind {
    pub const ALL: [Kind; 3] = [Kind::Primary, Kind::Shadow, Kind::Diffuse];

    pub fn name(self) -> &'static str {
        match self {
            Kind::Primary => "primary",
            Kind::Shadow => "shadow",
            Kind::Diffuse => "diffuse",
        }
    }
}

const TILE: u32 = 4;

/// Rays of a picture of `size` × `size` pixels, tile by tile.
pub fn primary(scene: &Scene, size: u32) -> Vec<Ray> {
    let forward = normalize(subtract(scene.target, scene.eye));
    let right = normalize(cross(forward, [0.0, 1.0, 0.0]));
    let up = cross(right, forward);
    let mut rays = Vec::new();
    for tile in 0..(size / TILE) * (size / TILE) {
        let (tile_x, tile_y) = (tile % (size / TILE), tile / (size / TILE));
        for pixel in 0..TILE * TILE {
            let at = |tile: u32, pixel: u32| {
                2.0 * ((TILE * tile + pixel) as f32 + 0.5) / size as f32 - 1.0
            };
            let (x, y) = (at(tile_x, pixel % TILE), at(tile_y, pixel / TILE));
            let aside = add(scale(right, 0.55 * x), scale(up, -0.55 * y));
            rays.push(Ray {
                origin: scene.eye,
                t_min: 0.0,
                direction: add(forward, aside),
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
    let mut random = Random::new(17);
    let (mut shadow, mut diffuse) = (Vec::new(), Vec::new());
    for (ray, hit) in primary.iter().zip(tuff.hits(primary)) {
        let Some(hit) = hit else { continue };
        let [a, b, c] = scene.mesh.indices[hit.primitive_index as usize]
            .map(|i| scene.mesh.vertices[i as usize]);
        let normal = normalize(cross(subtract(b, a), subtract(c, a)));
        let normal = if dot(normal, ray.direction) > 0.0 {
            scale(normal, -1.0)
        } else {
            normal
        };
        if !normal.iter().all(|c| c.is_finite()) {
            continue;
        }
        let point = add(ray.origin, scale(ray.direction, hit.t));
        let reach = point.iter().fold(1f32, |most, c| most.max(c.abs()));
        let origin = add(point, scale(normal, 1e-4 * reach));
        let toward = |direction: Vector, t_max: f32, flags: u32| Ray {
            origin,
            t_min: 0.0,
            direction,
            t_max,
            flags,
            cull_mask: 0xFF,
        };
        let to_light = subtract(scene.light, origin);
        shadow.push(toward(to_light, 1.0, ray_flags::TERMINATE_ON_FIRST_HIT));
        let bounce = add(normal, scale(random.direction(), 0.999));
        diffuse.push(toward(normalize(bounce), f32::INFINITY, 0));
    }
    (shadow, diffuse)
}
