//! Samples that need more than one bilinear footprint: of cubes, with borders and comparisons, at
//! several places along a footprint, and gathers.

use std::mem::MaybeUninit;

use lanes::Row;
use lanes::vector::{Task, Vector};

use super::super::format::Numeric;
use super::super::format::block;
use super::super::lod;
use super::super::operands::Operands;
use super::super::{AddressMode, CompareOp, ImageDescriptor, ImageOpKind, LodMode, cube};
use super::axis::{Along, Axis};
use super::levels::{Anisotropy, Levels, levels_of};
use super::taps::{Taps, index_in_block};
use super::{Components, Fast, Offsets};

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
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match self.fast.op.kind {
                ImageOpKind::Gather(_) => {
                    let offsets = self.fast.offsets(v, self.operands);
                    let coordinates = self.operands.coordinates;
                    let reference = self.operands.depth_reference;
                    (self.fast).gathered(v, coordinates, offsets, reference, self.mask)
                }
                _ => self.fast.sampled_whole(v, self.operands, self.mask),
            }
        }
    }
}

/// Where lanes sample: coordinates along the image's axes or on the face, and the layer.
pub(super) struct LaneCoordinates<V: Vector> {
    pub coordinates: [V::F; 3],
    /// The layer's offset, in bytes.
    pub layer: V::I,
    /// Of cubes: the layer of the first face, and the face.
    first_face: V::I,
    face: V::I,
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
        let mut place = self.place(v, operands.coordinates);
        let (lambda, anisotropy) = self.lod_of_gradients(v, operands);
        #[expect(clippy::manual_map, reason = "closures are not compiled for the tier")]
        let reference = match operands.depth_reference {
            Some(row) => Some(self.reference(v, row)),
            None => None,
        };
        let (level, weight) = self.chosen_levels(v, operands.lod.first().copied(), lambda);
        let blends = self.has_levels() && v.gt(weight, v.splat(0.0)) & mask != 0;
        let levels = [level, self.next_level(v, level)];
        let centre = place.coordinates;
        let mut taps = Taps::new(v);
        let mut total = [v.splat(0.0); 4];
        let mut pass = 0;
        loop {
            if let Some(anisotropy) = &anisotropy {
                let moved = anisotropy.place(v, pass);
                for axis in 0..3 {
                    place.coordinates[axis] = v.add(centre[axis], moved[axis]);
                }
            }
            let mut components = [v.splat(0.0); 4];
            for (i, level) in levels.into_iter().enumerate().take(1 + blends as usize) {
                // SAFETY: the caller keeps the contract of this function; the levels are the
                // image's.
                let of_level = unsafe {
                    let levels = self.levels(v, level, mask);
                    let axes = self.axes(v, &levels, place.coordinates, offsets, mask);
                    let [x, y, _] = &axes;
                    let is_inner = x.is_inner && y.is_inner;
                    if self.is_nearest && self.is_loaded {
                        let mut texel = self.nearest_texel(v, &levels, place.layer, &axes);
                        if let Some(reference) = reference {
                            texel[0] = self.compare(v, texel[0], reference);
                        }
                        texel
                    } else if (self.straight || self.srgb) && self.spatial == 2 && is_inner {
                        self.weighted(v, &levels, place.layer, &axes, mask)
                    } else {
                        self.put_taps(v, &levels, &place, &axes, &mut taps);
                        self.blended(v, &mut taps, reference, None)
                    }
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

    /// The level of detail by the operands' gradients, with the axis of anisotropic samples; `None`
    /// without gradients.
    #[inline(always)]
    fn lod_of_gradients<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
    ) -> (Option<V::F>, Option<Anisotropy<V>>) {
        if self.op.lod != LodMode::Grad || !self.takes_derivatives() {
            return (None, None);
        }
        if self.is_cube {
            let lod = lod::from_gradients(self.op, operands, self.image, self.sampler);
            return (Some(v.load(&lod::words(&lod.lambda))), None);
        }
        let mut derivatives = [[v.splat(0.0); 3]; 2];
        for (screen, along) in derivatives.iter_mut().enumerate() {
            for axis in 0..self.spatial {
                along[axis] = v.load(operands.lod[screen * self.spatial + axis]);
            }
        }
        let footprint = self.footprint(v, derivatives);
        (Some(footprint.lambda), footprint.anisotropy)
    }

    /// A gather in the lanes of `mask`: the component, or the comparison with a reference, of the
    /// four texels.
    ///
    /// # Safety
    /// As [`Fast::blended`].
    #[inline(always)]
    pub(super) unsafe fn gathered<V: Vector>(
        &self,
        v: V,
        coordinates: &[&Row],
        offsets: Offsets<V>,
        reference: Option<&Row>,
        mask: u16,
    ) -> Components<V> {
        let place = self.place(v, coordinates);
        let levels = levels_of(v, &self.image.levels[0]);
        #[expect(clippy::manual_map, reason = "closures are not compiled for the tier")]
        let reference = match reference {
            Some(row) => Some(self.reference(v, row)),
            None => None,
        };
        let component = match reference {
            Some(_) => 0,
            None => gathered_component(&self.op.kind, self.image).unwrap_or(0),
        };
        let mut taps = Taps::new(v);
        let axes = self.axes(v, &levels, place.coordinates, offsets, mask);
        self.put_taps(v, &levels, &place, &axes, &mut taps);
        // SAFETY: the caller keeps the contract of `Fast::blended`; the level is the image's.
        unsafe { self.blended(v, &mut taps, reference, Some(component)) }
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

    /// The footprints at levels.
    #[inline(always)]
    pub(super) fn axes<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        coordinates: [V::F; 3],
        offsets: Offsets<V>,
        mask: u16,
    ) -> [Axis<V>; 3] {
        let looked_at = match levels.one {
            Some(_) => mask,
            None => u16::MAX,
        };
        let texel_bytes = v.splat_i(self.info.size_bytes as i32);
        let along = [
            (levels.width, texel_bytes, self.block_shift),
            (levels.height, levels.row_stride, self.block_shift),
            (levels.depth, levels.slice_stride, 0),
        ];
        let mut axes = [Axis::none(v); 3];
        for (index, (size, stride, block_shift)) in along.into_iter().enumerate() {
            if index == self.spatial {
                break;
            }
            let mode = match self.is_cube {
                true => AddressMode::ClampToEdge,
                false => self.sampler.address_mode[index],
            };
            let along = Along {
                size,
                stride,
                block_shift,
                looked_at,
            };
            axes[index] = self.axis(v, mode, (coordinates[index], offsets[index]), along);
        }
        axes
    }

    /// The texels around each lane; where a sample takes the nearest one, that.
    #[inline(always)]
    fn put_taps<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &LaneCoordinates<V>,
        axes: &[Axis<V>; 3],
        taps: &mut Taps<V>,
    ) {
        let [x, y, _] = axes;
        if self.is_cube && !self.is_nearest && !(x.is_inner && y.is_inner) {
            return self.put_taps_across_edges(v, levels, place, [x, y], taps);
        }
        self.place_taps(v, levels, place.layer, axes, taps);
    }

    /// [`Self::put_taps`] where some lie on other faces than their lanes' places.
    #[inline(always)]
    fn put_taps_across_edges<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        place: &LaneCoordinates<V>,
        [x, y]: [&Axis<V>; 2],
        taps: &mut Taps<V>,
    ) {
        let (one, zero) = (v.splat_i(1), v.splat_i(0));
        let face = place.face;
        let last_layer = v.splat_i(self.image.layer_count.max(1) as i32 - 1);
        let last_row = v.sub_i(levels.height, one);
        (taps.count, taps.in_pairs) = (4, false);
        taps.weights = [x.weight, y.weight, y.weight];
        let mut past_corner = [0; 4];
        for tap in 0..4 {
            let x = v.add_i(x.at, if tap & 1 == 0 { zero } else { one });
            let y = v.add_i(y.at, if tap >> 1 == 0 { zero } else { one });
            // Coordinates lie on their faces, so a footprint crosses an edge by one texel; NaN
            // excepted.
            let x = v.max_i(v.min_i(x, levels.width), v.splat_i(-1));
            let y = v.max_i(v.min_i(y, levels.width), v.splat_i(-1));
            let ([x, y, face], past) = cube::wrap_edges_in_vectors(v, [x, y, face], levels.width);
            past_corner[tap] = past;
            let layer = v.min_i(v.add_i(place.first_face, face), last_layer);
            let y = v.min_i(y, last_row);
            let (mut column, mut row) = (x, y);
            if self.block_shift != 0 {
                column = v.right_u(x, self.block_shift);
                row = v.right_u(y, self.block_shift);
                taps.index[tap] = MaybeUninit::new(index_in_block(v, x, y));
            }
            let at = v.mul_i(layer, v.splat_i(self.image.layer_stride_bytes as i32));
            let at = v.add_i(at, v.mul_i(row, levels.row_stride));
            let texel_bytes = v.splat_i(self.info.size_bytes as i32);
            let at = v.add_i(at, v.mul_i(column, texel_bytes));
            taps.offsets[tap] = MaybeUninit::new(v.add_i(levels.offset, at));
        }
        taps.past_corner = (past_corner != [0; 4]).then_some(past_corner);
    }

