//! A scene of clusters of triangles: by mesh shaders behind a task shader that culls, and the same
//! scene by vertex shaders.

use std::collections::HashMap;

use ash::ext;
use glam::{Affine3A, Vec3};
use tuff_tests::{Bound, Gpu, Painting, Pass, vk};

use super::gbuffer::normals;
use super::view::{View, nearer, projection};
use super::{RGBA, canvas, drawn, draws, turn};
use crate::scene::{self, Mesh};
use crate::workload::Prepared;
use crate::world::{Scale, camera, rows};

const MOST_VERTICES: usize = 64;
const MOST_TRIANGLES: usize = 124;

/// Clusters that a task workgroup looks at.
const TASKS: u32 = 32;

/// Quads along a side of the ground's clusters: these have 64 corners.
const QUADS: u32 = 7;

const COLORS: &str = "
    vec3 tintOf(int number) { return 0.5 + 0.5 * cos(vec3(0.0, 2.1, 4.2) + float(number)); }";

const VERTEX: &str = "
    layout(location = 0) in vec3 corner;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in vec4 row0;
    layout(location = 3) in vec4 row1;
    layout(location = 4) in vec4 row2;
    layout(location = 0) out vec3 up;
    layout(location = 1) out vec3 tint;
    layout(push_constant) uniform Push { mat4 camera; };
    void main() {
        vec4 at = vec4(corner, 1.0);
        vec3 place = vec3(dot(row0, at), dot(row1, at), dot(row2, at));
        up = vec3(dot(row0.xyz, normal), dot(row1.xyz, normal), dot(row2.xyz, normal));
        tint = tintOf(gl_InstanceIndex);
        gl_Position = camera * vec4(place, 1.0);
    }";

const FRAGMENT: &str = "
    layout(location = 0) in vec3 up;
    layout(location = 1) in vec3 tint;
    layout(location = 0) out vec4 color;
    void main() {
        float light = max(dot(normalize(up), vec3(0.48, 0.8, -0.36)), 0.0);
        color = vec4(tint * (0.2 + 0.8 * light), 1.0);
    }";

/// Declarations of both task and mesh shaders.
const SHARED: &str = "
    struct Cluster { vec4 sphere; vec4 cone; uint vertex, vertices, triangle, triangles; };
    struct Instance { vec4 rows[3]; vec4 eye; };
    struct Payload { uint instance; uint clusters[32]; };
    layout(push_constant) uniform Push { mat4 camera; uint first, count, instance; };
    layout(set = 0, binding = 0) readonly buffer Clusters { Cluster clusters[]; };
    layout(set = 0, binding = 1) readonly buffer Instances { Instance instances[]; };
    taskPayloadSharedEXT Payload payload;";

/// A cluster is left out if it is outside of the view, or if all of its triangles look away from
/// the eye in the space of the mesh.
const TASK: &str = "
    layout(local_size_x = 32) in;
    shared uint visible;
    bool isSeen(Cluster cluster, Instance instance) {
        vec3 from = cluster.sphere.xyz - instance.eye.xyz;
        float reach = cluster.cone.w * length(from) + cluster.sphere.w;
        if (dot(from, cluster.cone.xyz) >= reach) return false;
        vec4 middle = vec4(cluster.sphere.xyz, 1.0);
        vec3 place = vec3(
            dot(instance.rows[0], middle), dot(instance.rows[1], middle), dot(instance.rows[2], middle));
        vec4 clip = camera * vec4(place, 1.0);
        float radius = cluster.sphere.w * instance.eye.w;
        return !any(greaterThan(abs(clip.xy), clip.ww + radius * vec2(1.5, 2.0)));
    }
    void main() {
        if (gl_LocalInvocationIndex == 0) {
            visible = 0;
            payload.instance = instance + gl_WorkGroupID.y;
        }
        barrier();
        uint number = gl_GlobalInvocationID.x;
        if (number < count && isSeen(clusters[first + number], instances[instance + gl_WorkGroupID.y])) {
            payload.clusters[atomicAdd(visible, 1u)] = first + number;
        }
        barrier();
        EmitMeshTasksEXT(visible, 1, 1);
    }";

