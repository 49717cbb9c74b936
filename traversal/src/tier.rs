//! Instruction sets to build and walk with.
#![forbid(unsafe_code)]

use std::sync::atomic::{AtomicU8, Ordering};

/// An instruction set to walk with. The hits are the same bits in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// What every machine has.
    Portable,
    /// AVX2.
    Avx2,
    /// AVX-512 with 256-bit vectors.
    Avx512,
}

/// The best tier that may be used: a [`Tier`].
static LIMIT: AtomicU8 = AtomicU8::new(Tier::Avx512 as u8);

impl Tier {
    /// All tiers, the fastest last.
    pub const ALL: [Tier; 3] = [Tier::Portable, Tier::Avx2, Tier::Avx512];

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        match self {
            Tier::Portable => true,
            Tier::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("popcnt")
            }
            Tier::Avx512 => {
                Tier::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        return self == Tier::Portable;
    }

    /// Lets builds, and walkers that ask for the best, use no better tier than this from now on.
    pub fn limit(self) {
        LIMIT.store(self as u8, Ordering::Relaxed);
    }

    /// The fastest that this machine has, up to what [`Self::limit`] says.
    pub fn best() -> Tier {
        let limit = LIMIT.load(Ordering::Relaxed);
        let mut allowed = (Tier::ALL.into_iter().rev()).filter(|tier| *tier as u8 <= limit);
        (allowed.find(|tier| tier.is_available())).unwrap_or(Tier::Portable)
    }
}
