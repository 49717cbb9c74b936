//! The observable execution of shaders: partners in subgroups, order of candidates, results of
//! functions and denormals. One digest for each kind: the same input must give the same digests,
//! however it is run.

use std::hash::{DefaultHasher, Hasher};

use anyhow::Result;
use tuff_tests::{Case, Geometry, Gpu, Instance, Record, Structure, Table, translated, vk};

#[derive(clap::Args)]
pub struct Options {
    /// Flush denormals to zero in this process, as some hosts do, before the driver is loaded
    #[arg(long)]
    flush: bool,
}

/// Words that each launch leaves, by name. The shaders know their numbers.
const NAMES: [&str; 11] = [
    "any_hit",
    "closest_hit",
    "miss",
    "callable",
    "intersection",
    "first_hit",
    "query",
    "first_query",
    "functions",
    "denormals",
    "reordered",
];

const SIZE: [u32; 3] = [45, 31, 1];

/// The beginning of all shaders.
const COMMON: &str = r"
#extension GL_KHR_shader_subgroup_basic : enable
#extension GL_KHR_shader_subgroup_ballot : enable
#extension GL_NV_shader_invocation_reorder : enable
struct Carried { uint any; uint closest; uint miss; uint callable; uint first; uint depth; uint seed; };
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1) uniform accelerationStructureEXT leaves;
layout(set = 0, binding = 2, std430) buffer Results { uint results[][11]; };
uint launch() { return gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x; }
uint noted(uint before, uint word) { return (before ^ word) * 16777619u + (word >> 7); }
uint sharers(uint before) {
    return noted(noted(before, subgroupBallot(true).x), gl_SubgroupInvocationID);
}
uint random(inout uint seed) {
    seed = seed * 747796405u + 2891336453u;
    uint word = ((seed >> ((seed >> 28) + 4u)) ^ seed) * 277803737u;
    return (word >> 22) ^ word;
}
float between(inout uint seed) { return float(random(seed) >> 8) / 8388608.0 - 1.0; }
";

const RAYGEN: &str = r"
layout(location = 0) rayPayloadEXT Carried carried;
uint candidates(uint flags, vec3 origin, vec3 direction, inout uint first) {
    uint seen = 0u;
    rayQueryEXT query;
    rayQueryInitializeEXT(query, world, flags, 0xff, origin, 0.0, direction, 100.0);
    while (rayQueryProceedEXT(query)) {
        seen = noted(seen, rayQueryGetIntersectionPrimitiveIndexEXT(query, false));
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            seen = noted(seen, floatBitsToUint(rayQueryGetIntersectionTEXT(query, false)));
            if ((seen & 3u) == 0u) rayQueryConfirmIntersectionEXT(query);
        }
    }
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT) {
        first = noted(first, rayQueryGetIntersectionPrimitiveIndexEXT(query, true));
        vec2 at = rayQueryGetIntersectionBarycentricsEXT(query, true);
        first = noted(first, floatBitsToUint(at.x) ^ floatBitsToUint(at.y));
    }
    return seen;
}
void main() {
    uint self = launch();
    carried = Carried(0u, 0u, 0u, 0u, 0u, 0u, self * 9781u + 1u);
    vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy) * 2.0 - 1.0;
    vec3 origin = vec3(0, 0, -6), direction = normalize(vec3(at * 0.7, 1.0));
    uint reordered = 0u;
    for (uint bounce = 0u; bounce < 4u; bounce++) {
        traceRayEXT(world, 0u, 0xff, 0, 1, carried.seed & 1u, origin, 0.0, direction, 100.0, 0);
        // One instance of triangles that are not opaque, by parallel rays.
        traceRayEXT(leaves, 0u, 0xff, 0, 1, 0, vec3(at * 1.5, -4), 0.0, vec3(0.01, 0.02, 1), 100.0, 0);
        // Their first hit ends these: which one, a shader sees.
        carried.first = noted(carried.first, 1u);
        uint flags = gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsOpaqueEXT;
        traceRayEXT(leaves, flags, 0xff, 2, 1, 1, vec3(at * 1.5, -4), 0.0, vec3(0.01, 0.02, 1), 100.0, 0);
        results[self][6] = noted(results[self][6], candidates(0u, origin, direction, results[self][7]));
        candidates(gl_RayFlagsTerminateOnFirstHitEXT, origin, direction, results[self][7]);
        results[self][6] = sharers(results[self][6]);
        reorderThreadNV(random(carried.seed), 2u);
        reordered = sharers(reordered);
        if ((random(carried.seed) & 3u) == 0u) break;
        origin = vec3(between(carried.seed), between(carried.seed), between(carried.seed)) * 2.0;
        direction = normalize(vec3(between(carried.seed), between(carried.seed), between(carried.seed)) + 0.01);
    }
    results[self][0] = carried.any;
    results[self][1] = carried.closest;
    results[self][2] = carried.miss;
    results[self][3] = carried.callable;
    results[self][5] = carried.first;
    float x = at.x * 3.0, y = at.y * 2.0 + 2.5;
    uint functions = 0u;
    float values[] = float[](sin(x), cos(x), tan(x), asin(at.x), acos(at.y), atan(x), atan(x, y), sinh(x), cosh(x),
        tanh(x), asinh(x), acosh(y + 1.0), atanh(at.x), exp(x), exp2(x), log(y), log2(y), pow(y, x), inversesqrt(y));
    for (int i = 0; i < 19; i++) functions = noted(functions, floatBitsToUint(values[i]));
    results[self][8] = functions;
    // Denormals, as operands and as results.
    float small = uintBitsToFloat(self + 1u), least = uintBitsToFloat(0x00800000u + self);
    results[self][9] = noted(floatBitsToUint(small * 3.0), floatBitsToUint(least * 0.5) ^ floatBitsToUint(small + small));
    results[self][10] = reordered;
}
";

