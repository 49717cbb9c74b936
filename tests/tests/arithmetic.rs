//! Arithmetic in compute shaders: integers, floats, vectors, matrices, and what packs them, against
//! the host's answers.

use tuff_tests::*;

#[test]
fn integer_arithmetic_wraps_and_shifts() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(11);
    let mut inputs: Vec<[u32; 2]> = vec![
        [0, 1],
        [u32::MAX, 1],
        [0x8000_0000, 3],
        [0x7fff_ffff, u32::MAX],
        [5, 31],
    ];
    inputs.extend((0..1000).map(|_| [random.u32(..) >> random.u32(..32), random.u32(..) | 1]));
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer I { uvec2 inputs[]; };
    layout(set = 0, binding = 1) buffer O { uint o[][24]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        if (i >= inputs.length()) return;
        uint a = inputs[i].x, b = inputs[i].y, s = b & 31u;
        int x = int(a), y = int(b);
        o[i][0] = a + b; o[i][1] = a - b; o[i][2] = a * b; o[i][3] = a / b; o[i][4] = a % b;
        o[i][5] = a << s; o[i][6] = a >> s; o[i][7] = uint(x >> s);
        o[i][8] = a & b; o[i][9] = a | b; o[i][10] = a ^ b; o[i][11] = ~a;
        o[i][12] = uint(bitCount(a)); o[i][13] = uint(findLSB(a)); o[i][14] = uint(findMSB(a));
        o[i][15] = bitfieldReverse(a);
        o[i][16] = bitfieldExtract(a, int(s / 2u), int(s / 2u));
        o[i][17] = bitfieldInsert(a, b, int(s / 2u), int(s / 2u));
        o[i][18] = uint(min(x, y)); o[i][19] = max(a, b); o[i][20] = uint(abs(x));
        uint carry; o[i][21] = uaddCarry(a, b, carry) + carry;
        uint high, low; umulExtended(a, b, high, low); o[i][22] = high;
        int h, l; imulExtended(x, y, h, l); o[i][23] = uint(h);
    }";
    let input = gpu.buffer_with(&inputs);
    let output = gpu.buffer(96 * inputs.len() as u64);
    gpu.compute(
        source,
        &[input, output],
        [inputs.len().div_ceil(64) as u32, 1, 1],
    );
    for ([a, b], got) in inputs.into_iter().zip(output.read::<[u32; 24]>()) {
        let (x, y, s) = (a as i32, b as i32, b & 31);
        let half = s / 2;
        let field = ((1u64 << half) - 1) as u32;
        let expected = [
            a.wrapping_add(b),
            a.wrapping_sub(b),
            a.wrapping_mul(b),
            a / b,
            a % b,
            a << s,
            a >> s,
            (x >> s) as u32,
            a & b,
            a | b,
            a ^ b,
            !a,
            a.count_ones(),
            if a == 0 { u32::MAX } else { a.trailing_zeros() },
            if a == 0 {
                u32::MAX
            } else {
                31 - a.leading_zeros()
            },
            a.reverse_bits(),
            a >> half & field,
            a & !(field << half) | (b & field) << half,
            x.min(y) as u32,
            a.max(b),
            x.wrapping_abs() as u32,
            a.wrapping_add(b)
                .wrapping_add(u32::from(a.checked_add(b).is_none())),
            ((u64::from(a) * u64::from(b)) >> 32) as u32,
            ((i64::from(x) * i64::from(y)) >> 32) as u32,
        ];
        assert_eq!(got, expected, "{a:#x} {b:#x}");
    }
}

