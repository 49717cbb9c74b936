//! Options of walks that rays and structures do not decide.

use lanes::Tier;

/// How exact distances and weights are. Which triangles are hit is the same in each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Accuracy {
    /// In f32, but in f64 where that would show: see [`Accuracy::tolerance`].
    #[default]
    Spec,
    /// Always in f64, from exact positions, rounded once. Rays walk one by one.
    Exact,
}

impl Accuracy {
    /// How far off a distance may be, relative to itself, as bounds say: where it may be more, it
    /// is computed in f64. See [`rounding`](super::triangle::rounding).
    pub(crate) const fn tolerance(self) -> f32 {
        match self {
            Accuracy::Spec => 128.0 / (1 << 24) as f32,
            Accuracy::Exact => 0.0,
        }
    }
}

/// Shortcuts for scenes that need no more. Each can be disabled to measure its effect; hits stay
/// the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Specialisation {
    /// Coherent rays walk together.
    Packets = 1,
    /// Triangles that all count are tested without flags, opacity and suspension.
    Opaque = 2,
    /// A top level of one instance is not walked.
    OneInstance = 4,
    /// Children are fetched ahead in structures larger than a core's caches.
    Prefetch = 8,
    /// Rays of many lists walk node by node.
    Streams = 16,
}

impl Specialisation {
    /// All, by name.
    pub const ALL: [(&str, Specialisation); 5] = [
        ("packets", Specialisation::Packets),
        ("opaque_path", Specialisation::Opaque),
        ("one_instance", Specialisation::OneInstance),
        ("prefetch", Specialisation::Prefetch),
        ("streams", Specialisation::Streams),
    ];
}

/// A set of specialisations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Switches(u32);

impl Switches {
    #[inline(always)]
    pub fn contains(self, one: Specialisation) -> bool {
        self.0 & one as u32 != 0
    }
}

impl FromIterator<Specialisation> for Switches {
    fn from_iter<I: IntoIterator<Item = Specialisation>>(all: I) -> Switches {
        Switches(all.into_iter().fold(0, |bits, one| bits | one as u32))
    }
}

/// The options of a [`Walker`](super::Walker).
#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub tier: Tier,
    pub accuracy: Accuracy,
    /// Specialisations that are left out.
    pub without: Switches,
    /// Fuel of a group of rays between two looks at whether it may go on, at least 1.
    pub fuel: u64,
}

impl Default for Options {
    /// As fast as the machine allows.
    fn default() -> Options {
        Options {
            tier: Tier::best(),
            accuracy: Accuracy::Spec,
            without: Switches::default(),
            fuel: 1 << 16,
        }
    }
}
