//! `VK_EXT_opacity_micromap` and `VK_KHR_opacity_micromap`, against the specification's tables.

mod copies;
mod queries;
mod serialized;

use tuff_tests::*;
use vk::AccelerationStructureTypeKHR as Level;
use vk::BuildAccelerationStructureFlagsKHR as Flags;
use vk::GeometryInstanceFlagsKHR as InstanceFlags;

const TWO_STATES: u16 = 1;
const FOUR_STATES: u16 = 2;

/// The outcome of a ray.
const MISSED: u32 = 0;
const ASKED: u32 = 1;
const HIT: u32 = 2;

fn gpu_with_micromaps() -> Option<Gpu> {
    // The layer of 1.3.239 does not know micromaps in shaders and structures.
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 290));
    gpu.with("VK_EXT_opacity_micromap", |gpu| {
        gpu.optional.micromap.micromap != 0
    })
}

/// A test on each form of micromaps that the device has.
fn in_each_form(test: impl Fn(&Gpu, MicromapForm)) {
    if let Some(gpu) = gpu_with_micromaps() {
        test(&gpu, MicromapForm::Ext);
        if has_khr(&gpu) {
            test(&gpu, MicromapForm::Khr);
        }
    }
}

fn gpu_with_khr() -> Option<Gpu> {
    gpu_with_micromaps()?.with("VK_KHR_opacity_micromap", has_khr)
}

fn has_khr(gpu: &Gpu) -> bool {
    gpu.optional.micromap_khr.micromap != 0
}

/// Where a geometry's triangles find their opacity.
struct Use<'a> {
    form: MicromapForm,
    micromap: Option<&'a Micromap>,
    /// Type, words in it, bytes from one to the next.
    indices: Option<(vk::IndexType, Buffer, u64)>,
    base: u32,
}

impl Use<'_> {
    /// Triangle i of the geometry is triangle i of the micromap.
    fn of(micromap: &Micromap) -> Use<'_> {
        Use {
            form: micromap.form,
            micromap: Some(micromap),
            indices: None,
            base: 0,
        }
    }
}

/// Triangles of unit legs, side by side, two apart.
fn corners(count: u32) -> Vec<[f32; 3]> {
    (0..count)
        .flat_map(|i| {
            let x = 2.0 * i as f32;
            [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]
        })
        .collect()
}

/// Describes triangles with a micromap and hands the description on.
fn describe<T>(
    gpu: &Gpu,
    count: u32,
    usage: &Use<'_>,
    then: impl FnOnce(
        &vk::AccelerationStructureGeometryKHR,
        vk::AccelerationStructureBuildRangeInfoKHR,
    ) -> T,
) -> T {
    let mut chained = vk::AccelerationStructureTrianglesOpacityMicromapEXT::default()
        .index_type(vk::IndexType::NONE_KHR)
        .base_triangle(usage.base);
    if let Some(micromap) = usage.micromap {
        chained = chained
            .micromap(micromap.handle)
            .usage_counts(&micromap.usages);
    }
    if let Some((ty, buffer, stride)) = usage.indices {
        chained = chained.index_type(ty).index_stride(stride);
        chained.index_buffer.device_address = buffer.address;
    }
    let structure = usage
        .micromap
        .map_or_else(Default::default, |it| it.structure);
    let khr = AccelerationStructureTrianglesOpacityMicromapKHR {
        index_type: chained.index_type,
        // SAFETY: the description has an address of the device.
        index_buffer: unsafe { chained.index_buffer.device_address },
        index_stride: chained.index_stride,
        base_triangle: usage.base,
        micromap: structure,
        ..Default::default()
    };
    let mut data = triangles_at(gpu.buffer_with(&corners(count)).at(), 3 * count);
    data.p_next = match usage.form {
        MicromapForm::Ext => (&raw const chained).cast(),
        MicromapForm::Khr => (&raw const khr).cast(),
    };
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    then(&geometry_of(data), range)
}

fn bottom(gpu: &Gpu, count: u32, usage: &Use<'_>, flags: Flags) -> Structure {
    describe(gpu, count, usage, |geometry, range| {
        gpu.build(Level::BOTTOM_LEVEL, &[*geometry], &[range], flags)
    })
}

