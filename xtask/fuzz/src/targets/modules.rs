//! Modules with instructions changed, that run if they are taken.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use ash::vk;
use fastrand::Rng;
use tuff_tests::{Kernel, Stage, Table};

use crate::case::{Case, wild};
use crate::world::{World, compiled, groups, shaders};

/// Compute shaders to start from.
const SOURCES: [&str; 4] = [
    r"
    layout(local_size_x = 32) in;
    struct S { uint a[4]; vec3 v; };
    shared uint meet[32];
    shared S more[4];
    float f(vec2 x) { return x.x > 0.5 ? sin(x.y) : sqrt(x.x); }
    void main() {
        uint i = gl_GlobalInvocationID.x;
        meet[gl_LocalInvocationIndex] = i;
        barrier();
        for (uint k = 0u; k < 7u; k++) {
            switch (k % 3u) {
            case 0u: b[i + k] += meet[(i + k) & 31u]; break;
            case 1u: more[k & 3u].v = u[k].xyz * f(u[i & 63u].xy); break;
            default: more[i & 3u].a[k & 3u] = b[k * 8u];
            }
        }
        barrier();
        b[i] = more[i & 3u].a[1] + floatBitsToUint(more[i & 3u].v.y);
    }",
    r"
    layout(local_size_x = 8, local_size_y = 4) in;
    void main() {
        ivec2 at = ivec2(gl_GlobalInvocationID.xy);
        vec4 c = textureLod(t, vec2(at) * 0.1, 0.0) + texelFetch(t, at & 7, 0);
        c += imageLoad(p, at) * u[at.x & 63];
        imageStore(p, at & 7, c);
        if (c.x > 0.3) { c.y += textureGather(t, c.xy, 1).w; imageStore(p, at + 1, c.yxwz); }
        b[gl_LocalInvocationIndex] = floatBitsToUint(c.x) ^ uint(textureSize(t, 0).x + imageSize(p).y);
    }",
    r"
    #extension GL_KHR_shader_subgroup_arithmetic : require
    #extension GL_KHR_shader_subgroup_shuffle : require
    layout(local_size_x = 32) in;
    uint deep(uint n, uint x) { uint s = x; for (uint i = 0u; i < n; i++) { s = s * 3u + b[s & 255u]; if ((s & 7u) == 3u) break; } return s; }
    void main() {
        uint i = gl_LocalInvocationIndex, v[8];
        for (uint k = 0u; k < 8u; k++) v[k] = deep(k, i ^ k);
        uint x = subgroupAdd(v[i & 7u]) + subgroupShuffle(v[1], i ^ 5u);
        atomicAdd(b[i & 15u], x);
        atomicMax(b[16u + (x & 15u)], i);
        dvec2 d = dvec2(double(x), u[2].x);
        b[64u + i] = uint(d.x * d.y) + uint(int64_t(x) >> 3) + uint(v[x & 7u]);
    }",
    r"
    layout(local_size_x = 16) in;
    void main() {
        rayQueryEXT q, r;
        uint i = gl_LocalInvocationIndex;
        rayQueryInitializeEXT(q, world, i & 3u, 0xff, vec3(0.01 * i, 0.01, 0), 0.0, vec3(0, 0, 1), 50.0);
        rayQueryInitializeEXT(r, world, 0u, 0xff, vec3(0.02 * i, 0.03, 0), 0.0, vec3(0.1, 0, 1), 50.0);
        for (int k = 0; k < 20 && rayQueryProceedEXT(q); k++) {
            if (rayQueryGetIntersectionTypeEXT(q, false) == 0u) rayQueryConfirmIntersectionEXT(q);
            rayQueryProceedEXT(r);
            b[i + 16 * k] = rayQueryGetIntersectionPrimitiveIndexEXT(q, false);
        }
        if (rayQueryGetIntersectionTypeEXT(q, true) == 1u)
            b[400 + i] = floatBitsToUint(rayQueryGetIntersectionTEXT(q, true) + rayQueryGetIntersectionObjectToWorldEXT(q, true)[3].z);
    }",
];

fn kernels() -> &'static [Vec<u32>] {
    static KERNELS: OnceLock<Vec<Vec<u32>>> = OnceLock::new();
    const INTEGERS: &str = "#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require\n";
    KERNELS.get_or_init(|| {
        let all = SOURCES.map(|source| compiled(Stage::Compute, &format!("{INTEGERS}{source}")));
        all.to_vec()
    })
}

/// Where the instructions of a module begin.
fn instructions(words: &[u32]) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut at = 5;
    while at < words.len() {
        starts.push(at);
        at += (words[at] >> 16).max(1) as usize;
    }
    starts
}

