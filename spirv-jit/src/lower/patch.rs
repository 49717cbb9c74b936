//! The interface of tessellation shaders. A control shader's inputs and outputs are in workgroup
//! memory, patch by patch, because its invocations read each other's outputs after barriers.

use rspirv::spirv::{BuiltIn, Decoration, ExecutionMode, StorageClass};

use super::types::TypeKind;
use super::values::{MemoryLocation, Pointer, Shape};
use super::{Lowerer, budget};
use crate::ir::stage::{Builtin, Stage};
use crate::ir::tessellation::{
    ControlFacts, Domain, MAX_PATCH_VERTICES, PatchWord, Spacing, TessellationFacts,
    TessellationModes, Width,
};
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::Id;
use crate::{Error, SUBGROUP_SIZE};

/// Words of a patch, at most: far beyond any device's limit.
const MAX_PATCH_WORDS: usize = 1 << 12;

impl Lowerer<'_> {
    pub(super) fn is_control(&self) -> bool {
        self.request.stage == Stage::TessellationControl
    }

    /// Records the facts of a tessellation shader, and places the variables of a control shader.
    pub(super) fn declare_tessellation(&mut self) -> Result<(), Error> {
        let is_evaluation = self.request.stage == Stage::TessellationEvaluation;
        if !self.is_control() && !is_evaluation {
            return Ok(());
        }
        let (modes, vertices) = self.tessellation_modes();
        let mut facts = TessellationFacts {
            modes,
            control: None,
        };
        if is_evaluation {
            self.stage.tessellation = Some(facts);
            return Ok(());
        }
        let mut control = ControlFacts::default();
        let mut ids: Vec<Id> = (self.variables.iter())
            .filter(|(_, it)| matches!(it.class, StorageClass::Input | StorageClass::Output))
            .map(|(&id, _)| id)
            .filter(|&id| self.is_listed(id) && self.entry.interface.contains(&id))
            .collect();
        ids.sort_unstable();
        // The evaluation shader may declare the number of vertices.
        let vertices = vertices.or_else(|| ids.iter().find_map(|&id| self.output_vertices(id)));
        control.vertices = vertices.unwrap_or(1);
        if !(1..=MAX_PATCH_VERTICES).contains(&control.vertices) {
            return Err(self.b.invalid("a patch has 1 to 32 vertices"));
        }
        let mut end = 0u64;
        for &id in &ids {
            self.place_in_patch(id, &mut control, &mut end)?;
        }
        control.patch_bytes = end.next_multiple_of(16) as u32;
        self.workgroup.size_bytes = control.patch_bytes * control.patches();
        facts.control = Some(control);
        self.stage.tessellation = Some(facts);
        self.initialize_outputs(&ids)
    }

    /// The execution modes of a tessellation shader, and `OutputVertices`.
    fn tessellation_modes(&self) -> (TessellationModes, Option<u32>) {
        let mut modes = TessellationModes::default();
        let mut vertices = None;
        for (mode, numbers) in self.execution_modes() {
            match mode {
                ExecutionMode::Triangles => modes.domain = Some(Domain::Triangles),
                ExecutionMode::Quads => modes.domain = Some(Domain::Quads),
                ExecutionMode::Isolines => modes.domain = Some(Domain::Isolines),
                ExecutionMode::SpacingEqual => modes.spacing = Some(Spacing::Equal),
                ExecutionMode::SpacingFractionalEven => {
                    modes.spacing = Some(Spacing::FractionalEven);
                }
                ExecutionMode::SpacingFractionalOdd => {
                    modes.spacing = Some(Spacing::FractionalOdd);
                }
                ExecutionMode::VertexOrderCw => modes.clockwise = Some(true),
                ExecutionMode::VertexOrderCcw => modes.clockwise = Some(false),
                ExecutionMode::PointMode => modes.point_mode = true,
                ExecutionMode::OutputVertices => vertices = numbers.first().copied(),
                _ => {}
            }
        }
        (modes, vertices)
    }

    /// Elements of an output with a value for each vertex.
    fn output_vertices(&self, id: Id) -> Option<u32> {
        let variable = self.variables[&id];
        match *self.types.kind(variable.pointee).ok()? {
            TypeKind::Array { element, count } if variable.class == StorageClass::Output => {
                let built_in = self.module.annotations.id(id, Decoration::BuiltIn);
                let built_in = built_in.and_then(BuiltIn::from_u32);
                self.is_per_vertex(id, element, built_in).then_some(count)
            }
            _ => None,
        }
    }

    /// Whether a variable is of the patch (`Patch`), by its own decoration or by those of its
    /// block's members.
    pub(super) fn is_of_patch(&self, id: Id) -> bool {
        self.is_decorated(id, Decoration::Patch)
    }

    /// Whether a variable has a decoration, or the members of its block have it.
    pub(super) fn is_decorated(&self, id: Id, decoration: Decoration) -> bool {
        let annotations = &self.module.annotations;
        let mut ty = self.variables[&id].pointee;
        while let Ok(TypeKind::Array { element, .. }) = self.types.kind(ty) {
            ty = *element;
        }
        annotations.id(id, decoration).is_some() || annotations.member(ty, 0, decoration).is_some()
    }

    /// Assigns the location of a control shader's outputs and vertex inputs.
    fn place_in_patch(
        &mut self,
        id: Id,
        control: &mut ControlFacts,
        end: &mut u64,
    ) -> Result<(), Error> {
        let variable = self.variables[&id];
        let is_input = variable.class == StorageClass::Input;
        let built_in = self.module.annotations.id(id, Decoration::BuiltIn);
        let built_in = built_in.and_then(BuiltIn::from_u32);
        let mut ty = variable.pointee;
        let mut stride = 0;
        let mut elements = 1;
        if let TypeKind::Array { element, count } = *self.types.kind(ty)?
            && self.is_per_vertex(id, element, built_in)
        {
            stride = self.shared_layout().array_stride(ty)?;
            (ty, elements) = (element, count);
        } else if is_input {
            return Ok(());
        }
        let (size, align) = self.shared_layout().natural(variable.pointee)?;
        let start = end.next_multiple_of(align.max(16));
        // Room for the largest number of vertices, independent of the array's length.
        let vertices = match is_input {
            true => MAX_PATCH_VERTICES,
            false => control.vertices,
        };
        let more = u64::from(vertices.saturating_sub(elements));
        *end = start.saturating_add(size.saturating_add(more.saturating_mul(stride)));
        if *end > (ir::MAX_SHARED_BYTES / SUBGROUP_SIZE as u32).into() {
            return Err(budget("the values of a patch are too large"));
        }
        self.workgroup.offsets.insert(id, start as u32);
        let kept = match is_input {
            true => &mut control.inputs,
            false => &mut control.outputs,
        };
        kept.extend(self.memory_words(id, ty, start, stride, &[])?);
        match kept.len() > MAX_PATCH_WORDS {
            true => Err(budget("a stage's interface is too large")),
            false => Ok(()),
        }
    }

    /// The words of (an element of) a variable in workgroup memory at `start`, without members that
    /// are not `used`.
    pub(super) fn memory_words(
        &self,
        id: Id,
        ty: Id,
        start: u64,
        stride: u64,
        used: &[bool],
    ) -> Result<Vec<PatchWord>, Error> {
        let mut leaves_used = Vec::new();
        match self.types.kind(ty)? {
            TypeKind::Struct { members } => {
                for (index, &member) in members.iter().enumerate() {
                    let is_used = used.get(index) != Some(&false);
                    let count = self.types.leaves(member)?.len();
                    leaves_used.extend(std::iter::repeat_n(is_used, count));
                }
            }
            _ if used.first() == Some(&false) => return Ok(Vec::new()),
            _ => {}
        }
        let mut words = self.element_words(id, ty)?.into_iter();
        let mut kept = Vec::new();
        let leaves = self.shared_layout().leaves(ty, Shape::default())?;
        for (leaf, (ty, offset)) in leaves.into_iter().enumerate() {
            let width = match ty {
                Type::I8 => Width::Byte,
                Type::I16 => Width::Short,
                Type::F16 => Width::Half,
                _ => Width::Word,
            };
            for part in 0..ty.rows() {
                let Some(word) = words.next() else {
                    return Err(self.b.invalid("a value lacks words"));
                };
                if leaves_used.get(leaf) == Some(&false) {
                    continue;
                }
                kept.push(PatchWord {
                    row: self.output_row(word)?,
                    offset_bytes: (start + offset) as u32 + 4 * part,
                    stride_bytes: stride as u32,
                    width,
                });
            }
        }
        Ok(kept)
    }

    /// The location of an input or output of a control or mesh shader in workgroup memory.
    pub(super) fn patch_place(&mut self, id: Id) -> Result<Option<MemoryLocation>, Error> {
        let is_there = self.is_control() || self.is_mesh();
        let Some(&constant) = self.workgroup.offsets.get(&id).filter(|_| is_there) else {
            return Ok(None);
        };
        let offset = match self.is_control() {
            true => self.patch_offset()?,
            false => None,
        };
        Ok(Some(MemoryLocation::Shared { offset, constant }))
    }

    /// Offset of the invocation's patch, if a subgroup has several.
    fn patch_offset(&mut self) -> Result<Option<Value>, Error> {
        let facts = self.stage.tessellation.as_ref();
        let control = facts.and_then(|facts| facts.control.as_ref());
        if control.is_some_and(|control| control.patches() == 1) {
            return Ok(None);
        }
        let row = InputRow::Builtin(Builtin::PatchOffset, 0);
        self.input(row, Type::I32).map(Some)
    }

    /// Stores the initial values of outputs before any invocation proceeds.
    fn initialize_outputs(&mut self, ids: &[Id]) -> Result<(), Error> {
        let mut any = false;
        for &id in ids {
            let variable = self.variables[&id];
            let (Some(initializer), Some(place)) = (variable.initializer, self.patch_place(id)?)
            else {
                continue;
            };
            let pointer = Pointer::new(variable.pointee, place);
            if self.is_large(variable.pointee) {
                self.fill_from(pointer, initializer)?;
            } else {
                let values = self.initializer(initializer)?;
                self.store(&pointer, &values)?;
            }
            any = true;
        }
        match any {
            true => self.control_barrier(),
            false => Ok(()),
        }
    }

    /// A barrier of the invocations of a patch. A single subgroup needs none.
    pub(super) fn control_barrier(&mut self) -> Result<(), Error> {
        self.b.emit_effect(ir::Op::MemoryBarrier, &[])?;
        let facts = self.stage.tessellation.as_ref();
        let control = facts.and_then(|facts| facts.control.as_ref());
        if control.is_some_and(|control| control.subgroups() > 1) {
            self.b.emit_effect(ir::Op::Barrier, &[])?;
        }
        Ok(())
    }
}
