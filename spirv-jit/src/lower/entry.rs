//! The entry point: its function and the workgroup's size.

use rspirv::spirv::{BuiltIn, Decoration, ExecutionMode, ExecutionModel};

use super::Lowerer;
use crate::Error;
use crate::error::ErrorKind;
use crate::ir::MAX_INVOCATIONS;
use crate::ir::stage::Stage;
use crate::parse::{EntryPoint, ParsedModule, newer};
use crate::request::CompileRequest;

/// The entry point of a request.
pub(super) fn find_entry<'a>(
    parsed: &'a ParsedModule,
    request: &CompileRequest<'_>,
) -> Result<&'a EntryPoint, Error> {
    let model = match request.stage {
        Stage::Compute => ExecutionModel::GLCompute,
        Stage::RayGeneration => ExecutionModel::RayGenerationKHR,
        Stage::Intersection => ExecutionModel::IntersectionKHR,
        Stage::AnyHit => ExecutionModel::AnyHitKHR,
        Stage::ClosestHit => ExecutionModel::ClosestHitKHR,
        Stage::Miss => ExecutionModel::MissKHR,
        Stage::Callable => ExecutionModel::CallableKHR,
        Stage::Vertex => ExecutionModel::Vertex,
        Stage::TessellationControl => ExecutionModel::TessellationControl,
        Stage::TessellationEvaluation => ExecutionModel::TessellationEvaluation,
        Stage::Geometry => ExecutionModel::Geometry,
        Stage::Task => ExecutionModel::TaskEXT,
        Stage::Mesh => ExecutionModel::MeshEXT,
        Stage::Fragment => ExecutionModel::Fragment,
    };
    let mut entries = parsed.entry_points.iter();
    let found = entries.find(|entry| entry.model == model && entry.name == request.entry_point);
    found.ok_or_else(|| Error {
        kind: ErrorKind::EntryPoint,
        word_offset: None,
        message: format!(
            "there is no {model:?} entry point \"{}\"",
            request.entry_point
        ),
    })
}

impl Lowerer<'_> {
    /// The entry point's execution modes that the bindings have, with their operands.
    pub(super) fn execution_modes(&self) -> impl Iterator<Item = (ExecutionMode, &[u32])> {
        let known = |(mode, operands)| Some((ExecutionMode::from_u32(mode)?, operands));
        self.raw_execution_modes().filter_map(known)
    }

    /// All execution modes by number, also those that the bindings lack.
    fn raw_execution_modes(&self) -> impl Iterator<Item = (u32, &[u32])> {
        let modes = self.module.execution_modes.iter();
        modes.filter_map(|&index| {
            let operands = self.module.operands(self.module.instruction(index));
            let &[function, mode, ref operands @ ..] = operands else {
                return None;
            };
            (function == self.entry.function).then_some((mode, operands))
        })
    }

    /// Whether the pipeline or the entry point asks for 64-bit indexing.
    pub(super) fn indexes_in_64_bits(&self) -> bool {
        let mut modes = self.execution_modes();
        self.request.indexes_in_64_bits
            || modes.any(|(mode, _)| mode == ExecutionMode::Shader64BitIndexingEXT)
    }

    /// Whether ray queries ignore opacity micromaps.
    pub(super) fn ignores_micromaps(&self) -> Result<bool, Error> {
        let mut modes = self.raw_execution_modes();
        match modes.find(|&(mode, _)| mode == newer::OPACITY_MICROMAP_ID) {
            Some((_, &[enable, ..])) => Ok(*self.constants.bits(&self.types, enable)? == [0]),
            _ => Ok(self.request.micromaps_by_mode),
        }
    }

    /// The workgroup's size. The `WorkgroupSize` constant takes precedence over the execution
    /// modes.
    pub(super) fn local_size(&self) -> Result<[u32; 3], Error> {
        let mut size = [1; 3];
        if !self.request.stage.has_workgroups() {
            return Ok(size);
        }
        for (mode, operands) in self.execution_modes() {
            match mode {
                ExecutionMode::LocalSize if operands.len() >= 3 => {
                    size.copy_from_slice(&operands[..3]);
                }
                ExecutionMode::LocalSizeId if operands.len() >= 3 => {
                    for (slot, &id) in size.iter_mut().zip(operands) {
                        *slot = self.constants.unsigned(&self.types, id)?;
                    }
                }
                _ => {}
            }
        }
        for &index in &self.module.globals {
            let id = self.module.instruction(index).result;
            let built_in = self.module.annotations.id(id, Decoration::BuiltIn);
            if built_in == Some(BuiltIn::WorkgroupSize as u32) && self.constants.find(id).is_some()
            {
                for (slot, &bits) in size.iter_mut().zip(&*self.constants.bits(&self.types, id)?) {
                    *slot = bits as u32;
                }
            }
        }
        let invocations = size.iter().map(|&size| size as u64);
        let invocations = invocations.fold(1u64, |product, size| product.saturating_mul(size));
        if invocations == 0 || invocations > MAX_INVOCATIONS {
            let [x, y, z] = size;
            let message = format!(
                "a workgroup of {x} × {y} × {z} has {invocations} invocations: 1 to {MAX_INVOCATIONS} are possible"
            );
            return Err(Error::invalid(0, message));
        }
        Ok(size)
    }
}
