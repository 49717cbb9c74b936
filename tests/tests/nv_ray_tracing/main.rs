//! `VK_NV_ray_tracing`, against what the scenes are made of.

mod structures;

use tuff_tests::*;
use vk::AccelerationStructureMemoryRequirementsTypeNV as Needs;
use vk::BuildAccelerationStructureFlagsKHR as BuildFlags;
use vk::CopyAccelerationStructureModeKHR as CopyMode;

/// A device that has the extension; `None` skips the test.
#[track_caller]
fn gpu() -> Option<Gpu> {
    Gpu::new().with("VK_NV_ray_tracing", |gpu| gpu.nv_ray_tracing.is_some())
}

const HEAD: &str = r"
layout(set = 0, binding = 0) uniform accelerationStructureNV world;
layout(set = 0, binding = 1, std430) buffer Results { float results[]; };
";

/// Rays along z through points on a line, four floats of payload each.
const RAYGEN: &str = r"
layout(location = 3) rayPayloadNV vec4 found;
void main() {
    found = vec4(-2.0);
    vec3 origin = vec3(float(gl_LaunchIDNV.x) + 0.25, float(gl_LaunchIDNV.y) + 0.25, 0.0);
    traceNV(world, gl_RayFlagsNoneNV, 0xff, 0, 1, 0, origin, 0.0, vec3(0, 0, 1), 100.0, 3);
    uint place = 4u * (gl_LaunchIDNV.y * gl_LaunchSizeNV.x + gl_LaunchIDNV.x);
    for (uint i = 0u; i < 4u; i++) results[place + i] = found[i];
}";

const MISS: &str = r"
layout(location = 3) rayPayloadInNV vec4 found;
void main() { found = vec4(-1.0); }";

/// [`RAYGEN`] and [`MISS`], and a hit group of this shader.
fn shots(hit: &str) -> Case {
    Case::new(RAYGEN).miss(MISS).hit(hit)
}

/// Traces a grid with shaders that have [`HEAD`] before them.
struct Traced<'a> {
    gpu: &'a Gpu,
    rays: Rays,
    results: Buffer,
    table: Table,
    size: [u32; 3],
}

impl<'a> Traced<'a> {
    fn new(gpu: &'a Gpu, world: StructureNv, case: Case, size: [u32; 3]) -> Self {
        let results = gpu.buffer(16 * u64::from(size[0] * size[1] * size[2]));
        let case = case.head(HEAD).bind(world).bind(results);
        Self {
            gpu,
            rays: gpu.rays_nv(&case),
            results,
            table: case.table(),
            size,
        }
    }

    fn trace(&self) -> Vec<[f32; 4]> {
        self.gpu.trace_nv(&self.rays, &self.table, self.size);
        self.results.read()
    }

    fn trace_into(&self, world: StructureNv) -> Vec<[f32; 4]> {
        (self.gpu).write(self.rays.set.handle, 0, 0, &world.into());
        self.trace()
    }
}

/// The distance, and who was hit.
const HIT: &str = r"
layout(location = 3) rayPayloadInNV vec4 found;
void main() { found = vec4(gl_HitTNV, gl_InstanceCustomIndexNV, gl_PrimitiveID, gl_InstanceID); }";

fn close(a: f32, b: f32) -> bool {
    (a - b).abs() <= 1e-5 * b.abs().max(1.0)
}

/// Two triangles over a unit square at x, at a depth.
fn square(x: f32, z: f32) -> [[f32; 3]; 6] {
    let corner = |dx: f32, y: f32| [x + dx, y, z];
    [
        corner(0.0, 0.0),
        corner(1.0, 0.0),
        corner(0.0, 1.0),
        corner(1.0, 0.0),
        corner(1.0, 1.0),
        corner(0.0, 1.0),
    ]
}

fn squares(at: &[(f32, f32)]) -> Vec<[f32; 3]> {
    at.iter().flat_map(|&(x, z)| square(x, z)).collect()
}

#[test]
fn properties_are_those_of_the_newer_extensions() {
    let Some(gpu) = gpu() else { return };
    let mut nv = vk::PhysicalDeviceRayTracingPropertiesNV::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut nv);
    // SAFETY: the chain is one structure of an extension that is there.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut all)
    };
    let (pipelines, structures) = (&gpu.pipeline_properties, &gpu.structure_properties);
    assert_eq!(
        nv.shader_group_handle_size,
        pipelines.shader_group_handle_size
    );
    assert_eq!(
        nv.shader_group_base_alignment,
        pipelines.shader_group_base_alignment
    );
    assert_eq!(
        nv.max_shader_group_stride,
        pipelines.max_shader_group_stride
    );
    assert_eq!(nv.max_geometry_count, structures.max_geometry_count);
    assert_eq!(nv.max_instance_count, structures.max_instance_count);
    assert!(nv.max_recursion_depth >= 31);
    assert!(nv.max_triangle_count >= (1 << 29) - 1);
}

