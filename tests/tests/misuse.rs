//! Broken rules that only execution can see: with the driver's validation each is reported by its
//! name, without it nothing of it brings the process down, and the device goes on working.

use tuff_tests::*;
use vk::PipelineCreateFlags as Flags;
use vk::StridedDeviceAddressRegionKHR as Region;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

const RAYGEN: &str =
    "traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);";

/// A trace that is right as it stands; each test spoils a part.
struct Setup<'a> {
    /// The ray generation shader's use of `payload`, `world`, `words` and `numbers`.
    raygen: &'a str,
    hit: &'a str,
    callable: Option<&'a str>,
    intersection: Option<&'a str>,
    flags: Flags,
    boxes: bool,
    /// Numbers in a buffer, so that no compiler knows them.
    numbers: [f32; 8],
}

const RIGHT: Setup = Setup {
    raygen: RAYGEN,
    hit: "payload = 2u;",
    callable: None,
    intersection: None,
    flags: Flags::empty(),
    boxes: false,
    numbers: [0.0; 8],
};

/// The inputs of a trace.
struct Trace<'a> {
    gpu: &'a Gpu,
    rays: Rays,
    regions: [Region; 4],
    results: Buffer,
    world: Structure,
}

fn shader(body: &str, storage: &str) -> String {
    format!(
        r"#extension GL_EXT_buffer_reference : enable
        #extension GL_EXT_buffer_reference_uvec2 : enable
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1, std430) buffer W {{ uint words[]; }};
        layout(set = 0, binding = 2, std430) buffer N {{ float numbers[]; }};
        layout(buffer_reference, std430) buffer Place {{ uint word; }};
        layout(location = 0) {storage} uint payload;
        {body}"
    )
}

impl<'a> Trace<'a> {
    /// The trace of this ray generation shader.
    fn by(gpu: &'a Gpu, raygen: &str) -> Self {
        Self::new(gpu, &Setup { raygen, ..RIGHT })
    }

    fn new(gpu: &'a Gpu, parts: &Setup<'_>) -> Self {
        let geometry = match parts.boxes {
            true => Geometry::boxes(
                &[[-1.0, -1.0, -1.0, 1.0, 1.0, 0.0]],
                vk::GeometryFlagsKHR::empty(),
            ),
            false => Geometry::triangles(&TRIANGLE, vk::GeometryFlagsKHR::empty()),
        };
        let world = gpu.scene(&[geometry]);
        let results = gpu.buffer(64);
        let main = |body: &str| format!("void main() {{ {body} }}");
        let raygen = format!("payload = 9u; {} words[0] = payload;", parts.raygen);
        let data = "layout(location = 1) callableDataEXT uint data;";
        let raygen = shader(&format!("{data}\n{}", main(&raygen)), "rayPayloadEXT");
        let miss = shader(&main("payload = 1u;"), "rayPayloadInEXT");
        let hit = shader(&main(parts.hit), "rayPayloadInEXT");
        let mut case = Case::new(&raygen).miss(&miss).hit(&hit).flags(parts.flags);
        if let Some(intersection) = parts.intersection {
            case = case.intersection(intersection);
        }
        if let Some(callable) = parts.callable {
            case = case.callable(callable);
        }
        let numbers = gpu.buffer_with(&parts.numbers);
        let case = case.bind(world).bind(results).bind(numbers);
        let rays = gpu.rays(&case);
        let table = Table {
            miss: vec![Record::of(1); 4],
            hit: vec![Record::of(2); 4],
            ..case.table()
        };
        let regions = gpu.regions(&rays, &table);
        Self {
            gpu,
            rays,
            regions,
            results,
            world,
        }
    }

    /// Traces one ray, or 64, and returns the first word of the results.
    fn run(&self, width: u32) -> u32 {
        self.gpu.run(|commands| {
            let size = [width, 1, 1];
            self.gpu
                .record_trace(commands, &self.rays, &self.regions, size);
        });
        self.results.read::<u32>()[0]
    }

    /// A table of one record of these bytes.
    fn record(&self, handle: &[u8]) -> Region {
        let base = u64::from(self.gpu.pipeline_properties.shader_group_base_alignment);
        let buffer = self.gpu.buffer(2 * base);
        let start = buffer.address.next_multiple_of(base);
        buffer.write((start - buffer.address) as usize, handle);
        Region {
            device_address: start,
            stride: 32,
            size: 32,
        }
    }
}

