//! Tessellation: domains, spacings, levels, vertex orders, interfaces of both shaders, barriers,
//! restarts in lists of patches, geometry shaders after it, queries, bad input.

use tuff_tests::*;
use vk::PrimitiveTopology as Topology;

/// Hands on its number as a colour of three bytes.
const NUMBER: &str = "
    layout(location = 0) flat in int number;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(number & 255, number >> 8 & 255, number >> 16 & 255, 255) / 255.0; }";

/// A vertex shader whose vertices know nothing but their index.
const INDEX: &str = "
    layout(location = 0) out int index;
    void main() { index = gl_VertexIndex; gl_Position = vec4(0.0, 0.0, 0.0, 1.0); }";

/// A control shader of one vertex a patch, with these levels.
fn levels(outer: &str, inner: &str) -> String {
    format!(
        "layout(vertices = 1) out;
        layout(push_constant) uniform Push {{ vec4 outer; vec2 inner; }};
        layout(location = 0) in int index[];
        void main() {{
            vec4 o = {outer}; vec2 i = {inner};
            for (int k = 0; k < 4; k++) gl_TessLevelOuter[k] = o[k];
            for (int k = 0; k < 2; k++) gl_TessLevelInner[k] = i[k];
        }}"
    )
}

fn device() -> Option<Gpu> {
    Gpu::new().drawing()?.with("tessellation shaders", |gpu| {
        gpu.features.tessellation_shader == vk::TRUE
    })
}

fn numbers(gpu: &Gpu, canvas: &Canvas) -> Vec<Option<u32>> {
    let number = |[r, g, b, a]: [u8; 4]| (a != 0).then(|| u32::from_le_bytes([r, g, b, 0]));
    gpu.colors(canvas).into_iter().map(number).collect()
}

fn painting<'a>(gpu: &Gpu, shaders: [&'a str; 2], points: u32) -> Painting<'a> {
    let mut painting = Painting::new(gpu, INDEX, NUMBER, RGBA);
    painting.tessellation = Some(shaders);
    painting.control_points = points;
    painting.topology = Topology::PATCH_LIST;
    painting
}

const SPACINGS: [&str; 3] = [
    "equal_spacing",
    "fractional_even_spacing",
    "fractional_odd_spacing",
];

/// Levels, the outer ones first.
const LEVELS: [[f32; 6]; 8] = [
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
    [3.0, 5.0, 2.0, 7.0, 4.0, 6.0],
    [0.3, 9.9, 1.0, 64.0, 1.0, 13.2],
    [2.5, 1.0, 1.0, 1.0, 0.0, 1.0],
    [64.0, 64.0, 64.0, 64.0, 64.0, 64.0],
    [1e9, 3.7, f32::INFINITY, 17.0, f32::NAN, 1e30],
    [1.0, 1.0, 1.0, 1.0, 9.5, -4.0],
    [33.1, 2.0, 5.5, 1.1, 63.0, 2.0],
];

/// The triangles of a patch cover its domain once: each pixel inside has been drawn once, and those
/// outside never.
#[test]
fn domains_are_covered_once() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 64;
    let control = levels("outer", "inner");
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    for (domain, scale) in [("quads", 2.0), ("triangles", 4.0)] {
        for spacing in SPACINGS {
            let evaluation = format!(
                "layout({domain}, {spacing}, cw) in;
                layout(location = 0) flat out int number;
                void main() {{
                    number = 1;
                    gl_Position = vec4(gl_TessCoord.xy * {scale} - 1.0, 0.5, 1.0);
                }}"
            );
            let mut painting = painting(&gpu, [&control, &evaluation], 1);
            painting.blend[0] = painting.blend[0]
                .blend_enable(true)
                .src_color_blend_factor(vk::BlendFactor::ONE)
                .dst_color_blend_factor(vk::BlendFactor::ONE);
            let pipeline = gpu.painting(&painting);
            for levels in LEVELS {
                gpu.paint(&canvas, pipeline, |commands| {
                    gpu.push(commands, painting.layout, &levels);
                    gpu.draw_vertices(commands, 1);
                });
                let found = gpu.colors(&canvas);
                let wrong = found.iter().position(|it| it[0] != 1);
                assert_eq!(wrong, None, "{domain} {spacing} {levels:?}");
            }
        }
    }
}

