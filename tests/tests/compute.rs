//! Compute shaders: arithmetic, control flow, memory of every kind, against the host's answers.

use tuff_tests::*;

const ONE: [u32; 3] = [1, 1, 1];

#[test]
fn every_invocation_knows_its_place() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 4, local_size_y = 3, local_size_z = 2) in;
    layout(set = 0, binding = 0) buffer B { uint b[]; };
    void main() {
        uvec3 whole = gl_NumWorkGroups * gl_WorkGroupSize;
        uvec3 id = gl_GlobalInvocationID;
        uint i = (id.z * whole.y + id.y) * whole.x + id.x;
        bool right = id == gl_WorkGroupID * gl_WorkGroupSize + gl_LocalInvocationID
            && gl_LocalInvocationIndex == (gl_LocalInvocationID.z * 3u + gl_LocalInvocationID.y) * 4u
                + gl_LocalInvocationID.x;
        atomicAdd(b[i], right ? 1u : 100u);
    }";
    let buffer = gpu.buffer(4 * 4 * 3 * 2 * 5 * 2 * 3);
    gpu.compute(source, &[buffer], [5, 2, 3]);
    assert!(buffer.read::<u32>().iter().all(|count| *count == 1));
}

#[test]
fn integer_arithmetic_wraps_and_shifts() {
    let gpu = Gpu::new();
    let mut random = Random::new(11);
    let mut inputs: Vec<[u32; 2]> = vec![
        [0, 1],
        [u32::MAX, 1],
        [0x8000_0000, 3],
        [0x7fff_ffff, u32::MAX],
        [5, 31],
    ];
    inputs.extend((0..1000).map(|_| [random.bits() >> random.below(32), random.bits() | 1]));
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
    let mut random = Random::new(12);
    let a: Vec<i8> = (0..64).map(|_| random.bits() as i8).collect();
    let b: Vec<u16> = (0..64).map(|_| random.bits() as u16).collect();
    let wide = |random: &mut Random| u64::from(random.bits()) << 32 | u64::from(random.bits());
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
    let mut random = Random::new(13);
    let inputs: Vec<[f32; 2]> = (0..2048)
        .map(|_| [random.between(-100.0, 100.0), random.between(0.1, 50.0)])
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

/// Checks a function of one or two floats against double precision within `ulps`, or absolutely.
fn check_function(
    gpu: &Gpu,
    expression: &str,
    inputs: &[[f32; 2]],
    reference: impl Fn(f64, f64) -> f64,
    ulps: f64,
    absolute: f64,
) {
    let source = format!(
        "layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) buffer I {{ vec2 inputs[]; }};
        layout(set = 0, binding = 1) buffer O {{ float o[]; }};
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            if (i >= o.length()) return;
            float x = inputs[i].x, y = inputs[i].y;
            o[i] = {expression};
        }}"
    );
    let (input, output) = (gpu.buffer_with(inputs), gpu.buffer(4 * inputs.len() as u64));
    gpu.compute(
        &source,
        &[input, output],
        [inputs.len().div_ceil(64) as u32, 1, 1],
    );
    for ([x, y], got) in inputs.iter().zip(output.read::<f32>()) {
        let exact = reference(f64::from(*x), f64::from(*y));
        let ulp = f64::from((exact as f32).abs().next_up() - (exact as f32).abs());
        let error = (f64::from(got) - exact).abs();
        assert!(
            error <= ulps * ulp || error <= absolute,
            "{expression} of {x}, {y}: {got}, {exact}"
        );
    }
}