/// Shoots a ray at each point of the plane of the triangles.
fn shoot(gpu: &Gpu, world: Structure, points: &[[f32; 2]], ray_flags: u32) -> Vec<u32> {
    let raygen = format!(
        r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer P {{ vec2 points[]; }};
    layout(set = 0, binding = 2, std430) buffer R {{ uint results[]; }};
    layout(location = 0) rayPayloadEXT uint found;
    void main() {{
        uint i = gl_LaunchIDEXT.x;
        found = 9;
        traceRayEXT(world, {ray_flags}u{two_states}, 0xff, 0, 0, 0, vec3(points[i], 1), 0.0, vec3(0, 0, -1), 2.0, 0);
        results[i] = found;
    }}",
        ray_flags = ray_flags & 0x3ff,
        two_states = match ray_flags & 0x400 {
            0 => "",
            _ => " | gl_RayFlagsForceOpacityMicromap2StateEXT",
        },
    );
    let of = |body: &str| {
        format!("layout(location = 0) rayPayloadInEXT uint found; void main() {{ {body} }}")
    };
    let (miss, hit) = (of("found = 0;"), of("if (found != 1) found = 2;"));
    let any_hit = of("found = 1; terminateRayEXT;");
    let (input, output) = (gpu.buffer_with(points), gpu.buffer(4 * points.len() as u64));
    let flags = vk::PipelineCreateFlags::RAY_TRACING_OPACITY_MICROMAP_EXT;
    let case = Case::new(&raygen)
        .miss(&miss)
        .hit(&hit)
        .any_hit(&any_hit)
        .bind(world)
        .bind(input)
        .bind(output);
    case.flags(flags).trace(gpu, [points.len() as u32, 1, 1]);
    output.read()
}

/// The outcome of a four-state value by the specification's tables.
fn outcome(state: u8) -> u32 {
    [MISSED, HIT, ASKED, ASKED][usize::from(state)]
}

#[test]
fn every_part_has_its_state() {
    in_each_form(|gpu, form| {
        let mut random = Rng::with_seed(7);
        let mut triangles = Vec::new();
        for (level, format) in [(0, 1), (0, 2), (1, 1), (2, 2), (4, 1), (5, 2)] {
            let parts = 1usize << (2 * level);
            let states = (0..parts).map(|_| random.u32(..1 << format) as u8);
            triangles.push(MicroTriangle {
                level,
                format,
                states: states.collect(),
            });
        }
        let micromap = gpu.micromap_in(form, &triangles);
        let count = triangles.len() as u32;
        let bottom = bottom(gpu, count, &Use::of(&micromap), Flags::empty());
        let world = gpu.top(&[Instance::of(bottom)]);
        let (mut points, mut expected) = (Vec::new(), Vec::new());
        for (i, triangle) in triangles.iter().enumerate() {
            for (point, &state) in part_centres(triangle.level).iter().zip(&triangle.states) {
                points.push([2.0 * i as f32 + point[0], point[1]]);
                expected.push(outcome(state));
            }
        }
        assert_eq!(shoot(gpu, world, &points, 0), expected);
    });
}

#[test]
fn flags_change_what_states_mean() {
    in_each_form(|gpu, form| {
        let micromap = gpu.micromap_in(
            form,
            &[MicroTriangle::of(1, FOUR_STATES, |part| part as u8)],
        );
        let flags = Flags::ALLOW_DISABLE_OPACITY_MICROMAPS_EXT;
        let bottom = bottom(gpu, 1, &Use::of(&micromap), flags);
        let points = part_centres(1);
        const OPAQUE: u32 = 1;
        const NO_OPAQUE: u32 = 2;
        const CULL_OPAQUE: u32 = 0x40;
        const CULL_NO_OPAQUE: u32 = 0x80;
        const TWO: u32 = 0x400;
        let two = InstanceFlags::FORCE_OPACITY_MICROMAP_2_STATE_EXT;
        let off = InstanceFlags::DISABLE_OPACITY_MICROMAPS_EXT;
        let none = InstanceFlags::empty();
        for (instance, ray, expected) in [
            (none, 0, [MISSED, HIT, ASKED, ASKED]),
            (none, OPAQUE, [MISSED, HIT, HIT, HIT]),
            (none, NO_OPAQUE, [MISSED, ASKED, ASKED, ASKED]),
            (none, CULL_OPAQUE, [MISSED, MISSED, ASKED, ASKED]),
            (none, CULL_NO_OPAQUE, [MISSED, HIT, MISSED, MISSED]),
            (none, TWO, [MISSED, HIT, MISSED, HIT]),
            (none, TWO | NO_OPAQUE, [MISSED, ASKED, MISSED, ASKED]),
            (two, 0, [MISSED, HIT, MISSED, HIT]),
            (two, CULL_OPAQUE, [MISSED; 4]),
            (InstanceFlags::FORCE_OPAQUE, 0, [MISSED, HIT, HIT, HIT]),
            (InstanceFlags::FORCE_OPAQUE, CULL_OPAQUE, [MISSED; 4]),
            (
                InstanceFlags::FORCE_NO_OPAQUE,
                0,
                [MISSED, ASKED, ASKED, ASKED],
            ),
            (
                two | InstanceFlags::FORCE_NO_OPAQUE,
                0,
                [MISSED, ASKED, MISSED, ASKED],
            ),
            // The geometry's own flag counts again: it is not opaque.
            (off, 0, [ASKED; 4]),
            (off, OPAQUE, [HIT; 4]),
            (off | two, 0, [ASKED; 4]),
        ] {
            let world = gpu.top(&[Instance {
                flags: instance,
                ..Instance::of(bottom)
            }]);
            assert_eq!(
                shoot(gpu, world, &points, ray),
                expected,
                "{instance:?}, ray {ray:#x}"
            );
        }
    });
}