/// A patch with a relevant outer level that is not greater than zero is discarded.
#[test]
fn patches_are_discarded() {
    let Some(gpu) = device() else { return };
    let control = levels("outer", "inner");
    let canvas = gpu.canvas(RGBA, 4, 4);
    for (domain, relevant) in [("quads", 4), ("triangles", 3), ("isolines", 2)] {
        let evaluation = format!(
            "layout({domain}, point_mode) in;
            layout(location = 0) flat out int number;
            void main() {{ number = 1; gl_Position = vec4(0.1, 0.1, 0.5, 1.0); gl_PointSize = 1.0; }}"
        );
        let painting = painting(&gpu, [&control, &evaluation], 1);
        if gpu.features.shader_tessellation_and_geometry_point_size != vk::TRUE {
            return;
        }
        let pipeline = gpu.painting(&painting);
        for level in [0.0, -1.0, f32::NAN] {
            for index in 0..4 {
                let mut levels = [2.0f32; 6];
                levels[index] = level;
                gpu.paint(&canvas, pipeline, |commands| {
                    gpu.push(commands, painting.layout, &levels);
                    gpu.draw_vertices(commands, 1);
                });
                let is_drawn = gpu.colors(&canvas).iter().any(|it| it[3] != 0);
                assert_eq!(is_drawn, index >= relevant, "{domain} {index} {level}");
            }
        }
    }
}

/// Lines go along u, with equal distances in v; their ends are at 0 and 1, and none is at v = 1.
#[test]
fn isolines_are_lines_of_equal_distance() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 16;
    let control = levels("vec4(3.5, 7.0, 0.0, 0.0)", "vec2(0.0)");
    for spacing in SPACINGS {
        let evaluation = format!(
            "layout(isolines, {spacing}) in;
            layout(location = 0) flat out int number;
            void main() {{
                number = 1 + int(gl_TessCoord.y * 4.0 + 0.5);
                gl_Position = vec4(gl_TessCoord.x * 2.0 - 1.0, (gl_TessCoord.y * 16.0 + 0.5) / 8.0 - 1.0, 0.5, 1.0);
            }}"
        );
        let painting = painting(&gpu, [&control, &evaluation], 1);
        let pipeline = gpu.painting(&painting);
        let canvas = gpu.canvas(RGBA, SIDE, SIDE);
        gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 1));
        for (index, found) in numbers(&gpu, &canvas).into_iter().enumerate() {
            let y = index as u32 / SIDE;
            let expected = y.is_multiple_of(4).then_some(1 + y / 4);
            assert_eq!(found, expected, "{spacing} {index}");
        }
    }
}

/// Vertex orders and origins decide which triangles face front.
#[test]
fn orders_and_origins_turn_triangles() {
    let Some(gpu) = device() else { return };
    let control = levels("vec4(3.0)", "vec2(3.0)");
    let canvas = gpu.canvas(RGBA, 8, 8);
    for domain in ["quads", "triangles"] {
        for order in ["cw", "ccw"] {
            for lower_left in [false, true] {
                // The picture of the domain: v downwards from an upper left origin, else upwards.
                let evaluation = format!(
                    "layout({domain}, equal_spacing, {order}) in;
                    layout(location = 0) flat out int number;
                    void main() {{
                        number = 1;
                        vec2 at = gl_TessCoord.xy * 4.0 - 1.0;
                        gl_Position = vec4(at.x, {} at.y, 0.5, 1.0);
                    }}",
                    if lower_left { "-" } else { "" }
                );
                let mut painting = painting(&gpu, [&control, &evaluation], 1);
                painting.lower_left = lower_left;
                painting.rasterization = painting
                    .rasterization
                    .cull_mode(vk::CullModeFlags::BACK)
                    .front_face(match order {
                        "cw" => vk::FrontFace::CLOCKWISE,
                        _ => vk::FrontFace::COUNTER_CLOCKWISE,
                    });
                let pipeline = gpu.painting(&painting);
                gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 1));
                let is_drawn = gpu.colors(&canvas).iter().all(|it| it[3] != 0);
                assert!(is_drawn, "{domain} {order} {lower_left}");
            }
        }
    }
}

