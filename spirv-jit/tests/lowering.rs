//! Shaders of every kind pass through the front end into modules that the verifier accepts.

use images::ImageOpKind;
use shaders::{glsl, lower, lower_glsl, request, samples};
use spirv_jit::ir::op::Trace;
use spirv_jit::ir::{Op, Terminator, Type};
use spirv_jit::printf::Message;
use spirv_jit::program::{InputRow, Stage};
use spirv_jit::{Accuracy, CompileRequest};

fn operations(module: &spirv_jit::ir::Module) -> Vec<Op> {
    let mut out = Vec::new();
    for function in &module.functions {
        (function.body).visit_insts(&mut |inst| out.push(inst.op));
    }
    out
}

#[test]
fn a_workgroup_has_its_size_and_memory() {
    let module = lower_glsl(
        Stage::Compute,
        "layout(local_size_x = 8, local_size_y = 4) in;
         layout(set = 0, binding = 1) buffer Out { float data[]; };
         shared float tile[32];
         void main() {
             uint i = gl_LocalInvocationIndex;
             tile[i] = data[i];
             barrier();
             data[i] = tile[31 - i] + float(gl_WorkGroupID.x);
         }",
    );
    assert_eq!(module.local_size, [8, 4, 1]);
    assert_eq!(module.shared_size_bytes, 128);
    let operations = operations(&module);
    assert!(operations.contains(&Op::Barrier));
    assert!(matches!(module.functions[0].body.end, Terminator::End(ref v) if v.is_empty()));
}

#[test]
fn ray_generation_traces_with_a_payload() {
    let module = lower_glsl(
        Stage::RayGeneration,
        "layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
         layout(set = 0, binding = 1, rgba8) uniform image2D image;
         struct Payload { vec3 color; float t; uint64_t wide; bool hit; };
         layout(location = 0) rayPayloadEXT Payload payload;
         void main() {
             vec2 uv = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy);
             payload.color = vec3(0);
             for (int bounce = 0; bounce < 4; bounce++) {
                 traceRayEXT(scene, gl_RayFlagsOpaqueEXT, 0xff, 0, 1, 0, vec3(uv, 1), 0.001, vec3(0, 0, -1), 100.0, 0);
                 if (!payload.hit) break;
             }
             imageStore(image, ivec2(gl_LaunchIDEXT.xy), vec4(payload.color, 1));
         }",
    );
    assert!(operations(&module).contains(&Op::TraceRay(Trace::new(false, false))));
    assert_eq!(module.output_rows, 0);
}

#[test]
fn any_hit_gives_a_verdict_and_the_payload() {
    let module = lower_glsl(
        Stage::AnyHit,
        "layout(location = 0) rayPayloadInEXT vec4 payload;
         hitAttributeEXT vec2 barycentrics;
         layout(set = 0, binding = 2) uniform sampler2D textures[4];
         void main() {
             payload.x += 1.0;
             float alpha = texture(textures[nonuniformEXT(gl_InstanceCustomIndexEXT)], barycentrics).a;
             if (alpha < 0.5) ignoreIntersectionEXT;
             if (payload.x > 4.0) terminateRayEXT;
         }",
    );
    assert_eq!(module.output_rows, 5);
    assert!(module.inputs.contains(&InputRow::Payload(3)));
    assert!(module.inputs.contains(&InputRow::HitAttribute(1)));
}

#[test]
fn intersection_reports() {
    let module = lower_glsl(
        Stage::Intersection,
        "struct Attribute { vec3 normal; float u; };
         hitAttributeEXT Attribute hit;
         void main() {
             vec3 o = gl_ObjectRayOriginEXT, d = gl_ObjectRayDirectionEXT;
             float b = dot(o, d), c = dot(o, o) - 1.0;
             float h = b * b - c;
             if (h >= 0.0) {
                 float t = -b - sqrt(h);
                 hit.normal = o + t * d;
                 hit.u = t;
                 if (t > gl_RayTminEXT) reportIntersectionEXT(t, 3u);
             }
         }",
    );
    assert!(operations(&module).contains(&Op::ReportIntersection));
    assert_eq!(module.output_rows, 0);
}