/// Each check breaks one rule, whose name is on the left; what it asserts holds with validation and
/// without.
const CHECKS: &[(&str, Misuse)] = &[
    ("VUID-vkCmdTraceRaysKHR-None-03429", |gpu| {
        let mut trace = Trace::new(gpu, &RIGHT);
        trace.regions[2] = trace.record(&[0x5a; 32]);
        assert_eq!(trace.run(1), 9, "such a group is as good as none");
    }),
    ("VUID-vkCmdTraceRaysKHR-None-03429", |gpu| {
        let other = Trace::new(
            gpu,
            &Setup {
                hit: "payload = 77u;",
                ..RIGHT
            },
        );
        let mut trace = Trace::new(gpu, &RIGHT);
        trace.regions[2] = trace.record(&other.rays.handles[2]);
        assert_eq!(trace.run(1), 9);
    }),
    ("VUID-vkCmdTraceRaysKHR-flags-03511", |gpu| {
        let parts = Setup {
            raygen: "traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, 1), 9.0, 0);",
            flags: Flags::RAY_TRACING_NO_NULL_MISS_SHADERS_KHR,
            ..RIGHT
        };
        let mut trace = Trace::new(gpu, &parts);
        trace.regions[1] = trace.record(&[0; 32]);
        assert_eq!(trace.run(1), 9);
    }),
    ("VUID-vkCmdTraceRaysKHR-flags-03513", |gpu| {
        let parts = Setup {
            flags: Flags::RAY_TRACING_NO_NULL_CLOSEST_HIT_SHADERS_KHR,
            ..RIGHT
        };
        let mut trace = Trace::new(gpu, &parts);
        trace.regions[2] = trace.record(&[0; 32]);
        assert_eq!(trace.run(1), 9);
    }),
    (
        "VUID-vkCmdTraceRaysKHR-pMissShaderBindingTable-03685",
        |gpu| {
            let mut trace = Trace::new(gpu, &RIGHT);
            trace.regions[1].device_address += 16;
            trace.run(64);
        },
    ),
    ("VUID-vkCmdTraceRaysKHR-stride-03690", |gpu| {
        let mut trace = Trace::new(gpu, &RIGHT);
        trace.regions[2].stride = 33;
        trace.run(64);
    }),
    ("VUID-vkCmdTraceRaysKHR-stride-04041", |gpu| {
        let mut trace = Trace::new(gpu, &RIGHT);
        trace.regions[3] = Region {
            stride: 1 << 40,
            ..trace.regions[2]
        };
        trace.run(64);
    }),
    ("VUID-VkStridedDeviceAddressRegionKHR-size-04631", |gpu| {
        let mut trace = Trace::by(
            gpu,
            "traceRayEXT(world, 0u, 0xff, 12, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);",
        );
        trace.regions[2].size = 1 << 50;
        assert_eq!(trace.run(1), 9);
    }),
    ("VUID-VkStridedDeviceAddressRegionKHR-size-04631", |gpu| {
        for address in [64, 1 << 46, u64::MAX - 63, 0xdead_0000_0000_0000] {
            let mut trace = Trace::new(gpu, &RIGHT);
            for region in &mut trace.regions[1..] {
                region.device_address = address;
                (region.size, region.stride) = (1 << 20, 32);
            }
            assert_eq!(trace.run(1), 9);
            trace.regions[0].device_address = address;
            trace.run(1);
        }
    }),
    ("TUFF-record-index", |gpu| {
        let trace = Trace::by(
            gpu,
            "traceRayEXT(world, 0u, 0xff, 9, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);",
        );
        assert_eq!(trace.run(1), 9);
    }),
    (
        "VUID-vkCmdTraceRaysKHR-pHitShaderBindingTable-04736",
        |gpu| {
            let parts = Setup {
                boxes: true,
                ..RIGHT
            };
            assert_eq!(
                Trace::new(gpu, &parts).run(1),
                1,
                "boxes without a shader are missed"
            );
        },
    ),
    (
        "VUID-vkCmdTraceRaysKHR-maxPipelineRayRecursionDepth-03679",
        |gpu| {
            let parts = Setup {
                raygen: "payload = 0u; traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);",
                hit: "payload++; if (payload < 40u) traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);",
                ..RIGHT
            };
            assert_eq!(Trace::new(gpu, &parts).run(64), 40, "depth costs heap only");
        },
    ),
    (
        "VUID-vkCmdSetRayTracingPipelineStackSizeKHR-pipelineStackSize-03610",
        |gpu| {
            let call = "layout(location = 0) callableDataInEXT uint data;
            layout(location = 1) callableDataEXT uint deeper;
            void main() { deeper = data + 1u; if (deeper < 20u) executeCallableEXT(0, 1); data = deeper; }";
            let parts = Setup {
                raygen: "data = 0u; executeCallableEXT(0, 1); payload = data;",
                callable: Some(call),
                ..RIGHT
            };
            assert_eq!(Trace::new(gpu, &parts).run(64), 20);
        },
    ),
    ("VUID-vkCmdTraceRaysKHR-None-08114", |gpu| {
        let trace = Trace::new(gpu, &RIGHT);
        gpu.destroy(trace.world);
        trace.run(64);
    }),
    ("VUID-vkCmdTraceRaysKHR-None-08114", |gpu| {
        for address in ["uvec2(64, 0)", "uvec2(0x1230, 0x4567)", "uvec2(-1, -1)"] {
            let raygen = format!(
                "traceRayEXT(accelerationStructureEXT({address}), 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);"
            );
            let trace = Trace::by(gpu, &raygen);
            assert_eq!(trace.run(64), 1);
        }
    }),
    ("VUID-RuntimeSpirv-OpReportIntersectionKHR-06998", |gpu| {
        let parts = Setup {
            boxes: true,
            hit: "payload = gl_HitKindEXT;",
            intersection: Some("void main() { reportIntersectionEXT(1.0, 200u); }"),
            ..RIGHT
        };
        assert_eq!(Trace::new(gpu, &parts).run(1), 200);
    }),
    ("VUID-RuntimeSpirv-PhysicalStorageBuffer64-11819", |gpu| {
        for place in [
            "uvec2(0)",
            "uvec2(4, 0)",
            "uvec2(0x10, 0x3210)",
            "uvec2(-8, -1)",
        ] {
            let raygen = format!(
                "Place place = Place({place}); place.word = 5u; atomicAdd(place.word, 1u); payload = place.word + 30u;"
            );
            let trace = Trace::by(gpu, &raygen);
            assert_eq!(trace.run(64), 30, "{place}");
        }
    }),
    ("VUID-RuntimeSpirv-PhysicalStorageBuffer64-06315", |gpu| {
        // References are aligned to 16 unless they say otherwise.
        let buffer = gpu.buffer_with(&[0u32, 1, 2, 3]);
        let at = buffer.address + 8;
        let raygen = format!(
            "Place place = Place(uvec2({}u, {}u)); place.word += 10u; payload = place.word;",
            at as u32,
            at >> 32
        );
        let trace = Trace::by(gpu, &raygen);
        assert_eq!(trace.run(1), 12);
    }),
];

