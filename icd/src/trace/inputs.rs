//! Filling the input records of new invocations: only the rows that their program reads, a row at a time.

use std::cell::OnceCell;

use spirv_jit::program::{AlignedRow, Builtin, IO_DATA_ROW, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, HitRows, Structure, SuspendedPacket, Swept, Walk};

use super::Dispatch;
use super::rays::{Operands, RayGroup, Report, operand, structure_in, to_object};
use super::slab::Slab;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex};
use crate::wave::table::HANDLE_SIZE;

/// What inputs are read from.
pub struct Sources<'a> {
    pub dispatch: &'a Dispatch<'a>,
    /// The layer of all launches.
    pub layer: u32,
    pub subgroups: &'a Slab<Subgroup>,
    pub ray_groups: &'a Slab<RayGroup>,
    pub walks: &'a Slab<Walk>,
    pub packets: &'a Slab<Box<SuspendedPacket>>,
}

/// Per lane; of lanes that were not started, anything.
type Lanes<T> = [T; SUBGROUP_SIZE];

impl Sources<'_> {
    /// Fills the inputs of a new subgroup into `rows`, its state. `records` has a record address per lane.
    pub fn fill(
        &self,
        program: &Program,
        subgroup: &Subgroup,
        records: &Lanes<u64>,
        rows: &mut [AlignedRow],
    ) {
        let inputs = program.inputs();
        let rows = &mut rows[program.layout().inputs..][..inputs.len()];
        let inputs = rows.iter_mut().zip(inputs);
        match subgroup.role {
            Role::RayGeneration => {
                for (row, &input) in inputs {
                    row.0 = self.common_row(subgroup, records, input);
                }
            }
            Role::Callable => {
                let callers = match subgroup.is_in_place {
                    true => Callers::InPlace(self.data_of(subgroup.of[0].index())),
                    false => self.callers(&subgroup.of),
                };
                for (row, &input) in inputs {
                    row.0 = match input {
                        InputRow::CallableData(word) => callers.gather(word as usize),
                        _ => self.common_row(subgroup, records, input),
                    };
                }
            }
            _ => {
                let hits = HitLanes::new(self, subgroup);
                let callers = match subgroup.is_in_place {
                    true => Callers::InPlace(self.data_of(hits.rays.group(0).caller)),
                    false => self.callers(&hits.callers()),
                };
                for (row, &input) in inputs {
                    row.0 = match input {
                        InputRow::Payload(word) => callers.gather(word as usize),
                        InputRow::HitAttribute(word) => hits.attribute_row(word as usize),
                        InputRow::Builtin(builtin, component) => hits
                            .row(builtin, component as usize)
                            .unwrap_or_else(|| self.common_row(subgroup, records, input)),
                        InputRow::CallableData(_)
                        | InputRow::Attribute { .. }
                        | InputRow::Varying(_)
                        | InputRow::Barycentric(_) => [0; SUBGROUP_SIZE],
                    };
                }
            }
        }
    }

    /// Inputs that every stage has.
    fn common_row(&self, subgroup: &Subgroup, records: &Lanes<u64>, input: InputRow) -> Row {
        match input {
            InputRow::Builtin(Builtin::LaunchId, component) => match component {
                0 => subgroup.launch.x,
                1 => subgroup.launch.y,
                _ => [self.layer; SUBGROUP_SIZE],
            },
            InputRow::Builtin(Builtin::ShaderRecordAddress, component) => {
                records.map(|record| ((record + HANDLE_SIZE as u64) >> (32 * component)) as u32)
            }
            _ => [0; SUBGROUP_SIZE],
        }
    }

    /// The payload or callable data that a subgroup keeps for those that it waits for.
    fn data_of(&self, caller: SubgroupIndex) -> &[AlignedRow] {
        let subgroup = &self.subgroups[caller];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let first = program.layout().io + IO_DATA_ROW;
        &subgroup.rows[first..first + subgroup.data_words as usize]
    }

    /// Where each lane's caller keeps its payload or callable data.
    fn callers(&self, callers: &Lanes<LaneRef>) -> Callers<'_> {
        let first = callers[0].index();
        if callers.iter().all(|caller| caller.index() == first) {
            return Callers::One(self.data_of(first), callers.map(LaneRef::lane));
        }
        Callers::Many(callers.map(|caller| (self.data_of(caller.index()), caller.lane())))
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
    fn gather(&self, word: usize) -> Row {
        match self {
            Callers::InPlace(data) => data.get(word).map_or([0; SUBGROUP_SIZE], |row| row.0),
            Callers::One(data, lanes) => data.get(word).map_or([0; SUBGROUP_SIZE], |row| {
                lanes.map(|lane| row.0[lane % SUBGROUP_SIZE])
            }),
            Callers::Many(callers) => callers
                .map(|(data, lane)| data.get(word).map_or(0, |row| row.0[lane % SUBGROUP_SIZE])),
        }
    }
}

