//! Ray queries, which look at micromaps in the execution mode `OpacityMicromapIdKHR`, and with the
//! EXT extension without one.

use super::copies::motley;
use super::*;

/// A query at each point; the constant 3 may be the operand of the mode.
const SOURCE: &str = r"
#extension GL_EXT_ray_query : enable
layout(local_size_x = 16) in;
layout(constant_id = 3) const bool enable = true;
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer P { vec2 points[]; };
layout(set = 0, binding = 2, std430) buffer R { uint results[]; };
void main() {
    uint i = gl_LocalInvocationIndex;
    rayQueryEXT q;
    rayQueryInitializeEXT(q, world, gl_RayFlagsSkipAABBEXT, 0xff, vec3(points[i], 1), 0.0,
        vec3(0, 0, -1), 2.0);
    uint found = 0;
    while (rayQueryProceedEXT(q)) found = 1;
    if (rayQueryGetIntersectionTypeEXT(q, true) == gl_RayQueryCommittedIntersectionTriangleEXT)
        found = 2;
    results[i] = found;
    results[16 + i] = rayQueryGetRayFlagsEXT(q) + (enable ? 0x10000 : 0);
}";

/// A module whose entry point has the execution mode, by the constant whose `SpecId` is 3.
fn with_mode(words: &[u32]) -> Vec<u32> {
    const CAPABILITY: u32 = 17;
    const EXTENSION: u32 = 10;
    const EXECUTION_MODE: u32 = 16;
    const EXECUTION_MODE_ID: u32 = 331;
    const DECORATE: u32 = 71;
    const SPEC_ID: u32 = 1;
    let mut instructions = Vec::new();
    let mut rest = &words[5..];
    while let Some(&first) = rest.first() {
        let (instruction, after) = rest.split_at((first >> 16) as usize);
        instructions.push(instruction);
        rest = after;
    }
    let is = |opcode: u32| move |it: &&&[u32]| it[0] & 0xffff == opcode;
    let mut decorations = instructions.iter().filter(is(DECORATE));
    let constant = decorations.find(|it| it[2..] == [SPEC_ID, 3]);
    let constant = constant.expect("the constant")[1];
    let modes = instructions.iter().position(|it| is(EXECUTION_MODE)(&it));
    let modes = modes.expect("a mode");
    let function = instructions[modes][1];
    let capabilities = instructions.iter().filter(is(CAPABILITY)).count();

    let mut name = *b"SPV_KHR_opacity_micromap\0\0\0\0";
    let name = name
        .as_chunks_mut::<4>()
        .0
        .iter()
        .map(|it| u32::from_le_bytes(*it));
    let mut out = words[..5].to_vec();
    for (index, instruction) in instructions.iter().enumerate() {
        if index == capabilities {
            out.extend([2 << 16 | CAPABILITY, 6032, 8 << 16 | EXTENSION]);
            out.extend(name.clone());
        }
        out.extend_from_slice(instruction);
        if index == modes {
            out.extend([4 << 16 | EXECUTION_MODE_ID, function, 6031, constant]);
        }
    }
    out
}

/// The outcome of each query; `mode` is the value of the mode's constant.
fn queried(gpu: &Gpu, world: Structure, mode: Option<bool>) -> Vec<u32> {
    let plain = glsl(Stage::Compute, SOURCE);
    let words = match mode {
        Some(_) => with_mode(&plain),
        None => plain,
    };
    let results = gpu.buffer(128);
    let points = gpu.buffer_with(&part_centres(2));
    let set = gpu.set(&[
        (0, &[Bound::Structure(world.handle)]),
        (1, &[Bound::Storage(points)]),
        (2, &[Bound::Storage(results)]),
    ]);
    let enable = u32::from(mode.unwrap_or(true)).to_le_bytes();
    let entries = [vk::SpecializationMapEntry::default().constant_id(3).size(4)];
    let constants = vk::SpecializationInfo::default()
        .map_entries(&entries)
        .data(&enable);
    let layout = gpu.layout(&[set.layout]);
    let made = gpu.try_kernel(&words, c"main", layout, &constants);
    let pipeline = made.expect("vkCreateComputePipelines");
    let kernel = Kernel { pipeline, layout };
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    let found: Vec<u32> = results.read();
    // The flags are those that the shader gave.
    let constant = match mode {
        Some(false) => 0,
        _ => 0x10000,
    };
    assert_eq!(found[16..], [0x200 + constant; 16]);
    found[..16].to_vec()
}

#[test]
fn queries_look_at_micromaps_in_the_mode() {
    let without_ext = Gpu::without(c"VK_EXT_opacity_micromap");
    for gpu in [Some(without_ext), gpu_with_micromaps()] {
        let Some(gpu) = gpu.and_then(|gpu| {
            gpu.with("VK_KHR_opacity_micromap and VK_KHR_ray_query", |gpu| {
                has_khr(gpu) && gpu.optional.ray_query.ray_query != 0
            })
        }) else {
            return;
        };
        let has_ext = gpu.optional.micromap.micromap != 0;
        let (micromap, expected) = motley(&gpu, MicromapForm::Khr);
        let structure = bottom(&gpu, 1, &Use::of(&micromap), Flags::empty());
        let world = gpu.top(&[Instance::of(structure)]);
        assert_eq!(queried(&gpu, world, Some(true)), expected, "{has_ext}");
        if has_ext {
            assert_eq!(queried(&gpu, world, None), expected);
            let (micromap, expected) = motley(&gpu, MicromapForm::Ext);
            let structure = bottom(&gpu, 1, &Use::of(&micromap), Flags::empty());
            let world = gpu.top(&[Instance::of(structure)]);
            assert_eq!(queried(&gpu, world, None), expected);
        }
        // Not valid with such a structure: Tuff goes by the geometry's flags, as if there were no
        // micromap.
        if gpu.is_tuff() {
            assert_eq!(queried(&gpu, world, Some(false)), [ASKED; 16], "{has_ext}");
            if !has_ext {
                assert_eq!(queried(&gpu, world, None), [ASKED; 16]);
            }
        }
    }
}