/// A ray whose numbers break a rule: the end of its name, flags, and origin, tmin, direction, tmax.
type Numbers = (&'static str, u32, [f32; 8]);

fn rays() -> Vec<Numbers> {
    let (nan, infinity) = (f32::NAN, f32::INFINITY);
    let at = |x: f32, t_min: f32, z: f32, t_max: f32| [x, 0.0, 1.0, t_min, 0.0, 0.0, z, t_max];
    vec![
        ("06358", 0, at(nan, 0.0, -1.0, 9.0)),
        ("06358", 0, at(0.0, nan, -1.0, 9.0)),
        ("06358", 0, at(0.0, 0.0, nan, 9.0)),
        ("06358", 0, at(0.0, 0.0, -1.0, nan)),
        ("06355", 0, at(infinity, 0.0, -1.0, 9.0)),
        ("06355", 0, at(0.0, 0.0, -infinity, 9.0)),
        ("06356", 0, at(0.0, -1.0, -1.0, 9.0)),
        ("06357", 0, at(0.0, 5.0, -1.0, 4.0)),
        ("06552", 0x300, at(0.0, 0.0, -1.0, 9.0)),
        ("06892", 0x30, at(0.0, 0.0, -1.0, 9.0)),
        ("06893", 0x3, at(0.0, 0.0, -1.0, 9.0)),
        ("zero-direction", 0, at(0.0, 0.0, 0.0, 9.0)),
    ]
}

fn trace_numbers(gpu: &Gpu, flags: u32, numbers: [f32; 8]) {
    let raygen = format!(
        "traceRayEXT(world, {flags}u, 0xff, 0, 0, 0, vec3(numbers[0], numbers[1], numbers[2]), numbers[3],
            vec3(numbers[4], numbers[5], numbers[6]), numbers[7], 0);"
    );
    let parts = Setup {
        raygen: &raygen,
        numbers,
        ..RIGHT
    };
    let result = Trace::new(gpu, &parts).run(64);
    assert!(result == 1 || result == 2, "{numbers:?}: {result}");
}

/// The device does what it should, after all that.
fn still_works(gpu: &Gpu) {
    assert_eq!(Trace::new(gpu, &RIGHT).run(1), 2);
}

