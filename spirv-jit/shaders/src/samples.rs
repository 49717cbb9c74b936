//! Modules that a compiler made, for what corrupts them.

use spirv_jit::program::Stage;

use crate::glsl;

/// Compute shaders with all instructions of GLSL.
pub const COMPUTE: [&str; 4] = [
    include_str!("samples/arithmetic.comp"),
    include_str!("samples/images.comp"),
    include_str!("samples/memory.comp"),
    include_str!("samples/subgroups.comp"),
];

/// Each with its stage.
pub fn samples() -> Vec<(Stage, Vec<u32>)> {
    let mut samples: Vec<_> = COMPUTE
        .iter()
        .map(|source| (Stage::Compute, glsl(Stage::Compute, source)))
        .collect();
    let control = "layout(set = 0, binding = 0) buffer B { int data[]; };
        int f(int x, inout int y) { for (int i = 0; i < x; i++) { if (i == y) continue; switch (i) { case 1: y++; case 2: return y; default: break; } y += i; } return y; }
        void main() { int y = data[0]; data[1] = f(data[2], y); data[y] = y > 3 && data[4] < 2 ? 1 : f(3, y); }";
    samples.push((Stage::Compute, glsl(Stage::Compute, control)));
    let hit = "layout(location = 0) rayPayloadInEXT vec4 payload; hitAttributeEXT vec2 b;
        layout(shaderRecordEXT) buffer R { vec4 tint; };
        void main() { payload += tint * b.x; if (b.y > 0.5) ignoreIntersectionEXT; if (payload.x > 1.0) terminateRayEXT; }";
    samples.push((Stage::AnyHit, glsl(Stage::AnyHit, hit)));
    let query = "#extension GL_EXT_ray_query : require
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1) buffer B { float data[]; };
        void main() {
            rayQueryEXT q[2];
            for (int i = 0; i < 2; i++) {
                rayQueryInitializeEXT(q[i], world, 0, 0xff, vec3(data[0]), 0.0, vec3(0.0, 0.0, 1.0), data[1]);
                while (rayQueryProceedEXT(q[i])) { if (data[2] > 1.0) rayQueryConfirmIntersectionEXT(q[i]); }
            }
            data[3] = rayQueryGetIntersectionTEXT(q[1], true);
        }";
    samples.push((Stage::Compute, glsl(Stage::Compute, query)));
    let raygen = "layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1, rgba8) uniform image2D result;
        layout(location = 0) rayPayloadEXT vec4 payload;
        layout(location = 1) callableDataEXT float shade;
        void main() {
            payload = vec4(0.0);
            for (uint i = 0u; i < gl_LaunchSizeEXT.x; i++) {
                traceRayEXT(world, gl_RayFlagsOpaqueEXT, 0xff, 0, 1, 0, vec3(gl_LaunchIDEXT), 0.0, vec3(1.0), 100.0, 0);
                executeCallableEXT(i & 3u, 1);
                if (payload.w * shade > 1.0) break;
            }
            imageStore(result, ivec2(gl_LaunchIDEXT.xy), payload);
        }";
    samples.push((Stage::RayGeneration, glsl(Stage::RayGeneration, raygen)));
    let vertex = "layout(location = 0) in vec4 place; layout(location = 1) in ivec2 number;
        layout(location = 0) out vec3 color; layout(location = 1) flat out int which;
        layout(push_constant) uniform P { mat4 turn; } p;
        out gl_PerVertex { vec4 gl_Position; float gl_PointSize; float gl_ClipDistance[2]; };
        void main() {
            gl_Position = p.turn * place;
            gl_PointSize = float(number.x & 7);
            gl_ClipDistance[0] = place.x; gl_ClipDistance[1] = float(gl_VertexIndex - gl_InstanceIndex);
            color = normalize(place.xyz); which = number[gl_VertexIndex & 1];
        }";
    samples.push((Stage::Vertex, glsl(Stage::Vertex, vertex)));
    let fragment = "layout(set = 0, binding = 0) uniform sampler2D t; layout(set = 0, binding = 1) buffer B { uint data[]; };
        layout(location = 0) in vec3 color; layout(location = 1) flat in int which;
        layout(location = 0) out vec4 result; layout(location = 1) out uvec2 more;
        void main() {
            vec4 c = texture(t, color.xy) + textureLod(t, gl_FragCoord.xy * 0.1, fwidth(color.z));
            if (c.w > 0.9 || !gl_FrontFacing) discard;
            for (int i = 0; i < (which & 7); i++) { if (dFdx(c.x) > 0.5) break; c += dFdyFine(c.yzwx); }
            more = uvec2(atomicAdd(data[which & 15], 1u), gl_SampleMaskIn[0]);
            gl_FragDepth = c.z; result = c;
        }";
    samples.push((Stage::Fragment, glsl(Stage::Fragment, fragment)));
    let geometry = "layout(triangles_adjacency, invocations = 3) in; layout(triangle_strip, max_vertices = 12) out;
        layout(location = 0) in vec3 color[]; layout(location = 1) flat in int which[];
        layout(location = 0) out vec3 shade; layout(location = 1) flat out ivec2 number;
        void main() {
            for (int i = 0; i < (which[0] & 15); i++) {
                gl_Position = gl_in[i % 6].gl_Position + vec4(float(gl_InvocationID));
                shade = color[which[1] & 7]; number = ivec2(gl_PrimitiveIDIn, i);
                gl_Layer = i & 1; gl_PrimitiveID = i; EmitVertex();
                if (i % 3 == 2) EndPrimitive();
            }
        }";
    samples.push((Stage::Geometry, glsl(Stage::Geometry, geometry)));
    let payload =
        "struct Payload { uint count; vec3 shade[8]; }; taskPayloadSharedEXT Payload payload;";
    let task = format!(
        "layout(local_size_x = 20) in; {payload} shared uint sum;
        void main() {{
            if (gl_LocalInvocationIndex == 0) {{ sum = 0; payload.count = gl_DrawID; }}
            barrier();
            atomicAdd(payload.count, gl_WorkGroupID.x);
            atomicMax(sum, gl_LocalInvocationIndex);
            payload.shade[gl_LocalInvocationIndex & 7] = vec3(gl_NumWorkGroups);
            barrier();
            EmitMeshTasksEXT(sum, payload.count & 3, 1);
        }}"
    );
    samples.push((Stage::Task, glsl(Stage::Task, &task)));
    let mesh = format!(
        "layout(local_size_x = 24) in; layout(triangles, max_vertices = 24, max_primitives = 12) out;
        {payload} shared vec4 places[24];
        layout(location = 0) out vec3 color[]; layout(location = 1) flat out f16vec2 small[];
        layout(location = 2) perprimitiveEXT out Block {{ int which; uint more[2]; }} blocks[];
        void main() {{
            uint i = gl_LocalInvocationIndex;
            places[i] = vec4(i, gl_WorkGroupID.xy, payload.count);
            barrier();
            SetMeshOutputsEXT(24, payload.count % 12);
            gl_MeshVerticesEXT[i].gl_Position = places[23 - i];
            color[i] = payload.shade[i & 7]; small[i] = f16vec2(places[i].xy);
            for (uint at = i; at < payload.count; at += 24) {{
                gl_PrimitiveTriangleIndicesEXT[at] = uvec3(at, at + 1, at + 2);
                gl_MeshPrimitivesEXT[at].gl_CullPrimitiveEXT = at % 3 == 0;
                gl_MeshPrimitivesEXT[at].gl_Layer = int(at & 1);
                blocks[at].which = int(i); blocks[at].more[at & 1] = at;
            }}
        }}"
    );
    samples.push((Stage::Mesh, glsl(Stage::Mesh, &mesh)));
    samples
}
