//! `VK_EXT_shader_long_vector`: vectors of more than four components.

use tuff_tests::assembly::{instruction, instructions, opcode, with_capability};
use tuff_tests::*;

/// `LongVectorEXT`.
const CAPABILITY: u32 = 5425;
const OP_TYPE_VECTOR: u32 = 23;
const OP_DECORATE: u32 = 71;
const ARRAY_STRIDE: u32 = 6;

/// A shader in which each vector of four components has as many as this instead, arrays of them
/// included. The source has no constants of such vectors, and picks no components by name.
fn lengthened(source: &str, components: u32) -> Vec<u32> {
    let words = glsl(Stage::Compute, source);
    let words = with_capability(&words, CAPABILITY, "SPV_EXT_long_vector");
    let mut out = words[..5].to_vec();
    for it in instructions(&words) {
        match *it {
            [_, vector, component, 4] if opcode(it) == OP_TYPE_VECTOR => {
                let operands = [vector, component, components];
                out.extend(instruction(OP_TYPE_VECTOR, &operands));
            }
            [_, array, ARRAY_STRIDE, 16] if opcode(it) == OP_DECORATE => {
                let operands = [array, ARRAY_STRIDE, 4 * components];
                out.extend(instruction(OP_DECORATE, &operands));
            }
            _ => out.extend_from_slice(it),
        }
    }
    out
}

fn gpu() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 340));
    gpu.with("VK_EXT_shader_long_vector", |gpu| {
        gpu.optional.long_vector.long_vector != 0
    })
}

const SIZES: [u32; 5] = [5, 8, 17, 64, 1024];

const INVOCATIONS: u32 = 8;

/// Runs a body over vectors `a` and `b`, which gives a vector `r`; `i` is the invocation, `n` the
/// number of components.
fn run(
    gpu: &Gpu,
    components: u32,
    (ty, declarations, body): (&str, &str, &str),
    given: [&[u32]; 2],
) -> Vec<u32> {
    let source = format!(
        "layout(local_size_x = {INVOCATIONS}) in;
        layout(set = 0, binding = 0, scalar) readonly buffer A {{ {ty} a_[]; }};
        layout(set = 0, binding = 1, scalar) readonly buffer B {{ {ty} b_[]; }};
        layout(set = 0, binding = 2, scalar) buffer R {{ {ty} r_[]; }};
        const uint n = {components}u;
        {declarations}
        void main() {{
            uint i = gl_LocalInvocationIndex;
            {ty} a = a_[i], b = b_[i], r;
            {body}
            r_[i] = r;
        }}"
    );
    let results = gpu.buffer(4 * given[0].len() as u64);
    let set = gpu.set_of(&[
        gpu.buffer_with(given[0]).into(),
        gpu.buffer_with(given[1]).into(),
        results.into(),
    ]);
    let kernel = gpu.kernel_of(&lengthened(&source, components), &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    results.read()
}

fn integers(components: u32, seed: u32) -> Vec<u32> {
    let word = |k: u32| (k + seed).wrapping_mul(0x9e37_79b9) ^ k << 5;
    (0..INVOCATIONS * components).map(word).collect()
}

#[test]
fn integers_are_computed_component_by_component() {
    let Some(gpu) = gpu() else {
        return;
    };
    let body = "r = a * b + (a ^ b); r = max(r, min(a, b)); r -= a & b;";
    for components in SIZES {
        let (a, b) = (integers(components, 1), integers(components, 77));
        let found = run(&gpu, components, ("uvec4", "", body), [&a, &b]);
        let wanted = a.iter().zip(&b).map(|(&a, &b)| {
            let r = a.wrapping_mul(b).wrapping_add(a ^ b).max(a.min(b));
            r.wrapping_sub(a & b)
        });
        assert!(wanted.eq(found), "{components} components");
    }
}

/// Sums of small integers, which are exact in every order.
#[test]
fn products_of_vectors_sum_all_components() {
    let Some(gpu) = gpu() else {
        return;
    };
    let body = "float sum = dot(a, b); r = abs(a) * sum; r = r + b;";
    for components in SIZES {
        let numbers = |seed: u32| -> Vec<f32> {
            let small = |word: u32| (word % 15) as f32 - 7.0;
            integers(components, seed).into_iter().map(small).collect()
        };
        let (a, b) = (numbers(3), numbers(5));
        let bits = |numbers: &[f32]| -> Vec<u32> { numbers.iter().map(|x| x.to_bits()).collect() };
        let found = run(&gpu, components, ("vec4", "", body), [&bits(&a), &bits(&b)]);
        let mut found = found.into_iter().map(f32::from_bits);
        let length = components as usize;
        for (a, b) in a.chunks(length).zip(b.chunks(length)) {
            let sum: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            for (a, b) in a.iter().zip(b) {
                assert_eq!(
                    found.next(),
                    Some(a.abs() * sum + b),
                    "{components} components"
                );
            }
        }
    }
}

/// Components at computed indices of variables and of workgroup memory.
#[test]
fn components_are_reached_by_computed_indices() {
    let Some(gpu) = gpu() else {
        return;
    };
    let body = "
        for (uint k = 0u; k < n; k++) r[k] = a[n - 1u - k] + b[(k * 3u + i) % n];
        shared_[i] = r;
        barrier();
        r = shared_[(i + 1u) % 8u];
        r[i % n] = shared_[i][(i + 2u) % n];";
    let most = gpu.limits.max_compute_shared_memory_size / (4 * INVOCATIONS);
    for components in SIZES.into_iter().filter(|&it| it <= most) {
        let (a, b) = (integers(components, 9), integers(components, 4));
        let found = run(
            &gpu,
            components,
            ("uvec4", "shared uvec4 shared_[8];", body),
            [&a, &b],
        );
        let n = components as usize;
        let at = |i: usize, k: usize| {
            let (a, b) = (&a[i * n..][..n], &b[i * n..][..n]);
            a[n - 1 - k].wrapping_add(b[(k * 3 + i) % n])
        };
        for (index, found) in found.into_iter().enumerate() {
            let (i, k) = (index / n, index % n);
            let wanted = match k == i % n {
                true => at(i, (i + 2) % n),
                false => at((i + 1) % INVOCATIONS as usize, k),
            };
            assert_eq!(found, wanted, "{components} components: {i}, {k}");
        }
    }
}

#[test]
fn vectors_have_at_least_1024_components() {
    let Some(gpu) = gpu() else {
        return;
    };
    let mut limits = newer::PhysicalDeviceShaderLongVectorPropertiesEXT::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
    // SAFETY: the physical device is of this instance, and the chain one structure that it knows.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut all);
    }
    assert!(limits.max_vector_components >= 1024);
}
