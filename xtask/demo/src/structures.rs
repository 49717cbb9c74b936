//! The scene's acceleration structures.

use anyhow::Result;
use ash::vk;
use vk::{
    AccelerationStructureGeometryAabbsDataKHR as AabbsData,
    AccelerationStructureGeometryDataKHR as GeometryData,
    AccelerationStructureGeometryTrianglesDataKHR as TrianglesData,
    AccelerationStructureInstanceKHR as TlasInstance, BufferUsageFlags as Usage,
    DeviceOrHostAddressConstKHR as Address,
};

use crate::scene::{Model, Scene, Shape, Vertex, kind};
use crate::vulkan::{AccelerationStructure, BlasInput, Buffer, Context, build_blas, build_tlas};

/// `MASK_BLOCKS_LIGHT | 2` and `2` in scene.glsl.
const MASK_SOLID: u8 = 3;
const MASK_LETS_LIGHT_THROUGH: u8 = 2;

/// Every mesh and procedural gets a bottom level; the top level, over the instances, comes last.
pub fn build_structures<'a>(
    context: &'a Context,
    scene: &Scene,
    vertices: &Buffer,
    indices: &Buffer,
) -> Result<Vec<AccelerationStructure<'a>>> {
    let boxes: Vec<[f32; 6]> = scene
        .procedurals
        .iter()
        .map(|procedural| {
            let low = procedural.centre - procedural.radius;
            let high = procedural.centre + procedural.radius;
            [low.x, low.y, low.z, high.x, high.y, high.z]
        })
        .collect();
    let usage = Usage::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
    let boxes_buffer = Buffer::with(context, &boxes, usage)?;
    let (vertices, indices) = (vertices.address(), indices.address());
    let boxes = boxes_buffer.address();

    let triangles = |mesh| mesh_input(scene, mesh, vertices, indices);
    let procedural = |(i, procedural): (usize, &crate::scene::Procedural)| {
        let material = &scene.materials[procedural.material as usize];
        let data = AabbsData::default()
            .data(Address {
                device_address: boxes,
            })
            .stride(size_of::<[f32; 6]>() as u64);
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::AABBS)
            .geometry(GeometryData { aabbs: data })
            .flags(opaque_unless(material.kind == kind::GLASS));
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
            .primitive_count(1)
            .primitive_offset((i * size_of::<[f32; 6]>()) as u32);
        BlasInput {
            geometries: vec![geometry],
            ranges: vec![range],
        }
    };
    let inputs: Vec<BlasInput> = scene
        .meshes
        .iter()
        .map(triangles)
        .chain(scene.procedurals.iter().enumerate().map(procedural))
        .collect();
    let mut structures = build_blas(context, &inputs)?;
    let instances: Vec<TlasInstance> = scene
        .instances
        .iter()
        .map(|instance| tlas_instance(scene, &structures, instance))
        .collect();
    structures.push(build_tlas(context, &instances)?);
    Ok(structures)
}

/// The geometries of a mesh. `vertices` and `indices` are the addresses of all meshes' data.
fn mesh_input<'g>(
    scene: &Scene,
    mesh: &crate::scene::Mesh,
    vertices: u64,
    indices: u64,
) -> BlasInput<'g> {
    let own = &scene.geometries[mesh.first_geometry as usize..][..mesh.geometry_count as usize];
    let geometries = own.iter().map(|geometry| {
        let material = &scene.materials[geometry.material as usize];
        let tested = material.alpha_cutoff > 0.0 || material.kind == kind::GLASS;
        let data = TrianglesData::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(Address {
                device_address: vertices,
            })
            .vertex_stride(size_of::<Vertex>() as u64)
            // The range's first vertex is added to each index: the greatest sum counts.
            .max_vertex(geometry.first_vertex + geometry.vertex_count - 1)
            .index_type(vk::IndexType::UINT32)
            .index_data(Address {
                device_address: indices,
            });
        vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
            .geometry(GeometryData { triangles: data })
            .flags(opaque_unless(tested))
    });
    let ranges = own.iter().map(|geometry| {
        vk::AccelerationStructureBuildRangeInfoKHR::default()
            .primitive_count(geometry.index_count / 3)
            .primitive_offset(geometry.first_index * 4)
            .first_vertex(geometry.first_vertex)
    });
    BlasInput {
        geometries: geometries.collect(),
        ranges: ranges.collect(),
    }
}

fn opaque_unless(tested: bool) -> vk::GeometryFlagsKHR {
    match tested {
        true => vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION,
        false => vk::GeometryFlagsKHR::OPAQUE,
    }
}

fn tlas_instance(
    scene: &Scene,
    bottom: &[AccelerationStructure],
    instance: &crate::scene::Instance,
) -> TlasInstance {
    let (structure, custom_index, mask) = match instance.model {
        Model::Mesh(mesh) => {
            let first_geometry = scene.meshes[mesh as usize].first_geometry;
            let material = scene.geometries[first_geometry as usize].material;
            let mask = match scene.materials[material as usize].kind {
                kind::WATER => MASK_LETS_LIGHT_THROUGH,
                _ => MASK_SOLID,
            };
            (mesh as usize, first_geometry, mask)
        }
        Model::Procedural(number) => (scene.meshes.len() + number as usize, number, MASK_SOLID),
    };
    let hit_group = hit_group(scene, instance);
    let matrix = rows(instance);
    TlasInstance {
        transform: vk::TransformMatrixKHR {
            matrix: bytemuck::cast(matrix),
        },
        instance_custom_index_and_mask: vk::Packed24_8::new(custom_index, mask),
        instance_shader_binding_table_record_offset_and_flags: vk::Packed24_8::new(hit_group, 0),
        acceleration_structure_reference: vk::AccelerationStructureReferenceKHR {
            device_handle: bottom[structure].address(),
        },
    }
}

/// Which hit group an instance has.
pub fn hit_group(scene: &Scene, instance: &crate::scene::Instance) -> u32 {
    match instance.model {
        Model::Mesh(_) => 0,
        Model::Procedural(number) => match scene.procedurals[number as usize].shape {
            Shape::Sphere => 1,
            Shape::Sponge => 2,
        },
    }
}

/// An instance's transform as Vulkan has it.
pub fn rows(instance: &crate::scene::Instance) -> [[f32; 4]; 3] {
    let m = instance.transform.matrix3;
    let t = instance.transform.translation;
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], t[i]])
}
