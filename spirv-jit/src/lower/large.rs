//! Values with too many scalars to take apart. Each has its own per-lane memory, which is written
//! once, by loops over the elements of arrays.
//!
//! The frame of an invocation bounds their size ([`MAX_ROWS`](super::types::MAX_ROWS)).

use std::rc::Rc;

use rspirv::spirv::Op;

use super::Lowerer;
use super::pointer::Index;
use super::types::{MAX_LEAVES, MAX_ROWS, TypeKind, too_many_rows};
use super::values::{MemoryLocation, Pointer, Val, Values};
use crate::Error;
use crate::ir::op::MAX_TABLE_RESULTS;
use crate::ir::{self, Node, Terminator, Type, Value};
use crate::parse::{Id, Instruction};

/// Arrays with more scalars are copied by loops.
const LOOP_FROM: u64 = 64;

/// Largest number of array elements in one iteration of such a loop.
const MAX_ELEMENTS: u64 = 16;

/// The source of a value's contents.
#[derive(Clone)]
pub(super) enum ContentsSource {
    Memory(Pointer),
    Zero(Id),
    /// A constant, as rows: a table of the function, and a row in it.
    Table {
        ty: Id,
        table: u32,
        row: Option<Value>,
        constant: u32,
    },
    /// The same value for each element.
    Element(Rc<ContentsSource>),
    /// A value in scalars.
    Scalars(Rc<[Value]>),
}

