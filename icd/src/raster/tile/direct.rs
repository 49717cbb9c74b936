//! Fragments that no program runs for: those of draws without one, and of programs that only pass
//! varyings and constants on. From coverage straight to the attachments, sixteen pixels at a time,
//! whole squares in rows.

use lanes::vector::Vector;
use smallvec::SmallVec;

use super::color::{ComponentRows, SourceOver};
use super::coverage::{Covered, Square};
use super::depth::{Plain, Tested};
use super::interpolation::{clamped, depths, interpolate, perspective_weights, plane_at};
use super::lanes::{IN_BLOCK, IN_ROW, Row, row_of};
use super::pass_through::{Change, Part, PassThrough, Texels, Value, texels_of};
use super::places::{Pattern, Places};
use super::plan::Plan;
use super::samples::{Counts, MAX_SAMPLES, count};
use super::scalar::fill;
use super::texels::{load_word, store, store_word};
use crate::raster::Target;

lanes::vectors! {
    /// Tests a primitive's fragments and writes their colours and depths.
    ///
    /// # Safety
    /// The covered area lies in the render area, except for blocks at its edge, and so in all
    /// attachments, as does the layer; the tile belongs to the caller.
    pub unsafe fn draw<V>(
        v,
        plan: &Plan<'_>,
        pass_through: &PassThrough,
        part: &Part<'_>,
        covered: &Covered,
        counts: &mut Counts,
    ) {
        let mut values = SmallVec::<[Value; 8]>::new();
        let mut solid = None;
        if pass_through.constant.is_none() {
            for slope in pass_through.slopes.iter().flatten() {
                values.push(part.value(slope));
            }
            if pass_through.replaces {
                solid = texels_of(v, &plan.output, &values);
            }
        }
        let solid = pass_through.constant.as_ref().or(solid.as_ref());
        let painter = DirectPrimitive {
            v,
            plan,
            part,
            plain: plan.tests.plain().filter(|_| plan.samples == 1),
            is_untested: plan.samples == 1 && plan.tests.is_empty(),
            has_program: pass_through.slopes.is_some(),
            values: &values,
            solid,
            source_over: match solid {
                None => source_over_of(v, plan, &values),
                Some(_) => None,
            },
        };
        // SAFETY: the caller owns the tile, and covers only the render area, except for blocks at
        // its edge.
        unsafe { painter.paint(covered, counts) };
    }
}

/// The blend of a primitive of one colour over the only attachment, if blending is of that kind.
#[inline(always)]
fn source_over_of<V: Vector>(v: V, plan: &Plan<'_>, values: &[Value]) -> Option<SourceOver<V>> {
    let ([color], 1) = (&plan.output.colors[..], plan.samples) else {
        return None;
    };
    let mut source = [v.splat_i(0); 4];
    for (component, place) in source.iter_mut().zip(&color.source) {
        let Some(place) = place else {
            continue;
        };
        *component = v.splat_i(values[*place].word()? as i32);
    }
    color.source_over(v, source)
}

/// Columns and rows of the lanes of a row or a block.
#[inline(always)]
fn steps_of(places: &Places) -> &'static [Row; 2] {
    match places.pattern {
        Pattern::Row => &IN_ROW,
        _ => &IN_BLOCK,
    }
}

/// A primitive while it is drawn.
struct DirectPrimitive<'a, V: Vector> {
    v: V,
    plan: &'a Plan<'a>,
    part: &'a Part<'a>,
    /// The only test of the only samples.
    plain: Option<Plain<'a>>,
    /// No test applies to the only samples.
    is_untested: bool,
    has_program: bool,
    /// By row of outputs, if the texels are not those of all primitives.
    values: &'a [Value],
    /// The texel of each attachment, where they are the same everywhere in the primitive.
    solid: Option<&'a Texels>,
    /// The blend over the only attachment, if the colour is uniform.
    source_over: Option<SourceOver<V>>,
}

