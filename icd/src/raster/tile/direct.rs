//! Fragments that no program runs for: those of draws without one, and of programs that only pass varyings and constants on. From coverage
//! straight to the attachments, sixteen pixels at a time, whole squares in rows.

use smallvec::SmallVec;
use spirv_jit::image::vector::Vector;

use super::coverage::Covered;
use super::depth::Tested;
use super::inputs::{Inputs, Slope, depths, interpolate, perspective_weights, plane_at};
use super::lanes::{IN_BLOCK, IN_ROW, rows_of, vectors};
use super::output::{Output, Rows};
use super::plan::Plan;
use super::samples::{MAX_SAMPLES, locations};
use super::texels::{Pattern, Places, fill};
use super::visit::{Counts, any, count};
use crate::raster::primitive::{Bounds, Record};

/// What fragments leave without a program that runs.
pub struct Direct {
    /// The outputs; none of a draw without a program.
    slopes: Option<Vec<Slope>>,
    /// What is there already does not matter to the colours.
    replaces: bool,
}

/// A primitive in a tile.
pub struct Part<'a> {
    pub record: &'a Record,
    /// Outputs of its vertices.
    pub outputs: &'a [u32],
    /// The tile's first pixel.
    pub corner: [i32; 2],
    /// The render area.
    pub area: &'a Bounds,
}

/// An output of a primitive's fragments.
#[derive(Clone, Copy)]
enum Value {
    Same(u32),
    /// At the first vertex, and the differences of the others.
    Varying {
        first: f32,
        others: [f32; 2],
        perspective: bool,
    },
}

impl Direct {
    /// Of a program whose outputs are rows like inputs; none where they depend on more than pixels' centres.
    pub fn new(rows: Option<&Inputs>, output: &Output) -> Option<Self> {
        let slopes = match rows {
            Some(rows) => Some(rows.slopes()?),
            None => None,
        };
        Some(Self {
            slopes,
            replaces: output.replaces(),
        })
    }
}

impl Part<'_> {
    fn word(&self, vertex: usize, word: u32) -> u32 {
        let place = self.record.vertices[vertex].wrapping_add(word);
        self.outputs.get(place as usize).copied().unwrap_or(0)
    }

    fn value(&self, slope: &Slope) -> Value {
        let record = self.record;
        Value::Same(match *slope {
            Slope::Constant(word) => word,
            Slope::Flat(word) => self.word(usize::from(record.provoking.min(2)), word),
            Slope::PerVertex(word, vertex) => self.word(vertex, word),
            Slope::Front => u32::from(record.front),
            Slope::Layer => record.layer,
            Slope::Viewport => record.viewport,
            Slope::Primitive => record.primitive_id,
            Slope::View => record.view_index,
            Slope::Varying(word, perspective) => {
                let at = |vertex: usize| f32::from_bits(self.word(vertex, word));
                let first = at(0);
                return Value::Varying {
                    first,
                    others: [at(1) - first, at(2) - first],
                    perspective,
                };
            }
        })
    }
}

vectors! {
    /// Tests a primitive's fragments and writes what they leave.
    ///
    /// # Safety
    /// What is covered lies in the render area but for blocks at its edge, and with it in all attachments, as does the layer; the tile belongs to
    /// the caller.
    pub unsafe fn draw<V>(
        v,
        plan: &Plan<'_>,
        direct: &Direct,
        part: &Part<'_>,
        covered: &Covered,
        counts: &mut Counts,
    ) {
        // SAFETY: the caller's promise.
        unsafe { Painter::new(v, plan, direct, part).paint(covered, counts) };
    }
}

/// A primitive while it is drawn.
struct Painter<'a, V: Vector> {
    v: V,
    plan: &'a Plan<'a>,
    part: &'a Part<'a>,
    has_program: bool,
    /// By row of outputs.
    values: SmallVec<[Value; 8]>,
    /// The texel of each attachment, where they are the same everywhere.
    solid: Option<SmallVec<[[u32; 4]; 2]>>,
}

