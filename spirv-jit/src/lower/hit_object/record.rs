//! Hit objects recorded without a trace: misses, hits, and committed intersections of ray queries.

use crate::Error;
use crate::facts::Fact;
use crate::hit_object::{kind, primitive, word};
use crate::ir::{self, Type, Value};
use crate::lower::Lowerer;
use crate::lower::types::TypeKind;
use crate::lower::values::Pointer;
use crate::parse::Id;
use crate::query::{QueryWord, row};

impl Lowerer<'_> {
    /// Operands: (flags,) miss index, origin, t_min, direction, t_max(, time).
    pub(super) fn record_miss(
        &mut self,
        pointer: &Pointer,
        operands: &[Id],
        with_flags: bool,
        motion: bool,
    ) -> Result<(), Error> {
        let mut object = self.empty_hit_object();
        object[word::KIND] = self.b.i32(kind::MISS);
        let rest = if with_flags {
            object[word::FLAGS] = self.word(operands[0])?;
            &operands[1..]
        } else {
            operands
        };
        object[word::RECORD_INDEX] = self.word(rest[0])?;
        self.record_ray(&mut object, &rest[1..5])?;
        if motion {
            object[word::TIME] = self.ray_time(rest[5])?;
        }
        self.store(pointer, &object)
    }

    /// Operands: origin, t_min, direction, t_max.
    fn record_ray(&mut self, object: &mut [Value], operands: &[Id]) -> Result<(), Error> {
        let mut words = Vec::with_capacity(8);
        for &id in operands {
            words.extend_from_slice(&self.leaves(id)?);
        }
        if words.len() != 8 {
            return Err(self.b.invalid("a ray is made of 32-bit floats"));
        }
        object[word::ORIGIN..=word::T_MAX].copy_from_slice(&words);
        Ok(())
    }

    /// Operands: structure, instance, primitive, geometry, hit kind, record index or offset and
    /// stride, origin, t_min, direction, t_max, (time,) attributes.
    pub(super) fn record_hit(
        &mut self,
        pointer: &Pointer,
        operands: &[Id],
        with_index: bool,
        motion: bool,
    ) -> Result<(), Error> {
        let mut object = self.empty_hit_object();
        object[word::KIND] = self.b.i32(kind::HIT);
        let structure = self.scalar(operands[0])?;
        let address = self.b.unpack64(structure)?;
        object[word::STRUCTURE..word::STRUCTURE + 2].copy_from_slice(&address);
        object[word::INSTANCE] = self.word(operands[1])?;
        object[word::PRIMITIVE] = self.word(operands[2])?;
        object[word::GEOMETRY] = self.word(operands[3])?;
        let hit_kind = self.word(operands[4])?;
        object[word::HIT_KIND] = self.typed_hit_kind(hit_kind)?;
        object[word::SLOT] = self.b.i32(u32::MAX);
        let rest = if with_index {
            object[word::RECORD_INDEX] = self.word(operands[5])?;
            &operands[6..]
        } else {
            let (offset, stride) = (self.word(operands[5])?, self.word(operands[6])?);
            let instance = self.fact(&object, Fact::InstanceSbtOffset)?[0];
            let geometry = self
                .b
                .binary(ir::Op::IMul, object[word::GEOMETRY], stride)?;
            let sum = self.b.binary(ir::Op::IAdd, instance, geometry)?;
            object[word::RECORD_INDEX] = self.b.binary(ir::Op::IAdd, sum, offset)?;
            &operands[7..]
        };
        self.record_ray(&mut object, &rest[..4])?;
        if motion {
            object[word::TIME] = self.ray_time(rest[4])?;
        }
        self.record_attributes(&mut object, rest[4 + usize::from(motion)])?;
        self.store(pointer, &object)
    }

    /// Operands: query, record index, attributes(, hit kind). Without a committed intersection the
    /// hit object is empty.
    pub(super) fn record_from_query(
        &mut self,
        pointer: &Pointer,
        operands: &[Id],
    ) -> Result<(), Error> {
        let query = self.pointer(operands[0])?;
        if !matches!(self.types.kind(query.pointee)?, TypeKind::RayQuery) {
            return Err(self.b.invalid("the operand is not a ray query"));
        }
        let mut object = self.empty_hit_object();
        for (row, index, count) in [
            (row::STRUCTURE, word::STRUCTURE, 2),
            (row::FLAGS, word::FLAGS, 1),
            (row::ORIGIN, word::ORIGIN, 3),
            (row::T_MIN, word::T_MIN, 1),
            (row::DIRECTION, word::DIRECTION, 3),
        ] {
            let types: Vec<Type> = (index..index + count).map(word::ty).collect();
            let values = self.load_query_rows(&query, row, &types)?;
            object[index..index + count].copy_from_slice(&values);
        }
        let (zero, one) = (self.b.i32(0), self.b.i32(1));
        let ty = self.committed_word(&query, Fact::IntersectionType, 0)?;
        let is_built_in = self.b.compare(ir::Op::IEq, ty, one)?;
        let is_hit = self.b.compare(ir::Op::INe, ty, zero)?;
        let mask = self.load_query_rows(&query, row::CULL_MASK, &[Type::I32])?[0];
        let eight = self.b.i32(8);
        let mask = self.b.binary(ir::Op::Shl, mask, eight)?;
        let (hit, empty) = (self.b.i32(kind::HIT), self.b.i32(kind::EMPTY));
        let state = self.b.select(is_hit, hit, empty)?;
        object[word::KIND] = self.b.binary(ir::Op::Or, state, mask)?;
        object[word::RECORD_INDEX] = self.word(operands[1])?;
        object[word::T_MAX] = self.committed_word(&query, Fact::T, 0)?;
        object[word::INSTANCE] = self.committed_word(&query, Fact::InstanceId, 0)?;
        object[word::GEOMETRY] = self.committed_word(&query, Fact::GeometryIndex, 0)?;
        object[word::PRIMITIVE] = self.committed_word(&query, Fact::PrimitiveIndex, 0)?;
        object[word::SLOT] = self.committed_word(&query, Fact::Slot, 0)?;
        // The shader provides the hit kind and the attributes of a box.
        let given = match operands.get(3) {
            Some(&id) => self.word(id)?,
            None => zero,
        };
        let low_byte = self.b.i32(0xff);
        let given = self.b.binary(ir::Op::And, given, low_byte)?;
        let found = self.committed_word(&query, Fact::HitWord, 0)?;
        object[word::HIT_KIND] = self.b.select(is_built_in, found, given)?;
        self.record_attributes(&mut object, operands[2])?;
        for component in 0..2 {
            let weight = self.committed_word(&query, Fact::Barycentrics, component)?;
            let place = &mut object[word::ATTRIBUTES + usize::from(component)];
            *place = self.b.select(is_built_in, weight, *place)?;
        }
        self.store(pointer, &object)
    }

    /// A word about the committed intersection of a query.
    fn committed_word(
        &mut self,
        query: &Pointer,
        fact: Fact,
        component: u8,
    ) -> Result<Value, Error> {
        let row = self.query_row(QueryWord {
            committed: true,
            fact,
            component,
        })?;
        let ty = match fact {
            Fact::T => Type::F32,
            _ => Type::I32,
        };
        Ok(self.load_query_rows(query, row, &[ty])?[0])
    }

    /// The shader's hit kind, with the primitive kind that it implies.
    fn typed_hit_kind(&mut self, hit_kind: Value) -> Result<Value, Error> {
        let (mask, limit) = (self.b.i32(0xff), self.b.i32(0xfe));
        let low = self.b.binary(ir::Op::And, hit_kind, mask)?;
        let is_triangle = self.b.compare(ir::Op::ULe, limit, low)?;
        let triangle = self.b.i32(primitive::TRIANGLE << 8);
        let triangle = self.b.binary(ir::Op::Or, low, triangle)?;
        self.b.select(is_triangle, triangle, low)
    }

    /// Takes the words of an attribute variable into the hit object.
    fn record_attributes(&mut self, object: &mut [Value], attributes: Id) -> Result<(), Error> {
        let pointer = self.pointer(attributes)?;
        let values = self.load(&pointer)?;
        let words = self.scalars_to_words(&values)?;
        let places = &mut object[word::ATTRIBUTES..];
        for (place, &value) in places.iter_mut().zip(&words) {
            *place = match self.b.ty(value) {
                Type::I32 => value,
                _ => self.b.emit(ir::Op::Bitcast, &[value], Type::I32)?,
            };
        }
        Ok(())
    }
}
