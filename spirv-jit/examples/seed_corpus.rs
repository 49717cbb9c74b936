//! Writes real modules to `fuzz/corpus/modules`, one file each: what the fuzz target `modules` starts from.

use spirv_jit::program::Stage;

fn main() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/corpus/modules");
    std::fs::create_dir_all(folder).expect("the folder can be made");
    for (index, (stage, words)) in shaders::samples::samples().into_iter().enumerate() {
        let first = match stage {
            Stage::Compute => 0u8,
            Stage::RayGeneration => 1,
            Stage::Miss => 2,
            Stage::ClosestHit => 3,
            Stage::AnyHit => 4,
            Stage::Intersection => 5,
            Stage::Callable => 6,
            Stage::Vertex => 7,
            Stage::Fragment => 8,
        };
        let mut bytes = vec![first];
        bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        let file = format!("{folder}/{index}");
        std::fs::write(&file, bytes).unwrap_or_else(|error| panic!("{file}: {error}"));
    }
}
