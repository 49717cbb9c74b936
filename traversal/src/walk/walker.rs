//! A thread's working state for the walk that it is running.

use lanes::Tier;

use super::entry::{Entry, STACK};
use super::facts::InstanceFacts;
use super::group_hits::GroupHits;
use super::level::Level;
use super::level_rays::LevelRays;
use super::options::{Accuracy, Options, Specialisation, Switches};
use super::packet::PacketSpace;
#[cfg(target_arch = "x86_64")]
use super::stream::Streams;
use super::suspended::Suspended;
use crate::live::Live;
use crate::ray::Ray;

/// The stack and ray set-up that a thread needs to run walks. Large (some kilobytes), reused for
/// every walk of the thread; holds nothing between calls that a suspended walk needs.
pub struct Walker {
    pub(crate) stack: [Entry; STACK],
    pub(crate) top: Level,
    /// The bottom level that the walk is in, and its instance.
    pub(crate) bottom: Level,
    pub(crate) instance: InstanceFacts,
    pub(crate) hits: GroupHits,
    pub(crate) level_rays: LevelRays,
    pub(crate) packet: PacketSpace,
    #[cfg(target_arch = "x86_64")]
    pub(crate) streams: Streams,
    /// Groups with rays in the stream.
    pub(crate) streamed: Vec<u32>,
    /// Memory of rays that no longer wait.
    pub(crate) spare: Vec<Box<Suspended>>,
    pub(crate) counts: Counts,
    pub(crate) options: Options,
}

/// How rays have walked, for tests that are about one way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Groups that set out as packets.
    pub together: u64,
    /// Of those, the ones that split.
    pub split: u64,
    /// Rays that were added to streams.
    pub streamed: u64,
}

impl Walker {
    /// How rays have walked since the walker was made.
    pub fn counts(&self) -> Counts {
        self.counts
    }

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
        let mut level = Level::EMPTY;
        level.ray.tolerance = options.accuracy.tolerance();
        let mut level_rays = LevelRays::EMPTY;
        level_rays.tolerance = options.accuracy.tolerance();
        options.tier.is_available().then(|| {
            Box::new(Walker {
                stack: [Entry::default(); STACK],
                top: level.clone(),
                bottom: level,
                instance: InstanceFacts::NONE,
                hits: GroupHits::NONE,
                level_rays,
                packet: PacketSpace::EMPTY,
                #[cfg(target_arch = "x86_64")]
                streams: Streams::new(),
                streamed: Vec::new(),
                spare: Vec::new(),
                counts: Counts::default(),
                options,
            })
        })
    }

    /// Sets where the structures may lie that walks meet from here on;
    /// [`EVERYWHERE`](crate::EVERYWHERE) otherwise.
    ///
    /// # Safety
    /// That memory is there as long as walks go on, until another is set.
    pub unsafe fn set_live(&mut self, live: &Live) {
        self.top.set_live(live);
        self.bottom.set_live(live);
    }

    /// The disabled specialisations.
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