#[test]
fn small_and_large_integers() {
    let gpu = Gpu::new();
    let sizes = [
        gpu.features.shader_int64,
        gpu.features.shader_int16,
        gpu.features12.shader_int8,
        gpu.features12.storage_buffer8_bit_access,
        gpu.features11.storage_buffer16_bit_access,
    ];
    if !has("integers of all sizes", sizes == [vk::TRUE; 5]) {
        return;
    }
    let source = r"
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0, scalar) buffer A { int8_t a[]; };
    layout(set = 0, binding = 1, scalar) buffer B { uint16_t b[]; };
    layout(set = 0, binding = 2, scalar) buffer C { int64_t c[]; };
    layout(set = 0, binding = 3, scalar) buffer D { uint64_t d[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        int8_t x = a[i];
        a[i] = int8_t(x * int8_t(3) - int8_t(7));
        uint16_t y = b[i];
        b[i] = uint16_t((y >> 3us) * 5us + uint16_t(x));
        c[i] = c[i] * int64_t(x) - (int64_t(y) << 20);
        d[i] = (d[i] / uint64_t(y | 1us)) ^ uint64_t(c[i]);
    }";
    let mut random = Rng::with_seed(12);
    let a: Vec<i8> = (0..64).map(|_| random.i8(..)).collect();
    let b: Vec<u16> = (0..64).map(|_| random.u16(..)).collect();
    let wide = |random: &mut Rng| random.u64(..);
    let c: Vec<i64> = (0..64).map(|_| wide(&mut random) as i64).collect();
    let d: Vec<u64> = (0..64).map(|_| wide(&mut random)).collect();
    let buffers = [
        gpu.buffer_with(&a),
        gpu.buffer_with(&b),
        gpu.buffer_with(&c),
        gpu.buffer_with(&d),
    ];
    gpu.compute(source, &buffers, [2, 1, 1]);
    let (ga, gb): (Vec<i8>, Vec<u16>) = (buffers[0].read(), buffers[1].read());
    let (gc, gd): (Vec<i64>, Vec<u64>) = (buffers[2].read(), buffers[3].read());
    for i in 0..64 {
        let (x, y) = (a[i], b[i]);
        assert_eq!(ga[i], x.wrapping_mul(3).wrapping_sub(7));
        assert_eq!(gb[i], (y >> 3).wrapping_mul(5).wrapping_add(x as u16));
        let c = c[i]
            .wrapping_mul(i64::from(x))
            .wrapping_sub(i64::from(y) << 20);
        assert_eq!(gc[i], c);
        assert_eq!(gd[i], (d[i] / u64::from(y | 1)) ^ c as u64);
    }
}

#[test]
fn float_arithmetic_rounds_correctly() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(13);
    let inputs: Vec<[f32; 2]> = (0..2048)
        .map(|_| {
            [
                between(&mut random, -100.0, 100.0),
                between(&mut random, 0.1, 50.0),
            ]
        })
        .collect();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer I { vec2 inputs[]; };
    layout(set = 0, binding = 1) buffer O { float o[][12]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        float a = inputs[i].x, b = inputs[i].y;
        precise float sum = a + b, difference = a - b, product = a * b;
        o[i][0] = sum; o[i][1] = difference; o[i][2] = product;
        o[i][3] = floor(a); o[i][4] = ceil(a); o[i][5] = trunc(a); o[i][6] = roundEven(a);
        o[i][7] = abs(a); o[i][8] = min(a, b); o[i][9] = max(a, b);
        o[i][10] = float(int(a + 1000.0)); o[i][11] = -a;
    }";
    let (input, output) = (gpu.buffer_with(&inputs), gpu.buffer(48 * 2048));
    gpu.compute(source, &[input, output], [32, 1, 1]);
    for ([a, b], got) in inputs.into_iter().zip(output.read::<[f32; 12]>()) {
        let expected = [
            a + b,
            a - b,
            a * b,
            a.floor(),
            a.ceil(),
            a.trunc(),
            a.round_ties_even(),
            a.abs(),
            a.min(b),
            a.max(b),
            (a + 1000.0).trunc(),
            -a,
        ];
        assert_eq!(got.map(f32::to_bits), expected.map(f32::to_bits), "{a} {b}");
    }
}

