//! Blending against sums in f64, write masks, logical operations, and what becomes of coverage.

use std::sync::atomic::Ordering;

use ash::vk;
use ash::vk::{BlendFactor, BlendOp};

use super::support::{Canvas, Random, Triangle, chunk, draw, pass_on, program, run, targets};
use crate::object::graphics_state::{BlendAttachment, GraphicsState};
use crate::raster::Work;

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;

const FACTORS: [BlendFactor; 15] = [
    BlendFactor::ZERO,
    BlendFactor::ONE,
    BlendFactor::SRC_COLOR,
    BlendFactor::ONE_MINUS_SRC_COLOR,
    BlendFactor::DST_COLOR,
    BlendFactor::ONE_MINUS_DST_COLOR,
    BlendFactor::SRC_ALPHA,
    BlendFactor::ONE_MINUS_SRC_ALPHA,
    BlendFactor::DST_ALPHA,
    BlendFactor::ONE_MINUS_DST_ALPHA,
    BlendFactor::CONSTANT_COLOR,
    BlendFactor::ONE_MINUS_CONSTANT_COLOR,
    BlendFactor::CONSTANT_ALPHA,
    BlendFactor::ONE_MINUS_CONSTANT_ALPHA,
    BlendFactor::SRC_ALPHA_SATURATE,
];

const SECOND: [BlendFactor; 4] = [
    BlendFactor::SRC1_COLOR,
    BlendFactor::ONE_MINUS_SRC1_COLOR,
    BlendFactor::SRC1_ALPHA,
    BlendFactor::ONE_MINUS_SRC1_ALPHA,
];

const OPS: [BlendOp; 5] = [
    BlendOp::ADD,
    BlendOp::SUBTRACT,
    BlendOp::REVERSE_SUBTRACT,
    BlendOp::MIN,
    BlendOp::MAX,
];

/// The table "Blend Factors" of the specification.
fn factor(factor: BlendFactor, component: usize, [s, s1, d, c]: [[f64; 4]; 4]) -> f64 {
    match factor {
        BlendFactor::ZERO => 0.0,
        BlendFactor::ONE => 1.0,
        BlendFactor::SRC_COLOR => s[component],
        BlendFactor::ONE_MINUS_SRC_COLOR => 1.0 - s[component],
        BlendFactor::DST_COLOR => d[component],
        BlendFactor::ONE_MINUS_DST_COLOR => 1.0 - d[component],
        BlendFactor::SRC_ALPHA => s[3],
        BlendFactor::ONE_MINUS_SRC_ALPHA => 1.0 - s[3],
        BlendFactor::DST_ALPHA => d[3],
        BlendFactor::ONE_MINUS_DST_ALPHA => 1.0 - d[3],
        BlendFactor::CONSTANT_COLOR => c[component],
        BlendFactor::ONE_MINUS_CONSTANT_COLOR => 1.0 - c[component],
        BlendFactor::CONSTANT_ALPHA => c[3],
        BlendFactor::ONE_MINUS_CONSTANT_ALPHA => 1.0 - c[3],
        BlendFactor::SRC_ALPHA_SATURATE if component == 3 => 1.0,
        BlendFactor::SRC_ALPHA_SATURATE => s[3].min(1.0 - d[3]),
        BlendFactor::SRC1_COLOR => s1[component],
        BlendFactor::ONE_MINUS_SRC1_COLOR => 1.0 - s1[component],
        BlendFactor::SRC1_ALPHA => s1[3],
        BlendFactor::ONE_MINUS_SRC1_ALPHA => 1.0 - s1[3],
        other => panic!("{other:?}"),
    }
}

fn blended(op: BlendOp, s: f64, sf: f64, d: f64, df: f64) -> f64 {
    match op {
        BlendOp::ADD => s * sf + d * df,
        BlendOp::SUBTRACT => s * sf - d * df,
        BlendOp::REVERSE_SUBTRACT => d * df - s * sf,
        BlendOp::MIN => s.min(d),
        _ => s.max(d),
    }
}

