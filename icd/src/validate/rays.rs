//! Checks of the operands of trace instructions and ray queries, and of their structures.
#![forbid(unsafe_code)]

use std::collections::HashSet;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::reach::Stray;
use traversal::{Kind, Ray, ray_flags};

use super::{Checks, Rule};
use crate::object::ray_tracing_pipeline::PipelineFacts;
use crate::wave::observer::{
    Instruction, Interests, Observer, RecordLookup, ShaderCall, StartedRay,
};

/// One command's dispatch, while it runs.
pub struct Traced {
    pub checks: Checks,
    pub(super) facts: PipelineFacts,
    /// The stack size in bytes: the command buffer's, or the pipeline's default.
    pub(super) stack_bytes: u64,
    /// Addresses of the live structures.
    structures: HashSet<u64>,
}

/// The rules of one instruction; `None` for rules that it lacks.
struct RayRules {
    finite: Rule,
    not_negative: Rule,
    order: Rule,
    nan: Rule,
    time: Option<Rule>,
    top: Option<Rule>,
    /// A structure with motion needs a pipeline that allows it.
    motion: Option<Rule>,
    /// The instruction needs motion itself.
    pipeline: Option<Rule>,
    flags: Option<FlagRules>,
}

#[derive(Clone, Copy)]
struct FlagRules {
    skips: Rule,
    culls: Rule,
    opacity: Rule,
    /// Rules about flags that the pipeline and the ray combine; ray queries have no pipeline.
    with_pipeline: Option<(Rule, Rule)>,
}

const TRACE: RayRules = RayRules {
    finite: Rule::TraceFinite,
    not_negative: Rule::TraceNotNegative,
    order: Rule::TraceOrder,
    nan: Rule::TraceNan,
    time: None,
    top: Some(Rule::TraceTop),
    motion: Some(Rule::TraceMotion),
    pipeline: None,
    flags: Some(FlagRules {
        skips: Rule::TraceSkips,
        culls: Rule::TraceCulls,
        opacity: Rule::TraceOpacity,
        with_pipeline: Some((Rule::TraceSkipsTriangles, Rule::TraceSkipsBoxes)),
    }),
};
const MOTION: RayRules = RayRules {
    finite: Rule::MotionFinite,
    not_negative: Rule::MotionNotNegative,
    order: Rule::MotionOrder,
    nan: Rule::MotionNan,
    time: Some(Rule::MotionTime),
    top: Some(Rule::MotionTop),
    motion: None,
    pipeline: Some(Rule::MotionPipeline),
    flags: None,
};
const HIT_OBJECT: RayRules = RayRules {
    finite: Rule::HitObjectFinite,
    not_negative: Rule::HitObjectNotNegative,
    order: Rule::HitObjectOrder,
    nan: Rule::HitObjectNan,
    time: Some(Rule::HitObjectTime),
    top: None,
    motion: Some(Rule::HitObjectMotion),
    pipeline: None,
    flags: Some(FlagRules {
        skips: Rule::HitObjectSkips,
        culls: Rule::HitObjectCulls,
        opacity: Rule::HitObjectOpacity,
        with_pipeline: Some((Rule::HitObjectSkipsTriangles, Rule::HitObjectSkipsBoxes)),
    }),
};

/// `OpRayQueryInitializeKHR`.
const QUERY: RayRules = RayRules {
    finite: Rule::QueryFinite,
    not_negative: Rule::QueryNotNegative,
    order: Rule::QueryOrder,
    nan: Rule::QueryNan,
    time: None,
    top: Some(Rule::QueryTop),
    motion: None,
    pipeline: None,
    flags: Some(FlagRules {
        skips: Rule::QuerySkips,
        culls: Rule::QueryCulls,
        opacity: Rule::QueryOpacity,
        with_pipeline: None,
    }),
};

impl RayRules {
    /// Checks the numbers and flags of a ray.
    fn ray(&self, ray: &Ray, require: impl Fn(bool, Rule)) {
        let numbers = || ray.origin.iter().chain(&ray.direction);
        let has_nan = numbers().any(|n| n.is_nan()) || ray.t_min.is_nan() || ray.t_max.is_nan();
        require(!has_nan, self.nan);
        if !has_nan {
            require(numbers().all(|n| n.is_finite()), self.finite);
            require(ray.t_min >= 0.0 && ray.t_max >= 0.0, self.not_negative);
            require(ray.t_min <= ray.t_max, self.order);
            require(ray.direction != [0.0; 3], Rule::ZeroDirection);
        }
        let Some(rules) = &self.flags else { return };
        let at_most_one = |bits: u32| (ray.flags & bits).count_ones() <= 1;
        require(
            at_most_one(ray_flags::SKIP_TRIANGLES | ray_flags::SKIP_AABBS),
            rules.skips,
        );
        require(
            at_most_one(
                ray_flags::SKIP_TRIANGLES
                    | ray_flags::CULL_BACK_FACING_TRIANGLES
                    | ray_flags::CULL_FRONT_FACING_TRIANGLES,
            ),
            rules.culls,
        );
        require(
            at_most_one(
                ray_flags::OPAQUE
                    | ray_flags::NO_OPAQUE
                    | ray_flags::CULL_OPAQUE
                    | ray_flags::CULL_NO_OPAQUE,
            ),
            rules.opacity,
        );
    }
}

