//! Filtered sampling and gathering of a block of lanes (spec, "Image Sample Operations").
//!
//! Every step is a loop over the 16 lanes without branches that depend on a lane: inactive lanes
//! compute along, on clamped indices.

use lanes::{LANES, Row, bounds, map};

use super::address::{self, Axis, AxisRule, Floats, Ints};
use super::format::FormatInfo;
use super::format::block::{self, Offsets, Texels};
use super::lod::{self, LevelLanes, floats};
use super::operands::{Operands, put_texels, swizzle};
use super::residency::Residency;
use super::{
    AddressMode, CompareOp, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, Reduction,
    SamplerDescriptor, cube,
};

lanes::vectors! {
    /// `OpImageSample*` and `OpImage*Gather` of a usable image. Loops over lanes become vectors by
    /// themselves.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    pub(super) unsafe fn sample<V>(_v, op: &ImageOp, operands: &Operands<'_>, image: &ImageDescriptor, info: &FormatInfo,
        sampler: &SamplerDescriptor, mask: u16, results: &mut [Row]) {
        // SAFETY: the caller guarantees that the image's memory stays allocated during the call.
        unsafe { sample_body(op, operands, image, info, sampler, mask, results) }
    }
}

/// Where the lanes sample, apart from the level.
struct SampleCoordinates {
    /// Coordinates along the image's axes; in cubes, on the face.
    coordinates: [Floats; 3],
    face: Ints,
    /// Layer; of cube arrays, the cube's first.
    layer: Ints,
    depth_reference: Option<Floats>,
}

#[inline(always)]
fn place(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
) -> SampleCoordinates {
    let spatial = op.spatial_count();
    let mut place = SampleCoordinates {
        coordinates: [[0.0; LANES]; 3],
        face: [0; LANES],
        layer: [0; LANES],
        depth_reference: None,
    };
    for (coordinate, row) in place
        .coordinates
        .iter_mut()
        .zip(&operands.coordinates[..spatial])
    {
        *coordinate = floats(row);
    }
    if op.dim == Dim::Cube {
        let [x, y, z] = &place.coordinates;
        let on_cube = cube::place([x, y, z]);
        place.face = on_cube.face;
        place.coordinates = [on_cube.s, on_cube.t, [0.0; LANES]];
    }
    if let Some(row) = operands.coordinates.get(spatial) {
        // Rounded to the nearest layer ("Array Layer Selection").
        let (last, faces) = match op.dim {
            Dim::Cube => ((image.layer_count / 6).max(1) - 1, 6),
            _ => (image.layer_count.max(1) - 1, 1),
        };
        for lane in 0..LANES {
            let layer = f32::from_bits(row[lane]).round_ties_even();
            place.layer[lane] = (layer as i32).max(0).min(last as i32) * faces;
        }
    }
    if let Some(row) = operands.depth_reference {
        // Fixed-point depth lies in 0..1, so the reference must.
        let is_fixed = info.numeric == super::format::Numeric::Unorm;
        place.depth_reference = Some(map(&floats(row), |reference| {
            if is_fixed {
                bounds::min(bounds::max(reference, 0.0), 1.0)
            } else {
                reference
            }
        }));
    }
    place
}

