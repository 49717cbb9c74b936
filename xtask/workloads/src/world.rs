//! A scene on the device: structures, the meshes for shading, a camera and room for the picture.

use glam::{Affine3A, Vec3, vec3};
use tuff_tests::{Bound, Buffer, Geometry, Gpu, Instance, Structure, vk};

use crate::scene::{self, Mesh};

/// How large a workload is.
#[derive(Clone, Copy, Debug, clap::Args, serde::Serialize, serde::Deserialize)]
pub struct Scale {
    /// Picture width in pixels
    #[arg(long, default_value_t = 480)]
    pub width: u32,
    /// Picture height in pixels
    #[arg(long, default_value_t = 270)]
    pub height: u32,
    /// Triangles of the ground
    #[arg(long, default_value_t = 200_000)]
    pub triangles: usize,
    /// Balls of 2,048 triangles on it
    #[arg(long, default_value_t = 256)]
    pub instances: usize,
    /// Leave out the any-hit shader of `foliage`
    #[arg(long)]
    pub no_any_hit: bool,
}

impl Scale {
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}

/// The resources of the shaders' common bindings.
pub struct World {
    pub top: Structure,
    pub out: Buffer,
    pub corners: Buffer,
    pub indices: Buffer,
    pub camera: Buffer,
}

impl World {
    /// The ground with balls on it, opaque. `materials` hit groups are dealt out to the balls.
    pub fn landscape(gpu: &Gpu, scale: &Scale, materials: u32) -> World {
        let (ground, ball) = (scene::hills(scale.triangles), scene::ball(4));
        let opaque = vk::GeometryFlagsKHR::OPAQUE;
        let bottoms = [&ground, &ball].map(|mesh| gpu.bottom(&[geometry(mesh, opaque)]));
        let mut instances = vec![Instance::of(bottoms[0])];
        for placed in scene::placements(scale.instances, materials) {
            instances.push(Instance {
                transform: rows(&placed.transform),
                custom_index: ground.indices.len() as u32,
                table_offset: placed.material,
                ..Instance::of(bottoms[1])
            });
        }
        World::of(gpu, scale, &[&ground, &ball], gpu.top(&instances))
    }

    /// As little of it as there can be.
    pub fn least(gpu: &Gpu, scale: &Scale) -> World {
        let scale = Scale {
            triangles: 2,
            instances: 1,
            ..*scale
        };
        World::landscape(gpu, &scale, 1)
    }

    /// Ground, and leaves over it that an any-hit shader cuts out.
    pub fn foliage(gpu: &Gpu, scale: &Scale) -> World {
        World::foliage_of(gpu, scale, |leaves| {
            gpu.bottom(&[geometry(leaves, vk::GeometryFlagsKHR::empty())])
        })
    }

    /// The same with the structure that `below` makes of the leaves.
    pub fn foliage_of(gpu: &Gpu, scale: &Scale, below: impl Fn(&Mesh) -> Structure) -> World {
        let (ground, leaves) = (scene::hills(scale.triangles / 4), scene::leaves(30_000));
        let ground_below = gpu.bottom(&[geometry(&ground, vk::GeometryFlagsKHR::OPAQUE)]);
        let leaves_below = below(&leaves);
        let top = gpu.top(&[
            Instance::of(ground_below),
            Instance {
                custom_index: ground.indices.len() as u32,
                ..Instance::of(leaves_below)
            },
        ]);
        World::of(gpu, scale, &[&ground, &leaves], top)
    }

    /// Spheres in boxes, for an intersection shader. The corners are their middles.
    pub fn spheres(gpu: &Gpu, scale: &Scale) -> World {
        let middles: Vec<[f32; 3]> = scene::places(scale.instances * 8)
            .into_iter()
            .map(|place| (place * 1.5).into())
            .collect();
        let boxes: Vec<[f32; 6]> = middles
            .iter()
            .map(|&[x, y, z]| [x - 1.0, y - 1.0, z - 1.0, x + 1.0, y + 1.0, z + 1.0])
            .collect();
        let top = gpu.scene(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::OPAQUE)]);
        let mesh = Mesh {
            corners: middles,
            indices: vec![0],
        };
        World::of(gpu, scale, &[&mesh], top)
    }

    /// Boxes of many sizes on a plane, which is a box, too. The corners are the lower and the upper
    /// one of each.
    pub fn boxes(gpu: &Gpu, scale: &Scale) -> World {
        let boxes = scene::boxes(scale.instances * 2);
        let top = gpu.scene(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::OPAQUE)]);
        let ends = |&[a, b, c, d, e, f]: &[f32; 6]| [[a, b, c], [d, e, f]];
        let mesh = Mesh {
            corners: boxes.iter().flat_map(ends).collect(),
            indices: vec![0],
        };
        World::of(gpu, scale, &[&mesh], top)
    }

    /// One mesh as it is.
    pub fn of_mesh(gpu: &Gpu, scale: &Scale, mesh: &Mesh, bottom: Structure) -> World {
        World::of(gpu, scale, &[mesh], gpu.top(&[Instance::of(bottom)]))
    }

    fn of(gpu: &Gpu, scale: &Scale, meshes: &[&Mesh], top: Structure) -> World {
        let (mut corners, mut indices) = (Vec::new(), Vec::new());
        for mesh in meshes {
            let first = corners.len() as u32;
            corners.extend_from_slice(&mesh.corners);
            indices.extend(mesh.indices.iter().map(|index| first + index));
        }
        World {
            top,
            out: gpu.buffer(scale.pixels() * 16),
            corners: gpu.buffer_with(&corners),
            indices: gpu.buffer_with(&indices),
            camera: gpu.buffer_with(&camera(scale)),
        }
    }

    /// The bindings of `common.glsl`.
    pub fn bindings(&self) -> Vec<(u32, [Bound; 1])> {
        vec![
            (0, [Bound::Structure(self.top.handle)]),
            (1, [Bound::Storage(self.out)]),
            (2, [Bound::Storage(self.corners)]),
            (3, [Bound::Storage(self.indices)]),
            (4, [Bound::Uniform(self.camera)]),
        ]
    }
}

/// A mesh as a geometry of a bottom level.
pub fn geometry(mesh: &Mesh, flags: vk::GeometryFlagsKHR) -> Geometry {
    Geometry::Triangles {
        corners: mesh.corners.clone(),
        indices: mesh.indices.clone(),
        flags,
    }
}

/// The camera's position, the vectors to the picture's right and upper edges, and its direction.
pub fn camera(scale: &Scale) -> [[f32; 3]; 4] {
    let eye = vec3(-14.0, 7.0, -22.0);
    let ahead = (vec3(2.0, 0.0, 3.0) - eye).normalize();
    let wide = 0.6 * scale.width as f32 / scale.height as f32;
    let right = ahead.cross(Vec3::Y).normalize();
    let up = right.cross(ahead);
    [eye, right * wide, up * 0.6, ahead].map(Into::into)
}

/// The rows of a transform, one after the other.
pub fn rows(transform: &Affine3A) -> [f32; 12] {
    let columns = transform.to_cols_array_2d();
    std::array::from_fn(|i| columns[i % 4][i / 4])
}