#[test]
fn functions_are_as_precise_as_vulkan_asks() {
    let gpu = Gpu::new();
    let mut random = Random::new(14);
    let mut pairs = |low: f32, high: f32| -> Vec<[f32; 2]> {
        (0..1000)
            .map(|_| [random.between(low, high), random.between(low, high)])
            .collect()
    };
    // The bounds are those of "Precision of GLSL.std.450 Instructions".
    check_function(&gpu, "x / y", &pairs(0.1, 90.0), |x, y| x / y, 2.5, 0.0);
    check_function(
        &gpu,
        "inversesqrt(x)",
        &pairs(0.001, 900.0),
        |x, _| x.sqrt().recip(),
        2.0,
        0.0,
    );
    // sqrt is inherited from 1.0 / inversesqrt().
    check_function(
        &gpu,
        "sqrt(x)",
        &pairs(0.001, 900.0),
        |x, _| x.sqrt(),
        5.5,
        0.0,
    );
    let exp_ulps = |x: f64| 3.0 + 2.0 * x.abs();
    check_function(
        &gpu,
        "exp2(x)",
        &pairs(-10.0, 10.0),
        |x, _| x.exp2(),
        exp_ulps(10.0),
        0.0,
    );
    check_function(
        &gpu,
        "exp(x)",
        &pairs(-10.0, 10.0),
        |x, _| x.exp(),
        exp_ulps(10.0),
        0.0,
    );
    let small = f64::exp2(-21.0);
    check_function(
        &gpu,
        "log2(x)",
        &pairs(0.01, 90.0),
        |x, _| x.log2(),
        3.0,
        small,
    );
    check_function(
        &gpu,
        "log(x)",
        &pairs(0.01, 90.0),
        |x, _| x.ln(),
        3.0,
        small,
    );
    // pow is inherited from exp2(y * log2(x)).
    let pow_ulps = exp_ulps(20.0) + 40.0;
    check_function(
        &gpu,
        "pow(x, y)",
        &pairs(0.2, 4.0),
        |x, y| x.powf(y),
        pow_ulps,
        0.0,
    );
    let fine = f64::exp2(-11.0);
    check_function(
        &gpu,
        "sin(x)",
        &pairs(-3.125, 3.125),
        |x, _| x.sin(),
        0.0,
        fine,
    );
    check_function(
        &gpu,
        "cos(x)",
        &pairs(-3.125, 3.125),
        |x, _| x.cos(),
        0.0,
        fine,
    );
    check_function(
        &gpu,
        "atan(y, x)",
        &pairs(-9.0, 9.0),
        |x, y| y.atan2(x),
        4096.0,
        0.0,
    );
    check_function(
        &gpu,
        "asin(x)",
        &pairs(-1.0, 1.0),
        |x, _| x.asin(),
        4096.0,
        fine,
    );
    check_function(
        &gpu,
        "fract(x)",
        &pairs(-9.0, 9.0),
        |x, _| x - x.floor(),
        1.0,
        1e-6,
    );
    check_function(
        &gpu,
        "mix(x, y, 0.25)",
        &pairs(0.1, 9.0),
        |x, y| 0.75 * x + 0.25 * y,
        4.0,
        0.0,
    );
    check_function(
        &gpu,
        "fma(x, y, 1.0)",
        &pairs(0.1, 9.0),
        |x, y| x * y + 1.0,
        2.0,
        0.0,
    );
    let lengths = |x: f64, y: f64| (x * x + y * y).sqrt();
    check_function(
        &gpu,
        "length(vec2(x, y))",
        &pairs(-9.0, 9.0),
        lengths,
        8.0,
        0.0,
    );
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
    gpu.compute(source, &[buffer], ONE);
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
fn control_flow_diverges_and_comes_together() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    uint collatz(uint n) {
        uint steps = 0u;
        while (n > 1u) {
            n = (n & 1u) == 0u ? n / 2u : 3u * n + 1u;
            steps++;
        }
        return steps;
    }
    uint early(uint n) {
        for (uint i = 2u; i < 50u; i++) {
            if (n % i == 0u) return i;
        }
        return 0u;
    }
    void main() {
        uint id = gl_GlobalInvocationID.x;
        uint sum = collatz(id + 1u) * 100u;
        for (uint i = 0u; i < 10u; i++) {
            if (i == id % 7u) continue;
            for (uint j = 0u;; j++) {
                if (j > i) break;
                if ((id + j) % 5u == 4u) break;
                sum += j;
            }
            switch ((id + i) % 6u) {
            case 0u: sum += 1u; break;
            case 1u: sum += 10u; // falls through
            case 2u: sum += 100u; break;
            case 5u:
                if (id % 2u == 0u) break;
                sum += 1000u;
                break;
            default: sum += 3u;
            }
            if (i == 8u && id % 11u == 3u) break;
        }
        do { sum += 7u; } while (sum % 3u != 0u);
        o[id] = sum + 1000000u * early(id + 2u);
    }";
    let output = gpu.buffer(4 * 256);
    gpu.compute(source, &[output], [4, 1, 1]);
    let expected = |id: u32| {
        let mut n = id + 1;
        let mut sum = 0u32;
        while n > 1 {
            n = if n % 2 == 0 { n / 2 } else { 3 * n + 1 };
            sum += 100;
        }
        for i in 0..10 {
            if i == id % 7 {
                continue;
            }
            sum += (0..=i).take_while(|j| (id + j) % 5 != 4).sum::<u32>();
            sum += match (id + i) % 6 {
                0 => 1,
                1 => 110,
                2 => 100,
                5 if id % 2 == 0 => 0,
                5 => 1000,
                _ => 3,
            };
            if i == 8 && id % 11 == 3 {
                break;
            }
        }
        loop {
            sum += 7;
            if sum.is_multiple_of(3) {
                break;
            }
        }
        sum + 1_000_000 * (2..50).find(|i| (id + 2).is_multiple_of(*i)).unwrap_or(0)
    };
    for (id, got) in output.read::<u32>().into_iter().enumerate() {
        assert_eq!(got, expected(id as u32), "invocation {id}");
    }
}

