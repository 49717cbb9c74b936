//! The levels that lanes sample.

use std::mem::offset_of;

use lanes::vector::{Task, Vector};
use lanes::{LANES, Row, quad};

use super::super::chunk::{ChunkRows, SUBGROUPS};
use super::super::derivatives::{derivatives, put_derivatives};
use super::super::lod;
use super::super::operands::Operands;
use super::super::rows::Wave;
use super::super::{Filter, Level, LodMode};
use super::Fast;

/// The levels of detail that the lanes of a chunk sample.
pub(super) struct Lods {
    /// Numbers of levels.
    pub levels: ChunkRows,
    /// The weight of the level behind each.
    pub weights: ChunkRows,
    /// A bit for each subgroup some lane of which samples the level behind its own.
    pub between: u16,
    /// Of anisotropic samples, as [`Anisotropy`] has them.
    pub counts: ChunkRows,
    pub axes: [ChunkRows; 3],
    /// Samples that some lane of a subgroup takes.
    pub passes: [u8; SUBGROUPS],
}

impl Lods {
    #[inline(always)]
    pub fn new() -> Lods {
        Lods {
            levels: ChunkRows::new(),
            weights: ChunkRows::new(),
            between: 0,
            counts: ChunkRows::new(),
            axes: [const { ChunkRows::new() }; 3],
            passes: [1; SUBGROUPS],
        }
    }

    /// Along which places a subgroup's samples are.
    ///
    /// # Safety
    /// They were put, of an anisotropic sample.
    #[inline(always)]
    pub unsafe fn anisotropy<V: Vector>(&self, v: V, index: usize) -> Anisotropy<V> {
        // SAFETY: the caller guarantees that these were put.
        unsafe {
            Anisotropy {
                count: v.bits_to_f(self.counts.get(v, index)),
                axis: [
                    v.bits_to_f(self.axes[0].get(v, index)),
                    v.bits_to_f(self.axes[1].get(v, index)),
                    v.bits_to_f(self.axes[2].get(v, index)),
                ],
            }
        }
    }
}

/// Chooses the levels of detail.
pub(super) struct ChooseLods<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub lods: &'b mut Lods,
}

impl<V: Vector> Task<V> for ChooseLods<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let lods = self.lods;
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller keeps the contract of `Fast::sample`.
            unsafe {
                let mask = wave.mask(index);
                let (lod, footprint) = match fast.op.lod {
                    LodMode::Implicit => (None, None),
                    LodMode::Bias | LodMode::Lod => (Some(wave.lod(fast.op, index, 0)), None),
                    LodMode::Grad => (None, Some(fast.footprint_of(v, wave, index, mask))),
                };
                #[expect(clippy::manual_map, reason = "closures are not compiled for the tier")]
                let lambda = match &footprint {
                    Some(footprint) => Some(footprint.lambda),
                    None => None,
                };
                let (level, weight) = fast.chosen_levels(v, lod, lambda);
                lods.levels.put(v, index, level);
                lods.weights.put(v, index, v.bits_of(weight));
                let is_between = v.gt(weight, v.splat(0.0)) & mask != 0;
                lods.between |= u16::from(is_between) << (index % SUBGROUPS);
                let anisotropy = match footprint {
                    Some(footprint) => footprint.anisotropy,
                    None => None,
                };
                if let Some(anisotropy) = anisotropy {
                    let mut passes = 1;
                    while anisotropy.goes_on(v, passes, mask) {
                        passes += 1;
                    }
                    lods.passes[index % SUBGROUPS] = passes as u8;
                    lods.counts.put(v, index, v.bits_of(anisotropy.count));
                    for (rows, axis) in lods.axes.iter_mut().zip(anisotropy.axis) {
                        rows.put(v, index, v.bits_of(axis));
                    }
                }
            }
        }
    }
}

/// The levels that the subgroups of a chunk sample, in each lane.
pub(super) struct LevelRows {
    /// Sizes of the axes.
    sizes: [ChunkRows; 3],
    /// Bytes from a line to the next, and from a slice to the next.
    strides: [ChunkRows; 2],
    /// Bytes to the first texel.
    pub offsets: ChunkRows,
    /// A bit for each subgroup whose lanes sample one level.
    has_one: u16,
}

