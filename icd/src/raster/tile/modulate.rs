//! Fragments of programs that do no more than sample an image once and multiply what they find
//! ([`Modulated`]): straight from coverage to attachments of four bytes, sixteen pixels at a time.

use lanes::vector::Vector;
use lanes::{LaneMask, Tier};
use smallvec::SmallVec;
use spirv_jit::interp::modulate::{Sampling, TOGETHER};
use spirv_jit::ir::modulate::{Modulated, ModulatedOutput};
use spirv_jit::program::PassThrough;

use super::HAS_PORTABLE_LOOPS;
use super::color::ComponentRows;
use super::coverage::{Covered, Square};
use super::inputs::{Inputs, Slope};
use super::interpolation::{interpolate, perspective_weights, plane_at};
use super::lanes::{IN_BLOCK, IN_ROW, Row, lanes_of, quads_of};
use super::output::Output;
use super::pass_through::{Change, Part, Value};
use super::places::{Pattern, Places};
use super::rectangle::{Cells, EdgeTest, Rectangle};
use super::samples::Counts;
use super::texels::{load_word, store_word};
use crate::raster::primitive::{Bounds, Edge, PlaneEquation, Record};

/// How a program's fragments are worked off that way.
pub struct Sampled<'a> {
    pub modulated: &'a Modulated,
    /// The slopes of the factors of texels, by row of outputs, then both coordinates.
    slopes: Vec<Slope>,
    /// Varyings are perspective-correct.
    perspective: bool,
}

impl<'a> Sampled<'a> {
    /// None where the inputs depend on more than pixels' centres, not all varyings are of one kind,
    /// or attachments are others.
    pub fn new(modulated: &'a Modulated, inputs: &Inputs, output: &Output) -> Option<Self> {
        let outputs = modulated.outputs.iter().take(output.rows);
        let factors = outputs.map(|output| match *output {
            ModulatedOutput::PassThrough(row) | ModulatedOutput::Product(_, row) => row,
            ModulatedOutput::Texel(_) => PassThrough::Constant(0),
        });
        let rows: Vec<PassThrough> = factors
            .chain(modulated.coordinates.map(PassThrough::Input))
            .collect();
        let slopes = inputs.pass_through(&rows).slopes(rows.len())?;
        let mut kinds = slopes.iter().filter_map(|slope| match *slope {
            Slope::Varying(_, perspective) => Some(perspective),
            _ => None,
        });
        let perspective = kinds.next().unwrap_or(false);
        let is_one = kinds.all(|kind| kind == perspective);
        (is_one && output.is_bytes()).then_some(Self {
            modulated,
            slopes,
            perspective,
        })
    }
}

lanes::vectors! {
    /// Writes what a primitive's fragments leave; those of blocks have been tested.
    ///
    /// # Safety
    /// The covered area lies in the render area, except for blocks at its edge, and so in all
    /// attachments, as does the layer; the tile belongs to the caller. There are no squares if the
    /// image has several levels. The sampled image exists.
    pub unsafe fn draw<V>(
        v,
        kind: Tier,
        output: &Output,
        sampled: &Sampled<'_>,
        sampling: &Sampling<'_>,
        part: &Part<'_>,
        covered: &Covered,
        counts: &mut Counts,
    ) {
        if !V::IS_MACHINES && !HAS_PORTABLE_LOOPS {
            unreachable!("these fragments run their program");
        }
        let primitive = Primitive::new(sampled, part);
        let painter = SampledPrimitives::new(v, kind, output, sampled, sampling);
        let invocations = |square: &Square| u64::from(square.size) * u64::from(square.size);
        counts.invocations += covered.squares.iter().map(invocations).sum::<u64>();
        let of_blocks = covered.blocks.iter().map(|block| block.masks[0].count_ones());
        counts.invocations += u64::from(of_blocks.sum::<u32>());
        let mut fragments = Fragments::new(covered, part);
        while let Some(some) = SampleBatch::of(&mut fragments) {
            // SAFETY: the caller keeps the contract of this function; squares lie in the render
            // area.
            unsafe { painter.paint(&primitive, some) };
        }
    }
}

