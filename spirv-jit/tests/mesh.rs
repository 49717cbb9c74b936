//! Task and mesh shaders: where their interface lies, and what workgroups leave there.

use shaders::compute::run_mesh;
use shaders::raster::program;
use shaders::{glsl, request};
use spirv_jit::Program;
use spirv_jit::program::{
    InputRow, OutputRow, PatchWord, Stage, Varying, VaryingMode, VaryingPlace, Width,
};

/// A word of the vertex or primitive of that number.
fn word(memory: &[u8], at: &PatchWord, number: u32) -> u32 {
    let start = (at.offset_bytes + number * at.stride_bytes) as usize;
    let size = at.width.size_bytes() as usize;
    let mut bytes = [0; 4];
    bytes[..size].copy_from_slice(&memory[start..start + size]);
    u32::from_le_bytes(bytes)
}

fn find<'p>(words: &'p [PatchWord], row: &str) -> &'p PatchWord {
    let row: OutputRow = row.parse().expect("a row");
    let found = words.iter().find(|word| word.row == row);
    found.unwrap_or_else(|| panic!("no word {row}"))
}

fn count(program: &Program, memory: &[u8], index: usize) -> u32 {
    let start = program.mesh().expect("facts").counts_offset as usize + 4 * index;
    u32::from_le_bytes(memory[start..start + 4].try_into().expect("four bytes"))
}

#[test]
fn outputs_of_a_mesh_shader_lie_in_the_memory_of_its_workgroup() {
    let mesh = program(
        Stage::Mesh,
        "layout(local_size_x = 40) in;
         layout(triangles, max_vertices = 50, max_primitives = 60) out;
         layout(location = 2) out vec2 a[];
         layout(location = 3) flat out f16vec3 b[];
         layout(location = 5) perprimitiveEXT out Block { int x; float16_t y; } c[];
         shared uint sum;
         void main() {
             uint i = gl_LocalInvocationIndex;
             if (i == 0) sum = 0u;
             barrier();
             atomicAdd(sum, i);
             barrier();
             // The first invocation's counts hold.
             SetMeshOutputsEXT(i == 0 ? 40u : 7u, i == 0 ? 30u : 8u);
             gl_MeshVerticesEXT[i].gl_Position = vec4(i, gl_NumWorkGroups.yz, gl_DrawID);
             a[i] = vec2(sum, i);
             b[i] = f16vec3(i, 0.5, 2.0);
             if (i < 30) {
                 gl_PrimitiveTriangleIndicesEXT[i] = uvec3(i, i + 1, i + 2);
                 gl_MeshPrimitivesEXT[i].gl_Layer = int(100 + i);
                 gl_MeshPrimitivesEXT[i].gl_CullPrimitiveEXT = i % 2 == 1;
                 c[i].x = -int(i);
                 c[i].y = float16_t(i) + float16_t(0.25);
             }
         }",
    );
    let facts = mesh.mesh().expect("facts");
    assert_eq!((facts.corners, facts.payload_bytes), (3, 0));
    assert_eq!((facts.max_vertices, facts.max_primitives), (50, 60));
    // Built-ins that the shader never writes are not there.
    let has = |row: &str| mesh.outputs().contains(&row.parse().expect("a row"));
    assert!(has("position.3") && has("layer"));
    assert!(!has("point_size") && !has("primitive_id") && !has("viewport_index"));
    let memory = run_mesh(&mesh, &[]);
    assert_eq!([0, 1].map(|at| count(&mesh, &memory, at)), [40, 30]);
    let half = |value: f32| u32::from(half::f16::from_f32(value).to_bits());
    for i in 0..40 {
        let vertex = |row: &str| word(&memory, find(&facts.vertices, row), i);
        let position = [0, 1, 2, 3].map(|at| f32::from_bits(vertex(&format!("position.{at}"))));
        assert_eq!(position, [i as f32, 6.0, 7.0, 9.0]);
        assert_eq!(f32::from_bits(vertex("location.2.0.0")), 780.0);
        assert_eq!(f32::from_bits(vertex("location.2.1.0")), i as f32);
        assert_eq!(find(&facts.vertices, "location.3.0.0").width, Width::Half);
        let halves = [0, 1, 2].map(|at| vertex(&format!("location.3.{at}.0")));
        assert_eq!(halves, [half(i as f32), half(0.5), half(2.0)]);
    }
    for i in 0..30 {
        let primitive = |row: &str| word(&memory, find(&facts.primitives, row), i);
        let corners = [0, 1, 2].map(|at| primitive(&format!("primitive_index.{at}")));
        assert_eq!(corners, [i, i + 1, i + 2]);
        assert_eq!(primitive("layer"), 100 + i);
        assert_eq!(primitive("cull_primitive"), i % 2);
        assert_eq!(primitive("primitive.5.0"), i.wrapping_neg());
        assert_eq!(primitive("primitive.6.0"), half(i as f32 + 0.25));
    }
}

