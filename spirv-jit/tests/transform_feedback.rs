//! Outputs of a shader that transform feedback captures, and their places.

use shaders::raster::program;
use shaders::{glsl, request};
use spirv_jit::program::{
    FeedbackBuffer, FeedbackFacts, FeedbackWidth, FeedbackWord, OutputRow, Stage,
};

const fn location(location: u16, component: u8) -> OutputRow {
    OutputRow::Location {
        location,
        component,
        index: 0,
    }
}

/// Words of 32 bits of a buffer, with their offsets.
fn words(buffer: u8, words: &[(u32, OutputRow)]) -> Vec<FeedbackWord> {
    let of = |&(offset_bytes, row): &(u32, OutputRow)| FeedbackWord {
        buffer,
        offset_bytes,
        width: FeedbackWidth::Word,
        row,
    };
    words.iter().map(of).collect()
}

fn sorted(facts: &FeedbackFacts) -> Vec<FeedbackWord> {
    let mut words = facts.words.clone();
    words.sort_by_key(|word| (word.buffer, word.offset_bytes));
    words
}

#[test]
fn a_shader_without_the_mode_captures_nothing() {
    let plain = program(
        Stage::Vertex,
        "layout(location = 0) out vec4 a; void main() { a = vec4(1.0); }",
    );
    assert_eq!(plain.transform_feedback(), None);
}

/// Built-ins, members of blocks that have offsets, arrays, matrices and doubles.
#[test]
fn words_follow_from_offsets() {
    let program = program(
        Stage::Vertex,
        "layout(xfb_buffer = 1, xfb_stride = 64) out;
         layout(xfb_buffer = 2, xfb_stride = 48) out;
         layout(xfb_buffer = 1) out gl_PerVertex {
             layout(xfb_offset = 8) vec4 gl_Position;
             layout(xfb_offset = 4) float gl_PointSize;
             layout(xfb_offset = 24) float gl_ClipDistance[2];
         };
         layout(location = 2, component = 1, xfb_buffer = 2, xfb_offset = 0) out vec2 v[2];
         layout(location = 5, xfb_buffer = 2, xfb_offset = 16) out mat2 m;
         layout(location = 8, xfb_buffer = 2) out Block {
             float before; layout(xfb_offset = 40) double d; float after;
         };
         layout(location = 20) out vec4 other;
         void main() {
             gl_Position = vec4(1.0); gl_PointSize = 2.0; gl_ClipDistance[0] = gl_ClipDistance[1] = 1.0;
             v[0] = v[1] = vec2(1.0); m = mat2(1.0); before = after = 1.0; d = 1.0LF; other = vec4(1.0);
         }",
    );
    let facts = program.transform_feedback().expect("captures");
    let buffer = |stride_bytes| {
        Some(FeedbackBuffer {
            stride_bytes,
            stream: 0,
        })
    };
    assert_eq!(facts.buffers, [None, buffer(64), buffer(48), None]);
    let mut expected = words(
        1,
        &[
            (4, OutputRow::PointSize),
            (8, OutputRow::Position(0)),
            (12, OutputRow::Position(1)),
            (16, OutputRow::Position(2)),
            (20, OutputRow::Position(3)),
            (24, OutputRow::ClipDistance(0)),
            (28, OutputRow::ClipDistance(1)),
        ],
    );
    expected.extend(words(
        2,
        &[
            (0, location(2, 1)),
            (4, location(2, 2)),
            (8, location(3, 1)),
            (12, location(3, 2)),
            (16, location(5, 0)),
            (20, location(5, 1)),
            (24, location(6, 0)),
            (28, location(6, 1)),
            (40, location(9, 0)),
            (44, location(9, 1)),
        ],
    ));
    assert_eq!(sorted(facts), expected);
    assert_eq!(facts.to_string().parse_back(), *facts);
}

/// The facts that a text form stands for.
trait ParseBack {
    fn parse_back(&self) -> FeedbackFacts;
}

impl ParseBack for String {
    fn parse_back(&self) -> FeedbackFacts {
        let mut facts = FeedbackFacts::default();
        for word in self.split(", ") {
            assert!(facts.set(word), "{word}");
        }
        facts
    }
}