#[test]
fn triangles_are_where_they_were_put() {
    let Some(gpu) = gpu() else { return };
    // A slope: z = 2 + x / 2 over [0, 4] × [0, 4]; then a square at z = 1 with indices, moved by a
    // transform from x = 0 to x = 6.
    let slope = [
        [0.0, 0.0, 2.0],
        [4.0, 0.0, 4.0],
        [0.0, 4.0, 2.0],
        [4.0, 4.0, 4.0],
    ];
    let indexed = Geometry::Triangles {
        corners: slope.to_vec(),
        indices: vec![0, 1, 2, 3, 2, 1],
        flags: vk::GeometryFlagsKHR::OPAQUE,
    };
    let moved = Geometry::opaque(&square(0.0, 1.0));
    let mut described = gpu.describe_nv(&[indexed, moved], BuildFlags::PREFER_FAST_TRACE);
    described.transform(&gpu, 1, translated([6.0, 0.0, 0.0]));
    let bottom = gpu.structure_nv(&described);
    gpu.build_nv(&described, &bottom, None);
    let world = gpu.top_nv(&[Instance {
        custom_index: 77,
        ..bottom.instance()
    }]);
    let hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    hitAttributeNV vec2 weights;
    void main() {
        vec3 there = gl_WorldRayOriginNV + gl_HitTNV * gl_WorldRayDirectionNV;
        bool same = gl_HitTNV == gl_RayTmaxNV && gl_RayTminNV == 0.0 && gl_HitKindNV >= 254u
            && gl_ObjectRayOriginNV == gl_WorldRayOriginNV && gl_IncomingRayFlagsNV == gl_RayFlagsNoneNV
            && gl_ObjectToWorldNV[0] == vec3(1, 0, 0) && gl_WorldToObjectNV[3] == vec3(0);
        found = vec4(there.z, gl_PrimitiveID, same ? gl_InstanceCustomIndexNV : -3, weights.x + weights.y);
    }";
    let size = [8, 4, 1];
    let traced = Traced::new(&gpu, world, shots(hit).hit(hit), size);
    let found = traced.trace();
    for (index, [z, primitive, custom, weights]) in found.iter().copied().enumerate() {
        let (x, y) = ((index % 8) as f32 + 0.25, (index / 8) as f32 + 0.25);
        if x < 4.0 {
            // The diagonal goes from (4, 0) to (0, 4); the weights of the far corners add up to the
            // part of the way to it.
            let second = x + y > 4.0;
            let part = if second { 8.0 - x - y } else { x + y } / 4.0;
            assert!(close(z, 2.0 + x / 2.0), "{x} {y}: {z}");
            assert_eq!((primitive, custom), (f32::from(u8::from(second)), 77.0));
            assert!(close(weights, part), "{x} {y}: {weights}, {part}");
        } else if (6.0..7.0).contains(&x) && y < 1.0 {
            assert_eq!((z, primitive, custom), (1.0, 0.0, 77.0));
        } else {
            assert_eq!(z, -1.0, "{x} {y}");
        }
    }
}

