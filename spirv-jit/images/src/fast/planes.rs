//! Samples of 2D and 3D images without borders, and gathers, for one subgroup of a wave after the
//! other. What the image and the sampler decide is decided before the first, most of it when this
//! is compiled: so numbers stay in registers, and neighbours' chains of operations overlap.

use std::hint::assert_unchecked;

use lanes::vector::{Task, Vector};
use lanes::{Row, quad};

use super::super::rows::Wave;
use super::super::{AddressMode, LodMode};
use super::axis::{Along, Axis};
use super::levels::{Anisotropy, Levels, levels_of};
use super::taps::Taps;
use super::{Components, Fast};

/// How both coordinates are brought into a level.
mod mode {
    pub const CLAMP: u8 = 0;
    pub const REPEAT: u8 = 1;
    pub const ANY: u8 = 2;
}

/// Levels that may be sampled.
mod levels {
    pub const ONE: u8 = 0;
    pub const MANY: u8 = 1;
    /// One or many, at several places along a footprint.
    pub const ANISOTROPIC: u8 = 2;
}

/// The kinds of texels.
mod texels {
    /// Four bytes, as [`Fast::straight`](super::Fast::straight) has it, linear between them.
    pub const BYTES: u8 = 0;
    /// Four bytes, sRGB, linear between them.
    pub const SRGB: u8 = 1;
    pub const ANY: u8 = 5;
    /// A component, or the comparison, of the four texels of any format and dimension.
    pub const GATHERED_ANY: u8 = 6;
    /// Any format, in three dimensions.
    pub const VOLUME: u8 = 7;
    /// The nearest texel, of any format that is [`is_loaded`](super::Fast::is_loaded).
    pub const NEAREST: u8 = 8;
    /// The same in three dimensions.
    pub const NEAREST_IN_VOLUME: u8 = 9;

    pub const fn is_nearest(texels: u8) -> bool {
        matches!(texels, NEAREST | NEAREST_IN_VOLUME)
    }

    pub const fn is_volume(texels: u8) -> bool {
        matches!(texels, VOLUME | NEAREST_IN_VOLUME)
    }
}

struct Planes<'a, 'b, const LEVELS: u8, const MODE: u8, const TEXELS: u8>(
    &'b Fast<'a>,
    &'b Wave<'b>,
);