#[test]
fn functions_take_and_change_arrays_and_structures() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    struct Inner { uint a[5]; vec2 v; };
    struct Outer { Inner inner[3]; uint n; };
    void fill(inout Outer outer, uint id) {
        for (uint i = 0u; i < 3u; i++)
            for (uint j = 0u; j < 5u; j++) outer.inner[i].a[(j + id) % 5u] += id * 31u + i * 5u + j;
        outer.n = id;
    }
    uint pick(in Outer outer, uint i) {
        outer.inner[i % 3u].a[1] = 9u; // its own copy
        return outer.inner[i % 3u].a[i % 5u];
    }
    const uint table[6] = uint[](3u, 1u, 4u, 1u, 5u, 9u);
    void main() {
        uint id = gl_GlobalInvocationID.x;
        Outer outer;
        for (uint i = 0u; i < 3u; i++) outer.inner[i] = Inner(uint[](0u, 1u, 2u, 3u, 4u), vec2(i));
        fill(outer, id);
        Outer copy = outer;
        copy.inner[2] = outer.inner[id % 2u];
        uint sum = pick(outer, id) + 3u * pick(copy, id + 2u) + outer.n + uint(copy.inner[2].v.x);
        o[id] = sum * 10u + table[id % 6u];
    }";
    let output = gpu.buffer(4 * 192);
    gpu.compute(source, &[output], [3, 1, 1]);
    for (id, got) in output.read::<u32>().into_iter().enumerate() {
        let id = id as u32;
        let element = |i: u32, k: u32| k + id * 31 + i * 5 + (k + 5 - id % 5) % 5;
        let pick = |i: u32, from: u32| if i % 5 == 1 { 9 } else { element(from, i % 5) };
        let copied = if (id + 2) % 3 == 2 {
            id % 2
        } else {
            (id + 2) % 3
        };
        let sum = pick(id, id % 3) + 3 * pick(id + 2, copied) + id + id % 2;
        assert_eq!(
            got,
            sum * 10 + [3, 1, 4, 1, 5, 9][id as usize % 6],
            "invocation {id}"
        );
    }
}