/// One command's ray queries, while it runs.
pub struct Queried {
    checks: Checks,
    /// Addresses of the live structures.
    structures: HashSet<u64>,
}

impl Queried {
    /// Takes the structures that are live now.
    pub fn new(checks: Checks) -> Self {
        Self {
            structures: checks.validator.registry.structures(),
            checks,
        }
    }
}

impl Observer for Queried {
    fn interests(&self) -> Interests {
        Interests {
            rays: true,
            ..Interests::default()
        }
    }

    #[cold]
    fn ray(&self, started: &StartedRay) {
        let &StartedRay {
            place,
            ref ray,
            structure,
            kind,
            ..
        } = started;
        let detail = || format!("{ray:?}, structure {structure:#x}");
        let require = |holds, rule| self.checks.require(holds, rule, place, detail);
        QUERY.ray(ray, require);
        if structure != 0 {
            let exists = self.structures.contains(&structure);
            require(exists, Rule::QueryStructure);
        }
        if let Some(kind) = kind {
            require(kind.is_top(), Rule::QueryTop);
        }
    }

    fn strays(&self, strays: &[Stray], _: &[&Program]) {
        self.checks.strays(strays);
    }
}

/// The rules of the instruction that starts a ray.
fn rules(started: &StartedRay) -> &'static RayRules {
    match (started.instruction, started.has_time) {
        (Instruction::HitObjectTrace, _) => &HIT_OBJECT,
        (_, true) => &MOTION,
        (_, false) => &TRACE,
    }
}

impl Observer for Traced {
    fn interests(&self) -> Interests {
        Interests {
            rays: true,
            lookups: true,
            waves: false,
        }
    }

    fn ray(&self, ray: &StartedRay) {
        self.check_ray(ray);
    }

    fn hit_kind(&self, place: u64, kind: u32) {
        self.checks.require(kind <= 127, Rule::HitKind, place, || {
            format!("it is {kind}")
        });
    }

    fn call(&self, call: &ShaderCall) {
        self.check_call(call);
    }

    fn look_up(&self, lookup: &RecordLookup<'_>) {
        self.check_lookup(lookup);
    }

    fn strays(&self, strays: &[Stray], _: &[&Program]) {
        self.checks.strays(strays);
    }
}

impl Traced {
    /// Takes the structures that are live now.
    pub fn new(checks: Checks, facts: PipelineFacts, stack_bytes: Option<u64>) -> Self {
        Self {
            stack_bytes: stack_bytes.unwrap_or(facts.default_stack_bytes),
            facts,
            structures: checks.validator.registry.structures(),
            checks,
        }
    }

    /// Checks a ray: the shader's flags, the address, and the structure there.
    fn check_ray(&self, started: &StartedRay) {
        let &StartedRay {
            has_time,
            place,
            ref ray,
            time,
            structure,
            kind,
            ..
        } = started;
        let rules = rules(started);
        let detail = || format!("{ray:?}, time {time}, structure {structure:#x}");
        let require = |holds, rule| self.checks.require(holds, rule, place, detail);
        rules.ray(ray, require);
        if let Some(rule) = rules.time.filter(|_| has_time) {
            require((0.0..=1.0).contains(&time), rule);
        }
        if let Some(rules) = rules.flags.and_then(|flags| flags.with_pipeline) {
            self.skips(ray.flags, rules, require);
        }
        if structure != 0 {
            require(self.structures.contains(&structure), Rule::DeadStructure);
        }
        let allows_motion = self
            .facts
            .flags
            .contains(vk::PipelineCreateFlags::RAY_TRACING_ALLOW_MOTION_NV);
        let in_motion = kind == Some(Kind::MotionInstances);
        if let (Some(rule), Some(kind)) = (rules.top, kind) {
            require(kind.is_top() && (in_motion || !has_time), rule);
        }
        if let Some(rule) = rules.motion.filter(|_| in_motion) {
            require(allows_motion, rule);
        }
        if let Some(rule) = rules.pipeline {
            require(allows_motion, rule);
        }
    }

    /// Requires that the ray or its pipeline skips neither kind.
    fn skips(&self, flags: u32, (triangles, boxes): (Rule, Rule), require: impl Fn(bool, Rule)) {
        use vk::PipelineCreateFlags as Pipeline;
        let skips = |bit: u32| flags & bit != 0;
        let pipeline_skips = |flag| self.facts.flags.contains(flag);
        require(
            !(skips(ray_flags::SKIP_TRIANGLES)
                && pipeline_skips(Pipeline::RAY_TRACING_SKIP_AABBS_KHR)),
            triangles,
        );
        require(
            !(skips(ray_flags::SKIP_AABBS)
                && pipeline_skips(Pipeline::RAY_TRACING_SKIP_TRIANGLES_KHR)),
            boxes,
        );
    }
}
