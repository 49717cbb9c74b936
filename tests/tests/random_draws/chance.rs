//! Draws and their state, at random.

use super::*;

pub fn pick<T: Copy>(random: &mut Rng, of: &[T]) -> T {
    of[random.usize(..of.len())]
}

pub fn random_color(random: &mut Rng) -> [u8; 4] {
    let [r, g, b] = std::array::from_fn(|_| pick(random, &[0, 1, 64, 100, 127, 128, 200, 255]));
    [r, g, b, pick(random, &[0, 255])]
}

/// Depths that viewports of 0 to 1 and of 1/4 to 3/4 keep exactly.
pub fn random_depth(random: &mut Rng) -> f32 {
    random.u32(..17) as f32 / 16.0
}

pub fn random_area(random: &mut Rng) -> Area {
    let (x, y) = (random.u32(..WIDTH), random.u32(..HEIGHT));
    let (width, height) = (1 + random.u32(..WIDTH - x), 1 + random.u32(..HEIGHT - y));
    Area {
        low: [x, y].map(i64::from),
        high: [i64::from(x + width), i64::from(y + height)],
    }
}

const COMPARISONS: [vk::CompareOp; 8] = [
    vk::CompareOp::NEVER,
    vk::CompareOp::LESS,
    vk::CompareOp::EQUAL,
    vk::CompareOp::LESS_OR_EQUAL,
    vk::CompareOp::GREATER,
    vk::CompareOp::NOT_EQUAL,
    vk::CompareOp::GREATER_OR_EQUAL,
    vk::CompareOp::ALWAYS,
];

fn random_stencil(random: &mut Rng) -> vk::StencilOpState {
    let mut op = || vk::StencilOp::from_raw(random.i32(0..8));
    let (fail_op, pass_op, depth_fail_op) = (op(), op(), op());
    vk::StencilOpState {
        fail_op,
        pass_op,
        depth_fail_op,
        compare_op: pick(random, &COMPARISONS),
        compare_mask: pick(random, &[0xff, 0x0f, 0xf1]),
        write_mask: pick(random, &[0xff, 0x3c, 0xff]),
        reference: pick(random, &[0, 1, 0x80, 0xff]),
    }
}

fn random_blend(random: &mut Rng) -> vk::PipelineColorBlendAttachmentState {
    let mut factor = || {
        let factors = [
            vk::BlendFactor::ZERO,
            vk::BlendFactor::ONE,
            vk::BlendFactor::SRC_ALPHA,
            vk::BlendFactor::ONE_MINUS_SRC_ALPHA,
            vk::BlendFactor::DST_ALPHA,
            vk::BlendFactor::ONE_MINUS_DST_ALPHA,
        ];
        pick(random, &factors)
    };
    let factors: [_; 4] = std::array::from_fn(|_| factor());
    let op = |random: &mut Rng| vk::BlendOp::from_raw(random.i32(0..5));
    vk::PipelineColorBlendAttachmentState {
        blend_enable: u32::from(random.bool()),
        src_color_blend_factor: factors[0],
        dst_color_blend_factor: factors[1],
        color_blend_op: op(random),
        src_alpha_blend_factor: factors[2],
        dst_alpha_blend_factor: factors[3],
        alpha_blend_op: op(random),
        color_write_mask: vk::ColorComponentFlags::from_raw(pick(random, &[15, 15, 15, 7, 9])),
    }
}

/// Optional features of a device.
#[derive(Clone, Copy)]
pub struct Able {
    pub logic: bool,
    pub independent_blend: bool,
    pub large_points: bool,
    pub geometry: bool,
    /// Fragments of several pixels, which may leave depths and masks of samples.
    pub rates: bool,
    /// Edges of what is clipped stay where they are.
    pub clips_exactly: bool,
}

