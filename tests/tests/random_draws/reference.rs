//! A rasterizer that asks every sample of every pixel, in integers: what the specification says of
//! vertices on the grid of sub-pixels, of constant depths, and of blending without fractions.

use ash::vk;

/// Parts of a pixel's width that positions are counted in: `subPixelPrecisionBits` is 8.
pub const GRID: i64 = 256;
/// The standard locations of four samples, in parts of a pixel ("Multisampling").
const FOUR: [[i64; 2]; 4] = [[96, 32], [224, 96], [32, 160], [160, 224]];
const CENTRE: [[i64; 2]; 1] = [[128, 128]];

/// A rectangle of pixels: left, top, and the first column and row behind it.
#[derive(Clone, Copy, Debug)]
pub struct Area {
    pub low: [i64; 2],
    pub high: [i64; 2],
}

impl Area {
    fn has(&self, pixel: [i64; 2]) -> bool {
        (0..2).all(|axis| self.low[axis] <= pixel[axis] && pixel[axis] < self.high[axis])
    }
}

/// A triangle or a point in the framebuffer, in parts of a pixel.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    Triangle([[i64; 2]; 3]),
    /// The centre and the width.
    Point([i64; 2], i64),
}

/// A primitive of one depth and one colour.
#[derive(Clone, Copy, Debug)]
pub struct Primitive {
    pub shape: Shape,
    pub depth: f32,
    pub color: [u8; 4],
}

/// The work of a fragment shader besides passing the colour on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fragment {
    Plain,
    /// Discards fragments with all of these bits in `x ^ y`, x and y of the pixel in the middle.
    Discard(i64),
    /// Writes this depth.
    Depth(f32),
    /// Writes this mask of the samples of all pixels.
    Mask(u32),
}

/// All state of a draw that fragments meet.
#[derive(Clone, Debug)]
pub struct DrawState {
    pub viewport: Area,
    pub scissor: Area,
    pub cull: vk::CullModeFlags,
    pub front: vk::FrontFace,
    pub fragment: Fragment,
    /// Pixels of a fragment's sides.
    pub rate: [i64; 2],
    pub depth_test: bool,
    pub depth_write: bool,
    pub depth_compare: vk::CompareOp,
    pub stencil_test: bool,
    /// Of front and back.
    pub stencil: [vk::StencilOpState; 2],
    /// How each attachment takes colours.
    pub blends: Vec<vk::PipelineColorBlendAttachmentState>,
    pub logic: Option<vk::LogicOp>,
}

/// Attachments: colours of each attachment, depth and stencil, by pixel and sample.
#[derive(Clone, PartialEq)]
pub struct Frame {
    pub width: i64,
    pub height: i64,
    pub samples: usize,
    pub colors: Vec<Vec<[u8; 4]>>,
    pub depth: Vec<f32>,
    pub stencil: Vec<u8>,
}

impl Frame {
    pub fn new(width: u32, height: u32, samples: usize, attachments: usize) -> Frame {
        let count = (width * height) as usize * samples;
        Frame {
            width: i64::from(width),
            height: i64::from(height),
            samples,
            colors: vec![vec![[0; 4]; count]; attachments],
            depth: vec![0.0; count],
            stencil: vec![0; count],
        }
    }

