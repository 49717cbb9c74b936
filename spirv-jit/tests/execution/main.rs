//! Compute shaders run through the whole compiler and compared with the same computation in Rust.

mod control;
mod memory;

use shaders::compute::{Memory, check, compile, compile_as, dispatch};
use shaders::{glsl, request};
use spirv_jit::CompileRequest;
use spirv_jit::program::Stage;

fn ramp() -> Vec<u32> {
    (0..64).collect()
}

/// Words of all kinds: small, large, negative, bit patterns.
fn words() -> Vec<u32> {
    let mut state = 0x9e37_79b9u32;
    let mut out: Vec<u32> = vec![0, 1, 2, 31, 32, 0x7fff_ffff, 0x8000_0000, u32::MAX];
    while out.len() < 64 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        out.push(state);
    }
    out
}

/// Floats without surprises, as bits.
fn floats() -> Vec<u32> {
    (0..64).map(|i| (i as f32 * 0.37 - 9.1).to_bits()).collect()
}

#[test]
fn integer_arithmetic() {
    check(
        "",
        "int s = int(x); uint y = x * 2654435761u + 12345u; int t = int(y);
         uint c, hi, lo; int shi, slo;
         r = uaddCarry(x, y, c); r ^= c << 7; r ^= usubBorrow(x, y, c); r ^= c << 9;
         umulExtended(x, y, hi, lo); r ^= hi ^ (lo >> 1); imulExtended(s, t, shi, slo); r ^= uint(shi) * 3u;
         r += uint(bitCount(x)) + uint(findLSB(x)) * 5u + uint(findMSB(s)) * 7u + uint(findMSB(x)) * 11u;
         r ^= bitfieldReverse(x) + bitfieldExtract(x, 5, 9) + uint(bitfieldExtract(s, 20, 12)) + bitfieldInsert(x, y, 4, 11);
         r += uint(max(s, t)) ^ min(x, y) ^ uint(abs(s)) ^ uint(sign(t)) ^ uint(clamp(s, -100, 100));
         r ^= (x << (y & 31u)) + (x >> 3) + uint(s >> 5);
         if (y != 0u) r += x / y + x % y + uint(s / 77) + uint(t / -3);
         r += uint(s < t) + (uint(x < y) << 1) + (uint(s >= 0) << 2);
         int64_t w = int64_t(s) * int64_t(t) + 5l; uint64_t v = (uint64_t(x) << 32) | y;
         r ^= uint(w >> 13) + uint(v / 1000003ul) + uint(w % 97l == 3l) + uint(v >> 40);
         int16_t h = int16_t(x); uint8_t b = uint8_t(y); h = h * int16_t(3) + int16_t(b); b += uint8_t(h);
         r += uint(int(h)) ^ uint(b) ^ uint(h > int16_t(100)) ^ pack32(unpack16(x)) ^ uint(unpack8(y).y);",
        &words(),
        |_, x| {
            let s = x as i32;
            let y = x.wrapping_mul(2_654_435_761).wrapping_add(12_345);
            let t = y as i32;
            let mut r = x.wrapping_add(y);
            r ^= (x.checked_add(y).is_none() as u32) << 7;
            r ^= x.wrapping_sub(y);
            r ^= ((x < y) as u32) << 9;
            let product = x as u64 * y as u64;
            r ^= (product >> 32) as u32 ^ (product as u32 >> 1);
            r ^= (((s as i64 * t as i64) >> 32) as u32).wrapping_mul(3);
            let lsb = if x == 0 { u32::MAX } else { x.trailing_zeros() };
            let umsb = if x == 0 { u32::MAX } else { 31 - x.leading_zeros() };
            let magnitude = if s < 0 { !x } else { x };
            let smsb = if magnitude == 0 { u32::MAX } else { 31 - magnitude.leading_zeros() };
            r = r
                .wrapping_add(x.count_ones())
                .wrapping_add(lsb.wrapping_mul(5))
                .wrapping_add(smsb.wrapping_mul(7))
                .wrapping_add(umsb.wrapping_mul(11));
            let inserted = x & !(0x7ff << 4) | (y & 0x7ff) << 4;
            r ^= x
                .reverse_bits()
                .wrapping_add(x >> 5 & 0x1ff)
                .wrapping_add((s >> 20) as u32)
                .wrapping_add(inserted);
            r = r.wrapping_add(
                s.max(t) as u32
                    ^ x.min(y)
                    ^ s.wrapping_abs() as u32
                    ^ t.signum() as u32
                    ^ s.clamp(-100, 100) as u32,
            );
            r ^= (x << (y & 31)).wrapping_add(x >> 3).wrapping_add((s >> 5) as u32);
            if let (Some(quotient), Some(rest)) = (x.checked_div(y), x.checked_rem(y)) {
                r = r
                    .wrapping_add(quotient)
                    .wrapping_add(rest)
                    .wrapping_add((s / 77) as u32)
                    .wrapping_add((t / -3) as u32);
            }
            r = r.wrapping_add((s < t) as u32 + ((x < y) as u32 * 2) + ((s >= 0) as u32 * 4));
            let w = (s as i64 * t as i64).wrapping_add(5);
            let v = (x as u64) << 32 | y as u64;
            // GLSL leaves % of negative numbers undefined; SPIR-V's SMod takes the divisor's sign.
            r ^= ((w >> 13) as u32)
                .wrapping_add((v / 1_000_003) as u32)
                .wrapping_add((w.rem_euclid(97) == 3) as u32)
                .wrapping_add((v >> 40) as u32);
            let mut h = x as i16;
            let mut b = y as u8;
            h = h.wrapping_mul(3).wrapping_add(b as i16);
            b = b.wrapping_add(h as u8);
            r.wrapping_add(
                h as i32 as u32 ^ b as u32 ^ (h > 100) as u32 ^ x ^ (y >> 8 & 0xff),
            )
        },
    );
}

