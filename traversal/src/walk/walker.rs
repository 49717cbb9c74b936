//! A thread's working state for the walk that it is running, and the instruction sets there are.

use std::sync::atomic::{AtomicU8, Ordering};

use super::beams::Beams;
use super::facts::InstanceFacts;
use super::kernel::{GroupHits, Kernel, Portable};
use super::level::{Entered, Level};
use super::options::{Accuracy, Options, Specialisation, Switches};
use super::packet::PacketSpace;
#[cfg(target_arch = "x86_64")]
use super::stream::Streams;
use super::{Event, State, Verdict, Walk, descend};
use crate::layout::{MAX_DEPTH, WIDTH};
use crate::live::Live;
use crate::ray::Ray;

/// A child still to be visited: its [`child`] word, and above that the bits of the scaled distance
/// to its box, which is not negative; so entries are in the order of distances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(crate) struct Entry(u64);

impl Entry {
    /// The root, wherever it is entered.
    pub const ROOT: Entry = Entry(0);

    #[inline(always)]
    pub fn new(word: u32, near: f32) -> Entry {
        Entry(u64::from(word) | u64::from(near.to_bits()) << 32)
    }

    /// A [`child`] word.
    #[inline(always)]
    pub fn word(self) -> u32 {
        self.0 as u32
    }

    /// Scaled distance to its box.
    #[inline(always)]
    pub fn near(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// The last of all entries that are not beyond a distance.
    #[inline(always)]
    pub fn last_at(t: f32) -> Entry {
        Entry::new(u32::MAX, t)
    }

    /// The nearer and the farther of two.
    #[inline(always)]
    pub fn ordered(self, other: Entry) -> (Entry, Entry) {
        (self.min(other), self.max(other))
    }
}

/// Each level of a structure leaves seven siblings at most; two structures, and the eight of the
/// node at hand.
pub(crate) const STACK: usize = 2 * MAX_DEPTH as usize * (WIDTH - 1) + WIDTH + 1;

/// What a thread needs to run walks: the stack and the set-up of the ray being walked. Large
/// (some kilobytes), reused for every walk of the thread; holds nothing between calls that a
/// suspended walk needs.
pub struct Walker {
    pub(crate) stack: [Entry; STACK],
    pub(crate) top: Level,
    /// The bottom level that the walk is in, and its instance.
    pub(crate) bottom: Level,
    pub(crate) instance: InstanceFacts,
    pub(crate) hits: GroupHits,
    pub(crate) beams: Beams,
    pub(crate) packet: PacketSpace,
    #[cfg(target_arch = "x86_64")]
    pub(crate) streams: Streams,
    pub(crate) options: Options,
}

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
            }
            Tier::Avx512 => {
                Tier::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("popcnt")
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

impl Walker {
    /// A walker for one thread, as fast as the machine allows.
    pub fn new() -> Box<Walker> {
        Walker::with(Options::default()).expect("the best tier is available")
    }

    /// A walker with a certain instruction set; `None` if the machine does not have it.
    pub fn with_tier(tier: Tier) -> Option<Box<Walker>> {
        Walker::with(Options {
            tier,
            ..Options::default()
        })
    }

    /// A walker as described; `None` if the machine does not have its instruction set.
    pub fn with(options: Options) -> Option<Box<Walker>> {
        let mut level = Level::NOWHERE;
        level.space.tolerance = options.accuracy.tolerance();
        let mut beams = Beams::NOWHERE;
        beams.tolerance = options.accuracy.tolerance();
        options.tier.is_available().then(|| {
            Box::new(Walker {
                stack: [Entry::default(); STACK],
                top: level.clone(),
                bottom: level,
                instance: InstanceFacts::NONE,
                hits: GroupHits::NONE,
                beams,
                packet: PacketSpace::EMPTY,
                #[cfg(target_arch = "x86_64")]
                streams: Streams::new(),
                options,
            })
        })
    }

    /// Sets where the structures may lie that walks meet from here on; [`EVERYWHERE`](crate::EVERYWHERE) otherwise.
    ///
    /// # Safety
    /// That memory is there as long as walks go on, until another is set.
    pub unsafe fn set_live(&mut self, live: &Live) {
        self.top.set_live(live);
        self.bottom.set_live(live);
    }

    /// What is left out.
    #[inline(always)]
    pub(crate) fn without(&self) -> Switches {
        self.options.without
    }

    /// Whether rays may walk together: packets have one accuracy.
    pub(crate) fn takes_packets(&self) -> bool {
        self.options.accuracy == Accuracy::Spec && !self.without().contains(Specialisation::Packets)
    }
}

/// Whether a ray can hit anything.
pub(crate) fn is_sound(ray: &Ray) -> bool {
    let most = (ray.origin.iter().chain(&ray.direction))
        .fold(0, |most, c| most.max(c.to_bits() & 0x7FFF_FFFF));
    f32::from_bits(most).is_finite() & (ray.t_min <= ray.t_max)
}

/// Runs a walk until something has to be decided outside. What the walk before entered may be in `entered`.
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
        // SAFETY: likewise.
        Tier::Avx2 => unsafe { run_avx2(walk, verdict, walker, entered, fuel) },
        // SAFETY: every machine has plain Rust.
        _ => unsafe { run_with::<Portable>(walk, verdict, walker, entered, fuel) },
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
    // SAFETY: the caller's promise.
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
    // SAFETY: the caller's promise.
    unsafe { run_with::<super::avx::Avx<false>>(walk, verdict, walker, entered, fuel) }
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
    if walk.is_over(verdict) {
        walk.state = State::Done;
        return Event::Done;
    }
    // SAFETY: the caller's promise.
    let event = unsafe {
        if walk.terminates_on_first_hit() {
            descend::run::<K, true>(walk, walker, entered, fuel)
        } else {
            descend::run::<K, false>(walk, walker, entered, fuel)
        }
    };
    walk.state = State::after(event);
    event
}
