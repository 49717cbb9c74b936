//! 16-bit floats as vectors compute them: widened to f32 when a row is read, one operation of f32,
//! and rounded when the result's row is written ([`Float`] says why that is one rounding). The
//! processor's conversions do it (F16C, which every tier but the portable one has): like `eval`
//! they keep denormals, round to nearest even and make NaNs quiet.

use half::f16;

use super::lane::Block;
use crate::eval::Float;
use crate::interp::tier::{Portable, Tier};

/// How a tier computes 16-bit floats.
pub(super) trait Halves: Tier {
    type Half: Block + Float;
}

impl Halves for Portable {
    type Half = f16;
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Float, Halves};
    use crate::SUBGROUP_SIZE;
    use crate::eval::narrow;
    use crate::half_vectors::{self, Words};
    use crate::interp::kernels::lane::Block;
    use crate::interp::tier::{Avx2, Avx512};

    impl Halves for Avx2 {
        type Half = Half<256>;
    }

    impl Halves for Avx512 {
        type Half = Half<512>;
    }

    /// A 16-bit float in an f32, or the result of one operation on such, not yet rounded: no second
    /// operation takes it. `BITS` is the width of the registers.
    #[derive(Clone, Copy, Debug)]
    pub struct Half<const BITS: usize>(f32);

    impl<const BITS: usize> Block for Half<BITS> {
        type Slot = u32;
        type Held = f32;
        #[inline(always)]
        unsafe fn load(from: *const Words) -> [f32; SUBGROUP_SIZE] {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                match BITS {
                    512 => half_vectors::widen_avx512(from),
                    _ => half_vectors::widen_avx2(from),
                }
            }
        }
        #[inline(always)]
        unsafe fn store(held: [f32; SUBGROUP_SIZE], to: *mut Words) {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                match BITS {
                    512 => half_vectors::narrow_avx512(&held, to),
                    _ => half_vectors::narrow_avx2(&held, to),
                }
            }
        }
        #[inline(always)]
        fn of(held: f32) -> Self {
            Half(held)
        }
        #[inline(always)]
        fn held(self) -> f32 {
            self.0
        }
    }

    impl<const BITS: usize> Float for Half<BITS> {
        type Bits = u32;
        type Native = f32;
        #[inline(always)]
        fn bits(self) -> u32 {
            self.0.to_bits()
        }
        #[inline(always)]
        fn from_bits(bits: u32) -> Self {
            Half(f32::from_bits(bits))
        }
        #[inline(always)]
        fn widen(self) -> f32 {
            self.0
        }
        #[inline(always)]
        fn narrow(value: f32) -> Self {
            Half(value)
        }
        #[inline(always)]
        fn fma(self, b: Self, c: Self) -> Self {
            Half(narrow::odd_fma(self.0, b.0, c.0))
        }
        #[inline(always)]
        fn to_f64(self) -> f64 {
            self.0 as f64
        }
        #[inline(always)]
        fn from_f64(value: f64) -> Self {
            Half(narrow::odd_f32_from_f64(value))
        }
        #[inline(always)]
        fn from_f32(value: f32) -> Self {
            Half(value)
        }
    }
}
