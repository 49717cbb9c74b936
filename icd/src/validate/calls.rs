//! Checks of the records that a dispatch uses, and of its call depth.
#![forbid(unsafe_code)]

use ash::vk;

use super::{Rule, Traced};
use crate::wave::binding_table::{GroupKind, HANDLE_SIZE};
use crate::wave::observer::{LookupPurpose, RecordLookup, ShaderCall};

impl Traced {
    /// Checks a record that is used.
    pub(super) fn check_lookup(&self, lookup: &RecordLookup<'_>) {
        let RecordLookup {
            purpose,
            region,
            index,
            rays,
            ..
        } = *lookup;
        if purpose == LookupPurpose::SkippedClosestHit {
            return;
        }
        let need = need(purpose);
        let detail = || {
            format!(
                "record {index} for {need}, in the table at {:#x}",
                region.address
            )
        };
        let place = region
            .address
            .wrapping_add(u64::from(index).wrapping_mul(region.stride_bytes));
        let is_zero = lookup
            .record
            .is_none_or(|(handle, _)| handle == [0; HANDLE_SIZE]);
        let require = |holds: bool, rule| {
            if !holds {
                self.checks
                    .broken_times(rule, place, u64::from(rays), detail);
            }
        };
        if let Some(rule) = self.forbids_null(purpose) {
            require(!is_zero, rule);
        }
        let Some((_, group)) = lookup.record else {
            let is_there = region.address == 0 || region.size_bytes == 0;
            return require(is_there, Rule::RecordRange);
        };
        if is_zero {
            return;
        }
        let Some(group) = group else {
            return require(false, Rule::ForeignHandle);
        };
        match (purpose, group.kind) {
            (LookupPurpose::Miss | LookupPurpose::Callable, _) => {}
            (_, kind) if lookup.is_box => {
                require(kind == GroupKind::Procedural, Rule::GroupOfBoxes);
            }
            (_, kind) => require(kind == GroupKind::Triangles, Rule::GroupOfTriangles),
        }
    }

    /// The rule by which the pipeline excludes null records.
    fn forbids_null(&self, purpose: LookupPurpose) -> Option<Rule> {
        use vk::PipelineCreateFlags as Flags;
        let (flag, rule) = match purpose {
            LookupPurpose::AnyHit | LookupPurpose::AnyHitOfReport => (
                Flags::RAY_TRACING_NO_NULL_ANY_HIT_SHADERS_KHR,
                Rule::NullAnyHit,
            ),
            LookupPurpose::ClosestHit | LookupPurpose::SkippedClosestHit => (
                Flags::RAY_TRACING_NO_NULL_CLOSEST_HIT_SHADERS_KHR,
                Rule::NullClosestHit,
            ),
            LookupPurpose::Intersection => (
                Flags::RAY_TRACING_NO_NULL_INTERSECTION_SHADERS_KHR,
                Rule::NullIntersection,
            ),
            LookupPurpose::Miss => (Flags::RAY_TRACING_NO_NULL_MISS_SHADERS_KHR, Rule::NullMiss),
            LookupPurpose::Callable => return None,
        };
        self.facts.flags.contains(flag).then_some(rule)
    }

    /// Checks a call: the recursion depth of the called shader, and the stack of it and of all its
    /// callers.
    pub(super) fn check_call(&self, call: &ShaderCall) {
        let ShaderCall {
            place,
            depth,
            stack_bytes,
        } = *call;
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

/// The kind of shader that a record is looked up for, as messages name it.
fn need(purpose: LookupPurpose) -> &'static str {
    match purpose {
        LookupPurpose::AnyHit | LookupPurpose::AnyHitOfReport => "AnyHit",
        LookupPurpose::Intersection => "Intersection",
        LookupPurpose::ClosestHit | LookupPurpose::SkippedClosestHit => "ClosestHit",
        LookupPurpose::Miss => "Miss",
        LookupPurpose::Callable => "Callable",
    }
}
