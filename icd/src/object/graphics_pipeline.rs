//! Graphics pipelines, whole or in parts.

#![forbid(unsafe_code)]

use std::sync::Arc;

use spirv_jit::Program;
use spirv_jit::program::Stage;

use super::dynamic_state::{DynamicStates, Parts};
use super::graphics_state::GraphicsState;

/// The programs of a bound graphics pipeline or of bound shader objects.
pub struct Stages {
    pub vertex: Arc<Program>,
    /// None: depth and stencil alone, coverage without colour.
    pub fragment: Option<Arc<Program>>,
}

impl Stages {
    /// Whether both run the same programs.
    pub fn is_same(&self, other: &Self) -> bool {
        let fragments = (self.fragment.as_ref(), other.fragment.as_ref());
        let same_fragment = match fragments {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (one, other) => one.is_none() && other.is_none(),
        };
        same_fragment && Arc::ptr_eq(&self.vertex, &other.vertex)
    }
}

/// A graphics pipeline, or a library with some of its parts (`VK_EXT_graphics_pipeline_library`).
pub struct GraphicsPipeline {
    pub parts: Parts,
    /// Of the parts that it has; all else is the default.
    pub state: GraphicsState,
    pub dynamic: DynamicStates,
    pub vertex: Option<Arc<Program>>,
    pub fragment: Option<Arc<Program>>,
    /// The programs of a draw; none for a library without a vertex shader.
    pub stages: Option<Arc<Stages>>,
}

impl GraphicsPipeline {
    /// A pipeline without any part.
    pub fn empty() -> Self {
        Self {
            parts: Parts::empty(),
            state: GraphicsState::default(),
            dynamic: DynamicStates::default(),
            vertex: None,
            fragment: None,
            stages: None,
        }
    }

    /// Puts a program in its place.
    pub fn set_program(&mut self, stage: Stage, program: Arc<Program>) {
        match stage {
            Stage::Fragment => self.fragment = Some(program),
            _ => self.vertex = Some(program),
        }
    }

    /// Takes over the parts of a library, or those that a pipeline itself comes with.
    pub fn link(&mut self, part: &GraphicsPipeline) {
        let new = part.parts & !self.parts;
        self.state.take_parts(new, &part.state);
        self.dynamic = self.dynamic.union(part.dynamic);
        self.parts |= part.parts;
        if new.contains(Parts::PRE_RASTERIZATION_SHADERS) {
            self.vertex.clone_from(&part.vertex);
        }
        if new.contains(Parts::FRAGMENT_SHADER) {
            self.fragment.clone_from(&part.fragment);
        }
        self.stages = self.vertex.as_ref().map(|vertex| {
            Arc::new(Stages {
                vertex: Arc::clone(vertex),
                fragment: self.fragment.clone(),
            })
        });
    }
}
