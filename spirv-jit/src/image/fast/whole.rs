//! Samples of which there is more to say than what four texels weigh: of cubes, with borders and
//! comparisons, at several places along a footprint, and gathers.

use super::super::address::Ints;
use super::super::format::Numeric;
use super::super::format::block;
use super::super::format::layout::Codec;
use super::super::lod;
use super::super::operands::Operands;
use super::super::vector::{Task, Vector};
use super::super::{AddressMode, CompareOp, ImageDescriptor, ImageOpKind, LodMode, cube, sample};
use super::axis::Axis;
use super::levels::{Levels, levels_of};
use super::{Components, Fast, Offsets};
use crate::SUBGROUP_SIZE;
use crate::row::Row;

/// A block of such samples, compiled by itself, so that the code of common ones stays short.
pub(super) struct Whole<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub operands: &'b Operands<'b>,
    pub mask: u16,
}

impl<V: Vector> Task<V> for Whole<'_, '_> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Self::Output {
        // SAFETY: the caller's promise.
        unsafe {
            match self.fast.op.kind {
                ImageOpKind::Gather(_) => self.fast.gathered(v, self.operands, self.mask),
                _ => self.fast.sampled_whole(v, self.operands, self.mask),
            }
        }
    }
}

/// Where lanes sample: coordinates of the plane or of the face, and the layer.
struct Place<V: Vector> {
    s: V::F,
    t: V::F,
    /// The layer's offset, in bytes.
    layer: V::I,
    /// Of cubes: the layer of the first face, and the face.
    first_face: V::I,
    face: Ints,
}

/// The component of the texels that a gather takes. None where the view makes it constant.
pub(super) fn gathered_component(op: &ImageOpKind, image: &ImageDescriptor) -> Option<usize> {
    match op {
        ImageOpKind::Gather(component) => {
            let source = image.swizzle[*component as usize & 3] as usize;
            (source < 4).then_some(source)
        }
        _ => None,
    }
}

#[inline(always)]
fn vector_of<V: Vector>(v: V, ints: &Ints) -> V::I {
    let mut row = [0; SUBGROUP_SIZE];
    for lane in 0..SUBGROUP_SIZE {
        row[lane] = ints[lane] as u32;
    }
    v.load_i(&row)
}