pub fn random_draw(random: &mut Rng, able: Able, samples: u32, attachments: usize) -> Draw {
    // Powers of two make positions in clip space exact.
    let size = [pick(random, &[32, 64]), pick(random, &[32, 64])];
    let low = [random.i64(0..24) - 8, random.i64(0..24) - 8];
    let viewport = Area {
        low,
        high: [low[0] + size[0], low[1] + size[1]],
    };
    let topology = pick(
        random,
        &[
            vk::PrimitiveTopology::TRIANGLE_LIST,
            vk::PrimitiveTopology::TRIANGLE_LIST,
            vk::PrimitiveTopology::TRIANGLE_STRIP,
            vk::PrimitiveTopology::TRIANGLE_FAN,
            vk::PrimitiveTopology::POINT_LIST,
        ],
    );
    let is_points = topology == vk::PrimitiveTopology::POINT_LIST;
    let point_size = match able.large_points {
        true => pick(random, &[1.0, 3.0, 5.0]),
        false => 1.0,
    };
    // Half pixels put vertices and edges onto centres and samples. Instances move by two pixels at
    // most.
    let step = pick(random, &[1, 32, 128, 256]);
    let reach = match able.clips_exactly && random.bool() {
        true if !is_points => 6 * GRID,
        _ => -4 * GRID,
    };
    // All vertices of a primitive have one depth: so have all of a draw.
    let depth = random_depth(random);
    let mut place = |axis: usize| {
        let from = (low[axis] * GRID - reach) / step;
        let to = ((low[axis] + size[axis]) * GRID + reach) / step;
        let at = random.i64(from..to);
        match is_points {
            // The edges of a point of odd width around an eighth of a pixel beside a centre miss
            // all centres and samples.
            true => (at * step).div_euclid(GRID) * GRID + GRID / 2 + 8,
            false => at * step,
        }
    };
    let places: Vec<[i64; 2]> = (0..VERTICES).map(|_| [place(0), place(1)]).collect();
    let vertices = places
        .into_iter()
        .map(|at| (at, depth, random_color(random)))
        .collect();
    let instances = (0..INSTANCES)
        .map(|_| {
            let shift = match is_points {
                true => [0, 0],
                false => std::array::from_fn(|_| (random.i64(0..9) - 4) * GRID / 2),
            };
            let color = random_color(random);
            (shift, random.bool().then_some(color))
        })
        .collect();
    let first_instance = random.u32(..2);
    let vertex_offset = random.i32(0..4);
    let can_restart = topology == vk::PrimitiveTopology::TRIANGLE_STRIP
        || topology == vk::PrimitiveTopology::TRIANGLE_FAN;
    let indices = random.bool().then(|| {
        let index = |_| match can_restart && random.u32(..6) == 0 {
            true => None,
            false => Some(random.u32(..VERTICES - vertex_offset as u32)),
        };
        (0..18).map(index).collect()
    });
    let first_vertex = random.u32(..4);
    // Those that there are with one and with four samples.
    let rate = match able.rates && random.u32(..3) == 0 {
        true => pick(random, &[[2, 1], [2, 2]]),
        false => [1, 1],
    };
    let bits = samples * (rate[0] * rate[1]) as u32;
    let fragment = match random.u32(..6) {
        0 => Fragment::Discard(pick(random, &[1, 2, 3])),
        1 => Fragment::Depth(random_depth(random)),
        2 => Fragment::Mask(random.u32(..1 << bits)),
        _ => Fragment::Plain,
    };
    let blend = random_blend(random);
    let blends = (0..attachments)
        .map(|_| match able.independent_blend {
            true => random_blend(random),
            false => blend,
        })
        .collect();
    let state = DrawState {
        viewport,
        scissor: match random.bool() {
            true => random_area(random),
            false => whole(),
        },
        cull: pick(
            random,
            &[
                vk::CullModeFlags::NONE,
                vk::CullModeFlags::NONE,
                vk::CullModeFlags::FRONT,
                vk::CullModeFlags::BACK,
            ],
        ),
        front: pick(
            random,
            &[vk::FrontFace::CLOCKWISE, vk::FrontFace::COUNTER_CLOCKWISE],
        ),
        fragment,
        rate,
        depth_test: random.bool(),
        depth_write: random.bool(),
        depth_compare: pick(random, &COMPARISONS),
        stencil_test: random.bool(),
        stencil: [random_stencil(random), random_stencil(random)],
        blends,
        logic: (able.logic && random.u32(..4) == 0)
            .then(|| vk::LogicOp::from_raw(random.i32(0..16))),
    };
    Draw {
        state,
        topology,
        point_size,
        vertices,
        instances,
        first_instance,
        instance_count: 1 + random.u32(..INSTANCES - first_instance),
        first_vertex,
        vertex_count: 3 + random.u32(..VERTICES - first_vertex - 2),
        indices,
        vertex_offset,
        is_short: random.bool(),
        passes_on: able.geometry && random.u32(..4) == 0,
    }
}
