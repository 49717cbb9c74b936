//! Compares programs that only pass on varyings, and programs that compute the same, pixel by pixel
//! with a renderer of loops over samples: random sizes, areas, formats and states, in every tier.

use ash::vk;
use ash::vk::{BlendFactor, BlendOp, CompareOp};
use lanes::Tier;

use super::support::{
    COMPARE, Canvas, Random, chunk_of, draw, edges, halve_and_double, pass_on, run, targets,
};
use crate::object::graphics_state::GraphicsState;
use crate::raster::primitive::PlaneEquation;
use crate::raster::tile::samples::{fixed_point, from_center, standard};
use crate::raster::{Targets, Work};

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;
const DEPTH: vk::ImageAspectFlags = vk::ImageAspectFlags::DEPTH;

const COLORS: [vk::Format; 17] = [
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::R8_UNORM,
    vk::Format::R5G6B5_UNORM_PACK16,
    vk::Format::R8G8B8A8_SNORM,
    vk::Format::A2B10G10R10_UNORM_PACK32,
    vk::Format::A1R5G5B5_UNORM_PACK16,
    vk::Format::B10G11R11_UFLOAT_PACK32,
    vk::Format::R16G16_UNORM,
    vk::Format::R16G16B16A16_UNORM,
    vk::Format::R16_SFLOAT,
    vk::Format::R16G16_SFLOAT,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R32_SFLOAT,
    vk::Format::R32G32_SFLOAT,
    vk::Format::R32G32B32A32_SFLOAT,
];

const DEPTHS: [vk::Format; 4] = [
    vk::Format::D16_UNORM,
    vk::Format::X8_D24_UNORM_PACK32,
    vk::Format::D32_SFLOAT,
    vk::Format::D24_UNORM_S8_UINT,
];

const FACTORS: [BlendFactor; 7] = [
    BlendFactor::ZERO,
    BlendFactor::ONE,
    BlendFactor::SRC_COLOR,
    BlendFactor::SRC_ALPHA,
    BlendFactor::ONE_MINUS_SRC_ALPHA,
    BlendFactor::DST_COLOR,
    BlendFactor::ONE_MINUS_DST_ALPHA,
];

/// A triangle and the numbers at its corners.
pub struct Drawn {
    pub corners: [[i32; 2]; 3],
    pub depth: PlaneEquation,
    pub linear: [PlaneEquation; 2],
    pub origin: [i16; 2],
    pub colors: [[f32; 4]; 3],
}

impl Drawn {
    pub fn new(random: &mut Random, extent: [u32; 2]) -> Self {
        let reach = [8, 40, 300][random.i64(0..3) as usize] * 256;
        let middle = extent.map(|it| random.i64(0..i64::from(it) * 256));
        let corners =
            [(); 3].map(|()| middle.map(|it| (it + random.i64(-reach..reach + 1)) as i32));
        let mut plane = || PlaneEquation {
            at: random.f32() * 2.0 - 0.5,
            dx: (random.f32() - 0.5) / 32.0,
            dy: (random.f32() - 0.5) / 32.0,
        };
        let (depth, linear) = (plane(), [plane(), plane()]);
        let colors = [(); 3].map(|()| [(); 4].map(|()| random.f32() * 1.5 - 0.25));
        Self {
            corners,
            depth,
            linear,
            origin: extent.map(|it| random.i64(0..i64::from(it)) as i16),
            colors: match random.i64(0..2) {
                0 => [colors[0]; 3],
                _ => colors,
            },
        }
    }

    fn covers(&self, [x, y]: [i32; 2], [sx, sy]: [i32; 2]) -> bool {
        let (x, y) = (i128::from(x * 256 + sx), i128::from(y * 256 + sy));
        edges(self.corners)[..3]
            .iter()
            .all(|edge| i128::from(edge.a) * x + i128::from(edge.b) * y + i128::from(edge.c) >= 0)
    }

    fn plane(&self, plane: &PlaneEquation, [x, y]: [i32; 2], [sx, sy]: [f32; 2]) -> f32 {
        let x = sx + (x - i32::from(self.origin[0])) as f32;
        let y = sy + (y - i32::from(self.origin[1])) as f32;
        plane.at + plane.dx * x + plane.dy * y
    }

    fn color(&self, pixel: [i32; 2]) -> [f32; 4] {
        let weights = [0, 1].map(|it| self.plane(&self.linear[it], pixel, [0.0; 2]));
        let [first, second, third] = self.colors;
        [0, 1, 2, 3].map(|it| {
            first[it] + weights[0] * (second[it] - first[it]) + weights[1] * (third[it] - first[it])
        })
    }
}

