//! Tessellation shaders: their modes, and where the values of a patch lie.

use shaders::raster::program;
use shaders::{glsl, lower, request};
use spirv_jit::program::{
    Builtin, Domain, InputRow, MAX_PATCH_VERTICES, OutputRow, PatchWord, SiteKind, Spacing, Stage,
    TessellationModes, Varying, VaryingMode, VaryingPlace, Width,
};

const CONTROL: &str = "
    layout(location = 2) in vec2 a[];
    layout(location = 3) in f16vec2 narrow[];
    layout(location = 0) out double d[];
    layout(location = 1, component = 2) out float f[];
    layout(location = 7) patch out ivec3 whole[2];
    void main() {
        d[gl_InvocationID] = a[gl_InvocationID].x;
        barrier();
        f[gl_InvocationID] = float(d[gl_InvocationID ^ 1]) + narrow[0].y;
        whole[1] = ivec3(gl_PatchVerticesIn);
        gl_out[gl_InvocationID].gl_Position = gl_in[gl_InvocationID].gl_Position;
        gl_TessLevelOuter[3] = 2.0;
        gl_TessLevelInner[1] = 3.0;
    }";

fn control(vertices: u32) -> std::sync::Arc<spirv_jit::Program> {
    let source = format!("layout(vertices = {vertices}) out;{CONTROL}");
    program(Stage::TessellationControl, &source)
}

fn location(location: u16, component: u8) -> OutputRow {
    OutputRow::Location {
        location,
        component,
        index: 0,
    }
}

/// Every word of the interface has a place of its own, for each vertex that there may be, inside
/// the memory of the patch.
#[test]
fn values_of_patches_have_places() {
    for vertices in [1, 3, 16, 17, 32] {
        let program = control(vertices);
        let facts = program.tessellation().unwrap().control.as_ref().unwrap();
        assert_eq!(facts.vertices, vertices);
        let mut used = vec![false; facts.patch_bytes as usize];
        let mut take = |word: &PatchWord, vertices: u32| {
            for vertex in 0..vertices {
                let start = word.offset_bytes + vertex * word.stride_bytes;
                for byte in start..start + word.width.size_bytes() {
                    assert!(!std::mem::replace(&mut used[byte as usize], true), "{word}");
                }
            }
        };
        for word in &facts.inputs {
            take(word, MAX_PATCH_VERTICES);
        }
        for word in &facts.outputs {
            let is_of_patch = word.stride_bytes == 0;
            take(word, if is_of_patch { 1 } else { vertices });
        }
        let find = |words: &[PatchWord], row| words.iter().find(|it| it.row == row).copied();
        let input = |row| find(&facts.inputs, row);
        let output = |row| find(&facts.outputs, row);
        assert!(input(location(2, 1)).is_some() && input(OutputRow::Position(3)).is_some());
        assert_eq!(input(location(3, 1)).unwrap().width, Width::Half);
        // A double is two words.
        let [low, high] = [0, 1].map(|word| output(location(0, word)).unwrap());
        assert_eq!(high.offset_bytes, low.offset_bytes + 4);
        assert!(output(location(1, 2)).is_some());
        let of_patch = |location, component| OutputRow::Patch {
            location,
            component,
        };
        for row in [
            of_patch(7, 0),
            of_patch(8, 2),
            OutputRow::TessLevelOuter(3),
            OutputRow::TessLevelInner(1),
        ] {
            assert_eq!(output(row).unwrap().stride_bytes, 0, "{row}");
        }
        // Only the subgroups of a workgroup have to wait for each other.
        let waits = program.sites().contains(&SiteKind::Barrier);
        assert_eq!(waits, vertices > 16);
        assert_eq!(facts.patches(), (16 / vertices).max(1));
        let size = facts.patch_bytes * facts.patches();
        assert_eq!(program.shared_size_bytes(), size);
    }
}

#[test]
fn evaluation_shaders_read_words_of_patches() {
    let program = program(
        Stage::TessellationEvaluation,
        "layout(isolines, fractional_odd_spacing, ccw, point_mode) in;
         layout(location = 2) in vec2 a[];
         layout(location = 5) patch in Block { ivec2 x; layout(location = 9) float y; } block;
         layout(location = 0) out vec4 all;
         void main() {
             gl_Position = gl_in[31].gl_Position + vec4(gl_TessCoord, gl_PatchVerticesIn);
             all = vec4(a[2].y, block.x.y, block.y, gl_TessLevelOuter[1]);
         }",
    );
    let facts = program.tessellation().unwrap();
    let modes = TessellationModes {
        domain: Some(Domain::Isolines),
        spacing: Some(Spacing::FractionalOdd),
        clockwise: Some(false),
        point_mode: true,
    };
    assert_eq!((facts.modes, &facts.control), (modes, &None));
    // The other stage's modes count where this one has none.
    assert_eq!(TessellationModes::default().or(modes), modes);
    let varying = |place, component, mode| {
        InputRow::Varying(Varying {
            place,
            component,
            mode,
        })
    };
    for row in [
        varying(VaryingPlace::Position, 3, VaryingMode::PerVertex(31)),
        varying(VaryingPlace::Location(2), 1, VaryingMode::PerVertex(2)),
        varying(VaryingPlace::Patch(5), 1, VaryingMode::Flat),
        varying(VaryingPlace::Patch(9), 0, VaryingMode::Flat),
        varying(VaryingPlace::TessLevelOuter, 1, VaryingMode::Flat),
        InputRow::Builtin(Builtin::TessCoord, 2),
        InputRow::Builtin(Builtin::PatchVertices, 0),
    ] {
        assert!(program.inputs().contains(&row), "{row:?}");
    }
    assert!(program.outputs().contains(&OutputRow::Position(0)));
}

/// Facts that name memory outside of the patch are refused: the front end writes there.
#[test]
fn values_outside_of_the_patch_are_refused() {
    let source = format!("layout(vertices = 3) out;{CONTROL}");
    let words = glsl(Stage::TessellationControl, &source);
    let module = lower(&request(Stage::TessellationControl, &words)).unwrap();
    spirv_jit::ir::verify(&module).unwrap();
    let change = |change: &dyn Fn(&mut spirv_jit::program::ControlFacts)| {
        let mut module = module.clone();
        let facts = module.tessellation.as_mut().unwrap();
        change(facts.control.as_mut().unwrap());
        spirv_jit::ir::verify(&module).unwrap_err()
    };
    change(&|facts| facts.inputs[0].offset_bytes = facts.patch_bytes);
    change(&|facts| facts.outputs[0].stride_bytes = u32::MAX);
    change(&|facts| facts.patch_bytes *= 2);
    change(&|facts| facts.vertices = 33);
    change(&|facts| facts.vertices = 0);
}
