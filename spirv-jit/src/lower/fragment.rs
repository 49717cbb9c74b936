//! The facts of fragment shaders that the rasterizer needs.

use rspirv::spirv::{BuiltIn, Decoration, ExecutionMode, StorageClass};

use super::Lowerer;
use crate::ir::InputRow;
use crate::ir::interface::{DepthMode, FragmentFacts, Interlock, OutputRow, Position, VaryingMode};
use crate::ir::stage::{Builtin, Stage};

impl Lowerer<'_> {
    /// The facts of a fragment shader from execution modes and outputs.
    pub(super) fn fragment_facts(&self) -> Option<FragmentFacts> {
        if self.request.stage != Stage::Fragment {
            return None;
        }
        let mut facts = FragmentFacts {
            reads_attachments: self.interface.reads_attachments,
            ..FragmentFacts::default()
        };
        let mut mode = DepthMode::Any;
        for (execution_mode, _) in self.execution_modes() {
            match execution_mode {
                ExecutionMode::EarlyFragmentTests => facts.early_tests = true,
                ExecutionMode::PostDepthCoverage => facts.post_depth_coverage = true,
                ExecutionMode::RequireFullQuadsKHR => facts.full_quads = true,
                ExecutionMode::DepthGreater => mode = DepthMode::Greater,
                ExecutionMode::DepthLess => mode = DepthMode::Less,
                ExecutionMode::DepthUnchanged => mode = DepthMode::Unchanged,
                ExecutionMode::PixelInterlockOrderedEXT => {
                    facts.interlock = Some(Interlock::PixelOrdered);
                }
                ExecutionMode::PixelInterlockUnorderedEXT => {
                    facts.interlock = Some(Interlock::PixelUnordered);
                }
                ExecutionMode::SampleInterlockOrderedEXT => {
                    facts.interlock = Some(Interlock::SampleOrdered);
                }
                ExecutionMode::SampleInterlockUnorderedEXT => {
                    facts.interlock = Some(Interlock::SampleUnordered);
                }
                _ => {}
            }
        }
        for row in &self.interface.outputs {
            match *row {
                OutputRow::Location {
                    location, index, ..
                } => {
                    facts.color_mask |= 1u32.checked_shl(location.into()).unwrap_or(0);
                    facts.dual_source |= index == 1;
                }
                OutputRow::FragDepth => facts.depth = Some(mode),
                OutputRow::FragStencilRef => facts.writes_stencil_ref = true,
                OutputRow::SampleMask => facts.writes_sample_mask = true,
                _ => {}
            }
        }
        facts.per_sample = self.interface.inputs.iter().any(|row| match row {
            InputRow::Builtin(Builtin::SampleId | Builtin::SamplePosition, _) => true,
            InputRow::Varying(varying) => matches!(
                varying.mode,
                VaryingMode::Smooth(Position::Sample) | VaryingMode::Linear(Position::Sample)
            ),
            InputRow::Barycentric(coordinate) => coordinate.position == Position::Sample,
            _ => false,
        });
        // Variables of the interface count, whether they are read or not (Vulkan, "Sample
        // Shading").
        facts.per_sample |= self.entry.interface.iter().any(|&id| {
            let annotations = &self.module.annotations;
            let built_in = annotations.id(id, Decoration::BuiltIn);
            let built_in = built_in.and_then(BuiltIn::from_u32);
            let variable = self.variables.get(&id);
            variable.is_some_and(|variable| variable.class == StorageClass::Input)
                && (matches!(built_in, Some(BuiltIn::SampleId | BuiltIn::SamplePosition))
                    || annotations.id(id, Decoration::Sample).is_some())
        });
        Some(facts)
    }
}
