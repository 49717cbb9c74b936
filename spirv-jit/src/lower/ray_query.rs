//! Ray queries. An object is a run of words in per-lane memory ([`crate::query`]): only
//! `OpRayQueryProceedKHR` suspends, the rest are loads and stores.

use rspirv::spirv::{Op, RayQueryIntersection};

use super::types::TypeKind;
use super::values::{MemoryLocation, Pointer};
use super::{Lowerer, facts};
use crate::Error;
use crate::facts::Fact;
use crate::ir::op::Access;
use crate::ir::{self, Space, Type, Value};
use crate::parse::{Id, Instruction, ParsedModule};
use crate::query::{IGNORE_OPACITY_MICROMAPS, QueryWord, row, state};

/// `OpRayQueryGetIntersectionTypeKHR` of a committed intersection.
pub(super) const COMMITTED_TRIANGLE: u32 = 1;
pub(super) const COMMITTED_GENERATED: u32 = 2;

/// The fields that a hit object takes from the committed intersection.
const RECORDED: [Fact; 8] = [
    Fact::IntersectionType,
    Fact::T,
    Fact::InstanceId,
    Fact::GeometryIndex,
    Fact::PrimitiveIndex,
    Fact::Barycentrics,
    Fact::HitWord,
    Fact::Slot,
];

pub(super) fn is_ray_query(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::RayQueryInitializeKHR
            | Op::RayQueryTerminateKHR
            | Op::RayQueryGenerateIntersectionKHR
            | Op::RayQueryConfirmIntersectionKHR
            | Op::RayQueryProceedKHR
            | Op::RayQueryGetRayTMinKHR
            | Op::RayQueryGetRayFlagsKHR
            | Op::RayQueryGetWorldRayDirectionKHR
            | Op::RayQueryGetWorldRayOriginKHR
    ) || facts::of_query(opcode).is_some()
}

/// The candidate fields copied to the committed hit, except those the shader supplies.
fn is_copied(word: QueryWord, of_triangles: bool) -> bool {
    match word.fact {
        Fact::IntersectionType | Fact::AabbOpaque => false,
        Fact::InstanceCustomIndex
        | Fact::InstanceId
        | Fact::InstanceSbtOffset
        | Fact::GeometryIndex
        | Fact::PrimitiveIndex
        | Fact::ObjectRayDirection
        | Fact::ObjectRayOrigin
        | Fact::ObjectToWorld
        | Fact::WorldToObject
        | Fact::IsSphere
        | Fact::IsLss => true,
        _ => of_triangles,
    }
}

/// The words that a module's getters read, and those for commits in the shader.
pub(super) fn find_query_words(module: &ParsedModule) -> Vec<QueryWord> {
    let mut words = Vec::new();
    let (mut confirms, mut generates) = (false, false);
    let blocks = module.functions.iter().flat_map(|f| &f.blocks);
    for &index in blocks.flat_map(|block| &block.instructions) {
        let instruction = module.instruction(index);
        confirms |= instruction.opcode == Op::RayQueryConfirmIntersectionKHR;
        generates |= instruction.opcode == Op::RayQueryGenerateIntersectionKHR;
        if instruction.opcode == Op::HitObjectRecordFromQueryEXT {
            words.extend(RECORDED.iter().flat_map(|&fact| QueryWord::all(fact, true)));
        }
        let Some(fact) = facts::of_query(instruction.opcode) else {
            continue;
        };
        let which = match fact {
            Fact::AabbOpaque => Some(false),
            _ => literal_of(module, module.operands(instruction)[1]).map(|word| word != 0),
        };
        for committed in [false, true] {
            if which.is_none_or(|which| which == committed) {
                words.extend(QueryWord::all(fact, committed));
            }
        }
    }
    if generates {
        // A hit farther than the committed one is ignored.
        words.extend(QueryWord::all(Fact::T, true));
    }
    if confirms || generates {
        let copied = words
            .clone()
            .into_iter()
            .filter(|&word| word.committed && is_copied(word, confirms));
        words.extend(copied.map(|word| QueryWord {
            committed: false,
            ..word
        }));
    }
    words.sort_unstable();
    words.dedup();
    words
}

/// The value of an integer constant that cannot be specialized.
fn literal_of(module: &ParsedModule, id: Id) -> Option<u32> {
    let instruction = module.instruction(module.definition(id)?);
    match instruction.opcode {
        Op::Constant => module.operands(instruction).first().copied(),
        Op::ConstantNull => Some(0),
        _ => None,
    }
}

