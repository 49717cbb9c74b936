//! The float functions of compute shaders, against double precision.

use tuff_tests::*;

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
    let mut random = Rng::with_seed(14);
    // The range of both arguments, then the bounds: in units of the last place, or absolute.
    let mut check = |expression: &str,
                     [low, high]: [f32; 2],
                     [ulps, absolute]: [f64; 2],
                     reference: fn(f64, f64) -> f64| {
        let mut argument = || between(&mut random, low, high);
        let pairs: Vec<[f32; 2]> = (0..1000).map(|_| [argument(), argument()]).collect();
        check_function(&gpu, expression, &pairs, reference, ulps, absolute);
    };
    // The bounds are those of "Precision of GLSL.std.450 Instructions".
    check("x / y", [0.1, 90.0], [2.5, 0.0], |x, y| x / y);
    check("inversesqrt(x)", [0.001, 900.0], [2.0, 0.0], |x, _| {
        x.sqrt().recip()
    });
    // sqrt is inherited from 1.0 / inversesqrt().
    check("sqrt(x)", [0.001, 900.0], [5.5, 0.0], |x, _| x.sqrt());
    let exp_ulps = |x: f64| 3.0 + 2.0 * x.abs();
    check("exp2(x)", [-10.0, 10.0], [exp_ulps(10.0), 0.0], |x, _| {
        x.exp2()
    });
    check("exp(x)", [-10.0, 10.0], [exp_ulps(10.0), 0.0], |x, _| {
        x.exp()
    });
    let small = f64::exp2(-21.0);
    check("log2(x)", [0.01, 90.0], [3.0, small], |x, _| x.log2());
    check("log(x)", [0.01, 90.0], [3.0, small], |x, _| x.ln());
    // pow is inherited from exp2(y * log2(x)).
    let pow_ulps = exp_ulps(20.0) + 40.0;
    check("pow(x, y)", [0.2, 4.0], [pow_ulps, 0.0], |x, y| x.powf(y));
    // Around 1, where it is least: log2 may be off by 2^-21, which the exponent multiplies.
    let whole = |n: f64| exp_ulps(0.0) + n * std::f64::consts::LN_2 * f64::exp2(2.0);
    check("pow(x, 2.0)", [0.8, 1.25], [whole(2.0), 0.0], |x, _| x * x);
    check("pow(x, 3.0)", [0.8, 1.25], [whole(3.0), 0.0], |x, _| {
        x.powi(3)
    });
    check("pow(x, 4.0)", [0.8, 1.25], [whole(4.0), 0.0], |x, _| {
        x.powi(4)
    });
    check("pow(x, 5.0)", [0.8, 1.25], [whole(5.0), 0.0], |x, _| {
        x.powi(5)
    });
    check(
        "pow(2.0, x)",
        [-10.0, 10.0],
        [exp_ulps(10.0), 0.0],
        |x, _| x.exp2(),
    );
    let fine = f64::exp2(-11.0);
    check("sin(x)", [-3.125, 3.125], [0.0, fine], |x, _| x.sin());
    check("cos(x)", [-3.125, 3.125], [0.0, fine], |x, _| x.cos());
    check("atan(y, x)", [-9.0, 9.0], [4096.0, 0.0], |x, y| y.atan2(x));
    check("asin(x)", [-1.0, 1.0], [4096.0, fine], |x, _| x.asin());
    check("fract(x)", [-9.0, 9.0], [1.0, 1e-6], |x, _| x - x.floor());
    check("mix(x, y, 0.25)", [0.1, 9.0], [4.0, 0.0], |x, y| {
        0.75 * x + 0.25 * y
    });
    check("fma(x, y, 1.0)", [0.1, 9.0], [2.0, 0.0], |x, y| x * y + 1.0);
    let lengths = |x: f64, y: f64| (x * x + y * y).sqrt();
    check("length(vec2(x, y))", [-9.0, 9.0], [8.0, 0.0], lengths);
}
