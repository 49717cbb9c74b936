//! Filling the input records of new invocations: only the rows that their program reads, a row at a time.

use std::cell::OnceCell;

use spirv_jit::program::{AlignedRow, Builtin, IO_DATA_ROW, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, Structure, Swept};

use super::Dispatch;
use super::grid::Grid;
use super::rays::{RayInFlight, Report, to_object};
use super::slab::Slab;
use super::subgroup::{LaneRef, Role, Subgroup};
use super::table::HANDLE_SIZE;

/// What inputs are read from.
pub struct Sources<'a> {
    pub dispatch: &'a Dispatch<'a>,
    pub grid: &'a Grid,
    pub subgroups: &'a Slab<Subgroup>,
    pub rays: &'a Slab<RayInFlight>,
}

/// Per lane; lanes that were not started repeat the first one.
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
                let callers = self.callers(&subgroup.caller);
                for (row, &input) in inputs {
                    row.0 = match input {
                        InputRow::CallableData(word) => callers.gather(word as usize),
                        _ => self.common_row(subgroup, records, input),
                    };
                }
            }
            _ => {
                let hits = HitLanes::new(self.rays, subgroup);
                let callers = self.callers(&hits.rays.map(|ray| ray.caller));
                for (row, &input) in inputs {
                    row.0 = match input {
                        InputRow::Payload(word) => callers.gather(word as usize),
                        InputRow::HitAttribute(word) => hits.attribute_row(word as usize),
                        InputRow::Builtin(builtin, component) => hits
                            .row(builtin, component as usize)
                            .unwrap_or_else(|| self.common_row(subgroup, records, input)),
                        InputRow::CallableData(_) => [0; SUBGROUP_SIZE],
                    };
                }
            }
        }
    }

    /// Inputs that every stage has.
    fn common_row(&self, subgroup: &Subgroup, records: &Lanes<u64>, input: InputRow) -> Row {
        match input {
            InputRow::Builtin(Builtin::LaunchId, component) => {
                self.grid.launch_id_row(&subgroup.launch, component)
            }
            InputRow::Builtin(Builtin::ShaderRecordAddress, component) => {
                records.map(|record| ((record + HANDLE_SIZE as u64) >> (32 * component)) as u32)
            }
            _ => [0; SUBGROUP_SIZE],
        }
    }

    /// Where each lane's caller keeps its payload or callable data.
    fn callers(&self, callers: &Lanes<LaneRef>) -> Callers<'_> {
        let data = |caller: &LaneRef| {
            let subgroup = &self.subgroups[caller.subgroup];
            let program = &self.dispatch.shaders.programs[subgroup.program as usize];
            let first = program.layout().io + IO_DATA_ROW;
            &subgroup.rows[first..first + subgroup.data_words as usize]
        };
        let same = callers
            .iter()
            .all(|caller| caller.subgroup == callers[0].subgroup);
        if same {
            let lanes = callers.map(|caller| caller.lane);
            return Callers::One(data(&callers[0]), lanes);
        }
        Callers::Many(std::array::from_fn(|lane| {
            (data(&callers[lane]), callers[lane].lane)
        }))
    }
}

/// The payloads or callable data of the callers.
enum Callers<'a> {
    /// Of one subgroup, and which lane of it each is.
    One(&'a [AlignedRow], Lanes<u8>),
    Many(Lanes<(&'a [AlignedRow], u8)>),
}

impl Callers<'_> {
    /// A word of every caller's data; zero past the end of it.
    fn gather(&self, word: usize) -> Row {
        match self {
            Callers::One(data, lanes) => data.get(word).map_or([0; SUBGROUP_SIZE], |row| {
                lanes.map(|lane| row.0[lane as usize % SUBGROUP_SIZE])
            }),
            Callers::Many(callers) => callers.map(|(data, lane)| {
                data.get(word)
                    .map_or(0, |row| row.0[lane as usize % SUBGROUP_SIZE])
            }),
        }
    }
}

/// The rays of a subgroup of hit or miss shaders, and the hits that they are about.
struct HitLanes<'a> {
    role: Role,
    rays: Lanes<&'a RayInFlight>,
    hits: Lanes<&'a Hit>,
    object_to_world: OnceCell<Lanes<[f32; 12]>>,
    world_to_object: OnceCell<Lanes<[f32; 12]>>,
    vertices: OnceCell<Lanes<[[f32; 3]; 3]>>,
}

impl<'a> HitLanes<'a> {
    fn new(rays: &'a Slab<RayInFlight>, subgroup: &Subgroup) -> Self {
        let rays = subgroup.ray.map(|ray| &rays[ray]);
        Self {
            role: subgroup.role,
            rays,
            hits: rays.map(|ray| hit_of(subgroup.role, ray)),
            object_to_world: OnceCell::new(),
            world_to_object: OnceCell::new(),
            vertices: OnceCell::new(),
        }
    }

    fn attribute_row(&self, word: usize) -> Row {
        std::array::from_fn(|lane| {
            let (ray, hit) = (self.rays[lane], self.hits[lane]);
            if hit.is_built_in() {
                return hit
                    .barycentrics
                    .get(word)
                    .map_or(0, |weight| weight.to_bits());
            }
            let attributes = ray.details().map(|details| match self.role {
                Role::AnyHitOfReport => &details.report.attributes,
                _ => &details.attributes,
            });
            let found = attributes.and_then(|words| words.get(word));
            found.copied().unwrap_or(0)
        })
    }

    #[inline(always)]
    fn of_hits(&self, word: impl Fn(&Hit) -> u32) -> Option<Row> {
        Some(self.hits.map(word))
    }