#[test]
fn vectors_and_matrices() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0, std430) buffer B {
        layout(row_major) mat3x4 rows; // 4 rows of 3 as stored, each at 16 bytes
        mat4 m;
        mat2x3 n;
        vec4 v;
        float results[32];
    };
    void main() {
        vec4 a = m * v;
        vec4 b = v * m;
        vec3 c = n * v.xy;
        vec2 d = v.xyz * n;
        mat4 p = m * transpose(m);
        for (int i = 0; i < 4; i++) { results[i] = a[i]; results[4 + i] = b[i]; }
        for (int i = 0; i < 3; i++) results[8 + i] = c[i];
        results[11] = d.x; results[12] = d.y;
        results[13] = p[2][1]; results[14] = determinant(m); results[15] = inverse(m)[1][2];
        vec3 e = cross(v.xyz, v.yzw);
        results[16] = e.x; results[17] = e.y; results[18] = e.z;
        results[19] = dot(v, v.wzyx);
        results[20] = rows[2][1]; results[21] = rows[1][3];
        mat2 outer = outerProduct(v.xy, v.zw);
        results[22] = outer[1][0];
        vec4 w = v; w.zx = w.xy; w[3] += 2.0;
        results[23] = w.x * 1000.0 + w.y * 100.0 + w.z * 10.0 + w.w;
        results[24] = float(any(lessThan(v, vec4(2.5, 0, 0, 0)))) + 2.0 * float(all(greaterThan(v, vec4(0))));
        rows[0] = v;
    }";
    let mut words = vec![0.0f32; 12 * 16];
    let rows: Vec<f32> = (0..16).map(|i| 100.0 + i as f32).collect();
    words[..16].copy_from_slice(&rows);
    let m: Vec<f32> = (0..16).map(|i| ((i * 7 + 3) % 11) as f32 - 4.0).collect();
    words[16..32].copy_from_slice(&m);
    let n = [1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0];
    words[32..39].copy_from_slice(&n);
    let v = [1.0f32, 3.0, 4.0, 7.0];
    words[40..44].copy_from_slice(&v);
    let buffer = gpu.buffer_with(&words);
    gpu.compute(source, &[buffer], [1, 1, 1]);
    let after: Vec<f32> = buffer.read();
    let r = &after[44..];
    let at = |column: usize, row: usize| m[4 * column + row];
    for i in 0..4 {
        assert_eq!(
            r[i],
            (0..4).map(|k| at(k, i) * v[k]).sum::<f32>(),
            "m * v, {i}"
        );
        assert_eq!(
            r[4 + i],
            (0..4).map(|k| at(i, k) * v[k]).sum::<f32>(),
            "v * m, {i}"
        );
    }
    assert_eq!(&r[8..11], [13.0, 17.0, 21.0]);
    assert_eq!(&r[11..13], [1.0 + 6.0 + 12.0, 4.0 + 15.0 + 24.0]);
    assert_eq!(r[13], (0..4).map(|k| at(k, 1) * at(k, 2)).sum::<f32>());
    let minor = |skip_column: usize, skip_row: usize| {
        let keep = |skip: usize| (0..4).filter(move |i| *i != skip).collect::<Vec<_>>();
        let (c, q) = (keep(skip_column), keep(skip_row));
        let e = |i: usize, j: usize| f64::from(at(c[i], q[j]));
        e(0, 0) * (e(1, 1) * e(2, 2) - e(2, 1) * e(1, 2))
            - e(1, 0) * (e(0, 1) * e(2, 2) - e(2, 1) * e(0, 2))
            + e(2, 0) * (e(0, 1) * e(1, 2) - e(1, 1) * e(0, 2))
    };
    let sign = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
    let determinant: f64 = (0..4)
        .map(|c| sign(c) * f64::from(at(c, 0)) * minor(c, 0))
        .sum();
    assert!(
        (f64::from(r[14]) - determinant).abs() < 1e-2,
        "{} {determinant}",
        r[14]
    );
    // Column 1, row 2 of the inverse is the cofactor of column 2, row 1, over the determinant.
    let inverse = sign(3) * minor(2, 1) / determinant;
    assert!(
        (f64::from(r[15]) - inverse).abs() < 1e-4,
        "{} {inverse}",
        r[15]
    );
    assert_eq!(
        &r[16..19],
        [
            3.0 * 7.0 - 4.0 * 4.0,
            4.0 * 3.0 - 1.0 * 7.0,
            1.0 * 4.0 - 3.0 * 3.0
        ]
    );
    assert_eq!(r[19], 2.0 * (7.0 + 12.0));
    // Element [column][row] of a row-major matrix lies at row * 4 + column.
    assert_eq!(r[20], 100.0 + 4.0 + 2.0);
    assert_eq!(r[21], 100.0 + 12.0 + 1.0);
    assert_eq!(r[22], 1.0 * 7.0);
    assert_eq!(r[23], 3000.0 + 300.0 + 10.0 + 9.0);
    assert_eq!(r[24], 3.0);
    assert_eq!([after[0], after[4], after[8], after[12]], v);
}

