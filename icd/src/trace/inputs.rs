//! Filling the input records of new invocations: only the rows that their program reads, a row at a
//! time.

use lanes::{LaneMask, by_lane};
use spirv_jit::program::{AlignedRow, Builtin, IO_DATA_ROW, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, HitRows};

use super::Dispatch;
use super::grid::Launches;
use super::rays::{Operands, RayGroup, Report, operand};
use super::slab::Slab;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex};
use crate::wave::binding_table::HANDLE_SIZE;
use crate::wave::hit_facts::{CachedFacts, Lanes, Subjects, Take, take};
use crate::wave::rows::{bits_of, floats};

/// The sources of inputs.
pub struct Sources<'a> {
    pub dispatch: &'a Dispatch<'a>,
    /// The layer of all launches.
    pub layer: u32,
    pub subgroups: &'a Slab<Subgroup>,
    pub ray_groups: &'a Slab<RayGroup>,
}

/// A new subgroup of invocations.
pub struct Callee<'a> {
    pub role: Role,
    /// Those that are started.
    pub lanes: LaneMask,
    pub launch: &'a Launches,
    /// As [`Subgroup::of`] and [`Subgroup::is_in_place`].
    pub of: &'a Lanes<LaneRef>,
    pub is_in_place: bool,
    /// Addresses of their shader records.
    pub records: &'a Lanes<u64>,
}

lanes::vectors! {
    /// Fills the inputs of a new subgroup into `rows`, its state.
    pub fn fill<V>(
        _v,
        sources: &Sources<'_>,
        program: &Program,
        callee: &Callee<'_>,
        rows: &mut [AlignedRow],
    ) {
        sources.fill(program, callee, rows);
    }
}

impl Sources<'_> {
    #[inline(always)]
    fn fill(&self, program: &Program, subgroup: &Callee<'_>, rows: &mut [AlignedRow]) {
        let inputs = program.inputs();
        let rows = &mut rows[program.layout().inputs..][..inputs.len()];
        let inputs = rows.iter_mut().zip(inputs);
        match subgroup.role {
            Role::RayGeneration => {
                for (row, &input) in inputs {
                    row.0 = self.common_row(subgroup, input);
                }
            }
            Role::Callable => {
                let callers = match subgroup.is_in_place {
                    true => Callers::InPlace(self.data_of(subgroup.of[0].index())),
                    false => self.callers(subgroup.of),
                };
                for (row, &input) in inputs {
                    row.0 = match input {
                        InputRow::CallableData(word) => callers.gather(word as usize),
                        _ => self.common_row(subgroup, input),
                    };
                }
            }
            _ => {
                let rays = Rays::new(self, subgroup);
                let hits = HitLanes {
                    dispatch: self.dispatch,
                    role: subgroup.role,
                    started: subgroup.lanes,
                    of: subgroup.of,
                    rays: &rays,
                    cached: &CachedFacts::default(),
                };
                let callers = match subgroup.is_in_place {
                    true => Callers::InPlace(self.data_of(hits.rays.group(0).caller)),
                    false => self.callers(&hits.callers()),
                };
                for (row, &input) in inputs {
                    match input {
                        InputRow::Payload(word) => row.0 = callers.gather(word as usize),
                        InputRow::HitAttribute(word) => row.0 = hits.attribute_row(word as usize),
                        InputRow::Builtin(builtin, component) => {
                            if !hits.write_row(builtin, component as usize, &mut row.0) {
                                row.0 = self.common_row(subgroup, input);
                            }
                        }
                        InputRow::CallableData(_)
                        | InputRow::Attribute { .. }
                        | InputRow::Varying(_)
                        | InputRow::Barycentric(_) => row.0 = [0; SUBGROUP_SIZE],
                    }
                }
            }
        }
    }

    /// Inputs that every stage has.
    #[inline(always)]
    fn common_row(&self, subgroup: &Callee<'_>, input: InputRow) -> Row {
        match input {
            InputRow::Builtin(Builtin::LaunchId, component) => match component {
                0 => subgroup.launch.x,
                1 => subgroup.launch.y,
                _ => [self.layer; SUBGROUP_SIZE],
            },
            InputRow::Builtin(Builtin::ShaderRecordAddress, component) => {
                let records = subgroup.records;
                by_lane(|lane| ((records[lane] + HANDLE_SIZE as u64) >> (32 * component)) as u32)
            }
            _ => [0; SUBGROUP_SIZE],
        }
    }

    /// The payload or callable data that a subgroup keeps for those that it waits for.
    pub(super) fn data_of(&self, caller: SubgroupIndex) -> &[AlignedRow] {
        let subgroup = &self.subgroups[caller];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let first = program.layout().io + IO_DATA_ROW;
        &subgroup.rows[first..first + subgroup.data_words as usize]
    }

    /// Where each lane's caller keeps its payload or callable data.
    fn callers(&self, callers: &Lanes<LaneRef>) -> Callers<'_> {
        let first = callers[0].index();
        if callers.iter().all(|caller| caller.index() == first) {
            return Callers::One(self.data_of(first), by_lane(|lane| callers[lane].lane()));
        }
        Callers::Many(by_lane(|lane| {
            (self.data_of(callers[lane].index()), callers[lane].lane())
        }))
    }
}