/// # Safety
/// As [`sample`].
#[inline(always)]
unsafe fn sample_body(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    sampler: &SamplerDescriptor,
    mask: u16,
    results: &mut [Row],
) {
    let place = place(op, operands, image, info);
    let is_gather = matches!(op.kind, ImageOpKind::Gather(_));
    let levels = ChosenLevels::new(op, operands, image, info, sampler);
    let (mut magnified, mut between) = (0u16, 0u16);
    let mut is_uniform = true;
    let first = mask.trailing_zeros() as usize & 15;
    for lane in 0..LANES {
        let is_active = mask >> lane & 1 == 1;
        magnified |= ((levels.lambda[lane] <= 0.0) as u16) << lane;
        between |= ((levels.weight[lane] > 0.0) as u16) << lane;
        is_uniform &= !is_active | (levels.level[lane] == levels.level[first]);
    }
    let groups = filter_groups(info, sampler, is_gather, (mask, magnified));
    let sample_passes = match &levels.anisotropy {
        Some(anisotropy) => anisotropy.passes(mask),
        None => 1,
    };
    let centre = place.coordinates;
    let mut sample = BlockSample {
        op,
        operands,
        image,
        info,
        sampler,
        spatial: match op.dim {
            Dim::Cube => 2,
            _ => op.spatial_count(),
        },
        place,
        levels,
        common_level: is_uniform.then_some(first),
        between,
        passes: 1 + (between & mask != 0) as usize,
        sum: reduction_of(sampler, is_gather),
    };

    let mut total = [[0; LANES]; 4];
    for (filter, group) in groups {
        if group == 0 {
            continue;
        }
        let mut value = [[0; LANES]; 4];
        for sample_index in 0..sample_passes {
            let taking = match &sample.levels.anisotropy {
                Some(anisotropy) => group & anisotropy.taking(sample_index),
                None => group,
            };
            sample.move_to_sample(&centre, sample_index);
            // SAFETY: the caller keeps the contract of `sample`.
            let texels = unsafe { sample.texels(filter, taking) };
            match &sample.levels.anisotropy {
                Some(anisotropy) if sample_index > 0 => {
                    let (count, sum) = (&anisotropy.count, sample.sum);
                    accumulate(&mut value, &texels, sample_index, count, sum);
                }
                _ => value = texels,
            }
        }
        if let (Some(anisotropy), Sum::Average) = (&sample.levels.anisotropy, sample.sum) {
            divide(&mut value, &anisotropy.count);
        }
        for (total, value) in total.iter_mut().zip(&value) {
            for lane in 0..LANES {
                if group >> lane & 1 == 1 {
                    total[lane] = value[lane];
                }
            }
        }
    }
    put_results(op, image, info, &mut total, results);
}

/// The levels that lanes sample.
struct ChosenLevels {
    /// The level of detail after the sampler's clamp.
    lambda: Floats,
    /// The level, and the weight of the next one.
    level: Ints,
    weight: Floats,
    anisotropy: Option<lod::Anisotropy>,
}

impl ChosenLevels {
    #[inline(always)]
    fn new(
        op: &ImageOp,
        operands: &Operands<'_>,
        image: &ImageDescriptor,
        info: &FormatInfo,
        sampler: &SamplerDescriptor,
    ) -> ChosenLevels {
        if matches!(op.kind, ImageOpKind::Gather(_)) {
            // The base level, whatever the view's least level of detail.
            let (level, weight) = lod::split(Filter::Nearest, &[0.0; LANES]);
            return ChosenLevels {
                lambda: [0.0; LANES],
                level,
                weight,
                anisotropy: None,
            };
        }
        let lod = lod::lod(op, operands, image, sampler);
        let lambda = lod::clamp(&lod.lambda, sampler, operands.min_lod);
        let levels = lod::levels(&lambda, image);
        // Integers are never blended.
        let is_integer = info.numeric.is_integer();
        let mipmap_mode = match is_integer {
            true => Filter::Nearest,
            false => sampler.mipmap_mode,
        };
        let (level, weight) = lod::split(mipmap_mode, &levels);
        ChosenLevels {
            lambda,
            level,
            weight,
            anisotropy: lod.anisotropy.filter(|_| !is_integer),
        }
    }
}

/// The filters of a sample, each with its lanes: magnified lanes may have another one than the rest
/// of `mask`.
#[inline(always)]
fn filter_groups(
    info: &FormatInfo,
    sampler: &SamplerDescriptor,
    is_gather: bool,
    (mask, magnified): (u16, u16),
) -> [(Filter, u16); 2] {
    // Integers are never blended.
    let is_linear = !info.numeric.is_integer();
    let filter_of = |filter: Filter| if is_linear { filter } else { Filter::Nearest };
    if is_gather {
        [(Filter::Linear, mask), (Filter::Linear, 0)]
    } else if sampler.mag_filter == sampler.min_filter {
        [(filter_of(sampler.mag_filter), mask), (Filter::Nearest, 0)]
    } else {
        [
            (filter_of(sampler.mag_filter), mask & magnified),
            (filter_of(sampler.min_filter), mask & !magnified),
        ]
    }
}

/// A sample of a block of lanes.
struct BlockSample<'a> {
    op: &'a ImageOp,
    operands: &'a Operands<'a>,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
    sampler: &'a SamplerDescriptor,
    /// Axes that are filtered.
    spatial: usize,
    place: SampleCoordinates,
    levels: ChosenLevels,
    /// A lane whose level all active lanes have.
    common_level: Option<usize>,
    /// Lanes between two levels.
    between: u16,
    /// Levels that some active lane samples: one or two.
    passes: usize,
    sum: Sum,
}