const MISS: &str = r"
layout(location = 0) rayPayloadInEXT Carried carried;
void main() { carried.miss = sharers(carried.miss); }
";

const ANY_HIT: &str = r"
layout(location = 0) rayPayloadInEXT Carried carried;
hitAttributeEXT vec2 weights;
void main() {
    carried.any = noted(sharers(carried.any), floatBitsToUint(gl_HitTEXT) ^ gl_PrimitiveID);
    uint choice = (carried.seed >> 5 ^ gl_PrimitiveID * 2654435761u) >> 29;
    if (choice == 7u) terminateRayEXT;
    if (choice > 1u) ignoreIntersectionEXT;
}
";

const CLOSEST_HIT: &str = r"
layout(location = 0) rayPayloadInEXT Carried carried;
layout(location = 1) rayPayloadEXT Carried inner;
layout(location = 0) callableDataEXT uint called;
layout(shaderRecordEXT, std430) buffer Data { uint record; };
hitAttributeEXT vec2 weights;
void main() {
    carried.closest = noted(sharers(carried.closest), record ^ gl_PrimitiveID << 4 ^ gl_InstanceID);
    carried.closest = noted(carried.closest, floatBitsToUint(gl_HitTEXT) ^ floatBitsToUint(weights.x));
    called = carried.callable;
    executeCallableEXT(gl_PrimitiveID % 3u, 0);
    carried.callable = sharers(called);
    if (carried.depth < 2u) {
        inner = carried;
        inner.depth += 1u;
        vec3 from = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
        vec3 to = normalize(vec3(between(inner.seed), between(inner.seed), between(inner.seed)) + 0.01);
        traceRayEXT(world, 0u, 0xff, 0, 1, inner.depth & 1u, from, 0.001, to, 100.0, 1);
        inner.depth -= 1u;
        carried = inner;
        carried.closest = sharers(carried.closest);
    }
}
";

const FIRST_HIT: &str = r"
layout(location = 0) rayPayloadInEXT Carried carried;
hitAttributeEXT vec2 weights;
void main() {
    carried.first = noted(sharers(carried.first), gl_PrimitiveID ^ floatBitsToUint(weights.x) ^ floatBitsToUint(gl_HitTEXT));
}
";

const INTERSECTION: &str = r"
hitAttributeEXT vec2 weights;
void main() {
    uint self = launch();
    uint seen = noted(sharers(results[self][4]), gl_PrimitiveID ^ floatBitsToUint(gl_RayTmaxEXT));
    results[self][4] = seen;
    weights = vec2(float(seen & 255u), 1.0);
    float t = 2.0 + float(seen >> 8 & 1023u) / 256.0;
    if ((seen & 3u) != 0u) reportIntersectionEXT(t, 3u);
    reportIntersectionEXT(t - 0.25, 4u);
    results[self][4] = sharers(results[self][4]);
}
";

const CALLABLE: &str = r"
layout(location = 0) callableDataInEXT uint called;
layout(shaderRecordEXT, std430) buffer Data { uint record; };
void main() { called = noted(sharers(called), record); }
";