fn factor(factor: BlendFactor, it: usize, source: &[f32; 4], destination: &[f32; 4]) -> f32 {
    match factor {
        BlendFactor::ZERO => 0.0,
        BlendFactor::ONE => 1.0,
        BlendFactor::SRC_COLOR => source[it],
        BlendFactor::SRC_ALPHA => source[3],
        BlendFactor::ONE_MINUS_SRC_ALPHA => 1.0 - source[3],
        BlendFactor::DST_COLOR => destination[it],
        _ => 1.0 - destination[3],
    }
}

/// One sample's fragment, written as the specification tells it.
fn fragment(
    state: &GraphicsState,
    color: &Canvas,
    depth: Option<&Canvas>,
    place: [u32; 4],
    new_depth: f32,
    new_color: [f32; 4],
) {
    let tests = &state.depth_stencil;
    if let Some(depth) = depth.filter(|_| tests.depth_test) {
        let old = depth.texel(DEPTH, place);
        depth.set(DEPTH, place, [new_depth.to_bits(), 0, 0, 0]);
        let new = depth.texel(DEPTH, place);
        let [a, b] = [new, old].map(|words| f32::from_bits(words[0]));
        let passes = match tests.depth_compare {
            CompareOp::NEVER => false,
            CompareOp::LESS => a < b,
            CompareOp::EQUAL => a == b,
            CompareOp::LESS_OR_EQUAL => a <= b,
            CompareOp::GREATER => a > b,
            CompareOp::NOT_EQUAL => a != b,
            CompareOp::GREATER_OR_EQUAL => a >= b,
            _ => true,
        };
        if !passes || !tests.depth_write {
            depth.set(DEPTH, place, old);
        }
        if !passes {
            return;
        }
    }
    let info = color.target(COLOR).surface.format;
    let old = color.texel(COLOR, place);
    let attachment = &state.blend.attachments[0];
    let mut written = new_color;
    if attachment.enable {
        use images::format::Numeric;
        let limit = |it: f32| match info.numeric {
            Numeric::Unorm | Numeric::Srgb => it.clamp(0.0, 1.0),
            Numeric::Snorm => it.clamp(-1.0, 1.0),
            _ => it,
        };
        let (source, destination) = (new_color.map(limit), old.map(f32::from_bits));
        for it in 0..4 {
            let (op, sf, df) = match it {
                3 => (
                    attachment.alpha_op,
                    attachment.src_alpha,
                    attachment.dst_alpha,
                ),
                _ => (
                    attachment.color_op,
                    attachment.src_color,
                    attachment.dst_color,
                ),
            };
            let part = |number: f32, by: BlendFactor| match by {
                BlendFactor::ZERO => 0.0,
                _ => number * limit(factor(by, it, &source, &destination)),
            };
            let (s, d) = (part(source[it], sf), part(destination[it], df));
            written[it] = match op {
                BlendOp::ADD => s + d,
                BlendOp::SUBTRACT => s - d,
                BlendOp::REVERSE_SUBTRACT => d - s,
                BlendOp::MIN => source[it].min(destination[it]),
                _ => source[it].max(destination[it]),
            };
        }
    }
    let flags = [
        vk::ColorComponentFlags::R,
        vk::ColorComponentFlags::G,
        vk::ColorComponentFlags::B,
        vk::ColorComponentFlags::A,
    ];
    let mut words = written.map(f32::to_bits);
    for it in 0..4 {
        if !attachment.write_mask.contains(flags[it]) {
            words[it] = old[it];
        }
    }
    color.set(COLOR, place, words);
}

/// All fragments, one by one.
fn expect(
    targets: &Targets,
    state: &GraphicsState,
    drawn: &[Drawn],
    color: &Canvas,
    depth: Option<&Canvas>,
) {
    let area = targets.area;
    let locations = standard(targets.samples);
    for triangle in drawn {
        for index in 0..area.extent.width * area.extent.height {
            let x = area.offset.x + (index % area.extent.width) as i32;
            let y = area.offset.y + (index / area.extent.width) as i32;
            for (sample, &location) in (0..).zip(locations) {
                let is_on = state.multisample.sample_mask >> sample & 1 != 0;
                if !is_on || !triangle.covers([x, y], fixed_point(location)) {
                    continue;
                }
                let new_depth = triangle.plane(&triangle.depth, [x, y], from_center(location));
                let new_color = triangle.color([x, y]);
                let place = [x as u32, y as u32, 0, sample];
                fragment(state, color, depth, place, new_depth, new_color);
            }
        }
    }
}