#[test]
fn indices_choose_triangles_or_states() {
    in_each_form(|gpu, form| {
        // One state each, so that the centre tells which triangle it was.
        let of = |state: u8| MicroTriangle::of(0, FOUR_STATES, |_| state);
        let mut micromap = gpu.micromap_in(form, &[of(2), of(0), of(1)]);
        let words: [i32; 6] = [0, 1, -1, -2, -3, -4];
        let expected = [MISSED, HIT, MISSED, HIT, ASKED, ASKED];
        // Two triangles of the geometry refer to the micromap; special ones do not count.
        micromap.usages = vec![vk::MicromapUsageEXT {
            count: 2,
            subdivision_level: 0,
            format: FOUR_STATES.into(),
        }];
        let bytes: Vec<u8> = words
            .iter()
            .flat_map(|w| (*w as u16).to_le_bytes())
            .collect();
        let wide: Vec<i32> = words.iter().flat_map(|&w| [w, 77, 77]).collect();
        for indices in [
            (vk::IndexType::UINT16, gpu.buffer_with(&bytes), 2),
            (vk::IndexType::UINT32, gpu.buffer_with(&wide), 12),
        ] {
            let usage = Use {
                indices: Some(indices),
                base: 1,
                ..Use::of(&micromap)
            };
            let bottom = bottom(gpu, 6, &usage, Flags::empty());
            let world = gpu.top(&[Instance::of(bottom)]);
            let points: Vec<_> = (0..6).map(|i| [2.0 * i as f32 + 0.3, 0.3]).collect();
            assert_eq!(shoot(gpu, world, &points, 0), expected);
        }
        // Without a micromap, special indices are all there is.
        let usage = Use {
            form,
            micromap: None,
            indices: Some((vk::IndexType::UINT32, gpu.buffer_with(&words[2..]), 4)),
            base: 0,
        };
        let bottom = bottom(gpu, 4, &usage, Flags::empty());
        let world = gpu.top(&[Instance::of(bottom)]);
        let points: Vec<_> = (0..4).map(|i| [2.0 * i as f32 + 0.3, 0.3]).collect();
        assert_eq!(shoot(gpu, world, &points, 0), expected[2..]);
    });
}

/// Its states are so many that only some are written.
fn check_level(gpu: &Gpu, form: MicromapForm, level: u16, format: u16) {
    let bits = u32::from(format);
    let bytes = (1u64 << (2 * level)) * u64::from(bits) / 8;
    let data = gpu.untouched_buffer(bytes).expect("memory");
    let state = |part: u32| part.wrapping_mul(0x9e37_79b9) >> (32 - bits);
    // Each in a byte of its own.
    let last = (1u32 << (2 * level)) - 1;
    let parts = (0..512).map(|i| (last / 511).max(8) * i + i % 8);
    let parts: Vec<u32> = parts.filter(|&part| part <= last).collect();
    for &part in &parts {
        let place = part * bits;
        data.write((place / 8) as usize, &[(state(part) << (place % 8)) as u8]);
    }
    let usages = vec![vk::MicromapUsageEXT {
        count: 1,
        subdivision_level: level.into(),
        format: format.into(),
    }];
    let inputs = MicromapParts {
        data,
        triangles: gpu.buffer_with(&[0, u32::from(level) | bits << 16]),
        usages,
    };
    let micromap = gpu.micromap_of(form, inputs);
    let bottom = bottom(gpu, 1, &Use::of(&micromap), Flags::empty());
    let world = gpu.top(&[Instance::of(bottom)]);
    let points: Vec<_> = parts.iter().map(|&part| part_centre(level, part)).collect();
    let expected: Vec<u32> = parts.iter().map(|&it| outcome(state(it) as u8)).collect();
    assert_eq!(shoot(gpu, world, &points, 0), expected, "{form:?} {format}");
}

