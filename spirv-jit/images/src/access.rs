//! Accesses by integer coordinates: fetch, read, write, atomics (spec, "Integer Texel Coordinate
//! Operations", "Texel Input Validation Operations", "Texel Output Operations", "Image Atomics").

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::SeqCst};

use lanes::{LANES, Row};

use super::format::FormatInfo;
use super::format::block::{self, Offsets, each_lane};
use super::operands::{Operands, read_64};
use super::{AtomicOp, Dim, ImageDescriptor, ImageOp, LodMode, TexelType};

/// Byte offsets of the lanes' texels, and the lanes whose texel exists. Other lanes have the offset
/// of one that does, if there is one.
fn locate(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    mask: u16,
) -> (Offsets, u16) {
    let spatial = op.spatial_count();
    let mut offsets = [0; LANES];
    let mut inside = 0u16;
    let coordinate = |axis: usize, lane: usize| {
        let offset = if op.has_offset && axis < operands.offsets.len() {
            operands.offsets[axis][lane]
        } else {
            0
        };
        operands.coordinates[axis][lane].wrapping_add(offset)
    };
    each_lane(mask, |lane| {
        let level_index = match op.lod {
            LodMode::Lod => operands.lod[0][lane] as usize,
            _ => 0,
        };
        if !image.has_level(level_index) {
            return;
        }
        let level = &image.levels[level_index];
        let x = coordinate(0, lane);
        let (mut y, mut z, mut layer) = (0, 0, 0);
        match op.dim {
            Dim::D1 | Dim::Buffer => {}
            Dim::D2 => y = coordinate(1, lane),
            Dim::D3 => (y, z) = (coordinate(1, lane), coordinate(2, lane)),
            Dim::Cube => (y, layer) = (coordinate(1, lane), coordinate(2, lane)),
        }
        if op.coordinate_count() > spatial {
            layer = operands.coordinates[spatial][lane];
        }
        let sample = match operands.sample {
            // All samples of an attachment with one have its value.
            Some(row) if image.samples > 1 => row[lane],
            _ => 0,
        };
        let is_inside = x < level.width
            && y < level.height
            && z < level.depth
            && layer < image.layer_count
            && sample < image.samples.max(1) as u32;
        if is_inside {
            offsets[lane] = level.offset_bytes
                + layer as u64 * image.layer_stride_bytes
                + sample as u64 * image.sample_stride_bytes
                + z as u64 * level.slice_stride_bytes
                + info.texel_offset(x, y, level.row_stride_bytes);
            inside |= 1 << lane;
        }
    });
    let any = offsets[inside.trailing_zeros() as usize & 15];
    for lane in 0..LANES {
        if inside >> lane & 1 == 0 {
            offsets[lane] = any;
        }
    }
    (offsets, inside)
}

/// `OpImageFetch`, `OpImageRead`.
///
/// # Safety
/// The image's memory stays allocated during the call.
pub(super) unsafe fn read(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    mask: u16,
    results: &mut [Row],
) {
    let (offsets, inside) = locate(op, operands, image, info, mask);
    if let Some(residency) = operands.residency {
        residency.check(image, info, &offsets, inside);
    }
    if inside == 0 {
        // Nothing to load; missing components are filled below all the same.
        let mut texels = [[0; LANES]; 4];
        block::finish(info, &mut texels);
        super::operands::swizzle(image, info, &mut texels);
        return super::operands::put_texels(op, info, &texels, results);
    }
    if info.is_wide() && info.numeric.is_integer() {
        each_lane(mask, |lane| {
            // SAFETY: a texel inside the image, since some lane is inside.
            let words = unsafe {
                info.decode(std::slice::from_raw_parts(
                    image.data.add(offsets[lane] as usize),
                    info.size_bytes as usize,
                ))
            };
            let value = if inside >> lane & 1 == 1 {
                [words[0], words[1]]
            } else {
                [0; 2]
            };
            let is_wide_result = op.texel == TexelType::I64;
            for row in &mut results[..op.result_rows()] {
                row[lane] = 0;
            }
            results[0][lane] = value[0];
            if is_wide_result {
                results[1][lane] = value[1];
                results[6][lane] = 1;
            } else {
                results[3][lane] = 1;
            }
        });
        return;
    }
    // SAFETY: every lane's offset is that of a texel of the image.
    let mut texels = unsafe { block::load(info, image.data, &offsets) };
    for row in &mut texels {
        for lane in 0..LANES {
            if inside >> lane & 1 == 0 {
                row[lane] = 0;
            }
        }
    }
    block::finish(info, &mut texels);
    super::operands::swizzle(image, info, &mut texels);
    super::operands::put_texels(op, info, &texels, results);
}

/// `OpImageWrite`.
///
/// # Safety
/// The image's memory stays allocated during the call.
pub(super) unsafe fn write(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    mask: u16,
) {
    let (offsets, inside) = locate(op, operands, image, info, mask);
    let rows = operands.texel;
    let is_wide = info.is_wide() && info.numeric.is_integer();
    let texels = match (is_wide, op.texel) {
        // r and g, low and high each.
        (true, TexelType::I64) => [0, 1, 2, 3].map(|i| *rows[i]),
        (true, _) => [*rows[0], [0; LANES], *rows[1], [0; LANES]],
        (false, TexelType::I64) => [0, 2, 4, 6].map(|i| *rows[i]),
        (false, _) => [0, 1, 2, 3].map(|i| *rows[i]),
    };
    // SAFETY: lanes inside address texels of the image.
    unsafe { block::store(info, image.data, &offsets, inside, &texels) };
}