/// What a shader is about.
enum Subject<'a> {
    /// What was found in the end, or nothing.
    Hits,
    /// Candidates of rays that walk together, each in its own lane.
    Together(&'a SuspendedPacket),
    /// Candidates, and where their rays' intervals end.
    Candidates(Lanes<(Hit, f32)>),
}

impl<'a> Subject<'a> {
    fn new(sources: &Sources<'a>, subgroup: &Subgroup, rays: &Rays<'a>) -> Self {
        if let Rays::InPlace(group, _) = rays
            && let Some(place) = group.packet
        {
            return Self::Together(&sources.packets[place]);
        }
        Self::Candidates(std::array::from_fn(|i| {
            let (group, lane) = (rays.group(i), subgroup.of[i].lane());
            match group.packet {
                _ if subgroup.lanes >> i & 1 == 0 => (Hit::NONE, 0.0),
                Some(place) => {
                    let packet = &sources.packets[place];
                    (packet.candidates().hit(lane), packet.t_max()[lane])
                }
                None => {
                    let walk = &sources.walks[group.walks[lane]];
                    (*walk.candidate(), walk.t_max())
                }
            }
        }))
    }
}

/// The rays of a subgroup of hit or miss shaders, and their operands.
enum Rays<'a> {
    /// They are one group, each ray in its own lane.
    InPlace(&'a RayGroup, &'a Operands),
    Spread(Lanes<&'a RayGroup>, Lanes<&'a Operands>),
}

impl<'a> Rays<'a> {
    fn new(sources: &Sources<'a>, subgroup: &Subgroup) -> Self {
        let of = &subgroup.of;
        let (ray_groups, subgroups) = (sources.ray_groups, sources.subgroups);
        let mut last = (of[0].index(), &ray_groups[of[0].index()]);
        if subgroup.is_in_place {
            return Self::InPlace(last.1, last.1.operands(subgroups));
        }
        let groups = of.map(|ray| {
            if ray.index() != last.0 {
                last = (ray.index(), &ray_groups[ray.index()]);
            }
            last.1
        });
        let mut last = (of[0].index(), groups[0].operands(subgroups));
        let operands = std::array::from_fn(|lane| {
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

    #[inline(always)]
    fn operands(&self, lane: usize) -> &'a Operands {
        match self {
            Self::InPlace(_, operands) => operands,
            Self::Spread(_, operands) => operands[lane],
        }
    }
}

/// The rays of a subgroup of hit or miss shaders, and the hits that they are about.
struct HitLanes<'a> {
    dispatch: &'a Dispatch<'a>,
    role: Role,
    /// Those that were started.
    started: u16,
    of: &'a Lanes<LaneRef>,
    rays: Rays<'a>,
    subject: Subject<'a>,
    object_to_world: OnceCell<Lanes<[f32; 12]>>,
    world_to_object: OnceCell<Lanes<[f32; 12]>>,
    vertices: OnceCell<Lanes<[[f32; 3]; 3]>>,
}

impl<'a> HitLanes<'a> {
    fn new(sources: &Sources<'a>, subgroup: &'a Subgroup) -> Self {
        let decides = matches!(
            subgroup.role,
            Role::AnyHit | Role::AnyHitOfReport | Role::Intersection
        );
        let rays = Rays::new(sources, subgroup);
        let subject = match decides {
            true => Subject::new(sources, subgroup, &rays),
            false => Subject::Hits,
        };
        Self {
            dispatch: sources.dispatch,
            role: subgroup.role,
            started: subgroup.lanes,
            of: &subgroup.of,
            rays,
            subject,
            object_to_world: OnceCell::new(),
            world_to_object: OnceCell::new(),
            vertices: OnceCell::new(),
        }
    }

