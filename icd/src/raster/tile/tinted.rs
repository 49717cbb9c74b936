//! Fragments of programs that do no more than sample an image once and multiply what they find ([`Tinted`]): straight from coverage to attachments
//! of four bytes, sixteen pixels at a time.

use smallvec::SmallVec;
use spirv_jit::image::vector::Vector;
use spirv_jit::interp::TierKind;
use spirv_jit::interp::tinted::Sampling;
use spirv_jit::ir::tinted::{Tint, Tinted};
use spirv_jit::program::Passed;

use super::coverage::Covered;
use super::inputs::{Inputs, Slope, interpolate, perspective_weights, plane_at};
use super::lanes::{IN_BLOCK, IN_ROW, Row, lanes_of, quads_of, vectors};
use super::output::{Output, Rows};
use super::passed::{Part, Value};
use super::samples::Counts;
use super::texels::{Pattern, Places};

/// How a program's fragments are worked off that way.
pub struct Sampled<'a> {
    pub tinted: &'a Tinted,
    /// What texels are multiplied with, by row of outputs, then both coordinates.
    slopes: Vec<Slope>,
    /// Varyings are perspective-correct.
    perspective: bool,
}

impl<'a> Sampled<'a> {
    /// None where the inputs depend on more than pixels' centres, not all varyings are of one kind, or attachments are others.
    pub fn new(tinted: &'a Tinted, inputs: &Inputs, output: &Output) -> Option<Self> {
        let factors = tinted.outputs.iter().map(|tint| match *tint {
            Tint::Passed(row) | Tint::Product(_, row) => row,
            Tint::Texel(_) => Passed::Constant(0),
        });
        let rows: Vec<Passed> = factors
            .chain(tinted.coordinates.map(Passed::Input))
            .collect();
        let slopes = inputs.passed(&rows).slopes()?;
        let mut kinds = slopes.iter().filter_map(|slope| match *slope {
            Slope::Varying(_, perspective) => Some(perspective),
            _ => None,
        });
        let perspective = kinds.next().unwrap_or(false);
        let is_one = kinds.all(|kind| kind == perspective);
        (is_one && output.is_bytes()).then_some(Self {
            tinted,
            slopes,
            perspective,
        })
    }
}

vectors! {
    /// Writes what a primitive's fragments leave; those of blocks have been tested.
    ///
    /// # Safety
    /// What is covered lies in the render area but for blocks at its edge, and with it in all attachments, as does the layer; the tile belongs to
    /// the caller. There are no squares if the image has several levels. What is sampled is there.
    pub unsafe fn draw<V>(
        v,
        kind: TierKind,
        output: &Output,
        sampled: &Sampled<'_>,
        sampling: &Sampling<'_>,
        part: &Part<'_>,
        covered: &Covered,
        counts: &mut Counts,
    ) {
        let mut values = SmallVec::<[Value; 8]>::new();
        for slope in &sampled.slopes {
            values.push(part.value(slope));
        }
        let painter = Painter {
            v,
            kind,
            output,
            sampling,
            part,
            tints: &sampled.tinted.outputs,
            values: &values,
            perspective: sampled.perspective && !part.record.is_affine,
        };
        let layer = part.record.layer;
        for square in &covered.squares {
            let size = i32::from(square.size);
            counts.invocations += (size * size) as u64;
            let [left, top] = square.place(part.corner);
            for y in top..top + size {
                for x in (left..left + size).step_by(16) {
                    // SAFETY: the caller's promise: squares lie in the render area.
                    unsafe { painter.paint(&Places::row(x, y, layer), u16::MAX) };
                }
            }
        }
        for block in &covered.blocks {
            let mask = block.masks[0];
            if mask != 0 {
                counts.invocations += u64::from(mask.count_ones());
                let places = Places::block(block.place(part.corner), layer, part.area);
                // SAFETY: the caller's promise.
                unsafe { painter.paint(&places, mask) };
            }
        }
    }
}

