//! Geometry shaders: input and output topologies, invocations, layers and viewports, distances,
//! the order of primitives, queries, views.

use tuff_tests::*;
use vk::PrimitiveTopology as Topology;

/// Hands on its number as a colour of three bytes, and as nothing else.
const NUMBER: &str = "
    layout(location = 0) flat in int number;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(number & 255, number >> 8 & 255, number >> 16 & 255, 255) / 255.0; }";

/// A vertex shader whose vertices know nothing but their index.
const INDEX: &str = "
    layout(location = 0) flat out int index;
    void main() { index = gl_VertexIndex; gl_Position = vec4(0.0, 0.0, 0.0, 1.0); }";

/// A function that gives the centre of a pixel of an attachment of that many pixels a side.
fn centre(side: u32) -> String {
    format!(
        "vec4 centre(int x, int y) {{ return vec4((vec2(x, y) + 0.5) / {side}.0 * 2.0 - 1.0, 0.5, 1.0); }}"
    )
}

fn device() -> Option<Gpu> {
    Gpu::new().drawing()?.with("geometry shaders", |gpu| {
        gpu.features.geometry_shader == vk::TRUE
    })
}

/// The number that a pixel has, and none where nothing was drawn.
fn number([r, g, b, a]: [u8; 4]) -> Option<u32> {
    (a != 0).then(|| u32::from_le_bytes([r, g, b, 0]))
}

fn numbers(gpu: &Gpu, canvas: &Canvas) -> Vec<Option<u32>> {
    gpu.colors(canvas).into_iter().map(number).collect()
}

fn painting<'a>(gpu: &Gpu, geometry: &'a str, topology: Topology) -> Painting<'a> {
    let mut painting = Painting::new(gpu, INDEX, NUMBER, RGBA);
    painting.geometry = Some(geometry);
    painting.topology = topology;
    painting
}

/// Points become squares that lie over each other: at each pixel the last one stays, in order of
/// primitive, invocation and emission, whichever threads draw.
#[test]
fn primitives_stay_in_order() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 32;
    const POINTS: u32 = 3000;
    let geometry = "
        layout(points, invocations = 2) in; layout(triangle_strip, max_vertices = 8) out;
        layout(location = 0) flat in int index[];
        layout(location = 0) flat out int number;
        void main() {
            for (int square = 0; square < 2; square++) {
                number = (index[0] * 2 + gl_InvocationID) * 2 + square;
                vec2 place = vec2(number * 7 % 29, number * 11 % 31);
                for (int corner = 0; corner < 4; corner++) {
                    vec2 at = place + vec2(corner & 1, corner >> 1) * 3.0;
                    gl_Position = vec4(at / 16.0 - 1.0, 0.5, 1.0);
                    EmitVertex();
                }
                EndPrimitive();
            }
        }";
    let pipeline = gpu.painting(&painting(&gpu, geometry, Topology::POINT_LIST));
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.draw_vertices(commands, POINTS);
    });
    let mut expected = vec![None; (SIDE * SIDE) as usize];
    for number in 0..POINTS * 4 {
        let (left, top) = (number * 7 % 29, number * 11 % 31);
        for y in top..(top + 3).min(SIDE) {
            for x in left..(left + 3).min(SIDE) {
                expected[(y * SIDE + x) as usize] = Some(number);
            }
        }
    }
    assert_eq!(numbers(&gpu, &canvas), expected);
}

