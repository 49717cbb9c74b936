//! The interface of task and mesh shaders, which is in workgroup memory: the payload from task to
//! mesh shader, then the workgroup's counts, then the outputs of vertices and primitives, which any
//! invocation may write in any order.

use rspirv::spirv::{BuiltIn, Decoration, ExecutionMode, Op, StorageClass};

use super::types::TypeKind;
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::mesh::{COUNTS_BYTES, MAX_MESH_ELEMENTS, MeshFacts};
use crate::ir::op::Access;
use crate::ir::stage::{Builtin, Stage};
use crate::ir::{self, InputRow, Space, Terminator, Type};
use crate::parse::{Id, Instruction};

/// Words of a vertex or of a primitive, at most: far beyond any device's limit.
const MAX_ELEMENT_WORDS: usize = 1 << 10;

/// Whether a built-in is one of primitives, whatever its decorations.
fn is_of_primitives(built_in: BuiltIn) -> bool {
    matches!(
        built_in,
        BuiltIn::PrimitiveId
            | BuiltIn::Layer
            | BuiltIn::ViewportIndex
            | BuiltIn::CullPrimitiveEXT
            | BuiltIn::PrimitiveShadingRateKHR
            | BuiltIn::PrimitivePointIndicesEXT
            | BuiltIn::PrimitiveLineIndicesEXT
            | BuiltIn::PrimitiveTriangleIndicesEXT
    )
}

