//! Shader stages.

/// A shader stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    Compute,
    RayGeneration,
    Miss,
    ClosestHit,
    AnyHit,
    Intersection,
    Callable,
    Vertex,
    TessellationControl,
    TessellationEvaluation,
    Geometry,
    Task,
    Mesh,
    Fragment,
}

impl Stage {
    /// The name that glslang's program gives the files of this stage.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Compute => "comp",
            Stage::RayGeneration => "rgen",
            Stage::Miss => "rmiss",
            Stage::ClosestHit => "rchit",
            Stage::AnyHit => "rahit",
            Stage::Intersection => "rint",
            Stage::Callable => "rcall",
            Stage::Vertex => "vert",
            Stage::TessellationControl => "tesc",
            Stage::TessellationEvaluation => "tese",
            Stage::Geometry => "geom",
            Stage::Task => "task",
            Stage::Mesh => "mesh",
            Stage::Fragment => "frag",
        }
    }

    /// Whether draws run the stage.
    pub fn is_of_draws(self) -> bool {
        matches!(
            self,
            Stage::Vertex
                | Stage::TessellationControl
                | Stage::TessellationEvaluation
                | Stage::Geometry
                | Stage::Task
                | Stage::Mesh
                | Stage::Fragment
        )
    }

    /// Whether the stage is one of mesh pipelines.
    pub fn is_of_meshes(self) -> bool {
        matches!(self, Stage::Task | Stage::Mesh | Stage::Fragment)
    }
}