impl BlockSample<'_> {
    /// Moves the coordinates to an anisotropic sample around the centre.
    #[inline(always)]
    fn move_to_sample(&mut self, centre: &[Floats; 3], sample_index: i32) {
        let Some(anisotropy) = &self.levels.anisotropy else {
            return;
        };
        for axis in 0..self.spatial {
            for lane in 0..LANES {
                // Samples i = 1..=N at i / (N + 1) - 1/2 along the axis.
                let count = anisotropy.count[lane];
                let i = (sample_index + 1).min(count) as f32;
                let along = i / (count + 1) as f32 - 0.5;
                self.place.coordinates[axis][lane] =
                    centre[axis][lane] + along * anisotropy.axis[axis][lane];
            }
        }
    }

    /// The filtered texels of some lanes, blended between two levels.
    ///
    /// # Safety
    /// As [`sample`].
    #[inline(always)]
    unsafe fn texels(&self, filter: Filter, lanes: u16) -> Texels {
        let last_level = self.image.level_count as i32 - 1;
        let mut texels = [[0; LANES]; 4];
        for pass in 0..self.passes {
            let level = map(&self.levels.level, |d| (d + pass as i32).min(last_level));
            let level = match self.common_level {
                Some(lane) => [level[lane]; LANES],
                None => level,
            };
            let level_lanes = LevelLanes::new(self.image, &level, self.common_level.is_some());
            let footprint = Footprint {
                op: self.op,
                image: self.image,
                info: self.info,
                sampler: self.sampler,
                filter,
                spatial: self.spatial,
                level: &level_lanes,
                place: &self.place,
                lanes: if pass == 0 {
                    lanes
                } else {
                    lanes & self.between
                },
            };
            // SAFETY: the caller guarantees that the image's memory stays allocated during the
            // call.
            let of_level = unsafe { footprint.texels(self.operands, self.sum) };
            if pass == 0 {
                texels = of_level;
            } else {
                for (a, b) in texels.iter_mut().zip(&of_level) {
                    combine(a, b, &self.levels.weight, self.sum);
                }
            }
        }
        texels
    }
}

/// Writes the results of texels in units.
#[inline(always)]
fn put_results(
    op: &ImageOp,
    image: &ImageDescriptor,
    info: &FormatInfo,
    total: &mut Texels,
    results: &mut [Row],
) {
    match op.kind {
        ImageOpKind::Gather(component) => {
            if !op.depth_compare {
                finish_gather(image, info, component, total);
            }
            put_texels(op, info, total, results);
        }
        _ if op.depth_compare => results[0] = total[0],
        _ => {
            block::finish(info, total);
            swizzle(image, info, total);
            put_texels(op, info, total, results);
        }
    }
}

/// How texels become one.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sum {
    Average,
    Min,
    Max,
    /// They do not: the four of a gather stay.
    Gather,
}

#[inline(always)]
fn reduction_of(sampler: &SamplerDescriptor, is_gather: bool) -> Sum {
    match (is_gather, sampler.reduction) {
        (true, _) => Sum::Gather,
        (_, Reduction::WeightedAverage) => Sum::Average,
        (_, Reduction::Min) => Sum::Min,
        (_, Reduction::Max) => Sum::Max,
    }
}

/// Folds `b` of weight `weight` into `a` of the remaining weight. A weight of zero takes no part.
#[inline(always)]
fn combine(a: &mut Row, b: &Row, weight: &Floats, sum: Sum) {
    match sum {
        Sum::Average | Sum::Gather => {
            for lane in 0..LANES {
                let (x, y) = (f32::from_bits(a[lane]), f32::from_bits(b[lane]));
                // Exact where the weight is zero or the texels are equal.
                a[lane] = (x + weight[lane] * (y - x)).to_bits();
            }
        }
        Sum::Min => {
            for lane in 0..LANES {
                let (x, y) = (f32::from_bits(a[lane]), f32::from_bits(b[lane]));
                let takes = weight[lane] > 0.0 && y < x;
                a[lane] = if takes { b[lane] } else { a[lane] };
            }
        }
        Sum::Max => {
            for lane in 0..LANES {
                let (x, y) = (f32::from_bits(a[lane]), f32::from_bits(b[lane]));
                let takes = weight[lane] > 0.0 && y > x;
                a[lane] = if takes { b[lane] } else { a[lane] };
            }
        }
    }
}