impl<V: Vector, const LEVELS: u8, const MODE: u8, const TEXELS: u8> Task<V>
    for Planes<'_, '_, LEVELS, MODE, TEXELS>
{
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Planes(fast, wave) = self;
        // Copies that results are not written to, as far as the compiler can see: what is known of
        // them before the first subgroup holds for all.
        let (fast, wave) = (&{ *fast }, &{ *wave });
        // SAFETY: `Fast::planes` chose this.
        unsafe {
            let is_gather = TEXELS == texels::GATHERED_ANY;
            assert_unchecked(fast.is_gather() == is_gather);
            assert_unchecked(is_gather || !fast.is_cube);
            assert_unchecked(is_gather || !fast.op.depth_compare);
            assert_unchecked(fast.spatial == if texels::is_volume(TEXELS) { 3 } else { 2 });
            if LEVELS == levels::ONE {
                assert_unchecked(is_gather || !fast.has_levels());
            }
            assert_unchecked(fast.is_anisotropic == (LEVELS == levels::ANISOTROPIC));
            match TEXELS {
                texels::BYTES | texels::SRGB => {
                    assert_unchecked(!fast.is_nearest && fast.bytes);
                    assert_unchecked(fast.srgb == (TEXELS == texels::SRGB));
                    assert_unchecked(fast.straight == (TEXELS == texels::BYTES));
                    assert_unchecked(fast.info.size_bytes == 4 && fast.block_shift == 0);
                }
                texels::NEAREST | texels::NEAREST_IN_VOLUME => {
                    assert_unchecked(fast.is_nearest && fast.is_loaded && fast.block_shift == 0);
                }
                texels::ANY | texels::VOLUME if V::IS_MACHINES && LEVELS != levels::ANISOTROPIC => {
                    assert_unchecked(!(fast.is_nearest && fast.is_loaded));
                }
                _ => {}
            }
            if MODE != mode::ANY {
                assert_unchecked(!fast.sampler.unnormalized_coordinates);
            }
        }
        let first = levels_of(v, &fast.image.levels[0]);
        for subgroup in 0..wave.subgroups.len() {
            // SAFETY: the caller keeps the contract of this function; levels are the image's,
            // layers the view's.
            unsafe {
                let mask = wave.mask(subgroup);
                let s = v.load(wave.operand(subgroup, 0));
                let t = v.load(wave.operand(subgroup, 1));
                let layer = match fast.op.arrayed {
                    true => Some(wave.operand(subgroup, 2)),
                    false => None,
                };
                let layer = fast.layer_offset(v, layer);
                let offsets = match fast.op.has_offset {
                    true => [
                        Some(v.load_i(wave.offset(fast.op, subgroup, 0))),
                        Some(v.load_i(wave.offset(fast.op, subgroup, 1))),
                        match texels::is_volume(TEXELS) {
                            true => Some(v.load_i(wave.offset(fast.op, subgroup, 2))),
                            false => None,
                        },
                    ],
                    false => [None; 3],
                };
                let r = match texels::is_volume(TEXELS) {
                    true => v.load(wave.operand(subgroup, 2)),
                    false => v.splat(0.0),
                };
                let places = [(s, offsets[0]), (t, offsets[1]), (r, offsets[2])];
                if TEXELS == texels::GATHERED_ANY {
                    let reference = match fast.op.depth_compare {
                        true => Some(wave.reference(fast.op, subgroup)),
                        false => None,
                    };
                    let (coordinates, count) = coordinates(fast, wave, subgroup);
                    let coordinates = &coordinates[..count];
                    let texels = fast.gathered(v, coordinates, offsets, reference, mask);
                    wave.put_numbers(v, subgroup, fast.gathered_values(v, texels));
                    continue;
                }
                if LEVELS == levels::ONE || texels::is_volume(TEXELS) && !fast.has_levels() {
                    let sampled = of_level::<V, MODE, TEXELS>(fast, v, &first, layer, places, mask);
                    wave.put_numbers(v, subgroup, fast.finish(v, sampled));
                    continue;
                }
                let (level, weight, anisotropy) = levels_of_detail(fast, v, wave, subgroup, mask);
                let near = fast.levels(v, level, mask);
                let far = match v.gt(weight, v.splat(0.0)) & mask != 0 {
                    true => Some(fast.levels(v, fast.next_level(v, level), mask)),
                    false => None,
                };
                let of_levels = OfLevels::<V> {
                    near,
                    far,
                    weight,
                    layer,
                };
                let Some(along) = anisotropy else {
                    let sampled = of_levels.sample::<MODE, TEXELS>(fast, v, places, mask);
                    wave.put_numbers(v, subgroup, fast.finish(v, sampled));
                    continue;
                };
                let mut total = [v.splat(0.0); 4];
                let mut pass = 0;
                loop {
                    let [ds, dt, _] = along.place(v, pass);
                    let places = [
                        (v.add(s, ds), offsets[0]),
                        (v.add(t, dt), offsets[1]),
                        (r, offsets[2]),
                    ];
                    let sampled = of_levels.sample::<MODE, TEXELS>(fast, v, places, mask);
                    total = match pass {
                        0 => sampled,
                        _ => [
                            along.sum(v, pass, total[0], sampled[0]),
                            along.sum(v, pass, total[1], sampled[1]),
                            along.sum(v, pass, total[2], sampled[2]),
                            along.sum(v, pass, total[3], sampled[3]),
                        ],
                    };
                    pass += 1;
                    if !along.goes_on(v, pass, mask) {
                        break;
                    }
                }
                let mean = [
                    v.div(total[0], along.count),
                    v.div(total[1], along.count),
                    v.div(total[2], along.count),
                    v.div(total[3], along.count),
                ];
                wave.put_numbers(v, subgroup, fast.finish(v, mean));
            }
        }
    }
}