/// A state by chance.
pub fn state(random: &mut Random) -> GraphicsState {
    let mut state = GraphicsState::default();
    let mut pick = |count: usize| random.i64(0..count as i64) as usize;
    state.depth_stencil.depth_test = pick(4) != 0;
    state.depth_stencil.depth_write = pick(4) != 0;
    state.depth_stencil.depth_compare = COMPARE[pick(8)];
    let blend = &mut state.blend.attachments[0];
    blend.enable = pick(2) != 0;
    let ops = [
        BlendOp::ADD,
        BlendOp::SUBTRACT,
        BlendOp::REVERSE_SUBTRACT,
        BlendOp::MIN,
        BlendOp::MAX,
    ];
    (blend.color_op, blend.alpha_op) = (ops[pick(5)], ops[pick(5)]);
    (blend.src_color, blend.dst_color) = (FACTORS[pick(7)], FACTORS[pick(7)]);
    (blend.src_alpha, blend.dst_alpha) = (FACTORS[pick(7)], FACTORS[pick(7)]);
    if pick(4) == 0 {
        // The commonest of all.
        let factors = [BlendFactor::ONE, BlendFactor::SRC_ALPHA];
        (blend.color_op, blend.alpha_op) = (BlendOp::ADD, BlendOp::ADD);
        (blend.src_color, blend.src_alpha) = (factors[pick(2)], factors[pick(2)]);
        blend.dst_color = BlendFactor::ONE_MINUS_SRC_ALPHA;
        blend.dst_alpha = BlendFactor::ONE_MINUS_SRC_ALPHA;
    }
    if pick(4) == 0 {
        blend.write_mask = vk::ColorComponentFlags::from_raw(pick(15) as u32 + 1);
    }
    if pick(4) == 0 {
        state.multisample.sample_mask = pick(256) as u32;
    }
    state
}

fn check(random: &mut Random, runs: bool) {
    let pick = |random: &mut Random, count: usize| random.i64(0..count as i64) as usize;
    let extent = [1 + pick(random, 150) as u32, 1 + pick(random, 100) as u32];
    let samples = [1, 1, 2, 4, 8][pick(random, 5)];
    let color_format = COLORS[pick(random, COLORS.len())];
    let depth_format = match pick(random, 3) {
        0 => None,
        _ => Some(DEPTHS[pick(random, DEPTHS.len())]),
    };
    let canvases = || {
        let [width, height] = extent;
        let depth = depth_format.map(|it| Canvas::new(it, width, height, 1, samples));
        (Canvas::new(color_format, width, height, 1, samples), depth)
    };
    let mut state = state(random);
    state.multisample.samples = samples;
    let drawn: Vec<_> = (0..5).map(|_| Drawn::new(random, extent)).collect();
    let (left, top) = (
        pick(random, extent[0] as usize),
        pick(random, extent[1] as usize),
    );
    let area = match pick(random, 2) {
        0 => None,
        _ => Some(vk::Rect2D {
            offset: vk::Offset2D {
                x: left as i32,
                y: top as i32,
            },
            extent: vk::Extent2D {
                width: 1 + pick(random, extent[0] as usize - left) as u32,
                height: 1 + pick(random, extent[1] as usize - top) as u32,
            },
        }),
    };
    let targets_of = |color: &Canvas, depth: Option<&Canvas>| {
        let mut targets = targets(Some(color), depth);
        targets.area = area.unwrap_or(targets.area);
        targets
    };
    let (color, depth) = canvases();
    let all = targets_of(&color, depth.as_ref());
    expect(&all, &state, &drawn, &color, depth.as_ref());
    for limit in Tier::ALL {
        limit.limit();
        let (color_drawn, depth_drawn) = canvases();
        let targets = targets_of(&color_drawn, depth_drawn.as_ref());
        let shapes = drawn.iter().map(|it| {
            let colors = it.colors.map(|color| color.map(f32::to_bits));
            (it.corners, it.depth, it.linear, it.origin, colors)
        });
        let chunk = chunk_of(0, &targets, shapes);
        // The same numbers, from a program that has to run.
        let fragment = match runs {
            true => halve_and_double("linear.center"),
            false => pass_on("linear.center"),
        };
        let work = [Work::Draw(draw(state.clone(), Some(fragment)))];
        run(1, &targets, &work, &[chunk]);
        let what =
            format!("{color_format:?} {depth_format:?} {extent:?} {samples} {area:?} {limit}");
        assert!(color.bytes() == color_drawn.bytes(), "colours: {what}");
        if let (Some(wanted), Some(drawn)) = (&depth, &depth_drawn) {
            assert!(wanted.bytes() == drawn.bytes(), "depths: {what}");
        }
    }
}

#[test]
fn every_tier_draws_what_the_loops_do() {
    let mut random = Random::with_seed(0x51de_0b0e_1357_9bdf);
    for _ in 0..400 {
        check(&mut random, false);
    }
}

#[test]
fn programs_that_run_leave_the_same() {
    let mut random = Random::with_seed(0x2468_ace0_0f1e_2d3c);
    for _ in 0..250 {
        check(&mut random, true);
    }
}
