//! Sampling against a reference, and the derivatives that choose levels.

use tuff_tests::*;
use vk::Format as F;

const SAMPLED: vk::ImageUsageFlags = vk::ImageUsageFlags::SAMPLED;

/// Samples `picture` at each of `places` by the GLSL expression, in which `p` is the place.
fn sample(
    gpu: &Gpu,
    declared: &str,
    picture: &Picture,
    sampler: vk::Sampler,
    expression: &str,
    places: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let source = format!(
        "layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) uniform {declared} t;
        layout(set = 0, binding = 1) buffer P {{ vec4 places[]; }};
        layout(set = 0, binding = 2) buffer O {{ vec4 o[]; }};
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            if (i >= places.length()) return;
            vec4 p = places[i];
            o[i] = vec4({expression});
        }}"
    );
    let (input, output) = (
        gpu.buffer_with(places),
        gpu.buffer(16 * places.len() as u64),
    );
    gpu.compute_with(
        &source,
        &[
            (0, &[Bound::Sampled(picture.view, sampler)]),
            (1, &[Bound::Storage(input)]),
            (2, &[Bound::Storage(output)]),
        ],
        [places.len().div_ceil(64) as u32, 1, 1],
    );
    output.read()
}

/// The texel that an address mode finds for `i` on a side of `n`; `None` is the border.
fn wrapped(mode: vk::SamplerAddressMode, i: i32, n: i32) -> Option<usize> {
    use vk::SamplerAddressMode as Mode;
    let mirrored = |i: i32| if i >= 0 { i } else { -(1 + i) };
    let j = match mode {
        Mode::REPEAT => i.rem_euclid(n),
        Mode::MIRRORED_REPEAT => (n - 1) - mirrored(i.rem_euclid(2 * n) - n),
        Mode::CLAMP_TO_EDGE => i.clamp(0, n - 1),
        Mode::CLAMP_TO_BORDER => i,
        Mode::MIRROR_CLAMP_TO_EDGE => mirrored(i).clamp(0, n - 1),
        _ => unreachable!("a mode of the core"),
    };
    (0..n).contains(&j).then_some(j as usize)
}