/// `OpAtomic*` on an image texel: the old values.
///
/// # Safety
/// The image's memory stays allocated during the call.
pub(super) unsafe fn atomic(
    op: &ImageOp,
    atomic: AtomicOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    mask: u16,
    results: &mut [Row],
) {
    let (offsets, inside) = locate(op, operands, image, info, mask);
    for row in &mut results[..op.result_rows()] {
        *row = [0; LANES];
    }
    let is_wide = op.texel == TexelType::I64;
    let size = if is_wide { 8 } else { 4 };
    if info.size_bytes as usize != size || info.blocks().is_some() {
        return;
    }
    let operand = |index: usize, lane: usize| -> u64 {
        let rows = operands.texel;
        match is_wide {
            true if rows.len() > 2 * index + 1 => {
                read_64(rows[2 * index], rows[2 * index + 1], lane)
            }
            false if rows.len() > index => rows[index][lane] as u64,
            _ => 0,
        }
    };
    each_lane(inside, |lane| {
        let (value, comparator) = (operand(0, lane), operand(1, lane));
        // SAFETY: a texel inside the image.
        let pointer = unsafe { image.data.add(offsets[lane] as usize) };
        if !(pointer as usize).is_multiple_of(size) {
            return;
        }
        // SAFETY: aligned, inside the image, and shader accesses to it are atomic or the
        // application's race.
        let old = unsafe {
            if is_wide {
                let texel = AtomicU64::from_ptr(pointer.cast());
                atomic_64(texel, atomic, value, comparator)
            } else {
                let texel = AtomicU32::from_ptr(pointer.cast());
                atomic_32(texel, atomic, value as u32, comparator as u32) as u64
            }
        };
        if op.result_rows() > 0 {
            results[0][lane] = old as u32;
        }
        if op.result_rows() > 1 {
            results[1][lane] = (old >> 32) as u32;
        }
    });
}

macro_rules! integer_atomic {
    ($name:ident, $atomic:ty, $unsigned:ty, $signed:ty, $float:expr) => {
        fn $name(
            texel: &$atomic,
            op: AtomicOp,
            value: $unsigned,
            comparator: $unsigned,
        ) -> $unsigned {
            let update = |f: &dyn Fn($unsigned) -> $unsigned| {
                let mut old = texel.load(SeqCst);
                loop {
                    match texel.compare_exchange_weak(old, f(old), SeqCst, SeqCst) {
                        Ok(old) => return old,
                        Err(now) => old = now,
                    }
                }
            };
            match op {
                AtomicOp::Load => texel.load(SeqCst),
                AtomicOp::Store => {
                    texel.store(value, SeqCst);
                    0
                }
                AtomicOp::Exchange => texel.swap(value, SeqCst),
                AtomicOp::CompareExchange => texel
                    .compare_exchange(comparator, value, SeqCst, SeqCst)
                    .unwrap_or_else(|old| old),
                AtomicOp::IAdd => texel.fetch_add(value, SeqCst),
                AtomicOp::ISub => texel.fetch_sub(value, SeqCst),
                AtomicOp::SMin => {
                    update(&|old| (old as $signed).min(value as $signed) as $unsigned)
                }
                AtomicOp::SMax => {
                    update(&|old| (old as $signed).max(value as $signed) as $unsigned)
                }
                AtomicOp::UMin => texel.fetch_min(value, SeqCst),
                AtomicOp::UMax => texel.fetch_max(value, SeqCst),
                AtomicOp::And => texel.fetch_and(value, SeqCst),
                AtomicOp::Or => texel.fetch_or(value, SeqCst),
                AtomicOp::Xor => texel.fetch_xor(value, SeqCst),
                AtomicOp::FAdd
                | AtomicOp::FMin
                | AtomicOp::FMax
                | AtomicOp::FAddFlushed
                | AtomicOp::FMinFlushed
                | AtomicOp::FMaxFlushed => update(&|old| $float(op, old, value)),
            }
        }
    };
}

/// f32 addition, minimum and maximum on bits; a NaN operand of a minimum or maximum gives the
/// other.
fn float_32(op: AtomicOp, old: u32, value: u32) -> u32 {
    if let Some(plain) = op.unflushed() {
        let bits = float_32(plain, old, value);
        let is_denormal = bits & f32::INFINITY.to_bits() == 0;
        return if is_denormal { bits & 1 << 31 } else { bits };
    }
    let (a, b) = (f32::from_bits(old), f32::from_bits(value));
    match op {
        AtomicOp::FAdd => (a + b).to_bits(),
        AtomicOp::FMin if b.is_nan() || a.total_cmp(&b).is_le() && !a.is_nan() => old,
        AtomicOp::FMax if b.is_nan() || a.total_cmp(&b).is_ge() && !a.is_nan() => old,
        _ => value,
    }
}

/// There are no 64-bit float images: the texel stays.
fn float_64(_: AtomicOp, old: u64, _: u64) -> u64 {
    old
}

integer_atomic!(atomic_32, AtomicU32, u32, i32, float_32);
integer_atomic!(atomic_64, AtomicU64, u64, i64, float_64);