#[test]
fn workgroups_share_memory_and_meet_at_barriers() {
    let gpu = Gpu::new();
    // A scan in shared memory: each step needs every invocation's last one.
    for size in [1u32, 7, 32, 61, 128, 256] {
        if size > gpu.limits.max_compute_work_group_invocations {
            continue;
        }
        let source = format!(
            "layout(local_size_x = {size}) in;
            layout(set = 0, binding = 0) buffer O {{ uint o[]; }};
            shared uint sums[{size}];
            shared uint flag;
            void main() {{
                uint i = gl_LocalInvocationIndex;
                sums[i] = i * i + gl_WorkGroupID.x;
                if (i == 0u) flag = 0u;
                barrier();
                for (uint step = 1u; step < {size}u; step *= 2u) {{
                    uint add = i >= step ? sums[i - step] : 0u;
                    barrier();
                    sums[i] += add;
                    barrier();
                }}
                atomicMax(flag, sums[i]);
                barrier();
                o[gl_GlobalInvocationID.x] = sums[i] + (flag == sums[{size} - 1] ? 0u : 1000000u);
            }}"
        );
        let output = gpu.buffer(4 * 6 * u64::from(size));
        gpu.compute(&source, &[output], [6, 1, 1]);
        for (i, got) in output.read::<u32>().into_iter().enumerate() {
            let (group, last) = (i as u32 / size, i as u32 % size);
            let expected: u32 = (0..=last).map(|k| k * k + group).sum();
            assert_eq!(got, expected, "size {size}, invocation {i}");
        }
    }
}

#[test]
fn atomics_lose_nothing() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[9]; int signed_min; uint seen[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        atomicAdd(o[0], i);
        atomicOr(o[1], 1u << (i % 32u));
        atomicAnd(o[2], ~(1u << (i % 13u)));
        atomicXor(o[3], i * 2654435761u);
        atomicMin(o[4], i + 5u);
        atomicMax(o[5], i);
        uint ticket = atomicAdd(o[6], 1u);
        seen[ticket] = 1u;
        atomicCompSwap(o[7], i, i + 1u);
        atomicExchange(o[8], i | 0x10000u);
        atomicMin(signed_min, 3 - int(i));
    }";
    let count = 64 * 16u32;
    let mut start = vec![0u32; 10 + count as usize];
    start[2] = u32::MAX;
    start[4] = u32::MAX;
    let buffer = gpu.buffer_with(&start);
    gpu.compute(source, &[buffer], [16, 1, 1]);
    let o: Vec<u32> = buffer.read();
    assert_eq!(o[0], (0..count).sum());
    assert_eq!(o[1], u32::MAX);
    assert_eq!(o[2], !0x1fff);
    assert_eq!(
        o[3],
        (0..count).fold(0, |x, i| x ^ i.wrapping_mul(2_654_435_761))
    );
    assert_eq!((o[4], o[5], o[6]), (5, count - 1, count));
    assert!(o[7] >= 1 && o[7] <= count);
    assert!(o[8] & 0x10000 != 0 && o[8] & 0xffff < count);
    assert_eq!(o[9] as i32, 3 - (count as i32 - 1));
    assert!(o[10..].iter().all(|seen| *seen == 1));
}

