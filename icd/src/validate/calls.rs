//! Checks of the records that a dispatch uses, and of its call depth.
#![forbid(unsafe_code)]

use ash::vk;

use super::{Rule, Traced};
use crate::wave::table::{Group, GroupKind, HANDLE_SIZE, Handle, Region};

/// The purpose of a record look-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    AnyHit,
    ClosestHit,
    Intersection,
    Miss,
    Callable,
}

/// A record that is looked up.
pub struct Lookup<'a> {
    pub need: Need,
    pub region: &'a Region,
    pub index: u32,
    /// The record, if the index is in the table.
    pub record: Option<(Handle, Option<&'a Group>)>,
    /// Whether a hit is on a box. Spheres count as triangles.
    pub is_box: bool,
}

impl Traced {
    /// Checks a record that is used.
    pub fn lookup(&self, lookup: &Lookup<'_>) {
        let Lookup {
            need,
            region,
            index,
            ..
        } = *lookup;
        let detail = || {
            format!(
                "record {index} for {need:?}, in the table at {:#x}",
                region.address
            )
        };
        let place = region
            .address
            .wrapping_add(u64::from(index).wrapping_mul(region.stride_bytes));
        let is_zero = lookup
            .record
            .is_none_or(|(handle, _)| handle == [0; HANDLE_SIZE]);
        if let Some(rule) = self.forbids_null(need) {
            self.checks.require(!is_zero, rule, place, detail);
        }
        let Some((_, group)) = lookup.record else {
            let is_there = region.address == 0 || region.size_bytes == 0;
            return self
                .checks
                .require(is_there, Rule::RecordRange, place, detail);
        };
        if is_zero {
            return;
        }
        let Some(group) = group else {
            return self.checks.broken(Rule::ForeignHandle, place, detail);
        };
        match (need, group.kind) {
            (Need::Miss | Need::Callable, _) => {}
            (_, kind) if lookup.is_box => {
                let right = kind == GroupKind::Procedural;
                self.checks
                    .require(right, Rule::GroupOfBoxes, place, detail);
            }
            (_, kind) => {
                let right = kind == GroupKind::Triangles;
                self.checks
                    .require(right, Rule::GroupOfTriangles, place, detail);
            }
        }
    }

    /// The rule by which the pipeline excludes null records.
    fn forbids_null(&self, need: Need) -> Option<Rule> {
        use vk::PipelineCreateFlags as Flags;
        let (flag, rule) = match need {
            Need::AnyHit => (
                Flags::RAY_TRACING_NO_NULL_ANY_HIT_SHADERS_KHR,
                Rule::NullAnyHit,
            ),
            Need::ClosestHit => (
                Flags::RAY_TRACING_NO_NULL_CLOSEST_HIT_SHADERS_KHR,
                Rule::NullClosestHit,
            ),
            Need::Intersection => (
                Flags::RAY_TRACING_NO_NULL_INTERSECTION_SHADERS_KHR,
                Rule::NullIntersection,
            ),
            Need::Miss => (Flags::RAY_TRACING_NO_NULL_MISS_SHADERS_KHR, Rule::NullMiss),
            Need::Callable => return None,
        };
        self.facts.flags.contains(flag).then_some(rule)
    }

    /// Checks a call: the recursion depth of the called shader, and the stack of it and of all its
    /// callers.
    pub fn call(&self, place: u64, depth: u32, stack_bytes: u64) {
        let max = self.facts.max_recursion_depth;
        self.checks
            .require(depth <= max, Rule::Recursion, place, || {
                format!("depth {depth}, of {max}")
            });
        let there = self.stack_bytes;
        self.checks
            .require(stack_bytes <= there, Rule::StackSize, place, || {
                format!("{stack_bytes} bytes are taken, {there} are there; execution goes on")
            });
    }
}
