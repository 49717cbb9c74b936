//! The shapes that meshes are put together from.

use std::f32::consts::TAU;

use glam::{DVec3, Vec3, vec3};

use crate::{ICOSAHEDRON, Mesh, icosahedron};

impl Mesh {
    /// A triangle with vertices of its own.
    pub fn push(&mut self, corners: [Vec3; 3]) {
        let first = self.vertices.len() as u32;
        self.vertices
            .extend(corners.map(|corner| corner.to_array()));
        self.indices.push([first, first + 1, first + 2]);
    }

    /// A grid of `columns` × `rows` quads; `place` gives the position at (u, v) in 0..1.
    pub fn patch(&mut self, columns: u32, rows: u32, place: impl Fn(f32, f32) -> Vec3) {
        let first = self.vertices.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
                self.vertices.push(place(u, v).into());
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = first + row * (columns + 1) + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns + 2);
                self.indices.extend([[a, b, c], [b, d, c]]);
            }
        }
    }

    /// An axis-aligned box.
    pub fn cuboid(&mut self, min: [f32; 3], max: [f32; 3]) {
        for axis in 0..3 {
            let (s, t) = ((axis + 1) % 3, (axis + 2) % 3);
            for level in [min[axis], max[axis]] {
                self.patch(1, 1, |u, v| {
                    let mut corner = [level; 3];
                    corner[s] = min[s] + u * (max[s] - min[s]);
                    corner[t] = min[t] + v * (max[t] - min[t]);
                    corner.into()
                });
            }
        }
    }

    /// A surface of revolution that stands at `base`; `radius` at heights 0..1.
    pub fn lathe(
        &mut self,
        base: Vec3,
        columns: u32,
        rows: u32,
        radius: impl Fn(f32) -> f32,
        height: f32,
    ) {
        self.patch(columns, rows, |u, v| {
            let (sin, cos) = libm::sincosf(TAU * u);
            let r = radius(v);
            base + vec3(r * cos, height * v, r * sin)
        });
    }

    /// An icosahedron whose edges are cut into `frequency` parts: 20 frequency² triangles. `place`
    /// moves each point of the unit sphere.
    pub fn sphere(&mut self, frequency: u32, place: impl Fn(Vec3) -> Vec3) {
        let corners = icosahedron().map(|corner| DVec3::from(corner).as_vec3());
        for face in ICOSAHEDRON {
            let [a, b, c] = face.map(|i| corners[i as usize]);
            let first = self.vertices.len() as u32;
            // Rows of 1, 2, … points; row r starts after r (r + 1) / 2.
            for row in 0..=frequency {
                for column in 0..=row {
                    let (v, w) = (row - column, column);
                    let u = frequency - row;
                    let point = u as f32 * a + v as f32 * b + w as f32 * c;
                    self.vertices.push(place(point.normalize()).into());
                }
            }
            for row in 0..frequency {
                let above = first + row * (row + 1) / 2;
                let below = above + row + 1;
                for column in 0..=row {
                    let (top, left) = (above + column, below + column);
                    self.indices.push([top, left, left + 1]);
                    if column < row {
                        self.indices.push([top, left + 1, top + 1]);
                    }
                }
            }
        }
    }
}