/// The vertices of each primitive in the order of the shader's inputs (section "Primitive
/// Topologies"): a digit each, the first one lowest.
fn seen(
    gpu: &Gpu,
    topology: Topology,
    inputs: &str,
    indices: &[u16],
    restart: bool,
) -> Vec<Vec<u32>> {
    const SIDE: u32 = 8;
    let geometry = format!(
        "layout({inputs}) in; layout(points, max_vertices = 1) out;
        layout(location = 0) flat in int index[];
        layout(location = 0) flat out int number;
        {}
        void main() {{
            number = 0;
            for (int i = index.length() - 1; i >= 0; i--) number = number * 16 + index[i];
            gl_Position = centre(gl_PrimitiveIDIn % 8, gl_PrimitiveIDIn / 8);
            gl_PointSize = 1.0;
            EmitVertex();
        }}",
        centre(SIDE)
    );
    let mut painting = painting(gpu, &geometry, topology);
    painting.restart = restart;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    let buffer = gpu.buffer_with(indices);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_indices(commands, &buffer, vk::IndexType::UINT16);
        // SAFETY: the command buffer is being recorded.
        unsafe { (gpu.device).cmd_draw_indexed(commands, indices.len() as u32, 1, 0, 0, 0) };
    });
    let corners = match inputs {
        "points" => 1,
        "lines" => 2,
        "triangles" => 3,
        "lines_adjacency" => 4,
        _ => 6,
    };
    let digits = |number: u32| {
        (0..corners)
            .map(|digit| number >> (4 * digit) & 15)
            .collect()
    };
    let all = numbers(gpu, &canvas);
    let drawn = all.iter().map_while(|number| number.map(digits)).collect();
    let count = all.iter().flatten().count();
    assert_eq!(count, all.iter().take_while(|it| it.is_some()).count());
    drawn
}

#[test]
fn inputs_are_the_vertices_of_each_topology() {
    let Some(gpu) = device() else { return };
    let first = |count| (0..count).collect::<Vec<u16>>();
    let cases: [(_, _, _, &[&[u32]]); 10] = [
        (Topology::POINT_LIST, "points", 2, &[&[0], &[1]]),
        (Topology::LINE_LIST, "lines", 5, &[&[0, 1], &[2, 3]]),
        (Topology::LINE_STRIP, "lines", 3, &[&[0, 1], &[1, 2]]),
        (
            Topology::TRIANGLE_LIST,
            "triangles",
            7,
            &[&[0, 1, 2], &[3, 4, 5]],
        ),
        (
            Topology::TRIANGLE_STRIP,
            "triangles",
            5,
            &[&[0, 1, 2], &[1, 3, 2], &[2, 3, 4]],
        ),
        (
            Topology::TRIANGLE_FAN,
            "triangles",
            4,
            &[&[1, 2, 0], &[2, 3, 0]],
        ),
        (
            Topology::LINE_LIST_WITH_ADJACENCY,
            "lines_adjacency",
            9,
            &[&[0, 1, 2, 3], &[4, 5, 6, 7]],
        ),
        (
            Topology::LINE_STRIP_WITH_ADJACENCY,
            "lines_adjacency",
            6,
            &[&[0, 1, 2, 3], &[1, 2, 3, 4], &[2, 3, 4, 5]],
        ),
        (
            Topology::TRIANGLE_LIST_WITH_ADJACENCY,
            "triangles_adjacency",
            13,
            &[&[0, 1, 2, 3, 4, 5], &[6, 7, 8, 9, 10, 11]],
        ),
        (
            Topology::TRIANGLE_STRIP_WITH_ADJACENCY,
            "triangles_adjacency",
            12,
            &[
                &[0, 1, 2, 6, 4, 3],
                &[2, 5, 6, 8, 4, 0],
                &[4, 2, 6, 10, 8, 7],
                &[6, 9, 10, 11, 8, 4],
            ],
        ),
    ];
    for (topology, inputs, count, expected) in cases {
        let seen = seen(&gpu, topology, inputs, &first(count), false);
        assert_eq!(seen, expected, "{topology:?}");
    }
}

/// A restart ends a strip with adjacency, and the last triangle of each has no neighbour behind it.
/// Primitives are numbered on.
#[test]
fn strips_with_adjacency_start_anew() {
    let Some(gpu) = device() else { return };
    const END: u16 = u16::MAX;
    let triangles = [
        0, 1, 2, 3, 4, 5, END, 6, 7, END, 1, 2, 3, 4, 5, 6, 7, 8, END,
    ];
    let expected: [&[u32]; 3] = [
        &[0, 1, 2, 5, 4, 3],
        &[1, 2, 3, 7, 5, 4],
        &[3, 6, 7, 8, 5, 1],
    ];
    let topology = Topology::TRIANGLE_STRIP_WITH_ADJACENCY;
    let found = seen(&gpu, topology, "triangles_adjacency", &triangles, true);
    assert_eq!(found, expected);
    let lines = [0, 1, 2, 3, END, 4, 5, 6, END, 7, 8, 9, 10, 11];
    let expected: [&[u32]; 3] = [&[0, 1, 2, 3], &[7, 8, 9, 10], &[8, 9, 10, 11]];
    let topology = Topology::LINE_STRIP_WITH_ADJACENCY;
    let found = seen(&gpu, topology, "lines_adjacency", &lines, true);
    assert_eq!(found, expected);
}