impl Lowerer<'_> {
    /// Whether values of a type are too large to be taken apart.
    pub(super) fn is_large(&self, ty: Id) -> bool {
        self.types.leaf_count(ty) > MAX_LEAVES
    }

    /// Lowers an instruction that produces, uses or moves a large value; false for others.
    pub(super) fn lower_large(&mut self, instruction: &Instruction) -> Result<bool, Error> {
        let operands = self.module.operands(instruction);
        let ty = instruction.result_type;
        match instruction.opcode {
            Op::Variable => {
                let (_, pointee) = self.types.pointer(ty)?;
                match operands.get(1) {
                    Some(&initializer) if self.is_large(pointee) => {
                        self.lower_large_variable(instruction, pointee, initializer)?;
                    }
                    _ => return Ok(false),
                }
            }
            Op::Store | Op::CopyMemory => {
                let moved = self.moved_type(instruction)?;
                if !self.is_large(moved) {
                    return Ok(false);
                }
                self.lower_large_move(instruction, operands, moved)?;
            }
            Op::CompositeExtract => {
                let whole = self.type_of(operands[0])?;
                if !self.is_large(whole) {
                    return Ok(false);
                }
                self.extract(instruction, whole, operands)?;
            }
            _ if !self.is_large(ty) => return Ok(false),
            Op::Load => {
                let pointer = self.pointer_to(operands[0], ty)?;
                let pointer = self.with_access(pointer, &operands[1..]);
                self.define_filled(instruction, ContentsSource::Memory(pointer))?;
            }
            Op::CopyLogical => {
                let source = self.source(operands[0])?;
                self.define_filled(instruction, source)?;
            }
            Op::Undef => {
                let place = self.new_place("", ty)?;
                self.define(instruction.result, Val::Kept(place))?;
            }
            Op::CompositeConstruct => {
                let place = self.new_place("", ty)?;
                for (index, &part) in operands.iter().enumerate() {
                    let element = self.step_by(place.clone(), Index::Constant(index as i64))?;
                    self.fill_from(element, part)?;
                }
                self.define(instruction.result, Val::Kept(place))?;
            }
            Op::CompositeConstructReplicateEXT => {
                let source = ContentsSource::Element(self.source(operands[0])?.into());
                self.define_filled(instruction, source)?;
            }
            Op::CompositeInsert => {
                let place = self.new_place("", ty)?;
                self.fill_from(place.clone(), operands[1])?;
                let mut part = place.clone();
                for &index in &operands[2..] {
                    part = self.part(part, index)?;
                }
                self.fill_from(part, operands[0])?;
                self.define(instruction.result, Val::Kept(place))?;
            }
            Op::Select => self.choose(instruction, operands)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// A variable with an initializer.
    fn lower_large_variable(
        &mut self,
        instruction: &Instruction,
        pointee: Id,
        initializer: Id,
    ) -> Result<(), Error> {
        self.check_opaque(initializer, pointee)?;
        let name = self.module.annotations.name(instruction.result).to_owned();
        let pointer = self.new_place(&name, pointee)?;
        let source = self.source(initializer)?;
        self.fill(pointer.clone(), source)?;
        self.define(instruction.result, Val::Pointer(pointer))
    }

    /// A store or a copy in memory.
    fn lower_large_move(
        &mut self,
        instruction: &Instruction,
        operands: &[u32],
        moved: Id,
    ) -> Result<(), Error> {
        let (target, source) = match instruction.opcode {
            Op::Store => {
                let target = self.pointer_to(operands[0], moved)?;
                let target = self.with_access(target, &operands[2..]);
                self.check_opaque(operands[1], target.pointee)?;
                (target, self.source(operands[1])?)
            }
            _ => {
                let (target, source) = self.copied(instruction)?;
                (target, ContentsSource::Memory(source))
            }
        };
        self.fill(target, source)
    }

    /// A part of a large value.
    fn extract(
        &mut self,
        instruction: &Instruction,
        whole: Id,
        operands: &[u32],
    ) -> Result<(), Error> {
        if self.constants.find(operands[0]).is_some() && !self.is_large(instruction.result_type) {
            let (first, part) = self.types.path(whole, &operands[1..])?;
            let types = self.types.leaves(part)?;
            let bits = self
                .constants
                .part(&self.types, operands[0], first, types.len())?;
            let pairs = types.iter().zip(bits);
            let values: Vec<Value> = pairs.map(|(&ty, bits)| self.b.constant(ty, bits)).collect();
            return self.define_typed(instruction, values);
        }
        let Val::Kept(mut pointer) = self.value(operands[0])? else {
            return Err(self.b.invalid("a composite is expected"));
        };
        for &index in &operands[1..] {
            pointer = self.part(pointer, index)?;
        }
        if self.is_large(pointer.pointee) {
            return self.define(instruction.result, Val::Kept(pointer));
        }
        let values = self.load(&pointer)?;
        self.define_typed(instruction, values)
    }

    /// A part by a literal index, which must exist.
    fn part(&mut self, pointer: Pointer, index: u32) -> Result<Pointer, Error> {
        if index >= self.types.element_count(pointer.pointee)? {
            return Err(self.b.invalid("composite index out of range"));
        }
        self.step_by(pointer, Index::Constant(index.into()))
    }

    /// One of two large values, by a single condition.
    fn choose(&mut self, instruction: &Instruction, operands: &[u32]) -> Result<(), Error> {
        let condition = self.bool_scalar(operands[0])?;
        let place = self.new_place("", instruction.result_type)?;
        let label = self.b.new_label();
        let mut bodies = [operands[1], operands[2]].into_iter().map(|id| {
            let outer = self.b.open();
            let filled = self.fill_from(place.clone(), id);
            let body = self.b.close(outer, Terminator::Br(label, Vec::new()));
            filled.map(|()| body)
        });
        let then_body = bodies.next().transpose()?.unwrap_or_default();
        let else_body = bodies.next().transpose()?.unwrap_or_default();
        drop(bodies);
        self.b.push(Node::If {
            condition,
            label,
            results: Vec::new(),
            then_body,
            else_body,
        });
        self.define(instruction.result, Val::Kept(place))
    }

    /// Per-lane memory for a value.
    pub(super) fn new_place(&mut self, name: &str, ty: Id) -> Result<Pointer, Error> {
        let local = self.new_local(name, ty)?;
        Ok(Pointer::new(ty, MemoryLocation::Local { local, row: 0 }))
    }

    fn define_filled(
        &mut self,
        instruction: &Instruction,
        source: ContentsSource,
    ) -> Result<(), Error> {
        let place = self.new_place("", instruction.result_type)?;
        self.fill(place.clone(), source)?;
        self.define(instruction.result, Val::Kept(place))
    }

    /// A large constant, in memory.
    pub(super) fn keep_constant(&mut self, id: Id, ty: Id) -> Result<Val, Error> {
        let place = self.new_place("", ty)?;
        let source = self.constant_source(id, ty)?;
        self.fill(place.clone(), source)?;
        Ok(Val::Kept(place))
    }

    fn constant_source(&mut self, id: Id, ty: Id) -> Result<ContentsSource, Error> {
        if self.constants.is_null(id) {
            return Ok(ContentsSource::Zero(ty));
        }
        let rows = self.types.info(ty)?.rows;
        if rows > MAX_ROWS {
            return Err(too_many_rows());
        }
        let bits = self.constants.bits(&self.types, id)?;
        let types = self.types.leaves_of_any(ty)?;
        let mut words = Vec::with_capacity(rows as usize);
        for (ty, &bits) in types.iter().zip(bits.iter()) {
            words.push(bits as u32);
            if ty.rows() == 2 {
                words.push((bits >> 32) as u32);
            }
        }
        let tables = &mut self.b.function.tables;
        tables.push(words);
        Ok(ContentsSource::Table {
            ty,
            table: tables.len() as u32 - 1,
            row: None,
            constant: 0,
        })
    }

    /// The source of an id's contents.
    pub(super) fn source(&mut self, id: Id) -> Result<ContentsSource, Error> {
        if let Some(ty) = self.constants.find(id).map(|constant| constant.ty)
            && self.is_large(ty)
        {
            return self.constant_source(id, ty);
        }
        Ok(match self.value(id)? {
            Val::Kept(pointer) => ContentsSource::Memory(pointer),
            _ => ContentsSource::Scalars(self.leaves(id)?[..].into()),
        })
    }

    /// Fills memory with the contents of an id.
    pub(super) fn fill_from(&mut self, target: Pointer, id: Id) -> Result<(), Error> {
        let source = self.source(id)?;
        self.fill(target, source)
    }

    /// Fills memory. It recurses only into elements of arrays of two or more that loops fill in
    /// turn, so its depth is at most logarithmic in the frame's bound.
    pub(super) fn fill(&mut self, target: Pointer, source: ContentsSource) -> Result<(), Error> {
        // Last first.
        let mut work = vec![(target, source)];
        while let Some((target, source)) = work.pop() {
            let info = self.types.info(target.pointee)?;
            if info.rows > MAX_ROWS {
                return Err(too_many_rows());
            }
            if info.leaf_count == 0 {
                continue;
            }
            if let ContentsSource::Scalars(values) = &source {
                self.store(&target, values)?;
                continue;
            }
            if info.leaf_count <= LOOP_FROM {
                let values = self.read(&source)?;
                self.store(&target, &values)?;
                continue;
            }
            let leaves = info.leaf_count;
            match info.kind.clone() {
                TypeKind::Struct { members } => {
                    self.check_parts(&source, members.len() as u32, true)?;
                    let first = work.len();
                    for index in 0..members.len() as i64 {
                        let index = Index::Constant(index);
                        let part = self.step_by(target.clone(), index)?;
                        work.push((part, self.source_step(&source, index)?));
                    }
                    work[first..].reverse();
                }
                TypeKind::Array { count, .. } => {
                    self.check_parts(&source, count, false)?;
                    if count == 1 {
                        let index = Index::Constant(0);
                        let part = self.step_by(target, index)?;
                        work.push((part, self.source_step(&source, index)?));
                        continue;
                    }
                    let of_element = leaves / u64::from(count);
                    let together = (LOOP_FROM / of_element).clamp(1, MAX_ELEMENTS) as u32;
                    self.fill_array(&target, &source, count, together)?;
                }
                _ => return Err(self.b.invalid("a value of this type cannot be this large")),
            }
        }
        Ok(())
    }

    /// Fills the elements of an array, several in each iteration of a loop.
    fn fill_array(
        &mut self,
        target: &Pointer,
        source: &ContentsSource,
        count: u32,
        together: u32,
    ) -> Result<(), Error> {
        let turns = count / together;
        self.emit_turns(turns, |lowerer, turn| {
            let first = lowerer.b.scale(turn, together.into())?;
            for more in 0..together {
                let index = lowerer.b.add_terms(Some(first), more)?;
                let index = Index::Value(index);
                let part = lowerer.step_by(target.clone(), index)?;
                let source = lowerer.source_step(source, index)?;
                lowerer.fill(part, source)?;
            }
            Ok(())
        })?;
        for index in turns * together..count {
            let index = Index::Constant(index.into());
            let part = self.step_by(target.clone(), index)?;
            let source = self.source_step(source, index)?;
            self.fill(part, source)?;
        }
        Ok(())
    }

    /// A loop with this number of iterations, at least one.
    fn emit_turns(
        &mut self,
        turns: u32,
        emit: impl FnOnce(&mut Self, Value) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let (zero, one, last) = (self.b.i32(0), self.b.i32(1), self.b.i32(turns - 1));
        let counted = self.b.open_loop(zero);
        let turn = counted.number;
        emit(self, turn)?;
        let goes_on = self.b.compare(ir::Op::ULt, turn, last)?;
        self.b.leave_unless(&counted, goes_on);
        self.b.close_loop(counted, one)
    }

    /// The type of a source's contents, where that is known.
    fn source_type(&self, source: &ContentsSource) -> Option<Id> {
        match source {
            ContentsSource::Memory(pointer) => Some(pointer.pointee),
            ContentsSource::Zero(ty) | ContentsSource::Table { ty, .. } => Some(*ty),
            ContentsSource::Element(_) | ContentsSource::Scalars(_) => None,
        }
    }

    /// Checks that a source has as many parts as its destination.
    fn check_parts(
        &self,
        source: &ContentsSource,
        count: u32,
        is_struct: bool,
    ) -> Result<(), Error> {
        let fits = match (self.source_type(source), source) {
            (Some(ty), _) => {
                let kind = self.types.kind(ty)?;
                matches!(kind, TypeKind::Struct { .. }) == is_struct
                    && self.types.element_count(ty)? == count
            }
            (None, ContentsSource::Element(_)) => true,
            (None, _) => false,
        };
        if fits {
            return Ok(());
        }
        Err(self.b.invalid("an object of another type is expected"))
    }

    /// A part of a source.
    fn source_step(
        &mut self,
        source: &ContentsSource,
        index: Index,
    ) -> Result<ContentsSource, Error> {
        let element = |ty: Id| {
            let member = match index {
                Index::Constant(index) => u32::try_from(index).ok(),
                Index::Value(..) => None,
            };
            self.types.element(ty, member)
        };
        Ok(match source {
            ContentsSource::Memory(pointer) => {
                ContentsSource::Memory(self.step_by(pointer.clone(), index)?)
            }
            ContentsSource::Zero(ty) => ContentsSource::Zero(element(*ty)?),
            ContentsSource::Element(each) => (**each).clone(),
            ContentsSource::Scalars(_) => {
                return Err(self.b.invalid("an object of another type is expected"));
            }
            &ContentsSource::Table {
                ty,
                table,
                row,
                constant,
            } => {
                let element = element(ty)?;
                let (row, constant) = match index {
                    Index::Constant(index) => {
                        let more = self.types.row_offset(ty, index as u32)?;
                        (row, constant + more as u32)
                    }
                    Index::Value(value) => {
                        let rows = self.types.info(element)?.rows;
                        let more = self.b.scale(value, rows)?;
                        let row = match row {
                            Some(row) => self.b.binary(ir::Op::IAdd, row, more)?,
                            None => more,
                        };
                        (Some(row), constant)
                    }
                };
                ContentsSource::Table {
                    ty: element,
                    table,
                    row,
                    constant,
                }
            }
        })
    }

    /// The scalars of a source that is small.
    fn read(&mut self, source: &ContentsSource) -> Result<Values, Error> {
        match source {
            ContentsSource::Memory(pointer) => self.load(pointer),
            ContentsSource::Scalars(values) => Ok(Values::from_slice(values)),
            ContentsSource::Zero(of) => {
                let types = self.types.leaves(*of)?;
                Ok(types.iter().map(|&ty| self.b.constant(ty, 0)).collect())
            }
            ContentsSource::Table {
                ty,
                table,
                row,
                constant,
            } => {
                let types = self.types.leaves(*ty)?;
                let rows = self.types.info(*ty)?.rows as usize;
                let mut words = Vec::with_capacity(rows);
                while words.len() < rows {
                    let count = (rows - words.len()).min(MAX_TABLE_RESULTS);
                    let at = self.b.add_terms(*row, constant + words.len() as u32)?;
                    let types = [Type::I32; MAX_TABLE_RESULTS];
                    let op = ir::Op::Table(*table);
                    words.extend(self.b.emit_unchecked(op, &[at], &types[..count])?);
                }
                Ok(self.words_to_scalars(&words, &types)?.into())
            }
            ContentsSource::Element(_) => {
                Err(self.b.invalid("an object of another type is expected"))
            }
        }
    }
}
