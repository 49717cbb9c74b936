//! The scenes: one mesh and one camera each, made by code.

use std::f32::consts::PI;

use super::mesh::Mesh;
use super::random::{Random, hash};
use super::vector::{Vector, add, normalize, scale};

/// A mesh and who looks at it.
pub struct Scene {
    pub name: &'static str,
    pub mesh: Mesh,
    pub eye: Vector,
    pub target: Vector,
    /// Where shadow rays go.
    pub light: Vector,
}

/// How a scene is made, to be called when its turn comes.
pub struct Recipe {
    pub name: &'static str,
    /// Part of the goal; the others have rows of their own.
    pub counts: bool,
    make: fn() -> (Mesh, Vector, Vector, Vector),
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
            eye,
            target,
            light,
        }
    }
}

/// Smooth noise in −1..1: hashed values at the corners of unit cells.
fn noise(p: Vector) -> f32 {
    let cell = p.map(f32::floor);
    let fade: Vector = std::array::from_fn(|i| {
        let t = p[i] - cell[i];
        t * t * (3.0 - 2.0 * t)
    });
    let mut sum = 0.0;
    for corner in 0..8u32 {
        let mut seed = 0;
        let mut weight = 1.0;
        for axis in 0..3 {
            let up = corner >> axis & 1;
            seed = hash(seed ^ (cell[axis] as i32 as u32).wrapping_add(up));
            weight *= if up == 1 {
                fade[axis]
            } else {
                1.0 - fade[axis]
            };
        }
        sum += weight * (seed as f32 / u32::MAX as f32 * 2.0 - 1.0);
    }
    sum
}

/// A lump with creases, about 70,000 small triangles: what a scan is like.
fn bunny() -> (Mesh, Vector, Vector, Vector) {
    let mut mesh = Mesh::default();
    mesh.sphere(59, |d| {
        let mut radius = 1.0;
        for (octave, weight) in [(1.7, 0.45), (4.1, 0.18), (9.7, 0.06), (31.0, 0.012)] {
            radius += weight * noise(scale(d, octave));
        }
        scale(d, radius)
    });
    (mesh, [1.9, 1.1, 2.3], [0.0, 0.0, 0.0], [3.0, 5.0, 2.0])
}