#[test]
fn intersection_shaders_find_spheres_in_boxes() {
    let Some(gpu) = gpu() else { return };
    let centres = [[0.25f32, 0.25, 5.0], [2.0, 0.25, 7.0], [4.75, 0.5, 9.0]];
    let boxes = centres.map(|[x, y, z]| [x - 0.5, y - 0.5, z - 0.5, x + 0.5, y + 0.5, z + 0.5]);
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    let world = gpu.scene_nv(&[
        Geometry::boxes(&boxes[..1], opaque),
        Geometry::boxes(&boxes[1..], opaque),
    ]);
    let intersection = r"
    hitAttributeNV vec3 normal;
    void main() {
        // The geometry is known by its hit group alone: the second one is of primitives 1 and 2.
        vec3 centres[3] = vec3[3](vec3(0.25, 0.25, 5.0), vec3(2.0, 0.25, 7.0), vec3(4.75, 0.5, 9.0));
        vec3 centre = centres[FIRST + gl_PrimitiveID];
        vec3 o = gl_ObjectRayOriginNV - centre;
        float b = dot(o, gl_ObjectRayDirectionNV);
        float d = b * b - dot(o, o) + 0.25;
        if (d >= 0.0) {
            float t = -b - sqrt(d);
            normal = (o + t * gl_ObjectRayDirectionNV) / 0.5;
            // A hit past the ray's end is not accepted.
            bool far = reportIntersectionNV(1e6, 7u);
            if (!far) reportIntersectionNV(t, 3u + uint(gl_PrimitiveID));
        }
    }";
    let [first, second] = ["0", "1"].map(|n| intersection.replace("FIRST", n));
    let hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    hitAttributeNV vec3 normal;
    void main() { found = vec4(gl_HitTNV, float(gl_HitKindNV), normal.x, normal.z); }";
    let case = shots(hit).intersection(&first).hit(hit);
    let traced = Traced::new(&gpu, world, case.intersection(&second), [6, 1, 1]);
    for (index, [t, kind, nx, nz]) in traced.trace().into_iter().enumerate() {
        let (x, y) = (index as f32 + 0.25, 0.25);
        let hit = centres.iter().enumerate().find_map(|(i, c)| {
            let below = 0.25 - (x - c[0]).powi(2) - (y - c[1]).powi(2);
            (below >= 0.0).then(|| {
                (
                    i,
                    c[2] - below.sqrt(),
                    (x - c[0]) / 0.5,
                    -below.sqrt() / 0.5,
                )
            })
        });
        let Some((i, depth, expected_x, expected_z)) = hit else {
            assert_eq!(t, -1.0, "{index}");
            continue;
        };
        assert!(close(t, depth), "{index}: {t}, {depth}");
        assert_eq!(kind, [3.0, 3.0, 4.0][i]);
        assert!(
            close(nx, expected_x) && close(nz, expected_z),
            "{index}: {nx} {nz}"
        );
    }
}

#[test]
fn any_hit_shaders_ignore_and_end_there() {
    let Some(gpu) = gpu() else { return };
    // Layers at z = 1, 2, 3 …: the first of x = i that counts is the one at 1 + i.
    let layers: Vec<_> = (0..4).map(|z| (0.0, 1.0 + z as f32)).collect();
    let corners: Vec<[f32; 3]> = squares(&layers)
        .iter()
        .map(|[x, y, z]| [x * 4.0, *y, *z])
        .collect();
    let world = gpu.scene_nv(&[Geometry::triangles(
        &corners,
        vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION,
    )]);
    let any_hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    void drop_it(bool really) {
        if (really) { ignoreIntersectionNV(); found.y = 99.0; }
        found.w += 1.0;
    }
    void main() {
        uint layer = uint(gl_PrimitiveID) / 2u;
        for (uint i = 0u; i < 3u; i++) {
            if (layer == i && gl_LaunchIDNV.x > i) {
                drop_it(gl_HitTNV > 0.5);
                found.z = 99.0;
            }
        }
    }";
    let hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    void main() { found.x = gl_HitTNV; }";
    let case = shots(hit).any_hit(any_hit);
    let found = Traced::new(&gpu, world, case, [4, 1, 1]).trace();
    for (x, found) in found.iter().enumerate() {
        // Nothing behind an ignored intersection is executed.
        assert_eq!(*found, [1.0 + x as f32, -2.0, -2.0, -2.0], "{x}");
    }
}

#[test]
fn any_hit_shaders_end_the_ray() {
    let Some(gpu) = gpu() else { return };
    let layers: Vec<_> = (0..40).map(|z| (0.0, 1.0 + z as f32)).collect();
    let world = gpu.scene_nv(&[Geometry::triangles(
        &squares(&layers),
        vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION,
    )]);
    let any_hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    void main() {
        found.y += 1.0;
        found.w = gl_HitTNV;
        switch (gl_PrimitiveID & 0) {
        case 0: terminateRayNV(); found.z = 99.0; break;
        default: found.z = 98.0;
        }
        found.z = 97.0;
    }";
    let hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    void main() { found.x = gl_HitTNV; }";
    let case = shots(hit).any_hit(any_hit);
    let found = Traced::new(&gpu, world, case, [2, 1, 1]).trace();
    // One call, whichever candidate comes first; it is the hit.
    let [t, count, untouched, seen] = found[0];
    assert_eq!((count, untouched), (-1.0, -2.0));
    assert!(
        t == seen && t.fract() == 0.0 && (1.0..=40.0).contains(&t),
        "{t} {seen}"
    );
    assert_eq!(found[1], [-1.0; 4]);
}

