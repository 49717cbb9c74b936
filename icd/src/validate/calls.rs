//! The records that a dispatch meets, and how deep its calls go.
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
    /// The record, if the index lies in the table.
    pub record: Option<(Handle, Option<&'a Group>)>,
    /// Of a hit: whether it is on a box. Spheres count as triangles.
    pub is_box: bool,
}

impl Traced {
    /// Looks at a record that is met.
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

    /// The rule by which the pipeline promised that there is no null record.
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

    /// Looks at a call: the recursion depth of the shader that is called, and the stack of all that
    /// wait for it, itself included.
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