    fn locations(&self) -> &'static [[i64; 2]] {
        match self.samples {
            1 => &CENTRE,
            _ => &FOUR,
        }
    }

    /// Runs `touch` with the index of each sample of these pixels.
    pub fn in_area(&mut self, area: Area, mut touch: impl FnMut(&mut Frame, usize)) {
        for y in area.low[1].max(0)..area.high[1].min(self.height) {
            for x in area.low[0].max(0)..area.high[0].min(self.width) {
                for sample in 0..self.samples {
                    touch(self, self.index([x, y], sample));
                }
            }
        }
    }

    fn index(&self, pixel: [i64; 2], sample: usize) -> usize {
        (pixel[1] * self.width + pixel[0]) as usize * self.samples + sample
    }

    /// Draws a primitive; answers how many samples pass all tests.
    pub fn draw(&mut self, state: &DrawState, primitive: &Primitive) -> u64 {
        let back = match primitive.shape {
            Shape::Triangle(corners) => {
                let area = doubled_area(corners);
                // The specification's area has the other sign: y goes down ("Basic Polygon
                // Rasterization").
                let is_front = match state.front {
                    vk::FrontFace::CLOCKWISE => area > 0,
                    _ => area < 0,
                };
                let side = match is_front {
                    true => vk::CullModeFlags::FRONT,
                    false => vk::CullModeFlags::BACK,
                };
                if area == 0 || state.cull.contains(side) {
                    return 0;
                }
                usize::from(!is_front)
            }
            Shape::Point(..) => 0,
        };
        let mut passed = 0;
        for y in 0..self.height {
            for x in 0..self.width {
                let pixel = [x, y];
                if !state.scissor.has(pixel) || !state.viewport.has(pixel) {
                    continue;
                }
                let [width, height] = state.rate;
                let middle = |at: i64, size: i64| at / size * size + size / 2;
                if let Fragment::Discard(bits) = state.fragment
                    && (middle(x, width) ^ middle(y, height)) & bits == bits
                {
                    continue;
                }
                // The coverage mask begins with the last pixel ("Multisampling").
                let behind = width * height - 1 - (x % width + y % height * width);
                let first = behind as usize * self.samples;
                for (sample, place) in self.locations().iter().enumerate() {
                    let is_masked = matches!(state.fragment, Fragment::Mask(mask) if mask >> (first + sample) & 1 == 0);
                    let at = [x * GRID + place[0], y * GRID + place[1]];
                    if is_masked || !covers(primitive.shape, at) {
                        continue;
                    }
                    let index = self.index(pixel, sample);
                    passed += u64::from(self.fragment(state, primitive, back, index));
                }
            }
        }
        passed
    }

    /// Stencil test, depth test, and output of one sample: true if it passes.
    fn fragment(
        &mut self,
        state: &DrawState,
        primitive: &Primitive,
        back: usize,
        index: usize,
    ) -> bool {
        let depth = match state.fragment {
            Fragment::Depth(depth) => depth,
            _ => primitive.depth,
        };
        let depth_passes = !state.depth_test || {
            let there = self.depth[index];
            compare(state.depth_compare, depth, there)
        };
        if state.stencil_test {
            let ops = &state.stencil[back];
            let there = self.stencil[index];
            let masked = |it: u32| it & ops.compare_mask & 0xff;
            let passes = compare(
                ops.compare_op,
                masked(ops.reference),
                masked(u32::from(there)),
            );
            let op = match (passes, depth_passes) {
                (false, _) => ops.fail_op,
                (true, false) => ops.depth_fail_op,
                (true, true) => ops.pass_op,
            };
            let new = apply(op, there, ops.reference as u8);
            let mask = ops.write_mask as u8;
            self.stencil[index] = there & !mask | new & mask;
            if !passes {
                return false;
            }
        }
        if !depth_passes {
            return false;
        }
        if state.depth_test && state.depth_write {
            self.depth[index] = depth;
        }
        for (attachment, blend) in state.blends.iter().enumerate() {
            let mut source = primitive.color;
            // The second attachment gets red and blue exchanged.
            if attachment == 1 {
                source.swap(0, 2);
            }
            let there = self.colors[attachment][index];
            let new = match state.logic {
                Some(op) => std::array::from_fn(|c| logic(op, source[c], there[c])),
                None => blended(blend, source, there),
            };
            let mask = blend.color_write_mask.as_raw();
            self.colors[attachment][index] =
                std::array::from_fn(|c| if mask >> c & 1 == 1 { new[c] } else { there[c] });
        }
        true
    }
}