const MESH: &str = "
    layout(local_size_x = 64) in;
    layout(triangles, max_vertices = 64, max_primitives = 124) out;
    layout(location = 0) out vec3 up[];
    layout(location = 1) out vec3 tint[];
    layout(set = 0, binding = 2, scalar) readonly buffer Corners { vec3 corners[]; };
    layout(set = 0, binding = 3, scalar) readonly buffer Normals { vec3 normals[]; };
    layout(set = 0, binding = 4) readonly buffer Numbers { uint numbers[]; };
    layout(set = 0, binding = 5) readonly buffer Triangles { uint triangles[]; };
    void main() {
        Cluster cluster = clusters[payload.clusters[gl_WorkGroupID.x]];
        Instance instance = instances[payload.instance];
        SetMeshOutputsEXT(cluster.vertices, cluster.triangles);
        uint i = gl_LocalInvocationIndex;
        if (i < cluster.vertices) {
            uint number = numbers[cluster.vertex + i];
            vec4 at = vec4(corners[number], 1.0);
            vec3 normal = normals[number];
            mat3x4 of = mat3x4(instance.rows[0], instance.rows[1], instance.rows[2]);
            up[i] = vec3(dot(of[0].xyz, normal), dot(of[1].xyz, normal), dot(of[2].xyz, normal));
            tint[i] = tintOf(int(payload.instance));
            gl_MeshVerticesEXT[i].gl_Position = camera * vec4(at * of, 1.0);
        }
        for (; i < cluster.triangles; i += 64) {
            uint three = triangles[cluster.triangle + i];
            gl_PrimitiveTriangleIndicesEXT[i] = uvec3(three, three >> 8, three >> 16) & 0xFFu;
        }
    }";

#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Cluster {
    /// Middle and radius.
    sphere: [f32; 4],
    /// The axis of the triangles' normals, and the sine of the widest angle to it.
    cone: [f32; 4],
    vertex: u32,
    vertices: u32,
    triangle: u32,
    triangles: u32,
}

#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Instance {
    rows: [f32; 12],
    /// The eye in the mesh's space, and how much larger than that the world is at most.
    eye: [f32; 4],
}

#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Push {
    camera: [f32; 16],
    first: u32,
    count: u32,
    instance: u32,
}

/// Corners by number, and indices into these, as meshlets hold them.
#[derive(Default)]
struct Clusters {
    clusters: Vec<Cluster>,
    corners: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    numbers: Vec<u32>,
    triangles: Vec<u32>,
}

impl Clusters {
    /// Adds the triangles of a mesh in their order; a cluster ends where the next triangle has no
    /// room.
    fn add(&mut self, mesh: &Mesh) {
        let base = self.corners.len() as u32;
        self.corners.extend_from_slice(&mesh.corners);
        self.normals.extend(normals(mesh));
        let mut members: Vec<[u32; 3]> = Vec::new();
        let mut places: HashMap<u32, u32> = HashMap::new();
        for triangle in mesh.indices.chunks_exact(3) {
            let new = triangle
                .iter()
                .filter(|corner| !places.contains_key(corner))
                .count();
            if places.len() + new > MOST_VERTICES || members.len() == MOST_TRIANGLES {
                self.close(mesh, base, &members, &places);
                members.clear();
                places.clear();
            }
            members.push([0, 1, 2].map(|i| {
                let next = places.len() as u32;
                *places.entry(triangle[i]).or_insert(next)
            }));
        }
        self.close(mesh, base, &members, &places);
    }

    fn close(&mut self, mesh: &Mesh, base: u32, members: &[[u32; 3]], places: &HashMap<u32, u32>) {
        let mut corners = vec![0; places.len()];
        for (&corner, &place) in places {
            corners[place as usize] = corner;
        }
        let at = |place: u32| Vec3::from(mesh.corners[corners[place as usize] as usize]);
        let all = || (0..corners.len() as u32).map(at);
        let (low, high) = all().fold((Vec3::MAX, Vec3::MIN), |(low, high), at| {
            (low.min(at), high.max(at))
        });
        let middle = (low + high) * 0.5;
        let radius = all().map(|at| at.distance(middle)).fold(0.0, f32::max);
        let facing = |&[a, b, c]: &[u32; 3]| (at(b) - at(a)).cross(at(c) - at(a)).normalize();
        let axis = members.iter().map(facing).sum::<Vec3>().normalize();
        let least = members
            .iter()
            .map(|it| facing(it).dot(axis))
            .fold(1.0, f32::min);
        // A cone as wide as half of all directions looks away from nothing.
        let sine = match least > 0.1 {
            true => (1.0 - least * least).sqrt(),
            false => 1.0,
        };
        self.clusters.push(Cluster {
            sphere: middle.extend(radius).to_array(),
            cone: axis.extend(sine).to_array(),
            vertex: self.numbers.len() as u32,
            vertices: corners.len() as u32,
            triangle: self.triangles.len() as u32,
            triangles: members.len() as u32,
        });
        self.numbers
            .extend(corners.iter().map(|corner| base + corner));
        self.triangles
            .extend(members.iter().map(|[a, b, c]| a | b << 8 | c << 16));
    }
}