impl Lowerer<'_> {
    /// Rows of an object.
    pub(super) fn query_rows(words: &[QueryWord]) -> u64 {
        (row::WORDS + words.len()) as u64
    }

    pub(super) fn lower_ray_query(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let query = self.pointer(operands[0])?;
        if !matches!(self.types.kind(query.pointee)?, TypeKind::RayQuery) {
            return Err(self.b.invalid("the operand is not a ray query"));
        }
        match instruction.opcode {
            Op::RayQueryInitializeKHR => self.initialize_query(&query, &operands[1..]),
            Op::RayQueryTerminateKHR => self.set_query_state(&query, state::OVER),
            Op::RayQueryConfirmIntersectionKHR => self.confirm_intersection(&query),
            Op::RayQueryGenerateIntersectionKHR => self.generate_intersection(&query, operands[1]),
            Op::RayQueryProceedKHR => {
                let row = self.pointer_scalars(&query)?;
                let op = ir::Op::RayQueryProceed;
                let more = self.b.emit_unchecked(op, &row, &[Type::I1])?;
                self.define_typed(instruction, &more)
            }
            Op::RayQueryGetRayTMinKHR => self.get_query_rows(instruction, &query, row::T_MIN),
            Op::RayQueryGetRayFlagsKHR => self.get_query_rows(instruction, &query, row::FLAGS),
            Op::RayQueryGetWorldRayDirectionKHR => {
                self.get_query_rows(instruction, &query, row::DIRECTION)
            }
            Op::RayQueryGetWorldRayOriginKHR => {
                self.get_query_rows(instruction, &query, row::ORIGIN)
            }
            opcode => {
                let Some(fact) = facts::of_query(opcode) else {
                    return Err(self.unsupported(instruction));
                };
                let committed = match fact {
                    Fact::AabbOpaque => false,
                    _ => self.is_committed(operands[1])?,
                };
                let first = self.query_row(QueryWord {
                    committed,
                    fact,
                    component: 0,
                })?;
                self.get_query_rows(instruction, &query, first)
            }
        }
    }

    /// The operand `Intersection`.
    fn is_committed(&self, id: Id) -> Result<bool, Error> {
        let which = self.constants.unsigned(&self.types, id)?;
        match RayQueryIntersection::from_u32(which) {
            Some(RayQueryIntersection::RayQueryCandidateIntersectionKHR) => Ok(false),
            Some(RayQueryIntersection::RayQueryCommittedIntersectionKHR) => Ok(true),
            None => Err(self
                .b
                .invalid("an intersection is a candidate or committed")),
        }
    }

    /// The row of a word that the module uses.
    pub(super) fn query_row(&self, word: QueryWord) -> Result<usize, Error> {
        let found = self.query_words.binary_search(&word);
        found
            .map(|index| row::WORDS + index)
            .map_err(|_| self.b.invalid("a query lacks a word"))
    }

    /// Only the low 8 bits of the cull mask count (SPIR-V specification,
    /// `OpRayQueryInitializeKHR`).
    fn initialize_query(&mut self, query: &Pointer, operands: &[Id]) -> Result<(), Error> {
        let structure = self.scalar(operands[0])?;
        let mut words: Vec<Value> = self.b.unpack64(structure)?.to_vec();
        let mut flags = self.word(operands[1])?;
        if self.ignores_micromaps()? {
            let ours = self.b.i32(IGNORE_OPACITY_MICROMAPS);
            flags = self.b.binary(ir::Op::Or, flags, ours)?;
        }
        words.push(flags);
        let (cull_mask, low_bits) = (self.word(operands[2])?, self.b.i32(0xFF));
        words.push(self.b.binary(ir::Op::And, cull_mask, low_bits)?);
        for &id in &operands[3..7] {
            words.extend_from_slice(&self.leaves(id)?);
        }
        let floats = words[4..].iter().all(|&word| self.b.ty(word) == Type::F32);
        if words.len() != row::GENERATED_T - row::STRUCTURE || !floats {
            return Err(self.b.invalid("a ray is made of 32-bit floats"));
        }
        let t_max = words[words.len() - 1];
        self.store_query_rows(query, row::STRUCTURE, &words)?;
        // Nothing is committed yet, which getters may read before the first step.
        let committed = |fact| QueryWord {
            committed: true,
            fact,
            component: 0,
        };
        if let Ok(row) = self.query_row(committed(Fact::IntersectionType)) {
            let none = self.b.i32(0);
            self.store_query_rows(query, row, &[none])?;
        }
        if let Ok(row) = self.query_row(committed(Fact::T)) {
            self.store_query_rows(query, row, &[t_max])?;
        }
        self.set_query_state(query, state::READY)
    }

    fn set_query_state(&mut self, query: &Pointer, state: u32) -> Result<(), Error> {
        let state = self.b.i32(state);
        self.store_query_rows(query, row::STATE, &[state])
    }

    fn confirm_intersection(&mut self, query: &Pointer) -> Result<(), Error> {
        let always = self.b.bool(true);
        self.commit_candidate(query, always, true)?;
        self.set_query_state(query, state::CONFIRMED)
    }

    /// The hit counts if it is in the ray's current interval.
    fn generate_intersection(&mut self, query: &Pointer, t: Id) -> Result<(), Error> {
        let t = self.scalar(t)?;
        if self.b.ty(t) != Type::F32 {
            return Err(self.b.invalid("the hit's t must be a 32-bit float"));
        }
        let committed_t = self.query_row(QueryWord {
            committed: true,
            fact: Fact::T,
            component: 0,
        })?;
        let t_min = self.load_query_rows(query, row::T_MIN, &[Type::F32])?[0];
        let t_max = self.load_query_rows(query, committed_t, &[Type::F32])?[0];
        let after = self.b.compare(ir::Op::FOLe, t_min, t)?;
        let before = self.b.compare(ir::Op::FOLe, t, t_max)?;
        let inside = self.b.binary(ir::Op::And, after, before)?;
        self.commit_candidate(query, inside, false)?;
        for (row, value) in [(committed_t, t), (row::GENERATED_T, t)] {
            self.store_query_row_if(query, row, inside, value)?;
        }
        let generated = self.b.i32(state::GENERATED);
        self.store_query_row_if(query, row::STATE, inside, generated)
    }

    /// Copies the getters' answers for the candidate to those for the committed intersection.
    fn commit_candidate(
        &mut self,
        query: &Pointer,
        condition: Value,
        triangle: bool,
    ) -> Result<(), Error> {
        let words = self.query_words.clone();
        for (index, &word) in words.iter().enumerate().filter(|(_, word)| word.committed) {
            let to = row::WORDS + index;
            let value = match word.fact {
                Fact::IntersectionType if triangle => self.b.i32(COMMITTED_TRIANGLE),
                Fact::IntersectionType => self.b.i32(COMMITTED_GENERATED),
                _ if is_copied(word, triangle) => {
                    let from = self.query_row(QueryWord {
                        committed: false,
                        ..word
                    })?;
                    self.load_query_rows(query, from, &[Type::I32])?[0]
                }
                _ => continue,
            };
            self.store_query_row_if(query, to, condition, value)?;
        }
        Ok(())
    }

    fn store_query_row_if(
        &mut self,
        query: &Pointer,
        row: usize,
        condition: Value,
        value: Value,
    ) -> Result<(), Error> {
        let ty = self.b.ty(value);
        let old = self.load_query_rows(query, row, &[ty])?[0];
        let value = self.b.select(condition, value, old)?;
        self.store_query_rows(query, row, &[value])
    }

    /// A getter: rows from `first` on, as its result's type says.
    fn get_query_rows(
        &mut self,
        instruction: &Instruction,
        query: &Pointer,
        first: usize,
    ) -> Result<(), Error> {
        let types = self.types.leaves(instruction.result_type)?;
        let words: Vec<Type> = types
            .iter()
            .map(|&ty| match ty {
                Type::I1 => Type::I32,
                other => other,
            })
            .collect();
        if words.iter().any(|ty| ty.bits() != 32) || words.len() > row_count(instruction.opcode) {
            return Err(self.b.invalid("a query's word has 32 bits"));
        }
        let values = self.load_query_rows(query, first, &words)?;
        let values = self.words_to_scalars(&values, &types)?;
        self.define_typed(instruction, values)
    }

    pub(super) fn load_query_rows(
        &mut self,
        query: &Pointer,
        first: usize,
        types: &[Type],
    ) -> Result<Vec<Value>, Error> {
        let mut values = Vec::with_capacity(types.len());
        for (index, &ty) in types.iter().enumerate() {
            let place = first + index;
            let mut value = match query.place {
                MemoryLocation::Local { local, row } => {
                    let (variable, row) = self.private.locals[local].find(row + place as u32);
                    let op = ir::Op::VarLoad(variable, row);
                    self.b.emit_unchecked(op, &[], &[ty])?[0]
                }
                _ => {
                    let address = self.address(query, place as u64)?;
                    let access = Access::plain(Space::Private);
                    self.b.load(access, &address, &[ty])?[0]
                }
            };
            if place == row::FLAGS && self.ignores_micromaps()? {
                let theirs = self.b.i32(!IGNORE_OPACITY_MICROMAPS);
                value = self.b.binary(ir::Op::And, value, theirs)?;
            }
            values.push(value);
        }
        Ok(values)
    }

    fn store_query_rows(
        &mut self,
        query: &Pointer,
        first: usize,
        values: &[Value],
    ) -> Result<(), Error> {
        for (index, &value) in values.iter().enumerate() {
            match query.place {
                MemoryLocation::Local { local, row } => {
                    let (variable, row) =
                        self.private.locals[local].find(row + (first + index) as u32);
                    let op = ir::Op::VarStore(variable, row);
                    self.b.emit_effect(op, &[value])?;
                }
                _ => {
                    let address = self.address(query, (first + index) as u64)?;
                    self.b
                        .store(Access::plain(Space::Private), &address, &[value])?;
                }
            }
        }
        Ok(())
    }
}

/// Rows that a getter may read.
fn row_count(opcode: Op) -> usize {
    match opcode {
        Op::RayQueryGetWorldRayDirectionKHR | Op::RayQueryGetWorldRayOriginKHR => 3,
        _ => facts::of_query(opcode).map_or(1, |fact| fact.words()),
    }
}
