//! Hit objects and reordering (`SPV_EXT_shader_invocation_reorder`,
//! `SPV_NV_shader_invocation_reorder`).

mod record;

use rspirv::spirv::Op;

use super::values::Pointer;
use super::{Lowerer, facts};
use crate::Error;
use crate::facts::Fact;
use crate::hit_object::{IDENTITY, TRACED, kind, primitive, word};
use crate::ir::stage::Stage;
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

/// The effect of an instruction on a hit object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Action {
    Trace {
        motion: bool,
    },
    Execute,
    Reorder,
    ReorderWithHint,
    ReorderExecute,
    TraceReorderExecute {
        motion: bool,
    },
    RecordEmpty,
    RecordMiss {
        with_flags: bool,
        motion: bool,
    },
    RecordHit {
        with_index: bool,
        motion: bool,
    },
    RecordFromQuery,
    SetRecordIndex,
    CopyAttributes,
    /// Whether the hit object is of this kind.
    Is(u32),
    /// These words, unchanged.
    Words {
        first: usize,
        count: usize,
    },
    HitKind,
    /// Whether a primitive of this kind was hit.
    IsPrimitive(u32),
    /// The first words of a fact, as many as the result's type has.
    Fact(Fact),
    ObjectRay {
        origin: bool,
    },
}

/// The table of instructions.
fn action(opcode: Op) -> Option<Action> {
    use Action::*;
    let words = |first, count| Words { first, count };
    let record_miss = |with_flags, motion| RecordMiss { with_flags, motion };
    let record_hit = |with_index, motion| RecordHit { with_index, motion };
    Some(match opcode {
        Op::HitObjectTraceRayNV | Op::HitObjectTraceRayEXT => Trace { motion: false },
        Op::HitObjectTraceRayMotionNV | Op::HitObjectTraceRayMotionEXT => Trace { motion: true },
        Op::HitObjectExecuteShaderNV | Op::HitObjectExecuteShaderEXT => Execute,
        Op::ReorderThreadWithHitObjectNV | Op::ReorderThreadWithHitObjectEXT => Reorder,
        Op::ReorderThreadWithHintNV | Op::ReorderThreadWithHintEXT => ReorderWithHint,
        Op::HitObjectReorderExecuteShaderEXT => ReorderExecute,
        Op::HitObjectTraceReorderExecuteEXT => TraceReorderExecute { motion: false },
        Op::HitObjectTraceMotionReorderExecuteEXT => TraceReorderExecute { motion: true },
        Op::HitObjectRecordEmptyNV | Op::HitObjectRecordEmptyEXT => RecordEmpty,
        Op::HitObjectRecordMissNV => record_miss(false, false),
        Op::HitObjectRecordMissMotionNV => record_miss(false, true),
        Op::HitObjectRecordMissEXT => record_miss(true, false),
        Op::HitObjectRecordMissMotionEXT => record_miss(true, true),
        Op::HitObjectRecordHitNV => record_hit(false, false),
        Op::HitObjectRecordHitMotionNV => record_hit(false, true),
        Op::HitObjectRecordHitWithIndexNV => record_hit(true, false),
        Op::HitObjectRecordHitWithIndexMotionNV => record_hit(true, true),
        Op::HitObjectGetCurrentTimeNV | Op::HitObjectGetCurrentTimeEXT => words(word::TIME, 1),
        Op::HitObjectRecordFromQueryEXT => RecordFromQuery,
        Op::HitObjectSetShaderBindingTableRecordIndexEXT => SetRecordIndex,
        Op::HitObjectGetAttributesNV | Op::HitObjectGetAttributesEXT => CopyAttributes,
        Op::HitObjectIsEmptyNV | Op::HitObjectIsEmptyEXT => Is(kind::EMPTY),
        Op::HitObjectIsMissNV | Op::HitObjectIsMissEXT => Is(kind::MISS),
        Op::HitObjectIsHitNV | Op::HitObjectIsHitEXT => Is(kind::HIT),
        Op::HitObjectGetRayTMinNV | Op::HitObjectGetRayTMinEXT => words(word::T_MIN, 1),
        Op::HitObjectGetRayTMaxNV | Op::HitObjectGetRayTMaxEXT => words(word::T_MAX, 1),
        Op::HitObjectGetRayFlagsEXT => words(word::FLAGS, 1),
        Op::HitObjectGetWorldRayOriginNV | Op::HitObjectGetWorldRayOriginEXT => {
            words(word::ORIGIN, 3)
        }
        Op::HitObjectGetWorldRayDirectionNV | Op::HitObjectGetWorldRayDirectionEXT => {
            words(word::DIRECTION, 3)
        }
        Op::HitObjectGetInstanceIdNV | Op::HitObjectGetInstanceIdEXT => words(word::INSTANCE, 1),
        Op::HitObjectGetGeometryIndexNV | Op::HitObjectGetGeometryIndexEXT => {
            words(word::GEOMETRY, 1)
        }
        Op::HitObjectGetPrimitiveIndexNV | Op::HitObjectGetPrimitiveIndexEXT => {
            words(word::PRIMITIVE, 1)
        }
        Op::HitObjectGetShaderBindingTableRecordIndexNV
        | Op::HitObjectGetShaderBindingTableRecordIndexEXT => words(word::RECORD_INDEX, 1),
        Op::HitObjectIsSphereHitNV => IsPrimitive(primitive::SPHERE),
        Op::HitObjectIsLSSHitNV => IsPrimitive(primitive::LINEAR_SWEPT_SPHERE),
        Op::HitObjectGetHitKindNV | Op::HitObjectGetHitKindEXT => HitKind,
        Op::HitObjectGetObjectRayOriginNV | Op::HitObjectGetObjectRayOriginEXT => {
            ObjectRay { origin: true }
        }
        Op::HitObjectGetObjectRayDirectionNV | Op::HitObjectGetObjectRayDirectionEXT => {
            ObjectRay { origin: false }
        }
        _ => return facts::of_hit_object(opcode).map(Fact),
    })
}