/// Blends one colour into an 8 × 8 image and compares what is there then. `tolerance`: of the
/// format, in its numbers.
fn check(
    format: vk::Format,
    component_count: usize,
    is_fixed: bool,
    tolerance: f64,
    state: &BlendAttachment,
    random: &mut Random,
) {
    let canvas = Canvas::new(format, 8, 8, 1, 1);
    let color = |random: &mut Random| [(); 4].map(|()| random.f32() * 1.5 - 0.25);
    let (source, second, constants) = (color(random), color(random), color(random));
    let old = color(random);
    for place in 0..64 {
        canvas.set(COLOR, [place % 8, place / 8, 0, 0], old.map(f32::to_bits));
    }
    let destination = canvas.texel(COLOR, [0; 4]).map(f32::from_bits);
    let mut graphics = GraphicsState::default();
    graphics.blend.attachments[0] = *state;
    graphics.blend.constants = constants;
    let constant =
        |index: usize, value: f32| format!("v{index}: i32 = const {}\n", value.to_bits());
    let values: String = source
        .iter()
        .chain(&second)
        .enumerate()
        .map(|(i, &it)| constant(i, it))
        .collect();
    let fragment = program(&format!(
        "module fragment
        output_rows 8
        outputs location.0.0.0, location.0.1.0, location.0.2.0, location.0.3.0,
                location.0.0.1, location.0.1.1, location.0.2.1, location.0.3.1
        fragment dual_source, colors.1
        func f0 {{
            {values}
            end(v0, v1, v2, v3, v4, v5, v6, v7)
        }}"
    ));
    let targets = targets(Some(&canvas), None);
    let work = [Work::Draw(draw(graphics, Some(fragment)))];
    let chunk = chunk(0, &targets, &[Triangle::everywhere(0.0, [0; 4])]);
    run(1, &targets, &work, &[chunk]);
    let limit = |it: f32| match is_fixed {
        true => f64::from(it.clamp(0.0, 1.0)),
        false => f64::from(it),
    };
    assert!(component_count > 3 || destination[3] == 1.0);
    let all = [source, second, destination, constants].map(|color| color.map(limit));
    let got = canvas.texel(COLOR, [5, 6, 0, 0]).map(f32::from_bits);
    for component in 0..component_count {
        let (op, sf, df) = match component {
            3 => (state.alpha_op, state.src_alpha, state.dst_alpha),
            _ => (state.color_op, state.src_color, state.dst_color),
        };
        let (sf, df) = (factor(sf, component, all), factor(df, component, all));
        let wanted = blended(op, all[0][component], sf, all[2][component], df);
        let wanted = if is_fixed {
            wanted.clamp(0.0, 1.0)
        } else {
            wanted
        };
        let error = (f64::from(got[component]) - wanted).abs();
        assert!(
            error <= tolerance,
            "{format:?} {state:?}: component {component} is {}, not {wanted}",
            got[component]
        );
    }
}

#[test]
fn every_factor_and_operation_is_what_the_table_says() {
    let mut random = Random::with_seed(5);
    let formats = [
        // Half a unit, and what f32 adds to it. What is there has the components that formats
        // lack, too: 0, 0 and 1.
        (vk::Format::R8G8B8A8_UNORM, 4, true, 0.5 / 255.0 + 1e-6),
        (vk::Format::B8G8R8A8_UNORM, 4, true, 0.5 / 255.0 + 1e-6),
        (vk::Format::R8_UNORM, 1, true, 0.5 / 255.0 + 1e-6),
        (vk::Format::R5G6B5_UNORM_PACK16, 3, true, 0.5 / 31.0 + 1e-6),
        (vk::Format::R16G16_UNORM, 2, true, 0.5 / 65535.0 + 1e-6),
        (vk::Format::R16_SFLOAT, 1, false, 2.0f64.powi(-11) * 4.0),
        (vk::Format::R16G16_SFLOAT, 2, false, 2.0f64.powi(-11) * 4.0),
        (
            vk::Format::R16G16B16A16_SFLOAT,
            4,
            false,
            2.0f64.powi(-11) * 4.0,
        ),
        (vk::Format::R32_SFLOAT, 1, false, 2e-6),
        (vk::Format::R32G32_SFLOAT, 2, false, 2e-6),
        (vk::Format::R32G32B32A32_SFLOAT, 4, false, 2e-6),
    ];
    let all: Vec<BlendFactor> = FACTORS.into_iter().chain(SECOND).collect();
    for (format, component_count, is_fixed, tolerance) in formats {
        for &src_color in &all {
            for &dst_color in &all {
                let mut pick =
                    |from: &[BlendFactor]| from[random.i64(0..from.len() as i64) as usize];
                let (src_alpha, dst_alpha) = (pick(&all), pick(&all));
                let mut op = || OPS[random.i64(0..5) as usize];
                let state = BlendAttachment {
                    enable: true,
                    src_color,
                    dst_color,
                    color_op: op(),
                    src_alpha,
                    dst_alpha,
                    alpha_op: op(),
                    write_mask: vk::ColorComponentFlags::RGBA,
                    ..Default::default()
                };
                check(
                    format,
                    component_count,
                    is_fixed,
                    tolerance,
                    &state,
                    &mut random,
                );
            }
        }
    }
}