#[test]
fn the_finest_level_there_is() {
    // One device after the other: a map may be as large as 256 MiB.
    for (form, format) in [
        (MicromapForm::Ext, FOUR_STATES),
        (MicromapForm::Khr, TWO_STATES),
    ] {
        let Some(gpu) = gpu_with_micromaps() else {
            return;
        };
        if form == MicromapForm::Khr && !has_khr(&gpu) {
            return;
        }
        let mut limits = vk::PhysicalDeviceOpacityMicromapPropertiesEXT::default();
        let mut khr = PhysicalDeviceOpacityMicromapPropertiesKHR::default();
        limits.p_next = match has_khr(&gpu) {
            true => (&raw mut khr).cast(),
            false => std::ptr::null_mut(),
        };
        let mut properties = vk::PhysicalDeviceProperties2::default();
        properties.p_next = (&raw mut limits).cast();
        // SAFETY: the chain outlives the call.
        unsafe {
            gpu.instance
                .get_physical_device_properties2(gpu.physical, &mut properties);
        }
        let levels = match form {
            MicromapForm::Ext => [
                limits.max_opacity2_state_subdivision_level,
                limits.max_opacity4_state_subdivision_level,
            ],
            MicromapForm::Khr => [
                khr.max_opacity2_state_subdivision_level,
                khr.max_opacity4_state_subdivision_level,
            ],
        };
        // The specification's least limits.
        assert!(levels.iter().all(|&level| level >= 3));
        if form == MicromapForm::Khr {
            assert!(khr.max_opacity_lossy4_state_subdivision_level >= 3);
            assert!(khr.max_micromap_triangles >= 1 << 27);
        }
        let level = levels[usize::from(format) - 1];
        check_level(&gpu, form, level as u16, format);
    }
}

#[test]
fn an_update_brings_another_micromap() {
    in_each_form(|gpu, form| {
        let first = gpu.micromap_in(
            form,
            &[MicroTriangle::of(1, TWO_STATES, |part| part as u8 & 1)],
        );
        let second = gpu.micromap_in(
            form,
            &[MicroTriangle::of(2, FOUR_STATES, |part| part as u8 & 3)],
        );
        let flags = Flags::ALLOW_UPDATE | Flags::ALLOW_OPACITY_MICROMAP_UPDATE_EXT;
        let bottom = bottom(gpu, 1, &Use::of(&first), flags);
        let world = gpu.top(&[Instance::of(bottom)]);
        assert_eq!(
            shoot(gpu, world, &part_centres(1), 0),
            [MISSED, HIT, MISSED, HIT]
        );
        describe(gpu, 1, &Use::of(&second), |geometry, range| {
            let geometries = [*geometry];
            let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
                .ty(Level::BOTTOM_LEVEL)
                .flags(flags)
                .mode(vk::BuildAccelerationStructureModeKHR::UPDATE)
                .src_acceleration_structure(bottom.handle)
                .dst_acceleration_structure(bottom.handle)
                .geometries(&geometries);
            info.scratch_data.device_address = gpu.buffer(1 << 16).address.next_multiple_of(256);
            gpu.run(|commands| {
                // SAFETY: every buffer that the info refers to lives as long as the device.
                unsafe {
                    gpu.acceleration.cmd_build_acceleration_structures(
                        commands,
                        &[info],
                        &[&[range]],
                    );
                }
            });
        });
        let expected: Vec<u32> = (0..16).map(|part| outcome(part & 3)).collect();
        assert_eq!(shoot(gpu, world, &part_centres(2), 0), expected);
    });
}