impl LevelRows {
    #[inline(always)]
    pub fn new() -> LevelRows {
        LevelRows {
            sizes: [const { ChunkRows::new() }; 3],
            strides: [const { ChunkRows::new() }; 2],
            offsets: ChunkRows::new(),
            has_one: 0,
        }
    }

    /// The size of an axis, and the bytes between its texels or blocks, which are given for the
    /// first one.
    ///
    /// # Safety
    /// The levels were put; they have such an axis.
    #[inline(always)]
    pub unsafe fn extent<V: Vector>(
        &self,
        v: V,
        index: usize,
        axis: usize,
        texel_bytes: V::I,
    ) -> (V::I, V::I) {
        // SAFETY: the caller guarantees that the levels were put.
        unsafe {
            let stride = match axis {
                0 => texel_bytes,
                _ => self.strides[(axis - 1) & 1].get(v, index),
            };
            (self.sizes[axis].get(v, index), stride)
        }
    }

    /// The lanes that have to be inside for texels to be looked at as they lie.
    #[inline(always)]
    pub fn looked_at(&self, index: usize, mask: u16) -> u16 {
        match self.has_one >> (index % SUBGROUPS) & 1 {
            1 => mask,
            _ => u16::MAX,
        }
    }
}

/// Puts the chosen levels, or those behind them.
pub(super) struct PutLevels<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub levels: &'b ChunkRows,
    pub is_next: bool,
    pub to: &'b mut LevelRows,
}

impl<V: Vector> Task<V> for PutLevels<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let to = self.to;
        to.has_one = 0;
        let levels = &fast.image.levels;
        let last = v.splat_i(fast.image.level_count as i32 - 1);
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that levels were chosen, which are the image's; fields
            // of these are gathered.
            unsafe {
                let mut level = self.levels.get(v, index);
                if self.is_next {
                    level = v.min_i(v.add_i(level, v.splat_i(1)), last);
                }
                let mask = wave.mask(index);
                let mut row = [0; LANES];
                v.store_i(level, &mut row);
                let first = row[mask.trailing_zeros() as usize & 15];
                // Inactive lanes follow the first active one.
                if v.ne_i(level, v.splat_i(first as i32)) & mask == 0 {
                    let level = &levels[first as usize];
                    let sizes = [level.width, level.height, level.depth];
                    for (rows, size) in to.sizes.iter_mut().zip(sizes).take(fast.spatial) {
                        rows.put(v, index, v.splat_i(size as i32));
                    }
                    let strides = [level.row_stride_bytes, level.slice_stride_bytes];
                    for (rows, stride) in to.strides.iter_mut().zip(strides) {
                        rows.put(v, index, v.splat_i(stride as i32));
                    }
                    to.offsets
                        .put(v, index, v.splat_i(level.offset_bytes as i32));
                    to.has_one |= 1 << (index % SUBGROUPS);
                    continue;
                }
                let at = v.mul_i(level, v.splat_i(size_of::<Level>() as i32));
                let base = levels.as_ptr().cast::<u8>();
                // The lower words of 64-bit fields.
                let low = if cfg!(target_endian = "big") { 4 } else { 0 };
                let sizes = [
                    offset_of!(Level, width),
                    offset_of!(Level, height),
                    offset_of!(Level, depth),
                ];
                for (rows, size) in to.sizes.iter_mut().zip(sizes).take(fast.spatial) {
                    rows.put(v, index, v.gather(base.add(size), at));
                }
                let strides = [
                    offset_of!(Level, row_stride_bytes),
                    offset_of!(Level, slice_stride_bytes),
                ];
                for (rows, stride) in to.strides.iter_mut().zip(strides) {
                    rows.put(v, index, v.gather(base.add(stride + low), at));
                }
                let offset = v.gather(base.add(offset_of!(Level, offset_bytes) + low), at);
                to.offsets.put(v, index, offset);
            }
        }
    }
}

/// The footprints of the lanes' samples from their derivatives, as in [`lod`].
struct Footprint<V: Vector> {
    /// λ', without bias.
    lambda: V::F,
    anisotropy: Option<Anisotropy<V>>,
}