#[test]
fn closest_hit_reads_records_and_addresses() {
    let module = lower_glsl(
        Stage::ClosestHit,
        "struct Vertex { vec3 position; vec2 uv; };
         layout(buffer_reference, scalar) readonly buffer Vertices { Vertex v[]; };
         layout(buffer_reference, scalar) readonly buffer Indices { uvec3 i[]; };
         layout(shaderRecordEXT, scalar) buffer Record { Vertices vertices; Indices indices; vec4 tint; };
         layout(location = 0) rayPayloadInEXT vec3 color;
         hitAttributeEXT vec2 bary;
         void main() {
             uvec3 i = indices.i[gl_PrimitiveID];
             vec3 w = vec3(1 - bary.x - bary.y, bary);
             vec2 uv = vertices.v[i.x].uv * w.x + vertices.v[i.y].uv * w.y + vertices.v[i.z].uv * w.z;
             vec3 p = gl_ObjectToWorldEXT * vec4(vertices.v[i.x].position, 1);
             color = tint.rgb * vec3(uv, p.x) * float(gl_HitKindEXT) + gl_HitTriangleVertexPositionsEXT[1];
         }",
    );
    assert_eq!(module.output_rows, 3);
}

#[test]
fn callable_and_miss() {
    let module = lower_glsl(
        Stage::Callable,
        "struct Data { float a; dvec2 b; uint8_t c; };
         layout(location = 0) callableDataInEXT Data data;
         void main() { data.b *= data.a; data.c += uint8_t(1); }",
    );
    // f32, two f64 of two words each, one byte in a word.
    assert_eq!(module.output_rows, 6);
    let module = lower_glsl(
        Stage::Miss,
        "layout(location = 0) rayPayloadInEXT vec3 color;
         layout(location = 1) callableDataEXT float shared_data;
         void main() {
             shared_data = 1.0;
             executeCallableEXT(2, 1);
             color = vec3(shared_data, gl_WorldRayDirectionEXT.y, float(gl_IncomingRayFlagsEXT));
         }",
    );
    assert!(operations(&module).contains(&Op::ExecuteCallable));
}

#[test]
fn control_flow_of_every_kind() {
    lower_glsl(
        Stage::Compute,
        "layout(set = 0, binding = 0) buffer B { int data[]; };
         int early(int x) {
             if (x < 0) return -1;
             for (int i = 0; i < x; i++) {
                 if (i == 7) return i;
                 if ((i & 1) != 0) continue;
                 for (int j = 0; ; j++) { if (j > i) break; if (j == 3) return 9; x += j; }
             }
             return x;
         }
         int fall(int x) {
             int r = 0;
             switch (x) {
             case 0: r = 1;
             case 1: r += 2; break;
             case 2: case 5: r = 5;
             default: r += 10;
             case 9: if (r > 12) break; r *= 2; break;
             case 11: return -4;
             }
             return r;
         }
         void change(inout int a, out int b, in int c) { a += c; b = a * 2; }
         void main() {
             uint i = gl_GlobalInvocationID.x;
             int x = data[i], y = 0;
             do {
                 switch (x & 3) { case 0: x += 3; continue; case 1: y++; break; default: x >>= 1; }
                 y += early(x) + fall(y);
             } while (y < 100 && x > 0);
             change(x, y, 3);
             while (true) { if (x++ > 1000) break; if (y == x) { y = 3; continue; } y -= 2; }
             data[i] = x > 2 && y < 4 || x == y ? x : y;
         }",
    );
}

#[test]
fn the_whole_instruction_set_of_glsl() {
    for source in samples::COMPUTE {
        lower_glsl(Stage::Compute, source);
    }
}