#[test]
fn vectors_and_matrices() {
    check(
        "layout(set = 0, binding = 2, std430) buffer M { layout(row_major) mat3x4 rows; layout(column_major) mat3x4 columns; };",
        "float f = uintBitsToFloat(x); vec3 v = vec3(f, f + 1.0, 2.0);
         if (i == 0u) { rows = mat3x4(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12); columns = rows; rows[1][2] += 0.5; }
         mat3x4 m = mat3x4(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12);
         vec4 p = m * v; vec3 q = p * m; mat3 s = transpose(m) * m;
         mat3 k = mat3(2, 0, 1, 1, 3, 0, 0, 1, 4); mat3 e = inverse(k) * k;
         float d = determinant(k) + determinant(mat4(2, 0, 0, 1, 0, 3, 0, 0, 0, 0, 1, 0, 1, 0, 0, 2)) + determinant(mat2(1, 2, 3, 4));
         float err = 0.0; for (int a = 0; a < 3; a++) for (int b = 0; b < 3; b++) err += abs(e[a][b] - (a == b ? 1.0 : 0.0));
         r = floatBitsToUint(p.w + q.y + s[1][2] + d + outerProduct(v, v)[2].y + cross(v, v.zxy).x + m[i % 3u][i & 3u]
            + (err < 1e-5 ? 0.0 : 1e6));",
        &floats(),
        |i, x| {
            let f = f32::from_bits(x);
            let v = [f, f + 1.0, 2.0];
            let m = |c: usize, r: usize| (c * 4 + r + 1) as f32;
            let p: Vec<f32> = (0..4)
                .map(|r| m(0, r) * v[0] + m(1, r) * v[1] + m(2, r) * v[2])
                .collect();
            let q = |c: usize| p[0] * m(c, 0) + p[1] * m(c, 1) + p[2] * m(c, 2) + p[3] * m(c, 3);
            let s = |c: usize, r: usize| (0..4).map(|k| m(r, k) * m(c, k)).sum::<f32>();
            // 2 * (3 * 4 - 0) - 1 * (0 * 4 - 1 * 1) + 0, 9, -2
            let d = 25.0 + 9.0 - 2.0;
            let outer = v[1] * v[2];
            let w = [v[2], v[0], v[1]];
            let cross = v[1] * w[2] - w[1] * v[2];
            (p[3] + q(1) + s(1, 2) + d + outer + cross + m(i as usize % 3, i as usize & 3))
                .to_bits()
        },
    );
}

