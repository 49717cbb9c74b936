//! Operations by themselves: a compute kernel for each operation, width and kind of memory, and a
//! few kernels of many operations, as programs have them.
//!
//! Every kernel is made of the same frame: an invocation a pixel starts from its number, repeats
//! the operation in a loop, and writes what came out as its pixel, by which drivers are held
//! against each other. Values that depend on the size of subgroups, or on the order of
//! invocations, are multiplied by a zero that compilers cannot see.

use tuff_tests::{Bound, Gpu, Picture, Shape, Stage, vk};

use crate::shader;
use crate::workload::{Prepared, borrowed};
use crate::world::{Scale, World};

/// Turns of each kernel's loop.
const TURNS: u32 = 32;
/// How often a turn repeats the operation.
const REPEATS: usize = 4;
/// Words of the buffer that kernels read, and of the one that they write: a power of two.
const WORDS: u32 = 1 << 20;
/// Texels of an image's side: a power of two.
const SIDE: u32 = 512;

/// The feature that a kernel needs of a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Need {
    Nothing,
    Int8,
    Int16,
    Int64,
    Half,
    Double,
    Int64Atomics,
    FloatAtomics,
}

impl Need {
    fn is_met(self, gpu: &Gpu) -> bool {
        let has = match self {
            Need::Nothing => vk::TRUE,
            Need::Int8 => gpu.features12.shader_int8 & gpu.features12.storage_buffer8_bit_access,
            Need::Int16 => gpu.features.shader_int16 & gpu.features11.storage_buffer16_bit_access,
            Need::Int64 => gpu.features.shader_int64,
            Need::Half => {
                gpu.features12.shader_float16 & gpu.features11.storage_buffer16_bit_access
            }
            Need::Double => gpu.features.shader_float64,
            Need::Int64Atomics => gpu.features12.shader_buffer_int64_atomics,
            Need::FloatAtomics => gpu.optional.float_atomics.shader_buffer_float32_atomic_add,
        };
        has == vk::TRUE
    }
}

/// A kernel.
#[derive(Clone, Copy)]
pub struct Operation {
    pub name: &'static str,
    need: Need,
    /// Invocations of a workgroup.
    local: u32,
    /// The image's format, where there is one.
    image: Option<(&'static str, vk::Format)>,
    declarations: &'static str,
    /// Before the loop.
    start: &'static str,
    turn: &'static str,
    /// How often a turn repeats it.
    repeats: usize,
    /// A float that shows the result.
    value: &'static str,
}

/// An operation on values, with nothing else around it.
const fn plain(
    name: &'static str,
    need: Need,
    start: &'static str,
    turn: &'static str,
    value: &'static str,
) -> Operation {
    Operation {
        name,
        need,
        local: 64,
        image: None,
        declarations: "",
        start,
        turn,
        repeats: REPEATS,
        value,
    }
}

impl Operation {
    /// With declarations, and in workgroups of so many invocations.
    const fn with(self, local: u32, declarations: &'static str) -> Operation {
        Operation {
            local,
            declarations,
            ..self
        }
    }

    const fn on_image(self, layout: &'static str, format: vk::Format) -> Operation {
        Operation {
            image: Some((layout, format)),
            ..self
        }
    }