/// A furnished room seen from a corner: walls of two triangles, vases of thousands.
fn interior() -> (Mesh, Vector, Vector, Vector) {
    let mut mesh = Mesh::default();
    let mut random = Random::new(7);
    mesh.cuboid([0.0, -0.1, 0.0], [10.0, 0.0, 8.0]);
    mesh.cuboid([0.0, 3.5, 0.0], [10.0, 3.6, 8.0]);
    mesh.cuboid([-0.1, 0.0, 0.0], [0.0, 3.5, 8.0]);
    mesh.cuboid([10.0, 0.0, 0.0], [10.1, 3.5, 8.0]);
    mesh.cuboid([0.0, 0.0, -0.1], [10.0, 3.5, 0.0]);
    mesh.cuboid([0.0, 0.0, 8.0], [10.0, 3.5, 8.1]);
    // Curtains.
    for (x, z) in [(0.15, 1.0), (0.15, 5.0), (9.85, 3.0)] {
        mesh.patch(70, 40, |u, v| {
            [
                x + 0.06 * (u * 40.0).sin() * (1.0 - 0.5 * v),
                0.2 + 3.0 * v,
                z + 1.8 * u,
            ]
        });
    }
    // Tables with vases, each with chairs.
    for (x, z) in [(2.5, 2.5), (6.5, 2.2), (4.5, 5.5)] {
        mesh.cuboid([x - 0.8, 0.72, z - 0.5], [x + 0.8, 0.76, z + 0.5]);
        for (dx, dz) in [(-0.7, -0.4), (0.7, -0.4), (-0.7, 0.4), (0.7, 0.4)] {
            mesh.lathe([x + dx, 0.0, z + dz], 24, 4, |_| 0.035, 0.72);
            let (cx, cz) = (x + 1.3 * dx, z + 2.2 * dz);
            mesh.cuboid([cx - 0.2, 0.42, cz - 0.2], [cx + 0.2, 0.46, cz + 0.2]);
            let back = cz + 0.18f32.copysign(dz);
            mesh.cuboid([cx - 0.2, 0.46, back - 0.02], [cx + 0.2, 1.0, back + 0.02]);
            for (lx, lz) in [(-0.17, -0.17), (0.17, -0.17), (-0.17, 0.17), (0.17, 0.17)] {
                mesh.lathe([cx + lx, 0.0, cz + lz], 12, 2, |_| 0.02, 0.42);
            }
        }
        for i in 0..3 {
            let at = [
                x - 0.5 + 0.5 * i as f32,
                0.76,
                z + random.between(-0.3, 0.3),
            ];
            let waist = random.between(0.3, 0.6);
            mesh.lathe(
                at,
                40,
                36,
                |v| 0.09 - 0.06 * (PI * (v / waist).min(1.4)).sin(),
                0.35,
            );
        }
    }
    // Shelves full of books.
    for shelf in 0..5 {
        let y = 0.4 + 0.55 * shelf as f32;
        mesh.cuboid([7.0, y - 0.03, 7.6], [9.8, y, 8.0]);
        let mut x = 7.05;
        while x < 9.7 {
            let (width, height) = (random.between(0.015, 0.06), random.between(0.2, 0.4));
            mesh.cuboid(
                [x, y, 7.65],
                [x + width, y + height, random.between(7.85, 7.98)],
            );
            x += width + 0.002;
        }
    }
    // A sofa of cushions, a rug with pile, lamps, a plant.
    for i in 0..4 {
        let center = [1.0 + 0.75 * i as f32, 0.45, 7.2];
        mesh.sphere(9, |d| {
            let box_like = d.map(|c| c.signum() * c.abs().powf(0.4));
            add(
                center,
                [0.38 * box_like[0], 0.22 * box_like[1], 0.45 * box_like[2]],
            )
        });
    }
    for _ in 0..2500 {
        let (x, z) = (random.between(3.0, 6.0), random.between(3.4, 4.6));
        let tip = add([x, 0.04, z], scale(random.direction(), 0.015));
        mesh.triangle([[x, 0.0, z], [x + 0.006, 0.0, z], tip]);
    }
    for x in [2.5, 5.0, 7.5] {
        mesh.sphere(9, |d| add([x, 2.9, 4.0], scale(d, 0.22)));
        mesh.lathe([x, 3.1, 4.0], 8, 1, |_| 0.01, 0.4);
    }
    for _ in 0..1200 {
        let root = [9.2, 0.5, 0.8];
        let tip = add(
            root,
            scale(normalize(add(random.direction(), [0.0, 0.8, 0.0])), 0.9),
        );
        let at = random.between(0.4, 1.0);
        let center: Vector = std::array::from_fn(|i| root[i] + at * (tip[i] - root[i]));
        let side = scale(random.direction(), 0.03);
        let along = scale(random.direction(), 0.09);
        let (left, right) = (add(center, side), add(center, scale(side, -1.0)));
        mesh.triangle([left, right, add(center, along)]);
        mesh.triangle([right, left, add(center, scale(along, -0.6))]);
    }
    (mesh, [0.7, 1.7, 0.7], [6.0, 0.8, 5.0], [5.0, 3.0, 3.8])
}

/// A thousand balls of a thousand triangles, in rows.
fn grid() -> (Mesh, Vector, Vector, Vector) {
    let mut mesh = Mesh::default();
    for z in 0..9 {
        for y in 0..9 {
            for x in 0..10 {
                let center = [x, y, z].map(|c| 2.2 * c as f32);
                mesh.sphere(8, |d| add(center, d));
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
fn soup() -> (Mesh, Vector, Vector, Vector) {
    let mut mesh = Mesh::default();
    let mut random = Random::new(11);
    for _ in 0..1_000_000 {
        let center = random.vector();
        mesh.triangle([(); 3].map(|()| add(center, scale(random.vector(), 0.012))));
    }
    (mesh, [0.3, 0.2, 2.4], [0.0, 0.0, 0.0], [1.5, 2.5, 1.0])
}

/// Long thin triangles at every angle: boxes say little about them.
fn needles() -> (Mesh, Vector, Vector, Vector) {
    let mut mesh = Mesh::default();
    let mut random = Random::new(13);
    for _ in 0..300_000 {
        let center = random.vector();
        let along = scale(random.direction(), 0.15);
        let side = scale(random.direction(), 0.0007);
        mesh.triangle([
            add(center, along),
            add(center, scale(along, -1.0)),
            add(center, side),
        ]);
    }
    (mesh, [0.3, 0.2, 2.4], [0.0, 0.0, 0.0], [1.5, 2.5, 1.0])
}