#[test]
fn push_constants_and_specialization_constants() {
    let gpu = Gpu::new();
    let source = r"
    layout(constant_id = 3) const uint size = 4u;
    layout(constant_id = 1) const float scale = 1.5;
    layout(constant_id = 7) const bool flip = false;
    layout(constant_id = 2) const int offset = -3;
    layout(local_size_x_id = 9) in;
    layout(push_constant) uniform Push { uvec2 a; layout(offset = 16) vec3 v; float f[4]; };
    layout(set = 0, binding = 0) buffer O { float o[]; };
    float table[size * 2u];
    void main() {
        uint i = gl_GlobalInvocationID.x;
        for (uint k = 0u; k < table.length(); k++) table[k] = float(k) * scale;
        float x = table[i % table.length()] + float(offset) + v.z + f[i % 4u] + float(a.y);
        o[i] = flip ? -x : x;
    }";
    let output = gpu.buffer(4 * 24);
    let bound = [Bound::Storage(output)];
    let set = gpu.set(&[(0, &bound)]);
    let mut push = [0.0f32; 12];
    push[1] = f32::from_bits(40);
    push[4..7].copy_from_slice(&[1.0, 2.0, 3.0]);
    push[7..11].copy_from_slice(&[0.25, 0.5, 0.75, 1.0]);
    for specialized in [false, true] {
        let mut data = Vec::new();
        data.extend(8u32.to_le_bytes());
        data.extend((-0.5f32).to_le_bytes());
        data.extend(1u32.to_le_bytes());
        data.extend(5i32.to_le_bytes());
        data.extend(12u32.to_le_bytes());
        let entry = |constant_id: u32, offset: u32| vk::SpecializationMapEntry {
            constant_id,
            offset,
            size: 4,
        };
        let all = [
            entry(3, 0),
            entry(1, 4),
            entry(7, 8),
            entry(2, 12),
            entry(9, 16),
        ];
        let used = if specialized { &all[..] } else { &all[4..] };
        let constants = vk::SpecializationInfo::default()
            .map_entries(used)
            .data(&data);
        let kernel = gpu.specialized_kernel(source, &[set.layout], &constants);
        gpu.dispatch(kernel, &[set], &push, [2, 1, 1]);
        for (i, got) in output.read::<f32>().into_iter().enumerate() {
            let (size, scale, sign, offset) = if specialized {
                (16, -0.5, -1.0, 5.0)
            } else {
                (8, 1.5, 1.0, -3.0)
            };
            let x = (i % size) as f32 * scale + offset + 3.0 + [0.25, 0.5, 0.75, 1.0][i % 4] + 40.0;
            assert_eq!(got, sign * x, "{specialized} {i}");
        }
    }
}