impl Lowerer<'_> {
    pub(super) fn is_mesh(&self) -> bool {
        self.request.stage == Stage::Mesh
    }

    /// Whether a variable is of each primitive (`PerPrimitiveEXT`), by its own decoration or by
    /// those of its block's members.
    pub(super) fn is_of_primitive(&self, id: Id) -> bool {
        self.is_decorated(id, Decoration::PerPrimitiveEXT)
    }

    /// Places the payload, the counts and the outputs of a task or mesh shader at the start of
    /// workgroup memory.
    pub(super) fn declare_mesh(&mut self) -> Result<(), Error> {
        if !matches!(self.request.stage, Stage::Task | Stage::Mesh) {
            return Ok(());
        }
        let mut facts = self.mesh_modes()?;
        let mut end = 0u64;
        for id in self.listed(StorageClass::TaskPayloadWorkgroupEXT) {
            let pointee = self.variables[&id].pointee;
            let (size, _) = self.shared_layout().natural(pointee)?;
            self.workgroup.offsets.insert(id, end as u32);
            end = end.saturating_add(size).next_multiple_of(16);
            self.check_memory(end)?;
        }
        facts.payload_bytes = end as u32;
        facts.counts_offset = end as u32;
        end += u64::from(COUNTS_BYTES);
        if self.is_mesh() {
            for id in self.listed(StorageClass::Output) {
                self.place_in_mesh(id, &mut facts, &mut end)?;
            }
        }
        self.workgroup.size_bytes = end as u32;
        self.stage.mesh = Some(facts);
        Ok(())
    }

    /// The entry's variables of a storage class, in order.
    fn listed(&self, class: StorageClass) -> Vec<Id> {
        let of_class = self.variables.iter().filter(|(_, it)| it.class == class);
        let mut ids: Vec<Id> = (of_class.map(|(&id, _)| id))
            .filter(|id| self.entry.interface.contains(id))
            .collect();
        ids.sort_unstable();
        ids
    }

    fn check_memory(&self, end: u64) -> Result<(), Error> {
        match end > ir::MAX_SHARED_BYTES.into() {
            true => Err(budget("the shader has too much workgroup memory")),
            false => Ok(()),
        }
    }

    /// The execution modes of a mesh shader.
    fn mesh_modes(&self) -> Result<MeshFacts, Error> {
        let mut facts = MeshFacts::default();
        let modes = self.execution_modes().filter(|_| self.is_mesh());
        for (mode, numbers) in modes {
            let number = numbers.first().copied().unwrap_or(0);
            match mode {
                ExecutionMode::OutputPoints => facts.corners = 1,
                ExecutionMode::OutputLinesEXT => facts.corners = 2,
                ExecutionMode::OutputTrianglesEXT => facts.corners = 3,
                ExecutionMode::OutputVertices => facts.max_vertices = number,
                ExecutionMode::OutputPrimitivesEXT => facts.max_primitives = number,
                _ => {}
            }
        }
        if self.is_mesh() && facts.corners == 0 {
            return Err(self.b.invalid("a mesh shader lacks its kind of primitives"));
        }
        match facts.max_vertices.max(facts.max_primitives) > MAX_MESH_ELEMENTS {
            true => Err(budget("a mesh shader has too many vertices or primitives")),
            false => Ok(facts),
        }
    }

    /// Assigns the location of a mesh shader's output.
    fn place_in_mesh(&mut self, id: Id, facts: &mut MeshFacts, end: &mut u64) -> Result<(), Error> {
        let pointee = self.variables[&id].pointee;
        let TypeKind::Array { element, count } = *self.types.kind(pointee)? else {
            return Err(self.b.invalid("an output of a mesh shader is an array"));
        };
        let built_in = self.module.annotations.id(id, Decoration::BuiltIn);
        let built_in = built_in.and_then(BuiltIn::from_u32);
        let of_primitives = self.is_of_primitive(id) || built_in.is_some_and(is_of_primitives);
        let stride = self.shared_layout().array_stride(pointee)?;
        let (size, align) = self.shared_layout().natural(pointee)?;
        let start = end.next_multiple_of(align.max(16));
        // Room for the largest count, independent of the array's length.
        let elements = match of_primitives {
            true => facts.max_primitives,
            false => facts.max_vertices,
        };
        let more = u64::from(elements.saturating_sub(count));
        let after = start.saturating_add(size.saturating_add(more.saturating_mul(stride)));
        self.check_memory(after)?;
        *end = after.next_multiple_of(16);
        self.workgroup.offsets.insert(id, start as u32);
        let used = self.used_members(id, element)?;
        let words = self.memory_words(id, element, start, stride, &used)?;
        let kept = match of_primitives {
            true => &mut facts.primitives,
            false => &mut facts.vertices,
        };
        kept.extend(words);
        match kept.len() > MAX_ELEMENT_WORDS {
            true => Err(budget("a stage's interface is too large")),
            false => Ok(()),
        }
    }

    /// The used members of an array's blocks, since compilers declare all built-in members. Outputs
    /// that are never written do not exist, like those that [`crate::pass::trim_outputs`] removes.
    fn used_members(&self, id: Id, element: Id) -> Result<Vec<bool>, Error> {
        let members = match self.types.kind(element)? {
            TypeKind::Struct { members } => members.len(),
            _ => 1,
        };
        let is_block = matches!(self.types.kind(element)?, TypeKind::Struct { .. });
        let mut used = vec![false; members];
        let functions = self.module.functions.iter();
        for block in functions.flat_map(|function| &function.blocks) {
            for &index in &block.instructions {
                let instruction = self.module.instruction(index);
                if !self.module.uses(instruction).contains(&id) {
                    continue;
                }
                let operands = self.module.operands(instruction);
                let is_chain = matches!(
                    instruction.opcode,
                    Op::AccessChain | Op::InBoundsAccessChain
                );
                let member = match operands {
                    &[base, _, member, ..] if is_chain && is_block && base == id => {
                        self.constants.unsigned(&self.types, member).ok()
                    }
                    _ => None,
                };
                match member.and_then(|member| used.get_mut(member as usize)) {
                    Some(used) => *used = true,
                    None => used.fill(true),
                }
            }
        }
        Ok(used)
    }

    /// `OpSetMeshOutputsEXT`.
    pub(super) fn lower_set_mesh_outputs(
        &mut self,
        instruction: &Instruction,
    ) -> Result<(), Error> {
        if !self.is_mesh() {
            return Err(self.unsupported(instruction));
        }
        let operands = self.module.operands(instruction);
        self.store_counts(&[operands[0], operands[1]])
    }

    /// `OpEmitMeshTasksEXT`, which ends the invocation.
    pub(super) fn emit_mesh_tasks(&mut self, counts: &[Id]) -> Result<Terminator, Error> {
        if self.request.stage != Stage::Task {
            return Err(self.b.invalid("only task shaders emit mesh tasks"));
        }
        self.store_counts(counts)?;
        self.end_invocation(super::interface::Verdict::Accept)
    }

    /// Stores the workgroup's counts, which are those of its first invocation. Other invocations
    /// store to unused memory.
    fn store_counts(&mut self, ids: &[Id]) -> Result<(), Error> {
        let Some(facts) = &self.stage.mesh else {
            return Err(self.b.invalid("there are no counts in this stage"));
        };
        let (at, past) = (facts.counts_offset, facts.counts_offset + COUNTS_BYTES / 2);
        let index = InputRow::Builtin(Builtin::LocalInvocationIndex, 0);
        let index = self.input(index, Type::I32)?;
        let (zero, at, past) = (self.b.i32(0), self.b.i32(at), self.b.i32(past));
        let is_first = self.b.compare(ir::Op::IEq, index, zero)?;
        let at = self.b.select(is_first, at, past)?;
        let mut counts = Vec::with_capacity(ids.len());
        for &id in ids {
            let count = self.scalar(id)?;
            counts.push(self.b.i32_of(count, false)?);
        }
        self.b.store(Access::plain(Space::Shared), &[at], &counts)
    }
}