    /// A turn holds the operation once.
    const fn once(self) -> Operation {
        Operation { repeats: 1, ..self }
    }
}

const FLOATS: &str = "float x = unit(seed), y = 0.5 + 0.4 * unit(hash(seed)), z = unit(number);";
const WORD: &str = "uint x = seed, y = hash(seed), z = number * 77u + 5u;";
const HALVES: &str = "float16_t x = float16_t(unit(seed)), y = float16_t(0.5 + 0.25 * unit(hash(seed))), z = float16_t(0.25);";
const DOUBLES: &str =
    "double x = double(unit(seed)), y = 0.5 + 0.4 * double(unit(hash(seed))), z = 0.3;";
const LONGS: &str =
    "uint64_t x = (uint64_t(seed) << 32) | number, y = uint64_t(hash(seed)) * 99991ul, z = 77ul;";
const SHORTS: &str = "uint16_t x = uint16_t(seed), y = uint16_t(hash(seed)), z = uint16_t(number);";
const BYTES: &str = "uint8_t x = uint8_t(seed), y = uint8_t(hash(seed)), z = uint8_t(number);";
const SUM: &str = "uint x = seed, sum = 0u;";

/// Of a float, an integer, the upper half of a long one (drivers compute no more than is read), and
/// an integer that drivers may differ in.
const FLOAT: &str = "float(x)";
const INT: &str = "float(uint(x) & 0xffffu) / 65536.0";
const LONG: &str = "float(uint(x >> 32) & 0xffffu) / 65536.0";
const HIDDEN: &str = "unit(x) + float(sum & 0xffffu) * zero";

const NONE: Need = Need::Nothing;

const WORKGROUP: &str = "shared uint cells[256];";
const GRID: &str = "shared float left[32 * 32], right[32 * 32];";
const LARGE_GRID: &str = "shared float left[64 * 16], right[16 * 64];";

/// All of them, in the order of the report.
pub static ALL: &[Operation] = &[
    plain("f32 add", NONE, FLOATS, "x += y; x = z - x;", FLOAT),
    plain("f32 mul", NONE, FLOATS, "x *= y; x *= 1.5;", FLOAT),
    plain("f32 fma", NONE, FLOATS, "x = fma(x, y, z);", FLOAT),
    plain("f32 div", NONE, FLOATS, "x = y / (x + 1.0);", FLOAT),
    plain("f32 sqrt", NONE, FLOATS, "x = sqrt(x + z);", FLOAT),
    plain("f32 fract", NONE, FLOATS, "x = fract(x * 1.75 + z);", FLOAT),
    plain("f32 select", NONE, FLOATS, "x = x < z ? x + y : x - y;", FLOAT),
    plain("f32 sin", NONE, FLOATS, "x = sin(x + y);", FLOAT),
    plain("f32 exp2", NONE, FLOATS, "x = exp2(-x);", FLOAT),
    plain("f32 log2", NONE, FLOATS, "x = log2(2.0 + abs(x));", FLOAT),
    plain("f32 pow", NONE, FLOATS, "x = pow(x + y, 0.75);", FLOAT),
    plain("i32 add", NONE, WORD, "x += y; y -= x;", INT),
    plain("i32 mul", NONE, WORD, "x = x * y + z;", INT),
    plain("i32 div", NONE, WORD, "x = y / ((x & 255u) + 1u) + z;", INT),
    plain("i32 shift", NONE, WORD, "x = (x << 3) ^ (x >> 5) ^ y;", INT),
    plain("i32 min", NONE, WORD, "x = min(x + y, z) + x;", INT),
    plain("i32 bit count", NONE, WORD, "x = y + uint(bitCount(x)); y ^= x;", INT),
    plain("i32 highest bit", NONE, WORD, "x = y + uint(findMSB(x)); y ^= x << 9;", INT),
    plain("i8 add mul", Need::Int8, BYTES, "x = x * y + z; y += x;", INT),
    plain("i16 add mul", Need::Int16, SHORTS, "x = x * y + z; y += x;", INT),
    plain("i64 add", Need::Int64, LONGS, "x += y; y -= x;", LONG),
    plain("i64 mul", Need::Int64, LONGS, "x = x * y + z;", LONG),
    plain("i64 shift", Need::Int64, LONGS, "x = (x << 7) ^ (x >> 9) ^ y;", LONG),
    plain("f16 add", Need::Half, HALVES, "x += y; x = z - x;", FLOAT),
    plain("f16 fma", Need::Half, HALVES, "x = fma(x, y, z);", FLOAT),
    plain("f16 div", Need::Half, HALVES, "x = y / (x + z);", FLOAT),
    plain("f16 sqrt", Need::Half, HALVES, "x = sqrt(x + z);", FLOAT),
    plain("f16 to f32", Need::Half, HALVES, "x = float16_t(float(x) * 0.75 + 0.125);", FLOAT),
    plain("f64 add", Need::Double, DOUBLES, "x += y; x = z - x;", FLOAT),
    plain("f64 fma", Need::Double, DOUBLES, "x = fma(x, y, z);", FLOAT),
    plain("f64 div", Need::Double, DOUBLES, "x = y / (x + 1.0);", FLOAT),
    plain("f64 sqrt", Need::Double, DOUBLES, "x = sqrt(x + z);", FLOAT),
    plain("f32 to i32", NONE, FLOATS, "x = unit(uint(x * 65536.0) * 40503u);", FLOAT),
    plain(
        "divergent if",
        NONE,
        WORD,
        "if ((x & 1u) != 0u) { x = x * 3u + y; } else { x = (x >> 1) ^ z; }",
        INT,
    ),
    plain(
        "divergent loop",
        NONE,
        WORD,
        "for (uint k = x & 7u; k > 0u; k--) { x = x * 5u + y; }",
        INT,
    ),
    plain(
        "switch",
        NONE,
        WORD,
        "switch (x & 7u) {
            case 0u: x += y; break; case 1u: x ^= z; break;
            case 2u: x *= 5u; break; case 3u: x -= y; break;
            case 4u: x = x << 1 | 1u; break; case 5u: x = ~x; break;
            case 6u: x = x * z + 1u; break; default: x += 3u; }",
        INT,
    ),
    plain("call", NONE, WORD, "x = twist(x, y);", INT)
        .with(64, "uint twist(uint a, uint b) { if (a > b) return a - b; return a * 3u + b; }"),
    plain("load u32 at one place", NONE, WORD, "x += data[turn * 7u & MASK];", INT),
    plain("load u32 a run", NONE, WORD, "x += data[number + turn * 64u & MASK];", INT),
    plain("load u32 apart", NONE, WORD, "x = x * 5u + data[x & MASK];", INT),
    plain("load uvec4 a run", NONE, WORD, "x += quads[number + turn * 64u & MASK / 4u].z;", INT),
    plain(
        "load uvec4 apart",
        NONE,
        WORD,
        "{ uvec4 v = quads[x & MASK / 4u]; x = x * 5u + v.x + v.y * v.z + v.w; }",
        INT,
    ),
    plain("load u8 apart", Need::Int8, WORD, "x = x * 5u + uint(bytes[x & MASK]);", INT),
    plain("load u16 apart", Need::Int16, WORD, "x = x * 5u + uint(shorts[x & MASK]);", INT),
    plain("load u64 apart", Need::Int64, LONGS, "x = x * 5ul + longs[uint(x) & MASK / 2u];", INT),
    plain(
        "store u32 a run",
        NONE,
        WORD,
        "x = x * 5u + 1u; written[number + turn * COUNT & MASK] = x;",
        INT,
    ),
    plain("store u32 apart", NONE, WORD, "x = x * 5u + 1u; written[x & MASK] = x;", INT),
    plain(
        "store uvec4 a run",
        NONE,
        WORD,
        "x = x * 5u + 1u; written_quads[number + turn * COUNT & MASK / 4u] = uvec4(x, y, z, x);",
        INT,
    ),
    plain("store u8 a run", Need::Int8, WORD, "x = x * 5u + 1u; written_bytes[number] = uint8_t(x);", INT),
    plain("uniform load", NONE, FLOATS, "x = fma(x, constants[turn & 31u].x, y);", FLOAT),
    plain("private array", NONE, "uint x = seed; uint a[16]; for (uint k = 0u; k < 16u; k++) a[k] = x + k;", "a[x & 15u] += x; x = x * 5u + a[x >> 8 & 15u];", INT),
    plain("workgroup load", NONE, "uint x = seed; cells[local] = seed; barrier();", "x = x * 5u + cells[x >> 8 & 63u];", INT)
        .with(64, WORKGROUP),
    plain("workgroup two barriers", NONE, WORD, "cells[local] = x; barrier(); x = x * 5u + cells[(local + turn) & 255u]; barrier();", INT)
        .with(256, WORKGROUP)
        .once(),
    plain("workgroup of 1024 two barriers", NONE, WORD, "cells[local] = x; barrier(); x = x * 5u + cells[(local + turn) & 1023u]; barrier();", INT)
        .with(1024, "shared uint cells[1024];")
        .once(),
    plain("atomic add workgroup", NONE, SUM, "sum += atomicAdd(cells[x & 7u], x); x = x * 5u + 1u;", HIDDEN)
        .with(64, WORKGROUP),
    plain("atomic add at one place", NONE, SUM, "sum += atomicAdd(written[0], x); x = x * 5u + 1u;", HIDDEN),
    plain("atomic add apart", NONE, SUM, "sum += atomicAdd(written[x & MASK], x); x = x * 5u + 1u;", HIDDEN),
    plain("atomic min at one place", NONE, SUM, "sum += atomicMin(written[0], x); x = x * 5u + 1u;", HIDDEN),
    plain("atomic exchange apart", NONE, SUM, "sum += atomicExchange(written[x & MASK], x); x = x * 5u + 1u;", HIDDEN),
    plain("atomic compare apart", NONE, SUM, "sum += atomicCompSwap(written[x & MASK], turn, x); x = x * 5u + 1u;", HIDDEN),
    plain("atomic u64 add apart", Need::Int64Atomics, SUM, "sum += uint(atomicAdd(written_longs[x & MASK / 2u], uint64_t(x))); x = x * 5u + 1u;", HIDDEN),
    plain("atomic f32 add at one place", Need::FloatAtomics, SUM, "atomicAdd(written_floats[0], unit(x)); x = x * 5u + 1u;", HIDDEN),
    plain("atomic f32 add apart", Need::FloatAtomics, SUM, "atomicAdd(written_floats[x & MASK], unit(x)); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup add u32", NONE, SUM, "sum += subgroupAdd(x); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup add f32", NONE, SUM, "sum += uint(subgroupAdd(unit(x))); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup min u32", NONE, SUM, "sum += subgroupMin(x); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup scan u32", NONE, SUM, "sum += subgroupInclusiveAdd(x); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup scan f32", NONE, SUM, "sum += uint(subgroupExclusiveAdd(unit(x))); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup clusters of 4", NONE, WORD, "x = x * 5u + subgroupClusteredAdd(x, 4u);", INT),
    plain("subgroup ballot", NONE, SUM, "sum += subgroupBallot((x & 16u) != 0u).x; x = x * 5u + 1u;", HIDDEN),
    plain("subgroup any", NONE, SUM, "sum += subgroupAny((x & 240u) == 0u) ? 1u : 0u; x = x * 5u + 1u;", HIDDEN),
    plain("subgroup broadcast", NONE, SUM, "sum += subgroupBroadcastFirst(x); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup shuffle", NONE, SUM, "sum += subgroupShuffle(x, x >> 9 & 3u); x = x * 5u + 1u;", HIDDEN),
    plain("subgroup shuffle xor", NONE, WORD, "x = x * 5u + subgroupShuffleXor(x, 2u);", INT),
    plain("quad broadcast", NONE, WORD, "x = x * 5u + subgroupQuadBroadcast(x, 1u);", INT),
    plain("image load rgba8", NONE, FLOATS, "x += imageLoad(texels, at(number + turn)).y * 0.1;", FLOAT)
        .on_image("rgba8", vk::Format::R8G8B8A8_UNORM),
    plain("image load rgba16f", NONE, FLOATS, "x += imageLoad(texels, at(number + turn)).y * 0.1;", FLOAT)
        .on_image("rgba16f", vk::Format::R16G16B16A16_SFLOAT),
    plain("image load r32f", NONE, FLOATS, "x += imageLoad(texels, at(number + turn)).x * 0.1;", FLOAT)
        .on_image("r32f", vk::Format::R32_SFLOAT),
    plain("image load rgba32f apart", NONE, "uint x = seed; float sum = 0.0;", "sum += imageLoad(texels, at(x)).y * 0.1; x = x * 5u + 1u;", "unit(x) + sum")
        .on_image("rgba32f", vk::Format::R32G32B32A32_SFLOAT),
    plain("image store rgba8", NONE, FLOATS, "x = fma(x, y, 0.1); imageStore(texels, at(number), vec4(x, y, z, 1.0));", FLOAT)
        .on_image("rgba8", vk::Format::R8G8B8A8_UNORM),
    plain("image store rgba16f", NONE, FLOATS, "x = fma(x, y, 0.1); imageStore(texels, at(number), vec4(x, y, z, 1.0));", FLOAT)
        .on_image("rgba16f", vk::Format::R16G16B16A16_SFLOAT),
    plain("image atomic apart", NONE, SUM, "sum += imageAtomicAdd(texels, at(x), x); x = x * 5u + 1u;", HIDDEN)
        .on_image("r32ui", vk::Format::R32_UINT),
    plain(
        "matrix product small tiles",
        NONE,
        "float s[32]; for (uint k = 0u; k < 32u; k++) s[k] = 0.0;",
        "for (uint k = 0u; k < 32u; k++) {
            left[k * 32u + local] = unit(data[turn * 8192u + k * 32u + local + group * 64u & MASK]);
            right[k * 32u + local] = unit(data[turn * 4096u + k * 32u + local & MASK]);
        }
        barrier();
        for (uint k = 0u; k < 32u; k++) {
            float a = left[k * 32u + local];
            for (uint n = 0u; n < 32u; n++) s[n] = fma(a, right[k * 32u + n], s[n]);
        }
        barrier();",
        "(s[0] + s[13] + s[31]) / 768.0",
    )
    .with(32, GRID)
    .once(),
    plain(
        "matrix product large tiles",
        NONE,
        "float s[32]; for (uint k = 0u; k < 32u; k++) s[k] = 0.0;
        const uint row = local / 16u * 4u, column = local % 16u * 4u;",
        "for (uint k = local; k < 1024u; k += 128u) {
            left[k] = unit(data[turn * 8192u + k + group * 64u & MASK]);
            right[k] = unit(data[turn * 4096u + k & MASK]);
        }
        barrier();
        for (uint k = 0u; k < 16u; k++) {
            for (uint m = 0u; m < 4u; m++) for (uint half_of = 0u; half_of < 2u; half_of++) {
                float a = left[(row + m + 32u * half_of) * 16u + k];
                for (uint n = 0u; n < 4u; n++) {
                    s[half_of * 16u + m * 4u + n] = fma(a, right[k * 64u + column + n], s[half_of * 16u + m * 4u + n]);
                }
            }
        }
        barrier();",
        "(s[0] + s[13] + s[31]) / 384.0",
    )
    .with(128, LARGE_GRID)
    .once(),
    plain(
        "reduction",
        NONE,
        WORD,
        "cells[local] = data[number + turn * 256u & MASK] >> 8;
        for (uint k = 128u; k > 0u; k >>= 1) {
            barrier();
            if (local < k) cells[local] += cells[local + k];
        }
        barrier();
        x = x * 5u + cells[0];
        barrier();",
        INT,
    )
    .with(256, WORKGROUP)
    .once(),
    plain(
        "scan",
        NONE,
        WORD,
        "cells[local] = data[number + turn * 256u & MASK] >> 8;
        barrier();
        for (uint k = 1u; k < 256u; k <<= 1) {
            uint before = local >= k ? cells[local - k] : 0u;
            barrier();
            cells[local] += before;
            barrier();
        }
        x = x * 5u + cells[local];
        barrier();",
        INT,
    )
    .with(256, WORKGROUP)
    .once(),
    plain(
        "particles",
        Need::FloatAtomics,
        "vec3 x = vec3(unit(seed), unit(seed >> 3), unit(seed >> 7)), v = x.yzx - 0.5;",
        "v += 0.01 * (0.5 - x);
        x = fract(x + 0.01 * v);
        uvec3 cell = uvec3(x * 32.0);
        atomicAdd(written_floats[cell.x + 32u * cell.y + 1024u * cell.z], v.x * v.x);",
        "x.x",
    ),
];