    /// The lane of a ray in its group.
    #[inline(always)]
    fn lane(&self, lane: usize) -> usize {
        self.of[lane].lane()
    }

    /// Who waits for the rays.
    fn callers(&self) -> Lanes<LaneRef> {
        std::array::from_fn(|lane| LaneRef::new(self.rays.group(lane).caller, self.lane(lane)))
    }

    /// The hit in a lane. Where it is about a report, this is the box.
    fn hit(&self, lane: usize) -> Hit {
        match &self.subject {
            Subject::Candidates(candidates) => candidates[lane].0,
            Subject::Together(packet) => packet.candidates().hit(lane),
            Subject::Hits => {
                let hits = &self.rays.group(lane).hits;
                hits.get(self.lane(lane)).unwrap_or(Hit::NONE)
            }
        }
    }

    /// Whether a lane was started: rows have anything elsewhere.
    fn is_there(&self, lane: usize) -> bool {
        self.started >> lane & 1 != 0
    }

    /// A row of what was hit: from the rows of hits, or from candidates.
    #[inline(always)]
    fn of_hits(
        &self,
        row: impl Fn(&HitRows, usize) -> u32,
        candidate: impl Fn(&Hit) -> u32,
    ) -> Option<Row> {
        Some(match &self.subject {
            Subject::Candidates(candidates) => {
                std::array::from_fn(|lane| candidate(&candidates[lane].0))
            }
            Subject::Together(packet) => std::array::from_fn(|lane| row(packet.candidates(), lane)),
            Subject::Hits => match &self.rays {
                Rays::InPlace(group, _) => std::array::from_fn(|lane| row(&group.hits, lane)),
                Rays::Spread(groups, _) => {
                    std::array::from_fn(|lane| row(&groups[lane].hits, self.lane(lane)))
                }
            },
        })
    }

    /// A row of the operands.
    #[inline(always)]
    fn of_rays(&self, row: usize) -> Row {
        match &self.rays {
            Rays::InPlace(_, operands) => operands[row].0,
            Rays::Spread(_, operands) => {
                std::array::from_fn(|lane| operands[lane][row].0[self.lane(lane)])
            }
        }
    }

    fn of_reports(&self, word: impl Fn(&Report) -> u32) -> Row {
        std::array::from_fn(|lane| {
            let procedural = self.rays.group(lane).procedural();
            procedural.map_or(0, |rays| word(&rays.reports[self.lane(lane)]))
        })
    }

    /// What was hit, where that is in rows.
    fn hit_rows(&self) -> Option<&'a HitRows> {
        match (&self.subject, &self.rays) {
            (Subject::Together(packet), _) => Some(packet.candidates()),
            (Subject::Hits, Rays::InPlace(group, _)) => Some(&group.hits),
            _ => None,
        }
    }

    fn attribute_row(&self, word: usize) -> Row {
        if let Some(hits) = self.hit_rows() {
            let mut built_in = 0;
            for lane in 0..SUBGROUP_SIZE {
                built_in |= u16::from(hits.is_built_in(lane)) << lane;
            }
            if self.started & !built_in == 0 {
                let weights = hits.barycentrics.get(word);
                return weights.map_or([0; SUBGROUP_SIZE], |row| row.map(f32::to_bits));
            }
        }
        std::array::from_fn(|lane| {
            let (group, from) = (self.rays.group(lane), self.lane(lane));
            let weights = |hits: &HitRows, lane: usize| {
                let [second, third] = &hits.barycentrics;
                (hits.is_built_in(lane)).then(|| [second[lane], third[lane]])
            };
            let built_in = match &self.subject {
                Subject::Candidates(candidates) => Some(&candidates[lane].0)
                    .filter(|hit| hit.is_built_in())
                    .map(|hit| hit.barycentrics),
                Subject::Together(packet) => weights(packet.candidates(), lane),
                Subject::Hits => weights(&group.hits, from),
            };
            if let Some(weights) = built_in {
                return weights.get(word).map_or(0, |weight| weight.to_bits());
            }
            let attribute = group.procedural().and_then(|rays| match self.role {
                Role::AnyHitOfReport => rays.reports[from].attributes.get(word).copied(),
                _ => rays.attributes.get(word).map(|row| row[from]),
            });
            attribute.unwrap_or(0)
        })
    }