#[test]
fn descriptors_in_arrays_with_dynamic_offsets_and_addresses() {
    let gpu = Gpu::new();
    let indexes = [
        gpu.features12
            .shader_uniform_buffer_array_non_uniform_indexing,
        gpu.features12
            .shader_storage_buffer_array_non_uniform_indexing,
    ];
    if !has(
        "descriptors indexed non-uniformly",
        indexes == [vk::TRUE; 2],
    ) {
        return;
    }
    let source = r"
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0) uniform U { uvec4 u; } uniforms[3];
    layout(set = 0, binding = 2) buffer S { uint s[]; } storage[5];
    layout(set = 1, binding = 0) uniform D { uint d; } moved;
    layout(set = 1, binding = 4) buffer E { uint e[]; } output_window;
    layout(buffer_reference) buffer List;
    layout(buffer_reference, std430, buffer_reference_align = 16) buffer List { uint value; uint pad; List next; };
    layout(push_constant) uniform Push { List head; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        List list = head;
        for (uint k = 0u; k < i % 3u; k++) list = list.next;
        uint a = uniforms[nonuniformEXT(i % 3u)].u[i % 4u];
        uint b = storage[nonuniformEXT(i % 5u)].s[i];
        storage[nonuniformEXT(i % 5u)].s[i] = 0u;
        output_window.e[i] = a + b * 10u + moved.d * 100000u + list.value;
    }";
    let uniforms: Vec<Bound> = (0..3u32)
        .map(|k| Bound::Uniform(gpu.buffer_with(&[k, k + 10, k + 20, k + 30])))
        .collect();
    let stored: Vec<Buffer> = (0..5u32)
        .map(|k| gpu.buffer_with(&(0..64).map(|i| 1000 * (k + 1) + i).collect::<Vec<u32>>()))
        .collect();
    let storage: Vec<Bound> = stored
        .iter()
        .map(|buffer| Bound::Storage(*buffer))
        .collect();
    let set_0 = gpu.set(&[(0, &uniforms), (2, &storage)]);
    let moved = gpu.buffer_with(&(0..1024).collect::<Vec<u32>>());
    let window = gpu.buffer(4096);
    let set_1 = gpu.set(&[
        (0, &[Bound::UniformDynamic(moved, 4)]),
        (4, &[Bound::StorageDynamic(window, 256)]),
    ]);
    let list = gpu.buffer(48);
    let (second, third) = (list.address + 16, list.address + 32);
    list.write(0, &[1_000_000u64, second, 2_000_000, third, 3_000_000, 0]);
    let kernel = gpu.kernel(source, &[set_0.layout, set_1.layout]);
    gpu.run(|commands| {
        let point = vk::PipelineBindPoint::COMPUTE;
        let (sets, offsets) = ([set_0.handle, set_1.handle], [512, 1024]);
        let all = vk::ShaderStageFlags::ALL;
        let push = list.address.to_le_bytes();
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            gpu.device
                .cmd_bind_pipeline(commands, point, kernel.pipeline);
            gpu.device
                .cmd_bind_descriptor_sets(commands, point, kernel.layout, 0, &sets, &offsets);
            gpu.device
                .cmd_push_constants(commands, kernel.layout, all, 0, &push);
            gpu.device.cmd_dispatch(commands, 2, 1, 1);
        }
    });
    let results: Vec<u32> = window.read();
    for i in 0..64u32 {
        let a = i % 3 + 10 * (i % 4);
        let b = 1000 * (i % 5 + 1) + i;
        let expected = a + b * 10 + 128 * 100_000 + 1_000_000 * (i % 3 + 1);
        assert_eq!(results[256 + i as usize], expected, "invocation {i}");
    }
    assert!(
        results[..256]
            .iter()
            .chain(&results[320..])
            .all(|word| *word == 0)
    );
    assert_eq!(
        stored[2].read::<u32>()[..8],
        [3000, 3001, 0, 3003, 3004, 3005, 3006, 0]
    );
}

#[test]
fn indirect_dispatch_and_base_groups() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 8) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    void main() { atomicAdd(o[gl_GlobalInvocationID.x], gl_NumWorkGroups.x + 100u * gl_WorkGroupID.y); }";
    let output = gpu.buffer(4 * 64);
    let bound = [Bound::Storage(output)];
    let set = gpu.set(&[(0, &bound)]);
    let kernel = gpu.kernel(source, &[set.layout]);
    let sizes = gpu.buffer_with(&[9u32, 9, 9, 3, 2, 1]);
    gpu.run(|commands| {
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            gpu.device
                .cmd_bind_pipeline(commands, point, kernel.pipeline);
            gpu.device.cmd_bind_descriptor_sets(
                commands,
                point,
                kernel.layout,
                0,
                &[set.handle],
                &[],
            );
            gpu.device.cmd_dispatch_indirect(commands, sizes.handle, 12);
        }
    });
    // Three groups wide, twice: once with y = 0 and once with y = 1.
    let expected: Vec<u32> = (0..64).map(|i| if i < 24 { 106 } else { 0 }).collect();
    assert_eq!(output.read::<u32>(), expected);
}

#[test]
fn half_and_double_precision() {
    let gpu = Gpu::new();
    let mut random = Random::new(15);
    let inputs: Vec<[f32; 2]> = (0..256)
        .map(|_| [random.between(-50.0, 50.0), random.between(0.5, 20.0)])
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
    let mut random = Random::new(16);
    let inputs: Vec<[f32; 4]> = (0..128)
        .map(|_| std::array::from_fn(|_| random.between(-1.3, 1.3)))
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