/// Strips of lines and of triangles; a strip that is too short makes no primitive.
#[test]
fn strips_are_cut_where_they_end() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 16;
    // A row of pixels, from one vertex to the next in the middle between two.
    let lines = "
        layout(points) in; layout(line_strip, max_vertices = 9) out;
        layout(location = 0) flat out int number;
        void put(float x, float y, int n) {
            number = n; gl_Position = vec4(x / 8.0 - 1.0, (y + 0.5) / 8.0 - 1.0, 0.5, 1.0); EmitVertex();
        }
        void main() {
            put(0.0, 0.0, 1); put(4.0, 0.0, 2); put(8.0, 0.0, 3); EndPrimitive();
            put(0.0, 2.0, 4); EndPrimitive();
            EndPrimitive();
            put(8.0, 4.0, 5); put(12.0, 4.0, 6);
        }";
    let pipeline = gpu.painting(&painting(&gpu, lines, Topology::POINT_LIST));
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 1));
    let found = numbers(&gpu, &canvas);
    for (index, found) in found.into_iter().enumerate() {
        let expected = match (index as u32 % SIDE, index as u32 / SIDE) {
            (0..4, 0) => Some(1),
            (4..8, 0) => Some(2),
            (8..12, 4) => Some(5),
            _ => None,
        };
        assert_eq!(found, expected, "pixel {index}");
    }
    // The first vertex of each triangle provokes: of a strip, the vertex of the triangle's number.
    let triangles = "
        layout(points) in; layout(triangle_strip, max_vertices = 9) out;
        layout(location = 0) flat out int number;
        void put(float x, float y, int n) {
            number = n; gl_Position = vec4(vec2(x, y) / 8.0 - 1.0, 0.5, 1.0); EmitVertex();
        }
        void main() {
            put(0.0, 0.0, 1); put(0.0, 16.0, 2); put(16.0, 0.0, 3); put(16.0, 16.0, 4); EndPrimitive();
            put(0.0, 0.0, 5); put(16.0, 16.0, 6);
        }";
    let pipeline = gpu.painting(&painting(&gpu, triangles, Topology::POINT_LIST));
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 1));
    for (index, found) in numbers(&gpu, &canvas).into_iter().enumerate() {
        let (x, y) = (index as u32 % SIDE, index as u32 / SIDE);
        if x + y != SIDE - 1 {
            let expected = if x + y < SIDE { 1 } else { 2 };
            assert_eq!(found, Some(expected), "pixel {x}, {y}");
        }
    }
}