/// Elements of an array of blocks go to consecutive buffers.
#[test]
fn blocks_of_an_array_have_a_buffer_each() {
    let program = program(
        Stage::Vertex,
        "layout(location = 0, xfb_buffer = 1, xfb_stride = 8) out Block {
             layout(xfb_offset = 4) float a;
         } blocks[2];
         void main() { blocks[0].a = 1.0; blocks[1].a = 2.0; }",
    );
    let facts = program.transform_feedback().expect("captures");
    let mut expected = words(1, &[(4, location(0, 0))]);
    expected.extend(words(2, &[(4, location(1, 0))]));
    assert_eq!(sorted(facts), expected);
    let strides = facts.buffers.map(|it| it.map_or(0, |it| it.stride_bytes));
    assert_eq!(strides, [0, 8, 8, 0]);
}

/// Scalars of 16 bits are tightly packed, and keep their own widths.
#[test]
fn small_scalars_are_packed() {
    let program = program(
        Stage::Vertex,
        "layout(location = 0, xfb_buffer = 0, xfb_stride = 16, xfb_offset = 0) out f16vec3 h;
         layout(location = 1, xfb_buffer = 0, xfb_offset = 6) flat out i16vec2 s;
         void main() { h = f16vec3(1.0hf); s = i16vec2(1s); }",
    );
    let facts = program.transform_feedback().expect("captures");
    let places: Vec<_> = (sorted(facts).iter())
        .map(|it| (it.offset_bytes, it.width))
        .collect();
    use FeedbackWidth::{Half, Short};
    let expected = [(0, Half), (2, Half), (4, Half), (6, Short), (8, Short)];
    assert_eq!(places, expected);
}

#[test]
fn evaluation_shaders_capture() {
    let program = program(
        Stage::TessellationEvaluation,
        "layout(triangles) in;
         layout(location = 0, xfb_buffer = 0, xfb_stride = 12, xfb_offset = 0) out vec3 place;
         void main() { place = gl_TessCoord; gl_Position = vec4(gl_TessCoord, 1.0); }",
    );
    let facts = program.transform_feedback().expect("captures");
    let places = [0, 1, 2].map(|word| (4 * u32::from(word), location(0, word)));
    assert_eq!(sorted(facts), words(0, &places));
}

/// Each stream has its own buffers.
#[test]
fn buffers_are_of_streams() {
    let program = program(
        Stage::Geometry,
        "layout(points) in; layout(points, max_vertices = 2) out;
         layout(location = 0, stream = 0, xfb_buffer = 0, xfb_stride = 4, xfb_offset = 0) out int a;
         layout(location = 1, stream = 2, xfb_buffer = 3, xfb_stride = 8, xfb_offset = 4) out int b;
         void main() { a = 1; EmitStreamVertex(0); b = 2; EmitStreamVertex(2); }",
    );
    let facts = program.transform_feedback().expect("captures");
    let streams = facts
        .buffers
        .map(|it| it.map(|it| (it.stride_bytes, it.stream)));
    assert_eq!(streams, [Some((4, 0)), None, None, Some((8, 2))]);
}

/// Strides that outputs do not fit in, and buffers that do not exist. Compilers of GLSL refuse them
/// themselves.
#[test]
fn captures_outside_are_refused() {
    // OpDecorate and the decorations XfbBuffer, XfbStride and Offset.
    const DECORATE: u32 = 4 << 16 | 71;
    let source = "layout(location = 0, xfb_buffer = 0, xfb_stride = 16, xfb_offset = 0) out vec4 a;
         void main() { a = vec4(1.0); }";
    let compile = |words: &[u32]| spirv_jit::compile(&request(Stage::Vertex, words)).err();
    let words = glsl(Stage::Vertex, source);
    assert!(compile(&words).is_none());
    for (decoration, wrong) in [(36, 4), (36, u32::MAX), (37, 12), (35, 4), (35, u32::MAX)] {
        let mut words = words.clone();
        let found = (words.windows(4)).position(|it| [it[0], it[2]] == [DECORATE, decoration]);
        words[found.expect("a decoration") + 3] = wrong;
        assert!(compile(&words).is_some(), "{decoration} {wrong}");
    }
}