/// Sampling along the longer axis of a footprint.
pub(super) struct Anisotropy<V: Vector> {
    /// Samples to take, 1 to 16.
    pub count: V::F,
    /// The axis, in normalised coordinates.
    pub axis: [V::F; 3],
}

impl<V: Vector> Anisotropy<V> {
    /// Where sample `pass` of each lane is, or its last one, from the middle: samples i = 1..=N at
    /// i / (N + 1) - 1/2 along the axis.
    #[inline(always)]
    pub(super) fn place(&self, v: V, pass: u32) -> [V::F; 3] {
        let one = v.splat(1.0);
        let i = v.min(v.splat((pass + 1) as f32), self.count);
        let along = v.sub(v.div(i, v.add(self.count, one)), v.splat(0.5));
        [
            v.mul(along, self.axis[0]),
            v.mul(along, self.axis[1]),
            v.mul(along, self.axis[2]),
        ]
    }

    /// Whether lanes of the mask take a sample `pass`.
    #[inline(always)]
    fn goes_on(&self, v: V, pass: u32, mask: u16) -> bool {
        v.gt(self.count, v.splat(pass as f32)) & mask != 0
    }

    /// The sum with sample `pass`, of lanes that take it.
    #[inline(always)]
    pub(super) fn sum(&self, v: V, pass: u32, total: V::F, sample: V::F) -> V::F {
        let takes_part = v.gt(self.count, v.splat(pass as f32));
        let sum = v.bits_of(v.add(total, sample));
        v.bits_to_f(v.select(takes_part, sum, v.bits_of(total)))
    }
}

/// Binary logarithm, as [`lod`]'s.
#[inline(always)]
fn log2<V: Vector>(v: V, x: V::F) -> V::F {
    let least = v.splat_i(lod::SQRT_HALF as i32);
    let bits = v.sub_i(v.bits_of(x), least);
    let exponent = v.to_f(v.right_i(bits, 23));
    let mantissa = v.and_i(bits, v.splat_i(0x007f_ffff));
    let mantissa = v.bits_to_f(v.add_i(mantissa, least));
    let one = v.splat(1.0);
    let t = v.div(v.sub(mantissa, one), v.add(mantissa, one));
    let square = v.mul(t, t);
    let mut series = v.splat(lod::SERIES[4]);
    for power in [3, 2, 1, 0] {
        series = v.add(v.splat(lod::SERIES[power]), v.mul(square, series));
    }
    v.add(exponent, v.mul(t, series))
}

#[inline(always)]
fn square_length<V: Vector>(v: V, x: V::F, y: V::F) -> V::F {
    v.add(v.mul(x, x), v.mul(y, y))
}

