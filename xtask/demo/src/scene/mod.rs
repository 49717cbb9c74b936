//! A scene as the renderer takes it: meshes, instances, materials, textures, a camera and a sun.
#![forbid(unsafe_code)]

mod gltf_file;
mod landscape;
mod mesh;
mod noise;
mod paint;
mod random;
mod shapes;
mod terrain;
mod texture;
mod tree;

use std::path::Path;

use anyhow::Result;
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec3};

pub use texture::{Texture, Wrap};

/// In place of a texture's index: no texture.
pub const NONE: u32 = u32::MAX;

/// In place of a material's `alpha_cutoff`: alpha is how likely a hit is to be one.
pub const BY_CHANCE: f32 = 2.0;

/// A vertex as the shaders read it (`Vertex` in scene.glsl): 32 bytes.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Vertex {
    pub position: Vec3,
    pub u: f32,
    pub normal: Vec3,
    pub v: f32,
}

/// Kinds of material, as in scene.glsl.
pub mod kind {
    pub const PLAIN: u32 = 0;
    pub const TERRAIN: u32 = 1;
    pub const WATER: u32 = 2;
    pub const GLASS: u32 = 3;
}

/// A material as the shaders read it (`Material` in scene.glsl): 80 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    pub base_color: Vec3,
    /// Hits with less alpha than this are none; 0 for opaque materials.
    pub alpha_cutoff: f32,
    pub emission: Vec3,
    pub roughness: f32,
    /// Per metre, inside glass and water.
    pub absorption: Vec3,
    pub metallic: f32,
    pub kind: u32,
    pub base_texture: u32,
    pub metal_rough_texture: u32,
    pub normal_texture: u32,
    pub emission_texture: u32,
    pub ior: f32,
    /// The share of diffuse light that goes through.
    pub translucency: f32,
    pub normal_scale: f32,
}

impl Default for Material {
    fn default() -> Material {
        Material {
            base_color: Vec3::splat(0.8),
            alpha_cutoff: 0.0,
            emission: Vec3::ZERO,
            roughness: 1.0,
            absorption: Vec3::ZERO,
            metallic: 0.0,
            kind: kind::PLAIN,
            base_texture: NONE,
            metal_rough_texture: NONE,
            normal_texture: NONE,
            emission_texture: NONE,
            ior: 1.5,
            translucency: 0.0,
            normal_scale: 1.0,
        }
    }
}

/// One material's part of a mesh: a range of the scene's indices.
#[derive(Clone, Copy, Debug)]
pub struct Geometry {
    pub first_index: u32,
    pub index_count: u32,
    /// Added to each index.
    pub first_vertex: u32,
    pub vertex_count: u32,
    pub material: u32,
}

/// The geometries of one bottom-level acceleration structure, consecutive.
#[derive(Clone, Copy, Debug)]
pub struct Mesh {
    pub first_geometry: u32,
    pub geometry_count: u32,
}

/// The shapes that have an intersection shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    Sphere,
    Sponge,
}

/// A procedural primitive: it fits the box `centre ± radius`.
#[derive(Clone, Copy, Debug)]
pub struct Procedural {
    pub shape: Shape,
    pub centre: Vec3,
    pub radius: f32,
    pub material: u32,
}

/// The model of an instance.
#[derive(Clone, Copy, Debug)]
pub enum Model {
    Mesh(u32),
    Procedural(u32),
}

#[derive(Clone, Copy, Debug)]
pub struct Instance {
    pub model: Model,
    pub transform: Affine3A,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub position: Vec3,
    pub forward: Vec3,
    pub up: Vec3,
    /// The full vertical angle of view, in radians.
    pub fov_y: f32,
}

#[derive(Clone, Copy, Debug)]
pub struct Sun {
    /// Towards the sun, a unit vector.
    pub direction: Vec3,
    pub irradiance: Vec3,
    /// Its apparent radius, in radians.
    pub angular_radius: f32,
}

/// Textures that the shaders know by role.
#[derive(Clone, Copy, Debug)]
pub struct Roles {
    pub grass: u32,
    pub rock: u32,
    pub sand: u32,
    pub clouds: u32,
}

#[derive(Debug)]
pub struct Scene {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
    pub geometries: Vec<Geometry>,
    pub meshes: Vec<Mesh>,
    pub procedurals: Vec<Procedural>,
    pub instances: Vec<Instance>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub camera: Camera,
    pub sun: Sun,
    /// Colour of the haze, and its density per unit of length.
    pub haze: (Vec3, f32),
    pub roles: Roles,
    /// The picture's exposure: a factor before tone mapping.
    pub exposure: f32,
    /// About how large the scene is: what counts as touching follows from it.
    pub extent: f32,
}

impl Scene {
    /// The scene made by code, the same on every machine.
    pub fn landscape() -> Scene {
        landscape::landscape()
    }

    /// A glTF scene from a file (.glb or .gltf).
    pub fn from_gltf(path: &Path) -> Result<Scene> {
        gltf_file::load(path)
    }

    /// Triangles stored, each counted once however often it is instanced.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// Triangles as instanced in the scene.
    pub fn instanced_triangle_count(&self) -> usize {
        let of = |instance: &Instance| match instance.model {
            Model::Mesh(mesh) => {
                let mesh = self.meshes[mesh as usize];
                self.geometries[mesh.first_geometry as usize..][..mesh.geometry_count as usize]
                    .iter()
                    .map(|geometry| geometry.index_count as usize / 3)
                    .sum()
            }
            Model::Procedural(_) => 0,
        };
        self.instances.iter().map(of).sum()
    }

    fn add_material(&mut self, material: Material) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    fn add_texture(&mut self, texture: Texture) -> u32 {
        self.textures.push(texture);
        self.textures.len() as u32 - 1
    }

    fn add_procedural(&mut self, procedural: Procedural) -> Model {
        self.procedurals.push(procedural);
        Model::Procedural(self.procedurals.len() as u32 - 1)
    }

    fn place(&mut self, model: Model, transform: Affine3A) {
        self.instances.push(Instance { model, transform });
    }
}