#[test]
fn specialization_constants() {
    let source = "layout(local_size_x_id = 7) in;
         layout(constant_id = 1) const int N = 4;
         layout(constant_id = 2) const bool DOUBLE = false;
         layout(constant_id = 3) const float SCALE = 1.5;
         layout(constant_id = 4) const uint64_t WIDE = 1ul;
         const int M = N * 3 - (DOUBLE ? -1 : 2);
         const uvec2 PAIR = uvec2(N, M);
         layout(set = 0, binding = 0) buffer Out { uint o[]; };
         void main() { uint a[N]; for (int i = 0; i < N; i++) a[i] = uint(i);
             o[gl_LocalInvocationIndex] = uint(M) + PAIR.y * 100u + uint(SCALE * 2.0) * 10000u + uint(WIDE >> 32) * 1000000u + a[N - 1] * 10000000u; }";
    let words = glsl(Stage::Compute, source);
    let run = |specialization: &[(u32, &[u8])]| {
        let program = compile_as(&CompileRequest {
            specialization,
            ..request(Stage::Compute, &words)
        });
        let mut memory = Memory {
            buffers: vec![(0, vec![0; 32])],
            push_constants: Vec::new(),
        };
        dispatch(&program, 1, &mut memory);
        (program.local_size()[0], memory.buffers[0].1[0])
    };
    assert_eq!(run(&[]), (1, 10 + 1000 + 30_000 + 30_000_000));
    let given: [(u32, &[u8]); 5] = [
        (1, &6i32.to_le_bytes()),
        (2, &1u32.to_le_bytes()),
        (3, &4f32.to_le_bytes()),
        (4, &(9u64 << 32).to_le_bytes()),
        (7, &20u32.to_le_bytes()),
    ];
    assert_eq!(
        run(&given),
        (20, 19 + 1900 + 80_000 + 9_000_000 + 50_000_000)
    );
}

#[test]
fn subgroup_operations() {
    check(
        "",
        "bool c = (x & 1u) != 0u;
         r = subgroupAdd(x) + subgroupShuffleXor(x, 1u) * 3u + subgroupShuffleUp(x, 1u) * 5u * uint(gl_SubgroupInvocationID > 0u);
         r += subgroupExclusiveAdd(x) + subgroupInclusiveMax(x) * 7u + subgroupClusteredAdd(x, 4u) * 11u;
         r += subgroupBallot(c).x + subgroupBallotBitCount(subgroupBallot(c)) + subgroupBroadcast(x, 3u) + subgroupQuadSwapDiagonal(x);
         if (c) r += subgroupBroadcastFirst(x) * 13u + (subgroupElect() ? 1u : 0u);
         r += gl_SubgroupSize + gl_SubgroupLtMask.x + uint(subgroupAnd(c)) + uint(subgroupOr(c)) + uint(subgroupAllEqual(c)) + gl_SubgroupGtMask.x;",
        &ramp(),
        |i, x| {
            let lane = i % 16;
            let first = i - lane;
            let all = first..first + 16;
            let mut r = all.clone().sum::<u32>() + (x ^ 1) * 3;
            if lane > 0 {
                r += (x - 1) * 5;
            }
            r += (first..i).sum::<u32>() + x * 7;
            let quad = i / 4 * 4;
            r += (quad..quad + 4).sum::<u32>() * 11;
            r += 0xaaaa + 8 + (first + 3) + (x ^ 3);
            if x % 2 == 1 {
                r += (first + 1) * 13 + (lane == 1) as u32;
            }
            // Some lanes are odd, not all.
            let above = 0xffff & !((2u32 << lane) - 1);
            r + 16 + ((1 << lane) - 1) + 1 + above
        },
    );
}

