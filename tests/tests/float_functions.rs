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
    let mut pairs = |low: f32, high: f32| -> Vec<[f32; 2]> {
        (0..1000)
            .map(|_| {
                [
                    between(&mut random, low, high),
                    between(&mut random, low, high),
                ]
            })
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
