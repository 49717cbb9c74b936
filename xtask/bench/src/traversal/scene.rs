//! The scenes: one mesh and one camera each, made by code.

use std::f32::consts::PI;

use fastrand::Rng;
use glam::{Vec3, vec3};
use scenes::Mesh;

/// A mesh, a viewpoint and a light.
pub struct Scene {
    pub name: &'static str,
    pub mesh: Mesh,
    pub eye: Vec3,
    pub target: Vec3,
    /// Where shadow rays go.
    pub light: Vec3,
}

/// A mesh, an eye, its target, and a light.
type SceneParts = (Mesh, [f32; 3], [f32; 3], [f32; 3]);

/// How a scene is made, to be called when its turn comes.
pub struct Recipe {
    pub name: &'static str,
    /// Part of the goal; the others have rows of their own.
    pub counts: bool,
    make: fn() -> SceneParts,
}

/// All scenes, in the order of the table.
pub const RECIPES: [Recipe; 5] = [
    Recipe {
        name: "bunny",
        counts: true,
        make: bunny,
    },
    Recipe {
        name: "interior",
        counts: true,
        make: interior,
    },
    Recipe {
        name: "grid",
        counts: true,
        make: grid,
    },
    Recipe {
        name: "soup",
        counts: true,
        make: soup,
    },
    Recipe {
        name: "needles",
        counts: false,
        make: needles,
    },
];

impl Recipe {
    pub fn make(&self) -> Scene {
        let (mut mesh, eye, target, light) = (self.make)();
        // One vertex more than there are, for readers that take sixteen bytes at a time.
        mesh.vertices.push([0.0; 3]);
        Scene {
            name: self.name,
            mesh,
            eye: eye.into(),
            target: target.into(),
            light: light.into(),
        }
    }
}

fn opaque() -> Mesh {
    Mesh {
        opaque: true,
        ..Mesh::default()
    }
}

/// In [low, high).
fn between(random: &mut Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * random.f32()
}

/// In a cube of edge 2 around the origin.
fn vector(random: &mut Rng) -> Vec3 {
    Vec3::from([(); 3].map(|()| between(random, -1.0, 1.0)))
}