/// The kernel of this name.
pub fn named(name: &str) -> Option<&'static Operation> {
    ALL.iter().find(|operation| operation.name == name)
}

impl Operation {
    fn source(&self, count: u32) -> String {
        let Operation {
            local,
            declarations,
            start,
            value,
            ..
        } = self;
        let turn = format!("{{ {} }}\n", self.turn).repeat(self.repeats);
        let atomics = match self.need {
            Need::Int64Atomics => "#extension GL_EXT_shader_atomic_int64 : require",
            Need::FloatAtomics => "#extension GL_EXT_shader_atomic_float : require",
            _ => "",
        };
        let extensions = match self.need {
            Need::Int8 => INT8,
            Need::Int16 => INT16,
            Need::Int64 | Need::Int64Atomics => INT64,
            Need::Half => HALF,
            Need::FloatAtomics => FLOAT_BUFFERS,
            Need::Nothing | Need::Double => "",
        };
        let image = self.image.map_or_else(String::new, |(layout, _)| {
            let kind = if layout.ends_with("ui") { "u" } else { "" };
            format!(
                "layout(binding = 4, {layout}) uniform {kind}image2D texels;
                ivec2 at(uint n) {{ return ivec2(n & {mask}u, n >> 9 & {mask}u); }}",
                mask = SIDE - 1
            )
        });
        format!(
            "#extension GL_KHR_shader_subgroup_basic : require
            #extension GL_KHR_shader_subgroup_arithmetic : require
            #extension GL_KHR_shader_subgroup_clustered : require
            #extension GL_KHR_shader_subgroup_ballot : require
            #extension GL_KHR_shader_subgroup_shuffle : require
            #extension GL_KHR_shader_subgroup_vote : require
            #extension GL_KHR_shader_subgroup_quad : require
            {atomics}
            {extensions}
            layout(local_size_x = {local}) in;
            layout(binding = 0) buffer Result {{ vec4 result[]; }};
            layout(binding = 1) readonly buffer Data {{ uint data[]; }};
            layout(binding = 1) readonly buffer Quads {{ uvec4 quads[]; }};
            layout(binding = 2) buffer Written {{ uint written[]; }};
            layout(binding = 2) buffer WrittenQuads {{ uvec4 written_quads[]; }};
            layout(binding = 3) uniform Constants {{ vec4 constants[32]; float zero; }};
            {image}
            const uint MASK = {mask}u, COUNT = {count}u;
            uint hash(uint x) {{
                x = (x ^ (x >> 16)) * 0x7feb352du;
                x = (x ^ (x >> 15)) * 0x846ca68bu;
                return x ^ (x >> 16);
            }}
            float unit(uint x) {{ return float(x >> 8) / 16777216.0; }}
            {declarations}
            void main() {{
                const uint number = gl_GlobalInvocationID.x;
                const uint local = gl_LocalInvocationIndex;
                const uint group = gl_WorkGroupID.x;
                const uint seed = hash(number);
                {start}
                for (uint turn = 0u; turn < {TURNS}u; turn++) {{ {turn} }}
                result[number] = vec4({value}, 0.0, 0.0, 1.0);
            }}",
            mask = WORDS - 1,
        )
    }

