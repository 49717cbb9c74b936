//! The contents of a pipeline that its creation flags ask to keep for the application.

#![forbid(unsafe_code)]

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::Program;
use spirv_jit::ir::{Module, binary};

use super::pipeline_binary::PipelineBinary;
use super::stage_program::StageProgram;

/// `VK_PIPELINE_CREATE_2_CAPTURE_DATA_BIT_KHR`, in the lower half of the newer flags.
const CAPTURE_DATA: vk::PipelineCreateFlags = vk::PipelineCreateFlags::from_raw(1 << 31);

/// The flags for tools that look at executables.
const CAPTURE_EXECUTABLES: vk::PipelineCreateFlags = vk::PipelineCreateFlags::from_raw(
    vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR.as_raw()
        | vk::PipelineCreateFlags::CAPTURE_INTERNAL_REPRESENTATIONS_KHR.as_raw(),
);

/// Whether a pipeline keeps the modules of its programs.
pub fn keeps_modules(flags: vk::PipelineCreateFlags) -> bool {
    flags.intersects(CAPTURE_DATA | CAPTURE_EXECUTABLES)
}

/// The captures of a pipeline.
#[derive(Default)]
pub struct Captured {
    /// The binary of the pipeline's own stages, until the application releases it.
    pub binary: Mutex<Option<PipelineBinary>>,
    /// Programs with their modules, those of linked libraries included.
    programs: Mutex<Vec<StageProgram>>,
}

impl Captured {
    /// The captures that the flags ask for, of a pipeline's own programs and of its libraries.
    pub fn of<'a>(
        flags: vk::PipelineCreateFlags,
        own: Vec<StageProgram>,
        libraries: impl Iterator<Item = &'a Captured>,
    ) -> Self {
        let binary = (flags.contains(CAPTURE_DATA)).then(|| PipelineBinary::of(&own));
        let captured = Self {
            binary: Mutex::new(binary.flatten()),
            programs: Mutex::default(),
        };
        if flags.intersects(CAPTURE_EXECUTABLES) {
            for library in libraries {
                let programs = library.programs.lock().clone();
                captured.programs.lock().extend(programs);
            }
            own.into_iter().for_each(|program| captured.add(program));
        }
        captured
    }

    /// Keeps a program, if it comes with its module.
    pub fn add(&self, program: StageProgram) {
        if program.module.is_some() {
            self.programs.lock().push(program);
        }
    }

    /// The module of a program, if it was captured.
    pub fn module(&self, program: &Program) -> Option<Module> {
        let programs = self.programs.lock();
        let found = programs
            .iter()
            .find(|it| it.program.number() == program.number())?;
        binary::decode(found.module.as_ref()?).ok()
    }
}
