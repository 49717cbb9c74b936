//! The common samples, loads and stores, compiled for each tier: one call for all subgroups of a
//! wave that share an image.

use lanes::vector::{Portable, Vector};
use lanes::{LANES, LaneMask, Row, quad};

use super::ImageOp;
use super::chunk::SUBGROUPS;
use super::fast::{self, Fast};
use super::loads;
use super::operands::Operands;
use super::plain::Plain;
pub(super) use super::rows::of_one;
pub use super::rows::{MAX_OPERANDS, Rows, Wave};
use super::stores::Stores;

lanes::vectors! {
    /// Samples of subgroups each of which has lanes that sample.
    ///
    /// # Safety
    /// The wave is as [`Wave`] says, for the operation of `fast`; the image's memory stays
    /// allocated during the call.
    pub unsafe fn sample<V>(v, fast: &Fast<'_>, wave: &Wave<'_>) {
        // SAFETY: the caller guarantees that the wave is as `Wave` requires, for the operation of
        // `fast`; the image's memory stays allocated during the call.
        unsafe {
            // The constant alone decides: where it is false, nothing behind it is compiled.
            if V::IS_MACHINES && fast.is_of_steps::<V>() {
                for subgroups in wave.subgroups.chunks(SUBGROUPS) {
                    let rest = fast.steps(v, &Wave { subgroups, ..*wave });
                    let (mut left, mut count) = ([0; SUBGROUPS], 0);
                    for (index, &subgroup) in subgroups.iter().enumerate() {
                        if rest >> index & 1 == 1 {
                            left[count] = subgroup;
                            count += 1;
                        }
                    }
                    if count != 0 {
                        let subgroups = &left[..count];
                        sample_each(v, fast, &Wave { subgroups, ..*wave });
                    }
                }
                return;
            }
            sample_each(v, fast, wave);
        }
    }
}

/// Samples of subgroups, one by one.
///
/// # Safety
/// As [`sample`].
#[inline(always)]
unsafe fn sample_each<V: Vector>(v: V, fast: &Fast<'_>, wave: &Wave<'_>) {
    // SAFETY: the caller keeps the contract of `sample`.
    unsafe {
        if fast.is_of_planes::<V>() {
            return fast.planes(v, wave);
        }
        for index in 0..wave.subgroups.len() {
            let values = whole(v, fast, wave, index);
            wave.put_numbers(v, index, values);
        }
    }
}

/// The operand rows of a subgroup.
///
/// # Safety
/// As [`Wave::mask`].
#[inline(always)]
unsafe fn rows<'w>(wave: &'w Wave<'_>, index: usize) -> ([&'w Row; MAX_OPERANDS], usize) {
    let count = wave.operands.len().min(MAX_OPERANDS);
    let mut rows = [&[0; LANES]; MAX_OPERANDS];
    for (operand, row) in rows.iter_mut().enumerate().take(count) {
        // SAFETY: the caller keeps the contract of `Wave::mask`.
        *row = unsafe { wave.operand(index, operand) };
    }
    (rows, count)
}

/// # Safety
/// As [`sample`].
#[inline(always)]
unsafe fn whole<V: Vector>(
    v: V,
    fast: &Fast<'_>,
    wave: &Wave<'_>,
    index: usize,
) -> fast::Components<V> {
    // SAFETY: the caller keeps the contract of `sample`.
    unsafe {
        let mask = wave.mask(index);
        let (mut rows, count) = rows(wave, index);
        let derived;
        if wave.derives && fast.takes_derivatives() {
            derived = derivatives(v, fast.op(), &rows, mask);
            put_derivatives(fast.op(), &derived, &mut rows);
        }
        fast.whole(v, &Operands::new(fast.op(), &rows[..count]), mask)
    }
}

/// The derivatives of a sample's coordinates, of which it has one to three: in x, then in y.
#[inline(always)]
fn derivatives<V: Vector>(v: V, op: &ImageOp, rows: &[&Row], active: u16) -> [Row; 6] {
    let spatial = op.spatial_count().min(3);
    let mut derived = [[0; LANES]; 6];
    for axis in 0..spatial {
        let coordinate = v.load(rows[axis]);
        v.store(
            v.derivative::<{ quad::X }>(coordinate, active),
            &mut derived[axis],
        );
        let y = v.derivative::<{ quad::Y }>(coordinate, active);
        v.store(y, &mut derived[spatial + axis]);
    }
    derived
}

/// The derivatives of a sample's coordinates where no tier is chosen: the first operand rows are
/// the coordinates.
pub fn derivatives_of(op: &ImageOp, rows: &[&Row], active: LaneMask) -> [Row; 6] {
    derivatives(Portable, op, rows, active.bits())
}

/// Puts derivatives in the place of their operands.
#[inline(always)]
pub fn put_derivatives<'r>(op: &ImageOp, derived: &'r [Row; 6], rows: &mut [&'r Row]) {
    let places = &mut rows[op.rows_before_lod()..];
    for (place, row) in places.iter_mut().zip(derived).take(2 * op.spatial_count()) {
        *place = row;
    }
}

lanes::vectors! {
    /// Loads of subgroups one after the other, up to the first that [`Plain`] is not for: the
    /// number of those before it. Subgroups without lanes are passed over.
    ///
    /// # Safety
    /// As [`sample`].
    pub unsafe fn load<V>(v, plain: &Plain<'_>, wave: &Wave<'_>) -> usize {
        // SAFETY: the caller keeps the contract of `sample`.
        unsafe { loads::load(v, plain, wave) }
    }
}

lanes::vectors! {
    /// As [`load`], stores.
    ///
    /// # Safety
    /// As there.
    pub unsafe fn store<V>(v, plain: &Plain<'_>, wave: &Wave<'_>) -> usize {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if let Some(stores) = Stores::new(plain, wave) {
                stores.store(v, wave);
                return wave.subgroups.len();
            }
            for index in 0..wave.subgroups.len() {
                let mask = wave.mask(index);
                let (rows, count) = rows(wave, index);
                let operands = Operands::new(plain.op(), &rows[..count]);
                if mask != 0 && !plain.write(v, &operands, mask) {
                    return index;
                }
            }
        }
        wave.subgroups.len()
    }
}