/// Each invocation has a layer, a viewport and a number of its primitive to itself.
#[test]
fn invocations_choose_layer_viewport_and_number() {
    let Some(gpu) = device() else { return };
    let viewports = gpu.features.multi_viewport == vk::TRUE;
    if !has("several viewports", viewports) {
        return;
    }
    const SIDE: u32 = 4;
    let geometry = "
        layout(triangles, invocations = 6) in; layout(triangle_strip, max_vertices = 3) out;
        layout(location = 0) flat in int index[];
        void main() {
            for (int i = 0; i < 3; i++) {
                gl_Position = vec4(index[i] == 1 ? 3.0 : -1.0, index[i] == 2 ? 3.0 : -1.0, 0.5, 1.0);
                gl_Layer = gl_InvocationID / 2;
                gl_ViewportIndex = gl_InvocationID % 2;
                gl_PrimitiveID = 1000 * gl_InvocationID + gl_PrimitiveIDIn;
                EmitVertex();
            }
        }";
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() {
            int number = gl_PrimitiveID * 8 + gl_Layer * 2 + gl_ViewportIndex;
            color = vec4(number & 255, number >> 8 & 255, number >> 16, 255) / 255.0;
        }";
    let mut painting = painting(&gpu, geometry, Topology::TRIANGLE_LIST);
    painting.fragment = Some(fragment);
    painting.viewports = 2;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas_of(RGBA, SIDE, SIDE, 3, 1);
    gpu.paint(&canvas, pipeline, |commands| {
        let half = |x: u32| vk::Viewport {
            x: x as f32,
            y: 0.0,
            width: 2.0,
            height: SIDE as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let scissors = [canvas.area(); 2];
        // SAFETY: the command buffer is being recorded.
        unsafe {
            let device = &gpu.device;
            device.cmd_set_viewport(commands, 0, &[half(0), half(2)]);
            device.cmd_set_scissor(commands, 0, &scissors);
        }
        gpu.draw_vertices(commands, 3);
    });
    for (index, found) in numbers(&gpu, &canvas).into_iter().enumerate() {
        let index = index as u32;
        let (layer, viewport) = (index / (SIDE * SIDE), index % SIDE / 2);
        let invocation = layer * 2 + viewport;
        let expected = 1000 * invocation * 8 + layer * 2 + viewport;
        assert_eq!(found, Some(expected), "pixel {index}");
    }
}

/// Distances come in with vertices and leave with those that are emitted; a primitive whose cull
/// distances are all negative is gone.
#[test]
fn distances_clip_and_cull() {
    let Some(gpu) = device() else { return };
    let distances = gpu.features.shader_clip_distance == vk::TRUE
        && gpu.features.shader_cull_distance == vk::TRUE;
    if !has("clip and cull distances", distances) {
        return;
    }
    const SIDE: u32 = 8;
    let vertex = "
        out gl_PerVertex { vec4 gl_Position; float gl_ClipDistance[1]; float gl_CullDistance[1]; };
        void main() {
            gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, 0.5, 1.0);
            gl_ClipDistance[0] = gl_Position.x;
            gl_CullDistance[0] = -1.0;
        }";
    let geometry = "
        layout(triangles, invocations = 2) in; layout(triangle_strip, max_vertices = 3) out;
        in gl_PerVertex { vec4 gl_Position; float gl_ClipDistance[1]; float gl_CullDistance[1]; } gl_in[];
        out gl_PerVertex { vec4 gl_Position; float gl_ClipDistance[1]; float gl_CullDistance[1]; };
        layout(location = 0) flat out int number;
        void main() {
            for (int i = 0; i < 3; i++) {
                gl_Position = gl_in[i].gl_Position;
                gl_ClipDistance[0] = gl_in[i].gl_ClipDistance[0];
                gl_CullDistance[0] = gl_InvocationID == 1 ? gl_in[i].gl_CullDistance[0] : 1.0;
                number = 1 + gl_InvocationID;
                EmitVertex();
            }
        }";
    let mut painting = painting(&gpu, geometry, Topology::TRIANGLE_LIST);
    painting.vertex = vertex;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 3));
    for (index, found) in numbers(&gpu, &canvas).into_iter().enumerate() {
        let is_right = index as u32 % SIDE >= SIDE / 2;
        assert_eq!(found, is_right.then_some(1), "pixel {index}");
    }
}

/// As many vertices as a shader may emit: each is a pixel.
#[test]
fn the_most_vertices_are_all_drawn() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 128;
    let geometry = format!(
        "layout(points, invocations = 32) in; layout(points, max_vertices = 128) out;
        layout(location = 0) flat in int index[];
        layout(location = 0) flat out int number;
        {}
        void main() {{
            for (int i = 0; i < 128; i++) {{
                number = (index[0] * 32 + gl_InvocationID) * 128 + i;
                gl_Position = centre(number % 128, number / 128);
                gl_PointSize = 1.0;
                EmitVertex();
            }}
        }}",
        centre(SIDE)
    );
    let pipeline = gpu.painting(&painting(&gpu, &geometry, Topology::POINT_LIST));
    let canvas = gpu.canvas(RGBA, SIDE, SIDE);
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 4));
    let expected: Vec<_> = (0..SIDE * SIDE).map(Some).collect();
    assert_eq!(numbers(&gpu, &canvas), expected);
}

