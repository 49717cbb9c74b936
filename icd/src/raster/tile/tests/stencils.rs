//! Depth and stencil tests against a table written from the specification ("Fragment Operations").

use ash::vk;
use ash::vk::{CompareOp, StencilOp};

use super::support::{COMPARE, Canvas, Random, Triangle, chunk, draw, run, targets};
use crate::object::graphics_state::{GraphicsState, StencilFace};
use crate::raster::Work;

const DEPTH: vk::ImageAspectFlags = vk::ImageAspectFlags::DEPTH;
const STENCIL: vk::ImageAspectFlags = vk::ImageAspectFlags::STENCIL;

const OPS: [StencilOp; 8] = [
    StencilOp::KEEP,
    StencilOp::ZERO,
    StencilOp::REPLACE,
    StencilOp::INCREMENT_AND_CLAMP,
    StencilOp::DECREMENT_AND_CLAMP,
    StencilOp::INVERT,
    StencilOp::INCREMENT_AND_WRAP,
    StencilOp::DECREMENT_AND_WRAP,
];

fn holds(op: CompareOp, order: std::cmp::Ordering) -> bool {
    match op {
        CompareOp::NEVER => false,
        CompareOp::LESS => order.is_lt(),
        CompareOp::EQUAL => order.is_eq(),
        CompareOp::LESS_OR_EQUAL => order.is_le(),
        CompareOp::GREATER => order.is_gt(),
        CompareOp::NOT_EQUAL => order.is_ne(),
        CompareOp::GREATER_OR_EQUAL => order.is_ge(),
        _ => true,
    }
}

fn operated(op: StencilOp, old: u8, reference: u8) -> u8 {
    match op {
        StencilOp::KEEP => old,
        StencilOp::ZERO => 0,
        StencilOp::REPLACE => reference,
        StencilOp::INCREMENT_AND_CLAMP => old.saturating_add(1),
        StencilOp::DECREMENT_AND_CLAMP => old.saturating_sub(1),
        StencilOp::INVERT => !old,
        StencilOp::INCREMENT_AND_WRAP => old.wrapping_add(1),
        _ => old.wrapping_sub(1),
    }
}

/// A depth, rounded to a format's units.
fn rounded(format: vk::Format, depth: f32) -> f64 {
    let units = match format {
        vk::Format::D16_UNORM => 65535.0,
        vk::Format::X8_D24_UNORM_PACK32 | vk::Format::D24_UNORM_S8_UINT => 16_777_215.0,
        _ => return f64::from(depth),
    };
    (f64::from(depth).clamp(0.0, 1.0) * units).round_ties_even() / units
}

