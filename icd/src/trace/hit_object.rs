//! Hit objects: filled by a trace, asked about, executed.

use spirv_jit::Program;
use spirv_jit::hit_object::{HitFact, IDENTITY, TRACED, kind, primitive, word};
use spirv_jit::program::IO_DATA_ROW;
use traversal::{Hit, Ray, Structure, Swept};

use super::Limits;
use super::batch::Batch;
use super::rays::Recorded;
use super::subgroup::{LaneRef, Subgroup};
use super::table::HANDLE_SIZE;

impl Batch<'_> {
    /// A walk is over: what it found goes to the caller, no shader runs.
    pub(super) fn fill_hit_object(&mut self, index: u32) {
        let ray = &self.worker.rays[index];
        let caller = ray.caller;
        let mut object = [0; word::COUNT];
        let state = match ray.committed() {
            Some(hit) => {
                object[word::T_MAX] = hit.t.to_bits();
                object[word::RECORD_INDEX] = ray.hit_record_index(hit);
                object[word::INSTANCE] = hit.instance_index;
                object[word::GEOMETRY] = hit.geometry_index;
                object[word::PRIMITIVE] = hit.primitive_index;
                object[word::HIT_KIND] = hit.hit_kind as u32 | primitive_of(hit) << 8;
                object[word::SLOT] = hit.slot;
                let attributes = &mut object[word::ATTRIBUTES..];
                if hit.is_built_in() {
                    attributes[..2].copy_from_slice(&hit.barycentrics.map(f32::to_bits));
                } else {
                    let details = ray.details();
                    attributes
                        .copy_from_slice(&details.map_or_else(Default::default, |d| d.attributes));
                }
                kind::HIT
            }
            None => {
                object[word::T_MAX] = ray.t_max().to_bits();
                object[word::RECORD_INDEX] = ray.miss_index;
                kind::MISS
            }
        };
        object[word::KIND] = state | ray.cull_mask << 8;
        let subgroup = &mut self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        for (row, &index) in TRACED.iter().enumerate() {
            subgroup.set_io(program, row, caller.lane as usize, object[index]);
        }
        self.finish_ray(index);
    }

    /// Calls the closest-hit or miss shader of a hit object; an empty one has none.
    pub(super) fn execute_hit_object(&mut self, caller: LaneRef) {
        let subgroup = &self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let object = Object::of_execute(subgroup, program, caller.lane as usize)
            .confined(self.dispatch.limits);
        if object.state() == kind::EMPTY {
            return self.answered(caller);
        }
        let launch = subgroup.launch[caller.lane as usize];
        let index = self.worker.rays.take();
        let ray = &mut self.worker.rays[index];
        ray.caller = caller;
        ray.launch = launch;
        ray.structure = object.structure();
        ray.flags = object.0[word::FLAGS];
        ray.cull_mask = object.0[word::KIND] >> 8 & 0xff;
        ray.fills_hit_object = false;
        ray.time = object.time();
        // The record's index is given: one that the rule for hits, with these, leads back to.
        ray.sbt_stride = 0;
        ray.miss_index = object.0[word::RECORD_INDEX];
        let hit = (object.state() == kind::HIT).then(|| object.hit());
        ray.sbt_offset = match &hit {
            Some(hit) => object.0[word::RECORD_INDEX].wrapping_sub(hit.instance_sbt_offset),
            None => 0,
        };
        ray.is_recorded = true;
        let details = ray.details_mut();
        details
            .attributes
            .copy_from_slice(&object.0[word::ATTRIBUTES..]);
        details.recorded = Recorded {
            ray: object.ray(),
            hit,
        };
        self.end_walk(index);
    }

    /// Answers a question about a hit at once.
    pub(super) fn answer_fact(&mut self, caller: LaneRef, fact: HitFact) {
        let lane = caller.lane as usize;
        let subgroup = &mut self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let mut object = Object([0; word::COUNT]);
        for (row, &index) in IDENTITY.iter().enumerate() {
            object.0[index] = subgroup.io(program, row, lane);
        }
        let object = object.confined(self.dispatch.limits);
        let mut answer = [0; IO_DATA_ROW];
        let tables = &self.dispatch.tables;
        match fact {
            HitFact::Instance => {
                let hit = object.hit();
                answer[0] = hit.instance_custom_index;
                answer[1] = hit.instance_sbt_offset;
            }
            HitFact::ObjectToWorld => {
                let matrix =
                    object.read(|s| s.object_to_world_at(object.0[word::INSTANCE], object.time()));
                answer[..12].copy_from_slice(&column_major(&matrix));
            }
            HitFact::WorldToObject => {
                let matrix =
                    object.read(|s| s.world_to_object_at(object.0[word::INSTANCE], object.time()));
                answer[..12].copy_from_slice(&column_major(&matrix));
            }
            HitFact::TriangleVertexPositions => {
                let vertices =
                    object.read(|s| s.triangle_vertices_at(&object.hit(), object.time()));
                for (place, coordinate) in answer.iter_mut().zip(vertices.as_flattened()) {
                    *place = coordinate.to_bits();
                }
            }
            HitFact::SweptEnds => {
                let (positions, radii) = object.read(|s| s.swept_ends(&object.hit()));
                let numbers = positions.as_flattened().iter().chain(&radii);
                for (place, number) in answer.iter_mut().zip(numbers) {
                    *place = number.to_bits();
                }
            }
            HitFact::ShaderRecord => {
                let table = match object.state() {
                    kind::HIT => &tables.hit,
                    _ => &tables.miss,
                };
                let record = match object.state() {
                    kind::EMPTY => None,
                    _ => table.record(object.0[word::RECORD_INDEX]),
                };
                let data = record.map_or(0, |record| record + HANDLE_SIZE as u64);
                answer[0] = data as u32;
                answer[1] = (data >> 32) as u32;
            }
        }
        for (row, &value) in answer[..fact.words()].iter().enumerate() {
            subgroup.set_io(program, row, lane, value);
        }
        self.answered(caller);
    }
}