#[test]
fn callable_shaders_take_data_by_location() {
    let Some(gpu) = gpu() else { return };
    let results = gpu.buffer(4 * 32);
    let results_are = "layout(set = 0, binding = 0, std430) buffer R { float results[]; };";
    let raygen = format!(
        "{results_are}
        layout(location = 5) callableDataNV vec2 pair;
        layout(location = 2) callableDataNV float single;
        void main() {{
            single = float(gl_LaunchIDNV.x);
            executeCallableNV(gl_LaunchIDNV.x % 2u, 2);
            pair = vec2(single, 1000.0);
            executeCallableNV(2u, 5);
            results[gl_LaunchIDNV.x] = pair.x + pair.y;
        }}"
    );
    let scale = r"
    layout(shaderRecordNV, std430) buffer Record { float factor; };
    layout(location = 2) callableDataInNV float single;
    void main() { single *= factor; }";
    let both = r"
    layout(location = 5) callableDataInNV vec2 pair;
    layout(location = 2) callableDataNV float inner;
    void main() {
        inner = pair.x;
        executeCallableNV(0u, 2);
        pair = vec2(inner, pair.y + 1.0);
    }";
    let case = Case::new(&raygen)
        .callable(scale)
        .callable(both)
        .recursion(0)
        .bind(results);
    let rays = gpu.rays_nv(&case);
    let table = Table {
        callable: vec![
            Record::with(1, &[3.0f32]),
            Record::with(1, &[5.0f32]),
            Record::of(2),
        ],
        ..case.table()
    };
    gpu.trace_nv(&rays, &table, [32, 1, 1]);
    let factor = |x: usize| if x.is_multiple_of(2) { 3.0 } else { 5.0 };
    let expected: Vec<f32> = (0..32)
        .map(|x| x as f32 * factor(x) * 3.0 + 1001.0)
        .collect();
    assert_eq!(results.read::<f32>(), expected);
}

#[test]
fn shaders_that_are_hit_trace_by_location() {
    let Some(gpu) = gpu() else { return };
    // Each hit traces on from where it is, up to a depth; layers at z = 1, 2 … 6.
    let layers: Vec<_> = (0..6).map(|z| (0.0, 1.0 + z as f32)).collect();
    let world = gpu.scene_nv(&[Geometry::opaque(&squares(&layers))]);
    let raygen = format!(
        "{HEAD}
        layout(location = 0) rayPayloadNV vec2 result;
        void main() {{
            result = vec2(0.0, float(gl_LaunchIDNV.x));
            traceNV(world, 0u, 0xff, 0, 0, 1, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 100.0, 0);
            results[gl_LaunchIDNV.x] = result.x;
        }}"
    );
    let hit = format!(
        "{HEAD}
        layout(location = 0) rayPayloadInNV vec2 result;
        layout(location = 1) rayPayloadNV vec2 next;
        void main() {{
            vec3 there = gl_WorldRayOriginNV + gl_HitTNV * gl_WorldRayDirectionNV;
            next = vec2(0.0, result.y - 1.0);
            if (result.y > 0.0) {{
                traceNV(world, 0u, 0xff, 0, 0, 0, there, 0.5, vec3(0, 0, 1), 100.0, 1);
            }}
            result.x = there.z + 10.0 * next.x;
        }}"
    );
    let miss = "layout(location = 0) rayPayloadInNV vec2 result; void main() { result.x = 7.0; }";
    let results = gpu.buffer(4 * 8);
    let case = Case::new(&raygen)
        .miss(miss)
        .hit(&hit)
        .recursion(9)
        .bind(world)
        .bind(results);
    let rays = gpu.rays_nv(&case);
    gpu.trace_nv(&rays, &Table::of(0, &[1, 1], &[2]), [8, 1, 1]);
    // The value seen from layer z on, so many layers deep: z + 10 (z + 1) + 100 (z + 2) …, and 7
    // past the last.
    fn seen(z: u32, depth: u32) -> f32 {
        match (z, depth) {
            (7, _) => 7.0,
            (z, 0) => z as f32,
            (z, depth) => z as f32 + 10.0 * seen(z + 1, depth - 1),
        }
    }
    let found = results.read::<f32>();
    for (depth, found) in found.iter().enumerate() {
        assert!(close(*found, seen(1, depth as u32)), "{depth}: {found}");
    }
}