/// Whether this file lowers an opcode.
pub(super) fn is_hit_object(opcode: Op) -> bool {
    action(opcode).is_some()
}

impl Lowerer<'_> {
    pub(super) fn lower_hit_object(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let Some(action) = action(instruction.opcode) else {
            return Err(self.unsupported(instruction));
        };
        self.check_reorder_stage(action)?;
        if action == Action::ReorderWithHint {
            return self.reorder(None, operands);
        }
        let pointer = self.pointer(operands[0])?;
        let mut object = self.load(&pointer)?;
        if object.len() != word::COUNT {
            return Err(self.b.invalid("this is not a hit object"));
        }
        let rest = &operands[1..];
        let result = match action {
            Action::Trace { motion } => return self.hit_object_trace(&pointer, rest, motion),
            Action::Execute => return self.hit_object_execute(&object, rest[0]),
            Action::Reorder => return self.reorder(Some(&object), rest),
            Action::ReorderWithHint => return Ok(()),
            Action::ReorderExecute => {
                self.reorder(Some(&object), &rest[1..])?;
                return self.hit_object_execute(&object, rest[0]);
            }
            Action::TraceReorderExecute { motion } => {
                self.hit_object_trace(&pointer, rest, motion)?;
                let object = self.load(&pointer)?;
                let payload = 10 + usize::from(motion);
                self.reorder(Some(&object), &rest[payload + 1..])?;
                return self.hit_object_execute(&object, rest[payload]);
            }
            Action::RecordEmpty => {
                let empty = self.empty_hit_object();
                return self.store(&pointer, &empty);
            }
            Action::RecordMiss { with_flags, motion } => {
                return self.record_miss(&pointer, rest, with_flags, motion);
            }
            Action::RecordHit { with_index, motion } => {
                return self.record_hit(&pointer, rest, with_index, motion);
            }
            Action::RecordFromQuery => return self.record_from_query(&pointer, rest),
            Action::SetRecordIndex => {
                object[word::RECORD_INDEX] = self.word(rest[0])?;
                return self.store(&pointer, &object);
            }
            Action::CopyAttributes => return self.copy_attributes(&object, rest[0]),
            Action::Is(wanted) => {
                let found = self.hit_object_kind(&object)?;
                let wanted = self.b.i32(wanted);
                vec![self.b.compare(ir::Op::IEq, found, wanted)?]
            }
            Action::Words { first, count } => object[first..first + count].to_vec(),
            Action::HitKind => {
                let mask = self.b.i32(0xff);
                vec![self.b.binary(ir::Op::And, object[word::HIT_KIND], mask)?]
            }
            Action::IsPrimitive(wanted) => {
                let (shift, wanted) = (self.b.i32(8), self.b.i32(wanted));
                let found = self.b.binary(ir::Op::LShr, object[word::HIT_KIND], shift)?;
                vec![self.b.compare(ir::Op::IEq, found, wanted)?]
            }
            Action::Fact(fact) => {
                let mut words = self.fact(&object, fact)?;
                words.truncate(self.types.leaves(instruction.result_type)?.len());
                words
            }
            Action::ObjectRay { origin } => self.object_ray(&object, origin)?,
        };
        self.define_typed(instruction, result)
    }

    /// Only ray generation shaders may use `OpReorderThread*` and the instructions that include it.
    fn check_reorder_stage(&self, action: Action) -> Result<(), Error> {
        let reorders = matches!(
            action,
            Action::Reorder
                | Action::ReorderWithHint
                | Action::ReorderExecute
                | Action::TraceReorderExecute { .. }
        );
        let allowed = match self.request.stage {
            Stage::RayGeneration => true,
            Stage::ClosestHit | Stage::Miss => !reorders,
            _ => false,
        };
        match allowed {
            true => Ok(()),
            false => Err(self.b.invalid("this stage must not use this instruction")),
        }
    }

    fn hit_object_kind(&mut self, object: &[Value]) -> Result<Value, Error> {
        let mask = self.b.i32(kind::MASK);
        self.b.binary(ir::Op::And, object[word::KIND], mask)
    }

    fn empty_hit_object(&mut self) -> Vec<Value> {
        (0..word::COUNT)
            .map(|index| self.b.constant(word::ty(index), 0))
            .collect()
    }

    /// Operands: structure, flags, cull mask, SBT offset and stride, miss index, origin, t_min,
    /// direction, t_max, (time,) payload.
    fn hit_object_trace(
        &mut self,
        pointer: &Pointer,
        operands: &[Id],
        motion: bool,
    ) -> Result<(), Error> {
        let mut words = self.ray_words(operands)?;
        let ray = words.clone();
        let op = ir::Op::TraceRay(ir::op::Trace::new(true, motion));
        let time = if motion {
            let time = self.ray_time(operands[10])?;
            words.push(time);
            time
        } else {
            self.b.f32(0.0)
        };
        let payload = self.pointer(operands[10 + usize::from(motion)])?;
        let types = self.types.leaves(payload.pointee)?;
        let values = self.load(&payload)?;
        let taken = self.scalars_to_words(&values)?;
        let traced = TRACED.iter().map(|&index| word::ty(index));
        let results: Vec<Type> = traced.chain(taken.iter().map(|&w| self.b.ty(w))).collect();
        words.extend(taken);
        let returned = self.b.emit_unchecked(op, &words, &results)?;
        let (traced, payload_words) = returned.split_at(TRACED.len());
        let values = self.words_to_scalars(payload_words, &types)?;
        self.store(&payload, &values)?;
        let mut object = self.empty_hit_object();
        for (&index, &value) in TRACED.iter().zip(traced) {
            object[index] = value;
        }
        object[word::TIME] = time;
        object[word::FLAGS] = ray[2];
        object[word::ORIGIN..word::ORIGIN + 3].copy_from_slice(&ray[7..10]);
        object[word::T_MIN] = ray[10];
        object[word::DIRECTION..word::DIRECTION + 3].copy_from_slice(&ray[11..14]);
        object[word::STRUCTURE..word::STRUCTURE + 2].copy_from_slice(&ray[..2]);
        self.store(pointer, &object)
    }

    fn hit_object_execute(&mut self, object: &[Value], payload: Id) -> Result<(), Error> {
        let payload = self.pointer(payload)?;
        let types = self.types.leaves(payload.pointee)?;
        let values = self.load(&payload)?;
        let taken = self.scalars_to_words(&values)?;
        let word_types: Vec<Type> = taken.iter().map(|&word| self.b.ty(word)).collect();
        // The first sixteen have rows of their own, the rest follow the payload.
        let (first, rest) = object.split_at(crate::state::IO_DATA_ROW);
        let words = [first, &taken, rest].concat();
        let op = ir::Op::HitObjectExecute;
        let returned = self.b.emit_unchecked(op, &words, &word_types)?;
        let values = self.words_to_scalars(&returned, &types)?;
        self.store(&payload, &values)
    }

    /// `hint`: empty, or the hint and its number of bits.
    fn reorder(&mut self, object: Option<&[Value]>, hint: &[Id]) -> Result<(), Error> {
        let (hint, bits) = match *hint {
            [hint, bits] => (self.word(hint)?, self.word(bits)?),
            [] => (self.b.i32(0), self.b.i32(0)),
            _ => return Err(self.b.invalid("a hint comes with its number of bits")),
        };
        let (kind, record) = match object {
            Some(object) => (self.hit_object_kind(object)?, object[word::RECORD_INDEX]),
            None => (self.b.i32(u32::MAX), self.b.i32(0)),
        };
        self.b
            .emit_effect(ir::Op::ReorderThread, &[hint, bits, kind, record])
    }

    /// Writes the hit object's attributes to a variable; words that no attribute can have are zero.
    fn copy_attributes(&mut self, object: &[Value], attributes: Id) -> Result<(), Error> {
        let pointer = self.pointer(attributes)?;
        let types = self.types.leaves(pointer.pointee)?;
        let wanted: u32 = types.iter().map(|ty| ty.rows()).sum();
        let mut words = object[word::ATTRIBUTES..].to_vec();
        words.resize(words.len().max(wanted as usize), self.b.i32(0));
        let values = self.words_to_scalars(&words, &types)?;
        self.store(&pointer, &values)
    }

    fn fact(&mut self, object: &[Value], fact: Fact) -> Result<Vec<Value>, Error> {
        let words: Vec<Value> = IDENTITY.iter().map(|&index| object[index]).collect();
        let op = ir::Op::HitObjectGet(fact);
        let results = vec![fact.ty(); fact.words()];
        Ok(self.b.emit_unchecked(op, &words, &results)?.to_vec())
    }

    /// The ray in the instance's space: rows of the matrix times the origin or the direction.
    fn object_ray(&mut self, object: &[Value], origin: bool) -> Result<Vec<Value>, Error> {
        let matrix = self.fact(object, Fact::WorldToObject)?;
        let first = if origin {
            word::ORIGIN
        } else {
            word::DIRECTION
        };
        let vector = &object[first..first + 3];
        let mut out = Vec::with_capacity(3);
        for row in 0..3 {
            let mut sum = self.b.binary(ir::Op::FMul, matrix[row], vector[0])?;
            for column in 1..3 {
                let element = matrix[3 * column + row];
                let product = self.b.binary(ir::Op::FMul, element, vector[column])?;
                sum = self.b.binary(ir::Op::FAdd, sum, product)?;
            }
            if origin {
                sum = self.b.binary(ir::Op::FAdd, sum, matrix[9 + row])?;
            }
            out.push(sum);
        }
        Ok(out)
    }
}