#[test]
fn large_functions_with_several_call_sites_stay_functions() {
    let step = "for (int k = 0; k < 4; k++) { y += a[k]; s = s * 3u + uint(y); a[(k + 1) & 3] ^= int(s); } \n";
    let source = format!(
        "layout(set = 0, binding = 0) buffer B {{ int data[]; }};
         uint s = 1u;
         int big(inout int a[4], int y) {{ if (y == 77) return 5; {} return y; }}
         int twice(inout int b[4], int y) {{ return big(b, y) + big(b, y + 1); }}
         void main() {{ int a[4] = int[](1, 2, 3, 4); data[0] = twice(a, data[1]) + twice(a, data[2]) + a[2] + int(s); }}",
        step.repeat(16)
    );
    let module = lower_glsl(Stage::Compute, &source);
    assert!(module.functions.len() > 1);
    let calls = operations(&module);
    assert!(calls.iter().any(|op| matches!(op, Op::Call(_))));
}

#[test]
fn functions_are_as_exact_as_was_asked_for() {
    let words = glsl(
        Stage::Compute,
        "layout(set = 0, binding = 1) buffer Out { float data[]; };
         void main() { data[0] = sin(data[1]) + sqrt(data[2]) + normalize(vec2(data[3], data[4])).x; }",
    );
    let compiled = |accuracy| {
        let request = CompileRequest {
            accuracy,
            ..request(Stage::Compute, &words)
        };
        let module = lower(&request).expect("it compiles");
        operations(&module)
    };
    let spec = compiled(Accuracy::Spec);
    assert!(spec.contains(&Op::FSin) && spec.contains(&Op::FInverseSqrt));
    assert!(!spec.contains(&Op::FConvert));
    let fast = compiled(Accuracy::Fast);
    assert!(fast.contains(&Op::FSinFast) && fast.contains(&Op::FInverseSqrtFast));
    assert!(!fast.contains(&Op::FSin) && fast.contains(&Op::FSqrt));
    let exact = compiled(Accuracy::Exact);
    // Two functions go to f64 and back; a square root is exact as it is.
    let conversions = exact.iter().filter(|op| **op == Op::FConvert).count();
    assert_eq!(conversions, 4);
}

#[test]
fn messages_are_lowered_where_they_are_wanted() {
    let source = "#extension GL_EXT_debug_printf : require
         layout(set = 0, binding = 1) buffer Out { vec3 data[]; };
         void main() { debugPrintfEXT(\"%v3f %d\", data[0], 5); }";
    let words = glsl(Stage::Compute, source);
    for prints in [false, true] {
        let request = CompileRequest {
            prints,
            ..request(Stage::Compute, &words)
        };
        let module = lower(&request).expect("it compiles");
        let operations = operations(&module);
        let is_message = |op: &&Op| matches!(op, Op::DebugPrintf(_));
        let messages = operations.iter().filter(is_message).count();
        assert_eq!(messages, usize::from(prints));
        let tables = &module.functions[0].tables;
        if prints {
            let message = Message::from_table(&tables[0]).expect("a message");
            assert_eq!(message.format.as_deref(), Some("%v3f %d"));
            let types = message.arguments.iter().map(|it| (it.ty, it.components));
            let expected = [(Some(Type::F32), 3), (Some(Type::I32), 1)];
            assert!(types.eq(expected));
        } else {
            assert!(tables.is_empty());
        }
    }
}

#[test]
fn reads_of_volatile_images_are_volatile() {
    for (qualifier, volatile) in [("", false), ("volatile", true)] {
        let source = format!(
            "layout(local_size_x = 1) in;
             layout(set = 0, binding = 0, rgba8) uniform {qualifier} image2D image;
             layout(set = 0, binding = 1) buffer Out {{ vec4 color; }};
             void main() {{ color = imageLoad(image, ivec2(1)); }}"
        );
        let operations = operations(&lower_glsl(Stage::Compute, &source));
        let reads = operations.iter().filter_map(|op| match op {
            Op::Image(image) if image.kind == ImageOpKind::Read => Some(image.volatile),
            _ => None,
        });
        assert_eq!(reads.collect::<Vec<_>>(), [volatile], "{qualifier}");
    }
}
