//! Instruction sets, chosen at run time. The processor is asked here and nowhere else, and one
//! limit binds all that compute.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

/// An instruction set to compute with. The results are the same bits in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// The baseline that every machine has.
    Portable,
    Avx2,
    /// AVX-512 with what came with it on servers: F, VL, DQ and BW.
    Avx512,
}

/// The best tier that may be used.
static LIMIT: AtomicU8 = AtomicU8::new(Tier::Avx512 as u8);

/// Whether permutes look bytes up in tables of 256 (AVX-512 VBMI): not all processors with
/// [`Tier::Avx512`] have them. The results are the same with and without them.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn has_byte_permutes() -> bool {
    is_x86_feature_detected!("avx512vbmi")
}

/// Whether the processor adds and multiplies 16-bit floats (AVX-512 FP16): not all processors with
/// [`Tier::Avx512`] do. The results are the same with and without.
#[inline]
pub fn has_half_arithmetic() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx512fp16")
    }
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Whether the processor counts bits in lanes, and zeros above the highest one (AVX-512 VPOPCNTDQ
/// and CD): not all processors with [`Tier::Avx512`] do. The results are the same with and without.
#[inline]
pub fn has_bit_counts() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx512vpopcntdq") && is_x86_feature_detected!("avx512cd")
    }
    #[cfg(not(target_arch = "x86_64"))]
    false
}

impl Tier {
    /// All tiers, the best last.
    pub const ALL: [Tier; 3] = [Tier::Portable, Tier::Avx2, Tier::Avx512];

    /// Tiers that this machine has, the best last.
    pub fn available() -> &'static [Tier] {
        static AVAILABLE: OnceLock<usize> = OnceLock::new();
        let count = AVAILABLE.get_or_init(|| {
            #[cfg(target_arch = "x86_64")]
            {
                let avx2 = is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
                    && is_x86_feature_detected!("f16c");
                let avx512 = avx2
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw");
                1 + usize::from(avx2) + usize::from(avx512)
            }
            #[cfg(not(target_arch = "x86_64"))]
            1
        });
        &Tier::ALL[..*count]
    }

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        Tier::available().contains(&self)
    }

    /// Lets everything from now on (programs, samplers, copies of texels, builds, walkers that ask
    /// for the best) use no better tier than this.
    pub fn limit(self) {
        LIMIT.store(self as u8, Ordering::Relaxed);
    }

    /// The best that is available, up to what [`Self::limit`] says. Cheap enough to be asked for
    /// each sample.
    #[inline]
    pub fn best() -> Tier {
        let limit = usize::from(LIMIT.load(Ordering::Relaxed));
        let available = Tier::available();
        available[limit.min(available.len() - 1)]
    }

    /// The vector instructions, as processors' manuals name them.
    pub fn instruction_set(self) -> &'static str {
        match self {
            Tier::Avx512 => "AVX-512",
            Tier::Avx2 => "AVX2",
            Tier::Portable if cfg!(target_arch = "x86_64") => "SSE2",
            Tier::Portable if cfg!(target_arch = "aarch64") => "NEON",
            Tier::Portable => "scalar",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Tier::Portable => "portable",
            Tier::Avx2 => "avx2",
            Tier::Avx512 => "avx512",
        }
    }
}

/// As people type it.
impl fmt::Display for Tier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Tier {
    type Err = String;

    fn from_str(text: &str) -> Result<Tier, String> {
        let found = Tier::ALL.into_iter().find(|tier| tier.name() == text);
        found.ok_or_else(|| format!("\"{text}\" is not one of portable, avx2, avx512"))
    }
}