/// Adds an anisotropic sample in the lanes that take so many.
#[inline(always)]
fn accumulate(value: &mut Texels, texels: &Texels, sample_index: i32, count: &Ints, sum: Sum) {
    for (value, texel) in value.iter_mut().zip(texels) {
        for lane in 0..LANES {
            let (x, y) = (f32::from_bits(value[lane]), f32::from_bits(texel[lane]));
            let summed = match sum {
                Sum::Min => bounds::min(x, y),
                Sum::Max => bounds::max(x, y),
                _ => x + y,
            };
            if sample_index < count[lane] {
                value[lane] = summed.to_bits();
            }
        }
    }
}

/// The means of summed anisotropic samples.
#[inline(always)]
fn divide(value: &mut Texels, count: &Ints) {
    for row in value {
        for lane in 0..LANES {
            let mean = f32::from_bits(row[lane]) / count[lane] as f32;
            row[lane] = mean.to_bits();
        }
    }
}

/// Texels around the lanes' places at one level.
struct Footprint<'a> {
    op: &'a ImageOp,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
    sampler: &'a SamplerDescriptor,
    filter: Filter,
    /// Axes that are filtered.
    spatial: usize,
    level: &'a LevelLanes,
    place: &'a SampleCoordinates,
    /// Lanes that take texels.
    lanes: u16,
}

