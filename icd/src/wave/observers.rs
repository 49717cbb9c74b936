//! All observers of one command, as one.

#![forbid(unsafe_code)]

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::reach::Stray;

use super::launch_counts::LaunchCounts;
use super::observer::{
    Interests, Observation, Observer, RecordLookup, ShaderCall, StartedRay, StartedWave,
};

/// The observers of a command. At most one has an invocation, and at most one keeps counts.
pub struct Observers<'a>(SmallVec<[&'a dyn Observer; 4]>);

impl<'a> Observers<'a> {
    /// Those of these that are there.
    pub fn new(all: impl IntoIterator<Item = Option<&'a dyn Observer>>) -> Self {
        Self(all.into_iter().flatten().collect())
    }

    /// All as one; `None` if there are none.
    pub fn all(&self) -> Option<&dyn Observer> {
        match *self.0 {
            [] => None,
            [one] => Some(one),
            _ => Some(self),
        }
    }
}

impl Observer for Observers<'_> {
    fn interests(&self) -> Interests {
        let none = Interests::default();
        self.0.iter().fold(none, |all, observer| {
            let Interests {
                rays,
                lookups,
                waves,
            } = observer.interests();
            Interests {
                rays: all.rays || rays,
                lookups: all.lookups || lookups,
                waves: all.waves || waves,
            }
        })
    }

    fn invocation(&self) -> Option<[u32; 3]> {
        self.0.iter().find_map(|observer| observer.invocation())
    }

    fn observe(&self, event: Observation) {
        let mut all = self.0.iter();
        if let Some(observer) = all.find(|observer| observer.invocation().is_some()) {
            observer.observe(event);
        }
    }

    fn counts(&self) -> Option<&LaunchCounts> {
        self.0.iter().find_map(|observer| observer.counts())
    }

    fn ray(&self, ray: &StartedRay) {
        self.0.iter().for_each(|observer| observer.ray(ray));
    }

    fn hit_kind(&self, place: u64, kind: u32) {
        let tell = |observer: &&dyn Observer| observer.hit_kind(place, kind);
        self.0.iter().for_each(tell);
    }

    fn call(&self, call: &ShaderCall) {
        self.0.iter().for_each(|observer| observer.call(call));
    }

    fn look_up(&self, lookup: &RecordLookup<'_>) {
        self.0.iter().for_each(|observer| observer.look_up(lookup));
    }

    fn wave(&self, wave: &StartedWave) {
        self.0.iter().for_each(|observer| observer.wave(wave));
    }

    fn strays(&self, strays: &[Stray], programs: &[&Program]) {
        let tell = |observer: &&dyn Observer| observer.strays(strays, programs);
        self.0.iter().for_each(tell);
    }
}

#[cfg(test)]
mod tests {
    use parking_lot::Mutex;

    use super::*;

    /// Notes calls that it takes an interest in.
    struct Notes {
        interests: Interests,
        invocation: Option<[u32; 3]>,
        calls: Mutex<Vec<u32>>,
    }

    impl Notes {
        fn new(rays: bool, waves: bool, invocation: Option<[u32; 3]>) -> Self {
            Self {
                interests: Interests {
                    rays,
                    lookups: false,
                    waves,
                },
                invocation,
                calls: Mutex::default(),
            }
        }
    }

    impl Observer for Notes {
        fn interests(&self) -> Interests {
            self.interests
        }

        fn invocation(&self) -> Option<[u32; 3]> {
            self.invocation
        }

        fn observe(&self, _: Observation) {
            self.calls.lock().push(u32::MAX);
        }

        fn hit_kind(&self, _: u64, kind: u32) {
            self.calls.lock().push(kind);
        }
    }

    #[test]
    fn events_come_to_all_and_those_of_an_invocation_to_its_observer() {
        let (checks, statistics) = (Notes::new(true, false, None), Notes::new(false, true, None));
        let capture = Notes::new(false, false, Some([1, 2, 3]));
        let all: [Option<&dyn Observer>; 4] =
            [Some(&checks), None, Some(&statistics), Some(&capture)];
        let observers = Observers::new(all);
        let one = observers.all().expect("there are three");
        assert!(one.interests().rays && one.interests().waves && !one.interests().lookups);
        assert_eq!(one.invocation(), Some([1, 2, 3]));
        one.hit_kind(7, 5);
        one.observe(Observation::QueryOver {
            object: 0,
            hit: None,
        });
        assert_eq!(*checks.calls.lock(), [5]);
        assert_eq!(*capture.calls.lock(), [5, u32::MAX]);
    }

    #[test]
    fn statistics_and_lists_of_addresses_leave_rays_their_lines() {
        assert!(Observers::new([None, None]).all().is_none());
        let statistics = Notes::new(false, true, None);
        let one = Observers::new([Some(&statistics as &dyn Observer), None]);
        assert!(!one.all().expect("there is one").watches_rays());
        let capture = Notes::new(false, false, Some([0; 3]));
        let all = [Some(&statistics as &dyn Observer), Some(&capture)];
        assert!(Observers::new(all).watches_rays());
    }
}