/// Of length 1, any direction alike.
pub fn direction(random: &mut Rng) -> Vec3 {
    loop {
        let v = vector(random);
        if (1e-4..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Scrambles 32 bits: noise has a value at each place, whatever was asked before.
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

/// Smooth noise in −1..1: hashed values at the corners of unit cells.
fn noise(p: Vec3) -> f32 {
    let cell = p.floor();
    let t = p - cell;
    let fade = t * t * (3.0 - 2.0 * t);
    let mut sum = 0.0;
    for corner in 0..8u32 {
        let mut seed = 0;
        let mut weight = 1.0;
        for axis in 0..3 {
            let up = corner >> axis & 1;
            seed = hash(seed ^ (cell[axis] as i32 as u32).wrapping_add(up));
            weight *= match up {
                1 => fade[axis],
                _ => 1.0 - fade[axis],
            };
        }
        sum += weight * (seed as f32 / u32::MAX as f32 * 2.0 - 1.0);
    }
    sum
}

/// A lump with creases, about 70,000 small triangles: what a scan is like.
fn bunny() -> SceneParts {
    let mut mesh = opaque();
    mesh.sphere(59, |d| {
        let mut radius = 1.0;
        for (octave, weight) in [(1.7, 0.45), (4.1, 0.18), (9.7, 0.06), (31.0, 0.012)] {
            radius += weight * noise(octave * d);
        }
        radius * d
    });
    (mesh, [1.9, 1.1, 2.3], [0.0, 0.0, 0.0], [3.0, 5.0, 2.0])
}

/// Tables with vases, each with chairs.
fn add_tables(mesh: &mut Mesh, random: &mut Rng) {
    for (x, z) in [(2.5, 2.5), (6.5, 2.2), (4.5, 5.5)] {
        mesh.cuboid([x - 0.8, 0.72, z - 0.5], [x + 0.8, 0.76, z + 0.5]);
        for (dx, dz) in [(-0.7, -0.4), (0.7, -0.4), (-0.7, 0.4), (0.7, 0.4)] {
            mesh.lathe(vec3(x + dx, 0.0, z + dz), 24, 4, |_| 0.035, 0.72);
            let (cx, cz) = (x + 1.3 * dx, z + 2.2 * dz);
            mesh.cuboid([cx - 0.2, 0.42, cz - 0.2], [cx + 0.2, 0.46, cz + 0.2]);
            let back = cz + 0.18f32.copysign(dz);
            mesh.cuboid([cx - 0.2, 0.46, back - 0.02], [cx + 0.2, 1.0, back + 0.02]);
            for (lx, lz) in [(-0.17, -0.17), (0.17, -0.17), (-0.17, 0.17), (0.17, 0.17)] {
                mesh.lathe(vec3(cx + lx, 0.0, cz + lz), 12, 2, |_| 0.02, 0.42);
            }
        }
        for i in 0..3 {
            let aside = between(random, -0.3, 0.3);
            let at = vec3(x - 0.5 + 0.5 * i as f32, 0.76, z + aside);
            let waist = between(random, 0.3, 0.6);
            mesh.lathe(
                at,
                40,
                36,
                |v| 0.09 - 0.06 * libm::sinf(PI * (v / waist).min(1.4)),
                0.35,
            );
        }
    }
}

/// Shelves full of books.
fn add_shelves(mesh: &mut Mesh, random: &mut Rng) {
    for shelf in 0..5 {
        let y = 0.4 + 0.55 * shelf as f32;
        mesh.cuboid([7.0, y - 0.03, 7.6], [9.8, y, 8.0]);
        let mut x = 7.05;
        while x < 9.7 {
            let (width, height) = (between(random, 0.015, 0.06), between(random, 0.2, 0.4));
            mesh.cuboid(
                [x, y, 7.65],
                [x + width, y + height, between(random, 7.85, 7.98)],
            );
            x += width + 0.002;
        }
    }
}

/// A furnished room seen from a corner: walls of two triangles, vases of thousands.
fn interior() -> SceneParts {
    let mut mesh = opaque();
    let mut random = Rng::with_seed(7);
    mesh.cuboid([0.0, -0.1, 0.0], [10.0, 0.0, 8.0]);
    mesh.cuboid([0.0, 3.5, 0.0], [10.0, 3.6, 8.0]);
    mesh.cuboid([-0.1, 0.0, 0.0], [0.0, 3.5, 8.0]);
    mesh.cuboid([10.0, 0.0, 0.0], [10.1, 3.5, 8.0]);
    mesh.cuboid([0.0, 0.0, -0.1], [10.0, 3.5, 0.0]);
    mesh.cuboid([0.0, 0.0, 8.0], [10.0, 3.5, 8.1]);
    // Curtains.
    for (x, z) in [(0.15, 1.0), (0.15, 5.0), (9.85, 3.0)] {
        mesh.patch(70, 40, |u, v| {
            let fold = 0.06 * libm::sinf(u * 40.0) * (1.0 - 0.5 * v);
            vec3(x + fold, 0.2 + 3.0 * v, z + 1.8 * u)
        });
    }
    add_tables(&mut mesh, &mut random);
    add_shelves(&mut mesh, &mut random);
    // A sofa of cushions, a rug with pile, lamps, a plant.
    for i in 0..4 {
        let center = vec3(1.0 + 0.75 * i as f32, 0.45, 7.2);
        mesh.sphere(9, |d| {
            let box_like = d.signum() * d.abs().map(|it| libm::powf(it, 0.4));
            center + vec3(0.38, 0.22, 0.45) * box_like
        });
    }
    for _ in 0..2500 {
        let (x, z) = (
            between(&mut random, 3.0, 6.0),
            between(&mut random, 3.4, 4.6),
        );
        let tip = vec3(x, 0.04, z) + 0.015 * direction(&mut random);
        mesh.push([vec3(x, 0.0, z), vec3(x + 0.006, 0.0, z), tip]);
    }
    for x in [2.5, 5.0, 7.5] {
        mesh.sphere(9, |d| vec3(x, 2.9, 4.0) + 0.22 * d);
        mesh.lathe(vec3(x, 3.1, 4.0), 8, 1, |_| 0.01, 0.4);
    }
    for _ in 0..1200 {
        let root = vec3(9.2, 0.5, 0.8);
        let leaf = 0.9 * (direction(&mut random) + vec3(0.0, 0.8, 0.0)).normalize();
        let center = root + between(&mut random, 0.4, 1.0) * leaf;
        let side = 0.03 * direction(&mut random);
        let along = 0.09 * direction(&mut random);
        let (left, right) = (center + side, center - side);
        mesh.push([left, right, center + along]);
        mesh.push([right, left, center - 0.6 * along]);
    }
    (mesh, [0.7, 1.7, 0.7], [6.0, 0.8, 5.0], [5.0, 3.0, 3.8])
}

/// A thousand balls of a thousand triangles, in rows.
fn grid() -> SceneParts {
    let mut mesh = opaque();
    for z in 0..9 {
        for y in 0..9 {
            for x in 0..10 {
                let center = 2.2 * vec3(x as f32, y as f32, z as f32);
                mesh.sphere(8, |d| center + d);
            }
        }
    }
    (
        mesh,
        [-9.0, 14.0, 29.0],
        [10.0, 8.0, 9.0],
        [30.0, 40.0, 20.0],
    )
}

/// A million small triangles anywhere.
fn soup() -> SceneParts {
    let mut mesh = opaque();
    let mut random = Rng::with_seed(11);
    for _ in 0..1_000_000 {
        let center = vector(&mut random);
        mesh.push([(); 3].map(|()| center + 0.012 * vector(&mut random)));
    }
    (mesh, [0.3, 0.2, 2.4], [0.0, 0.0, 0.0], [1.5, 2.5, 1.0])
}

/// Long thin triangles at every angle: boxes say little about them.
fn needles() -> SceneParts {
    let mut mesh = opaque();
    let mut random = Rng::with_seed(13);
    for _ in 0..300_000 {
        let center = vector(&mut random);
        let along = 0.15 * direction(&mut random);
        let side = 0.0007 * direction(&mut random);
        mesh.push([center + along, center - along, center + side]);
    }
    (mesh, [0.3, 0.2, 2.4], [0.0, 0.0, 0.0], [1.5, 2.5, 1.0])
}