impl<'a, V: Vector> Painter<'a, V> {
    #[inline(always)]
    fn new(v: V, plan: &'a Plan<'a>, direct: &Direct, part: &'a Part<'a>) -> Self {
        let mut values = SmallVec::new();
        for slope in direct.slopes.iter().flatten() {
            values.push(part.value(slope));
        }
        let mut painter = Self {
            v,
            plan,
            part,
            has_program: direct.slopes.is_some(),
            values,
            solid: None,
        };
        if direct.replaces {
            painter.solid = painter.texels();
        }
        painter
    }

    /// The texels, if all fragments leave the same.
    #[inline(always)]
    fn texels(&self) -> Option<SmallVec<[[u32; 4]; 2]>> {
        let v = self.v;
        let mut texels = SmallVec::new();
        for color in &self.plan.output.colors {
            let mut source = [v.splat_i(0); 4];
            for (component, place) in color.source.iter().enumerate() {
                let Some(place) = place else {
                    continue;
                };
                let Value::Same(word) = self.values[*place] else {
                    return None;
                };
                source[component] = v.splat_i(word as i32);
            }
            let words = color.encode(v, &color.with_alpha(v, source));
            let rows = rows_of(v, &words);
            texels.push([rows[0][0], rows[1][0], rows[2][0], rows[3][0]]);
        }
        Some(texels)
    }

    /// # Safety
    /// As [`draw`].
    #[inline(always)]
    unsafe fn paint(&self, covered: &Covered, counts: &mut Counts) {
        let Self { plan, part, .. } = self;
        let layer = part.record.layer;
        let mut whole = [0; MAX_SAMPLES];
        for (sample, mask) in whole.iter_mut().enumerate().take(plan.samples as usize) {
            if plan.sample_mask >> sample & 1 != 0 {
                *mask = u16::MAX;
            }
        }
        if any(&whole) == 0 {
            return;
        }
        let solid = self.solid.as_ref().filter(|_| plan.tests.is_empty());
        for square in &covered.squares {
            let [left, top] = square.place(part.corner);
            let size = i32::from(square.size);
            if let Some(texels) = solid {
                let pixels = (size * size) as u64;
                counts.samples += pixels / 16 * count(&whole);
                counts.invocations += if self.has_program { pixels } else { 0 };
                for (color, texel) in plan.output.colors.iter().zip(texels) {
                    for sample in (0..plan.samples).filter(|&sample| whole[sample as usize] != 0) {
                        // SAFETY: the caller's promise.
                        unsafe { fill(&color.target, [left, top], size, layer, sample, texel) };
                    }
                }
                continue;
            }
            for y in top..top + size {
                for x in (left..left + size).step_by(16) {
                    // SAFETY: the caller's promise: squares lie in the render area.
                    unsafe { self.sixteen(&Places::row(x, y, layer), &whole, counts) };
                }
            }
        }
        for block in &covered.blocks {
            let mut masks = block.masks;
            for (mask, whole) in masks.iter_mut().zip(&whole) {
                *mask &= whole;
            }
            let places = Places::block(block.place(part.corner), layer, part.area);
            // SAFETY: the caller's promise.
            unsafe { self.sixteen(&places, &masks, counts) };
        }
    }