/// `OpFunction`: before it all is declarations, one change of which mostly spoils the module.
const OP_FUNCTION: u32 = 54;

/// The types of results, as far as a module says so.
fn types(words: &[u32], starts: &[usize]) -> BTreeMap<u32, u32> {
    let body = starts
        .iter()
        .skip_while(|&&at| words[at] & 0xFFFF != OP_FUNCTION);
    let mut types = BTreeMap::new();
    for &at in body.chain(starts) {
        let opcode = words[at] & 0xFFFF;
        // Constants, variables, and what computes: a type and a result come first.
        let has_both = matches!(opcode, 41..=52 | 54..=61 | 65..=70 | 77..=205 | 227..=242 | 245);
        if has_both && at + 2 < words.len() {
            types.insert(words[at + 2], words[at + 1]);
        }
    }
    types
}

/// Changes a module in one place.
pub fn mutate(rng: &mut Rng, words: &mut Vec<u32>) {
    let starts = instructions(words);
    let first = starts
        .iter()
        .position(|&at| words[at] & 0xFFFF == OP_FUNCTION);
    let first = first.unwrap_or(0);
    let from = if rng.u32(0..8) == 0 { 0 } else { first };
    let index = rng.usize(from..starts.len());
    let at = starts[index];
    let length = ((words[at] >> 16).max(1) as usize).min(words.len() - at);
    let operand = |rng: &mut Rng| at + rng.usize(1.min(length - 1)..length);
    match rng.u32(0..12) {
        // Another value of the same type.
        0..=6 => {
            let types = types(words, &starts);
            let place = operand(rng);
            let Some(ty) = types.get(&words[place]) else {
                return;
            };
            let alike: Vec<u32> = (types.iter())
                .filter(|(_, other)| *other == ty)
                .map(|(id, _)| *id)
                .collect();
            words[place] = alike[rng.usize(0..alike.len())];
        }
        7 => {
            let place = operand(rng);
            words[place] = rng.u32(0..words[3].max(1));
        }
        // Another instruction of the same length.
        8 => {
            let other = starts[rng.usize(first..starts.len())];
            if words[other] >> 16 == words[at] >> 16 {
                words[at] = words[other];
            }
        }
        9 => {
            let place = operand(rng);
            words[place] = wild(rng) as u32;
        }
        10 => {
            words.drain(at..at + length);
        }
        _ => {
            let mut copy: Vec<u32> = words[at..at + length].to_vec();
            if length > 2 && types(words, &starts).contains_key(&copy[2]) {
                // A value of its own, which takes the place of another now and then.
                (copy[2], words[3]) = (words[3], words[3] + 1);
            }
            let to = starts[rng.usize(first..starts.len())];
            words.splice(to..to, copy);
        }
    }
}

pub fn run(world: &World, case: &Case) {
    let mut rng = case.common();
    match rng.u32(0..4) {
        0 => run_rays(world, case, &mut rng),
        _ => run_kernel(world, case, &mut rng),
    }
}

fn run_kernel(world: &World, case: &Case, rng: &mut Rng) {
    let kernels = kernels();
    let mut words = kernels[rng.usize(0..kernels.len())].clone();
    case.steps()
        .take(6)
        .for_each(|mut rng| mutate(&mut rng, &mut words));
    let constants = vk::SpecializationInfo::default();
    let made = (world.gpu).try_kernel(&words, c"main", world.layout, &constants);
    if let Ok(pipeline) = made {
        let kernel = Kernel {
            pipeline,
            layout: world.layout,
        };
        let push = [rng.u32(..), rng.u32(..), rng.u32(..)];
        world.run(|commands| {
            (world.gpu).record_dispatch(commands, kernel, &[world.set], &push, [2, 1, 1]);
        });
    }
}

/// One of the shaders of a pipeline is changed.
fn run_rays(world: &World, case: &Case, rng: &mut Rng) {
    let mut all = shaders().to_vec();
    let which = rng.usize(0..all.len());
    case.steps()
        .take(6)
        .for_each(|mut rng| mutate(&mut rng, &mut all[which].1));
    let made = world.gpu.try_rays(&all, &groups(), 1, world.layout);
    if let Ok(pipeline) = made {
        let rays = (world.gpu).rays_of(pipeline, world.layout, world.set, groups().len());
        let regions = world.gpu.regions(&rays, &Table::of(0, &[1], &[2]));
        world.run(|commands| {
            (world.gpu).record_trace(commands, &rays, &regions, [20, 2, 1]);
        });
    }
}