#[test]
fn queries_count_invocations_and_primitives() {
    use vk::QueryPipelineStatisticFlags as Statistic;
    let Some(gpu) = device() else { return };
    let counts = gpu.features.pipeline_statistics_query == vk::TRUE;
    if !has("pipeline statistics", counts) {
        return;
    }
    // Of seven points, those of odd numbers make a strip of three triangles and a stray vertex.
    let geometry = "
        layout(points, invocations = 3) in; layout(triangle_strip, max_vertices = 6) out;
        layout(location = 0) flat in int index[];
        layout(location = 0) flat out int number;
        void main() {
            if (index[0] % 2 == 0) return;
            for (int i = 0; i < 6; i++) {
                number = 1;
                gl_Position = vec4(i & 1, i >> 1, 0.5, 1.0);
                EmitVertex();
                if (i == 4) EndPrimitive();
            }
        }";
    let pipeline = gpu.painting(&painting(&gpu, geometry, Topology::POINT_LIST));
    let canvas = gpu.canvas(RGBA, 8, 8);
    let wanted = [
        (Statistic::INPUT_ASSEMBLY_PRIMITIVES, 7),
        (Statistic::VERTEX_SHADER_INVOCATIONS, 7),
        (Statistic::GEOMETRY_SHADER_INVOCATIONS, 21),
        (Statistic::GEOMETRY_SHADER_PRIMITIVES, 27),
        (Statistic::CLIPPING_INVOCATIONS, 27),
    ];
    let all = wanted.iter().fold(Statistic::empty(), |all, it| all | it.0);
    let info = vk::QueryPoolCreateInfo::default()
        .query_type(vk::QueryType::PIPELINE_STATISTICS)
        .query_count(1)
        .pipeline_statistics(all);
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
    let [found] = gpu.query_results::<[u64; 5], 1>(pool, 0);
    assert_eq!(found, wanted.map(|(_, count)| count));
}

/// A shader without a picture still runs: what it stores is there.
#[test]
fn invocations_store_where_nothing_is_rasterized() {
    let Some(gpu) = device() else { return };
    let stores = gpu.features.vertex_pipeline_stores_and_atomics == vk::TRUE;
    if !has("stores in geometry shaders", stores) {
        return;
    }
    let geometry = "
        layout(lines, invocations = 4) in; layout(line_strip, max_vertices = 2) out;
        layout(location = 0) flat in int index[];
        layout(set = 0, binding = 0) buffer B { uint sum[4]; };
        void main() { atomicAdd(sum[gl_InvocationID], uint(index[0] + index[1])); }";
    let buffer = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[Bound::Storage(buffer)]);
    let mut painting = painting(&gpu, geometry, Topology::LINE_STRIP);
    painting.fragment = Some(WHITE);
    painting.dynamic = vec![vk::DynamicState::RASTERIZER_DISCARD_ENABLE];
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 4, 4);
    gpu.paint(&canvas, pipeline, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_set_rasterizer_discard_enable(commands, true) };
        gpu.bind_set(commands, painting.layout, set.handle);
        gpu.draw_vertices(commands, 100);
    });
    // The sum of 2i + 1 over 99 lines.
    assert_eq!(buffer.read::<u32>(), [99 * 99; 4]);
}

#[test]
fn views_run_geometry_shaders_of_their_own() {
    let Some(gpu) = device() else { return };
    let views = gpu.features11.multiview_geometry_shader == vk::TRUE;
    if !has("views with geometry shaders", views) {
        return;
    }
    let geometry = format!(
        "layout(points) in; layout(points, max_vertices = 1) out;
        layout(location = 0) flat out int number;
        {}
        void main() {{
            number = 5 + gl_ViewIndex; gl_Position = centre(gl_ViewIndex, 1); gl_PointSize = 1.0; EmitVertex();
        }}",
        centre(4)
    );
    let mut painting = painting(&gpu, &geometry, Topology::POINT_LIST);
    painting.view_mask = 0b101;
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas_of(RGBA, 4, 4, 3, 1);
    let pass = |view_mask| Pass {
        view_mask,
        ..Pass::black(&canvas)
    };
    gpu.draw(&pass(0b111), |_| {});
    gpu.draw(&pass(0b101), |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 1);
    });
    for (index, found) in numbers(&gpu, &canvas).into_iter().enumerate() {
        let expected = match (index / 16, index % 16) {
            (0, 4) => Some(5),
            (2, 6) => Some(7),
            _ => None,
        };
        assert_eq!(found, expected, "pixel {index}");
    }
}