/// The rows of a subgroup's coordinates, and their number: a cube's layer is the last.
///
/// # Safety
/// As [`Wave::mask`].
#[inline(always)]
pub(super) unsafe fn coordinates<'w>(
    fast: &Fast<'_>,
    wave: &'w Wave<'_>,
    subgroup: usize,
) -> ([&'w Row; 4], usize) {
    let count = fast.op.coordinate_count().min(4);
    // SAFETY: the caller keeps the contract of `Wave::mask`.
    unsafe {
        let mut coordinates = [wave.operand(subgroup, 0); 4];
        for (index, row) in coordinates.iter_mut().enumerate().take(count).skip(1) {
            *row = wave.operand(subgroup, index);
        }
        (coordinates, count)
    }
}

/// The levels that lanes sample.
struct OfLevels<'l, V: Vector> {
    near: Levels<'l, V>,
    /// Those behind them, where some lane samples one.
    far: Option<Levels<'l, V>>,
    /// The weight of those.
    weight: V::F,
    layer: V::I,
}

impl<V: Vector> OfLevels<'_, V> {
    /// # Safety
    /// As [`Fast::blended`].
    #[inline(always)]
    unsafe fn sample<const MODE: u8, const TEXELS: u8>(
        &self,
        fast: &Fast<'_>,
        v: V,
        places: [AxisCoordinate<V>; 3],
        mask: u16,
    ) -> Components<V> {
        // SAFETY: the caller keeps the contract of `Fast::blended`.
        unsafe {
            let near = of_level::<V, MODE, TEXELS>(fast, v, &self.near, self.layer, places, mask);
            let Some(far) = &self.far else {
                return near;
            };
            let far = of_level::<V, MODE, TEXELS>(fast, v, far, self.layer, places, mask);
            [
                v.lerp(near[0], far[0], self.weight),
                v.lerp(near[1], far[1], self.weight),
                v.lerp(near[2], far[2], self.weight),
                v.lerp(near[3], far[3], self.weight),
            ]
        }
    }
}

/// The level of each lane, the weight of the next, and where samples are, if there may be several.
///
/// # Safety
/// As [`Wave::mask`].
#[inline(always)]
unsafe fn levels_of_detail<V: Vector>(
    fast: &Fast<'_>,
    v: V,
    wave: &Wave<'_>,
    subgroup: usize,
    active: u16,
) -> (V::I, V::F, Option<Anisotropy<V>>) {
    // SAFETY: the caller keeps the contract of `Wave::mask`.
    let footprint = unsafe {
        match fast.op.lod {
            LodMode::Grad if wave.derives => {
                let s = v.load(wave.operand(subgroup, 0));
                let t = v.load(wave.operand(subgroup, 1));
                let zero = v.splat(0.0);
                let derivatives = [
                    [
                        v.derivative::<{ quad::X }>(s, active),
                        v.derivative::<{ quad::X }>(t, active),
                        zero,
                    ],
                    [
                        v.derivative::<{ quad::Y }>(s, active),
                        v.derivative::<{ quad::Y }>(t, active),
                        zero,
                    ],
                ];
                fast.footprint(v, derivatives)
            }
            LodMode::Grad => {
                let zero = v.splat(0.0);
                let derivatives = [
                    [
                        v.load(wave.lod(fast.op, subgroup, 0)),
                        v.load(wave.lod(fast.op, subgroup, 1)),
                        zero,
                    ],
                    [
                        v.load(wave.lod(fast.op, subgroup, 2)),
                        v.load(wave.lod(fast.op, subgroup, 3)),
                        zero,
                    ],
                ];
                fast.footprint(v, derivatives)
            }
            LodMode::Bias | LodMode::Lod => {
                let lod = Some(wave.lod(fast.op, subgroup, 0));
                let (level, weight) = fast.chosen_levels(v, lod, None);
                return (level, weight, None);
            }
            LodMode::Implicit => {
                let (level, weight) = fast.chosen_levels(v, None, None);
                return (level, weight, None);
            }
        }
    };
    let (level, weight) = fast.chosen_levels(v, None, Some(footprint.lambda));
    (level, weight, footprint.anisotropy)
}