/// Draws a colour over all of a canvas.
fn paint(canvas: &Canvas, state: GraphicsState, color: [u32; 4]) -> u64 {
    let targets = targets(Some(canvas), None);
    let draw = draw(state, Some(pass_on("flat")));
    let counters = draw.counters[0].clone();
    let work = [Work::Draw(draw)];
    let chunk = chunk(0, &targets, &[Triangle::everywhere(0.0, color)]);
    run(1, &targets, &work, &[chunk]);
    counters.samples.load(Ordering::Relaxed)
}

#[test]
fn write_masks_keep_other_components() {
    for format in [
        vk::Format::R8G8B8A8_UINT,
        vk::Format::A2B10G10R10_UINT_PACK32,
        vk::Format::R16G16B16A16_UINT,
        vk::Format::R32G32B32_UINT,
        vk::Format::R32G32B32A32_UINT,
    ] {
        for mask in 0..16 {
            let canvas = Canvas::new(format, 5, 3, 1, 1);
            paint(&canvas, GraphicsState::default(), [1, 2, 3, 1]);
            let mut state = GraphicsState::default();
            state.blend.attachments[0].write_mask = vk::ColorComponentFlags::from_raw(mask);
            paint(&canvas, state, [9, 8, 7, 2]);
            let wanted = [(1, 9), (2, 8), (3, 7), (1, 2)];
            let mut wanted: [u32; 4] =
                std::array::from_fn(|component| match mask >> component & 1 {
                    0 => wanted[component].0,
                    _ => wanted[component].1,
                });
            if format == vk::Format::R32G32B32_UINT {
                wanted[3] = 1;
            }
            assert_eq!(canvas.texel(COLOR, [4, 2, 0, 0]), wanted, "{format:?}");
            assert_eq!(canvas.texel(COLOR, [0, 0, 0, 0]), wanted, "{format:?}");
        }
    }
}

#[test]
fn logical_operations_are_their_truth_tables() {
    // The results for (source, destination) = 00, 01, 10, 11, as bits 0 to 3 (spec, table "Logical
    // Operations").
    let tables = [
        (vk::LogicOp::CLEAR, 0b0000),
        (vk::LogicOp::AND, 0b1000),
        (vk::LogicOp::AND_REVERSE, 0b0100),
        (vk::LogicOp::COPY, 0b1100),
        (vk::LogicOp::AND_INVERTED, 0b0010),
        (vk::LogicOp::NO_OP, 0b1010),
        (vk::LogicOp::XOR, 0b0110),
        (vk::LogicOp::OR, 0b1110),
        (vk::LogicOp::NOR, 0b0001),
        (vk::LogicOp::EQUIVALENT, 0b1001),
        (vk::LogicOp::INVERT, 0b0101),
        (vk::LogicOp::OR_REVERSE, 0b1101),
        (vk::LogicOp::COPY_INVERTED, 0b0011),
        (vk::LogicOp::OR_INVERTED, 0b1011),
        (vk::LogicOp::NAND, 0b0111),
        (vk::LogicOp::SET, 0b1111),
    ];
    for (op, table) in tables {
        let canvas = Canvas::new(vk::Format::R8G8B8A8_UINT, 4, 4, 1, 1);
        paint(&canvas, GraphicsState::default(), [0b1010, 0, 255, 7]);
        let mut state = GraphicsState::default();
        state.blend.logic_op = Some(op);
        paint(&canvas, state, [0b1100, 0, 255, 7]);
        let low = canvas.texel(COLOR, [1, 1, 0, 0])[0] & 0xf;
        assert_eq!(low, table, "{op:?}");
    }
}

