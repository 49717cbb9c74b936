//! The common samples, loads and stores, compiled for each tier: one call for all subgroups of a
//! wave that share an image.

use super::chunk::SUBGROUPS;
pub use super::derivatives::{derivatives_of, put_derivatives};
use super::fast::Fast;
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
            for subgroups in wave.subgroups.chunks(SUBGROUPS) {
                fast.sample(v, &Wave { subgroups, ..*wave });
            }
        }
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
                let (rows, count) = wave.operand_rows(index);
                let operands = Operands::new(plain.op(), &rows[..count]);
                if mask != 0 && !plain.write(v, &operands, mask) {
                    return index;
                }
            }
        }
        wave.subgroups.len()
    }
}