/// Invocations read what others of their patch wrote before a barrier: outputs of vertices and of
/// the patch. A patch has one subgroup, a part of one, or several.
#[test]
fn control_shaders_share_outputs() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 8;
    const PATCHES: u32 = SIDE * SIDE;
    for vertices in [1, 3, 5, 16, 17, 32] {
        let control = format!(
            "#define id gl_InvocationID
            layout(vertices = {vertices}) out;
            layout(location = 0) in int index[];
            layout(location = 0) out int first[];
            layout(location = 1) out ivec2 second[];
            layout(location = 2) patch out int marks[4];
            layout(location = 6) patch out ivec2 total;
            void main() {{
                first[id] = index[id % 2] * 100 + id;
                if (id == {vertices} - 1) marks[gl_PrimitiveID & 3] = gl_PrimitiveID + 7;
                barrier();
                int next = (id + 1) % {vertices};
                second[id] = ivec2(first[next], marks[gl_PrimitiveID & 3]);
                barrier();
                if (id == 0) {{
                    total = ivec2(0, gl_PrimitiveID);
                    for (int k = 0; k < {vertices}; k++) total.x += second[k].x * (k + 1);
                    gl_TessLevelOuter = float[](1.0, 1.0, 1.0, 1.0);
                    gl_TessLevelInner = float[](1.0, 1.0);
                }}
            }}"
        );
        let evaluation = format!(
            "layout(quads) in;
            layout(location = 0) in int first[];
            layout(location = 1) in ivec2 second[];
            layout(location = 2) patch in int marks[4];
            layout(location = 6) patch in ivec2 total;
            layout(location = 0) flat out int number;
            void main() {{
                int id = total.y;
                int sum = 0;
                for (int k = 0; k < gl_PatchVerticesIn; k++) sum += second[k].x * (k + 1);
                bool right = sum == total.x && gl_PatchVerticesIn == {vertices}
                    && first[{vertices} - 1] == (id * 2 + ({vertices} - 1) % 2) * 100 + {vertices} - 1
                    && second[{vertices} - 1].y == marks[id & 3];
                number = right ? marks[id & 3] : 0;
                vec2 at = vec2(id % 8, id / 8) + gl_TessCoord.xy;
                gl_Position = vec4(at / 4.0 - 1.0, 0.5, 1.0);
            }}"
        );
        let painting = painting(&gpu, [&control, &evaluation], 2);
        let pipeline = gpu.painting(&painting);
        let canvas = gpu.canvas(RGBA, SIDE, SIDE);
        gpu.paint(&canvas, pipeline, |commands| {
            gpu.draw_vertices(commands, 2 * PATCHES + 1);
        });
        let expected: Vec<_> = (0..PATCHES).map(|patch| Some(patch + 7)).collect();
        assert_eq!(numbers(&gpu, &canvas), expected, "{vertices}");
    }
}