#[test]
fn payloads_lie_at_the_same_place_in_both_stages() {
    let payload = "struct Payload { uint a; float b[3]; u16vec2 c; };
         taskPayloadSharedEXT Payload payload;";
    let task = program(
        Stage::Task,
        &format!(
            "layout(local_size_x = 33) in; {payload} shared uint other[100];
             void main() {{
                 uint i = gl_LocalInvocationIndex;
                 other[i] = i;
                 if (i == 0) payload.a = 0u;
                 barrier();
                 atomicAdd(payload.a, other[i]);
                 if (i < 3) payload.b[i] = float(i) + 0.5;
                 payload.c = u16vec2(7, 8);
                 EmitMeshTasksEXT(1 + i, 2, 3);
             }}"
        ),
    );
    let memory = run_mesh(&task, &[]);
    assert_eq!([0, 1, 2].map(|at| count(&task, &memory, at)), [1, 2, 3]);
    let facts = task.mesh().expect("facts");
    let mesh = program(
        Stage::Mesh,
        &format!(
            "layout(points, max_vertices = 1, max_primitives = 1) out; {payload}
             layout(location = 0) out vec4 a[]; layout(location = 1) flat out uvec2 b[];
             shared uint other;
             void main() {{
                 other = 3u;
                 SetMeshOutputsEXT(1, 1);
                 a[0] = vec4(payload.a, payload.b[0], payload.b[1], payload.b[2]);
                 b[0] = uvec2(payload.c);
             }}"
        ),
    );
    let made = mesh.mesh().expect("facts");
    assert_eq!(facts.payload_bytes, made.payload_bytes);
    let memory = run_mesh(&mesh, &memory[..facts.payload_bytes as usize]);
    let vertex = |row: String| word(&memory, find(&made.vertices, &row), 0);
    let floats = [0, 1, 2, 3].map(|at| f32::from_bits(vertex(format!("location.0.{at}.0"))));
    assert_eq!(floats, [528.0, 0.5, 1.5, 2.5]);
    assert_eq!(
        [0, 1].map(|at| vertex(format!("location.1.{at}.0"))),
        [7, 8]
    );
}

#[test]
fn fragments_read_words_of_primitives_as_they_are() {
    let fragment = program(
        Stage::Fragment,
        "layout(location = 3) perprimitiveEXT in vec2 a;
         layout(location = 4) perprimitiveEXT in Block { float b; };
         layout(location = 0) out vec3 color;
         void main() { color = vec3(a, b); }",
    );
    for (location, component) in [(3, 0), (3, 1), (4, 0)] {
        let row = InputRow::Varying(Varying {
            place: VaryingPlace::Primitive(location),
            component,
            mode: VaryingMode::Flat,
        });
        assert!(fragment.inputs().contains(&row), "{row:?}");
    }
}

#[test]
fn mesh_shaders_out_of_range_are_refused() {
    let compile = |source: &str| {
        let words = glsl(Stage::Mesh, source);
        spirv_jit::compile(&request(Stage::Mesh, &words)).err()
    };
    let mesh = |size: u32| {
        format!(
            "layout(points, max_vertices = 1, max_primitives = 1) out; shared uint x[{size}];
             void main() {{ x[gl_LocalInvocationIndex] = 1; SetMeshOutputsEXT(x[0], 1); }}"
        )
    };
    assert_eq!(compile(&mesh(1 << 10)), None);
    let error = compile(&mesh(1 << 22)).expect("too much memory");
    assert_eq!(error.kind, spirv_jit::error::ErrorKind::Budget);
}
