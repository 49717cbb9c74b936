//! Vertices that geometry shaders emit.

use rspirv::spirv::{Capability, ExecutionMode, Op};

use super::{Lowerer, budget};
use crate::Error;
use crate::ir::interface::{Emits, GeometryFacts};
use crate::ir::stage::Stage;
use crate::ir::transform_feedback::MAX_STREAMS;
use crate::ir::{self, Type, VariableId};
use crate::parse::Instruction;

/// Rows of emitted vertices: far beyond any device's limit.
const MAX_ROWS: u64 = 1 << 14;

/// The emission state of a geometry shader.
pub(super) struct Emission {
    pub facts: GeometryFacts,
    /// The number of vertices so far, and for each stream whether its next vertex starts a strip.
    pub variable: VariableId,
}

impl Lowerer<'_> {
    /// Sets up the emission of a geometry shader with known outputs. Each vertex stores all
    /// outputs, and the invocation returns the number of vertices.
    pub(super) fn declare_emission(&mut self) -> Result<(), Error> {
        if self.request.stage != Stage::Geometry {
            return Ok(());
        }
        let facts = self.geometry_facts()?;
        let words = self.interface.outputs.len() as u64 + 1;
        if (u64::from(facts.max_vertices) + 1).saturating_mul(words) > MAX_ROWS {
            return Err(budget("a geometry shader emits too many vertices"));
        }
        self.interface.output_rows = 1;
        let streams = if facts.streams { MAX_STREAMS } else { 1 };
        let variable = self.new_rows("emitted", 1 + streams)?;
        let (zero, one) = (self.b.i32(0), self.b.i32(1));
        let mut words = vec![zero];
        words.resize(1 + streams as usize, one);
        self.store_rows(variable, &words)?;
        self.stage.emission = Some(Emission { facts, variable });
        Ok(())
    }

    fn geometry_facts(&self) -> Result<GeometryFacts, Error> {
        let mut facts = GeometryFacts {
            invocations: 1,
            streams: (self.module.capabilities.iter())
                .any(|&(capability, _)| capability == Capability::GeometryStreams),
            ..GeometryFacts::default()
        };
        let mut emits = None;
        for (mode, numbers) in self.execution_modes() {
            let number = numbers.first().copied().unwrap_or(0);
            match mode {
                ExecutionMode::InputPoints => facts.vertices = 1,
                ExecutionMode::InputLines => facts.vertices = 2,
                ExecutionMode::InputLinesAdjacency => facts.vertices = 4,
                ExecutionMode::Triangles => facts.vertices = 3,
                ExecutionMode::InputTrianglesAdjacency => facts.vertices = 6,
                ExecutionMode::OutputPoints => emits = Some(Emits::Points),
                ExecutionMode::OutputLineStrip => emits = Some(Emits::LineStrips),
                ExecutionMode::OutputTriangleStrip => emits = Some(Emits::TriangleStrips),
                ExecutionMode::Invocations => facts.invocations = number,
                ExecutionMode::OutputVertices => facts.max_vertices = number,
                _ => {}
            }
        }
        match emits {
            Some(emits) if facts.vertices != 0 => Ok(GeometryFacts { emits, ..facts }),
            _ => Err(self
                .b
                .invalid("a geometry shader lacks its kinds of primitives")),
        }
    }

    /// `OpEmitVertex`, `OpEndPrimitive`, and the same of a stream.
    pub(super) fn lower_emission(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let stream = match self.module.operands(instruction) {
            &[stream, ..] => self.constants.unsigned(&self.types, stream)?,
            [] => 0,
        };
        let Some(emission) = &self.stage.emission else {
            return Err(self.b.invalid("only geometry shaders emit vertices"));
        };
        let (variable, most) = (emission.variable, emission.facts.max_vertices);
        let streams = if emission.facts.streams {
            MAX_STREAMS
        } else {
            1
        };
        if stream >= streams {
            return Err(self.b.invalid("no such stream of vertices"));
        }
        let (one, row) = (self.b.i32(1), 1 + stream);
        if matches!(
            instruction.opcode,
            Op::EndPrimitive | Op::EndStreamPrimitive
        ) {
            let starts = ir::Op::VarStore(variable, row);
            return self.b.emit_effect(starts, &[one]);
        }
        let load = |row| ir::Op::VarLoad(variable, row);
        let vertex = self.b.emit(load(0), &[], Type::I32)?;
        let mut starts = self.b.emit(load(row), &[], Type::I32)?;
        if stream > 0 {
            let place = self.b.i32(stream << 1);
            starts = self.b.binary(ir::Op::Or, starts, place)?;
        }
        let mut words = vec![vertex, starts];
        words.extend(self.output_words()?);
        self.b.emit_effect(ir::Op::Emit, &words)?;
        let next = self.b.binary(ir::Op::IAdd, vertex, one)?;
        let most = self.b.i32(most);
        let next = self.b.binary(ir::Op::UMin, next, most)?;
        let zero = self.b.i32(0);
        (self.b).emit_effect(ir::Op::VarStore(variable, 0), &[next])?;
        self.b.emit_effect(ir::Op::VarStore(variable, row), &[zero])
    }
}