/// Ground whose triangles come square by square.
fn ground(triangles: usize) -> Mesh {
    let mut mesh = scene::hills(triangles);
    let side = ((mesh.triangle_count() / 2) as f64).sqrt() as u32;
    let mut quads: Vec<(u32, [u32; 6])> = (0..)
        .zip(mesh.indices.chunks_exact(6))
        .map(|(number, quad)| {
            let (i, j) = (number % side / QUADS, number / side / QUADS);
            (j * side + i, quad.try_into().expect("six corners"))
        })
        .collect();
    quads.sort_by_key(|quad| quad.0);
    mesh.indices = quads.into_iter().flat_map(|quad| quad.1).collect();
    mesh
}

/// The scene of both rows.
struct ClusterScene {
    meshes: [Mesh; 2],
    places: Vec<Affine3A>,
}

impl ClusterScene {
    fn new(scale: &Scale) -> ClusterScene {
        let placements = scene::placements(scale.instances, 1);
        let mut places = vec![Affine3A::IDENTITY];
        places.extend(placements.iter().map(|it| it.transform));
        ClusterScene {
            meshes: [ground(scale.triangles), scene::ball(4).welded()],
            places,
        }
    }

    /// First place and count of places, for each mesh.
    fn instances(&self) -> [(u32, u32); 2] {
        [(0, 1), (1, self.places.len() as u32 - 1)]
    }

    /// A turn of what is recorded into a pass with depth, and its check.
    fn prepared(
        self,
        gpu: &Gpu,
        scale: &Scale,
        mut painting: Painting<'_>,
        record: impl Fn(vk::CommandBuffer),
    ) -> Prepared {
        let color = canvas(gpu, scale, RGBA);
        let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
        painting.depth = depth.format;
        painting.depth_stencil = nearer();
        painting.rasterization = painting
            .rasterization
            .cull_mode(vk::CullModeFlags::BACK)
            .front_face(vk::FrontFace::COUNTER_CLOCKWISE);
        let pipeline = gpu.painting(&painting);
        let pass = Pass {
            colors: &[color],
            clears: &[[0.0; 4]],
            depth: Some(depth),
            clear_depth: Some((1.0, 0)),
            ..Pass::default()
        };
        let turn = turn(gpu, &pass, |commands| {
            gpu.bind(commands, pipeline);
            record(commands);
        });
        let balls = self.meshes[1].triangle_count() * (self.places.len() - 1);
        let work = self.meshes[0].triangle_count() + balls;
        let view = View::of(scale);
        drawn(gpu, turn, &[color], work as f64, move |gpu| {
            let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
            view.check(&self.meshes, &self.places, |x, y| {
                View::distance(depths[(y * depth.width + x) as usize])
            })
        })
    }
}