#[test]
fn deferred_pipelines_are_compiled_shader_by_shader() {
    let Some(gpu) = gpu() else { return };
    let world = gpu.scene_nv(&[Geometry::opaque(&square(1.0, 4.0))]);
    let case = shots(HIT).flags(vk::PipelineCreateFlags::DEFER_COMPILE_NV);
    let deferred = Traced::new(&gpu, world, case, [3, 1, 1]);
    let nv = gpu.nv();
    let pipeline = deferred.rays.pipeline;
    std::thread::scope(|scope| {
        for shader in 0..3 {
            // SAFETY: each shader of the pipeline is compiled once.
            scope.spawn(move || unsafe {
                nv.compile_deferred(pipeline, shader)
                    .expect("vkCompileDeferredNV");
            });
        }
    });
    let expected = [[-1.0; 4], [4.0, 0.0, 0.0, 0.0], [-1.0; 4]];
    assert_eq!(deferred.trace(), expected);
}

#[test]
fn empty_launches_and_empty_tables_do_nothing() {
    let Some(gpu) = gpu() else { return };
    let world = gpu.scene_nv(&[Geometry::opaque(&square(0.0, 1.0))]);
    let traced = Traced::new(&gpu, world, shots(HIT), [1, 1, 1]);
    let tables = gpu.tables_nv(&traced.rays, &traced.table);
    gpu.run(|commands| {
        for size in [[0, 1, 1], [1, 0, 1], [1, 1, 0], [0, 0, 0]] {
            gpu.record_trace_nv(commands, &traced.rays, &tables, size);
        }
    });
    assert_eq!(traced.results.read::<[f32; 4]>(), [[0.0; 4]]);
    // Zero records are no shaders: the payload stays as it is.
    let without = Table {
        miss: vec![Record::default()],
        hit: vec![Record::default()],
        ..traced.table.clone()
    };
    gpu.trace_nv(&traced.rays, &without, [1, 1, 1]);
    assert_eq!(traced.results.read::<[f32; 4]>(), [[-2.0; 4]]);
}

#[test]
fn descriptors_come_in_arrays_and_by_template() {
    let Some(gpu) = gpu() else { return };
    let worlds = [1.0, 5.0].map(|z| gpu.scene_nv(&[Geometry::opaque(&square(0.0, z))]));
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureNV worlds[2];
    layout(set = 0, binding = 1, std430) buffer Results { float results[]; };
    layout(location = 0) rayPayloadNV float t;
    void main() {
        for (int i = 0; i < 2; i++) {
            traceNV(worlds[i], 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0, 0);
            results[i] = t;
        }
    }";
    let miss = "layout(location = 0) rayPayloadInNV float t; void main() { t = -1.0; }";
    let hit = "layout(location = 0) rayPayloadInNV float t; void main() { t = gl_HitTNV; }";
    let results = gpu.buffer(8);
    let case = Case::new(raygen)
        .miss(miss)
        .hit(hit)
        .bind_array(&worlds.map(|world| Bound::StructureNv(world.handle)))
        .bind(results);
    let rays = gpu.rays_nv(&case);
    gpu.trace_nv(&rays, &case.table(), [1, 1, 1]);
    assert_eq!(results.read::<f32>(), [1.0, 5.0]);

    let entries = [vk::DescriptorUpdateTemplateEntry::default()
        .descriptor_type(vk::DescriptorType::ACCELERATION_STRUCTURE_NV)
        .descriptor_count(2)
        .stride(16)];
    let info = vk::DescriptorUpdateTemplateCreateInfo::default()
        .descriptor_update_entries(&entries)
        .descriptor_set_layout(rays.set.layout);
    let handles = [
        worlds[1].handle,
        Default::default(),
        worlds[0].handle,
        Default::default(),
    ];
    // SAFETY: the template's data is two handles, 16 bytes apart; nothing uses the set meanwhile.
    unsafe {
        let template = gpu
            .device
            .create_descriptor_update_template(&info, None)
            .expect("a template");
        gpu.device.update_descriptor_set_with_template(
            rays.set.handle,
            template,
            handles.as_ptr().cast(),
        );
        gpu.device
            .destroy_descriptor_update_template(template, None);
    }
    gpu.trace_nv(&rays, &case.table(), [1, 1, 1]);
    assert_eq!(results.read::<f32>(), [5.0, 1.0]);
}
