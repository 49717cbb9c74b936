//! A line's members, and the calls that it runs in place: see [`direct`](super::direct).

use lanes::LaneMask;
use spirv_jit::Program;
use spirv_jit::program::{AlignedRow, Event};

use super::fill_plan::FillPlan;
use super::subgroup::{Callee, LaneRef, Role, SubgroupIndex};
use crate::wave::binding_table::ProgramIndex;

/// The event of a subgroup that went on in a line.
pub struct Noted {
    pub index: SubgroupIndex,
    pub event: Event,
}

/// The subgroups of a batch's lines.
pub struct LineLists {
    /// Whether lines of ray generation shaders are taken on directly; see
    /// [`direct`](super::direct).
    pub is_direct: bool,
    /// A line is being answered.
    pub is_answered: bool,
    /// Subgroups at traces and calls that are to be answered as lines.
    pub standing: Vec<SubgroupIndex>,
    /// How far subgroups of lines came in this round.
    pub noted: Vec<Noted>,
    /// The same, of hit and miss shaders.
    pub noted_callees: Vec<Noted>,
}

impl LineLists {
    pub fn new(is_direct: bool) -> Self {
        Self {
            is_direct,
            is_answered: false,
            standing: Vec::new(),
            noted: Vec::new(),
            noted_callees: Vec::new(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.standing.is_empty() && self.noted.is_empty() && self.noted_callees.is_empty()
    }
}

/// A worker's memory for the line that is being answered.
#[derive(Default)]
pub struct Line {
    /// Groups of rays of the members.
    pub groups: Vec<u32>,
    /// Hit and miss shaders that are called, in the order of their first calls.
    pub programs: Vec<ProgramIndex>,
    /// The same of any-hit shaders.
    pub deciders: Vec<ProgramIndex>,
    /// By program.
    pub calls: Vec<Vec<InPlace>>,
    /// States of the hit, miss and any-hit shaders that run, and of the callables that those call.
    pub states: [Vec<AlignedRow>; 2],
    /// By program; none was looked for yet, or there is none.
    pub plans: Vec<Option<Option<FillPlan>>>,
    pub nested: Vec<Nested>,
}

/// A call of lanes of one group of rays, which stay in place.
pub struct InPlace {
    pub role: Role,
    pub record: u64,
    pub group: u32,
    pub lanes: LaneMask,
}

impl InPlace {
    /// The first ray.
    pub fn of(&self) -> LaneRef {
        LaneRef::new(self.group, self.lanes.first())
    }
}

/// A call of a callable by lanes of a hit or miss shader in place.
pub struct Nested {
    pub program: ProgramIndex,
    pub record: u64,
    /// The number of the caller in its wave.
    pub caller: usize,
    pub lanes: LaneMask,
}

impl Line {
    /// Forgets what a batch that was given up left.
    pub fn clear(&mut self) {
        self.groups.clear();
        self.programs.clear();
        self.deciders.clear();
        self.calls.iter_mut().for_each(Vec::clear);
        self.plans.clear();
        self.nested.clear();
    }

    /// The fill plan of a program.
    pub fn plan(&mut self, index: ProgramIndex, program: &Program) -> Option<&FillPlan> {
        let place = index as usize;
        if self.plans.len() <= place {
            self.plans.resize_with(place + 1, || None);
        }
        let plan = self.plans[place].get_or_insert_with(|| FillPlan::new(program));
        plan.as_ref()
    }

    /// Adds a call.
    pub fn call(&mut self, (program, role, record): Callee, group: u32, lanes: LaneMask) {
        let place = program as usize;
        if self.calls.len() <= place {
            self.calls.resize_with(place + 1, Vec::new);
        }
        let calls = &mut self.calls[place];
        if calls.is_empty() {
            match role {
                Role::AnyHit => self.deciders.push(program),
                _ => self.programs.push(program),
            }
        }
        calls.push(InPlace {
            role,
            record,
            group,
            lanes,
        });
    }
}
