//! Writes real modules, one file each, to `modules` and `words` in the folder that is named: what
//! the fuzz targets of these names start from.

use std::path::Path;

use spirv_jit::program::Stage;

/// Words of a header, which the target `words` puts before what it is given.
const HEADER: usize = 5;

fn write(folder: &Path, index: usize, first: &[u8], words: &[u32]) {
    std::fs::create_dir_all(folder).expect("the folder can be made");
    let words = words.iter().flat_map(|word| word.to_le_bytes());
    let bytes: Vec<u8> = first.iter().copied().chain(words).collect();
    let file = folder.join(format!("sample-{index}"));
    std::fs::write(&file, bytes).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
}

fn main() {
    let folder = std::env::args_os().nth(1).expect("a folder is named");
    let folder = Path::new(&folder);
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
            Stage::Geometry => 9,
            Stage::TessellationControl => 10,
            Stage::TessellationEvaluation => 11,
            Stage::Task => 12,
            Stage::Mesh => 13,
        };
        write(&folder.join("modules"), index, &[first], &words);
        if stage == Stage::Compute {
            write(&folder.join("words"), index, &[], &words[HEADER..]);
        }
    }
}
