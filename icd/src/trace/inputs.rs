//! Filling the input records of new invocations: only the rows that their program reads, a row at a time.

use std::cell::OnceCell;

use spirv_jit::program::{AlignedRow, Builtin, IO_DATA_ROW, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, Structure, Swept};

use super::Dispatch;
use super::grid::Grid;
use super::rays::{RayInFlight, to_object};
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
    /// Fills the inputs of `subgroup`, which is not yet among the others. `records` has a record address per lane.
    pub fn fill(&self, program: &Program, subgroup: &mut Subgroup, records: &Lanes<u64>) {
        let first = program.layout().inputs;
        match subgroup.role {
            Role::RayGeneration => {
                for (index, &input) in program.inputs().iter().enumerate() {
                    subgroup.rows[first + index].0 = self.common_row(subgroup, records, input);
                }
            }
            Role::Callable => {
                let callers = self.callers(&subgroup.caller);
                for (index, &input) in program.inputs().iter().enumerate() {
                    subgroup.rows[first + index].0 = match input {
                        InputRow::CallableData(word) => gather(&callers, word),
                        _ => self.common_row(subgroup, records, input),
                    };
                }
            }
            _ => {
                let hits = HitLanes::new(self.rays, subgroup);
                let callers = self.callers(&hits.rays.map(|ray| ray.caller));
                for (index, &input) in program.inputs().iter().enumerate() {
                    subgroup.rows[first + index].0 = match input {
                        InputRow::Payload(word) => gather(&callers, word),
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
            InputRow::Builtin(Builtin::LaunchId, component) => subgroup
                .launch
                .map(|launch| self.grid.launch_id(launch)[component as usize]),
            InputRow::Builtin(Builtin::ShaderRecordAddress, component) => {
                records.map(|record| ((record + HANDLE_SIZE as u64) >> (32 * component)) as u32)
            }
            _ => [0; SUBGROUP_SIZE],
        }
    }

    /// Where each lane's caller keeps its payload or callable data.
    fn callers(&self, callers: &Lanes<LaneRef>) -> Lanes<Data<'_>> {
        callers.map(|caller| {
            let subgroup = &self.subgroups[caller.subgroup];
            let program = &self.dispatch.shaders.programs[subgroup.program as usize];
            let first = program.layout().io + IO_DATA_ROW;
            Data {
                rows: &subgroup.rows[first..first + subgroup.data_words as usize],
                lane: caller.lane as usize,
            }
        })
    }
}

/// The payload or callable data of one caller.
#[derive(Clone, Copy)]
struct Data<'a> {
    rows: &'a [AlignedRow],
    lane: usize,
}

/// A word of every caller's data; zero past the end of it.
fn gather(callers: &Lanes<Data<'_>>, word: u32) -> Row {
    callers.map(|data| {
        data.rows
            .get(word as usize)
            .map_or(0, |row| row.0[data.lane])
    })
}

/// The rays of a subgroup of hit or miss shaders, and the hits that they are about.
struct HitLanes<'a> {
    role: Role,
    rays: Lanes<&'a RayInFlight>,
    hits: Lanes<Hit>,
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
            let (ray, hit) = (self.rays[lane], &self.hits[lane]);
            if hit.is_built_in() {
                return hit
                    .barycentrics
                    .get(word)
                    .map_or(0, |weight| weight.to_bits());
            }
            let attributes = match self.role {
                Role::AnyHitOfReport => &ray.report.attributes,
                _ => &ray.attributes,
            };
            attributes.get(word).copied().unwrap_or(0)
        })
    }

    fn of_hits(&self, word: impl Fn(&Hit) -> u32) -> Option<Row> {
        Some(std::array::from_fn(|lane| word(&self.hits[lane])))
    }

    fn of_rays(&self, word: impl Fn(&RayInFlight) -> u32) -> Option<Row> {
        Some(std::array::from_fn(|lane| word(self.rays[lane])))
    }

    /// What structures say of the hits at the rays' times.
    fn of_structures<T: Default>(&self, read: impl Fn(Structure, &Hit, f32) -> T) -> Lanes<T> {
        std::array::from_fn(|lane| {
            // SAFETY: as for the walk: the structure is built and bound until the dispatch is complete.
            let structure = unsafe { Structure::at(self.rays[lane].structure) };
            structure.map_or_else(T::default, |structure| {
                read(structure, &self.hits[lane], self.rays[lane].time)
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
            Builtin::HitKind => self.of_hits(|hit| hit.hit_kind as u32),
            Builtin::WorldRayOrigin => self.of_rays(|ray| ray.ray().origin[component].to_bits()),
            Builtin::WorldRayDirection => {
                self.of_rays(|ray| ray.ray().direction[component].to_bits())
            }
            Builtin::RayTmin => self.of_rays(|ray| ray.ray().t_min.to_bits()),
            Builtin::RayTmax => Some(self.t_max_row()),
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
    fn t_max_row(&self) -> Row {
        match self.role {
            Role::AnyHit | Role::AnyHitOfReport | Role::ClosestHit => {
                self.hits.map(|hit| hit.t.to_bits())
            }
            _ => self.rays.map(|ray| ray.t_max().to_bits()),
        }
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

/// The hit that an invocation of this role is about.
fn hit_of(role: Role, ray: &RayInFlight) -> Hit {
    match role {
        Role::AnyHit | Role::Intersection => *ray.walk().candidate(),
        Role::AnyHitOfReport => Hit {
            t: ray.report.t,
            hit_kind: ray.report.hit_kind,
            ..*ray.walk().candidate()
        },
        _ => ray.committed().copied().unwrap_or_default(),
    }
}