#[test]
fn samples_follow_mask_and_alpha() {
    for samples in [2, 4, 8u32] {
        for alpha in [0.0f32, 0.3, 0.5, 1.0] {
            let canvas = Canvas::new(vk::Format::R32G32B32A32_SFLOAT, 6, 6, 1, samples);
            let mut state = GraphicsState::default();
            state.multisample.samples = samples;
            state.multisample.alpha_to_coverage = true;
            state.multisample.alpha_to_one = true;
            state.multisample.sample_mask = 0b1011_0111;
            let color = [1.0, 2.0, 3.0, alpha].map(f32::to_bits);
            let counted = paint(&canvas, state, color);
            let all = (alpha * samples as f32).round() as u32;
            let mut expected = 0;
            for sample in 0..samples {
                let is_covered = sample < all && 0b1011_0111 >> sample & 1 != 0;
                let wanted = match is_covered {
                    true => [1.0, 2.0, 3.0, 1.0],
                    false => [0.0; 4],
                };
                let got = canvas.texel(COLOR, [5, 5, 0, sample]).map(f32::from_bits);
                assert_eq!(got, wanted, "sample {sample} of {samples}, alpha {alpha}");
                expected += u64::from(is_covered) * 36;
            }
            assert_eq!(counted, expected);
        }
    }
}

/// With one sample alpha is the share of covered pixels: in 64ths of each 8×8 pixels. A larger
/// alpha covers all pixels that a smaller one covers.
#[test]
fn pixels_of_one_sample_follow_alpha() {
    let covered = |[width, height]: [u32; 2], alpha: f32| -> Vec<bool> {
        let canvas = Canvas::new(vk::Format::R32G32B32A32_SFLOAT, width, height, 1, 1);
        let mut state = GraphicsState::default();
        state.multisample.alpha_to_coverage = true;
        let counted = paint(&canvas, state, [1.0, 2.0, 3.0, alpha].map(f32::to_bits));
        let pixels = (0..width * height).map(|at| [at % width, at / width, 0, 0]);
        let is_covered = |pixel| canvas.texel(COLOR, pixel)[0] == 1.0f32.to_bits();
        let covered: Vec<bool> = pixels.map(is_covered).collect();
        assert_eq!(covered.iter().filter(|it| **it).count() as u64, counted);
        covered
    };
    let (width, height) = (80, 24);
    let mut before = vec![false; width * height];
    for step in 0..=64 {
        let alpha = step as f32 / 64.0;
        let found = covered([width as u32, height as u32], alpha);
        for square in 0..width * height / 64 {
            let (left, top) = (square * 8 % width, square * 8 / width * 8);
            let pixel = |at: usize| found[(top + at / 8) * width + left + at % 8];
            assert_eq!(
                (0..64).filter(|&at| pixel(at)).count(),
                step,
                "{left}, {top}"
            );
        }
        assert!(before.iter().zip(&found).all(|(before, now)| now | !before));
        // Neither the size of the picture nor the edge of a primitive matters.
        let part = covered([13, 11], alpha);
        assert!((0..13 * 11).all(|at| part[at] == found[at / 13 * width + at % 13]));
        before = found;
    }
    for (alpha, all) in [
        (f32::NAN, false),
        (-1.0, false),
        (2.0, true),
        (f32::MIN_POSITIVE, false),
    ] {
        assert_eq!(covered([9, 9], alpha), [all; 81], "{alpha}");
    }
}