/// Prints a line for each kind of thing: its name and the digests of two turns.
pub fn probe(options: &Options) -> Result<()> {
    if options.flush {
        flush_denormals();
    }
    let gpu = Gpu::without_validation();
    if !gpu.is_tuff() {
        // Who shares a subgroup is each driver's own business.
        return Ok(());
    }
    let (first, second) = (digests(&gpu), digests(&gpu));
    for (i, name) in NAMES.iter().enumerate() {
        println!("{name}\t{:016x}\t{:016x}", first[i], second[i]);
    }
    Ok(())
}

fn digests(gpu: &Gpu) -> [u64; NAMES.len()] {
    let words = trace(gpu);
    std::array::from_fn(|name| {
        let mut hasher = DefaultHasher::new();
        for launch in words.chunks_exact(NAMES.len()) {
            hasher.write_u32(launch[name]);
        }
        hasher.finish()
    })
}

fn trace(gpu: &Gpu) -> Vec<u32> {
    let (world, leaves) = worlds(gpu);
    let count = SIZE.iter().product::<u32>() as usize;
    let output = gpu.buffer_with(&vec![0u32; count * NAMES.len()]);
    let case = Case::new(RAYGEN)
        .miss(MISS)
        .hit(CLOSEST_HIT)
        .any_hit(ANY_HIT)
        .hit(CLOSEST_HIT)
        .any_hit(ANY_HIT)
        .intersection(INTERSECTION)
        .hit(FIRST_HIT)
        .callable(CALLABLE)
        .head(COMMON)
        .recursion(4)
        .bind(world)
        .bind(leaves)
        .bind(output);
    let table = Table {
        raygen: Record::of(0),
        miss: vec![Record::of(1), Record::of(1)],
        hit: [2, 2, 4, 2, 3, 3]
            .into_iter()
            .zip(0u32..)
            .map(|(group, record)| Record::with(group, &[record]))
            .collect(),
        callable: (0u32..3).map(|record| Record::with(5, &[record])).collect(),
    };
    gpu.trace(&gpu.rays(&case), &table, SIZE);
    output.read()
}

/// Instances of triangles, some of them opaque, of boxes, and of a floor; and one of triangles
/// alone.
fn worlds(gpu: &Gpu) -> (Structure, Structure) {
    let mut seed = 1u32;
    let mut next = || {
        seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (seed >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let mut triangles = |count: usize| -> Vec<[f32; 3]> {
        (0..count)
            .flat_map(|_| {
                let at = [next(), next(), next()];
                let mut corner = || at.map(|c| c + 0.3 * next());
                [corner(), corner(), corner()]
            })
            .collect()
    };
    let none = vk::GeometryFlagsKHR::empty();
    let mixed = gpu.bottom(&[
        Geometry::opaque(&triangles(150)),
        Geometry::triangles(&triangles(300), none),
    ]);
    let leaves = gpu.bottom(&[Geometry::triangles(&triangles(300), none)]);
    let boxes: Vec<[f32; 6]> = triangles(20)
        .chunks_exact(3)
        .map(|at| {
            let [x, y, z] = at[0];
            [x - 0.3, y - 0.3, z - 0.3, x + 0.3, y + 0.3, z + 0.3]
        })
        .collect();
    let boxes = gpu.bottom(&[Geometry::boxes(&boxes, none)]);
    let floor = [[-9.0, -1.5, -9.0], [0.0, -1.5, 20.0], [9.0, -1.5, -9.0]];
    let floor = gpu.bottom(&[Geometry::opaque(&floor)]);
    let placed = |structure, at, table_offset| Instance {
        transform: translated(at),
        table_offset,
        ..Instance::of(structure)
    };
    let world = gpu.top(&[
        placed(mixed, [-1.2, 0.0, 0.0], 0),
        placed(mixed, [1.2, 0.3, 1.0], 0),
        placed(boxes, [0.0, 0.0, 0.5], 4),
        placed(boxes, [0.5, 0.8, 2.0], 5),
        placed(floor, [0.0; 3], 3),
    ]);
    (world, gpu.top(&[Instance::of(leaves)]))
}

/// As compilers' options for fast mathematics make programs do at their start.
fn flush_denormals() {
    #[cfg(target_arch = "x86_64")]
    {
        // Exceptions masked, results flushed, operands too.
        let word: u32 = 0x1F80 | 1 << 15 | 1 << 6;
        // SAFETY: a valid word; nothing here computes with floats but the scene, which has no
        // denormals.
        unsafe {
            std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack, preserves_flags));
        }
    }
}
