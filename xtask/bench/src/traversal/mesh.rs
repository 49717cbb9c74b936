//! Meshes and the shapes that they are put together from.

use std::f32::consts::TAU;

use super::vector::{Vector, normalize};

/// Triangles with shared vertices.
#[derive(Default)]
pub struct Mesh {
    pub vertices: Vec<Vector>,
    pub indices: Vec<[u32; 3]>,
}

impl Mesh {
    /// A triangle with vertices of its own.
    pub fn triangle(&mut self, corners: [Vector; 3]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners);
        self.indices.push([first, first + 1, first + 2]);
    }

    /// A grid of `columns` × `rows` quads; `place` gives the position at (u, v) in 0..1.
    pub fn patch(&mut self, columns: u32, rows: u32, place: impl Fn(f32, f32) -> Vector) {
        let first = self.vertices.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
                self.vertices.push(place(u, v));
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
    pub fn cuboid(&mut self, min: Vector, max: Vector) {
        for axis in 0..3 {
            let (s, t) = ((axis + 1) % 3, (axis + 2) % 3);
            for level in [min[axis], max[axis]] {
                self.patch(1, 1, |u, v| {
                    let mut corner = [level; 3];
                    corner[s] = min[s] + u * (max[s] - min[s]);
                    corner[t] = min[t] + v * (max[t] - min[t]);
                    corner
                });
            }
        }
    }

    /// A surface of revolution that stands at `base`; `radius` at heights 0..1.
    pub fn lathe(
        &mut self,
        base: Vector,
        columns: u32,
        rows: u32,
        radius: impl Fn(f32) -> f32,
        height: f32,
    ) {
        self.patch(columns, rows, |u, v| {
            let (sin, cos) = turn(u);
            let r = radius(v);
            [base[0] + r * cos, base[1] + height * v, base[2] + r * sin]
        });
    }

    /// An icosahedron whose edges are cut into `frequency` parts: 20 frequency² triangles. `place`
    /// moves each point of the unit sphere.
    pub fn sphere(&mut self, frequency: u32, place: impl Fn(Vector) -> Vector) {
        let p = (1.0 + 5f32.sqrt()) / 2.0;
        let corners = [
            [-1.0, p, 0.0],
            [1.0, p, 0.0],
            [-1.0, -p, 0.0],
            [1.0, -p, 0.0],
            [0.0, -1.0, p],
            [0.0, 1.0, p],
            [0.0, -1.0, -p],
            [0.0, 1.0, -p],
            [p, 0.0, -1.0],
            [p, 0.0, 1.0],
            [-p, 0.0, -1.0],
            [-p, 0.0, 1.0],
        ];
        for face in FACES {
            let [a, b, c] = face.map(|i| corners[i]);
            let first = self.vertices.len() as u32;
            // Rows of 1, 2, … points; row r starts after r (r + 1) / 2.
            for row in 0..=frequency {
                for column in 0..=row {
                    let (v, w) = (row - column, column);
                    let u = frequency - row;
                    let point = std::array::from_fn(|i| {
                        u as f32 * a[i] + v as f32 * b[i] + w as f32 * c[i]
                    });
                    self.vertices.push(place(normalize(point)));
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

/// The faces of an icosahedron.
const FACES: [[usize; 3]; 20] = [
    [0, 11, 5],
    [0, 5, 1],
    [0, 1, 7],
    [0, 7, 10],
    [0, 10, 11],
    [1, 5, 9],
    [5, 11, 4],
    [11, 10, 2],
    [10, 7, 6],
    [7, 1, 8],
    [3, 9, 4],
    [3, 4, 2],
    [3, 2, 6],
    [3, 6, 8],
    [3, 8, 9],
    [4, 9, 5],
    [2, 4, 11],
    [6, 2, 10],
    [8, 6, 7],
    [9, 8, 1],
];

/// A circle's point.
pub fn turn(fraction: f32) -> (f32, f32) {
    (TAU * fraction).sin_cos()
}