impl Fast<'_> {
    /// The footprints of a subgroup's samples, by derivatives that are operands, or are those of
    /// the coordinates.
    ///
    /// # Safety
    /// As [`Fast::sample`].
    #[inline(always)]
    unsafe fn footprint_of<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        index: usize,
        mask: u16,
    ) -> Footprint<V> {
        // SAFETY: the caller keeps the contract of `Fast::sample`.
        unsafe {
            if self.is_cube {
                let (mut rows, count) = wave.operand_rows(index);
                let derived;
                if wave.derives {
                    derived = derivatives(v, self.op, &rows, mask);
                    put_derivatives(self.op, &derived, &mut rows);
                }
                let operands = Operands::new(self.op, &rows[..count]);
                let lod = lod::from_gradients(self.op, &operands, self.image, self.sampler);
                return Footprint {
                    lambda: v.load(&lod::words(&lod.lambda)),
                    anisotropy: None,
                };
            }
            let mut gradients = [[v.splat(0.0); 3]; 2];
            for axis in 0..self.spatial {
                if wave.derives {
                    let at = v.load(wave.operand(index, axis));
                    gradients[0][axis] = v.derivative::<{ quad::X }>(at, mask);
                    gradients[1][axis] = v.derivative::<{ quad::Y }>(at, mask);
                } else {
                    let row = wave.lod(self.op, index, axis);
                    gradients[0][axis] = v.load(row);
                    let row = wave.lod(self.op, index, self.spatial + axis);
                    gradients[1][axis] = v.load(row);
                }
            }
            self.footprint(v, gradients)
        }
    }

    /// The footprints of derivatives along the screen's x, then y, by the image's axes; of the
    /// third one only in 3D images.
    #[inline(always)]
    fn footprint<V: Vector>(&self, v: V, derivatives: [[V::F; 3]; 2]) -> Footprint<V> {
        let base = &self.image.levels[0];
        let (width, height) = (v.splat(base.width as f32), v.splat(base.height as f32));
        let [[sx, tx, rx], [sy, ty, ry]] = derivatives;
        let mut x = square_length(v, v.mul(sx, width), v.mul(tx, height));
        let mut y = square_length(v, v.mul(sy, width), v.mul(ty, height));
        if self.spatial == 3 {
            let depth = v.splat(base.depth as f32);
            let (of_x, of_y) = (v.mul(rx, depth), v.mul(ry, depth));
            (x, y) = (v.add(x, v.mul(of_x, of_x)), v.add(y, v.mul(of_y, of_y)));
        }
        let longer = v.max(x, y);
        let lambda = v.mul(v.splat(0.5), log2(v, longer));
        if !self.is_anisotropic {
            return Footprint {
                lambda,
                anisotropy: None,
            };
        }
        let one = v.splat(1.0);
        let most = lod::most_samples(self.sampler);
        let ratio = v.sqrt(v.div(longer, v.min(x, y)));
        let texels = v.max(v.ceil(v.sqrt(longer)), one);
        let count = v.min(v.max(v.ceil(ratio), one), v.splat(most.ceil()));
        let clamped = v.min(v.max(ratio, one), v.splat(most));
        let is_y = v.gt(y, x);
        let axis_s = v.select(is_y, v.bits_of(sy), v.bits_of(sx));
        let axis_t = v.select(is_y, v.bits_of(ty), v.bits_of(tx));
        let axis_r = v.select(is_y, v.bits_of(ry), v.bits_of(rx));
        Footprint {
            lambda: v.sub(lambda, log2(v, clamped)),
            anisotropy: Some(Anisotropy {
                count: v.min(count, texels),
                axis: [
                    v.bits_to_f(axis_s),
                    v.bits_to_f(axis_t),
                    v.bits_to_f(axis_r),
                ],
            }),
        }
    }

    /// The first of the levels that lanes sample, and the weight of the next. `lod` is bias or
    /// level, if the operation has one; `lambda` is that of a footprint.
    #[inline(always)]
    fn chosen_levels<V: Vector>(
        &self,
        v: V,
        lod: Option<&Row>,
        lambda: Option<V::F>,
    ) -> (V::I, V::F) {
        let levels = self.levels_of_detail(v, lod, lambda);
        match self.sampler.mipmap_mode {
            Filter::Nearest => {
                let level = v.floor(v.add(levels, v.splat(0.5)));
                (v.to_i(level), v.splat(0.0))
            }
            Filter::Linear => {
                let floor = v.floor(levels);
                (v.to_i(floor), v.sub(levels, floor))
            }
        }
    }

    /// λ' to d', as in [`lod`].
    #[inline(always)]
    fn levels_of_detail<V: Vector>(&self, v: V, lod: Option<&Row>, lambda: Option<V::F>) -> V::F {
        if !self.has_levels() {
            return v.splat(0.0);
        }
        let bias = v.splat(self.sampler.mip_lod_bias);
        let bias = match (self.op.lod, lod) {
            (LodMode::Bias, Some(row)) => v.add(bias, v.load(row)),
            _ => bias,
        };
        let bias = v.max(bias, v.splat(-lod::MAX_LOD_BIAS));
        let bias = v.min(bias, v.splat(lod::MAX_LOD_BIAS));
        let lambda = match (self.op.lod, lod, lambda) {
            (LodMode::Lod, Some(row), _) => v.add(v.load(row), bias),
            (_, _, Some(lambda)) => v.add(lambda, bias),
            _ => bias,
        };
        let lambda = v.min(lambda, v.splat(self.sampler.max_lod));
        let lambda = v.max(lambda, v.splat(self.sampler.min_lod));
        let level = v.max(v.max(lambda, v.splat(0.0)), v.splat(self.image.min_lod));
        v.min(level, v.splat((self.image.level_count - 1) as f32))
    }
}