impl Fast<'_> {
    /// [`Fast::components`] of a sample.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn sampled_whole<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
    ) -> Components<V> {
        let offsets = self.offsets(v, operands);
        let mut place = self.place(v, operands);
        let (mut lambda, mut anisotropy) = (None, None);
        if self.op.lod == LodMode::Grad && self.takes_derivatives() {
            if self.is_cube {
                let lod = lod::from_gradients(self.op, operands, self.image, self.sampler);
                lambda = Some(v.load(&lod::words(&lod.lambda)));
            } else {
                let rows = operands.lod;
                let derivatives = [
                    v.load(rows[0]),
                    v.load(rows[1]),
                    v.load(rows[2]),
                    v.load(rows[3]),
                ];
                let footprint = self.footprint(v, derivatives);
                (lambda, anisotropy) = (Some(footprint.lambda), footprint.anisotropy);
            }
        }
        #[expect(clippy::manual_map, reason = "closures are not compiled for the tier")]
        let reference = match operands.depth_reference {
            Some(row) => Some(self.reference(v, row)),
            None => None,
        };
        let (level, weight) = self.chosen_levels(v, operands.lod.first().copied(), lambda);
        let blends = self.has_levels() && v.gt(weight, v.splat(0.0)) & mask != 0;
        let levels = [level, self.next_level(v, level)];
        let (centre_s, centre_t) = (place.s, place.t);
        let mut total = [v.splat(0.0); 4];
        let mut pass = 0;
        loop {
            if let Some(anisotropy) = &anisotropy {
                let [s, t] = anisotropy.place(v, pass);
                (place.s, place.t) = (v.add(centre_s, s), v.add(centre_t, t));
            }
            let mut components = [v.splat(0.0); 4];
            for (i, level) in levels.into_iter().enumerate().take(1 + blends as usize) {
                // SAFETY: the caller's promise; the levels are the image's.
                let of_level = unsafe {
                    let levels = self.levels(v, level, mask);
                    let axes = self.axes(v, &levels, &place, offsets);
                    self.at_level(v, &levels, &place, &axes, reference, mask)
                };
                for (a, b) in components.iter_mut().zip(of_level) {
                    *a = if i == 0 { b } else { v.lerp(*a, b, weight) };
                }
            }
            let Some(anisotropy) = &anisotropy else {
                return components;
            };
            for (total, component) in total.iter_mut().zip(components) {
                *total = match pass {
                    0 => component,
                    _ => anisotropy.sum(v, pass, *total, component),
                };
            }
            pass += 1;
            if !anisotropy.goes_on(v, pass, mask) {
                for total in &mut total {
                    *total = v.div(*total, anisotropy.count);
                }
                return total;
            }
        }
    }

    /// [`Fast::components`] of a gather: the component, or the comparison, of the four texels.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn gathered<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
    ) -> Components<V> {
        let place = self.place(v, operands);
        let levels = levels_of(v, &self.image.levels[0]);
        let axes = self.axes(v, &levels, &place, self.offsets(v, operands));
        #[expect(clippy::manual_map, reason = "closures are not compiled for the tier")]
        let reference = match operands.depth_reference {
            Some(row) => Some(self.reference(v, row)),
            None => None,
        };
        // SAFETY: the caller's promise; the level is the image's.
        let taps = unsafe { self.taps(v, &levels, &place, &axes, reference, mask) };
        let component = match reference {
            Some(_) => 0,
            None => gathered_component(&self.op.kind, self.image).unwrap_or(0),
        };
        // (0, 1), (1, 1), (1, 0), (0, 0).
        [
            taps[2][component],
            taps[3][component],
            taps[1][component],
            taps[0][component],
        ]
    }

    /// The four results of a gather: units to values, and a component that the view makes constant
    /// or the format lacks.
    #[inline(always)]
    pub(super) fn gathered_values<V: Vector>(&self, v: V, texels: Components<V>) -> Components<V> {
        if self.op.depth_compare {
            return texels;
        }
        let constant = match gathered_component(&self.op.kind, self.image) {
            Some(source) if self.info.channels[source].bits != 0 => None,
            Some(source) => Some(self.info.missing(source)),
            None if self.is_zero_gathered() => Some(0),
            None => Some(self.info.missing(3)),
        };
        let scale = block::unit_scale(self.info);
        let mut values = texels;
        for value in &mut values {
            if let Some(constant) = constant {
                *value = v.bits_to_f(v.splat_i(constant as i32));
            } else if scale != 1.0 {
                *value = v.div(*value, v.splat(scale));
            }
        }
        values
    }

    /// Whether the view's component is zero.
    fn is_zero_gathered(&self) -> bool {
        match self.op.kind {
            ImageOpKind::Gather(component) => self.image.swizzle[component as usize & 3] == 4,
            _ => false,
        }
    }

    #[inline(always)]
    fn axes<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &Place<V>,
        offsets: Offsets<V>,
    ) -> [Axis<V>; 2] {
        let modes = match self.is_cube {
            true => [AddressMode::ClampToEdge; 2],
            false => [self.sampler.address_mode[0], self.sampler.address_mode[1]],
        };
        let texel_bytes = v.splat_i(self.info.size_bytes as i32);
        let s = (place.s, offsets[0]);
        let t = (place.t, offsets[1]);
        [
            self.axis(v, modes[0], s, levels.width, texel_bytes),
            self.axis(v, modes[1], t, levels.height, levels.row_stride),
        ]
    }

    /// Samples a level.
    ///
    /// # Safety
    /// As [`Fast::weighted`].
    #[inline(always)]
    unsafe fn at_level<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &Place<V>,
        axes: &[Axis<V>; 2],
        reference: Option<V::F>,
        mask: u16,
    ) -> Components<V> {
        let [x, y] = axes;
        // SAFETY: the caller's promise.
        unsafe {
            if reference.is_none()
                && (self.is_inside(v, levels, axes, mask) || self.is_nearest && !self.has_border)
            {
                return self.weighted(v, levels, place.layer, [x, y], mask);
            }
            let taps = self.taps(v, levels, place, axes, reference, mask);
            match self.is_nearest {
                true => taps[0],
                false => self.blend(v, taps, x, y),
            }
        }
    }

    /// For each axis, the lanes whose first texel is of the level's, and those whose second is; all
    /// of them where the axis brings texels into the level.
    #[inline(always)]
    pub(super) fn inside<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        [x, y]: &[Axis<V>; 2],
    ) -> [[u16; 2]; 2] {
        let may_leave = |axis: usize| {
            self.is_cube || self.sampler.address_mode[axis] == AddressMode::ClampToBorder
        };
        let mut inside = [[u16::MAX; 2]; 2];
        if may_leave(0) {
            inside[0] = x.inside(v, levels.width);
        }
        if may_leave(1) {
            inside[1] = y.inside(v, levels.height);
        }
        inside
    }

    /// Whether the lanes' texels need no border and no other face.
    #[inline(always)]
    fn is_inside<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        axes: &[Axis<V>; 2],
        mask: u16,
    ) -> bool {
        if !self.is_cube && !self.has_border {
            return true;
        }
        let [x, y] = self.inside(v, levels, axes);
        let mut inside = x[0] & y[0];
        if !self.is_nearest {
            inside &= x[1] & y[1];
        }
        mask & !inside == 0
    }

    /// The four texels around each lane, or their comparisons; where a sample takes the nearest
    /// one, only the first is anything.
    ///
    /// # Safety
    /// As [`Fast::weighted`].
    #[inline(always)]
    unsafe fn taps<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &Place<V>,
        axes: &[Axis<V>; 2],
        reference: Option<V::F>,
        mask: u16,
    ) -> [Components<V>; 4] {
        let [x, y] = axes;
        let mut taps = [[v.splat(0.0); 4]; 4];
        // SAFETY: the caller's promise.
        unsafe {
            if self.is_cube && !self.is_nearest && !self.is_inside(v, levels, axes, mask) {
                self.put_across_edges(v, levels, place, axes, reference, &mut taps);
                return taps;
            }
            let inside = self.inside(v, levels, axes);
            let offset = v.add_i(levels.offset, place.layer);
            let depths = match reference {
                Some(_) if !self.is_nearest => self.depths(v, offset, axes),
                _ => None,
            };
            for (tap, texel) in taps.iter_mut().enumerate() {
                let (column, row) = (tap & 1, tap >> 1);
                if let Some(depths) = &depths {
                    texel[0] = depths[tap];
                    self.replace_outside(v, texel, inside[0][column] & inside[1][row]);
                    self.put_compared(v, texel, reference);
                    continue;
                }
                let across = if column == 0 { x.first } else { x.second };
                let down = if row == 0 { y.first } else { y.second };
                let at = v.add_i(v.add_i(offset, down), across);
                *texel = self.texel(v, at);
                self.replace_outside(v, texel, inside[0][column] & inside[1][row]);
                self.put_compared(v, texel, reference);
                if self.is_nearest {
                    break;
                }
            }
        }
        taps
    }

    /// The first components of four texels, where the format has no others and is one of the usual
    /// ones for depths.
    ///
    /// # Safety
    /// As [`Fast::weighted`], for levels and layers that begin at these offsets.
    #[inline(always)]
    unsafe fn depths<V: Vector>(
        &self,
        v: V,
        offset: V::I,
        [x, y]: &[Axis<V>; 2],
    ) -> Option<[V::F; 4]> {
        let texel_bytes = v.splat_i(self.info.size_bytes as i32);
        let (upper, lower) = (v.add_i(offset, y.first), v.add_i(offset, y.second));
        match self.info.codec {
            Codec::Words(1) => {
                // SAFETY: the caller's promise.
                let [a, b, c, d] = unsafe { self.words(v, [upper, lower], x, texel_bytes) };
                Some([
                    v.bits_to_f(a),
                    v.bits_to_f(b),
                    v.bits_to_f(c),
                    v.bits_to_f(d),
                ])
            }
            // Two neighbours are a word.
            Codec::Unorm16(1) if v.ne_i(v.sub_i(x.second, x.first), texel_bytes) == 0 => {
                // SAFETY: the caller's promise.
                let (upper, lower) = unsafe {
                    (
                        v.gather(self.image.data, v.add_i(upper, x.first)),
                        v.gather(self.image.data, v.add_i(lower, x.first)),
                    )
                };
                let low = v.splat_i(0xffff);
                Some([
                    v.to_f(v.and_i(upper, low)),
                    v.to_f(v.right_u(upper, 16)),
                    v.to_f(v.and_i(lower, low)),
                    v.to_f(v.right_u(lower, 16)),
                ])
            }
            _ => None,
        }
    }

    /// [`Self::taps`] where some lie on other faces than their lanes' places.
    ///
    /// # Safety
    /// As [`Fast::weighted`].
    #[inline(always)]
    unsafe fn put_across_edges<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &Place<V>,
        [x, y]: &[Axis<V>; 2],
        reference: Option<V::F>,
        taps: &mut [Components<V>; 4],
    ) {
        let (one, zero) = (v.splat_i(1), v.splat_i(0));
        let face = vector_of(v, &place.face);
        let last_layer = v.splat_i(self.image.layer_count.max(1) as i32 - 1);
        let last_row = v.sub_i(levels.height, one);
        let mut corners = [0u16; 4];
        for (tap, texel) in taps.iter_mut().enumerate() {
            let x = v.add_i(x.at, if tap & 1 == 0 { zero } else { one });
            let y = v.add_i(y.at, if tap >> 1 == 0 { zero } else { one });
            // Coordinates lie on their faces, so a footprint crosses an edge by one texel; NaN
            // excepted.
            let x = v.max_i(v.min_i(x, levels.width), v.splat_i(-1));
            let y = v.max_i(v.min_i(y, levels.width), v.splat_i(-1));
            let ([x, y, face], past) = cube::wrap_edges_in_vectors(v, [x, y, face], levels.width);
            corners[tap] = past;
            let layer = v.min_i(v.add_i(place.first_face, face), last_layer);
            let row = v.min_i(y, last_row);
            let at = v.mul_i(layer, v.splat_i(self.image.layer_stride_bytes as i32));
            let at = v.add_i(at, v.mul_i(row, levels.row_stride));
            let column_bytes = v.splat_i(self.info.size_bytes as i32);
            let at = v.add_i(at, v.mul_i(x, column_bytes));
            // SAFETY: the caller's promise; indices are inside the level, and layers inside the
            // view.
            *texel = unsafe { self.texel(v, v.add_i(levels.offset, at)) };
            self.put_compared(v, texel, reference);
        }
        // A texel past a cube's corner is the mean of the three around it.
        for (tap, lanes) in corners.into_iter().enumerate() {
            if lanes == 0 {
                continue;
            }
            for component in 0..4 {
                let mut others = [v.splat(0.0); 3];
                let mut count = 0;
                for other in 0..4 {
                    if other != tap {
                        others[count] = taps[other][component];
                        count += 1;
                    }
                }
                let sum = v.add(v.add(others[0], others[1]), others[2]);
                let mean = v.bits_of(v.div(sum, v.splat(3.0)));
                let texel = &mut taps[tap][component];
                *texel = v.bits_to_f(v.select(lanes, mean, v.bits_of(*texel)));
            }
        }
    }

    /// Where the lanes sample.
    #[inline(always)]
    fn place<V: Vector>(&self, v: V, operands: &Operands<'_>) -> Place<V> {
        let coordinates = operands.coordinates;
        if !self.is_cube {
            return Place {
                s: v.load(coordinates[0]),
                t: v.load(coordinates[1]),
                layer: self.layer_offset(v, coordinates.get(2).copied()),
                first_face: v.splat_i(0),
                face: [0; SUBGROUP_SIZE],
            };
        }
        let layers = self.image.layer_count.max(1) as i32;
        let direction = [
            &lod::floats(coordinates[0]),
            &lod::floats(coordinates[1]),
            &lod::floats(coordinates[2]),
        ];
        let on_cube = cube::place(direction);
        let first_face = match self.op.arrayed {
            true => {
                let cube = self.layer(v, coordinates[3], (layers / 6).max(1) - 1);
                v.mul_i(cube, v.splat_i(6))
            }
            false => v.splat_i(0),
        };
        let layer = v.add_i(first_face, vector_of(v, &on_cube.face));
        let layer = v.min_i(layer, v.splat_i(layers - 1));
        Place {
            s: v.load(&lod::words(&on_cube.s)),
            t: v.load(&lod::words(&on_cube.t)),
            layer: v.mul_i(layer, v.splat_i(self.image.layer_stride_bytes as i32)),
            first_face,
            face: on_cube.face,
        }
    }

    /// The reference of depth comparisons: fixed-point depths lie in 0..1, so the reference must,
    /// too.
    #[inline(always)]
    pub(super) fn reference<V: Vector>(&self, v: V, row: &Row) -> V::F {
        let reference = v.load(row);
        match self.info.numeric {
            Numeric::Unorm => v.min(v.max(reference, v.splat(0.0)), v.splat(1.0)),
            _ => reference,
        }
    }

    /// The border's word of the component that a gather takes.
    pub(super) fn gathered_border(&self) -> u32 {
        let component = gathered_component(&self.op.kind, self.image).unwrap_or(0);
        sample::border_units(self.sampler, self.info)[component]
    }

    /// Puts the border in the place of texels of other lanes than those `inside`.
    #[inline(always)]
    fn replace_outside<V: Vector>(&self, v: V, texel: &mut Components<V>, inside: u16) {
        if !self.has_border || inside == u16::MAX {
            return;
        }
        let mut border = sample::border_units(self.sampler, self.info);
        if self.straight && self.info.codec == Codec::Bgra8 {
            border.swap(0, 2);
        }
        for (component, word) in texel.iter_mut().zip(border) {
            let replaced = v.select(inside, v.bits_of(*component), v.splat_i(word as i32));
            *component = v.bits_to_f(replaced);
        }
    }

    /// Puts the comparison in the place of a depth, if there is a reference.
    #[inline(always)]
    fn put_compared<V: Vector>(&self, v: V, texel: &mut Components<V>, reference: Option<V::F>) {
        if let Some(reference) = reference {
            texel[0] = self.compare(v, texel[0], reference);
        }
    }

    /// 1 where the comparison of a depth with the reference holds, else 0.
    #[inline(always)]
    fn compare<V: Vector>(&self, v: V, depth: V::F, reference: V::F) -> V::F {
        let depth = match block::unit_scale(self.info) {
            1.0 => depth,
            // A border need not be among the units.
            scale if self.has_border => v.div(depth, v.splat(scale)),
            scale => v.div_units(depth, scale),
        };
        let holds = match self.sampler.compare.unwrap_or(CompareOp::Never) {
            CompareOp::Never => 0,
            CompareOp::Less => v.gt(depth, reference),
            CompareOp::Equal => v.eq(reference, depth),
            CompareOp::LessOrEqual => v.ge(depth, reference),
            CompareOp::Greater => v.gt(reference, depth),
            CompareOp::NotEqual => !v.eq(reference, depth),
            CompareOp::GreaterOrEqual => v.ge(reference, depth),
            CompareOp::Always => u16::MAX,
        };
        let (one, zero) = (v.splat(1.0), v.splat(0.0));
        v.bits_to_f(v.select(holds, v.bits_of(one), v.bits_of(zero)))
    }

    /// The comparison of a plane's depths at the lanes' places with the reference: linear between
    /// those of four texels, or the nearest one's.
    ///
    /// # Safety
    /// As [`Fast::weighted`].
    #[inline(always)]
    pub(super) unsafe fn compared<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        axes: &[Axis<V>; 2],
        reference: V::F,
        mask: u16,
    ) -> V::F {
        let [x, y] = axes;
        let offset = v.add_i(levels.offset, layer);
        // SAFETY: the caller's promise.
        unsafe {
            if self.is_nearest {
                let texel = self.texel(v, v.add_i(v.add_i(offset, y.first), x.first));
                return self.compare(v, texel[0], reference);
            }
            let depths = match self.info.codec {
                Codec::Words(1) if self.info.size_bytes == 4 => {
                    let words = self.four_words(v, levels, layer, [x, y], mask);
                    Some([
                        v.bits_to_f(words[0]),
                        v.bits_to_f(words[1]),
                        v.bits_to_f(words[2]),
                        v.bits_to_f(words[3]),
                    ])
                }
                _ => self.depths(v, offset, axes),
            };
            let [a, b, c, d] = match depths {
                Some(depths) => depths,
                None => {
                    let (upper, lower) = (v.add_i(offset, y.first), v.add_i(offset, y.second));
                    [
                        self.texel(v, v.add_i(upper, x.first))[0],
                        self.texel(v, v.add_i(upper, x.second))[0],
                        self.texel(v, v.add_i(lower, x.first))[0],
                        self.texel(v, v.add_i(lower, x.second))[0],
                    ]
                }
            };
            let upper = v.lerp(
                self.compare(v, a, reference),
                self.compare(v, b, reference),
                x.weight,
            );
            let lower = v.lerp(
                self.compare(v, c, reference),
                self.compare(v, d, reference),
                x.weight,
            );
            v.lerp(upper, lower, y.weight)
        }
    }
}
