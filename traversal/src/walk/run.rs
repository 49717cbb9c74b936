//! Runs walks in the instruction set of their walker.

#[cfg(target_arch = "x86_64")]
use lanes::Tier;

use super::kernel::Kernel;
use super::level::Entered;
use super::meter::{Meter, Unmetered};
use super::portable::PortableKernel;
use super::{Event, Verdict, Walk, WalkState, Walker, descend};

/// Runs a walk until something has to be decided outside. What the walk before entered may be in
/// `entered`.
pub(crate) fn run(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
) -> Event {
    match walker.options.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a walker has this tier only on machines that have the instruction set.
        Tier::Avx512 => unsafe { run_avx512(walk, verdict, walker, entered, fuel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a walker has this tier only on machines that have the instruction set.
        Tier::Avx2 => unsafe { run_avx2(walk, verdict, walker, entered, fuel) },
        // SAFETY: every machine has plain Rust.
        _ => unsafe { run_with::<PortableKernel>(walk, verdict, walker, entered, fuel) },
    }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_avx512(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
) -> Event {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { run_with::<super::avx::Avx<true>>(walk, verdict, walker, entered, fuel) }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn run_avx2(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
) -> Event {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { run_with::<super::avx::Avx<false>>(walk, verdict, walker, entered, fuel) }
}

/// [`run`] with a meter.
pub(crate) fn run_metered<M: Meter>(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
    meter: &mut M,
) -> Event {
    match walker.options.tier {
        // One kernel for both: reports are no reason for more code.
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a walker has these tiers only on machines that have AVX2.
        Tier::Avx512 | Tier::Avx2 => unsafe {
            run_metered_avx2(walk, verdict, walker, entered, fuel, meter)
        },
        // SAFETY: every machine has plain Rust.
        _ => unsafe { run_all::<PortableKernel, M>(walk, verdict, walker, entered, fuel, meter) },
    }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn run_metered_avx2<M: Meter>(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
    meter: &mut M,
) -> Event {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { run_all::<super::avx::Avx<false>, M>(walk, verdict, walker, entered, fuel, meter) }
}

/// [`run`] with a kernel.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
pub(crate) unsafe fn run_with<K: Kernel>(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
) -> Event {
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    unsafe { run_all::<K, _>(walk, verdict, walker, entered, fuel, &mut Unmetered) }
}

/// [`run`] with a kernel and a meter.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn run_all<K: Kernel, M: Meter>(
    walk: &mut Walk,
    verdict: Verdict,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
    meter: &mut M,
) -> Event {
    if walk.is_over(verdict) {
        walk.state = WalkState::Done;
        return Event::Done;
    }
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    let event = unsafe {
        if walk.terminates_on_first_hit() {
            descend::run::<K, M, true>(walk, walker, entered, fuel, meter)
        } else {
            descend::run::<K, M, false>(walk, walker, entered, fuel, meter)
        }
    };
    walk.state = WalkState::after(event);
    event
}
