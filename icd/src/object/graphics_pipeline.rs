//! Graphics pipelines, whole or in parts.

#![forbid(unsafe_code)]

use std::sync::Arc;

use spirv_jit::Program;
use spirv_jit::program::Stage;

use super::dynamic_state::{DynamicStates, Parts};
use super::graphics_state::GraphicsState;

/// The stages of drawing, in the order in which they run.
const STAGES: [Stage; 7] = [
    Stage::Vertex,
    Stage::TessellationControl,
    Stage::TessellationEvaluation,
    Stage::Geometry,
    Stage::Task,
    Stage::Mesh,
    Stage::Fragment,
];

/// The programs of a bound graphics pipeline or of bound shader objects, by stage. Without a
/// fragment program a draw writes depth and stencil alone.
#[derive(Clone, Default)]
pub struct Stages([Option<Arc<Program>>; STAGES.len()]);

impl Stages {
    fn place(stage: Stage) -> Option<usize> {
        STAGES.iter().position(|&other| other == stage)
    }

    /// Whether a stage takes part in drawing.
    pub fn has(stage: Stage) -> bool {
        Self::place(stage).is_some()
    }

    /// Sets or removes the program of a drawing stage.
    pub fn set(&mut self, stage: Stage, program: Option<Arc<Program>>) {
        if let Some(place) = Self::place(stage) {
            self.0[place] = program;
        }
    }

    fn of(&self, stage: Stage) -> Option<&Arc<Program>> {
        self.0[Self::place(stage)?].as_ref()
    }

    pub fn vertex(&self) -> Option<&Program> {
        self.of(Stage::Vertex).map(|program| &**program)
    }

    /// The tessellation control and evaluation programs.
    pub fn tessellation(&self) -> Option<(&Program, &Program)> {
        let control = self.of(Stage::TessellationControl)?;
        Some((control, self.of(Stage::TessellationEvaluation)?))
    }

    /// Whether only one of the two tessellation programs is bound, so that nothing can be drawn.
    pub fn lacks_tessellation(&self) -> bool {
        let control = self.of(Stage::TessellationControl);
        control.is_some() != self.of(Stage::TessellationEvaluation).is_some()
    }

    pub fn geometry(&self) -> Option<&Program> {
        self.of(Stage::Geometry).map(|program| &**program)
    }

    /// The mesh program, which replaces all stages above.
    pub fn mesh(&self) -> Option<&Program> {
        self.of(Stage::Mesh).map(|program| &**program)
    }

    /// The task program before the mesh program.
    pub fn task(&self) -> Option<&Program> {
        self.mesh()?;
        self.of(Stage::Task).map(|program| &**program)
    }

    /// Whether a stage can produce many primitives from one, or from a workgroup.
    pub fn amplifies(&self) -> bool {
        self.geometry().is_some() || self.mesh().is_some()
    }

    pub fn fragment(&self) -> Option<&Program> {
        self.of(Stage::Fragment).map(|program| &**program)
    }

    /// The program of the last stage before rasterization, whose outputs the rasterizer takes.
    pub fn last(&self) -> Option<&Program> {
        let [before @ .., _] = &self.0;
        before
            .iter()
            .rev()
            .flatten()
            .next()
            .map(|program| &**program)
    }

    /// The bound programs, in the order in which they run.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Program>> + Clone {
        self.0.iter().flatten()
    }

    /// Copies the programs of the stages for which `wanted` holds.
    fn take(&mut self, from: &Self, wanted: impl Fn(Stage) -> bool) {
        for (place, stage) in STAGES.into_iter().enumerate() {
            if wanted(stage) {
                self.0[place].clone_from(&from.0[place]);
            }
        }
    }

    /// Whether both run the same programs.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.0.iter().zip(&other.0)).all(|programs| match programs {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (one, other) => one.is_none() && other.is_none(),
        })
    }
}

impl FromIterator<Arc<Program>> for Stages {
    fn from_iter<I: IntoIterator<Item = Arc<Program>>>(programs: I) -> Self {
        let mut stages = Self::default();
        for program in programs {
            stages.set(program.stage(), Some(program));
        }
        stages
    }
}

/// A graphics pipeline, or a library with some of its parts (`VK_EXT_graphics_pipeline_library`).
pub struct GraphicsPipeline {
    pub parts: Parts,
    /// The state of the parts that are there; the rest is the default.
    pub state: GraphicsState,
    pub dynamic: DynamicStates,
    pub stages: Arc<Stages>,
}

impl GraphicsPipeline {
    /// A pipeline without any part.
    pub fn empty() -> Self {
        Self {
            parts: Parts::empty(),
            state: GraphicsState::default(),
            dynamic: DynamicStates::default(),
            stages: Arc::default(),
        }
    }

    /// Sets the program of its stage.
    pub fn set_program(&mut self, stage: Stage, program: Arc<Program>) {
        Arc::make_mut(&mut self.stages).set(stage, Some(program));
    }

    /// Copies the parts of a library, or the pipeline's own parts.
    pub fn link(&mut self, part: &GraphicsPipeline) {
        let new = part.parts & !self.parts;
        self.state.take_parts(new, &part.state);
        self.dynamic = self.dynamic.union(part.dynamic);
        self.parts |= part.parts;
        let stages = Arc::make_mut(&mut self.stages);
        stages.take(&part.stages, |stage| {
            new.contains(match stage {
                Stage::Fragment => Parts::FRAGMENT_SHADER,
                _ => Parts::PRE_RASTERIZATION_SHADERS,
            })
        });
    }
}
