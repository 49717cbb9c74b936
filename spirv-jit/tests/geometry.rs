//! Geometry shaders: their interface, and the vertices that they emit.

use shaders::raster::{Emitted, program, run_geometry};
use shaders::{glsl, request};
use spirv_jit::program::{
    Builtin, Emits, GeometryFacts, InputRow, OutputRow, Stage, Varying, VaryingMode, VaryingPlace,
};

fn of_vertex(place: VaryingPlace, component: u8, vertex: u8) -> InputRow {
    InputRow::Varying(Varying {
        place,
        component,
        mode: VaryingMode::PerVertex(vertex),
    })
}

/// The place of an output among a vertex's words.
fn place(program: &spirv_jit::Program, row: OutputRow) -> usize {
    let found = program.outputs().iter().position(|other| *other == row);
    found.unwrap_or_else(|| panic!("no output {row}"))
}

#[test]
fn inputs_are_those_of_the_primitives_vertices() {
    let program = program(
        Stage::Geometry,
        "layout(lines, invocations = 5) in; layout(points, max_vertices = 2) out;
         in gl_PerVertex { vec4 gl_Position; float gl_PointSize; float gl_ClipDistance[2]; } gl_in[];
         layout(location = 3, component = 1) in vec2 a[];
         layout(location = 4) in Block { flat ivec2 x; layout(location = 8) double d; } b[];
         layout(location = 0) out vec4 all; layout(location = 1) flat out ivec4 more;
         void main() {
             for (int i = 0; i < gl_in.length(); i++) {
                 gl_Position = gl_in[i].gl_Position;
                 gl_PointSize = gl_in[1 - i].gl_PointSize;
                 all = vec4(a[i], gl_in[i].gl_ClipDistance[1], float(b[i].d));
                 more = ivec4(b[i].x, gl_PrimitiveIDIn, gl_InvocationID);
                 gl_PrimitiveID = 9 + i;
                 EmitVertex();
             }
         }",
    );
    let facts = GeometryFacts {
        vertices: 2,
        emits: Emits::Points,
        invocations: 5,
        max_vertices: 2,
        streams: false,
    };
    assert_eq!(program.geometry(), Some(&facts));
    for vertex in 0..2 {
        for (place, component) in [
            (VaryingPlace::Position, 3),
            (VaryingPlace::PointSize, 0),
            (VaryingPlace::ClipDistance, 1),
            (VaryingPlace::Location(3), 2),
            (VaryingPlace::Location(4), 1),
            (VaryingPlace::Location(8), 1),
        ] {
            let row = of_vertex(place, component, vertex);
            assert!(program.inputs().contains(&row), "{row:?}");
        }
    }
    let double = 2.5f64.to_bits();
    let emitted = run_geometry(&program, &mut [], |row, lane| match row {
        InputRow::Builtin(Builtin::PrimitiveId, _) => 100,
        InputRow::Builtin(Builtin::InvocationId, _) => lane as u32,
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(8),
            component,
            ..
        }) => (double >> (32 * component)) as u32,
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(4),
            component,
            mode: VaryingMode::PerVertex(vertex),
        }) => u32::from(10 * vertex + component),
        InputRow::Varying(Varying {
            component,
            mode: VaryingMode::PerVertex(vertex),
            ..
        }) => (f32::from(vertex) + 0.25 * f32::from(component)).to_bits(),
        row => panic!("{row:?}"),
    });
    let location = |location, component| OutputRow::Location {
        location,
        component,
        index: 0,
    };
    for (lane, vertices) in emitted.iter().enumerate() {
        assert_eq!(vertices.len(), 2);
        for (number, vertex) in vertices.iter().enumerate() {
            let word = |row| vertex.words[place(&program, row)];
            let first = number as f32;
            let floats = [0, 1, 2, 3].map(|of| f32::from_bits(word(location(0, of))));
            assert_eq!(floats, [first + 0.25, first + 0.5, first + 0.25, 2.5]);
            let number = number as u32;
            let words = [0, 1, 2, 3].map(|of| word(location(1, of)));
            assert_eq!(words, [10 * number, 10 * number + 1, 100, lane as u32]);
            let position = [0, 3].map(|of| f32::from_bits(word(OutputRow::Position(of))));
            assert_eq!(position, [first, first + 0.75]);
            assert_eq!(f32::from_bits(word(OutputRow::PointSize)), 1.0 - first);
            assert_eq!(word(OutputRow::PrimitiveId), 9 + number);
        }
    }
}