    #[inline(always)]
    fn of_rays(&self, word: impl Fn(&RayInFlight) -> u32) -> Option<Row> {
        Some(self.rays.map(word))
    }

    fn of_reports(&self, word: impl Fn(&Report) -> u32) -> Option<Row> {
        Some(
            self.rays
                .map(|ray| ray.details().map_or(0, |details| word(&details.report))),
        )
    }

    /// What structures say of the hits at the rays' times.
    fn of_structures<T: Default>(&self, read: impl Fn(Structure, &Hit, f32) -> T) -> Lanes<T> {
        std::array::from_fn(|lane| {
            // SAFETY: as for the walk: the structure is built and bound until the dispatch is complete.
            let structure = unsafe { Structure::at(self.rays[lane].structure) };
            structure.map_or_else(T::default, |structure| {
                read(structure, self.hits[lane], self.rays[lane].time)
            })
        })
    }

    fn object_to_world(&self) -> &Lanes<[f32; 12]> {
        self.object_to_world.get_or_init(|| {
            self.of_structures(|structure, hit, time| {
                structure.object_to_world_at(hit.instance_index, time)
            })
        })
    }

    fn world_to_object(&self) -> &Lanes<[f32; 12]> {
        self.world_to_object.get_or_init(|| {
            self.of_structures(|structure, hit, time| {
                structure.world_to_object_at(hit.instance_index, time)
            })
        })
    }

    /// A row of a built-in that hit or miss shaders have; `None` for those that every stage has.
    fn row(&self, builtin: Builtin, component: usize) -> Option<Row> {
        match builtin {
            Builtin::PrimitiveId => self.of_hits(|hit| hit.primitive_index),
            Builtin::InstanceId => self.of_hits(|hit| hit.instance_index),
            Builtin::InstanceCustomIndex => self.of_hits(|hit| hit.instance_custom_index),
            Builtin::GeometryIndex => self.of_hits(|hit| hit.geometry_index),
            Builtin::HitKind if self.role == Role::AnyHitOfReport => {
                self.of_reports(|report| report.hit_kind as u32)
            }
            Builtin::HitKind => self.of_hits(|hit| hit.hit_kind as u32),
            Builtin::WorldRayOrigin => self.of_rays(|ray| ray.ray().origin[component].to_bits()),
            Builtin::WorldRayDirection => {
                self.of_rays(|ray| ray.ray().direction[component].to_bits())
            }
            Builtin::RayTmin => self.of_rays(|ray| ray.ray().t_min.to_bits()),
            Builtin::RayTmax => self.t_max_row(),
            Builtin::IncomingRayFlags => self.of_rays(|ray| ray.flags),
            Builtin::CullMask => self.of_rays(|ray| ray.cull_mask),
            Builtin::ObjectToWorld => Some(column_major(self.object_to_world(), component)),
            Builtin::WorldToObject => Some(column_major(self.world_to_object(), component)),
            Builtin::ObjectRayOrigin => Some(self.object_ray_row(component, true)),
            Builtin::ObjectRayDirection => Some(self.object_ray_row(component, false)),
            Builtin::HitTriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    self.of_structures(|structure, hit, time| {
                        structure.triangle_vertices_at(hit, time)
                    })
                });
                Some(std::array::from_fn(|lane| {
                    vertices[lane][component / 3][component % 3].to_bits()
                }))
            }
            Builtin::CurrentRayTime => self.of_rays(|ray| ray.time.to_bits()),
            Builtin::HitIsSphere => self.of_hits(|hit| (hit.swept == Swept::Sphere) as u32),
            Builtin::HitIsLss => self.of_hits(|hit| (hit.swept == Swept::LinearSweptSphere) as u32),
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

    /// Ends and radii of spheres and linear swept spheres.
    fn ends(&self) -> Lanes<([[f32; 3]; 2], [f32; 2])> {
        self.of_structures(|structure, hit, _| structure.swept_ends(hit))
    }

    /// `RayTmaxKHR`: the hit's distance in hit shaders, the end of the interval as it stands in the others.
    fn t_max_row(&self) -> Option<Row> {
        Some(match self.role {
            Role::AnyHit | Role::ClosestHit => self.hits.map(|hit| hit.t.to_bits()),
            Role::AnyHitOfReport => self.of_reports(|report| report.t.to_bits())?,
            _ => self.rays.map(|ray| ray.t_max().to_bits()),
        })
    }

    /// A component of the ray in the instance's space: the matrix rows times the origin or the direction.
    fn object_ray_row(&self, component: usize, origin: bool) -> Row {
        let matrices = self.world_to_object();
        std::array::from_fn(|lane| {
            let ray = self.rays[lane].ray();
            let (vector, w) = if origin {
                (&ray.origin, 1.0)
            } else {
                (&ray.direction, 0.0)
            };
            to_object(&matrices[lane], component, vector, w).to_bits()
        })
    }
}

/// A component of a 4 × 3 column-major shader matrix, from row-major 3 × 4 ones.
fn column_major(matrices: &Lanes<[f32; 12]>, component: usize) -> Row {
    std::array::from_fn(|lane| matrices[lane][component % 3 * 4 + component / 3].to_bits())
}

/// The hit that an invocation of this role is about. Where it is about a report, this is the box.
#[inline(always)]
fn hit_of(role: Role, ray: &RayInFlight) -> &Hit {
    static NONE: Hit = Hit::NONE;
    match role {
        Role::AnyHit | Role::Intersection | Role::AnyHitOfReport => ray.walk().candidate(),
        _ => ray.committed().unwrap_or(&NONE),
    }
}