lanes::vectors! {
    /// Writes what the fragments of two triangles leave that make up a rectangle, in the cells of
    /// `limit`.
    ///
    /// # Safety
    /// The rectangle lies in the limit, that in the render area and with it in all attachments, as
    /// does the layer; the limit's pixels belong to the caller. What is sampled is there, and has
    /// one level.
    pub unsafe fn draw_rectangle<V>(
        v,
        kind: Tier,
        output: &Output,
        sampled: &Sampled<'_>,
        sampling: &Sampling<'_>,
        parts: [&Part<'_>; 2],
        rectangle: &Rectangle,
        limit: &Bounds,
        counts: &mut Counts,
    ) {
        if !V::IS_MACHINES && !HAS_PORTABLE_LOOPS {
            unreachable!("these fragments run their program");
        }
        counts.invocations += rectangle.area();
        let primitives = [
            Primitive::new(sampled, parts[0]),
            Primitive::new(sampled, parts[1]),
        ];
        let painter = SampledPrimitives::new(v, kind, output, sampled, sampling);
        let cells = rectangle.cells(limit, parts[0].record.layer.into());
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match primitives[0].is_like(&primitives[1]) {
                true => painter.paint_same(&primitives[0], cells),
                false => painter.paint_both(&primitives, &rectangle.diagonal, cells),
            }
        }
    }
}

/// Up to as many times sixteen pixels as are sampled in one call: their places, and masks that are
/// not empty.
struct SampleBatch {
    places: [Places; TOGETHER],
    masks: [u16; TOGETHER],
    count: usize,
}

impl SampleBatch {
    /// The next ones.
    #[inline(always)]
    fn of(from: &mut impl Iterator<Item = (Places, u16)>) -> Option<Self> {
        let mut some = Self {
            places: [Places::default(); TOGETHER],
            masks: [0; TOGETHER],
            count: 0,
        };
        while some.count < TOGETHER {
            let Some((places, mask)) = from.next() else {
                break;
            };
            if mask != 0 {
                (some.places[some.count], some.masks[some.count]) = (places, mask);
                some.count += 1;
            }
        }
        (some.count != 0).then_some(some)
    }
}

/// The covered pixels: sixteen of a row each, then blocks.
struct Fragments<'a> {
    covered: &'a Covered,
    corner: [i32; 2],
    area: &'a Bounds,
    layer: u32,
    /// The next square, and pixels of it that were given; then the next block.
    square: usize,
    given: usize,
    block: usize,
}

impl<'a> Fragments<'a> {
    fn new(covered: &'a Covered, part: &Part<'a>) -> Self {
        Self {
            covered,
            corner: part.corner,
            area: part.area,
            layer: part.record.layer.into(),
            square: 0,
            given: 0,
            block: 0,
        }
    }
}

impl Iterator for Fragments<'_> {
    type Item = (Places, u16);

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        if let Some(square) = self.covered.squares.get(self.square) {
            let [left, top] = square.place(self.corner);
            let size = usize::from(square.size);
            let (x, y) = ((self.given % size) as i32, (self.given / size) as i32);
            self.given += 16;
            if self.given == size * size {
                (self.square, self.given) = (self.square + 1, 0);
            }
            return Some((Places::row(left + x, top + y, self.layer), u16::MAX));
        }
        let block = self.covered.blocks.get(self.block)?;
        self.block += 1;
        let place = block.place(self.corner);
        let places = Places::block(place, self.layer, self.area);
        Some((places, block.masks[0]))
    }
}

/// The data from which a primitive's fragments are computed.
struct Primitive<'a> {
    record: &'a Record,
    linear: &'a [PlaneEquation; 3],
    /// The slopes of the factors of texels, by row of outputs, then both coordinates.
    values: SmallVec<[Value; 8]>,
    perspective: bool,
}

impl<'a> Primitive<'a> {
    #[inline(always)]
    fn new(sampled: &Sampled<'_>, part: &Part<'a>) -> Self {
        let mut values = SmallVec::new();
        for slope in &sampled.slopes {
            values.push(part.value(slope));
        }
        Self {
            record: part.record,
            linear: part.linear,
            values,
            perspective: sampled.perspective && !part.record.is_affine,
        }
    }

    /// Whether all fragments of both leave the same.
    fn is_like(&self, other: &Self) -> bool {
        let is_like =
            |(one, other): (&Value, &Value)| one.word().is_some() && one.word() == other.word();
        self.values.iter().zip(&other.values).all(is_like)
    }
}

/// Primitives while they are drawn.
struct SampledPrimitives<'a, V: Vector> {
    v: V,
    /// That of the vectors.
    kind: Tier,
    output: &'a Output,
    sampling: &'a Sampling<'a>,
    /// By row of outputs.
    outputs: &'a [ModulatedOutput],
}

/// Barycentric coordinates of the second and third vertex in sixteen pixels.
type Barycentrics<V> = [<V as Vector>::F; 2];

impl<'a, V: Vector> SampledPrimitives<'a, V> {
    #[inline(always)]
    fn new(
        v: V,
        kind: Tier,
        output: &'a Output,
        sampled: &'a Sampled<'_>,
        sampling: &'a Sampling<'a>,
    ) -> Self {
        Self {
            v,
            kind,
            output,
            sampling,
            outputs: &sampled.modulated.outputs,
        }
    }

