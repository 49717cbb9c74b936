//! Instruction sets, chosen at run time.

#![forbid(unsafe_code)]

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

/// The tiers by name, to choose one at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TierKind {
    Portable,
    Avx2,
    Avx512,
}

/// The best tier that may be used: a [`TierKind`].
static LIMIT: AtomicU8 = AtomicU8::new(TierKind::Avx512 as u8);

/// The names of the tiers, for those who want no better one than this: [`limit`].
pub const NAMES: [&str; 3] = ["portable", "avx2", "avx512"];

/// Lets everything from now on (programs, samplers, copies of texels) use no better tier than the one of this name. Returns whether
/// there is such a name.
pub fn limit(name: &str) -> bool {
    let tiers = [TierKind::Portable, TierKind::Avx2, TierKind::Avx512];
    let named = NAMES.iter().zip(tiers).find(|(known, _)| **known == name);
    if let Some((_, tier)) = named {
        LIMIT.store(tier as u8, Ordering::Relaxed);
    }
    named.is_some()
}

/// Whether permutes look bytes up in tables of 256 (AVX-512 VBMI): not all processors with [`TierKind::Avx512`] have them. The results are the
/// same with and without them.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn has_byte_permutes() -> bool {
    is_x86_feature_detected!("avx512vbmi")
}

impl TierKind {
    /// Tiers that this machine has, the best last.
    pub fn present() -> &'static [TierKind] {
        static PRESENT: OnceLock<Vec<TierKind>> = OnceLock::new();
        PRESENT.get_or_init(|| {
            #[allow(unused_mut)]
            let mut tiers = vec![TierKind::Portable];
            #[cfg(target_arch = "x86_64")]
            {
                let avx2 = is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
                    && is_x86_feature_detected!("f16c");
                if avx2 {
                    tiers.push(TierKind::Avx2);
                }
                if avx2
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                {
                    tiers.push(TierKind::Avx512);
                }
            }
            tiers
        })
    }

    /// The best that is present, up to what [`limit`] says. Cheap enough to be asked for each sample.
    #[inline]
    pub fn best() -> TierKind {
        static BEST: OnceLock<TierKind> = OnceLock::new();
        let best = *BEST.get_or_init(|| {
            let present = TierKind::present().iter();
            present.max().copied().unwrap_or(TierKind::Portable)
        });
        let limit = LIMIT.load(Ordering::Relaxed);
        match best as u8 <= limit {
            true => best,
            false if limit == TierKind::Avx2 as u8 => TierKind::Avx2,
            false => TierKind::Portable,
        }
    }

    /// The vector instructions, as processors' manuals name them.
    pub fn instruction_set(self) -> &'static str {
        match self {
            TierKind::Avx512 => "AVX-512",
            TierKind::Avx2 => "AVX2",
            TierKind::Portable if cfg!(target_arch = "x86_64") => "SSE2",
            TierKind::Portable if cfg!(target_arch = "aarch64") => "NEON",
            TierKind::Portable => "scalar",
        }
    }
}
