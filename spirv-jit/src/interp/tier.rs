//! Instruction sets, chosen at run time. A kernel is written once and instantiated in each; the results are the same bits.

use std::sync::OnceLock;

use super::machine::{Handler, Instr, Machine};

/// Something that performs an instruction; its `run` is inlined into a shell that has the tier's target features.
pub(super) trait Kernel {
    /// # Safety
    /// The instruction was emitted for this kernel, and the machine runs its program.
    unsafe fn run(machine: &mut Machine<'_>, instr: &Instr);
}

/// A set of target features.
pub(super) trait Tier: 'static {
    /// The kernel, compiled for this tier.
    fn handler<K: Kernel>() -> Handler;
}

macro_rules! tier {
    ($(#[$doc:meta])* $name:ident $(, $features:literal)?) => {
        $(#[$doc])*
        pub(super) struct $name;

        impl Tier for $name {
            fn handler<K: Kernel>() -> Handler {
                $(#[target_feature(enable = $features)])?
                unsafe fn shell<K: Kernel>(machine: &mut Machine<'_>, instr: &Instr) {
                    // SAFETY: as the caller promises.
                    unsafe { K::run(machine, instr) }
                }
                shell::<K>
            }
        }
    };
}

tier! {
    /// Whatever the target has by default.
    Portable
}
#[cfg(target_arch = "x86_64")]
tier! {
    Avx2, "avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c"
}
#[cfg(target_arch = "x86_64")]
tier! {
    Avx512, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c"
}

/// The tiers by name, to choose one at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TierKind {
    Portable,
    Avx2,
    Avx512,
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

    pub fn best() -> TierKind {
        TierKind::present()[TierKind::present().len() - 1]
    }
}