#[test]
fn filters_and_address_modes() {
    use vk::SamplerAddressMode as Mode;
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(23);
    let (width, height) = (7i32, 5i32);
    let texels: Vec<[f32; 4]> = (0..35)
        .map(|_| std::array::from_fn(|_| between(&mut random, 0.0, 1.0)))
        .collect();
    let picture = gpu.picture(Shape::flat(F::R32G32B32A32_SFLOAT, 7, 5), SAMPLED);
    gpu.upload(&picture, 0, texels.as_flattened());
    let places: Vec<[f32; 4]> = (0..1500)
        .map(|_| {
            [
                between(&mut random, -2.3, 3.3),
                between(&mut random, -2.3, 3.3),
                0.0,
                0.0,
            ]
        })
        .collect();
    let mut modes = vec![
        Mode::REPEAT,
        Mode::MIRRORED_REPEAT,
        Mode::CLAMP_TO_EDGE,
        Mode::CLAMP_TO_BORDER,
    ];
    if gpu.features12.sampler_mirror_clamp_to_edge != 0 {
        modes.push(Mode::MIRROR_CLAMP_TO_EDGE);
    }
    for (k, mode_u) in modes.iter().enumerate() {
        let mode_v = modes[(k + 1) % modes.len()];
        for filter in [vk::Filter::NEAREST, vk::Filter::LINEAR] {
            let sampler = gpu.sampler(
                &vk::SamplerCreateInfo::default()
                    .mag_filter(filter)
                    .min_filter(filter)
                    .address_mode_u(*mode_u)
                    .address_mode_v(mode_v)
                    .border_color(vk::BorderColor::FLOAT_OPAQUE_WHITE),
            );
            let got = sample(
                &gpu,
                "sampler2D",
                &picture,
                sampler,
                "textureLod(t, p.xy, 0.0)",
                &places,
            );
            let texel =
                |i: i32, j: i32| match (wrapped(*mode_u, i, width), wrapped(mode_v, j, height)) {
                    (Some(i), Some(j)) => texels[j * 7 + i],
                    _ => [1.0; 4],
                };
            for (place, got) in places.iter().zip(got) {
                let (u, v) = (place[0] * 7.0, place[1] * 5.0);
                let expected: [f32; 4] = if filter == vk::Filter::NEAREST {
                    if (u - u.round()).abs() < 1e-3 || (v - v.round()).abs() < 1e-3 {
                        continue;
                    }
                    texel(u.floor() as i32, v.floor() as i32)
                } else {
                    let (u, v) = (u - 0.5, v - 0.5);
                    let (i, j) = (u.floor() as i32, v.floor() as i32);
                    let (a, b) = (u - u.floor(), v - v.floor());
                    std::array::from_fn(|c| {
                        let row = |j| texel(i, j)[c] * (1.0 - a) + texel(i + 1, j)[c] * a;
                        row(j) * (1.0 - b) + row(j + 1) * b
                    })
                };
                // Filter weights may have as few as four bits, and everybody has eight.
                let error = if filter == vk::Filter::LINEAR {
                    0.01
                } else {
                    0.0
                };
                for c in 0..4 {
                    assert!(
                        (got[c] - expected[c]).abs() <= error,
                        "{mode_u:?} {mode_v:?} {filter:?} {place:?}: {got:?} {expected:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn levels_of_detail() {
    let gpu = Gpu::new();
    let shape = Shape {
        levels: 5,
        ..Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16)
    };
    let picture = gpu.picture(shape, SAMPLED);
    for level in 0..5u32 {
        let texels = (16 >> level) * (16 >> level);
        gpu.upload(
            &picture,
            level,
            &vec![[10.0 * level as f32, 1.0, 0.0, 0.0f32]; texels],
        );
    }
    let sampler = |mode, bias: f32, low: f32, high: f32| {
        gpu.sampler(
            &vk::SamplerCreateInfo::default()
                .mag_filter(vk::Filter::LINEAR)
                .min_filter(vk::Filter::LINEAR)
                .mipmap_mode(mode)
                .mip_lod_bias(bias)
                .min_lod(low)
                .max_lod(high),
        )
    };
    let (near, linear) = (
        vk::SamplerMipmapMode::NEAREST,
        vk::SamplerMipmapMode::LINEAR,
    );
    let places: Vec<[f32; 4]> = (0..60)
        .map(|i| [0.3, 0.6, -1.0 + 0.11 * i as f32, 0.0])
        .collect();
    for (mode, bias, low, high) in [
        (near, 0.0, 0.0, 100.0),
        (linear, 0.0, 0.0, 100.0),
        (linear, 1.5, 0.0, 100.0),
        (linear, 0.0, 0.75, 2.25),
    ] {
        let sampler = sampler(mode, bias, low, high);
        let got = sample(
            &gpu,
            "sampler2D",
            &picture,
            sampler,
            "textureLod(t, p.xy, p.z)",
            &places,
        );
        for (place, got) in places.iter().zip(got) {
            let lod = (place[2] + bias).clamp(low, high).clamp(0.0, 4.0);
            let expected = if mode == near {
                if (lod.fract() - 0.5).abs() < 0.01 {
                    continue;
                }
                10.0 * lod.round()
            } else {
                10.0 * lod
            };
            assert!(
                (got[0] - expected).abs() < 0.06,
                "{mode:?} {bias} {low} {place:?}: {got:?}"
            );
        }
    }
    let plain = sampler(linear, 0.0, 0.0, 100.0);
    let zero = [[0.0f32; 4]];
    let queried =
        "float(textureQueryLevels(t)), vec2(textureSize(t, 2)), texelFetch(t, ivec2(1, 0), 3).x";
    let got = sample(&gpu, "sampler2D", &picture, plain, queried, &zero);
    assert_eq!(got[0], [5.0, 4.0, 4.0, 30.0]);
    // Explicit gradients of four texels choose level 2.
    let graded = "textureGrad(t, vec2(0.5), vec2(0.25, 0.0), vec2(0.0, 0.25))";
    let got = sample(&gpu, "sampler2D", &picture, plain, graded, &zero);
    assert!((got[0][0] - 20.0).abs() < 0.2, "{got:?}");
}

/// Of a workgroup, only the last half asks, and of each sixteen invocations of that only some.
#[test]
fn sizes_are_told_to_some_of_the_invocations() {
    let gpu = Gpu::new();
    let picture = gpu.picture(Shape::flat(F::R8G8B8A8_UNORM, 24, 10), SAMPLED);
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let places: Vec<[f32; 4]> = (0u8..=255)
        .map(|i| {
            let asks = i % 64 >= 32 && i % 16 >= 5;
            [f32::from(u8::from(asks)), f32::from(i), 0.0, 0.0]
        })
        .collect();
    let source = "p.x == 0.0 ? vec4(-p.y) : vec4(textureSize(t, 0), p.xy)";
    let got = sample(&gpu, "sampler2D", &picture, sampler, source, &places);
    for (place, got) in places.iter().zip(got) {
        let expected = match place[0] == 0.0 {
            true => [-place[1]; 4],
            false => [24.0, 10.0, 1.0, place[1]],
        };
        assert_eq!(got, expected, "{place:?}");
    }
}

#[test]
fn cubes_arrays_volumes_and_gathers() {
    let gpu = Gpu::new();
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    // Faces in the order +x −x +y −y +z −z.
    let shape = |kind, extent, layers| Shape {
        kind,
        format: F::R32_SFLOAT,
        extent,
        levels: 1,
        layers,
    };
    let cube = gpu.picture(shape(vk::ImageViewType::CUBE, [2, 2, 1], 6), SAMPLED);
    let texels: Vec<f32> = (0..24).map(|i| i as f32).collect();
    gpu.upload(&cube, 0, &texels);
    let directions = [
        [1.0, 0.5, -0.5, 0.0],
        [-1.0, 0.5, -0.5, 0.0],
        [0.5, 1.0, -0.5, 0.0],
        [0.5, -1.0, -0.5, 0.0],
        [0.5, -0.5, 1.0, 0.0],
        [0.5, -0.5, -1.0, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "samplerCube",
        &cube,
        nearest,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &directions,
    );
    // By the table "Cube map face and coordinate selection": s and t of each face.
    let expected = directions.map(|[x, y, z, _]| {
        let (face, s, t) = match [x, y, z] {
            [1.0, ..] => (0, -z, -y),
            [-1.0, ..] => (1, z, -y),
            [_, 1.0, _] => (2, x, z),
            [_, -1.0, _] => (3, x, -z),
            [_, _, 1.0] => (4, x, -y),
            _ => (5, -x, -y),
        };
        4.0 * face as f32 + if t > 0.0 { 2.0 } else { 0.0 } + if s > 0.0 { 1.0 } else { 0.0 }
    });
    assert_eq!(
        got.iter().map(|texel| texel[0]).collect::<Vec<f32>>(),
        expected
    );

    let array = gpu.picture(
        shape(vk::ImageViewType::TYPE_2D_ARRAY, [2, 2, 1], 3),
        SAMPLED,
    );
    gpu.upload(&array, 0, &texels[..12]);
    // The layer is rounded to the nearest even and clamped.
    let places = [
        [0.25, 0.25, 0.0, 0.0],
        [0.75, 0.25, 1.4, 0.0],
        [0.25, 0.75, 1.6, 0.0],
        [0.75, 0.75, 9.0, 0.0],
        [0.25, 0.25, -3.0, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "sampler2DArray",
        &array,
        nearest,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &places,
    );
    assert_eq!(
        got.iter().map(|t| t[0]).collect::<Vec<f32>>(),
        [0.0, 5.0, 10.0, 11.0, 0.0]
    );

    let volume = gpu.picture(shape(vk::ImageViewType::TYPE_3D, [2, 3, 4], 1), SAMPLED);
    gpu.upload(&volume, 0, &texels);
    let linear = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .min_filter(vk::Filter::LINEAR)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE),
    );
    let places = [
        [0.5, 0.5, 0.5, 0.0],
        [0.25, 0.5, 0.125, 0.0],
        [0.6, 0.4, 0.7, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "sampler3D",
        &volume,
        linear,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &places,
    );
    for (place, got) in places.iter().zip(got) {
        // The texels are a linear function of the place, so filtering gives that function.
        let [x, y, z, _] = *place;
        let expected = (x * 2.0 - 0.5) + 2.0 * (y * 3.0 - 0.5) + 6.0 * (z * 4.0 - 0.5);
        assert!(
            (got[0] - expected).abs() < 0.1,
            "{place:?} {got:?} {expected}"
        );
    }

    let flat = gpu.picture(shape(vk::ImageViewType::TYPE_2D, [4, 4, 1], 1), SAMPLED);
    gpu.upload(&flat, 0, &texels[..16]);
    let got = sample(
        &gpu,
        "sampler2D",
        &flat,
        linear,
        "textureGather(t, p.xy)",
        &[[0.5, 0.5, 0.0, 0.0]],
    );
    assert_eq!(got[0], [9.0, 10.0, 6.0, 5.0]);
    let offset = "textureLodOffset(t, p.xy, 0.0, ivec2(1, -1)).xxxx";
    let got = sample(
        &gpu,
        "sampler2D",
        &flat,
        nearest,
        offset,
        &[[0.4, 0.6, 0.0, 0.0]],
    );
    assert_eq!(got[0][0], 6.0);
}

#[test]
fn formats_are_decoded_when_sampled() {
    let gpu = Gpu::new();
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    let read = |format: F, texel: &[u8]| {
        let picture = gpu.picture(Shape::flat(format, 1, 1), SAMPLED);
        gpu.upload(&picture, 0, texel);
        sample(
            &gpu,
            "sampler2D",
            &picture,
            nearest,
            "texelFetch(t, ivec2(0), 0)",
            &[[0.0; 4]],
        )[0]
    };
    let close = |got: [f32; 4], expected: [f32; 4]| {
        let fine = got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(fine, "{got:?} {expected:?}");
    };
    close(
        read(F::R8G8B8A8_UNORM, &[255, 51, 0, 102]),
        [1.0, 0.2, 0.0, 0.4],
    );
    close(
        read(F::B8G8R8A8_UNORM, &[255, 51, 0, 102]),
        [0.0, 0.2, 1.0, 0.4],
    );
    close(
        read(F::R8G8B8A8_SNORM, &[127, 129, 0, 128]),
        [1.0, -1.0, 0.0, -1.0],
    );
    close(
        read(F::R8G8B8A8_SRGB, &[255, 188, 0, 102]),
        [1.0, 0.5029, 0.0, 0.4],
    );
    close(read(F::R8_UNORM, &[51]), [0.2, 0.0, 0.0, 1.0]);
    close(read(F::R8G8_UNORM, &[51, 255]), [0.2, 1.0, 0.0, 1.0]);
    close(
        read(F::R5G6B5_UNORM_PACK16, &0xf81fu16.to_le_bytes()),
        [1.0, 0.0, 1.0, 1.0],
    );
    close(
        read(F::A1R5G5B5_UNORM_PACK16, &0x83e0u16.to_le_bytes()),
        [0.0, 1.0, 0.0, 1.0],
    );
    let packed = 0x4000_03ffu32.to_le_bytes();
    close(
        read(F::A2B10G10R10_UNORM_PACK32, &packed),
        [1.0, 0.0, 0.0, 0.3333],
    );
    let halves: Vec<u8> = [0x3c00u16, 0xc000, 0x3800, 0]
        .iter()
        .flat_map(|h| h.to_le_bytes())
        .collect();
    close(read(F::R16G16B16A16_SFLOAT, &halves), [1.0, -2.0, 0.5, 0.0]);
    // 1.0 in 11 bits is 15 << 6, in 10 bits 15 << 5; 2.0 has the next exponent.
    let small = (15u32 << 6 | (16 << 6) << 11 | (15 << 5) << 22).to_le_bytes();
    close(
        read(F::B10G11R11_UFLOAT_PACK32, &small),
        [1.0, 2.0, 1.0, 1.0],
    );
    // Mantissas over 512, times 2^(exponent − 15).
    let shared = (256u32 | 128 << 9 | 64 << 18 | 16 << 27).to_le_bytes();
    close(
        read(F::E5B9G9R9_UFLOAT_PACK32, &shared),
        [1.0, 0.5, 0.25, 1.0],
    );
}

#[test]
fn separate_samplers_and_view_swizzles() {
    let gpu = Gpu::new();
    let shape = Shape::flat(F::R8G8B8A8_UNORM, 2, 1);
    let picture = gpu.picture(shape, SAMPLED);
    gpu.upload(&picture, 0, &[255u8, 51, 102, 153, 0, 0, 0, 0]);
    use vk::ComponentSwizzle as Swizzle;
    let info = vk::ImageViewCreateInfo::default()
        .image(picture.handle)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(shape.format)
        .components(vk::ComponentMapping {
            r: Swizzle::A,
            g: Swizzle::ZERO,
            b: Swizzle::R,
            a: Swizzle::ONE,
        })
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .level_count(1)
                .layer_count(1),
        );
    // SAFETY: the view is destroyed below, after its last use.
    let view = unsafe { gpu.device.create_image_view(&info, None) }.expect("a view");
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    let output = gpu.buffer(16);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) uniform texture2D t;
    layout(set = 0, binding = 1) uniform sampler s[2];
    layout(set = 0, binding = 2) buffer O { vec4 o; };
    void main() { o = textureLod(sampler2D(t, s[1]), vec2(0.25, 0.5), 0.0); }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::SampledImage(view)]),
            (1, &[Bound::Sampler(nearest), Bound::Sampler(nearest)]),
            (2, &[Bound::Storage(output)]),
        ],
        [1, 1, 1],
    );
    let [r, g, b, a] = output.read::<[f32; 4]>()[0];
    assert!(
        (r - 0.6).abs() < 1e-3 && g == 0.0 && b == 1.0 && a == 1.0,
        "{r} {g} {b} {a}"
    );
    // SAFETY: nothing uses the view any more.
    unsafe { gpu.device.destroy_image_view(view, None) };
}