pub fn by_mesh_shaders(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let features = &gpu.optional.mesh_shader;
    if !draws(gpu) || features.mesh_shader == vk::FALSE || features.task_shader == vk::FALSE {
        return None;
    }
    let meshes = ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
    let scene = ClusterScene::new(scale);
    let mut clusters = Clusters::default();
    let ranges = scene.meshes.each_ref().map(|mesh| {
        let first = clusters.clusters.len() as u32;
        clusters.add(mesh);
        (first, clusters.clusters.len() as u32 - first)
    });
    let [eye, ..] = camera(scale).map(Vec3::from);
    let instance = |place: &Affine3A| {
        let largest = [place.x_axis, place.y_axis, place.z_axis].map(|axis| axis.length());
        let eye = place.inverse().transform_point3(eye);
        Instance {
            rows: rows(place),
            eye: eye
                .extend(largest.into_iter().fold(0.0, f32::max))
                .to_array(),
        }
    };
    let instances: Vec<Instance> = scene.places.iter().map(instance).collect();
    let set = gpu.set_of(&[
        Bound::Storage(gpu.buffer_with(&clusters.clusters)),
        Bound::Storage(gpu.buffer_with(&instances)),
        Bound::Storage(gpu.buffer_with(&clusters.corners)),
        Bound::Storage(gpu.buffer_with(&clusters.normals)),
        Bound::Storage(gpu.buffer_with(&clusters.numbers)),
        Bound::Storage(gpu.buffer_with(&clusters.triangles)),
    ]);
    let (task, mesh) = (format!("{SHARED}{TASK}"), format!("{SHARED}{COLORS}{MESH}"));
    let mut painting = Painting::new(gpu, "", FRAGMENT, RGBA);
    painting.mesh = Some((Some(&task), &mesh));
    painting.layout = gpu.layout(&[set.layout]);
    let layout = painting.layout;
    let camera = projection(scale).to_cols_array();
    let draws = scene.instances();
    let record = |commands| {
        gpu.bind_set(commands, layout, set.handle);
        for ((first, count), (instance, instances)) in ranges.into_iter().zip(draws) {
            let push = Push {
                camera,
                first,
                count,
                instance,
            };
            gpu.push(commands, layout, &push);
            // SAFETY: the command buffer is being recorded.
            unsafe {
                meshes.cmd_draw_mesh_tasks(commands, count.div_ceil(TASKS), instances, 1);
            }
        }
    };
    Some(scene.prepared(gpu, scale, painting, record))
}

pub fn by_vertex_shaders(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let scene = ClusterScene::new(scale);
    let vertex = format!("{COLORS}{VERTEX}");
    let mut painting = Painting::new(gpu, &vertex, FRAGMENT, RGBA);
    let rates = [
        (12, vk::VertexInputRate::VERTEX),
        (12, vk::VertexInputRate::VERTEX),
        (48, vk::VertexInputRate::INSTANCE),
    ];
    painting.bindings = (0..)
        .zip(rates)
        .map(
            |(binding, (stride, input_rate))| vk::VertexInputBindingDescription {
                binding,
                stride,
                input_rate,
            },
        )
        .collect();
    let (three, four) = (
        vk::Format::R32G32B32_SFLOAT,
        vk::Format::R32G32B32A32_SFLOAT,
    );
    let attributes = [
        (0, three, 0),
        (1, three, 0),
        (2, four, 0),
        (2, four, 16),
        (2, four, 32),
    ];
    painting.attributes = (0..)
        .zip(attributes)
        .map(
            |(location, (binding, format, offset))| vk::VertexInputAttributeDescription {
                location,
                binding,
                format,
                offset,
            },
        )
        .collect();
    let transforms: Vec<[f32; 12]> = scene.places.iter().map(rows).collect();
    let transforms = gpu.buffer_with(&transforms);
    let buffers = scene.meshes.each_ref().map(|mesh| {
        let corners = gpu.buffer_with(&mesh.corners);
        let normals = gpu.buffer_with(&normals(mesh));
        let indices = gpu.buffer_with(&mesh.indices);
        (
            [corners, normals, transforms].map(|it| it.handle),
            indices,
            mesh.indices.len() as u32,
        )
    });
    let layout = painting.layout;
    let camera = projection(scale).to_cols_array();
    let instances = scene.instances();
    let record = |commands| {
        gpu.push(commands, layout, &camera);
        for ((vertices, indices, count), (first, instances)) in buffers.iter().zip(instances) {
            gpu.bind_indices(commands, indices, vk::IndexType::UINT32);
            // SAFETY: the command buffer is being recorded.
            unsafe {
                (gpu.device).cmd_bind_vertex_buffers(commands, 0, vertices, &[0; 3]);
                (gpu.device).cmd_draw_indexed(commands, *count, instances, 0, 0, first);
            }
        }
    };
    Some(scene.prepared(gpu, scale, painting, record))
}