/// Rotations of vectors within clusters, in a loop whose turns branch.
#[test]
fn vectors_rotate_within_clusters() {
    let rotated = |delta: &str| {
        let cases: String = [1, 2, 4, 8, 16]
            .map(|size| {
                format!("case {size}u: w = subgroupClusteredRotate(v, {delta}, {size}u); break;")
            })
            .concat();
        format!(
            "uvec4 v = uvec4(x, x * 3u + 1u, x ^ 85u, ~x); r = 0u;
             for (uint size = 1u; size <= gl_SubgroupSize; size *= 2u) {{
                 uvec4 w;
                 switch (size) {{ {cases} }}
                 r = r * 31u + w.x + w.y * 7u + w.z * 13u + w.w * 17u;
             }}"
        )
    };
    // A number that is known when code is written, and one that is not.
    for delta in ["5u", "(gl_NumWorkGroups.x + 1u)"] {
        check(
            "#extension GL_KHR_shader_subgroup_rotate : require\n",
            &rotated(delta),
            &ramp(),
            |i, _| {
                [1, 2, 4, 8, 16].iter().fold(0u32, |r, size| {
                    let x = (i & !(size - 1)) | ((i + 5) & (size - 1));
                    let words = [x, x * 3 + 1, x ^ 85, !x];
                    let sum = [1u32, 7, 13, 17].iter().zip(words);
                    let sum = sum.fold(0u32, |sum, (k, word)| {
                        sum.wrapping_add(word.wrapping_mul(*k))
                    });
                    r.wrapping_mul(31).wrapping_add(sum)
                })
            },
        );
    }
}

#[test]
fn packing_and_conversions() {
    check(
        "",
        "float f = uintBitsToFloat(x); vec2 v = vec2(f, -f) * 0.1;
         r = packHalf2x16(v) ^ packSnorm2x16(v) ^ packUnorm4x8(vec4(v, 0.5, 1.0)) ^ packSnorm4x8(vec4(v, v.yx));
         vec4 u = unpackSnorm4x8(r) + unpackUnorm4x8(r) + unpackHalf2x16(packHalf2x16(v)).xyxy;
         r ^= floatBitsToUint(u.z + u.w) ^ uint(int(f * 100.0)) ^ uint(abs(f) * 7.0);
         double d = double(f) * 3.0lf; r ^= floatBitsToUint(float(d)) ^ uint(int(d));
         float16_t h = float16_t(f); h = h * float16_t(1.5) + float16_t(2); r ^= floatBitsToUint(float(h));
         int e; float m = frexp(f, e); r ^= floatBitsToUint(m) + uint(e) + floatBitsToUint(ldexp(m, e + 2)); float w; r ^= floatBitsToUint(modf(f, w)) + floatBitsToUint(w);",
        &floats(),
        |_, x| {
            use half::f16;
            let f = f32::from_bits(x);
            let v = [f * 0.1, -f * 0.1];
            let h = |f: f32| f16::from_f32(f).to_bits() as u32;
            let snorm = |f: f32, most: f32| (f.clamp(-1.0, 1.0) * most).round_ties_even() as i32 as u32;
            let unorm = |f: f32| (f.clamp(0.0, 1.0) * 255.0).round_ties_even() as u32;
            let s8 = |f: f32| snorm(f, 127.0) & 0xff;
            let s16 = |f: f32| snorm(f, 32767.0) & 0xffff;
            let mut r = h(v[0]) | h(v[1]) << 16;
            r ^= s16(v[0]) | s16(v[1]) << 16;
            r ^= unorm(v[0]) | unorm(v[1]) << 8 | unorm(0.5) << 16 | unorm(1.0) << 24;
            r ^= s8(v[0]) | s8(v[1]) << 8 | s8(v[1]) << 16 | s8(v[0]) << 24;
            let halves = v.map(|f| f16::from_f32(f).to_f32());
            let u = |k: u32, half: f32| {
                let byte = (r >> (8 * k)) as u8;
                (byte as i8 as f32 / 127.0).max(-1.0) + byte as f32 / 255.0 + half
            };
            let sum = u(2, halves[0]) + u(3, halves[1]);
            r ^= sum.to_bits() ^ (f * 100.0) as i32 as u32 ^ (f.abs() * 7.0) as u32;
            let d = f as f64 * 3.0;
            r ^= (d as f32).to_bits() ^ d as i32 as u32;
            let half = f16::from_f32(f);
            let half = f16::from_f32((half * f16::from_f32(1.5)).to_f32()) + f16::from_f32(2.0);
            r ^= half.to_f32().to_bits();
            let e = f.abs().log2().floor() as i32 + 1;
            let m = f / 2f32.powi(e);
            r ^= m
                .to_bits()
                .wrapping_add(e as u32)
                .wrapping_add((f * 4.0).to_bits());
            r ^ (f - f.trunc()).to_bits().wrapping_add(f.trunc().to_bits())
        },
    );
}

