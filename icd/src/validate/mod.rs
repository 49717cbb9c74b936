//! The driver's ray tracing validation: valid usage that only execution can check, reported by its
//! VUID.
//!
//! The feature `rayTracingValidation` (`VK_NV_ray_tracing_validation`) or `TUFF_VALIDATE=1` enables
//! it. Otherwise there is no [`Validator`], and execution tests one `Option` per dispatch, call or
//! ray.
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
//! A broken rule is reported once for each place, with the number of occurrences, when the command
//! is complete.

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

pub use rays::{Queried, Traced};
pub use registry::Registry;
pub use rules::{Caller, Rule};
pub use tables::invocations;

/// The validation of a device.
pub struct Validator {
    messengers: Arc<Messengers>,
    pub registry: Registry,
    /// The number of violations of each rule at each place.
    counts: Mutex<BTreeMap<Site, u64>>,
}

/// A rule and the place of its violation: a number that the rule's check chooses.
type Site = (Rule, Caller, u64);

impl Validator {
    /// Creates a validator without findings.
    pub fn new(messengers: Arc<Messengers>) -> Self {
        Self {
            messengers,
            registry: Registry::default(),
            counts: Mutex::default(),
        }
    }

    /// Starts the checks of one command.
    pub fn command(self: &Arc<Self>, caller: Caller) -> Checks {
        Checks {
            validator: Arc::clone(self),
            caller,
            found: Mutex::default(),
        }
    }

    /// Sends a message to the debug messengers, or to standard error if there are none.
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

/// The violations of one command's execution.
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
    /// Records a violation of a rule at a place.
    #[cold]
    pub fn broken(&self, rule: Rule, place: u64, detail: impl FnOnce() -> String) {
        self.broken_times(rule, place, 1, detail);
    }

    /// Records several violations.
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

    /// Records a violation unless `holds`.
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
            // The command does not have this rule.
            checks.broken(Rule::IndirectSize, 0, String::new);
        }
        let counts = validator.counts.lock();
        let all: Vec<_> = counts.iter().map(|(site, count)| (*site, *count)).collect();
        let site = |place| (Rule::TraceNan, Caller::TraceRays, place);
        assert_eq!(all, [(site(3), 4), (site(4), 2)]);
    }
}