    /// Prepares a turn: a dispatch of one invocation a pixel. `None` where the driver lacks what
    /// the operation needs.
    pub fn prepare(&self, gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
        if !self.need.is_met(gpu) {
            return None;
        }
        let count = scale.width * scale.height / self.local * self.local;
        let words: Vec<u32> = (0..WORDS).map(mixed).collect();
        let data = gpu.buffer_with(&words);
        let written = gpu.buffer_with(&vec![0u32; WORDS as usize]);
        let mut constants = vec![0.5f32; 4 * 32];
        constants.extend([0.0; 4]);
        let constants = gpu.buffer_with(&constants);
        let world = World::least(gpu, scale);
        let mut bindings = vec![
            (0, [Bound::Storage(world.out)]),
            (1, [Bound::Storage(data)]),
            (2, [Bound::Storage(written)]),
            (3, [Bound::Uniform(constants)]),
        ];
        if let Some((_, format)) = self.image {
            let features = match format {
                vk::Format::R32_UINT => vk::FormatFeatureFlags::STORAGE_IMAGE_ATOMIC,
                _ => vk::FormatFeatureFlags::STORAGE_IMAGE,
            };
            if !gpu.supports(format, features) {
                return None;
            }
            let usage = vk::ImageUsageFlags::STORAGE;
            let picture = gpu.picture(Shape::flat(format, SIDE, SIDE), usage);
            fill(gpu, &picture, format);
            bindings.push((4, [Bound::StorageImage(picture.view)]));
        }
        let set = gpu.set(&borrowed(&bindings));
        let words = shader::glsl(Stage::Compute, &self.source(count));
        let kernel = gpu.kernel_of(&words, &[set.layout]);
        let turn = gpu.record(|commands| {
            gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], [count / self.local, 1, 1]);
            gpu.barrier(commands);
        });
        let mut prepared = Prepared::picture(turn, &world);
        let operations = TURNS as usize * self.repeats;
        prepared.work = Some(f64::from(count) * operations as f64);
        Some(prepared)
    }
}