/// Each lane emits as many vertices as its number says: strips of three, and none past the most.
#[test]
fn vertices_come_in_order_of_emission_and_none_past_the_most() {
    let program = program(
        Stage::Geometry,
        "layout(points) in; layout(triangle_strip, max_vertices = 10) out;
         layout(location = 0) flat out int number;
         void main() {
             for (int i = 0; i < gl_PrimitiveIDIn; i++) {
                 gl_Position = vec4(0.0);
                 number = 100 * gl_PrimitiveIDIn + i;
                 EmitVertex();
                 if (i % 3 == 2) EndPrimitive();
             }
         }",
    );
    let number = OutputRow::Location {
        location: 0,
        component: 0,
        index: 0,
    };
    // Words that are always zero are none, except the position's.
    let expected = [0, 1, 2, 3].map(OutputRow::Position);
    assert_eq!(program.outputs().len(), expected.len() + 1);
    assert!(expected.iter().all(|row| program.outputs().contains(row)));
    let emitted = run_geometry(&program, &mut [], |row, lane| match row {
        InputRow::Builtin(Builtin::PrimitiveId, _) => lane as u32,
        row => panic!("{row:?}"),
    });
    for (lane, vertices) in emitted.into_iter().enumerate() {
        let expected = (0..lane.min(10)).map(|vertex| {
            let mut words = vec![0; program.outputs().len()];
            words[place(&program, number)] = (100 * lane + vertex) as u32;
            Emitted {
                starts: vertex % 3 == 0,
                stream: 0,
                words,
            }
        });
        assert_eq!(vertices, expected.collect::<Vec<_>>());
    }
}

/// Each stream has strips of its own.
#[test]
fn vertices_are_of_streams() {
    let program = program(
        Stage::Geometry,
        "layout(points) in; layout(points, max_vertices = 5) out;
         layout(location = 0, stream = 0) out int a; layout(location = 1, stream = 3) out int b;
         void main() {
             a = 1; b = 2;
             EmitStreamVertex(0); EmitStreamVertex(3); EndStreamPrimitive(0);
             EmitStreamVertex(3); EmitStreamVertex(0); EmitStreamVertex(0);
         }",
    );
    assert!(program.geometry().is_some_and(|facts| facts.streams));
    let emitted = run_geometry(&program, &mut [], |row, _| panic!("{row:?}"));
    let expected = [(0, true), (3, true), (3, false), (0, true), (0, false)];
    for vertices in emitted {
        let places: Vec<_> = vertices.iter().map(|it| (it.stream, it.starts)).collect();
        assert_eq!(places, expected);
    }
}

/// A large function with several calls is not lowered in place, except one that emits.
#[test]
fn functions_emit_into_their_callers_vertices() {
    let sums = "x = x * 1.5 + 0.25; ".repeat(300);
    let program = program(
        Stage::Geometry,
        &format!(
            "layout(points) in; layout(points, max_vertices = 4) out;
             layout(location = 0) out float f;
             void put(float x) {{ {sums} f = x; EmitVertex(); }}
             void main() {{ put(float(gl_PrimitiveIDIn)); put(1.0); if (gl_PrimitiveIDIn > 3) put(2.0); }}"
        ),
    );
    let emitted = run_geometry(&program, &mut [], |_, lane| lane as u32);
    for (lane, vertices) in emitted.iter().enumerate() {
        assert_eq!(vertices.len(), if lane > 3 { 3 } else { 2 });
    }
}

/// More vertices than memory could hold, which compilers of GLSL refuse themselves.
#[test]
fn too_many_vertices_are_refused() {
    // OpExecutionMode of the entry point: OutputVertices.
    const MODE: [u32; 2] = [4 << 16 | 16, 26];
    let source = "layout(points) in; layout(points, max_vertices = 8) out;
         layout(location = 0) out vec4 a[8]; void main() { a[0] = vec4(1.0); EmitVertex(); }";
    let mut words = glsl(Stage::Geometry, source);
    let compile = |words: &[u32]| spirv_jit::compile(&request(Stage::Geometry, words)).err();
    assert!(compile(&words).is_none());
    let mode = (words.windows(4)).position(|words| [words[0], words[2]] == MODE);
    for most in [100_000, u32::MAX] {
        words[mode.expect("a mode") + 3] = most;
        let error = compile(&words).expect("refused").to_string();
        assert!(error.contains("too many vertices"), "{error}");
    }
}