#[test]
fn partitions_are_reduced_and_scanned_apart() {
    let inputs: Vec<u32> = (0..64u32)
        .map(|i| i.wrapping_mul(0x9e37_79b9) >> 20)
        .collect();
    // The lanes of an invocation's part, as invocations.
    let part = |i: u32| {
        let base = i as usize / 16 * 16;
        let same = |k: &usize| (inputs[*k] ^ inputs[i as usize]) & 3 == 0;
        (base..base + 16).filter(same).collect::<Vec<usize>>()
    };
    let sum = |lanes: Vec<usize>| lanes.into_iter().map(|k| inputs[k]).sum::<u32>();
    let until = |i: u32, end: usize| part(i).into_iter().filter(|&k| k < end).collect();
    let partition = "uvec4 part = subgroupPartitionNV(uvec2(x & 1u, x & 2u));";
    check("", &format!("{partition} r = part.x;"), &inputs, |i, _| {
        part(i).iter().fold(0, |bits, k| bits | 1 << (k % 16))
    });
    check(
        "",
        &format!("{partition} r = subgroupPartitionedAddNV(x, part);"),
        &inputs,
        |i, _| sum(part(i)),
    );
    check(
        "",
        &format!("{partition} r = subgroupPartitionedExclusiveAddNV(x, part);"),
        &inputs,
        |i, _| sum(until(i, i as usize)),
    );
    check(
        "",
        &format!("{partition} r = uint(subgroupPartitionedInclusiveAddNV(float(x), part));"),
        &inputs,
        |i, _| sum(until(i, i as usize + 1)),
    );
}

/// C's `modf`: the fraction has the argument's sign, also where it is zero.
#[test]
fn fractions_have_the_sign_of_the_whole() {
    let values = [
        -0.0f32,
        0.0,
        -1.0,
        1.0,
        -2.75,
        2.75,
        f32::NEG_INFINITY,
        f32::INFINITY,
        -1.0e-40,
    ];
    let bits: Vec<u32> = values.iter().map(|value| value.to_bits()).collect();
    check(
        "",
        "float whole; float fraction = modf(uintBitsToFloat(x), whole);
         r = floatBitsToUint(fraction) ^ (floatBitsToUint(whole) << 1);",
        &bits,
        |_, x| {
            let value = f32::from_bits(x);
            let size = if value.is_infinite() {
                0.0
            } else {
                value.fract()
            };
            size.copysign(value).to_bits() ^ (value.trunc().to_bits() << 1)
        },
    );
}
