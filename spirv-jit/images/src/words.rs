//! Loads of texels whose components are words of memory as they are. All that subgroups have in
//! common is looked up once for a wave. Little then stands between two gathers: a processor
//! performs several at once, as far as it looks ahead and has room for the stores in between.

use lanes::LANES;
use lanes::vector::Vector;

use super::format::FormatInfo;
use super::plain::Plain;
use super::rows::Wave;
use super::{Dim, ImageDescriptor, ImageOp, LodMode};

/// An axis of an image, or its layers.
#[derive(Clone, Copy)]
pub(super) struct ImageAxis {
    pub operand: usize,
    pub size: u32,
    pub stride_bytes: u32,
}

/// The value of a result.
#[derive(Clone, Copy)]
enum Component {
    Unwanted,
    /// The format lacks it.
    Missing(u32),
    /// The word so many bytes behind the texel's start.
    Word(usize),
}

/// Loads that [`Plain`] applies to, from one level.
pub(super) struct WordLoads {
    /// The level's first texel.
    base: *const u8,
    axes: [ImageAxis; 4],
    axis_count: usize,
    texel_bytes: u32,
    components: [Component; 4],
}

impl WordLoads {
    /// `None` if components are no words, if lanes may differ in their level, or if the wave has no
    /// such level.
    ///
    /// # Safety
    /// As [`Wave`] says; the operation is that of `plain`.
    pub unsafe fn new(plain: &Plain<'_>, wave: &Wave<'_>) -> Option<WordLoads> {
        let (op, image, info) = plain.parts();
        let is_word = |bits: u8| matches!(bits, 0 | 32);
        let are_words = info.channels.iter().all(|channel| is_word(channel.bits));
        if !are_words || op.has_offset || image.swizzle != [0, 1, 2, 3] {
            return None;
        }
        // SAFETY: the caller guarantees that the wave is as `Wave` requires, for the operation of
        // `plain`.
        let level = unsafe { level(op, wave) }.filter(|&level| image.has_level(level))?;
        let (axes, axis_count) = axes(op, image, info, level);
        let component = |index: usize| match info.channels[index] {
            _ if wave.results[index].first.is_null() => Component::Unwanted,
            channel if channel.bits == 0 => Component::Missing(info.missing(index)),
            channel => Component::Word(channel.offset as usize / 8),
        };
        Some(WordLoads {
            base: (image.data.cast_const()).wrapping_add(image.levels[level].offset_bytes as usize),
            axes,
            axis_count,
            texel_bytes: info.size_bytes as u32,
            components: [0, 1, 2, 3].map(component),
        })
    }

    /// Loads the texels of a wave's subgroups.
    ///
    /// # Safety
    /// The wave is that of [`Self::new`]; the image's memory stays allocated during the call.
    #[inline(always)]
    pub unsafe fn load<V: Vector>(&self, v: V, wave: &Wave<'_>) {
        let steps: [u32; LANES] = std::array::from_fn(|lane| 4 * lane as u32);
        let steps = v.load_i(&steps);
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that the wave is that of `Self::new`; the image's
            // memory stays allocated during the call; lanes inside address texels of the level, and
            // others its first one.
            unsafe {
                let mask = wave.mask(index);
                if mask == 0 {
                    continue;
                }
                let mut inside = mask;
                let mut offsets = v.splat_i(0);
                let mut first = 0u32;
                for axis in self.axes.get_unchecked(..self.axis_count) {
                    let row = wave.operand(index, axis.operand);
                    let at = v.load_i(row);
                    inside &= v.lt_u(at, v.splat_i(axis.size as i32));
                    let stride = v.splat_i(axis.stride_bytes as i32);
                    offsets = v.add_i(offsets, v.mul_i(at, stride));
                    first = first.wrapping_add(row[0].wrapping_mul(axis.stride_bytes));
                }
                // One texel behind the other.
                let is_row = self.texel_bytes == 4
                    && inside == u16::MAX
                    && v.ne_i(v.sub_i(offsets, steps), v.splat_i(first as i32)) == 0;
                if is_row {
                    let row = self.base.add(first as usize).cast::<[u32; LANES]>();
                    let words = v.load_i(&row.read_unaligned());
                    self.put(v, wave, index, words);
                } else {
                    let offsets = v.keep(offsets, inside);
                    self.gather(v, wave, index, (offsets, inside));
                }
            }
        }
    }

    /// Writes the results of texels that have one component.
    ///
    /// # Safety
    /// As [`Self::load`].
    #[inline(always)]
    unsafe fn put<V: Vector>(&self, v: V, wave: &Wave<'_>, index: usize, words: V::I) {
        for (component, &what) in self.components.iter().enumerate() {
            let value = match what {
                Component::Unwanted => continue,
                Component::Missing(word) => v.splat_i(word as i32),
                Component::Word(_) => words,
            };
            // SAFETY: the caller keeps the contract of `Self::load`.
            unsafe { wave.put_component(v, index, component, value) };
        }
    }

    /// Gathers and writes each component's words.
    ///
    /// # Safety
    /// As [`Self::load`]; the base and each offset address a texel.
    #[inline(always)]
    unsafe fn gather<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        index: usize,
        (offsets, inside): (V::I, u16),
    ) {
        for (component, &what) in self.components.iter().enumerate() {
            // SAFETY: the caller keeps the contract of `Self::load`; the base and each offset
            // address a texel.
            unsafe {
                let value = match what {
                    Component::Unwanted => continue,
                    Component::Missing(word) => v.splat_i(word as i32),
                    Component::Word(behind) => {
                        v.keep(v.gather(self.base.add(behind), offsets), inside)
                    }
                };
                wave.put_component(v, index, component, value);
            }
        }
    }
}

/// The level that all lanes of all subgroups name, where one row names it.
///
/// # Safety
/// As [`WordLoads::new`].
pub(super) unsafe fn level(op: &ImageOp, wave: &Wave<'_>) -> Option<usize> {
    if op.lod != LodMode::Lod {
        return Some(0);
    }
    let rows = wave.operands.get(op.rows_before_lod())?;
    // SAFETY: the caller guarantees that the wave is as `Wave` requires, for the operation of
    // `plain`; the first subgroup has a row, which all others share.
    let row = unsafe { rows.first.as_ref() }.filter(|_| rows.step_bytes == 0)?;
    (row.iter().all(|&level| level == row[0])).then_some(row[0] as usize)
}

/// The axes of a level as an operation has coordinates for them, and how many these are.
pub(super) fn axes(
    op: &ImageOp,
    image: &ImageDescriptor,
    info: &FormatInfo,
    level: usize,
) -> ([ImageAxis; 4], usize) {
    let level = &image.levels[level];
    let (slices, slice_bytes) = match op.dim {
        Dim::Cube => (image.layer_count, image.layer_stride_bytes),
        _ => (level.depth, level.slice_stride_bytes),
    };
    let sizes = [level.width, level.height, slices];
    let strides = [info.size_bytes as u64, level.row_stride_bytes, slice_bytes];
    let spatial = op.spatial_count();
    let count = op.coordinate_count();
    let axis = |operand: usize| match operand < spatial {
        true => ImageAxis {
            operand,
            size: sizes[operand.min(2)],
            stride_bytes: strides[operand.min(2)] as u32,
        },
        false => ImageAxis {
            operand,
            size: image.layer_count,
            stride_bytes: image.layer_stride_bytes as u32,
        },
    };
    ([0, 1, 2, 3].map(axis), count.min(4))
}
