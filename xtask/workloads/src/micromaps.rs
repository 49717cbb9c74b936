//! The leaves of `foliage`, with their outline in an opacity micromap: the any-hit shader is asked
//! about the parts of a triangle that the outline crosses, and about no others.

use anyhow::ensure;
use tuff_tests::{
    AccelerationStructureTrianglesOpacityMicromapKHR, Gpu, MicroTriangle, Micromap, MicromapForm,
    Structure, geometry_of, part_centre, triangles_at, vk,
};

use crate::scene::Mesh;
use crate::workload::{self, Prepared, launch};
use crate::world::{Scale, World};

/// The subdivision level: 1,024 parts of a triangle.
const LEVEL: u16 = 5;

/// `VK_OPACITY_MICROMAP_FORMAT_4_STATE_EXT` and three of its states.
const FOUR_STATES: u16 = 2;
const TRANSPARENT: u8 = 0;
const OPAQUE: u8 = 1;
const UNKNOWN_OPAQUE: u8 = 3;

/// Micromaps of `VK_EXT_opacity_micromap`.
pub fn ext(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    (gpu.optional.micromap.micromap != 0).then(|| leaves(gpu, scale, MicromapForm::Ext))?
}

/// Micromaps of `VK_KHR_opacity_micromap`.
pub fn khr(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    (gpu.optional.micromap_khr.micromap != 0).then(|| leaves(gpu, scale, MicromapForm::Khr))?
}

fn leaves(gpu: &Gpu, scale: &Scale, form: MicromapForm) -> Option<Prepared> {
    let outline = MicroTriangle::of(LEVEL, FOUR_STATES, state);
    let micromap = gpu.micromap_in(form, &[outline]);
    let world = World::foliage_of(gpu, scale, |leaves| bottom(gpu, leaves, &micromap));
    let parts = workload::foliage_parts(scale);
    let flags = vk::PipelineCreateFlags::RAY_TRACING_OPACITY_MICROMAP_EXT;
    let rays = workload::pipeline_with(gpu, &parts, &world.bindings(), flags);
    let turn = launch(gpu, scale, &rays, 1);
    let plain = workload::foliage(gpu, scale)?;
    let picture = world.out;
    Some(Prepared {
        // The outline is the same, so the picture is, too.
        check: Some(Box::new(move |gpu| {
            plain.run(gpu)?;
            let [with, without] = [picture, plain.picture].map(|it| it.read::<u32>());
            let differ = with.iter().zip(&without).filter(|(a, b)| a != b).count();
            ensure!(
                differ == 0,
                "{differ} words of the picture differ without micromaps"
            );
            Ok(())
        })),
        ..Prepared::picture(turn, &world)
    })
}

/// The state of a part: `foliage_any_hit.glsl` cuts away what lies outside a disc about the
/// triangle's middle, in barycentric coordinates.
fn state(part: u32) -> u8 {
    // The square of the shader's radius is 0.05. A part's corners lie within √5 / 3 of its middle,
    // for legs of length 1. The margin covers rounding.
    let radius = 0.05_f32.sqrt();
    let margin = 0.746 / f32::from(1u16 << LEVEL) + 1e-4;
    let [u, v] = part_centre(LEVEL, part).map(|it| it - 1.0 / 3.0);
    let distance = libm::hypotf(u, v);
    if distance < radius - margin {
        OPAQUE
    } else if distance > radius + margin {
        TRANSPARENT
    } else {
        UNKNOWN_OPAQUE
    }
}

/// The leaves' structure: each triangle has the micromap's only triangle.
fn bottom(gpu: &Gpu, leaves: &Mesh, micromap: &Micromap) -> Structure {
    let count = (leaves.indices.len() / 3) as u32;
    let usages = [vk::MicromapUsageEXT {
        count,
        subdivision_level: LEVEL.into(),
        format: FOUR_STATES.into(),
    }];
    let indices = gpu.buffer_with(&vec![0u32; count as usize]);
    let mut ext = vk::AccelerationStructureTrianglesOpacityMicromapEXT::default()
        .index_type(vk::IndexType::UINT32)
        .index_stride(4)
        .micromap(micromap.handle)
        .usage_counts(&usages);
    ext.index_buffer.device_address = indices.address;
    let khr = AccelerationStructureTrianglesOpacityMicromapKHR {
        index_type: vk::IndexType::UINT32,
        index_buffer: indices.address,
        index_stride: 4,
        micromap: micromap.structure,
        ..Default::default()
    };
    let corners = gpu.buffer_with(&leaves.corners);
    let mut data = triangles_at(corners.at(), leaves.corners.len() as u32)
        .index_type(vk::IndexType::UINT32)
        .index_data(gpu.buffer_with(&leaves.indices).at());
    data.p_next = match micromap.form {
        MicromapForm::Ext => (&raw const ext).cast(),
        MicromapForm::Khr => (&raw const khr).cast(),
    };
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    gpu.build(
        vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        &[geometry_of(data)],
        &[range],
        vk::BuildAccelerationStructureFlagsKHR::empty(),
    )
}