/// The payloads or callable data of the callers.
enum Callers<'a> {
    /// Of one subgroup, each in its own lane.
    InPlace(&'a [AlignedRow]),
    /// Of one subgroup, and which lane of it each is.
    One(&'a [AlignedRow], Lanes<usize>),
    Many(Lanes<(&'a [AlignedRow], usize)>),
}

impl Callers<'_> {
    /// A word of every caller's data; zero past the end of it.
    #[inline(always)]
    fn gather(&self, word: usize) -> Row {
        match self {
            Callers::InPlace(data) => data.get(word).map_or([0; SUBGROUP_SIZE], |row| row.0),
            Callers::One(data, lanes) => data.get(word).map_or([0; SUBGROUP_SIZE], |row| {
                by_lane(|lane| row.0[lanes[lane] % SUBGROUP_SIZE])
            }),
            Callers::Many(callers) => by_lane(|lane| {
                let (data, lane) = callers[lane];
                data.get(word).map_or(0, |row| row.0[lane % SUBGROUP_SIZE])
            }),
        }
    }
}

/// The rays of a subgroup of hit or miss shaders, and their operands.
enum Rays<'a> {
    /// They are one group, each ray in its own lane.
    InPlace(&'a RayGroup, &'a Operands),
    Spread(Lanes<&'a RayGroup>, Lanes<&'a Operands>),
}

impl<'a> Rays<'a> {
    #[inline(always)]
    fn new(sources: &Sources<'a>, subgroup: &Callee<'_>) -> Self {
        let of = subgroup.of;
        let (ray_groups, subgroups) = (sources.ray_groups, sources.subgroups);
        let mut last = (of[0].index(), &ray_groups[of[0].index()]);
        if subgroup.is_in_place {
            return Self::InPlace(last.1, last.1.operands(subgroups));
        }
        let groups = by_lane(|lane| {
            let ray = of[lane];
            if ray.index() != last.0 {
                last = (ray.index(), &ray_groups[ray.index()]);
            }
            last.1
        });
        let mut last = (of[0].index(), groups[0].operands(subgroups));
        let operands = by_lane(|lane| {
            if of[lane].index() != last.0 {
                last = (of[lane].index(), groups[lane].operands(subgroups));
            }
            last.1
        });
        Self::Spread(groups, operands)
    }

    #[inline(always)]
    fn group(&self, lane: usize) -> &'a RayGroup {
        match self {
            Self::InPlace(group, _) => group,
            Self::Spread(groups, _) => groups[lane],
        }
    }
}

/// The rays of a subgroup of hit or miss shaders, and the hits that they are about.
struct HitLanes<'a> {
    dispatch: &'a Dispatch<'a>,
    role: Role,
    /// Those that were started.
    started: LaneMask,
    of: &'a Lanes<LaneRef>,
    rays: &'a Rays<'a>,
    cached: &'a CachedFacts,
}

impl<'a> HitLanes<'a> {
    /// The lane of a ray in its group.
    #[inline(always)]
    fn lane(&self, lane: usize) -> usize {
        self.of[lane].lane()
    }

    /// Who waits for the rays.
    fn callers(&self) -> Lanes<LaneRef> {
        by_lane(|lane| LaneRef::new(self.rays.group(lane).caller, self.lane(lane)))
    }