    /// # Safety
    /// As [`draw`], for these places.
    #[inline(always)]
    unsafe fn sixteen(&self, places: &Places, masks: &[u16; MAX_SAMPLES], counts: &mut Counts) {
        let Self { v, plan, part, .. } = self;
        let (v, record) = (*v, part.record);
        let from = [places.x[0], places.y[0]];
        let steps = match places.pattern {
            Pattern::Row => &IN_ROW,
            _ => &IN_BLOCK,
        };
        let mut masks = *masks;
        if !plan.tests.is_empty() {
            let front = if record.front { u16::MAX } else { 0 };
            let range = plan.clamps_depth.then_some(record.depth_range);
            let locations = locations(plan.samples);
            for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
                if *mask == 0 {
                    continue;
                }
                let depths = match plan.tests.uses_depths() {
                    true => depths(v, record, from, steps, locations[sample], range),
                    false => v.splat(0.0),
                };
                let tested = Tested {
                    places,
                    front,
                    depths,
                    references: None,
                };
                // SAFETY: the caller's promise.
                *mask = unsafe { plan.tests.run(v, &tested, sample as u32, *mask) };
            }
        }
        let lanes = any(&masks);
        if lanes == 0 {
            return;
        }
        counts.samples += count(&masks);
        if !self.has_program {
            return;
        }
        counts.invocations += u64::from(lanes.count_ones());
        if let Some(texels) = &self.solid {
            for (color, texel) in plan.output.colors.iter().zip(texels) {
                let words = [
                    v.splat_i(texel[0] as i32),
                    v.splat_i(texel[1] as i32),
                    v.splat_i(texel[2] as i32),
                    v.splat_i(texel[3] as i32),
                ];
                for (sample, &mask) in masks.iter().enumerate().take(plan.samples as usize) {
                    if mask != 0 {
                        // SAFETY: the caller's promise.
                        unsafe { color.put(v, places, sample as u32, mask, &words) };
                    }
                }
            }
            return;
        }
        let x = v.splat_i(from[0].wrapping_sub(record.origin[0]));
        let y = v.splat_i(from[1].wrapping_sub(record.origin[1]));
        let at = [
            v.to_f(v.add_i(x, v.load_i(&steps[0]))),
            v.to_f(v.add_i(y, v.load_i(&steps[1]))),
        ];
        let mut weights = Weights {
            at,
            linear: None,
            perspective: None,
        };
        for color in &plan.output.colors {
            let source = color.with_alpha(v, self.colors(&color.source, &mut weights));
            let second = match color.blend {
                Some(_) => color.with_alpha(v, self.colors(&color.second, &mut weights)),
                None => source,
            };
            // SAFETY: the caller's promise.
            unsafe {
                (plan.output).write_color(v, color, &source, &second, places, &masks);
            }
        }
    }

    /// Components of sixteen colours.
    #[inline(always)]
    fn colors(&self, rows: &Rows, weights: &mut Weights<V>) -> [V::I; 4] {
        let v = self.v;
        let mut colors = [v.splat_i(0); 4];
        for (color, place) in colors.iter_mut().zip(rows) {
            let Some(place) = place else {
                continue;
            };
            *color = match self.values[*place] {
                Value::Same(word) => v.splat_i(word as i32),
                Value::Varying {
                    first,
                    others,
                    perspective,
                } => {
                    let weights = weights.of(v, self.part.record, perspective);
                    let others = [v.splat(others[0]), v.splat(others[1])];
                    v.bits_of(interpolate(v, v.splat(first), others, weights))
                }
            };
        }
        colors
    }
}

/// Barycentric coordinates of the second and third vertex in sixteen pixels, once they are known.
struct Weights<V: Vector> {
    /// From the record's origin on.
    at: [V::F; 2],
    linear: Option<[V::F; 2]>,
    perspective: Option<[V::F; 2]>,
}

impl<V: Vector> Weights<V> {
    #[inline(always)]
    fn of(&mut self, v: V, record: &Record, perspective: bool) -> [V::F; 2] {
        let known = match perspective {
            true => &mut self.perspective,
            false => &mut self.linear,
        };
        if let Some(known) = known {
            return *known;
        }
        let found = match perspective {
            true => {
                let planes = [
                    plane_at(v, &record.perspective[0], self.at),
                    plane_at(v, &record.perspective[1], self.at),
                    plane_at(v, &record.perspective[2], self.at),
                ];
                perspective_weights(v, planes)
            }
            false => [
                plane_at(v, &record.linear[1], self.at),
                plane_at(v, &record.linear[2], self.at),
            ],
        };
        *known = Some(found);
        found
    }
}