impl Footprint<'_> {
    /// Whether edges of faces lead to the next face.
    #[inline(always)]
    fn is_seamless(&self) -> bool {
        self.op.dim == Dim::Cube && !self.sampler.non_seamless
    }

    #[inline(always)]
    fn axis(&self, axis: usize, offsets: Option<&Ints>) -> Axis {
        let rule = AxisRule {
            mode: match self.is_seamless() {
                true => AddressMode::ClampToEdge,
                false => self.sampler.address_mode[axis],
            },
            filter: self.filter,
            unnormalized: self.sampler.unnormalized_coordinates,
            seamless: self.is_seamless() && self.filter == Filter::Linear,
        };
        address::address(
            rule,
            &self.place.coordinates[axis],
            &self.level.size[axis],
            offsets,
        )
    }

    /// The filtered texel in units (see [`block`]), or the comparison's result in the first
    /// component, or a gather's four texels.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    unsafe fn texels(&self, operands: &Operands<'_>, sum: Sum) -> Texels {
        let offset_of = |axis: usize, tap: usize| -> Option<Ints> {
            let index = if self.op.has_offsets {
                tap * self.spatial + axis
            } else {
                axis
            };
            let row = operands.offsets.get(index)?;
            Some(map(row, |word| word as i32))
        };
        let mut axes = [Axis {
            index: [[0; LANES]; 2],
            weight: [0.0; LANES],
        }; 3];
        for (axis, slot) in axes.iter_mut().enumerate().take(self.spatial) {
            *slot = self.axis(axis, offset_of(axis, 0).as_ref());
        }
        let tap_count = match self.filter {
            Filter::Nearest => 1,
            Filter::Linear => 1 << self.spatial,
        };
        let mut taps = [[[0; LANES]; 4]; 8];
        let mut corners = [0u16; 8];
        for tap in 0..tap_count {
            if self.op.has_offsets {
                for (axis, slot) in axes.iter_mut().enumerate().take(self.spatial) {
                    *slot = self.axis(axis, offset_of(axis, tap).as_ref());
                }
            }
            // Each of a gather's own offsets moves the first texel of its footprint.
            let side = if self.op.has_offsets { 0 } else { tap };
            let indices = [
                &axes[0].index[side & 1],
                &axes[1].index[side >> 1 & 1],
                &axes[2].index[side >> 2 & 1],
            ];
            // SAFETY: the caller guarantees that the image's memory stays allocated during the
            // call.
            (taps[tap], corners[tap]) = unsafe { self.tap(indices, operands.residency) };
        }
        if corners != [0; 8] {
            fill_corners(&mut taps, &corners);
        }
        match sum {
            Sum::Gather => self.gathered(&taps),
            _ => {
                let mut left = tap_count;
                for axis in axes.iter().take(self.spatial) {
                    if self.filter == Filter::Nearest {
                        break;
                    }
                    left /= 2;
                    for k in 0..left {
                        let (mut a, b) = (taps[2 * k], taps[2 * k + 1]);
                        for component in 0..4 {
                            if self.info.channels[component].bits != 0 {
                                combine(&mut a[component], &b[component], &axis.weight, sum);
                            }
                        }
                        taps[k] = a;
                    }
                }
                taps[0]
            }
        }
    }

    /// The component of a gather in its four texels: of (0, 1), (1, 1), (1, 0), (0, 0), or by
    /// offsets of its own in their order.
    #[inline(always)]
    fn gathered(&self, taps: &[Texels; 8]) -> Texels {
        let order = match self.op.has_offsets {
            true => [0, 1, 2, 3],
            false => [2, 3, 1, 0],
        };
        let component = match self.op.kind {
            ImageOpKind::Gather(component) if !self.op.depth_compare => {
                self.image.swizzle[component as usize & 3] as usize & 3
            }
            _ => 0,
        };
        let mut four = [[0; LANES]; 4];
        for (row, tap) in four.iter_mut().zip(order) {
            *row = taps[tap][component];
        }
        four
    }

    /// The byte offsets of texels by their indices and layers.
    #[inline(always)]
    fn texel_offsets(&self, [x, y, z]: [&Ints; 3], layer: &Ints) -> Offsets {
        let mut offsets: Offsets = self.level.offset_bytes;
        let texel_bytes = self.info.size_bytes as u64;
        if self.info.blocks().is_some() {
            for lane in 0..LANES {
                let (x, y) = (x[lane] as u32, y[lane] as u32);
                let row_stride_bytes = self.level.row_stride_bytes[lane];
                offsets[lane] += self.info.texel_offset(x, y, row_stride_bytes);
            }
        } else {
            for lane in 0..LANES {
                offsets[lane] += x[lane] as u32 as u64 * texel_bytes;
            }
            if self.spatial >= 2 {
                for lane in 0..LANES {
                    offsets[lane] += y[lane] as u32 as u64 * self.level.row_stride_bytes[lane];
                }
            }
        }
        if self.spatial == 3 {
            for lane in 0..LANES {
                offsets[lane] += z[lane] as u32 as u64 * self.level.slice_stride_bytes[lane];
            }
        }
        if self.op.arrayed || self.op.dim == Dim::Cube {
            for lane in 0..LANES {
                offsets[lane] += layer[lane] as u32 as u64 * self.image.layer_stride_bytes;
            }
        }
        offsets
    }

    /// One texel per lane, and the lanes whose texel lies past a cube's corner.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    unsafe fn tap(&self, indices: [&Ints; 3], residency: Option<&Residency<'_>>) -> (Texels, u16) {
        let (mut x, mut y, mut z) = (*indices[0], *indices[1], *indices[2]);
        let mut layer = self.place.layer;
        let mut corners = 0;
        if self.op.dim == Dim::Cube {
            let mut face = self.place.face;
            if self.filter == Filter::Linear && self.is_seamless() {
                corners = cube::wrap_edges(&mut x, &mut y, &mut face, &self.level.size[0]);
            }
            let last = self.image.layer_count.max(1) as i32 - 1;
            for lane in 0..LANES {
                layer[lane] = (layer[lane] + face[lane]).min(last);
            }
            if self.is_seamless() {
                for lane in 0..LANES {
                    y[lane] = y[lane].min(self.level.size[1][lane] - 1);
                }
            }
        }
        let has_border = !self.is_seamless()
            && self.sampler.address_mode[..self.spatial].contains(&AddressMode::ClampToBorder);
        let mut border = [false; LANES];
        if has_border {
            for (axis, index) in [&mut x, &mut y, &mut z].into_iter().enumerate() {
                if axis >= self.spatial {
                    break;
                }
                for lane in 0..LANES {
                    let last = self.level.size[axis][lane] - 1;
                    border[lane] |= index[lane] < 0 || index[lane] > last;
                    index[lane] = index[lane].max(0).min(last);
                }
            }
        }
        let offsets = self.texel_offsets([&x, &y, &z], &layer);
        if let Some(residency) = residency {
            let outside = (0..).zip(border).fold(corners, |lanes, (lane, is_border)| {
                lanes | u16::from(is_border) << lane
            });
            residency.check(self.image, self.info, &offsets, self.lanes & !outside);
        }
        // SAFETY: indices are clamped to the level's size and the layer to the view's layers, so
        // each offset is that of a texel of the image.
        let mut texels = unsafe { block::load(self.info, self.image.data, &offsets) };
        if has_border {
            let color = border_units(self.sampler, self.info);
            for (row, color) in texels.iter_mut().zip(color) {
                for lane in 0..LANES {
                    row[lane] = if border[lane] { color } else { row[lane] };
                }
            }
        }
        if let Some(reference) = &self.place.depth_reference {
            let scale = block::unit_scale(self.info);
            let depth = map(&texels[0], |units| f32::from_bits(units) / scale);
            texels[0] = compare(self.sampler.compare, reference, &depth);
        }
        (texels, corners)
    }
}

