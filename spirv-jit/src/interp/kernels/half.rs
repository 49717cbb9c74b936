//! Conversions of 16-bit floats by the instructions that processors with AVX2 have for them. Like
//! `eval` they keep denormals and make NaNs quiet.

use std::arch::x86_64::*;

use lanes::Tier as TierKind;

use super::lane::Blocks;
use crate::SUBGROUP_SIZE;
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Avx2, Avx512, Kernel, Tier};

/// The kernel of `fconvert` from f16 to f32 in a tier that is not the portable one.
pub(super) fn widen(tier: TierKind) -> Handler {
    match tier {
        TierKind::Avx512 => Avx512::handler::<Widen>(),
        _ => Avx2::handler::<Widen>(),
    }
}

struct Widen;

impl Kernel for Widen {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: rows are the program's; a block is read before it is written, so that in-place is
        // sound. Only tiers with AVX2 and F16C have this kernel.
        unsafe {
            let (a, d) = (m.row(i.a), m.row(i.d));
            let (runs, count) = m.runs();
            for &subgroup in runs {
                let mut a = Blocks::<u32>::new(a, subgroup);
                let mut d = Blocks::<f32>::new(d, subgroup);
                for _ in 0..count {
                    widen_lanes(a.at, d.at);
                    a.go_on();
                    d.go_on();
                }
            }
        }
    }
}

/// # Safety
/// The processor has AVX2 and F16C; the lanes are there.
#[inline]
#[target_feature(enable = "avx2,f16c")]
unsafe fn widen_lanes(from: *const [u32; SUBGROUP_SIZE], to: *mut [f32; SUBGROUP_SIZE]) {
    // SAFETY: as the caller promises.
    unsafe {
        let from = from.cast::<__m256i>();
        let (low, high) = (_mm256_loadu_si256(from), _mm256_loadu_si256(from.add(1)));
        // Packed within halves: the middle quarters change places.
        let packed = _mm256_permute4x64_epi64::<0xd8>(_mm256_packus_epi32(low, high));
        let to = to.cast::<f32>();
        _mm256_storeu_ps(to, _mm256_cvtph_ps(_mm256_castsi256_si128(packed)));
        _mm256_storeu_ps(
            to.add(8),
            _mm256_cvtph_ps(_mm256_extracti128_si256::<1>(packed)),
        );
    }
}