#[test]
fn half_and_double_precision() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(15);
    let inputs: Vec<[f32; 2]> = (0..256)
        .map(|_| {
            [
                between(&mut random, -50.0, 50.0),
                between(&mut random, 0.5, 20.0),
            ]
        })
        .collect();
    if gpu.features12.shader_float16 != 0 && gpu.features11.storage_buffer16_bit_access != 0 {
        let source = r"
        layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) buffer I { vec2 inputs[]; };
        layout(set = 0, binding = 1, scalar) buffer O { float16_t o[][4]; };
        void main() {
            uint i = gl_GlobalInvocationID.x;
            float16_t a = float16_t(inputs[i].x), b = float16_t(inputs[i].y);
            precise float16_t sum = a + b, product = a * b;
            o[i][0] = a; o[i][1] = sum; o[i][2] = product; o[i][3] = float16_t(floor(a));
        }";
        let (input, output) = (gpu.buffer_with(&inputs), gpu.buffer(8 * 256));
        gpu.compute(source, &[input, output], [4, 1, 1]);
        use half::f16;
        for ([a, b], got) in inputs.iter().zip(output.read::<[u16; 4]>()) {
            let (a, b) = (f16::from_f32(*a), f16::from_f32(*b));
            let wide = |x: f16| f64::from(f32::from(x));
            // Double precision holds sums and products of halves exactly.
            let expected = [
                a,
                f16::from_f64(wide(a) + wide(b)),
                f16::from_f64(wide(a) * wide(b)),
                f16::from_f64(wide(a).floor()),
            ];
            assert_eq!(got, expected.map(f16::to_bits), "{a} {b}");
        }
    }
    if gpu.features.shader_float64 != 0 {
        let source = r"
        layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) buffer I { vec2 inputs[]; };
        layout(set = 0, binding = 1) buffer O { double o[][5]; };
        void main() {
            uint i = gl_GlobalInvocationID.x;
            double a = double(inputs[i].x), b = double(inputs[i].y);
            precise double third = a * (1.0lf / 3.0lf), sum = a + b * 1.0e-9lf, quotient = a / b;
            o[i][0] = third; o[i][1] = sum; o[i][2] = quotient; o[i][3] = floor(a); o[i][4] = sqrt(b);
        }";
        let (input, output) = (gpu.buffer_with(&inputs), gpu.buffer(40 * 256));
        gpu.compute(source, &[input, output], [4, 1, 1]);
        for ([a, b], got) in inputs.iter().zip(output.read::<[f64; 5]>()) {
            let (a, b) = (f64::from(*a), f64::from(*b));
            let expected = [a * (1.0 / 3.0), a + b * 1e-9, a / b, a.floor(), b.sqrt()];
            for (got, expected) in got.into_iter().zip(expected) {
                assert!(
                    (got - expected).abs() <= 4e-16 * expected.abs(),
                    "{got} {expected}"
                );
            }
        }
    }
}