/// The border colour in a format's units.
#[inline(always)]
pub(super) fn border_units(sampler: &SamplerDescriptor, info: &FormatInfo) -> [u32; 4] {
    let scale = block::unit_scale(info);
    sampler.border_color.map(|word| {
        if scale == 1.0 {
            word
        } else {
            // The range of a normalised format ("Texel Replacement").
            let number = bounds::min(bounds::max(f32::from_bits(word), 0.0), 1.0);
            (number * scale).to_bits()
        }
    })
}

/// `reference op depth` as 1.0 and 0.0.
#[inline(always)]
fn compare(op: Option<CompareOp>, reference: &Floats, depth: &Floats) -> Row {
    let each = |holds: fn(f32, f32) -> bool| {
        let mut row = [0; LANES];
        for lane in 0..LANES {
            row[lane] = (holds(reference[lane], depth[lane]) as u32 as f32).to_bits();
        }
        row
    };
    match op.unwrap_or(CompareOp::Never) {
        CompareOp::Never => each(|_, _| false),
        CompareOp::Less => each(|reference, depth| reference < depth),
        CompareOp::Equal => each(|reference, depth| reference == depth),
        CompareOp::LessOrEqual => each(|reference, depth| reference <= depth),
        CompareOp::Greater => each(|reference, depth| reference > depth),
        CompareOp::NotEqual => each(|reference, depth| reference != depth),
        CompareOp::GreaterOrEqual => each(|reference, depth| reference >= depth),
        CompareOp::Always => each(|_, _| true),
    }
}

/// A texel past a cube's corner is the mean of the three around it.
#[inline(never)]
fn fill_corners(taps: &mut [Texels; 8], corners: &[u16; 8]) {
    for tap in 0..4 {
        block::each_lane(corners[tap], |lane| {
            for component in 0..4 {
                let sum: f32 = (0..4)
                    .filter(|&other| other != tap)
                    .map(|other| f32::from_bits(taps[other][component][lane]))
                    .sum();
                taps[tap][component][lane] = (sum / 3.0).to_bits();
            }
        });
    }
}

/// Four texels of one component: units to values; a component that the view's swizzle makes
/// constant or the format lacks.
#[inline(always)]
fn finish_gather(image: &ImageDescriptor, info: &FormatInfo, component: u8, texels: &mut Texels) {
    let source = image.swizzle[component as usize & 3] as usize;
    let constant = match source {
        0..=3 if info.channels[source].bits != 0 => None,
        0..=3 => Some(info.missing(source)),
        4 => Some(0),
        _ => Some(info.missing(3)),
    };
    let scale = block::unit_scale(info);
    for row in texels {
        for word in row {
            *word = match constant {
                Some(constant) => constant,
                None if scale == 1.0 => *word,
                None => (f32::from_bits(*word) / scale).to_bits(),
            };
        }
    }
}

/// `OpImageQueryLod`: the level that would be sampled, and λ'.
///
/// # Safety
/// None beyond a valid descriptor; the image's texels are not read.
pub(super) unsafe fn query_lod(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    sampler: &SamplerDescriptor,
    _mask: u16,
    results: &mut [Row],
) {
    let lod = lod::lod(op, operands, image, sampler);
    let lambda = lod::clamp(&lod.lambda, sampler, operands.min_lod);
    let levels = lod::levels(&lambda, image);
    results[0] = levels.map(|level| match sampler.mipmap_mode {
        Filter::Nearest => lod::nearest(level).to_bits(),
        Filter::Linear => level.to_bits(),
    });
    results[1] = lod.lambda.map(f32::to_bits);
}