    /// What structures say of the hits at the rays' times.
    fn of_structures<T: Default>(&self, read: impl Fn(Structure, &Hit, f32) -> T) -> Lanes<T> {
        let mut last = (0, None);
        std::array::from_fn(|lane| {
            if !self.is_there(lane) {
                return T::default();
            }
            let (operands, from) = (self.rays.operands(lane), self.lane(lane));
            let named = structure_in(operands, from);
            if named != last.0 {
                last = (named, self.dispatch.limits.structure(named));
            }
            let hit = self.hit(lane);
            last.1.map_or_else(T::default, |structure| {
                read(structure, &hit, self.time(lane))
            })
        })
    }

    /// When a ray is cast.
    fn time(&self, lane: usize) -> f32 {
        match self.rays.group(lane).has_time {
            true => f32::from_bits(self.rays.operands(lane)[operand::TIME].0[self.lane(lane)]),
            false => 0.0,
        }
    }

    /// What structures say of the instances that were hit.
    fn of_instances(&self, read: impl Fn(Structure, u32, f32) -> [f32; 12]) -> Lanes<[f32; 12]> {
        let mut last: Option<((u64, u32, u32), [f32; 12])> = None;
        std::array::from_fn(|lane| {
            if !self.is_there(lane) {
                return [0.0; 12];
            }
            let named = structure_in(self.rays.operands(lane), self.lane(lane));
            let (index, time) = (self.hit(lane).instance_index, self.time(lane));
            let asked = (named, index, time.to_bits());
            if let Some((before, matrix)) = last
                && before == asked
            {
                return matrix;
            }
            let structure = self.dispatch.limits.structure(named);
            let matrix = structure.map_or([0.0; 12], |structure| read(structure, index, time));
            last = Some((asked, matrix));
            matrix
        })
    }

    fn object_to_world(&self) -> &Lanes<[f32; 12]> {
        self.object_to_world.get_or_init(|| {
            self.of_instances(|structure, index, time| structure.object_to_world_at(index, time))
        })
    }

    fn world_to_object(&self) -> &Lanes<[f32; 12]> {
        self.world_to_object.get_or_init(|| {
            self.of_instances(|structure, index, time| structure.world_to_object_at(index, time))
        })
    }