vectors! {
    /// Texels at sixteen coordinates.
    ///
    /// # Safety
    /// What is sampled is there.
    unsafe fn sample<V>(v, sampling: &Sampling<'_>, at: &[Row; 2], active: u16) -> [Row; 4] {
        let mut texels = [[0; 16]; 4];
        // SAFETY: the caller's promise.
        let sampled = unsafe { sampling.texels(v, [v.load(&at[0]), v.load(&at[1])], active) };
        v.store(sampled[0], &mut texels[0]);
        v.store(sampled[1], &mut texels[1]);
        v.store(sampled[2], &mut texels[2]);
        v.store(sampled[3], &mut texels[3]);
        texels
    }
}

/// A primitive while it is drawn.
struct Painter<'a, V: Vector> {
    v: V,
    /// That of the vectors.
    kind: TierKind,
    output: &'a Output,
    sampling: &'a Sampling<'a>,
    part: &'a Part<'a>,
    /// By row of outputs.
    tints: &'a [Tint],
    /// What they are multiplied with, then both coordinates.
    values: &'a [Value],
    perspective: bool,
}

impl<V: Vector> Painter<'_, V> {
    /// Samples and writes sixteen pixels.
    ///
    /// # Safety
    /// As [`draw`], for these places; the mask is not empty.
    #[inline(always)]
    unsafe fn paint(&self, places: &Places, mask: u16) {
        let (v, record) = (self.v, self.part.record);
        let [.., s, t] = self.values else {
            return;
        };
        // The others of their quads decide with the covered lanes what level is sampled; in rows there is one level.
        let (steps, active) = match places.pattern {
            Pattern::Row => (&IN_ROW, mask),
            _ => (&IN_BLOCK, lanes_of(quads_of(mask))),
        };
        let x = v.splat_i(places.x[0].wrapping_sub(record.origin[0]));
        let y = v.splat_i(places.y[0].wrapping_sub(record.origin[1]));
        let at = [
            v.to_f(v.add_i(x, v.load_i(&steps[0]))),
            v.to_f(v.add_i(y, v.load_i(&steps[1]))),
        ];
        let weights = match self.perspective {
            true => {
                let planes = [
                    plane_at(v, &record.perspective[0], at),
                    plane_at(v, &record.perspective[1], at),
                    plane_at(v, &record.perspective[2], at),
                ];
                perspective_weights(v, planes)
            }
            false => [
                plane_at(v, &record.linear[1], at),
                plane_at(v, &record.linear[2], at),
            ],
        };
        let mut coordinates = [[0; 16]; 2];
        v.store(self.value(s, weights), &mut coordinates[0]);
        v.store(self.value(t, weights), &mut coordinates[1]);
        // SAFETY: the caller's promise.
        let texels = unsafe { sample(self.kind, self.sampling, &coordinates, active) };
        for color in &self.output.colors {
            let source = self.colors(&color.source, weights, &texels);
            // SAFETY: the caller's promise.
            unsafe { color.put_colors(v, source, places, mask) };
        }
    }

    #[inline(always)]
    fn value(&self, value: &Value, weights: [V::F; 2]) -> V::F {
        let v = self.v;
        match *value {
            Value::Same(word) => v.splat(f32::from_bits(word)),
            Value::Varying { first, others, .. } => {
                let others = [v.splat(others[0]), v.splat(others[1])];
                interpolate(v, v.splat(first), others, weights)
            }
        }
    }

    /// Components of sixteen colours.
    #[inline(always)]
    fn colors(&self, rows: &Rows, weights: [V::F; 2], texels: &[Row; 4]) -> [V::I; 4] {
        let v = self.v;
        let mut colors = [v.splat_i(0); 4];
        for (color, row) in colors.iter_mut().zip(rows) {
            let Some(row) = *row else {
                continue;
            };
            let value = self.value(&self.values[row], weights);
            *color = v.bits_of(match self.tints[row] {
                Tint::Passed(_) => value,
                Tint::Texel(component) => v.load(&texels[usize::from(component % 4)]),
                Tint::Product(component, _) => {
                    v.mul(value, v.load(&texels[usize::from(component % 4)]))
                }
            });
        }
        colors
    }
}
