//! Descriptor heaps: pointers into them, and bindings that are mapped to them.

use rspirv::spirv::{BuiltIn, Decoration, StorageClass};

use super::Lowerer;
use super::types::{TypeKind, UNTYPED};
use super::values::{MemoryLocation, Pointer, Val};
use crate::Error;
use crate::descriptor_heap::{DESCRIPTOR_BYTES, HeapPlace, Mapping, Source, Table, Word, resource};
use crate::environment::reference;
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

/// Bits of a packed index for the image.
const IMAGE_INDEX_BITS: u32 = 20;

/// In the upper half of the value of a pointer to a combined image sampler: the sampler is an
/// embedded one.
const EMBEDDED: u32 = 1 << 31;

/// The used bits of an index in memory.
#[derive(Clone, Copy)]
enum IndexPart {
    Whole,
    Image,
    Sampler,
}

impl Lowerer<'_> {
    /// The heap of a variable, if it is one.
    pub(super) fn heap_of(&self, id: Id) -> Option<Table> {
        match self.module.annotations.id(id, Decoration::BuiltIn)? {
            it if it == BuiltIn::SamplerHeapEXT as u32 => Some(Table::Samplers),
            it if it == BuiltIn::ResourceHeapEXT as u32 => Some(Table::Resources),
            _ => None,
        }
    }

    /// The index of the mapping of a variable with a set and a binding.
    pub(super) fn mapping(
        &self,
        id: Id,
        (class, pointee): (StorageClass, Id),
        (set, binding): (u32, u32),
    ) -> Result<Option<usize>, Error> {
        let mappings = self.request.mappings;
        if mappings.is_empty() {
            return Ok(None);
        }
        let kind = self.resource_kind(id, class, pointee)?;
        Ok(mappings.iter().position(|it| {
            let number = binding.checked_sub(it.first_binding);
            it.set == set
                && number.is_some_and(|number| number < it.binding_count)
                && it.resources & kind != 0
        }))
    }

    /// The bit of a variable's kind in a mapping's mask.
    fn resource_kind(&self, id: Id, class: StorageClass, mut ty: Id) -> Result<u32, Error> {
        while let TypeKind::Array { element, .. } | TypeKind::RuntimeArray { element } =
            self.types.kind(ty)?
        {
            ty = *element;
        }
        let annotations = &self.module.annotations;
        let mut is_read_only = annotations.id(id, Decoration::NonWritable).is_some();
        Ok(match self.types.kind(ty)? {
            TypeKind::Sampler => resource::SAMPLER,
            TypeKind::SampledImage { .. } => resource::COMBINED,
            TypeKind::AccelerationStructure => resource::ACCELERATION_STRUCTURE,
            TypeKind::Image(image) if image.sampled == 1 => resource::SAMPLED_IMAGE,
            TypeKind::Image(_) if is_read_only => resource::READ_ONLY_IMAGE,
            TypeKind::Image(_) => resource::READ_WRITE_IMAGE,
            TypeKind::Struct { members } => {
                let is_storage = class == StorageClass::StorageBuffer
                    || annotations.id(ty, Decoration::BufferBlock).is_some();
                is_read_only |= (0..members.len() as u32).all(|member| {
                    annotations
                        .member(ty, member, Decoration::NonWritable)
                        .is_some()
                });
                match (is_storage, is_read_only) {
                    (false, _) => resource::UNIFORM_BUFFER,
                    (true, true) => resource::READ_ONLY_STORAGE_BUFFER,
                    (true, false) => resource::READ_WRITE_STORAGE_BUFFER,
                }
            }
            _ => return Err(self.b.invalid("a binding of a type that no resource has")),
        })
    }

    /// The location of a buffer with a mapping.
    pub(super) fn mapped_buffer(
        &mut self,
        mapping: &Mapping,
        number: (Option<Value>, u32),
    ) -> Result<MemoryLocation, Error> {
        match &mapping.source {
            Source::Heap(_) => Ok(MemoryLocation::Buffer {
                reference: self.mapped_reference(mapping, number)?,
                offset: None,
                constant: 0,
            }),
            &Source::Data(word) => self.word_place(word, None),
            &Source::HeapData { offset_bytes, push } => {
                let offset = self.heap_word(Word::Push(push), None, Type::I32)?;
                Ok(MemoryLocation::Buffer {
                    reference: self.b.constant_reference(Table::Data.binding(), 0),
                    offset: Some(offset),
                    constant: offset_bytes,
                })
            }
            &Source::Address(word) => Ok(MemoryLocation::Global {
                address: self.heap_word(word, None, Type::I64)?,
                constant: 0,
            }),
        }
    }

    /// The reference to the descriptor of a mapped resource that is neither a sampler nor a
    /// combined image sampler.
    pub(super) fn mapped_reference(
        &mut self,
        mapping: &Mapping,
        number: (Option<Value>, u32),
    ) -> Result<Value, Error> {
        match &mapping.source {
            Source::Heap(source) => {
                self.heap_reference(Table::Resources, &source.place, number, IndexPart::Whole)
            }
            _ => Err(self.b.invalid("a mapping to data has no descriptor")),
        }
    }

    /// The references that are the value of a mapped image, sampler or both.
    fn mapped_references(
        &mut self,
        mapping: &Mapping,
        ty: Id,
        number: (Option<Value>, u32),
    ) -> Result<Vec<Value>, Error> {
        let Source::Heap(source) = &mapping.source else {
            return Err(self.b.invalid("a mapping to data has no descriptor"));
        };
        let embedded = |it: &mut Self, at| it.b.constant_reference(Table::Embedded.binding(), at);
        match self.types.kind(ty)? {
            TypeKind::Sampler => Ok(vec![match source.embedded {
                Some(at) => embedded(self, at),
                None => {
                    self.heap_reference(Table::Samplers, &source.place, number, IndexPart::Whole)?
                }
            }]),
            TypeKind::SampledImage { .. } => {
                let (image, sampler) = match source.is_packed {
                    true => (IndexPart::Image, IndexPart::Sampler),
                    false => (IndexPart::Whole, IndexPart::Whole),
                };
                let mut place = source.sampler.clone();
                if source.is_packed {
                    place.index = source.place.index;
                }
                let image = self.heap_reference(Table::Resources, &source.place, number, image)?;
                let sampler = match source.embedded {
                    Some(at) => embedded(self, at),
                    None => self.heap_reference(Table::Samplers, &place, number, sampler)?,
                };
                Ok(vec![image, sampler])
            }
            _ => Ok(vec![self.mapped_reference(mapping, number)?]),
        }
    }

    /// The value of a mapped resource: references, or the address of an acceleration structure.
    pub(super) fn load_mapped(
        &mut self,
        mapping: &Mapping,
        ty: Id,
        number: (Option<Value>, u32),
    ) -> Result<Vec<Value>, Error> {
        if !matches!(self.types.kind(ty)?, TypeKind::AccelerationStructure) {
            return self.mapped_references(mapping, ty, number);
        }
        if let Source::Address(word) = mapping.source {
            return Ok(vec![self.heap_word(word, None, Type::I64)?]);
        }
        let reference = self.mapped_reference(mapping, number)?;
        let descriptor = self.b.descriptor(reference)?;
        let address = self
            .b
            .emit(ir::Op::DescriptorAddress, &[descriptor], Type::I64)?;
        Ok(vec![address])
    }

    /// The value of a pointer to a mapped resource. For a combined image sampler it has the image's
    /// entry in its lower half and the sampler's in its upper half.
    pub(super) fn mapped_scalar(
        &mut self,
        mapping: &Mapping,
        ty: Id,
        number: (Option<Value>, u32),
    ) -> Result<Value, Error> {
        let references = self.mapped_references(mapping, ty, number)?;
        let &[image, sampler] = &references[..] else {
            return Ok(references[0]);
        };
        let [image, _] = self.b.unpack64(image)?;
        let [mut sampler, _] = self.b.unpack64(sampler)?;
        if matches!(&mapping.source, Source::Heap(source) if source.embedded.is_some()) {
            let flag = self.b.i32(EMBEDDED);
            sampler = self.b.binary(ir::Op::Or, sampler, flag)?;
        }
        self.b.pack64(image, sampler, Type::I64)
    }

    /// The references of a combined image sampler, from the value of a pointer to it.
    pub(super) fn combined_references(&mut self, pointer: Value) -> Result<Vec<Value>, Error> {
        if self.request.mappings.is_empty() {
            return Ok(vec![pointer, pointer]);
        }
        let [image, sampler] = self.b.unpack64(pointer)?;
        let table = |it: &mut Self, table: Table| it.b.i32(reference::SETS + table as u32);
        let resources = table(self, Table::Resources);
        let (samplers, embedded) = (table(self, Table::Samplers), table(self, Table::Embedded));
        let zero = self.b.i32(0);
        let is_embedded = self.b.compare(ir::Op::SLt, sampler, zero)?;
        let samplers = self.b.select(is_embedded, embedded, samplers)?;
        let mask = self.b.i32(!EMBEDDED);
        let sampler = self.b.binary(ir::Op::And, sampler, mask)?;
        Ok(vec![
            self.b.pack64(image, resources, Type::I64)?,
            self.b.pack64(sampler, samplers, Type::I64)?,
        ])
    }

    /// The reference to a descriptor in a heap.
    fn heap_reference(
        &mut self,
        table: Table,
        place: &HeapPlace,
        (number, constant): (Option<Value>, u32),
        part: IndexPart,
    ) -> Result<Value, Error> {
        let first = place
            .first
            .wrapping_add(constant.wrapping_mul(place.stride));
        let mut terms = Vec::new();
        if let Some(number) = number.filter(|_| place.stride != 0) {
            terms.push(self.b.scale(number, place.stride.into())?);
        }
        if let Some(word) = place.index {
            let at = match place.is_index_array {
                true => Some(self.b.add_terms(number, constant)?),
                false => None,
            };
            let mut index = self.heap_word(word, at, Type::I32)?;
            let bits = self.b.i32(IMAGE_INDEX_BITS);
            index = match part {
                IndexPart::Whole => index,
                IndexPart::Image => {
                    let mask = self.b.i32((1 << IMAGE_INDEX_BITS) - 1);
                    self.b.binary(ir::Op::And, index, mask)?
                }
                IndexPart::Sampler => self.b.binary(ir::Op::LShr, index, bits)?,
            };
            // An index may count bytes instead of descriptors.
            let stride = place.index_stride_bytes;
            terms.push(match stride % DESCRIPTOR_BYTES {
                0 => self.b.scale(index, (stride / DESCRIPTOR_BYTES).into())?,
                _ => {
                    let bytes = self.b.scale(index, stride.into())?;
                    self.descriptors_in(bytes)?
                }
            });
        }
        let Some(mut sum) = terms.pop() else {
            return Ok(self.b.constant_reference(table.binding(), first));
        };
        for term in terms {
            sum = self.b.binary(ir::Op::IAdd, sum, term)?;
        }
        let entry = self.b.add_terms(Some(sum), first)?;
        self.b.reference(table.binding(), entry)
    }

    /// The reference to the descriptor at a byte offset of a heap.
    pub(super) fn heap_entry(
        &mut self,
        table: Table,
        offset: Option<Value>,
        constant: u32,
    ) -> Result<Value, Error> {
        if offset.is_none() {
            let entry = constant / DESCRIPTOR_BYTES;
            return Ok(self.b.constant_reference(table.binding(), entry));
        }
        let offset = self.b.add_terms(offset, constant)?;
        let entry = self.descriptors_in(offset)?;
        self.b.reference(table.binding(), entry)
    }

    fn descriptors_in(&mut self, bytes: Value) -> Result<Value, Error> {
        let bits = self.b.i32(DESCRIPTOR_BYTES.trailing_zeros());
        self.b.binary(ir::Op::LShr, bytes, bits)
    }

    /// The location of a word, plus an offset in words.
    fn word_place(&mut self, word: Word, at: Option<Value>) -> Result<MemoryLocation, Error> {
        let (mut address, constant) = match word {
            Word::Push(constant) => {
                return Ok(MemoryLocation::Buffer {
                    reference: self.b.push_constants(),
                    offset: None,
                    constant,
                });
            }
            Word::ShaderRecord(constant) => (self.shader_record_address()?, constant),
            Word::Indirect { push, offset } => {
                (self.heap_word(Word::Push(push), None, Type::I64)?, offset)
            }
        };
        if let Some(at) = at {
            let at = self.b.i64_of(at, false)?;
            let step = self.b.scale(at, 4)?;
            address = self.b.binary(ir::Op::IAdd, address, step)?;
        }
        Ok(MemoryLocation::Global {
            address,
            constant: constant.into(),
        })
    }

    /// A word of 32 or 64 bits for a mapping.
    fn heap_word(&mut self, word: Word, at: Option<Value>, ty: Type) -> Result<Value, Error> {
        let place = self.word_place(word, at)?;
        let pointer = Pointer {
            constant: matches!(place, MemoryLocation::Buffer { .. }),
            ..Pointer::new(UNTYPED, place)
        };
        let size = |ty: Type| u64::from(ty.size_bytes());
        Ok(self.load_runs(&pointer, &[(ty, 0)], size)?[0])
    }

    /// `OpBufferPointerEXT`.
    pub(super) fn lower_buffer_pointer(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let buffer = self.pointer(self.module.operands(instruction)[0])?;
        let (class, pointee) = self.types.pointer(instruction.result_type)?;
        let find = |decoration| self.module.annotations.id(instruction.result, decoration);
        let (aliased, volatile) = (find(Decoration::Aliased), find(Decoration::Volatile));
        if !matches!(class, StorageClass::Uniform | StorageClass::StorageBuffer) {
            return Err(self
                .b
                .invalid("a buffer's pointer has another storage class"));
        }
        let is_wide = self.types.has_wide_offsets && class == StorageClass::StorageBuffer;
        let place = Self::buffer_place(self.reference(&buffer)?, is_wide);
        let pointer = Pointer {
            is_wide,
            constant: class == StorageClass::Uniform && aliased.is_none(),
            volatile: volatile.is_some(),
            ..Pointer::new(pointee, place)
        };
        self.define(instruction.result, Val::Pointer(pointer))
    }
}