#[test]
fn packing_and_bit_casts() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer I { vec4 inputs[]; };
    layout(set = 0, binding = 1) buffer O { uint o[][8]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        vec4 v = inputs[i];
        o[i][0] = packUnorm4x8(v); o[i][1] = packSnorm4x8(v);
        o[i][2] = packUnorm2x16(v.xy); o[i][3] = packSnorm2x16(v.xy);
        o[i][4] = packHalf2x16(v.zw); o[i][5] = floatBitsToUint(unpackHalf2x16(o[i][4]).y);
        o[i][6] = floatBitsToUint(ldexp(v.x, 5));
        int e; float m = frexp(v.y, e); o[i][7] = floatBitsToUint(m) ^ uint(e);
    }";
    let mut random = Rng::with_seed(16);
    let inputs: Vec<[f32; 4]> = (0..128)
        .map(|_| std::array::from_fn(|_| between(&mut random, -1.3, 1.3)))
        .collect();
    let (input, output) = (gpu.buffer_with(&inputs), gpu.buffer(32 * 128));
    gpu.compute(source, &[input, output], [2, 1, 1]);
    let round = |x: f32| x.round_ties_even();
    for (v, got) in inputs.iter().zip(output.read::<[u32; 8]>()) {
        let near = |got: u32, expected: f32, mask: u32| {
            let got = if mask == 0xff {
                got as u8 as i8 as f32
            } else {
                got as u16 as i16 as f32
            };
            (got - expected).abs() <= 1.0
        };
        for k in 0..4 {
            let unorm = round(v[k].clamp(0.0, 1.0) * 255.0);
            assert!(((got[0] >> (8 * k) & 0xff) as f32 - unorm).abs() <= 1.0);
            assert!(near(
                got[1] >> (8 * k),
                round(v[k].clamp(-1.0, 1.0) * 127.0),
                0xff
            ));
        }
        for k in 0..2 {
            let unorm = round(v[k].clamp(0.0, 1.0) * 65535.0);
            assert!(((got[2] >> (16 * k) & 0xffff) as f32 - unorm).abs() <= 1.0);
            assert!(near(
                got[3] >> (16 * k),
                round(v[k].clamp(-1.0, 1.0) * 32767.0),
                0xffff
            ));
        }
        use half::f16;
        let halves = [
            f16::from_bits(got[4] as u16),
            f16::from_bits((got[4] >> 16) as u16),
        ];
        for k in 0..2 {
            assert!(
                (halves[k].to_f32() - v[2 + k]).abs() <= 1e-3,
                "{halves:?} {v:?}"
            );
        }
        assert_eq!(got[5], halves[1].to_f32().to_bits());
        assert_eq!(got[6], (v[0] * 32.0).to_bits());
        let exponent = if v[1] == 0.0 {
            0
        } else {
            v[1].abs().log2().floor() as i32 + 1
        };
        let mantissa = v[1] / (exponent as f32).exp2();
        assert_eq!(got[7], mantissa.to_bits() ^ exponent as u32, "{}", v[1]);
    }
}

/// `OpFmaKHR` in the place of each `Fma` of GLSL.std.450.
fn with_fma_khr(words: &[u32]) -> Vec<u32> {
    const CAPABILITY: u32 = 17;
    const EXT_INST: u32 = 12;
    const FMA_KHR: u32 = 4427;
    const FMA_CAPABILITY: u32 = 6030;
    const GLSL_FMA: u32 = 50;
    let mut out = words[..5].to_vec();
    out.extend([2 << 16 | CAPABILITY, FMA_CAPABILITY]);
    let mut rest = &words[5..];
    while let Some(&first) = rest.first() {
        let (instruction, tail) = rest.split_at((first >> 16) as usize);
        match *instruction {
            [head, ty, result, _, GLSL_FMA, a, b, c] if head & 0xFFFF == EXT_INST => {
                out.extend([6 << 16 | FMA_KHR, ty, result, a, b, c]);
            }
            _ => out.extend_from_slice(instruction),
        }
        rest = tail;
    }
    out
}

#[test]
fn fma_rounds_once() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 340));
    let Some(gpu) = gpu.with("VK_KHR_shader_fma", |gpu| {
        gpu.optional.shader_fma.shader_fma_float32 != 0
    }) else {
        return;
    };
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0, std430) buffer I { vec4 inputs[]; };
    layout(set = 0, binding = 1, std430) buffer O { vec2 o[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        vec4 v = inputs[i];
        o[i] = fma(v.xy, v.yx, v.zw);
    }";
    // Products whose lower half decides: they cancel against the rounded product.
    let inputs: Vec<[f32; 4]> = (0..64)
        .map(|i| {
            let (a, b) = (
                1.0 + f32::EPSILON * i as f32,
                3.0 - f32::EPSILON * 7.0 * i as f32,
            );
            [a, b, -(a * b), i as f32]
        })
        .collect();
    let words = with_fma_khr(&glsl(Stage::Compute, source));
    let (input, output) = (gpu.buffer_with(&inputs), gpu.buffer(64 * 8));
    let set = gpu.set_of(&[input.into(), output.into()]);
    let kernel = gpu.kernel_of(&words, &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    for (&[a, b, c, d], got) in inputs.iter().zip(output.read::<[f32; 2]>()) {
        assert_eq!(got, [a.mul_add(b, c), b.mul_add(a, d)], "{a} {b}");
    }
}
