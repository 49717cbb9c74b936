//! Meshes under construction.

use glam::Vec3;

use super::{Geometry, Mesh, Model, Scene, Vertex};

/// A part of a mesh that has one material.
#[derive(Default)]
pub struct Part {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
}

impl Part {
    pub fn vertex(&mut self, position: Vec3, normal: Vec3, uv: (f32, f32)) -> u32 {
        let (u, v) = uv;
        self.vertices.push(Vertex {
            position,
            u,
            normal,
            v,
        });
        self.vertices.len() as u32 - 1
    }

    pub fn triangle(&mut self, a: u32, b: u32, c: u32) {
        self.indices.extend([a, b, c]);
    }

    pub fn quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.indices.extend([a, b, c, a, c, d]);
    }

    /// A grid of `columns` × `rows` quads over a surface given at (0..=1, 0..=1); the normals are
    /// the surface's own.
    pub fn grid(
        &mut self,
        columns: u32,
        rows: u32,
        mut at: impl FnMut(f32, f32) -> (Vec3, Vec3, (f32, f32)),
    ) {
        let first = self.vertices.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let (s, t) = (column as f32 / columns as f32, row as f32 / rows as f32);
                let (position, normal, uv) = at(s, t);
                self.vertex(position, normal, uv);
            }
        }
        let stride = columns + 1;
        for row in 0..rows {
            for column in 0..columns {
                let a = first + row * stride + column;
                self.quad(a, a + 1, a + 1 + stride, a + stride);
            }
        }
    }
}

impl Scene {
    /// Adds a mesh of parts with their materials.
    pub(super) fn add_mesh(&mut self, parts: &[(&Part, u32)]) -> Model {
        let first_geometry = self.geometries.len() as u32;
        for (part, material) in parts {
            self.geometries.push(Geometry {
                first_index: self.indices.len() as u32,
                index_count: part.indices.len() as u32,
                first_vertex: self.vertices.len() as u32,
                vertex_count: part.vertices.len() as u32,
                material: *material,
            });
            self.vertices.extend_from_slice(&part.vertices);
            self.indices.extend_from_slice(&part.indices);
        }
        self.meshes.push(Mesh {
            first_geometry,
            geometry_count: parts.len() as u32,
        });
        Model::Mesh(self.meshes.len() as u32 - 1)
    }
}
