//! Real modules, corrupted word by word. The first byte of an input says for which stage it is
//! compiled.
#![no_main]

use fastrand::Rng;
use libfuzzer_sys::{fuzz_mutator, fuzz_target};
use shaders::corrupt;
use spirv_jit::program::Stage;

const STAGES: [Stage; 14] = [
    Stage::Compute,
    Stage::RayGeneration,
    Stage::Miss,
    Stage::ClosestHit,
    Stage::AnyHit,
    Stage::Intersection,
    Stage::Callable,
    Stage::Vertex,
    Stage::Fragment,
    Stage::Geometry,
    Stage::TessellationControl,
    Stage::TessellationEvaluation,
    Stage::Task,
    Stage::Mesh,
];

fn words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

fuzz_target!(|data: &[u8]| {
    if let Some((&stage, module)) = data.split_first() {
        corrupt::try_module(STAGES[stage as usize % STAGES.len()], &words(module), 0);
    }
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mut module = match data[..size].split_first() {
        Some((_, module)) => words(module),
        None => return size,
    };
    if module.is_empty() {
        return size;
    }
    corrupt::corrupt(&mut module, &mut Rng::with_seed(seed.into()));
    let bytes = module.iter().flat_map(|word| word.to_le_bytes());
    let room = &mut data[1..max_size];
    let mut count = 1;
    for (byte, place) in bytes.zip(room) {
        *place = byte;
        count += 1;
    }
    count
});