/// Twice the area, positive if the corners go clockwise as seen (y goes down).
fn doubled_area([a, b, c]: [[i64; 2]; 3]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

/// Whether a shape covers a place. On an edge that two triangles share one of them has it: the one
/// whose left or top edge it is.
fn covers(shape: Shape, at: [i64; 2]) -> bool {
    match shape {
        Shape::Triangle(mut corners) => {
            if doubled_area(corners) < 0 {
                corners.swap(1, 2);
            }
            (0..3).all(|edge| {
                let (from, to) = (corners[edge], corners[(edge + 1) % 3]);
                let side = doubled_area([from, to, at]);
                let is_left = to[1] < from[1];
                let is_top = to[1] == from[1] && to[0] > from[0];
                side > 0 || side == 0 && (is_left || is_top)
            })
        }
        Shape::Point(centre, width) => {
            (0..2).all(|axis| 2 * (at[axis] - centre[axis]).abs() < width)
        }
    }
}

fn compare<T: PartialOrd>(op: vk::CompareOp, value: T, there: T) -> bool {
    match op {
        vk::CompareOp::NEVER => false,
        vk::CompareOp::LESS => value < there,
        vk::CompareOp::EQUAL => value == there,
        vk::CompareOp::LESS_OR_EQUAL => value <= there,
        vk::CompareOp::GREATER => value > there,
        vk::CompareOp::NOT_EQUAL => value != there,
        vk::CompareOp::GREATER_OR_EQUAL => value >= there,
        _ => true,
    }
}

fn apply(op: vk::StencilOp, there: u8, reference: u8) -> u8 {
    match op {
        vk::StencilOp::KEEP => there,
        vk::StencilOp::ZERO => 0,
        vk::StencilOp::REPLACE => reference,
        vk::StencilOp::INCREMENT_AND_CLAMP => there.saturating_add(1),
        vk::StencilOp::DECREMENT_AND_CLAMP => there.saturating_sub(1),
        vk::StencilOp::INVERT => !there,
        vk::StencilOp::INCREMENT_AND_WRAP => there.wrapping_add(1),
        _ => there.wrapping_sub(1),
    }
}

fn logic(op: vk::LogicOp, s: u8, d: u8) -> u8 {
    match op {
        vk::LogicOp::CLEAR => 0,
        vk::LogicOp::AND => s & d,
        vk::LogicOp::AND_REVERSE => s & !d,
        vk::LogicOp::COPY => s,
        vk::LogicOp::AND_INVERTED => !s & d,
        vk::LogicOp::NO_OP => d,
        vk::LogicOp::XOR => s ^ d,
        vk::LogicOp::OR => s | d,
        vk::LogicOp::NOR => !(s | d),
        vk::LogicOp::EQUIVALENT => !(s ^ d),
        vk::LogicOp::INVERT => !d,
        vk::LogicOp::OR_REVERSE => s | !d,
        vk::LogicOp::COPY_INVERTED => !s,
        vk::LogicOp::OR_INVERTED => !s | d,
        vk::LogicOp::NAND => !(s & d),
        _ => 255,
    }
}

/// Blending by factors that are zero or one here: alphas are 0 or 255.
fn blended(
    state: &vk::PipelineColorBlendAttachmentState,
    source: [u8; 4],
    there: [u8; 4],
) -> [u8; 4] {
    if state.blend_enable == vk::FALSE {
        return source;
    }
    let factor = |factor| {
        let [source, there] = [source[3] == 255, there[3] == 255];
        i32::from(match factor {
            vk::BlendFactor::ZERO => false,
            vk::BlendFactor::ONE => true,
            vk::BlendFactor::SRC_ALPHA => source,
            vk::BlendFactor::ONE_MINUS_SRC_ALPHA => !source,
            vk::BlendFactor::DST_ALPHA => there,
            _ => !there,
        })
    };
    std::array::from_fn(|component| {
        let [of_source, of_there, op] = match component {
            3 => [
                factor(state.src_alpha_blend_factor),
                factor(state.dst_alpha_blend_factor),
                state.alpha_blend_op.as_raw(),
            ],
            _ => [
                factor(state.src_color_blend_factor),
                factor(state.dst_color_blend_factor),
                state.color_blend_op.as_raw(),
            ],
        };
        let [s, d] = [source[component], there[component]].map(i32::from);
        let value = match vk::BlendOp::from_raw(op) {
            vk::BlendOp::ADD => s * of_source + d * of_there,
            vk::BlendOp::SUBTRACT => s * of_source - d * of_there,
            vk::BlendOp::REVERSE_SUBTRACT => d * of_there - s * of_source,
            vk::BlendOp::MIN => s.min(d),
            _ => s.max(d),
        };
        value.clamp(0, 255) as u8
    })
}