/// Blocks, doubles, narrow types, built-ins of vertices and levels cross from stage to stage.
#[test]
fn interfaces_of_all_kinds_cross() {
    let Some(gpu) = device() else { return };
    let features = &gpu.features;
    if !has("64-bit floats", features.shader_float64 == vk::TRUE) {
        return;
    }
    let vertex = "
        layout(location = 0) out int index;
        layout(location = 1) out Block { double d; layout(location = 3) vec3 v[2]; } block;
        void main() {
            index = gl_VertexIndex;
            block.d = gl_VertexIndex + 1.0lf / 3.0lf;
            block.v[0] = vec3(gl_VertexIndex, 2.0, 3.0);
            block.v[1] = vec3(4.0, gl_VertexIndex, 6.0);
            gl_Position = vec4(gl_VertexIndex, 1.0, 2.0, 3.0);
        }";
    let control = "
        #define id gl_InvocationID
        layout(vertices = 3) out;
        layout(location = 0) in int index[];
        layout(location = 1) in Block { double d; layout(location = 3) vec3 v[2]; } block[];
        layout(location = 0) out Out { dvec3 d; layout(location = 5, component = 1) vec2 v; } outer[];
        layout(location = 7) patch out Patch { dvec2 d; mat2 m; } whole;
        void main() {
            outer[id].d = dvec3(block[id].d, 1.0, id);
            outer[id].v = vec2(block[id].v[0].x, block[id].v[1].y);
            gl_out[id].gl_Position = gl_in[id].gl_Position * 2.0;
            if (id == 1) {
                whole.d = dvec2(0.1lf, block[2].d);
                whole.m = mat2(1.0, 2.0, 3.0, 4.0);
                gl_TessLevelOuter = float[](1.0, 2.0, 3.0, 4.0);
                gl_TessLevelInner = float[](5.0, 6.0);
            }
        }";
    let evaluation = "
        layout(quads, equal_spacing) in;
        layout(location = 0) in Out { dvec3 d; layout(location = 5, component = 1) vec2 v; } outer[];
        layout(location = 7) patch in Patch { dvec2 d; mat2 m; } whole;
        layout(location = 0) flat out int number;
        void main() {
            bool right = whole.d == dvec2(0.1lf, 2.0 + 1.0lf / 3.0lf)
                && whole.m == mat2(1.0, 2.0, 3.0, 4.0)
                && gl_TessLevelOuter[0] == 1.0 && gl_TessLevelOuter[3] == 4.0 && gl_TessLevelInner[1] == 6.0;
            for (int k = 0; k < 3; k++) {
                right = right && outer[k].d == dvec3(k + 1.0lf / 3.0lf, 1.0, k)
                    && outer[k].v == vec2(k, k)
                    && gl_in[k].gl_Position == vec4(2 * k, 2.0, 4.0, 6.0);
            }
            number = right ? 1 : 2;
            gl_Position = vec4(gl_TessCoord.xy * 2.0 - 1.0, 0.5, 1.0);
        }";
    let mut painting = painting(&gpu, [control, evaluation], 3);
    painting.vertex = vertex;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 4, 4);
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 3));
    assert_eq!(numbers(&gpu, &canvas), [Some(1); 16]);
}

/// A restart drops the vertices of a patch that is not complete, as does the end of a draw.
#[test]
fn patches_start_anew() {
    let Some(gpu) = device() else { return };
    let restarts = gpu
        .optional
        .list_restart
        .primitive_topology_patch_list_restart
        == vk::TRUE;
    if !has("restarts in lists of patches", restarts) {
        return;
    }
    let control = "
        layout(vertices = 1) out;
        layout(location = 0) in int index[];
        layout(location = 0) patch out ivec2 of_patch;
        void main() {
            of_patch.x = (index[0] - 1) / 3;
            of_patch.y = gl_PatchVerticesIn == 3 ? index[0] + index[1] * 16 + index[2] * 256 : 0;
            gl_TessLevelOuter = float[](1.0, 1.0, 1.0, 1.0);
            gl_TessLevelInner = float[](1.0, 1.0);
        }";
    let evaluation = "
        layout(quads) in;
        layout(location = 0) patch in ivec2 of_patch;
        layout(location = 0) flat out int number;
        void main() {
            number = of_patch.y;
            vec2 at = vec2(of_patch.x, 0) + gl_TessCoord.xy;
            gl_Position = vec4(at / vec2(2.0, 0.5) - 1.0, 0.5, 1.0);
        }";
    let mut painting = painting(&gpu, [control, evaluation], 3);
    painting.restart = true;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 4, 1);
    const END: u16 = u16::MAX;
    let indices = [1, 2, END, 3, 4, 5, 6, END, END, 7, 8, 9, 10, 11, 12, 13, 14];
    let buffer = gpu.buffer_with(&indices);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_indices(commands, &buffer, vk::IndexType::UINT16);
        // SAFETY: the command buffer is being recorded.
        unsafe { (gpu.device).cmd_draw_indexed(commands, indices.len() as u32, 1, 0, 0, 0) };
    });
    let patch = |[a, b, c]: [u32; 3]| Some(a + b * 16 + c * 256);
    let expected = [
        patch([3, 4, 5]),
        None,
        patch([7, 8, 9]),
        patch([10, 11, 12]),
    ];
    assert_eq!(numbers(&gpu, &canvas), expected);
}