    /// A row of a built-in that hit or miss shaders have; `None` for those that every stage has.
    fn row(&self, builtin: Builtin, component: usize) -> Option<Row> {
        match builtin {
            Builtin::PrimitiveId => self.of_hits(
                |hits, lane| hits.primitive_index[lane],
                |hit| hit.primitive_index,
            ),
            Builtin::InstanceId => self.of_hits(
                |hits, lane| hits.instance_index[lane],
                |hit| hit.instance_index,
            ),
            Builtin::InstanceCustomIndex => self.of_hits(
                |hits, lane| hits.instance_custom_index[lane],
                |hit| hit.instance_custom_index,
            ),
            Builtin::GeometryIndex => self.of_hits(
                |hits, lane| hits.geometry_index[lane],
                |hit| hit.geometry_index,
            ),
            Builtin::HitKind if self.role == Role::AnyHitOfReport => {
                Some(self.of_reports(|report| report.hit_kind as u32))
            }
            Builtin::HitKind => self.of_hits(
                |hits, lane| hits.hit_kind(lane) as u32,
                |hit| hit.hit_kind as u32,
            ),
            Builtin::WorldRayOrigin => Some(self.of_rays(operand::ORIGIN + component)),
            Builtin::WorldRayDirection => Some(self.of_rays(operand::DIRECTION + component)),
            Builtin::RayTmin => Some(self.of_rays(operand::T_MIN)),
            Builtin::RayTmax => self.t_max_row(),
            Builtin::IncomingRayFlags => Some(self.of_rays(operand::FLAGS)),
            Builtin::CullMask => Some(self.of_rays(operand::CULL_MASK).map(|mask| mask & 0xff)),
            Builtin::ObjectToWorld => Some(column_major(self.object_to_world(), component)),
            Builtin::WorldToObject => Some(column_major(self.world_to_object(), component)),
            Builtin::ObjectRayOrigin => Some(self.object_ray_row(component, true)),
            Builtin::ObjectRayDirection => Some(self.object_ray_row(component, false)),
            Builtin::HitTriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    self.of_structures(|structure, hit, time| {
                        structure.triangle_vertices_at(hit, time, &self.dispatch.limits.live)
                    })
                });
                Some(std::array::from_fn(|lane| {
                    vertices[lane][component / 3][component % 3].to_bits()
                }))
            }
            Builtin::CurrentRayTime => Some(std::array::from_fn(|lane| self.time(lane).to_bits())),
            Builtin::HitIsSphere => self.is_swept(Swept::Sphere),
            Builtin::HitIsLss => self.is_swept(Swept::LinearSweptSphere),
            Builtin::HitSpherePosition | Builtin::HitLssPositions => {
                let ends = self.ends();
                Some(ends.map(|ends| ends.0.as_flattened()[component].to_bits()))
            }
            Builtin::HitSphereRadius | Builtin::HitLssRadii => {
                let ends = self.ends();
                Some(ends.map(|ends| ends.1[component].to_bits()))
            }
            _ => None,
        }
    }

    fn is_swept(&self, swept: Swept) -> Option<Row> {
        self.of_hits(
            |hits, lane| u32::from(hits.swept(lane) == swept),
            |hit| u32::from(hit.swept == swept),
        )
    }

    /// Ends and radii of spheres and linear swept spheres.
    fn ends(&self) -> Lanes<([[f32; 3]; 2], [f32; 2])> {
        let live = &self.dispatch.limits.live;
        self.of_structures(|structure, hit, _| structure.swept_ends(hit, live))
    }

    /// `RayTmaxKHR`: the hit's distance in hit shaders, the end of the interval as it stands in the others.
    fn t_max_row(&self) -> Option<Row> {
        match (self.role, &self.subject) {
            (Role::AnyHitOfReport, _) => Some(self.of_reports(|report| report.t.to_bits())),
            (Role::Intersection, Subject::Candidates(candidates)) => {
                Some(std::array::from_fn(|lane| candidates[lane].1.to_bits()))
            }
            (Role::Intersection, Subject::Together(packet)) => {
                Some(packet.t_max().map(f32::to_bits))
            }
            _ => self.of_hits(|hits, lane| hits.t[lane].to_bits(), |hit| hit.t.to_bits()),
        }
    }

    /// A component of the ray in the instance's space: the matrix rows times the origin or the direction.
    fn object_ray_row(&self, component: usize, origin: bool) -> Row {
        let matrices = self.world_to_object();
        let (first, w) = match origin {
            true => (operand::ORIGIN, 1.0),
            false => (operand::DIRECTION, 0.0),
        };
        let vector = [0, 1, 2].map(|axis| self.of_rays(first + axis).map(f32::from_bits));
        std::array::from_fn(|lane| {
            let vector = [vector[0][lane], vector[1][lane], vector[2][lane]];
            to_object(&matrices[lane], component, &vector, w).to_bits()
        })
    }
}

/// A component of a 4 × 3 column-major shader matrix, from row-major 3 × 4 ones.
fn column_major(matrices: &Lanes<[f32; 12]>, component: usize) -> Row {
    std::array::from_fn(|lane| matrices[lane][component % 3 * 4 + component / 3].to_bits())
}
