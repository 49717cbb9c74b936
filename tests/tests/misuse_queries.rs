//! Broken rules of ray queries: reported by their names, and survived.

use tuff_tests::*;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

/// A query whose numbers break a rule: the end of its name, flags, and origin, tmin, direction,
/// tmax.
type Numbers = (&'static str, u32, [f32; 8]);

const RIGHT: [f32; 8] = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 9.0];

fn queries() -> Vec<Numbers> {
    let (nan, infinity) = (f32::NAN, f32::INFINITY);
    let at = |x: f32, t_min: f32, z: f32, t_max: f32| [x, 0.0, 1.0, t_min, 0.0, 0.0, z, t_max];
    vec![
        ("06351", 0, at(nan, 0.0, -1.0, 9.0)),
        ("06351", 0, at(0.0, nan, -1.0, 9.0)),
        ("06351", 0, at(0.0, 0.0, nan, 9.0)),
        ("06351", 0, at(0.0, 0.0, -1.0, nan)),
        ("06348", 0, at(infinity, 0.0, -1.0, 9.0)),
        ("06348", 0, at(0.0, 0.0, -infinity, 9.0)),
        ("06349", 0, at(0.0, -1.0, -1.0, 9.0)),
        ("06350", 0, at(0.0, 5.0, -1.0, 4.0)),
        ("06889", 0x300, RIGHT),
        ("06890", 0x30, RIGHT),
        ("06891", 0x3, RIGHT),
        ("zero-direction", 0, at(0.0, 0.0, 0.0, 9.0)),
    ]
}

/// Where the structure is that is queried.
#[derive(Clone, Copy)]
enum World<'a> {
    Bound(Structure),
    /// An expression of the shader.
    At(&'a str),
}

/// Queries in compute; the committed type, the same in all invocations.
fn query(gpu: &Gpu, world: World<'_>, flags: u32, numbers: [f32; 8]) -> u32 {
    let results = gpu.buffer(4 * 64);
    let (bound, name) = match world {
        World::Bound(world) => (world, "world"),
        World::At(name) => (gpu.scene(&[Geometry::opaque(&TRIANGLE)]), name),
    };
    let source = format!(
        "#extension GL_EXT_buffer_reference_uvec2 : enable
        layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1, std430) buffer W {{ uint words[]; }};
        layout(set = 0, binding = 2, std430) buffer N {{ float n[]; }};
        void main() {{
            rayQueryEXT q;
            rayQueryInitializeEXT(q, {name}, {flags}u, 0xff, vec3(n[0], n[1], n[2]), n[3], vec3(n[4], n[5], n[6]), n[7]);
            while (rayQueryProceedEXT(q)) {{}}
            words[gl_LocalInvocationIndex] = rayQueryGetIntersectionTypeEXT(q, true);
        }}"
    );
    gpu.compute_with(
        &source,
        &[
            (0, &[Bound::Structure(bound.handle)]),
            (1, &[Bound::Storage(results)]),
            (2, &[Bound::Storage(gpu.buffer_with(&numbers))]),
        ],
        [1, 1, 1],
    );
    let words = results.read::<u32>();
    assert!(words.iter().all(|&word| word == words[0]), "{words:?}");
    words[0]
}

/// Each check breaks one rule, whose name is on the left; what it asserts holds with validation and
/// without.
const CHECKS: &[(&str, Misuse)] = &[
    ("VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", |gpu| {
        let bottom = gpu.bottom(&[Geometry::opaque(&TRIANGLE)]);
        let at = format!(
            "accelerationStructureEXT(uvec2({}u, {}u))",
            bottom.address as u32,
            bottom.address >> 32
        );
        query(gpu, World::At(&at), 0, RIGHT);
    }),
    ("TUFF-query-structure", |gpu| {
        for address in ["uvec2(64, 0)", "uvec2(0x1230, 0x4567)", "uvec2(-1, -1)"] {
            let at = format!("accelerationStructureEXT({address})");
            assert_eq!(query(gpu, World::At(&at), 0, RIGHT), 0);
        }
    }),
    ("TUFF-query-structure", |gpu| {
        let world = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
        let at = format!(
            "accelerationStructureEXT(uvec2({}u, {}u))",
            world.address as u32,
            world.address >> 32
        );
        gpu.destroy(world);
        query(gpu, World::At(&at), 0, RIGHT);
    }),
];

const NEEDS: &str = "VK_KHR_ray_query";

fn has_all(gpu: &Gpu) -> bool {
    gpu.optional.ray_query.ray_query == vk::TRUE
}

fn still_works(gpu: &Gpu) {
    let world = World::Bound(gpu.scene(&[Geometry::opaque(&TRIANGLE)]));
    assert_eq!(query(gpu, world, 0, RIGHT), 1);
}

fn spoilt(gpu: &Gpu, flags: u32, numbers: [f32; 8]) {
    let world = World::Bound(gpu.scene(&[Geometry::opaque(&TRIANGLE)]));
    let found = query(gpu, world, flags, numbers);
    assert!(found <= 1, "{numbers:?}: {found}");
}

#[test]
fn misuse_is_survived() {
    let gpu = Gpu::surviving().and_then(|gpu| gpu.with(NEEDS, has_all));
    let Some(gpu) = gpu else { return };
    gpu.assert_survived(CHECKS);
    for (_, flags, numbers) in queries() {
        spoilt(&gpu, flags, numbers);
    }
    still_works(&gpu);
}

#[test]
fn misuse_is_reported_by_its_name() {
    let gpu = Gpu::reporting().and_then(|gpu| gpu.with(NEEDS, has_all));
    let Some(gpu) = gpu else { return };
    still_works(&gpu);
    gpu.assert_silent();
    gpu.assert_reported(CHECKS);
    for (rule, flags, numbers) in queries() {
        spoilt(&gpu, flags, numbers);
        gpu.assert_said(&format!("-{rule}:"));
    }
    still_works(&gpu);
    gpu.assert_silent();
}

#[test]
fn queries_of_ray_tracing_shaders_are_looked_at() {
    let gpu = Gpu::reporting().and_then(|gpu| gpu.with(NEEDS, has_all));
    let Some(gpu) = gpu else { return };
    let world = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    void main() {
        rayQueryEXT q;
        float nowhere = sqrt(-1.0 - float(gl_LaunchIDEXT.x));
        rayQueryInitializeEXT(q, world, 0u, 0xff, vec3(nowhere, 0, 1), 0.0, vec3(0, 0, -1), 9.0);
        while (rayQueryProceedEXT(q)) {}
    }";
    let case = Case::new(raygen).recursion(0).bind(world);
    case.trace(&gpu, [40, 1, 1]);
    let said = gpu.take_complaints();
    assert!(
        said.len() == 1 && said[0].contains("06351") && said[0].contains("40 times"),
        "{said:#?}"
    );
}