/// Patches lie over each other: at each pixel the last one stays, however large they are and
/// whichever threads draw.
#[test]
fn patches_stay_in_order() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 32;
    const PATCHES: u32 = 60;
    let control = "
        layout(vertices = 1) out;
        layout(location = 0) in int index[];
        layout(location = 0) out int of_patch[];
        void main() {
            of_patch[gl_InvocationID] = index[0];
            for (int k = 0; k < 4; k++) gl_TessLevelOuter[k] = float(1 + (index[0] * 7) % 20);
            for (int k = 0; k < 2; k++) gl_TessLevelInner[k] = float(1 + (index[0] * 11) % 24);
        }";
    let evaluation = "
        layout(quads) in;
        layout(location = 0) in int of_patch[];
        layout(location = 0) flat out int number;
        void main() {
            number = of_patch[0];
            vec2 place = vec2((number * 7) % 29, (number * 11) % 31);
            gl_Position = vec4((place + gl_TessCoord.xy * 3.0) / 16.0 - 1.0, 0.5, 1.0);
        }";
    let pipeline = gpu.painting(&painting(&gpu, [control, evaluation], 1));
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.draw_vertices(commands, PATCHES);
    });
    let mut expected = vec![None; (SIDE * SIDE) as usize];
    for number in 0..PATCHES {
        let (left, top) = (number * 7 % 29, number * 11 % 31);
        for y in top..(top + 3).min(SIDE) {
            for x in left..(left + 3).min(SIDE) {
                expected[(y * SIDE + x) as usize] = Some(number);
            }
        }
    }
    assert_eq!(numbers(&gpu, &canvas), expected);
}

/// A geometry shader takes what patches become: triangles, lines or points, each vertex once in
/// point mode.
#[test]
fn geometry_shaders_follow() {
    let Some(gpu) = device() else { return };
    let has_geometry = gpu.features.geometry_shader == vk::TRUE;
    if !has("geometry shaders", has_geometry) {
        return;
    }
    let control = levels("vec4(4.0)", "vec2(4.0)");
    for (domain, inputs, count) in [
        ("quads", "triangles", 32),
        ("triangles", "triangles", 24),
        ("isolines", "lines", 16),
        ("quads, point_mode", "points", 25),
        ("triangles, point_mode", "points", 19),
        ("isolines, point_mode", "points", 20),
    ] {
        let evaluation = format!(
            "layout({domain}, equal_spacing) in;
            layout(location = 3) out vec2 at;
            void main() {{ at = gl_TessCoord.xy; gl_Position = vec4(0.0, 0.0, 0.5, 1.0); }}"
        );
        let geometry = format!(
            "layout({inputs}) in; layout(triangle_strip, max_vertices = 4) out;
            layout(location = 3) in vec2 at[];
            layout(location = 0) flat out int number;
            void main() {{
                for (int k = 0; k < 4; k++) {{
                    number = 1;
                    gl_Position = vec4(vec2(k & 1, k >> 1) * 2.0 - 1.0, 0.5, 1.0);
                    if (all(greaterThanEqual(at[0], vec2(0.0)))) EmitVertex();
                }}
            }}"
        );
        let mut painting = painting(&gpu, [&control, &evaluation], 1);
        painting.geometry = Some(&geometry);
        painting.blend[0] = painting.blend[0]
            .blend_enable(true)
            .src_color_blend_factor(vk::BlendFactor::ONE)
            .dst_color_blend_factor(vk::BlendFactor::ONE);
        let pipeline = gpu.painting(&painting);
        let canvas = gpu.canvas(RGBA, 4, 4);
        gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 1));
        let found = gpu.colors(&canvas);
        assert!(found.iter().all(|it| it[0] == count), "{domain}: {found:?}");
    }
}