/// A coordinate, and an offset in texels.
type AxisCoordinate<V> = (<V as Vector>::F, Option<<V as Vector>::I>);

#[inline(always)]
fn modes<const MODE: u8>(fast: &Fast<'_>) -> [AddressMode; 2] {
    match MODE {
        mode::CLAMP => [AddressMode::ClampToEdge; 2],
        mode::REPEAT => [AddressMode::Repeat; 2],
        _ => [fast.sampler.address_mode[0], fast.sampler.address_mode[1]],
    }
}

/// The footprints at levels.
#[inline(always)]
fn axes<V: Vector, const MODE: u8>(
    fast: &Fast<'_>,
    v: V,
    levels: &Levels<'_, V>,
    [s, t, r]: [AxisCoordinate<V>; 3],
    mask: u16,
) -> [Axis<V>; 3] {
    let [mode_s, mode_t] = modes::<MODE>(fast);
    let looked_at = match levels.one {
        Some(_) => mask,
        None => u16::MAX,
    };
    let columns = Along {
        size: levels.width,
        stride: v.splat_i(fast.info.size_bytes as i32),
        block_shift: fast.block_shift,
        looked_at,
    };
    let rows = Along {
        size: levels.height,
        stride: levels.row_stride,
        ..columns
    };
    let depth = match fast.spatial {
        3 => {
            let slices = Along {
                size: levels.depth,
                stride: levels.slice_stride,
                block_shift: 0,
                looked_at,
            };
            fast.axis(v, fast.sampler.address_mode[2], r, slices)
        }
        _ => Axis::none(v),
    };
    [
        fast.axis(v, mode_s, s, columns),
        fast.axis(v, mode_t, t, rows),
        depth,
    ]
}

/// # Safety
/// As [`Fast::blended`].
#[inline(always)]
unsafe fn of_level<V: Vector, const MODE: u8, const TEXELS: u8>(
    fast: &Fast<'_>,
    v: V,
    levels: &Levels<'_, V>,
    layer: V::I,
    places: [AxisCoordinate<V>; 3],
    mask: u16,
) -> Components<V> {
    if texels::is_nearest(TEXELS) {
        let [s, t, r] = places;
        let [mode_s, mode_t] = modes::<MODE>(fast);
        let column = fast.nearest(v, mode_s, s, levels.width);
        let row = fast.nearest(v, mode_t, t, levels.height);
        // SAFETY: the caller keeps the contract of `Fast::blended`.
        return unsafe {
            match TEXELS {
                texels::NEAREST_IN_VOLUME => {
                    let slice = fast.nearest(v, fast.sampler.address_mode[2], r, levels.depth);
                    let slice = v.mul_i(slice, levels.slice_stride);
                    fast.nearest_of(v, levels, v.add_i(layer, slice), [column, row], mask)
                }
                _ => fast.nearest_of(v, levels, layer, [column, row], mask),
            }
        };
    }
    let axes = axes::<V, MODE>(fast, v, levels, places, mask);
    // SAFETY: the caller keeps the contract of `Fast::blended`.
    unsafe {
        if TEXELS != texels::VOLUME {
            return fast.weighted(v, levels, layer, &axes, mask);
        }
        if fast.is_nearest && fast.is_loaded {
            return fast.nearest_texel(v, levels, layer, &axes);
        }
        let mut taps = Taps::new(v);
        fast.place_taps(v, levels, layer, &axes, &mut taps);
        fast.blended(v, &mut taps, None, None)
    }
}

