//! Meshes made by code, the same on every machine.

use std::collections::HashMap;

use glam::{Affine3A, Quat, Vec3, vec3};
use tuff_tests::{Rng, between};

/// Corners, and three numbers of corners for each triangle.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub corners: Vec<[f32; 3]>,
    pub indices: Vec<u32>,
}

impl Mesh {
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// The same triangles, with equal corners once.
    pub fn welded(&self) -> Mesh {
        let mut corners = Vec::new();
        let mut numbers = HashMap::new();
        let mut number = |&index: &u32| {
            let corner = self.corners[index as usize];
            *numbers.entry(corner.map(f32::to_bits)).or_insert_with(|| {
                corners.push(corner);
                corners.len() as u32 - 1
            })
        };
        let indices = self.indices.iter().map(&mut number).collect();
        Mesh { corners, indices }
    }
}

/// Half the side of the ground, in metres.
pub const REACH: f32 = 50.0;

/// The height of the ground at a place.
pub fn height(x: f32, z: f32) -> f32 {
    let octave =
        |scale: f32, size: f32| libm::sinf(x * scale) * libm::cosf(z * scale * 1.1 + 0.5) * size;
    octave(0.11, 2.0) + octave(0.37, 0.6) + octave(1.3, 0.12) + octave(4.1, 0.03)
}

/// Rolling ground of about this many triangles.
pub fn hills(triangles: usize) -> Mesh {
    let side = ((triangles / 2) as f64).sqrt().round().max(1.0) as u32;
    let at = |i: u32| (i as f32 / side as f32 * 2.0 - 1.0) * REACH;
    let mut mesh = Mesh::default();
    for j in 0..=side {
        for i in 0..=side {
            let (x, z) = (at(i), at(j));
            mesh.corners.push([x, height(x, z), z]);
        }
    }
    for j in 0..side {
        for i in 0..side {
            let first = j * (side + 1) + i;
            let [a, b, c, d] = [first, first + 1, first + side + 1, first + side + 2];
            mesh.indices.extend([a, c, b, b, c, d]);
        }
    }
    mesh
}

/// A ball of radius 1 about the origin with `8 · 4^levels` triangles.
pub fn ball(levels: u32) -> Mesh {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    let mut faces: Vec<[Vec3; 3]> = Vec::new();
    for (x, y, z) in [(0, 1, 2), (3, 1, 5), (0, 4, 5), (3, 4, 2)] {
        faces.push([axes[x], axes[y], axes[z]]);
    }
    for (x, y, z) in [(0, 5, 1), (3, 2, 1), (0, 2, 4), (3, 5, 4)] {
        faces.push([axes[x], axes[y], axes[z]]);
    }
    for _ in 0..levels {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Mesh {
        indices: (0..faces.len() as u32 * 3).collect(),
        corners: faces.into_iter().flatten().map(Into::into).collect(),
    }
}

/// Leaves of two triangles each, in `count` clumps' worth, over the ground.
pub fn leaves(count: usize) -> Mesh {
    let mut random = Rng::with_seed(7);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let (x, z) = (
            between(&mut random, -18.0, 18.0),
            between(&mut random, -18.0, 18.0),
        );
        let middle = vec3(x, height(x, z) + between(&mut random, 0.2, 3.0), z);
        let turn = between(&mut random, 0.0, std::f32::consts::TAU);
        let tilt = between(&mut random, -0.8, 0.8);
        let (sine, cosine) = libm::sincosf(turn);
        let along = vec3(cosine, tilt, sine) * 0.4;
        let across = vec3(-sine, 0.3, cosine) * 0.3;
        let first = mesh.corners.len() as u32;
        for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            mesh.corners.push((middle + along * u + across * v).into());
        }
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        mesh.indices.extend([a, b, c, b, d, c]);
    }
    mesh
}

/// Places for `count` things on the ground before the camera.
pub fn places(count: usize) -> Vec<Vec3> {
    let mut random = Rng::with_seed(3);
    (0..count)
        .map(|_| {
            let (x, z) = (
                between(&mut random, -20.0, 20.0),
                between(&mut random, -20.0, 20.0),
            );
            vec3(x, height(x, z) + between(&mut random, 0.5, 2.5), z)
        })
        .collect()
}

/// A wide, flat box, and `count` small ones of many sizes that stand on it: the lower corner of
/// each, and the upper one.
pub fn boxes(count: usize) -> Vec<[f32; 6]> {
    let mut random = Rng::with_seed(13);
    let ground = [-REACH, -1.0, -REACH, REACH, 0.0, REACH];
    let small = (0..count).map(|_| {
        let mut number = |low, high| between(&mut random, low, high);
        let (x, z) = (number(-14.0, 14.0), number(-14.0, 14.0));
        let [wide, tall, deep] = [number(0.2, 0.8), number(0.3, 4.0), number(0.2, 0.8)];
        [x - wide, 0.0, z - deep, x + wide, tall, z + deep]
    });
    std::iter::once(ground).chain(small).collect()
}

/// A ball on the ground.
pub struct Placement {
    pub transform: Affine3A,
    /// One of so many.
    pub material: u32,
}

/// Balls of different sizes, stretched and turned.
pub fn placements(count: usize, materials: u32) -> Vec<Placement> {
    let mut random = Rng::with_seed(11);
    let mut place = |at: Vec3| {
        let size = between(&mut random, 0.3, 1.2);
        let (sine, cosine) = libm::sincosf(between(&mut random, 0.0, 6.0) * 0.5);
        let turn = Quat::from_xyzw(0.0, sine, 0.0, cosine);
        let stretched = vec3(size, size * between(&mut random, 0.6, 1.4), size);
        Placement {
            transform: Affine3A::from_scale_rotation_translation(stretched, turn, at),
            material: random.u32(..materials),
        }
    };
    places(count).into_iter().map(&mut place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_closed() {
        let ball = ball(2);
        assert_eq!(ball.triangle_count(), 128);
        let corner = |i: usize| Vec3::from(ball.corners[ball.indices[i] as usize]);
        let mut area = Vec3::ZERO;
        for triangle in 0..128 {
            let [a, b, c] = [0, 1, 2].map(|k| corner(triangle * 3 + k));
            let normal = (b - a).cross(c - a);
            assert!(normal.dot(a + b + c) > 0.0, "it faces outwards");
            area += normal;
        }
        assert!(area.length() < 1e-5, "its faces' areas balance");
        let welded = ball.welded();
        // Euler: as many vertices and faces as edges, and two.
        assert_eq!(welded.corners.len() + 128, 128 * 3 / 2 + 2);
    }

    #[test]
    fn hills_have_the_size_asked_for() {
        assert_eq!(hills(20_000).triangle_count(), 20_000);
    }
}
