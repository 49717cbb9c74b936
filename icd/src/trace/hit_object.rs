//! Hit objects: filled by a trace, asked about, executed.

use lanes::LaneMask;
use spirv_jit::facts::Fact;
use spirv_jit::hit_object::{IDENTITY, TRACED, kind, primitive, word};
use spirv_jit::program::{IO_DATA_ROW, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::{Hit, Structure, Swept};

use super::batch::{Batch, Worker};
use super::rays::{Operands, RayGroup, operand, record_indices};
use super::subgroup::{Subgroup, SubgroupIndex};
use crate::wave::binding_table::HANDLE_SIZE;
use crate::wave::hit_facts::{CachedFacts, Lanes, OfHit, Subjects, hit_word, take};
use crate::wave::observer::Instruction;
use crate::wave::{Limits, Stopped};

impl Batch<'_> {
    /// Walks are over: what they found goes to the caller, no shader runs.
    pub(super) fn fill_hit_objects(&mut self, index: u32, lanes: LaneMask) {
        let Worker {
            ray_groups,
            subgroups,
            ..
        } = &mut *self.worker;
        let group = &ray_groups[index];
        let operands = group.operands(subgroups);
        let records = record_indices(self.dispatch.tier, &group.group_walk.hits, operands);
        for lane in lanes {
            let object = found_by(group, group.operands(subgroups), records[lane], lane);
            let subgroup = &mut subgroups[group.caller];
            for (row, &word) in TRACED.iter().enumerate() {
                subgroup.rows[group.io + row].0[lane] = object[word];
            }
        }
        self.finish_rays(index, lanes);
    }

    /// Calls the closest-hit or miss shaders of hit objects; an empty one has none.
    pub(super) fn execute_hit_objects(
        &mut self,
        index: SubgroupIndex,
        lanes: LaneMask,
    ) -> Result<(), Stopped> {
        let worker = &mut *self.worker;
        let subgroup = &worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let group_index = worker.ray_groups.take();
        let group = &mut worker.ray_groups[group_index];
        group.start(index, program.layout().io, lanes);
        group.record();
        let mut empty = LaneMask::NONE;
        for lane in lanes {
            let object = HitObject::of_execute(subgroup, program, lane);
            if object.state() == kind::EMPTY {
                empty.insert(lane);
                continue;
            }
            let mut sbt_offset = 0;
            group.group_walk.hits.t[lane] = f32::from_bits(object.0[word::T_MAX]);
            if object.state() == kind::HIT {
                let hit = object.hit(self.dispatch.limits);
                // The record's index is given: one that the rule for hits leads back to, with a
                // stride of 0.
                sbt_offset = object.0[word::RECORD_INDEX].wrapping_sub(hit.instance_sbt_offset);
                group.group_walk.hits.set(lane, &hit);
                let attributes = &mut group.procedural_mut().attributes;
                for (attribute, word) in attributes.iter_mut().zip(&object.0[word::ATTRIBUTES..]) {
                    attribute[lane] = *word;
                }
            }
            let words = [
                (operand::STRUCTURE, object.0[word::STRUCTURE]),
                (operand::STRUCTURE + 1, object.0[word::STRUCTURE + 1]),
                (operand::FLAGS, object.0[word::FLAGS]),
                (operand::CULL_MASK, object.0[word::KIND] >> 8 & 0xff),
                (operand::SBT_OFFSET, sbt_offset),
                (operand::SBT_STRIDE, 0),
                (operand::MISS_INDEX, object.0[word::RECORD_INDEX]),
                (operand::T_MIN, object.0[word::T_MIN]),
                (operand::T_MAX, object.0[word::T_MAX]),
                (operand::TIME, object.0[word::TIME]),
            ];
            let operands = group.recorded_mut();
            for (row, word) in words {
                operands[row].0[lane] = word;
            }
            for axis in 0..3 {
                operands[operand::ORIGIN + axis].0[lane] = object.0[word::ORIGIN + axis];
                operands[operand::DIRECTION + axis].0[lane] = object.0[word::DIRECTION + axis];
            }
        }
        group.in_flight -= empty;
        match group.in_flight {
            LaneMask::NONE => worker.ray_groups.remove(group_index),
            _ => {
                if self.is_watched {
                    self.watch_ray(group_index, Instruction::HitObjectExecute);
                }
                self.end_walks(group_index)?;
            }
        }
        if !empty.is_empty() {
            self.answered(index, empty);
        }
        Ok(())
    }

    /// Answers a question about a hit at once.
    pub(super) fn answer_fact(&mut self, index: SubgroupIndex, lane: usize, fact: Fact) {
        let subgroup = &mut self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let mut object = HitObject([0; word::COUNT]);
        for (row, &index) in IDENTITY.iter().enumerate() {
            object.0[index] = subgroup.io(program, row, lane);
        }
        let limits = self.dispatch.limits;
        let mut answer = [0; IO_DATA_ROW];
        let tables = &self.dispatch.tables;
        match fact {
            Fact::ShaderRecord => {
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
            _ => {
                let subject = HitObjectSubject {
                    hit: object.hit(limits),
                    object: &object,
                };
                let cached = CachedFacts::default();
                for (component, word) in answer[..fact.words()].iter_mut().enumerate() {
                    *word = take(fact, component, OfHit(&subject.hit))
                        .unwrap_or_else(|| cached.row(&subject, limits, fact, component)[0]);
                }
            }
        }
        for (row, &value) in answer[..fact.words()].iter().enumerate() {
            subgroup.set_io(program, row, lane, value);
        }
    }
}

/// The words of the hit object that a trace fills.
fn found_by(group: &RayGroup, operands: &Operands, record: u32, lane: usize) -> [u32; word::COUNT] {
    let mut object = [0; word::COUNT];
    object[word::RECORD_INDEX] = record;
    let state = match group.group_walk.hits.get(lane) {
        Some(hit) => {
            object[word::T_MAX] = hit.t.to_bits();
            object[word::INSTANCE] = hit.instance_index;
            object[word::GEOMETRY] = hit.geometry_index;
            object[word::PRIMITIVE] = hit.primitive_index;
            object[word::HIT_KIND] = hit_word(&hit);
            object[word::SLOT] = hit.slot;
            let attributes = &mut object[word::ATTRIBUTES..];
            if hit.is_built_in() {
                attributes[..2].copy_from_slice(&hit.barycentrics.map(f32::to_bits));
            } else if let Some(procedural) = group.procedural() {
                for (word, attribute) in attributes.iter_mut().zip(&procedural.attributes) {
                    *word = attribute[lane];
                }
            }
            kind::HIT
        }
        None => {
            object[word::T_MAX] = operands[operand::T_MAX].0[lane];
            kind::MISS
        }
    };
    object[word::KIND] = state | (operands[operand::CULL_MASK].0[lane] & 0xff) << 8;
    object
}

/// The words of one lane's hit object.
struct HitObject([u32; word::COUNT]);

impl HitObject {
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

    fn structure(&self) -> u64 {
        self.0[word::STRUCTURE] as u64 | (self.0[word::STRUCTURE + 1] as u64) << 32
    }

    fn hit(&self, limits: &Limits) -> Hit {
        let primitive = self.0[word::HIT_KIND] >> 8 & 0xff;
        let instance_index = self.0[word::INSTANCE];
        let (instance_custom_index, instance_sbt_offset) = self.read(limits, |structure| {
            structure.instance_indices(instance_index)
        });
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

    fn read<T: Default>(&self, limits: &Limits, read: impl Fn(Structure) -> T) -> T {
        limits
            .structure(self.structure())
            .map_or_else(T::default, read)
    }
}

/// The contents of a hit object, as lane 0.
struct HitObjectSubject<'a> {
    hit: Hit,
    object: &'a HitObject,
}

impl Subjects for HitObjectSubject<'_> {
    fn lanes(&self) -> LaneMask {
        LaneMask::of(0)
    }

    fn structures(&self) -> [Row; 2] {
        let address = self.object.structure();
        [address as u32, (address >> 32) as u32].map(|word| [word; SUBGROUP_SIZE])
    }

    fn times(&self) -> Lanes<f32> {
        [f32::from_bits(self.object.0[word::TIME]); SUBGROUP_SIZE]
    }

    fn instances(&self) -> Row {
        [self.hit.instance_index; SUBGROUP_SIZE]
    }

    fn hit(&self, _: usize) -> Hit {
        self.hit
    }

    fn origins(&self) -> [Lanes<f32>; 3] {
        [0, 1, 2].map(|axis| [f32::from_bits(self.object.0[word::ORIGIN + axis]); SUBGROUP_SIZE])
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        [0, 1, 2].map(|axis| [f32::from_bits(self.object.0[word::DIRECTION + axis]); SUBGROUP_SIZE])
    }
}