/// A number with all of its bits mixed.
pub fn mixed(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Texels whose numbers are finite in every format: bytes below 60.
fn fill(gpu: &Gpu, picture: &Picture, format: vk::Format) {
    let texel_bytes = match format {
        vk::Format::R16G16B16A16_SFLOAT => 8,
        vk::Format::R32G32B32A32_SFLOAT => 16,
        _ => 4,
    };
    let bytes = SIDE * SIDE * texel_bytes;
    let texels: Vec<u8> = (0..bytes).map(|at| (mixed(at) % 60) as u8).collect();
    gpu.upload(picture, 0, &texels);
}

const INT8: &str = "#extension GL_EXT_shader_explicit_arithmetic_types_int8 : require
    #extension GL_EXT_shader_8bit_storage : require
    layout(binding = 1) readonly buffer Bytes { uint8_t bytes[]; };
    layout(binding = 2) buffer WrittenBytes { uint8_t written_bytes[]; };";
const INT16: &str = "#extension GL_EXT_shader_explicit_arithmetic_types_int16 : require
    #extension GL_EXT_shader_16bit_storage : require
    layout(binding = 1) readonly buffer Shorts { uint16_t shorts[]; };";
const INT64: &str = "#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
    layout(binding = 1) readonly buffer Longs { uint64_t longs[]; };
    layout(binding = 2) buffer WrittenLongs { uint64_t written_longs[]; };";
const HALF: &str = "#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require";
const FLOAT_BUFFERS: &str = "layout(binding = 2) buffer WrittenFloats { float written_floats[]; };";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_compile_and_have_names_of_their_own() {
        for operation in ALL {
            let found = named(operation.name).unwrap();
            assert!(std::ptr::eq(found, operation), "{}", operation.name);
            let words = shader::glsl(Stage::Compute, &operation.source(57_600));
            assert!(!words.is_empty(), "{}", operation.name);
        }
    }
}