#[test]
fn misuse_is_survived() {
    let Some(gpu) = Gpu::surviving() else { return };
    gpu.assert_survived(CHECKS);
    for (_, flags, numbers) in rays() {
        trace_numbers(&gpu, flags, numbers);
    }
    still_works(&gpu);
}

#[test]
fn misuse_is_reported_by_its_name() {
    let Some(gpu) = Gpu::reporting() else { return };
    still_works(&gpu);
    gpu.assert_silent();
    gpu.assert_reported(CHECKS);
    for (rule, flags, numbers) in rays() {
        trace_numbers(&gpu, flags, numbers);
        gpu.assert_said(&format!("-{rule}:"));
    }
    still_works(&gpu);
    gpu.assert_silent();
}

#[test]
fn a_place_is_reported_once_with_a_count() {
    let Some(gpu) = Gpu::reporting() else { return };
    let mut trace = Trace::new(&gpu, &RIGHT);
    trace.regions[2] = trace.record(&[0x5a; 32]);
    trace.run(64);
    let said = gpu.take_complaints();
    // The any-hit and the closest-hit shader are looked for, by each ray, in one record.
    assert_eq!(said.len(), 1, "{said:#?}");
    assert!(said[0].contains("128 times"), "{said:#?}");
    trace.run(64);
    gpu.assert_silent();
}

/// Against VUID-VkBufferViewCreateInfo-offset-00931, as an engine in use does it: what is there can
/// be read.
#[test]
fn a_texel_buffer_view_ends_with_its_buffer() {
    let gpu = Gpu::without_validation();
    let from = gpu.buffer_with(&[1.0f32, 2.0, 3.0, 4.0]);
    let output = gpu.buffer(16);
    let info = vk::BufferViewCreateInfo::default()
        .buffer(from.handle)
        .format(vk::Format::R32_SFLOAT)
        .range(256);
    // SAFETY: the rule that is broken is the test's; the view is destroyed below.
    let view = unsafe { gpu.device.create_buffer_view(&info, None) }.expect("a view");
    let source = "
    layout(local_size_x = 4) in;
    layout(set = 0, binding = 0) uniform textureBuffer from;
    layout(set = 0, binding = 1) buffer O { float o[]; };
    void main() { int i = int(gl_GlobalInvocationID.x); o[i] = texelFetch(from, i).x; }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::UniformTexels(view)]),
            (1, &[Bound::Storage(output)]),
        ],
        [1, 1, 1],
    );
    assert_eq!(output.read::<f32>(), [1.0, 2.0, 3.0, 4.0]);
    // SAFETY: nothing uses the view any more.
    unsafe { gpu.device.destroy_buffer_view(view, None) };
}

#[test]
fn parameters_in_memory_are_looked_at() {
    let Some(gpu) = Gpu::reporting() else { return };
    let trace = Trace::new(&gpu, &RIGHT);
    let parameters = gpu.buffer_with(&[1u32 << 16, 1 << 16, 1]);
    let places = [
        (
            "VkTraceRaysIndirectCommandKHR-width-03641",
            parameters.address,
        ),
        (
            "vkCmdTraceRaysIndirectKHR-indirectDeviceAddress-03634",
            parameters.address + 2,
        ),
        (
            "vkCmdTraceRaysIndirectKHR-indirectDeviceAddress-03636",
            1 << 45,
        ),
        ("vkCmdTraceRaysIndirectKHR-indirectDeviceAddress-03636", 4),
    ];
    for (name, address) in places {
        gpu.run(|commands| {
            gpu.bind_rays(commands, &trace.rays);
            let [raygen, miss, hit, callable] = &trace.regions;
            // SAFETY: the driver promises to survive this.
            unsafe {
                gpu.ray_tracing
                    .cmd_trace_rays_indirect(commands, raygen, miss, hit, callable, address);
            }
        });
        gpu.assert_said(name);
    }
    still_works(&gpu);
}

/// Builds from addresses that lead nowhere, or to what is not there any more.
fn build_astray(gpu: &Gpu, of: vk::GeometryTypeKHR, address: u64) -> Structure {
    let at = vk::DeviceOrHostAddressConstKHR {
        device_address: address,
    };
    let is_top = of == vk::GeometryTypeKHR::INSTANCES;
    let data = match of {
        vk::GeometryTypeKHR::INSTANCES => vk::AccelerationStructureGeometryDataKHR {
            instances: vk::AccelerationStructureGeometryInstancesDataKHR::default().data(at),
        },
        vk::GeometryTypeKHR::AABBS => vk::AccelerationStructureGeometryDataKHR {
            aabbs: vk::AccelerationStructureGeometryAabbsDataKHR::default()
                .data(at)
                .stride(24),
        },
        _ => vk::AccelerationStructureGeometryDataKHR {
            triangles: triangles_at(at, 301)
                .index_type(vk::IndexType::UINT32)
                .index_data(at)
                .transform_data(at),
        },
    };
    let geometry = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(of)
        .geometry(data);
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(100);
    let level = match is_top {
        true => vk::AccelerationStructureTypeKHR::TOP_LEVEL,
        false => vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
    };
    let flags = vk::BuildAccelerationStructureFlagsKHR::empty();
    gpu.build(level, &[geometry], &[range], flags)
}

