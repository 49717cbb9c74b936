//! Filling the input records of new invocations: only the rows that their program reads.

use spirv_jit::program::{AlignedRow, Builtin, IO_DATA_ROW, InputRow};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, Structure};

use super::Dispatch;
use super::grid::Grid;
use super::rays::{MAX_ATTRIBUTE_WORDS, RayInFlight};
use super::slab::Slab;
use super::subgroup::{LaneRef, Role, Subgroup, lanes_of};
use super::table::HANDLE_SIZE;

/// What inputs are read from.
pub struct Sources<'a> {
    pub dispatch: &'a Dispatch<'a>,
    pub grid: &'a Grid,
    pub subgroups: &'a Slab<Subgroup>,
    pub rays: &'a Slab<RayInFlight>,
}

impl Sources<'_> {
    /// Fills the inputs of `subgroup`, which is not yet among the others. `records` has a record address per lane.
    pub fn fill(&self, program: &Program, subgroup: &mut Subgroup, records: &[u64; SUBGROUP_SIZE]) {
        let first = program.layout().inputs;
        for (index, &input) in program.inputs().iter().enumerate() {
            let mut row = AlignedRow::default();
            for lane in lanes_of(subgroup.lanes) {
                row.0[lane] = match input {
                    InputRow::Payload(word) => {
                        self.data(self.rays[subgroup.ray[lane]].caller, word)
                    }
                    InputRow::CallableData(word) => self.data(subgroup.caller[lane], word),
                    InputRow::HitAttribute(word) => self.attribute(subgroup, lane, word),
                    InputRow::Builtin(builtin, component) => {
                        self.builtin(subgroup, lane, records[lane], builtin, component as usize)
                    }
                };
            }
            subgroup.rows[first + index] = row;
        }
    }

    /// A word of the payload or callable data that `caller` handed over.
    fn data(&self, caller: LaneRef, word: u32) -> u32 {
        let from = &self.subgroups[caller.subgroup];
        from.data(
            &self.dispatch.shaders.programs[from.program as usize],
            word,
            caller.lane as usize,
        )
    }

    fn attribute(&self, subgroup: &Subgroup, lane: usize, word: u32) -> u32 {
        let ray = &self.rays[subgroup.ray[lane]];
        let hit = hit_of(subgroup.role, ray);
        let word = word as usize;
        if hit.triangle {
            return hit
                .barycentrics
                .get(word)
                .map_or(0, |weight| weight.to_bits());
        }
        let attributes = match subgroup.role {
            Role::AnyHitOfReport => &ray.report.attributes,
            _ => &ray.attributes,
        };
        attributes.get(word).copied().unwrap_or(0)
    }

    fn builtin(
        &self,
        subgroup: &Subgroup,
        lane: usize,
        record: u64,
        builtin: Builtin,
        component: usize,
    ) -> u32 {
        match builtin {
            Builtin::LaunchId => return self.grid.launch_id(subgroup.launch[lane])[component],
            Builtin::ShaderRecordAddress => {
                return ((record + HANDLE_SIZE as u64) >> (32 * component)) as u32;
            }
            _ if matches!(subgroup.role, Role::RayGeneration | Role::Callable) => return 0,
            _ => {}
        }
        let in_flight = &self.rays[subgroup.ray[lane]];
        let ray = in_flight.walk().ray();
        let hit = hit_of(subgroup.role, in_flight);
        match builtin {
            Builtin::PrimitiveId => hit.primitive_index,
            Builtin::InstanceId => hit.instance_index,
            Builtin::InstanceCustomIndex => hit.instance_custom_index,
            Builtin::GeometryIndex => hit.geometry_index,
            Builtin::WorldRayOrigin => ray.origin[component].to_bits(),
            Builtin::WorldRayDirection => ray.direction[component].to_bits(),
            Builtin::RayTmin => ray.t_min.to_bits(),
            Builtin::RayTmax => t_max(subgroup.role, in_flight, &hit).to_bits(),
            Builtin::IncomingRayFlags => in_flight.flags,
            Builtin::CullMask => in_flight.cull_mask,
            Builtin::HitKind => hit.hit_kind as u32,
            _ => self
                .instance_builtin(in_flight, &hit, builtin, component)
                .to_bits(),
        }
    }

    /// Built-ins that need the instance.
    fn instance_builtin(
        &self,
        in_flight: &RayInFlight,
        hit: &Hit,
        builtin: Builtin,
        component: usize,
    ) -> f32 {
        // SAFETY: as for the walk: the structure is built and bound until the dispatch is complete.
        let Some(structure) = (unsafe { Structure::at(in_flight.structure) }) else {
            return 0.0;
        };
        let ray = in_flight.walk().ray();
        // The matrices are row-major 3 × 4 in the structure and column-major 4 × 3 in the shader.
        let column_major = |matrix: [f32; 12]| matrix[component % 3 * 4 + component / 3];
        let world_to_object = |point: [f32; 3], w: f32| {
            let row = &structure.world_to_object(hit.instance_index)[component * 4..][..4];
            row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3] * w
        };
        match builtin {
            Builtin::ObjectToWorld => column_major(structure.object_to_world(hit.instance_index)),
            Builtin::WorldToObject => column_major(structure.world_to_object(hit.instance_index)),
            Builtin::ObjectRayOrigin => world_to_object(ray.origin, 1.0),
            Builtin::ObjectRayDirection => world_to_object(ray.direction, 0.0),
            Builtin::HitTriangleVertexPositions => {
                structure.triangle_vertices(hit)[component / 3][component % 3]
            }
            _ => 0.0,
        }
    }
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
        _ => ray.walk().committed().copied().unwrap_or_default(),
    }
}

/// `RayTmaxKHR`: the hit's distance in hit shaders, the end of the interval as it stands in the others.
fn t_max(role: Role, ray: &RayInFlight, hit: &Hit) -> f32 {
    match role {
        Role::AnyHit | Role::AnyHitOfReport | Role::ClosestHit => hit.t,
        _ => ray.walk().t_max(),
    }
}

/// The attribute words of a report, from the yield's operands.
pub fn reported_attributes(
    subgroup: &Subgroup,
    program: &Program,
    words: u32,
    lane: usize,
) -> [u32; MAX_ATTRIBUTE_WORDS] {
    std::array::from_fn(|word| {
        if (word as u32) < words {
            subgroup.io(program, IO_DATA_ROW + word, lane)
        } else {
            0
        }
    })
}