#[test]
fn fragments_pass_and_write_what_the_tables_say() {
    let mut random = Random::with_seed(99);
    let formats = [
        vk::Format::D16_UNORM,
        vk::Format::X8_D24_UNORM_PACK32,
        vk::Format::D32_SFLOAT,
        vk::Format::D24_UNORM_S8_UINT,
        vk::Format::D32_SFLOAT_S8_UINT,
        vk::Format::S8_UINT,
    ];
    for round in 0..2400 {
        let format = formats[round % formats.len()];
        let samples = [1, 4][round / 7 % 2];
        let canvas = Canvas::new(format, 4, 4, 1, samples);
        let has = |aspect| {
            canvas
                .image
                .planes
                .iter()
                .any(|plane| plane.aspect == aspect)
        };
        let (has_depth, has_stencil) = (has(DEPTH), has(STENCIL));
        let mut chance = |most: i64| random.i64(0..most) as usize;
        let face = |chance: &mut dyn FnMut(i64) -> usize| StencilFace {
            fail: OPS[chance(8)],
            pass: OPS[chance(8)],
            depth_fail: OPS[chance(8)],
            compare: COMPARE[chance(8)],
            compare_mask: [0xff, 0xf, 0xffff_fff3][chance(3)],
            write_mask: [0xff, 0xf0, 0xffff_ffff][chance(3)],
            reference: [0, 1, 127, 255, 256 + 3][chance(5)],
        };
        let mut state = GraphicsState::default();
        state.multisample.samples = samples;
        state.viewports.viewports.push(vk::Viewport {
            max_depth: 1.0,
            ..vk::Viewport::default()
        });
        state.rasterization.depth_clamp = chance(2) == 0;
        let tests = &mut state.depth_stencil;
        tests.stencil = [face(&mut chance), face(&mut chance)];
        tests.stencil_test = chance(4) != 0;
        tests.depth_test = chance(4) != 0;
        tests.depth_write = chance(3) != 0;
        tests.depth_compare = COMPARE[chance(8)];
        tests.depth_bounds_test = chance(3) == 0;
        tests.depth_bounds = [0.25, 0.75];
        let (front, new) = (chance(2) == 0, [-0.5f32, 0.0, 0.5, 1.0, 1.5][chance(5)]);
        let olds: [(f32, u8); 16] = std::array::from_fn(|_| {
            let depths = [0.0, 0.25, 0.5, 0.500_001, 1.0];
            (depths[chance(5)], [0, 1, 127, 254, 255][chance(5)])
        });
        let places = (0..16 * samples).map(|place| [place % 4, place / 4 % 4, 0, place / 16]);
        let old_at = |place: [u32; 4]| olds[(place[0] + 4 * place[1]) as usize];
        for place in places.clone() {
            let (depth, stencil) = old_at(place);
            if has_depth {
                canvas.set(DEPTH, place, [depth.to_bits(), 0, 0, 0]);
            }
            if has_stencil {
                canvas.set(STENCIL, place, [stencil.into(), 0, 0, 0]);
            }
        }
        let tests = state.depth_stencil;
        let clamps_to_one = chance(3) == 0;
        let clamped = if state.rasterization.depth_clamp || clamps_to_one {
            new.clamp(0.0, 1.0)
        } else {
            new
        };
        let mut targets = targets(None, Some(&canvas));
        targets.clamps_to_one = clamps_to_one;
        let draw = draw(state, None);
        let counters = draw.counters[0].clone();
        let triangle = Triangle {
            front,
            ..Triangle::everywhere(new, [0; 4])
        };
        let chunk = chunk(0, &targets, &[triangle]);
        run(1, &targets, &[Work::Draw(draw)], &[chunk]);

        let tested = rounded(format, clamped);
        let face = &tests.stencil[usize::from(!front)];
        let masked = |it: u32| it & face.compare_mask & 0xff;
        let mut count = 0;
        for place in places {
            let (old, mut stencil) = old_at(place);
            let stored = rounded(format, old);
            let in_bounds =
                !(has_depth && tests.depth_bounds_test) || (0.25..=0.75).contains(&stored);
            let stencil_passes = !(has_stencil && tests.stencil_test)
                || holds(
                    face.compare,
                    masked(face.reference).cmp(&masked(stencil.into())),
                );
            let depth_passes = !(has_depth && tests.depth_test)
                || holds(tests.depth_compare, tested.partial_cmp(&stored).unwrap());
            let passes = in_bounds && stencil_passes && depth_passes;
            count += u64::from(passes);
            if in_bounds && tests.stencil_test {
                let op = match (stencil_passes, depth_passes) {
                    (false, _) => face.fail,
                    (_, false) => face.depth_fail,
                    _ => face.pass,
                };
                let mask = face.write_mask as u8;
                stencil = operated(op, stencil, face.reference as u8) & mask | stencil & !mask;
            }
            let writes = passes && tests.depth_test && tests.depth_write;
            let depth = if writes { tested } else { stored };
            if has_depth {
                let got = f64::from(f32::from_bits(canvas.texel(DEPTH, place)[0]));
                let wanted = f64::from(depth as f32);
                assert_eq!(got, wanted, "{format:?} {old} {new} {tests:?}");
            }
            if has_stencil {
                let got = canvas.texel(STENCIL, place)[0] as u8;
                assert_eq!(got, stencil, "{format:?} {:?} {tests:?}", old_at(place));
            }
        }
        let counted = counters.samples.load(std::sync::atomic::Ordering::Relaxed);
        assert_eq!(counted, count);
    }
}
