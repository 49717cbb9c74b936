//! Ray tracing validation, the driver's own: valid usage that only execution can see, reported by
//! its name in the specification.
//!
//! It is on with the feature `rayTracingValidation` (`VK_NV_ray_tracing_validation`) or with
//! `TUFF_VALIDATE=1`. Where it is off there is no [`Validator`], and what executes looks at one
//! `Option` per dispatch, call or ray.
//!
//! ```text
//! rules     the table: each rule, its name by command, what must hold
//! registry  which buffers and structures are alive
//! tables    binding tables, the launch's size, parameters in memory: before a dispatch
//! rays      operands of trace instructions and ray queries, and the structures that they name
//! calls     the records that are met, recursion, the stack
//! builds    what builds of structures read
//! micromaps what builds of micromaps read, and what geometries say of theirs
//! ```
//!
//! A rule that is broken is reported once for each place where that happens, when the command is
//! complete, with how often it happened.

mod builds;
mod calls;
mod micromaps;
mod rays;
mod registry;
mod rules;
mod tables;

use std::collections::BTreeMap;
use std::ffi::CString;
use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;

use crate::object::messenger::Messengers;

pub use calls::{Lookup, Need};
pub use rays::{Instruction, Queried, Traced};
pub use registry::Registry;
pub use rules::{Caller, Rule};
pub use tables::invocations;

/// The validation of a device.
pub struct Validator {
    messengers: Arc<Messengers>,
    pub registry: Registry,
    /// How often each rule was broken at each place.
    counts: Mutex<BTreeMap<Site, u64>>,
}

/// A rule, and where it was broken: a number that the rule's check gives its places.
type Site = (Rule, Caller, u64);

impl Validator {
    /// One that has seen nothing yet.
    pub fn new(messengers: Arc<Messengers>) -> Self {
        Self {
            messengers,
            registry: Registry::default(),
            counts: Mutex::default(),
        }
    }

    /// Looks at one command.
    pub fn command(self: &Arc<Self>, caller: Caller) -> Checks {
        Checks {
            validator: Arc::clone(self),
            caller,
            found: Mutex::default(),
        }
    }

    /// Sends a message to debug messengers, or to standard error if there are none.
    fn send(&self, name: &str, message: &str) {
        let id = CString::new(name).unwrap_or_default();
        let heard = self.messengers.send(
            vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION,
            &id,
            message,
        );
        if !heard {
            eprintln!("tuff: {message}");
        }
    }
}

/// The broken rules of one command's execution.
pub struct Checks {
    pub validator: Arc<Validator>,
    caller: Caller,
    found: Mutex<BTreeMap<(Rule, u64), Found>>,
}

struct Found {
    count: u64,
    /// The details of the first occurrence.
    detail: String,
}

impl Checks {
    /// A rule was broken at a place.
    #[cold]
    pub fn broken(&self, rule: Rule, place: u64, detail: impl FnOnce() -> String) {
        self.broken_times(rule, place, 1, detail);
    }

    /// As [`Self::broken`], more than once.
    #[cold]
    pub fn broken_times(
        &self,
        rule: Rule,
        place: u64,
        count: u64,
        detail: impl FnOnce() -> String,
    ) {
        let mut found = self.found.lock();
        let found = found.entry((rule, place)).or_insert_with(|| Found {
            count: 0,
            detail: detail(),
        });
        found.count += count;
    }

    /// As [`Self::broken`] unless something holds.
    pub fn require(&self, holds: bool, rule: Rule, place: u64, detail: impl FnOnce() -> String) {
        if !holds {
            self.broken(rule, place, detail);
        }
    }
}

impl Drop for Checks {
    /// Reports new findings.
    fn drop(&mut self) {
        for ((rule, place), found) in std::mem::take(self.found.get_mut()) {
            let Some(name) = rule.vuid(self.caller) else {
                continue;
            };
            let site = (rule, self.caller, place);
            let mut counts = self.validator.counts.lock();
            let total = counts.entry(site).or_insert(0);
            let is_new = *total == 0;
            *total += found.count;
            drop(counts);
            if is_new {
                let Found { count, detail } = found;
                let how_often = match count {
                    1 => "once".to_owned(),
                    _ => format!("{count} times"),
                };
                let text = rule.text();
                self.validator.send(
                    &name,
                    &format!("{name}: must hold: {text}. Broken {how_often}: {detail}"),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_reported_once_and_counted() {
        let validator = Arc::new(Validator::new(Arc::default()));
        for _ in 0..2 {
            let checks = validator.command(Caller::TraceRays);
            checks.broken(Rule::TraceNan, 3, || "first".into());
            checks.broken(Rule::TraceNan, 3, || unreachable!("not the first"));
            checks.broken(Rule::TraceNan, 4, || "elsewhere".into());
            // Not a rule of this command.
            checks.broken(Rule::IndirectSize, 0, String::new);
        }
        let counts = validator.counts.lock();
        let all: Vec<_> = counts.iter().map(|(site, count)| (*site, *count)).collect();
        let site = |place| (Rule::TraceNan, Caller::TraceRays, place);
        assert_eq!(all, [(site(3), 4), (site(4), 2)]);
    }
}