/// What was hit, as a hit object says it.
pub fn primitive_of(hit: &Hit) -> u32 {
    match hit.swept {
        Swept::Sphere => primitive::SPHERE,
        Swept::LinearSweptSphere => primitive::LINEAR_SWEPT_SPHERE,
        Swept::No if hit.triangle => primitive::TRIANGLE,
        Swept::No => primitive::BOX,
    }
}

/// The words of one lane's hit object.
struct Object([u32; word::COUNT]);

impl Object {
    /// As an execute instruction has it: see `SiteKind::HitObjectExecute`.
    fn of_execute(subgroup: &Subgroup, program: &Program, lane: usize) -> Self {
        let behind = subgroup.data_words as usize;
        Self(std::array::from_fn(|index| {
            let row = if index < IO_DATA_ROW {
                index
            } else {
                index + behind
            };
            subgroup.io(program, row, lane)
        }))
    }

    fn state(&self) -> u32 {
        self.0[word::KIND] & kind::MASK
    }

    fn time(&self) -> f32 {
        f32::from_bits(self.0[word::TIME])
    }

    /// Forgets a structure that leads nowhere.
    fn confined(mut self, limits: &Limits) -> Self {
        let structure = limits.structure(self.structure());
        self.0[word::STRUCTURE] = structure as u32;
        self.0[word::STRUCTURE + 1] = (structure >> 32) as u32;
        self
    }

    fn structure(&self) -> u64 {
        self.0[word::STRUCTURE] as u64 | (self.0[word::STRUCTURE + 1] as u64) << 32
    }

    fn ray(&self) -> Ray {
        let float = |index: usize| f32::from_bits(self.0[index]);
        Ray {
            origin: [0, 1, 2].map(|axis| float(word::ORIGIN + axis)),
            t_min: float(word::T_MIN),
            direction: [0, 1, 2].map(|axis| float(word::DIRECTION + axis)),
            t_max: float(word::T_MAX),
            flags: self.0[word::FLAGS],
            cull_mask: self.0[word::KIND] >> 8 & 0xff,
        }
    }

    fn hit(&self) -> Hit {
        let primitive = self.0[word::HIT_KIND] >> 8 & 0xff;
        let instance_index = self.0[word::INSTANCE];
        let (instance_custom_index, instance_sbt_offset) =
            self.read(|structure| structure.instance_indices(instance_index));
        Hit {
            t: f32::from_bits(self.0[word::T_MAX]),
            barycentrics: [0, 1].map(|i| f32::from_bits(self.0[word::ATTRIBUTES + i])),
            instance_index,
            instance_custom_index,
            instance_sbt_offset,
            geometry_index: self.0[word::GEOMETRY],
            primitive_index: self.0[word::PRIMITIVE],
            slot: self.0[word::SLOT],
            hit_kind: self.0[word::HIT_KIND] as u8,
            opaque: false,
            triangle: primitive == primitive::TRIANGLE,
            swept: match primitive {
                primitive::SPHERE => Swept::Sphere,
                primitive::LINEAR_SWEPT_SPHERE => Swept::LinearSweptSphere,
                _ => Swept::No,
            },
        }
    }

    fn read<T: Default>(&self, read: impl Fn(Structure) -> T) -> T {
        // SAFETY: as for the walk: the structure is built and bound until the dispatch is complete.
        unsafe { Structure::at(self.structure()) }.map_or_else(T::default, read)
    }
}

/// The words of a 4 × 3 column-major shader matrix, from a row-major 3 × 4 one.
fn column_major(matrix: &[f32; 12]) -> [u32; 12] {
    std::array::from_fn(|word| matrix[word % 3 * 4 + word / 3].to_bits())
}