impl<V: Vector> DirectPrimitive<'_, V> {
    /// Draws the covered pixels.
    ///
    /// # Safety
    /// As [`draw`].
    #[inline(always)]
    unsafe fn paint(&self, covered: &Covered, counts: &mut Counts) {
        let plan = self.plan;
        let whole = plan.whole();
        if whole == [0; MAX_SAMPLES] {
            return;
        }
        let filled = self.solid.filter(|_| plan.tests.is_empty());
        if let Some(texels) = filled {
            // SAFETY: the caller provides squares in the render area.
            unsafe { self.fill_squares(texels, covered, &whole, counts) };
        }
        let source_over = self.source_over.as_ref().filter(|_| plan.tests.is_empty());
        if let (Some(source_over), [color]) = (source_over, &plan.output.colors[..]) {
            // SAFETY: the caller provides squares in the render area.
            unsafe { self.blend_squares(source_over, &color.target, covered, counts) };
        }
        let squares = match filled.is_some() || source_over.is_some() {
            true => &[],
            false => &covered.squares[..],
        };
        // SAFETY: the caller provides squares in the render area, and blocks that are outside of it
        // only at its edge.
        unsafe { self.paint_rows(squares, covered, &whole, counts) };
    }

    /// Fills the squares, which no test applies to, with the texel of each attachment.
    ///
    /// # Safety
    /// As [`draw`].
    #[inline(always)]
    unsafe fn fill_squares(
        &self,
        texels: &Texels,
        covered: &Covered,
        whole: &[u16; MAX_SAMPLES],
        counts: &mut Counts,
    ) {
        let Self { plan, part, .. } = self;
        let layer = part.record.layer.into();
        for square in &covered.squares {
            let size = i32::from(square.size);
            let pixels = (size * size) as u64;
            counts.samples += pixels / 16 * count(whole);
            counts.invocations += if self.has_program { pixels } else { 0 };
            for (color, texel) in plan.output.colors.iter().zip(texels) {
                for sample in (0..plan.samples).filter(|&sample| whole[sample as usize] != 0) {
                    let place = square.place(part.corner);
                    // SAFETY: the caller provides squares in the render area, and so in all
                    // attachments.
                    unsafe { fill(&color.target, place, size, layer, sample, texel) };
                }
            }
        }
    }

    /// Blends the squares, which no test applies to, with the only attachment.
    ///
    /// # Safety
    /// As [`draw`].
    #[inline(always)]
    unsafe fn blend_squares(
        &self,
        source_over: &SourceOver<V>,
        target: &Target,
        covered: &Covered,
        counts: &mut Counts,
    ) {
        for square in &covered.squares {
            let pixels = u64::from(square.size) * u64::from(square.size);
            counts.samples += pixels;
            counts.invocations += pixels;
            let place = square.place(self.part.corner);
            // SAFETY: the caller provides squares in the render area.
            unsafe { self.lay(source_over, target, place, square.size) };
        }
    }

    /// Draws squares, and all blocks, by rows or blocks of sixteen pixels.
    ///
    /// # Safety
    /// As [`draw`].
    #[inline(always)]
    unsafe fn paint_rows(
        &self,
        squares: &[Square],
        covered: &Covered,
        whole: &[u16; MAX_SAMPLES],
        counts: &mut Counts,
    ) {
        let part = self.part;
        let layer = part.record.layer.into();
        // One loop for both, so that the code has their work once.
        for index in 0..squares.len() + covered.blocks.len() {
            let (mut masks, mut size) = (*whole, 1);
            let first = match squares.get(index) {
                Some(square) => {
                    size = i32::from(square.size);
                    let [x, y] = square.place(part.corner);
                    Places::row(x, y, layer)
                }
                None => {
                    let block = &covered.blocks[index - squares.len()];
                    for (mask, of_block) in masks.iter_mut().zip(&block.masks) {
                        *mask &= of_block;
                    }
                    Places::block(block.place(part.corner), layer, part.area)
                }
            };
            for across in (0..size).step_by(16) {
                let mut places = first;
                places.x[0] += across;
                // SAFETY: the caller provides squares and blocks in the render area.
                unsafe { self.paint_column(places, size, &masks, counts) };
            }
        }
    }

    /// Draws one below the other: `rows` rows of sixteen pixels, or a block.
    ///
    /// # Safety
    /// As [`draw`], for these places.
    #[inline(always)]
    unsafe fn paint_column(
        &self,
        mut places: Places,
        rows: i32,
        masks: &[u16; MAX_SAMPLES],
        counts: &mut Counts,
    ) {
        let column = match self.plain {
            Some(_) if rows > 1 => Some(self.column(places.x[0])),
            _ => None,
        };
        for _ in 0..rows {
            let mut masks = *masks;
            // SAFETY: the caller provides places in the render area.
            unsafe {
                let depths = match self.plain {
                    None => None,
                    Some(_) => self.plain_depths(&places, column),
                };
                let lanes = match (self.plain, depths) {
                    (Some(plain), Some(depths)) => {
                        masks[0] = plain.run(self.v, &places, depths, masks[0]);
                        counts.samples += u64::from(masks[0].count_ones());
                        masks[0]
                    }
                    _ if self.is_untested => {
                        counts.samples += u64::from(masks[0].count_ones());
                        masks[0]
                    }
                    _ => self.test(&places, &mut masks, counts),
                };
                if lanes != 0 && self.has_program {
                    counts.invocations += u64::from(lanes.count_ones());
                    self.color(&places, &masks);
                }
            }
            places.y[0] += 1;
        }
    }

    /// Lays a colour over a square of pixels.
    ///
    /// # Safety
    /// As [`draw`], for this square.
    #[inline(always)]
    unsafe fn lay(&self, source_over: &SourceOver<V>, target: &Target, [x, y]: [i32; 2], size: u8) {
        let (v, surface) = (self.v, &target.surface);
        let slice = target.first_layer + u32::from(self.part.record.layer);
        let mut row = surface.texel(x as u32, y as u32, slice, 0);
        // A copy, that stays in registers.
        let source_over = *source_over;
        for _ in 0..size {
            for across in 0..usize::from(size) / 16 {
                let texels = row.wrapping_add(64 * across).cast::<Row>();
                // SAFETY: the caller provides a square in the render area, so its rows are texels
                // of the attachment.
                unsafe {
                    let old = v.load_i(&texels.read_unaligned());
                    texels.write_unaligned(row_of(v, source_over.over(v, old)));
                }
            }
            row = row.wrapping_add(surface.row_stride_bytes as usize);
        }
    }

    /// The part of the depths that a column of rows of sixteen pixels shares: see [`depths`].
    #[inline(always)]
    fn column(&self, x: i32) -> V::F {
        let (v, record) = (self.v, self.part.record);
        let from_x = v.splat_i(x.wrapping_sub(record.origin[0].into()));
        let x = v.to_f(v.add_i(from_x, v.load_i(&IN_ROW[0])));
        v.add(v.splat(record.depth.at), v.mul(v.splat(record.depth.dx), x))
    }

    /// Depths of the only samples of a row, or of a block of the common kind.
    #[inline(always)]
    fn plain_depths(&self, places: &Places, column: Option<V::F>) -> Option<V::F> {
        let (plan, record) = (self.plan, self.part.record);
        match column {
            Some(column) => Some(self.depths_of_row(column, places.y[0])),
            None if places.pattern == Pattern::Block => {
                let from = [places.x[0], places.y[0]];
                let range = plan.depth_range(record);
                Some(depths(
                    self.v,
                    record,
                    from,
                    &IN_BLOCK,
                    plan.locations[0],
                    range,
                ))
            }
            None => None,
        }
    }

    /// The depths of one of its rows, with one sample a pixel: those of [`depths`].
    #[inline(always)]
    fn depths_of_row(&self, column: V::F, y: i32) -> V::F {
        let (v, record) = (self.v, self.part.record);
        let y = y.wrapping_sub(record.origin[1].into()) as f32;
        let depths = v.add(column, v.splat(record.depth.dy * y));
        match self.plan.depth_range(record) {
            Some(range) => clamped(v, depths, range),
            None => depths,
        }
    }

    /// Does the tests of sixteen pixels; gives the lanes with samples that pass.
    ///
    /// # Safety
    /// As [`draw`], for these places.
    #[inline(always)]
    unsafe fn test(
        &self,
        places: &Places,
        masks: &mut [u16; MAX_SAMPLES],
        counts: &mut Counts,
    ) -> u16 {
        let Self { v, plan, part, .. } = self;
        let (v, record) = (*v, part.record);
        let from = [places.x[0], places.y[0]];
        let steps = steps_of(places);
        let mut lanes = 0;
        let front = if record.front { u16::MAX } else { 0 };
        let range = plan.depth_range(record);
        for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
            let mut left = *mask;
            if left != 0 && !plan.tests.is_empty() {
                let depths = match plan.tests.uses_depths() {
                    true => depths(v, record, from, steps, plan.locations[sample], range),
                    false => v.splat(0.0),
                };
                let tested = Tested {
                    places,
                    front,
                    depths,
                    references: None,
                };
                // SAFETY: the caller provides places in the render area.
                left = unsafe { plan.tests.run(v, &tested, sample as u32, left) };
                *mask = left;
            }
            lanes |= left;
            counts.samples += u64::from(left.count_ones());
        }
        lanes
    }

    /// Writes the colours of sixteen pixels.
    ///
    /// # Safety
    /// As [`draw`], for these places.
    #[inline(always)]
    unsafe fn color(&self, places: &Places, masks: &[u16; MAX_SAMPLES]) {
        let Self { v, plan, part, .. } = self;
        let (v, record) = (*v, part.record);
        let from = [places.x[0], places.y[0]];
        let steps = steps_of(places);
        if let Some(texels) = self.solid {
            for (color, texel) in plan.output.colors.iter().zip(texels) {
                let words = [
                    v.splat_i(texel[0] as i32),
                    v.splat_i(texel[1] as i32),
                    v.splat_i(texel[2] as i32),
                    v.splat_i(texel[3] as i32),
                ];
                for (sample, &mask) in masks.iter().enumerate().take(plan.samples as usize) {
                    if mask != 0 {
                        // SAFETY: the caller provides places in the render area. No texel there is
                        // read.
                        unsafe { store(v, &color.target, places, sample as u32, mask, &words) };
                    }
                }
            }
            return;
        }
        if let (Some(source_over), [color]) = (&self.source_over, &plan.output.colors[..]) {
            // SAFETY: the caller provides places in the render area.
            unsafe {
                let old = load_word(v, &color.target, places, 0, masks[0]);
                let new = source_over.over(v, old);
                store_word(v, &color.target, places, 0, masks[0], new);
            }
            return;
        }
        let x = v.splat_i(from[0].wrapping_sub(record.origin[0].into()));
        let y = v.splat_i(from[1].wrapping_sub(record.origin[1].into()));
        let at = [
            v.to_f(v.add_i(x, v.load_i(&steps[0]))),
            v.to_f(v.add_i(y, v.load_i(&steps[1]))),
        ];
        let mut weights = LazyBarycentrics {
            at,
            linear: None,
            perspective: None,
        };
        for color in &plan.output.colors {
            let source = color.with_alpha(v, self.colors(&color.source, &mut weights));
            let second = match color.has_second {
                true => color.with_alpha(v, self.colors(&color.second, &mut weights)),
                false => source,
            };
            // SAFETY: the caller provides places in the render area.
            unsafe {
                (plan.output).write_color(v, color, &source, &second, places, masks);
            }
        }
    }

    /// Components of sixteen colours.
    #[inline(always)]
    fn colors(&self, rows: &ComponentRows, weights: &mut LazyBarycentrics<V>) -> [V::I; 4] {
        // One by one: a loop would keep them in memory.
        [
            self.component(rows[0], weights),
            self.component(rows[1], weights),
            self.component(rows[2], weights),
            self.component(rows[3], weights),
        ]
    }

    #[inline(always)]
    fn component(&self, place: Option<usize>, weights: &mut LazyBarycentrics<V>) -> V::I {
        let v = self.v;
        let Some(place) = place else {
            return v.splat_i(0);
        };
        let value = &self.values[place];
        if value.change == Change::None {
            return v.splat_i(value.word as i32);
        }
        let is_perspective = value.change == Change::Perspective;
        let weights = weights.of(v, self.part, is_perspective);
        let others = [v.splat(value.others[0]), v.splat(value.others[1])];
        v.bits_of(interpolate(
            v,
            v.splat(f32::from_bits(value.word)),
            others,
            weights,
        ))
    }
}

/// Barycentric coordinates of the second and third vertex in sixteen pixels, once they are known.
struct LazyBarycentrics<V: Vector> {
    /// From the record's origin on.
    at: [V::F; 2],
    linear: Option<[V::F; 2]>,
    perspective: Option<[V::F; 2]>,
}

impl<V: Vector> LazyBarycentrics<V> {
    #[inline(always)]
    fn of(&mut self, v: V, part: &Part<'_>, perspective: bool) -> [V::F; 2] {
        let Part { record, linear, .. } = *part;
        let perspective = perspective && !record.is_affine;
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
                plane_at(v, &linear[1], self.at),
                plane_at(v, &linear[2], self.at),
            ],
        };
        *known = Some(found);
        found
    }
}
