//! Compiles the entry points of SPIR-V files and says how long it took and how large they became:
//! `compile FILE.spv…`.

use std::time::Instant;

use rspirv::spirv::{Capability, ExecutionModel};
use spirv_jit::CompileRequest;
use spirv_jit::ir::op::DescriptorBinding;
use spirv_jit::program::Stage;

fn main() {
    let capabilities: Vec<Capability> = (0..8000).filter_map(Capability::from_u32).collect();
    for path in std::env::args().skip(1) {
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) => {
                eprintln!("{path}: {error}");
                continue;
            }
        };
        let word = |chunk: &[u8]| u32::from_le_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]);
        let words: Vec<u32> = bytes.chunks_exact(4).map(word).collect();
        compile_entries(&path, &words, &capabilities);
    }
}

fn compile_entries(path: &str, words: &[u32], capabilities: &[Capability]) {
    let start = Instant::now();
    let parsed = match spirv_jit::parse::parse(words) {
        Ok(parsed) => parsed,
        Err(error) => {
            println!("{path}: {error}");
            return;
        }
    };
    let parse_time = start.elapsed();
    for entry in &parsed.entry_points {
        let Some(stage) = stage(entry.model) else {
            continue;
        };
        let binding = |set, binding: u32| {
            Some(DescriptorBinding {
                set,
                first: binding.wrapping_mul(16),
                count: 16,
                dynamic: false,
            })
        };
        let request = CompileRequest {
            words,
            entry_point: &entry.name,
            stage,
            specialization: &[],
            mappings: &[],
            bindings: &binding,
            capabilities,
            newer_capabilities: spirv_jit::parse::NewerCapability::ALL,
            accuracy: spirv_jit::Accuracy::Spec,
            prints: true,
            checks_alignment: false,
            micromaps_by_mode: false,
            view_index_is_device_index: false,
            indexes_in_64_bits: false,
        };
        let start = Instant::now();
        let lowered = spirv_jit::lower::lower_module(&parsed, &request);
        let lower_time = start.elapsed();
        shaders::code_pages::allow_native_code();
        let start = Instant::now();
        let program = spirv_jit::compile(&request);
        let total = start.elapsed();
        let lowered = lowered.map(|module| module.functions[0].value_types.len());
        let outcome = program.map(|program| {
            let wave = program.max_wave_subgroups();
            format!("state {} rows, wave {wave}", program.layout().rows)
        });
        println!(
            "{path} {stage:?} {:?}: parse {parse_time:?}, lower {lower_time:?} ({lowered:?} values), all {total:?}: {outcome:?}",
            entry.name
        );
    }
}

fn stage(model: ExecutionModel) -> Option<Stage> {
    Some(match model {
        ExecutionModel::GLCompute => Stage::Compute,
        ExecutionModel::RayGenerationKHR => Stage::RayGeneration,
        ExecutionModel::IntersectionKHR => Stage::Intersection,
        ExecutionModel::AnyHitKHR => Stage::AnyHit,
        ExecutionModel::ClosestHitKHR => Stage::ClosestHit,
        ExecutionModel::MissKHR => Stage::Miss,
        ExecutionModel::CallableKHR => Stage::Callable,
        ExecutionModel::Vertex => Stage::Vertex,
        ExecutionModel::TessellationControl => Stage::TessellationControl,
        ExecutionModel::TessellationEvaluation => Stage::TessellationEvaluation,
        ExecutionModel::Geometry => Stage::Geometry,
        ExecutionModel::TaskEXT => Stage::Task,
        ExecutionModel::MeshEXT => Stage::Mesh,
        ExecutionModel::Fragment => Stage::Fragment,
        _ => return None,
    })
}