/// Queries count patches and the vertices of their subdivision; each of those may be evaluated more
/// than once.
#[test]
fn queries_count_patches_and_vertices() {
    use vk::QueryPipelineStatisticFlags as Statistic;
    let Some(gpu) = device() else { return };
    let counts = gpu.features.pipeline_statistics_query == vk::TRUE;
    if !has("pipeline statistics", counts) {
        return;
    }
    let control = levels("vec4(4.0)", "vec2(4.0)");
    let evaluation = "
        layout(quads, equal_spacing) in;
        layout(location = 0) flat out int number;
        void main() { number = 1; gl_Position = vec4(gl_TessCoord.xy, 0.5, 1.0); }";
    let pipeline = gpu.painting(&painting(&gpu, [&control, evaluation], 2));
    let canvas = gpu.canvas(RGBA, 8, 8);
    let info = vk::QueryPoolCreateInfo::default()
        .query_type(vk::QueryType::PIPELINE_STATISTICS)
        .query_count(1)
        .pipeline_statistics(
            Statistic::CLIPPING_INVOCATIONS
                | Statistic::TESSELLATION_CONTROL_SHADER_PATCHES
                | Statistic::TESSELLATION_EVALUATION_SHADER_INVOCATIONS,
        );
    let pool = gpu.query_pool(&info);
    gpu.run(|commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            gpu.device.cmd_reset_query_pool(commands, pool, 0, 1);
            let flags = vk::QueryControlFlags::empty();
            gpu.device.cmd_begin_query(commands, pool, 0, flags);
        }
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 7);
        });
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_end_query(commands, pool, 0) };
    });
    let [[clipped, patches, evaluated]] = gpu.query_results::<[u64; 3], 1>(pool, 0);
    // Three patches of 32 triangles and 25 vertices.
    assert_eq!([clipped, patches], [96, 3]);
    assert!((75..=288).contains(&evaluated), "{evaluated}");
}

/// Garbage of all kinds: indices past the ends of arrays, vertices that a patch lacks, levels of
/// NaN. What is drawn is undefined; other memory and later draws are not.
#[test]
fn nonsense_does_no_harm() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 8;
    let control = "
        layout(vertices = 32) out;
        layout(push_constant) uniform Push { int wild; float level; };
        layout(location = 0) in int index[];
        layout(location = 0) out ivec4 words[];
        layout(location = 1) patch out int of_patch[8];
        void main() {
            words[gl_InvocationID] = ivec4(index[(gl_InvocationID + wild) & 31]);
            of_patch[wild & 7] = index[31];
            barrier();
            int other = words[(gl_InvocationID * wild) & 31].x;
            of_patch[other & 7] = gl_InvocationID;
            gl_TessLevelOuter[wild & 3] = level;
            gl_TessLevelInner[wild & 1] = level;
        }";
    let evaluation = "
        layout(triangles, fractional_odd_spacing) in;
        layout(push_constant) uniform Push { int wild; float level; };
        layout(location = 0) in ivec4 words[];
        layout(location = 1) patch in int of_patch[8];
        layout(location = 0) flat out int number;
        void main() {
            number = words[wild & 31].y + of_patch[wild & 7];
            gl_Position = vec4(gl_TessCoord.xy * level, intBitsToFloat(wild), gl_TessLevelOuter[wild & 3]);
        }";
    let wild = painting(&gpu, [control, evaluation], 32);
    let pipeline = gpu.painting(&wild);
    let plain_control = levels("vec4(2.0)", "vec2(2.0)");
    let plain = "
        layout(quads) in;
        layout(location = 0) flat out int number;
        void main() { number = 5; gl_Position = vec4(gl_TessCoord.xy * 2.0 - 1.0, 0.5, 1.0); }";
    let plain = gpu.painting(&painting(&gpu, [&plain_control, plain], 1));
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    for (number, level) in [
        (0, f32::NAN),
        (7, 64.0),
        (-1, f32::INFINITY),
        (i32::MIN, 1e-30),
        (0x7FFF_FFFF, -0.0),
    ] {
        for vertices in [3, 31, 32, 70, 330] {
            gpu.paint(&canvas, pipeline, |commands| {
                gpu.push(commands, wild.layout, &[number as u32, level.to_bits()]);
                gpu.draw_vertices(commands, vertices);
                gpu.bind(commands, plain);
                gpu.draw_vertices(commands, 1);
            });
            let found = numbers(&gpu, &canvas);
            assert_eq!(found, [Some(5); (SIDE * SIDE) as usize]);
        }
    }
}