/// glslang declares a `texture2D` as no depth image, and combines it with a `samplerShadow` into
/// one that is. As a function's argument, too. Expected: the comparison with a depth of one half
/// (the Vulkan specification, "Depth Compare Operation").
#[test]
fn separate_textures_meet_comparing_samplers() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let depth = gpu.canvas(F::D32_SFLOAT, 4, 4);
    let pass = Pass {
        depth: Some(depth),
        clear_depth: Some((0.5, 0)),
        ..Pass::default()
    };
    gpu.draw(&pass, |_| {});
    let comparing = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .compare_enable(true)
            .compare_op(vk::CompareOp::LESS),
    );
    let output = gpu.buffer(8);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) uniform texture2D t;
    layout(set = 0, binding = 1) uniform samplerShadow s;
    layout(set = 0, binding = 2) buffer O { vec2 o; };
    float compared(texture2D map, float with) {
        return textureLod(sampler2DShadow(map, s), vec3(0.5, 0.5, with), 0.0);
    }
    void main() {
        o = vec2(compared(t, 0.25), textureLod(sampler2DShadow(t, s), vec3(0.5, 0.5, 0.75), 0.0));
    }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::SampledImage(depth.view)]),
            (1, &[Bound::Sampler(comparing)]),
            (2, &[Bound::Storage(output)]),
        ],
        [1, 1, 1],
    );
    assert_eq!(output.read::<[f32; 2]>()[0], [1.0, 0.0]);
}

