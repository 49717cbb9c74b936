//! Shows what the passes make of a shader: `cargo run -p spirv-jit --example passes --
//! FILE.{rgen,rchit,rahit,rmiss,rint,rcall,comp}…`
//!
//! For each file: size of the IR before and after, and the time of each step. `TUFF_PRINT` prints
//! the IR itself. `#include "…"` is taken from the file's directory.

use std::path::Path;
use std::time::Instant;

use spirv_jit::Program;
use spirv_jit::ir::{Module, Node};
use spirv_jit::pass::{optimize, order, run_pass};
use spirv_jit::program::Stage;

fn stage(path: &Path) -> Stage {
    match path.extension().and_then(|e| e.to_str()) {
        Some("rgen") => Stage::RayGeneration,
        Some("rchit") => Stage::ClosestHit,
        Some("rahit") => Stage::AnyHit,
        Some("rmiss") => Stage::Miss,
        Some("rint") => Stage::Intersection,
        Some("rcall") => Stage::Callable,
        Some("vert") => Stage::Vertex,
        Some("tesc") => Stage::TessellationControl,
        Some("tese") => Stage::TessellationEvaluation,
        Some("geom") => Stage::Geometry,
        Some("task") => Stage::Task,
        Some("mesh") => Stage::Mesh,
        Some("frag") => Stage::Fragment,
        _ => Stage::Compute,
    }
}

/// The file's text, includes in place, without its version line.
fn source(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut out = String::new();
    for line in text.lines() {
        let included = line
            .strip_prefix("#include \"")
            .and_then(|r| r.strip_suffix('"'));
        match included {
            Some(name) => out += &source(&path.with_file_name(name)),
            None if line.starts_with("#version") => {}
            None => out += line,
        }
        out.push('\n');
    }
    out
}

/// Instructions and constructs.
fn size(module: &Module) -> (usize, usize) {
    let mut size = (0, 0);
    for function in &module.functions {
        function.body.visit(&mut |node| match node {
            Node::Inst(_) => size.0 += 1,
            _ => size.1 += 1,
        });
    }
    size
}

fn main() {
    let list = |name| std::env::var(name).unwrap_or_default();
    spirv_jit::pass::configure(&list("TUFF_DISABLE"), &list("TUFF_PRINT"));
    for argument in std::env::args().skip(1) {
        let path = Path::new(&argument);
        let stage = stage(path);
        let words = shaders::glsl(stage, &source(path));
        let request = shaders::request(stage, &words);
        let begin = Instant::now();
        let parsed = spirv_jit::parse::parse(&words).unwrap();
        let parse_time = begin.elapsed();
        let begin = Instant::now();
        let lowered = spirv_jit::lower::lower_module(&parsed, &request).unwrap();
        let lower_time = begin.elapsed();
        println!("{argument}: {} words, IR {:?}", words.len(), size(&lowered));
        println!("  {parse_time:>12.1?} parse\n  {lower_time:>12.1?} lower");
        let mut module = lowered.clone();
        for name in order() {
            let begin = Instant::now();
            run_pass(name, &mut module);
            println!("  {:>12.1?} {name} {:?}", begin.elapsed(), size(&module));
        }
        shaders::code_pages::allow_native_code();
        let begin = Instant::now();
        let program = Program::new(&module).unwrap();
        println!("  {:>12.1?} interpreter", begin.elapsed());
        println!(
            "  private rows {}, state rows {}, wave {} subgroups",
            module
                .functions
                .iter()
                .flat_map(|f| &f.variables)
                .map(|v| v.rows)
                .sum::<u32>(),
            program.layout().rows,
            program.max_wave_subgroups()
        );
        let mut module = lowered;
        let begin = Instant::now();
        optimize(&mut module).unwrap();
        println!("  {:>12.1?} all passes", begin.elapsed());
    }
}