    /// Samples and writes some pixels.
    ///
    /// # Safety
    /// As [`draw`], for these places.
    #[inline(always)]
    unsafe fn paint(&self, primitive: &Primitive<'_>, some: SampleBatch) {
        let mut weights = [[self.v.splat(0.0); 2]; TOGETHER];
        let mut at = [[[0; 16]; 2]; TOGETHER];
        for index in 0..some.count {
            weights[index] = self.weights(primitive, &some.places[index]);
            let coordinates = self.coordinates(primitive, weights[index]);
            self.v.store(coordinates[0], &mut at[index][0]);
            self.v.store(coordinates[1], &mut at[index][1]);
        }
        // SAFETY: the caller keeps the contract of `draw`, for these places.
        let texels = unsafe { self.sample(&mut at, &some) };
        for index in 0..some.count {
            for color in &self.output.colors {
                let texels = &texels[index];
                let source = self.colors(&color.source, primitive, weights[index], texels);
                // SAFETY: the caller keeps the contract of `draw`, for these places.
                unsafe { color.put_colors(self.v, source, &some.places[index], some.masks[index]) };
            }
        }
    }

    /// Samples and writes the cells of two primitives, of which the first has the pixels inside of
    /// an edge.
    ///
    /// # Safety
    /// As [`draw_rectangle`].
    #[inline(always)]
    unsafe fn paint_both(&self, primitives: &[Primitive<'_>; 2], diagonal: &Edge, cells: Cells) {
        let v = self.v;
        let [first, second] = primitives;
        let side = EdgeTest::new(v, diagonal);
        let mut cells = cells;
        while let Some(some) = SampleBatch::of(&mut cells) {
            let mut insides = [0; TOGETHER];
            let mut weights = [[[v.splat(0.0); 2]; 2]; TOGETHER];
            let mut at = [[[0; 16]; 2]; TOGETHER];
            for index in 0..some.count {
                let places = &some.places[index];
                let inside = side.inside(v, places);
                let both = [self.weights(first, places), self.weights(second, places)];
                let of_first = self.coordinates(first, both[0]);
                let of_second = self.coordinates(second, both[1]);
                let [to_s, to_t] = &mut at[index];
                v.store(self.select(inside, of_first[0], of_second[0]), to_s);
                v.store(self.select(inside, of_first[1], of_second[1]), to_t);
                (insides[index], weights[index]) = (inside, both);
            }
            // SAFETY: the caller keeps the contract of `draw_rectangle`.
            let texels = unsafe { self.sample(&mut at, &some) };
            for index in 0..some.count {
                let (inside, texels) = (insides[index], &texels[index]);
                let [weights_of_first, weights_of_second] = weights[index];
                for color in &self.output.colors {
                    let of_first = self.colors(&color.source, first, weights_of_first, texels);
                    let of_second = self.colors(&color.source, second, weights_of_second, texels);
                    let source = [
                        v.select(inside, of_first[0], of_second[0]),
                        v.select(inside, of_first[1], of_second[1]),
                        v.select(inside, of_first[2], of_second[2]),
                        v.select(inside, of_first[3], of_second[3]),
                    ];
                    let (places, mask) = (&some.places[index], some.masks[index]);
                    // SAFETY: the caller keeps the contract of `draw_rectangle`.
                    unsafe { color.put_colors(v, source, places, mask) };
                }
            }
        }
    }

    /// Writes cells whose fragments all leave the same, sampled once.
    ///
    /// # Safety
    /// As [`draw_rectangle`].
    #[inline(always)]
    unsafe fn paint_same(&self, primitive: &Primitive<'_>, cells: Cells) {
        let v = self.v;
        let none = [v.splat(0.0); 2];
        let coordinates = self.coordinates(primitive, none);
        let mut at = [[[0; 16]; 2]; TOGETHER];
        v.store(coordinates[0], &mut at[0][0]);
        v.store(coordinates[1], &mut at[0][1]);
        let mut texels = [[[0; 16]; 4]; TOGETHER];
        let one = [LaneMask::from_bits(1)];
        // SAFETY: the caller keeps the contract of `draw_rectangle`.
        unsafe { self.sampling.texels(self.kind, &mut at, &one, &mut texels) };
        let texels = texels[0].map(|row| [row[0]; 16]);
        let [color] = &self.output.colors[..] else {
            for (places, mask) in cells {
                for color in &self.output.colors {
                    let source = self.colors(&color.source, primitive, none, &texels);
                    // SAFETY: the caller keeps the contract of `draw_rectangle`.
                    unsafe { color.put_colors(v, source, &places, mask) };
                }
            }
            return;
        };
        let source = self.colors(&color.source, primitive, none, &texels);
        let source_over = color.source_over(v, source);
        for (places, mask) in cells {
            // SAFETY: the caller keeps the contract of `draw_rectangle`.
            unsafe {
                if let Some(source_over) = &source_over {
                    let old = load_word(v, &color.target, &places, 0, mask);
                    store_word(v, &color.target, &places, 0, mask, source_over.over(v, old));
                } else {
                    color.put_colors(v, source, &places, mask);
                }
            }
        }
    }

    /// In sixteen pixels.
    #[inline(always)]
    fn weights(&self, primitive: &Primitive<'_>, places: &Places) -> Barycentrics<V> {
        let (v, record) = (self.v, primitive.record);
        let steps = match places.pattern {
            Pattern::Row => &IN_ROW,
            _ => &IN_BLOCK,
        };
        let x = v.splat_i(places.x[0].wrapping_sub(record.origin[0].into()));
        let y = v.splat_i(places.y[0].wrapping_sub(record.origin[1].into()));
        let at = [
            v.to_f(v.add_i(x, v.load_i(&steps[0]))),
            v.to_f(v.add_i(y, v.load_i(&steps[1]))),
        ];
        match primitive.perspective {
            true => {
                let planes = [
                    plane_at(v, &record.perspective[0], at),
                    plane_at(v, &record.perspective[1], at),
                    plane_at(v, &record.perspective[2], at),
                ];
                perspective_weights(v, planes)
            }
            false => [
                plane_at(v, &primitive.linear[1], at),
                plane_at(v, &primitive.linear[2], at),
            ],
        }
    }

    /// Where the image is sampled.
    #[inline(always)]
    fn coordinates(&self, primitive: &Primitive<'_>, weights: Barycentrics<V>) -> [V::F; 2] {
        match &primitive.values[..] {
            [.., s, t] => [self.value(s, weights), self.value(t, weights)],
            _ => [self.v.splat(0.0); 2],
        }
    }

    /// The texels at some pixels' coordinates.
    ///
    /// # Safety
    /// The sampled image exists.
    #[inline(always)]
    unsafe fn sample(
        &self,
        at: &mut [[Row; 2]; TOGETHER],
        some: &SampleBatch,
    ) -> [[Row; 4]; TOGETHER] {
        let mut active = [LaneMask::NONE; TOGETHER];
        for index in 0..some.count {
            // The others of their quads decide with the covered lanes what level is sampled; in
            // rows there is one level.
            let mask = some.masks[index];
            active[index] = LaneMask::from_bits(match some.places[index].pattern {
                Pattern::Row => mask,
                _ => lanes_of(quads_of(mask)),
            });
        }
        let mut texels = [[[0; 16]; 4]; TOGETHER];
        let active = &active[..some.count];
        // SAFETY: the caller guarantees that the sampled image exists.
        unsafe { self.sampling.texels(self.kind, at, active, &mut texels) };
        texels
    }

    #[inline(always)]
    fn select(&self, mask: u16, a: V::F, b: V::F) -> V::F {
        let v = self.v;
        v.bits_to_f(v.select(mask, v.bits_of(a), v.bits_of(b)))
    }

    #[inline(always)]
    fn value(&self, value: &Value, weights: Barycentrics<V>) -> V::F {
        let v = self.v;
        let first = v.splat(f32::from_bits(value.word));
        if value.change == Change::None {
            return first;
        }
        let others = [v.splat(value.others[0]), v.splat(value.others[1])];
        interpolate(v, first, others, weights)
    }

    /// Components of sixteen colours.
    #[inline(always)]
    fn colors(
        &self,
        rows: &ComponentRows,
        primitive: &Primitive<'_>,
        weights: Barycentrics<V>,
        texels: &[Row; 4],
    ) -> [V::I; 4] {
        let v = self.v;
        let mut colors = [v.splat_i(0); 4];
        for (color, row) in colors.iter_mut().zip(rows) {
            let Some(row) = *row else {
                continue;
            };
            let value = self.value(&primitive.values[row], weights);
            *color = v.bits_of(match self.outputs[row] {
                ModulatedOutput::PassThrough(_) => value,
                ModulatedOutput::Texel(component) => v.load(&texels[usize::from(component % 4)]),
                ModulatedOutput::Product(component, _) => {
                    v.mul(value, v.load(&texels[usize::from(component % 4)]))
                }
            });
        }
        colors
    }
}