/// In compute, a quad is two by two invocations or four in a row.
#[test]
fn derivatives_in_compute() {
    let gpu = Gpu::new();
    let features = gpu.optional.derivatives;
    let quads = features.compute_derivative_group_quads;
    let there = quads * features.compute_derivative_group_linear != 0;
    if !has("derivatives in compute", there) {
        return;
    }
    let shape = Shape {
        levels: 5,
        ..Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16)
    };
    let picture = gpu.picture(shape, SAMPLED);
    for level in 0..5u32 {
        let texels = (16 >> level) * (16 >> level);
        gpu.upload(&picture, level, &vec![[level as f32; 4]; texels]);
    }
    let sampler = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
            .max_lod(100.0),
    );
    let results = gpu.buffer(32 * 64);
    let set = gpu.set_of(&[Bound::Sampled(picture.view, sampler), results.into()]);
    for (group, dx, dy) in [("quads", 3.0, 50.0), ("linear", 3.0, 6.0)] {
        let source = format!(
            r"
            #extension GL_NV_compute_shader_derivatives : enable
            layout(derivative_group_{group}NV) in;
            layout(local_size_x = 8, local_size_y = 4, local_size_z = 2) in;
            layout(set = 0, binding = 0) uniform sampler2D t;
            layout(set = 0, binding = 1, std430) buffer Results {{ vec4 results[][2]; }};
            void main() {{
                vec3 id = vec3(gl_LocalInvocationID);
                float f = 3.0 * id.x + 50.0 * id.y + 1000.0 * id.z;
                vec2 at = vec2(4.0 * id.x, 0.5 * id.y) / 16.0;
                results[gl_LocalInvocationIndex] = vec4[2](
                    vec4(dFdx(f), dFdyFine(f), fwidthCoarse(f), textureQueryLod(t, at).y),
                    vec4(texture(t, at).x, texture(t, at, 1.0).x, textureLod(t, at, 0.5).x, 0.0));
            }}"
        );
        let kernel = gpu.kernel(&source, &[set.layout]);
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        // Four texels from one invocation to its neighbour, eight to the one after that.
        let level = if group == "quads" { 2.0 } else { 3.0 };
        let words: Vec<[f32; 8]> = results.read();
        for (i, got) in words.iter().enumerate() {
            assert_eq!(got[..3], [dx, dy, dx + dy], "{group} {i}");
            let levels = [level, level, level + 1.0, 0.5];
            for (got, expected) in got[3..7].iter().zip(levels) {
                assert!(
                    (got - expected).abs() < 0.05,
                    "{group} {i}: {got} for {expected}"
                );
            }
        }
    }
}
