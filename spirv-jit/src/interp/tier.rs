//! Kernels in instruction sets: written once, instantiated in each; the results are the same bits.

use lanes::Tier as TierKind;

use super::machine::{Handler, Instr, Machine};

/// Something that performs an instruction; its `run` is inlined into a shell that has the tier's
/// target features.
pub(super) trait Kernel {
    /// # Safety
    /// The instruction was emitted for this kernel, and the machine runs its program.
    unsafe fn run(machine: &mut Machine<'_>, instr: &Instr);
}

/// A set of target features.
pub(super) trait Tier: 'static {
    const KIND: TierKind;

    /// The kernel, compiled for this tier.
    fn handler<K: Kernel>() -> Handler;
}

macro_rules! tier {
    ($(#[$doc:meta])* $name:ident $(, $features:literal)?) => {
        $(#[$doc])*
        pub(super) struct $name;

        impl Tier for $name {
            const KIND: TierKind = TierKind::$name;

            fn handler<K: Kernel>() -> Handler {
                $(#[target_feature(enable = $features)])?
                unsafe fn shell<K: Kernel>(machine: &mut Machine<'_>, instr: &Instr) {
                    // SAFETY: the caller keeps the contract of this function.
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