    /// Where the lanes sample.
    #[inline(always)]
    pub(super) fn place<V: Vector>(&self, v: V, coordinates: &[&Row]) -> LaneCoordinates<V> {
        if !self.is_cube {
            let mut place = LaneCoordinates {
                coordinates: [v.splat(0.0); 3],
                layer: self.layer_offset(v, coordinates.get(self.spatial).copied()),
                first_face: v.splat_i(0),
                face: v.splat_i(0),
            };
            for axis in 0..self.spatial {
                place.coordinates[axis] = v.load(coordinates[axis]);
            }
            return place;
        }
        let layers = self.image.layer_count.max(1) as i32;
        let direction = [
            v.load(coordinates[0]),
            v.load(coordinates[1]),
            v.load(coordinates[2]),
        ];
        let ([s, t], face) = cube::place_in_vectors(v, direction);
        let first_face = match self.op.arrayed {
            true => {
                let cube = self.layer(v, coordinates[3], (layers / 6).max(1) - 1);
                v.mul_i(cube, v.splat_i(6))
            }
            false => v.splat_i(0),
        };
        let layer = v.add_i(first_face, face);
        let layer = v.min_i(layer, v.splat_i(layers - 1));
        LaneCoordinates {
            coordinates: [s, t, v.splat(0.0)],
            layer: v.mul_i(layer, v.splat_i(self.image.layer_stride_bytes as i32)),
            first_face,
            face,
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

    /// 1 where the comparison of a depth with the reference holds, else 0.
    #[inline(always)]
    pub(super) fn compare<V: Vector>(&self, v: V, depth: V::F, reference: V::F) -> V::F {
        let depth = match block::unit_scale(self.info) {
            1.0 => depth,
            // A border need not be among the units.
            scale if self.has_border => v.div(depth, v.splat(scale)),
            scale => v.div_units(depth, scale),
        };
        self.passes(v, depth, reference)
    }

    /// As [`Self::compare`], of a depth that is not in units.
    #[inline(always)]
    pub(super) fn passes<V: Vector>(&self, v: V, depth: V::F, reference: V::F) -> V::F {
        let ones = v.splat_i(-1);
        let at_most = v.at_least(reference, depth);
        let at_least = v.at_least(depth, reference);
        let holds = match self.sampler.compare.unwrap_or(CompareOp::Never) {
            CompareOp::Never => v.splat_i(0),
            // Above, and not equal: `at_most` of a NaN is zero, too.
            CompareOp::Less => v.and_i(at_least, v.xor_i(at_most, ones)),
            CompareOp::Equal => v.and_i(at_most, at_least),
            CompareOp::LessOrEqual => at_least,
            CompareOp::Greater => v.and_i(at_most, v.xor_i(at_least, ones)),
            CompareOp::NotEqual => v.xor_i(v.and_i(at_most, at_least), ones),
            CompareOp::GreaterOrEqual => at_most,
            CompareOp::Always => ones,
        };
        v.bits_to_f(v.and_i(holds, v.bits_of(v.splat(1.0))))
    }
}