const KINDS: [vk::GeometryTypeKHR; 3] = [
    vk::GeometryTypeKHR::TRIANGLES,
    vk::GeometryTypeKHR::AABBS,
    vk::GeometryTypeKHR::INSTANCES,
];

#[test]
fn builds_from_nowhere_are_empty() {
    let Some(gpu) = Gpu::surviving() else { return };
    for of in KINDS {
        for address in [16, 1 << 46, 0xdead_beef_0000_0010, u64::MAX - 15] {
            let structure = build_astray(&gpu, of, address);
            let world = match of {
                vk::GeometryTypeKHR::INSTANCES => structure,
                _ => gpu.top(&[Instance::of(structure)]),
            };
            assert_eq!(gpu.depths(world, 4), [-1.0; 4], "{of:?} {address:#x}");
        }
    }
    // References that lead nowhere, beside one that does not.
    let bottom = gpu.bottom(&[Geometry::opaque(&TRIANGLE)]);
    let astray = |address| Instance::of(Structure { address, ..bottom });
    let right = Instance {
        transform: translated([0.0, 0.0, 3.0]),
        ..Instance::of(bottom)
    };
    let world = gpu.top(&[astray(64), astray(u64::MAX - 255), right, astray(1 << 45)]);
    assert_eq!(gpu.depths(world, 1), [3.0]);
    still_works(&gpu);
}

#[test]
fn builds_from_nowhere_are_reported() {
    let Some(gpu) = Gpu::reporting() else { return };
    for (i, of) in KINDS.into_iter().enumerate() {
        build_astray(&gpu, of, (1 << 46) + 4096 * i as u64);
        let said = gpu.take_complaints();
        let name = "TUFF-build-input";
        assert!(
            said.iter().any(|text| text.starts_with(name)),
            "{of:?}: {said:#?}"
        );
    }
    let bottom = gpu.bottom(&[Geometry::opaque(&TRIANGLE)]);
    gpu.assert_silent();
    gpu.destroy(bottom);
    gpu.top(&[Instance::of(bottom)]);
    let said = gpu.take_complaints();
    assert!(
        said.len() == 1 && said[0].starts_with("TUFF-build-reference"),
        "{said:#?}"
    );
}

/// The test is run again in a process of its own, whose dispatches may take half a second.
#[test]
fn a_hang_loses_the_device_and_no_more() {
    const LIMIT: &str = "TUFF_TIMEOUT";
    const CHILD: &str = "TUFF_TEST_HANGS";
    let Some(gpu) = Gpu::surviving() else { return };
    if std::env::var_os(CHILD).is_none() {
        let program = std::env::current_exe().expect("this program");
        let child = std::process::Command::new(program)
            .args(["--exact", "a_hang_loses_the_device_and_no_more"])
            .envs([(LIMIT, "0.5"), (CHILD, "1")])
            .output()
            .expect("this program runs again");
        let said = String::from_utf8_lossy(&child.stdout);
        assert!(child.status.success(), "{said}");
        let errors = String::from_utf8_lossy(&child.stderr);
        // The limit was the user's: the message names where it comes from.
        assert!(!gpu.is_tuff() || errors.contains(LIMIT), "{errors}");
        return;
    }
    let trace = Trace::by(&gpu, "while (words[1] == 0u) payload += words[2];");
    let lost = Err(vk::Result::ERROR_DEVICE_LOST);
    let ended = gpu.try_run(|commands| {
        gpu.record_trace(commands, &trace.rays, &trace.regions, [64, 1, 1]);
    });
    assert_eq!(ended, lost);
    let device = &gpu.device;
    // SAFETY: plain waits, on handles of this device.
    unsafe {
        assert_eq!(device.device_wait_idle(), lost);
        assert_eq!(device.queue_wait_idle(gpu.queue), lost);
        let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
        let fence = fence.expect("objects can be made of a lost device");
        let waited = device.wait_for_fences(&[fence], true, u64::MAX);
        assert_eq!(waited, lost);
        device.destroy_fence(fence, None);
    }
    drop(gpu);
    still_works(&Gpu::without_validation());
}