impl Fast<'_> {
    /// Whether [`Self::planes`] is for these samples. Where operations are no instructions, only
    /// the most common ones are worth their code.
    #[inline(always)]
    pub(in super::super) fn is_of_planes<V: Vector>(&self) -> bool {
        let is_common = V::IS_MACHINES
            || !self.has_levels()
                && !self.is_gather()
                && !self.is_cube
                && self.spatial == 2
                && !self.is_anisotropic;
        is_common && !self.has_more
    }

    /// Samples of subgroups, each of which has lanes that sample.
    ///
    /// # Safety
    /// As [`sample`](super::super::wave::sample).
    #[inline(always)]
    pub(in super::super) unsafe fn planes<V: Vector>(&self, v: V, wave: &Wave<'_>) {
        use AddressMode::{ClampToEdge, Repeat};
        debug_assert!(self.is_of_planes::<V>());
        let texels = match self.is_nearest {
            true if self.is_loaded => texels::NEAREST,
            _ if self.is_nearest || !self.srgb && !self.straight => texels::ANY,
            _ if self.srgb => texels::SRGB,
            _ => texels::BYTES,
        };
        let mode = match self.sampler.address_mode[..2] {
            _ if self.sampler.unnormalized_coordinates => mode::ANY,
            _ if self.takes_derivatives() => mode::ANY,
            [ClampToEdge, ClampToEdge] => mode::CLAMP,
            [Repeat, Repeat] => mode::REPEAT,
            _ => mode::ANY,
        };
        // SAFETY: the caller keeps the contract of `Fast::blended`; each is for the samples that it
        // says.
        unsafe {
            macro_rules! run {
                ($levels:ident $texels:ident $mode:ident) => {
                    v.apart(Planes::<
                        { levels::$levels },
                        { mode::$mode },
                        { texels::$texels },
                    >(self, wave))
                };
            }
            // The constant alone decides: where it is false, nothing behind it is compiled.
            match V::IS_MACHINES {
                false => return run!(ONE ANY ANY),
                true => {}
            }
            if self.is_gather() {
                return run!(ONE GATHERED_ANY ANY);
            }
            if self.spatial == 3 {
                return match self.is_nearest && self.is_loaded {
                    true => run!(MANY NEAREST_IN_VOLUME ANY),
                    false => run!(MANY VOLUME ANY),
                };
            }
            let levels = match self.has_levels() {
                _ if self.is_anisotropic => levels::ANISOTROPIC,
                true => levels::MANY,
                false => levels::ONE,
            };
            match (levels, texels, mode) {
                (levels::ONE, texels::BYTES, mode::CLAMP) => run!(ONE BYTES CLAMP),
                (levels::ONE, texels::BYTES, mode::REPEAT) => run!(ONE BYTES REPEAT),
                (levels::ONE, texels::SRGB, mode::CLAMP) => run!(ONE SRGB CLAMP),
                (levels::ONE, texels::SRGB, mode::REPEAT) => run!(ONE SRGB REPEAT),
                (levels::ONE, ..) => run!(ONE ANY ANY),
                (levels::MANY, texels, _) if texels::is_nearest(texels) => run!(MANY NEAREST ANY),
                (levels::MANY, texels::BYTES, _) => run!(MANY BYTES ANY),
                (levels::MANY, texels::SRGB, _) => run!(MANY SRGB ANY),
                (levels::MANY, ..) => run!(MANY ANY ANY),
                (_, texels::BYTES, _) => run!(ANISOTROPIC BYTES ANY),
                (_, texels::SRGB, _) => run!(ANISOTROPIC SRGB ANY),
                _ => run!(ANISOTROPIC ANY ANY),
            }
        }
    }
}