    /// The hits of a group that this is about.
    #[inline(always)]
    fn hits_of(&self, group: &'a RayGroup) -> &'a HitRows {
        group.hits_for(self.role)
    }

    /// A row of what was hit.
    #[inline(always)]
    fn row_of(&self, rows: impl Fn(&HitRows, usize) -> u32) -> Row {
        match self.rays {
            Rays::InPlace(group, _) => {
                let hits = self.hits_of(group);
                by_lane(|lane| rows(hits, lane))
            }
            Rays::Spread(groups, _) => {
                by_lane(|lane| rows(self.hits_of(groups[lane]), self.lane(lane)))
            }
        }
    }

    /// A row of the operands.
    #[inline(always)]
    fn of_rays(&self, row: usize) -> Row {
        match self.rays {
            Rays::InPlace(_, operands) => operands[row].0,
            Rays::Spread(_, operands) => by_lane(|lane| operands[lane][row].0[self.lane(lane)]),
        }
    }

    fn of_reports(&self, word: impl Fn(&Report) -> u32) -> Row {
        by_lane(|lane| {
            let procedural = self.rays.group(lane).procedural();
            procedural.map_or(0, |rays| word(&rays.reports[self.lane(lane)]))
        })
    }

    #[inline(always)]
    fn attribute_row(&self, word: usize) -> Row {
        if let Rays::InPlace(group, _) = self.rays {
            let hits = self.hits_of(group);
            if (self.started - hits.built_in()).is_empty() {
                let weights = hits.barycentrics.get(word);
                return weights.map_or([0; SUBGROUP_SIZE], |row| {
                    by_lane(|lane| row[lane].to_bits())
                });
            }
        }
        by_lane(|lane| {
            let (group, from) = (self.rays.group(lane), self.lane(lane));
            let hits = self.hits_of(group);
            if hits.is_built_in(from) {
                let weights = hits.barycentrics.get(word);
                return weights.map_or(0, |row| row[from].to_bits());
            }
            let attribute = group.procedural().and_then(|rays| match self.role {
                Role::AnyHitOfReport => rays.reports[from].attributes.get(word).copied(),
                _ => rays.attributes.get(word).map(|row| row[from]),
            });
            attribute.unwrap_or(0)
        })
    }

    /// Writes a row of a built-in that hit or miss shaders have; false for those that every stage
    /// has.
    #[inline(always)]
    fn write_row(&self, builtin: Builtin, component: usize, to: &mut Row) -> bool {
        *to = match (builtin, self.role) {
            (Builtin::HitKind, Role::AnyHitOfReport) => {
                self.of_reports(|report| report.hit_kind as u32)
            }
            (Builtin::RayTmax, _) => self.t_max_row(),
            (Builtin::WorldRayOrigin, _) => self.of_rays(operand::ORIGIN + component),
            (Builtin::WorldRayDirection, _) => self.of_rays(operand::DIRECTION + component),
            (Builtin::RayTmin, _) => self.of_rays(operand::T_MIN),
            (Builtin::IncomingRayFlags, _) => self.of_rays(operand::FLAGS),
            (Builtin::CullMask, _) => {
                let masks = self.of_rays(operand::CULL_MASK);
                by_lane(|lane| masks[lane] & 0xff)
            }
            (Builtin::CurrentRayTime, _) => bits_of(&self.times()),
            _ => {
                let Some(fact) = builtin.fact() else {
                    return false;
                };
                if take(fact, component, (self, &mut *to)).is_none() {
                    (self.cached).write_row(self, self.dispatch.limits, fact, component, to);
                }
                return true;
            }
        };
        true
    }

    /// `RayTmaxKHR`: the hit's distance in hit shaders, the end of the interval as it stands in the
    /// others.
    fn t_max_row(&self) -> Row {
        match self.role {
            Role::AnyHitOfReport => self.of_reports(|report| report.t.to_bits()),
            Role::Intersection => {
                by_lane(|lane| self.rays.group(lane).group_walk.t_max()[self.lane(lane)].to_bits())
            }
            _ => self.row_of(|hits, lane| hits.t[lane].to_bits()),
        }
    }
}

impl Take for (&HitLanes<'_>, &mut Row) {
    type Taken = ();

    #[inline(always)]
    fn take(self, rows: impl Fn(&HitRows, usize) -> u32, _: impl Fn(&Hit) -> u32) {
        *self.1 = self.0.row_of(rows);
    }
}

impl Subjects for HitLanes<'_> {
    fn lanes(&self) -> LaneMask {
        self.started
    }

    fn structures(&self) -> [Row; 2] {
        [0, 1].map(|word| self.of_rays(operand::STRUCTURE + word))
    }

    fn times(&self) -> Lanes<f32> {
        let times = self.of_rays(operand::TIME);
        by_lane(|lane| match self.rays.group(lane).has_time {
            true => f32::from_bits(times[lane]),
            false => 0.0,
        })
    }

    fn instances(&self) -> Row {
        self.row_of(|hits, lane| hits.instance_index[lane])
    }

    /// Where it is about a report, this is the box.
    fn hit(&self, lane: usize) -> Hit {
        let hits = self.hits_of(self.rays.group(lane));
        hits.get(self.lane(lane)).unwrap_or(Hit::NONE)
    }

    fn origins(&self) -> [Lanes<f32>; 3] {
        [0, 1, 2].map(|axis| floats(&self.of_rays(operand::ORIGIN + axis)))
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        [0, 1, 2].map(|axis| floats(&self.of_rays(operand::DIRECTION + axis)))
    }
}
