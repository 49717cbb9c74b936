//! Task and mesh shaders: order, payloads, values of primitives, layers and viewports, distances,
//! indirect draws, queries, views, libraries and shader objects.

use ash::ext;
use tuff_tests::*;

/// Hands on a number of the primitive as a colour of three bytes, and as nothing else.
const NUMBER: &str = "
    layout(location = 0) perprimitiveEXT flat in int number;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(number & 255, number >> 8 & 255, number >> 16 & 255, 255) / 255.0; }";

/// The head of a mesh shader that makes a point of its number.
fn head(side: u32, size: u32, most: u32) -> String {
    format!(
        "layout(local_size_x = {size}) in;
         layout(points, max_vertices = {most}, max_primitives = {most}) out;
         layout(location = 0) perprimitiveEXT flat out int number[];
         void point(uint i, uint x, uint y, uint value) {{
             vec2 at = (vec2(x, y) + 0.5) / {side}.0 * 2.0 - 1.0;
             gl_MeshVerticesEXT[i].gl_Position = vec4(at, 0.5, 1.0);
             gl_MeshVerticesEXT[i].gl_PointSize = 1.0;
             gl_PrimitivePointIndicesEXT[i] = i;
             number[i] = int(value);
         }}"
    )
}

fn device() -> Option<Gpu> {
    drawing(Gpu::new())
}

fn drawing(gpu: Gpu) -> Option<Gpu> {
    gpu.drawing()?.with("mesh shaders", |gpu| {
        let features = &gpu.optional.mesh_shader;
        features.mesh_shader == vk::TRUE && features.task_shader == vk::TRUE
    })
}

/// The number that a pixel has, and none where nothing was drawn.
fn number([r, g, b, a]: [u8; 4]) -> Option<u32> {
    (a != 0).then(|| u32::from_le_bytes([r, g, b, 0]))
}

fn numbers(gpu: &Gpu, canvas: &Canvas) -> Vec<Option<u32>> {
    gpu.colors(canvas).into_iter().map(number).collect()
}

fn painting<'a>(gpu: &Gpu, task: Option<&'a str>, mesh: &'a str) -> Painting<'a> {
    let mut painting = Painting::new(gpu, "", NUMBER, RGBA);
    painting.mesh = Some((task, mesh));
    painting
}

fn commands_of(gpu: &Gpu) -> ext::mesh_shader::Device {
    ext::mesh_shader::Device::new(&gpu.instance, &gpu.device)
}

fn draw(gpu: &Gpu, commands: vk::CommandBuffer, [x, y, z]: [u32; 3]) {
    // SAFETY: the command buffer is being recorded.
    unsafe { commands_of(gpu).cmd_draw_mesh_tasks(commands, x, y, z) };
}

/// Draws workgroups on a canvas of that many pixels a side.
fn drawn(gpu: &Gpu, painting: &Painting<'_>, side: u32, groups: [u32; 3]) -> Vec<Option<u32>> {
    let pipeline = gpu.painting(painting);
    let canvas = gpu.canvas(RGBA, side, side);
    gpu.paint(&canvas, pipeline, |commands| draw(gpu, commands, groups));
    numbers(gpu, &canvas)
}

/// Workgroups make squares that lie over each other: at each pixel the last one stays, in order of
/// workgroup and primitive, whichever threads draw.
#[test]
fn primitives_stay_in_order() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 32;
    let mesh = "
        layout(local_size_x = 4, local_size_y = 2) in;
        layout(triangles, max_vertices = 8, max_primitives = 4) out;
        layout(location = 0) perprimitiveEXT flat out int number[];
        void main() {
            SetMeshOutputsEXT(8, 4);
            uvec3 group = gl_WorkGroupID;
            uint workgroup = (group.z * gl_NumWorkGroups.y + group.y) * gl_NumWorkGroups.x + group.x;
            uint square = gl_LocalInvocationID.y, corner = gl_LocalInvocationID.x;
            uint value = workgroup * 2 + square;
            vec2 at = vec2(value * 7 % 29, value * 11 % 31) + vec2(corner & 1, corner >> 1) * 3.0;
            gl_MeshVerticesEXT[gl_LocalInvocationIndex].gl_Position = vec4(at / 16.0 - 1.0, 0.5, 1.0);
            if (corner < 2) {
                uint i = square * 2 + corner;
                uvec3 corners = corner == 0 ? uvec3(0, 1, 2) : uvec3(1, 2, 3);
                gl_PrimitiveTriangleIndicesEXT[i] = corners + square * 4;
                number[i] = int(value);
            }
        }";
    let found = drawn(&gpu, &painting(&gpu, None, mesh), SIDE, [20, 25, 6]);
    let mut expected = vec![None; (SIDE * SIDE) as usize];
    for number in 0..20 * 25 * 6 * 2 {
        let (left, top) = (number * 7 % 29, number * 11 % 31);
        for y in top..(top + 3).min(SIDE) {
            for x in left..(left + 3).min(SIDE) {
                expected[(y * SIDE + x) as usize] = Some(number);
            }
        }
    }
    assert_eq!(found, expected);
}

/// Invocations of several subgroups share memory behind barriers, and so do subgroup operations.
#[test]
fn invocations_of_a_workgroup_work_together() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 16;
    let mesh = format!(
        "{}
        shared uint sum; shared uint of_subgroups; shared uint values[128];
        void main() {{
            uint i = gl_LocalInvocationIndex;
            if (i == 0) {{ sum = 0; of_subgroups = 0; }}
            values[i] = i * i;
            barrier();
            atomicAdd(sum, values[127 - i]);
            uint all = subgroupAdd(i);
            if (subgroupElect()) atomicAdd(of_subgroups, all);
            barrier();
            // The number of points is known only now.
            SetMeshOutputsEXT(sum - 690779, of_subgroups - 8027);
            if (i < 101) point(i, i % 16, i / 16, values[i] + sum + of_subgroups);
        }}",
        head(SIDE, 128, 128)
    );
    // The sums of i² and of i below 128.
    let (squares, sum) = (690_880, 8128);
    let found = drawn(&gpu, &painting(&gpu, None, &mesh), SIDE, [1, 1, 1]);
    for (i, found) in (0..).zip(found) {
        let expected = (i < 101).then_some(i * i + squares + sum);
        assert_eq!(found, expected, "pixel {i}");
    }
}

/// Each task asks for as many mesh workgroups as its number says, none among them, and hands them
/// a payload.
#[test]
fn payloads_reach_the_workgroups_of_their_task() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 64;
    let payload = "struct Payload { uint task; uint sum; uint16_t small[3]; float many[40]; };
        taskPayloadSharedEXT Payload payload;";
    let task = format!(
        "layout(local_size_x = 40) in; {payload}
        void main() {{
            uint i = gl_LocalInvocationIndex, task = gl_WorkGroupID.x + 8 * gl_WorkGroupID.y;
            if (i == 0) {{
                payload.sum = 0;
                payload.task = task;
                for (int at = 0; at < 3; at++) payload.small[at] = uint16_t(at + task);
            }}
            barrier();
            atomicAdd(payload.sum, i + task);
            payload.many[i] = float(i) + 0.5;
            EmitMeshTasksEXT(task % 3, 2, task % 5);
        }}"
    );
    let mesh = format!(
        "{} {payload}
        void main() {{
            uint i = gl_WorkGroupID.x + 3 * (gl_WorkGroupID.y + 2 * gl_WorkGroupID.z);
            bool whole = payload.sum == 780 + 40 * payload.task && payload.many[i] == i + 0.5
                && payload.small[2] == uint16_t(payload.task + 2)
                && gl_NumWorkGroups == uvec3(payload.task % 3, 2, payload.task % 5);
            SetMeshOutputsEXT(1, 1);
            point(0, i, payload.task, whole ? 1 + payload.task + 64 * i : 0);
        }}",
        head(SIDE, 1, 1)
    );
    let painting = painting(&gpu, Some(&task), &mesh);
    let found = drawn(&gpu, &painting, SIDE, [8, 8, 1]);
    let mut expected = vec![None; (SIDE * SIDE) as usize];
    for task in 0..64 {
        for (x, y, z) in (0..task % 3)
            .flat_map(|x| (0..2).flat_map(move |y| (0..task % 5).map(move |z| (x, y, z))))
        {
            let i = x + 3 * (y + 2 * z);
            expected[(task * SIDE + i) as usize] = Some(1 + task + 64 * i);
        }
    }
    assert_eq!(found, expected);
}

/// Values of primitives come to fragments as they are, those of vertices interpolated; primitives
/// that are culled are not drawn.
#[test]
fn values_of_primitives_and_vertices_come_to_fragments() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 8;
    let mesh = "
        layout(local_size_x = 16) in;
        layout(lines, max_vertices = 16, max_primitives = 8) out;
        layout(location = 0) out vec2 a[];
        layout(location = 1) flat out uvec2 b[];
        layout(location = 2) perprimitiveEXT out Block { uvec2 c; float d[2]; } of_primitive[];
        void main() {
            SetMeshOutputsEXT(16, 8);
            uint i = gl_LocalInvocationIndex, line = i / 2;
            float x = i % 2 == 0 ? -1.0 : 1.0, y = (float(line) + 0.5) / 4.0 - 1.0;
            gl_MeshVerticesEXT[i].gl_Position = vec4(x, y, 0.5, 1.0);
            a[i] = vec2(x * 4.0 + 4.0, 7.0);
            b[i] = uvec2(i, i + 50);
            if (i < 8) {
                gl_PrimitiveLineIndicesEXT[i] = uvec2(2 * i, 2 * i + 1);
                if (i == 3 || i == 6) gl_MeshPrimitivesEXT[i].gl_CullPrimitiveEXT = true;
                else gl_MeshPrimitivesEXT[i].gl_CullPrimitiveEXT = false;
                gl_MeshPrimitivesEXT[i].gl_PrimitiveID = int(100 + i);
                of_primitive[i].c = uvec2(i * 3, i * 5);
                of_primitive[i].d[0] = float(i) + 0.25;
                of_primitive[i].d[1] = -float(i);
            }
        }";
    let fragment = "
        layout(location = 0) in vec2 a;
        layout(location = 1) flat in uvec2 b;
        layout(location = 2) perprimitiveEXT in Block { uvec2 c; float d[2]; };
        layout(location = 0) out vec4 color;
        void main() {
            uint i = gl_PrimitiveID - 100;
            // The first vertex of a line provokes.
            bool whole = b == uvec2(2 * i, 2 * i + 50) && c == uvec2(i * 3, i * 5)
                && d[0] == float(i) + 0.25 && d[1] == -float(i) && abs(a.y - 7.0) < 0.001
                && abs(a.x - gl_FragCoord.x) < 0.01;
            color = vec4(whole ? float(i + 1) / 255.0 : 0.0, 0.0, 0.0, 1.0);
        }";
    let mut painting = painting(&gpu, None, mesh);
    painting.fragment = Some(fragment);
    let found = drawn(&gpu, &painting, SIDE, [1, 1, 1]);
    for (pixel, found) in (0..).zip(found) {
        let line = pixel / SIDE;
        let expected = (line != 3 && line != 6).then_some(line + 1);
        assert_eq!(found, expected, "pixel {pixel}");
    }
}

/// Each primitive has a layer and a viewport to itself, though all have the same vertices.
#[test]
fn primitives_choose_layer_and_viewport() {
    let Some(gpu) = device() else { return };
    let viewports = gpu.features.multi_viewport == vk::TRUE;
    if !has("several viewports", viewports) {
        return;
    }
    const SIDE: u32 = 4;
    let mesh = "
        layout(local_size_x = 6) in;
        layout(triangles, max_vertices = 3, max_primitives = 6) out;
        layout(location = 0) perprimitiveEXT flat out int number[];
        void main() {
            SetMeshOutputsEXT(3, 6);
            uint i = gl_LocalInvocationIndex;
            if (i < 3) {
                gl_MeshVerticesEXT[i].gl_Position = vec4(i == 1 ? 3.0 : -1.0, i == 2 ? 3.0 : -1.0, 0.5, 1.0);
            }
            gl_PrimitiveTriangleIndicesEXT[i] = uvec3(0, 1, 2);
            gl_MeshPrimitivesEXT[i].gl_Layer = int(i / 2);
            gl_MeshPrimitivesEXT[i].gl_ViewportIndex = int(i % 2);
            number[i] = int(1000 + i);
        }";
    let fragment = "
        layout(location = 0) perprimitiveEXT flat in int number;
        layout(location = 0) out vec4 color;
        void main() {
            int all = number * 8 + gl_Layer * 2 + gl_ViewportIndex;
            color = vec4(all & 255, all >> 8 & 255, all >> 16, 255) / 255.0;
        }";
    let mut painting = painting(&gpu, None, mesh);
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
        draw(&gpu, commands, [1, 1, 1]);
    });
    for (index, found) in (0..).zip(numbers(&gpu, &canvas)) {
        let (layer, viewport) = (index / (SIDE * SIDE), index % SIDE / 2);
        let expected = (1000 + layer * 2 + viewport) * 8 + layer * 2 + viewport;
        assert_eq!(found, Some(expected), "pixel {index}");
    }
}

/// A primitive is clipped where a distance is negative, and gone where all cull distances are.
#[test]
fn distances_clip_and_cull() {
    let Some(gpu) = device() else { return };
    let distances = gpu.features.shader_clip_distance == vk::TRUE
        && gpu.features.shader_cull_distance == vk::TRUE;
    if !has("clip and cull distances", distances) {
        return;
    }
    const SIDE: u32 = 8;
    let mesh = "
        layout(local_size_x = 6) in;
        layout(triangles, max_vertices = 6, max_primitives = 2) out;
        layout(location = 0) perprimitiveEXT flat out int number[];
        out gl_MeshPerVertexEXT {
            vec4 gl_Position; float gl_ClipDistance[2]; float gl_CullDistance[1];
        } gl_MeshVerticesEXT[];
        void main() {
            SetMeshOutputsEXT(6, 2);
            uint i = gl_LocalInvocationIndex, corner = i % 3;
            vec4 at = vec4(corner == 1 ? 3.0 : -1.0, corner == 2 ? 3.0 : -1.0, 0.5, 1.0);
            gl_MeshVerticesEXT[i].gl_Position = at;
            gl_MeshVerticesEXT[i].gl_ClipDistance[0] = 1.0;
            gl_MeshVerticesEXT[i].gl_ClipDistance[1] = at.x;
            gl_MeshVerticesEXT[i].gl_CullDistance[0] = i < 3 ? 1.0 : -1.0;
            if (i < 2) {
                gl_PrimitiveTriangleIndicesEXT[i] = uvec3(0, 1, 2) + 3 * i;
                number[i] = int(1 + i);
            }
        }";
    let found = drawn(&gpu, &painting(&gpu, None, mesh), SIDE, [1, 1, 1]);
    for (index, found) in (0..).zip(found) {
        let is_right = index % SIDE >= SIDE / 2;
        assert_eq!(found, is_right.then_some(1), "pixel {index}");
    }
}

/// The most vertices and primitives: a point each, from several workgroups.
#[test]
fn the_most_primitives_are_all_drawn() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 64;
    let mesh = format!(
        "{}
        void main() {{
            SetMeshOutputsEXT(256, 256);
            for (uint i = gl_LocalInvocationIndex; i < 256; i += 64) {{
                uint value = gl_WorkGroupID.y * 256 + i;
                point(i, value % 64, value / 64, value);
            }}
        }}",
        head(SIDE, 64, 256)
    );
    let found = drawn(&gpu, &painting(&gpu, None, &mesh), SIDE, [1, 16, 1]);
    let expected: Vec<_> = (0..SIDE * SIDE).map(Some).collect();
    assert_eq!(found, expected);
}

/// Numbers of workgroups that stand in buffers, and the number of draws, too.
#[test]
fn indirect_draws_read_their_numbers() {
    let Some(gpu) = device() else { return };
    const SIDE: u32 = 16;
    let task = "
        taskPayloadSharedEXT uint index;
        void main() { index = gl_DrawID; EmitMeshTasksEXT(gl_NumWorkGroups.y, 1, 1); }";
    let mesh = format!(
        "{} taskPayloadSharedEXT uint index;
        void main() {{
            SetMeshOutputsEXT(1, 1);
            point(0, gl_WorkGroupID.x, index, 1 + index);
        }}",
        head(SIDE, 1, 1)
    );
    let alone = format!(
        "{} void main() {{
            SetMeshOutputsEXT(1, 1);
            point(0, gl_WorkGroupID.y, gl_DrawID, gl_NumWorkGroups.y);
        }}",
        head(SIDE, 1, 1)
    );
    let pipelines = [
        gpu.painting(&painting(&gpu, Some(task), &mesh)),
        gpu.painting(&painting(&gpu, None, &alone)),
    ];
    // Four words apart.
    let groups: Vec<u32> = (0..8u32).flat_map(|draw| [1, draw, 1, 99]).collect();
    let groups = gpu.buffer_with(&groups);
    let count = gpu.buffer_with(&[77u32, 5]);
    let all = commands_of(&gpu);
    let counted = gpu.features12.draw_indirect_count == vk::TRUE;
    for (by_count, pipeline) in [false, true]
        .into_iter()
        .flat_map(|it| pipelines.map(|pipeline| (it, pipeline)))
    {
        if by_count && !has("counts of draws in buffers", counted) {
            continue;
        }
        let canvas = gpu.canvas(RGBA, SIDE, SIDE);
        gpu.paint(&canvas, pipeline, |commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe {
                match by_count {
                    false => all.cmd_draw_mesh_tasks_indirect(commands, groups.handle, 16, 7, 16),
                    true => all.cmd_draw_mesh_tasks_indirect_count(
                        commands,
                        groups.handle,
                        16,
                        count.handle,
                        4,
                        7,
                        16,
                    ),
                }
            }
        });
        let draws = if by_count { 5 } else { 7 };
        for (index, found) in (0..).zip(numbers(&gpu, &canvas)) {
            let (x, draw) = (index % SIDE, index / SIDE);
            let expected = (draw < draws && x <= draw).then_some(draw + 1);
            assert_eq!(found, expected, "pixel {index}, counted: {by_count}");
        }
    }
}

#[test]
fn queries_count_invocations_and_primitives() {
    use vk::QueryPipelineStatisticFlags as Statistic;
    let Some(gpu) = device() else { return };
    let counts = gpu.features.pipeline_statistics_query == vk::TRUE
        && gpu.optional.mesh_shader.mesh_shader_queries == vk::TRUE;
    if !has("queries of mesh shaders", counts) {
        return;
    }
    let task = "layout(local_size_x = 5) in; void main() { EmitMeshTasksEXT(3, 2, 1); }";
    let mesh = format!(
        "{} void main() {{
            SetMeshOutputsEXT(7, 7);
            if (gl_LocalInvocationIndex < 7) point(gl_LocalInvocationIndex, 1, 1, 1);
        }}",
        head(8, 20, 10)
    );
    let pipeline = gpu.painting(&painting(&gpu, Some(task), &mesh));
    let canvas = gpu.canvas(RGBA, 8, 8);
    let wanted = [
        (Statistic::FRAGMENT_SHADER_INVOCATIONS, 4 * 6 * 7),
        (Statistic::TASK_SHADER_INVOCATIONS_EXT, 4 * 5),
        (Statistic::MESH_SHADER_INVOCATIONS_EXT, 4 * 6 * 20),
    ];
    let all = wanted.iter().fold(Statistic::empty(), |all, it| all | it.0);
    let info = vk::QueryPoolCreateInfo::default().query_count(1);
    let statistics = info
        .query_type(vk::QueryType::PIPELINE_STATISTICS)
        .pipeline_statistics(all);
    let made = info.query_type(vk::QueryType::MESH_PRIMITIVES_GENERATED_EXT);
    let pools = [gpu.query_pool(&statistics), gpu.query_pool(&made)];
    gpu.run(|commands| {
        for pool in pools {
            // SAFETY: the command buffer is being recorded.
            unsafe {
                gpu.device.cmd_reset_query_pool(commands, pool, 0, 1);
                let flags = vk::QueryControlFlags::empty();
                gpu.device.cmd_begin_query(commands, pool, 0, flags);
            }
        }
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            draw(&gpu, commands, [2, 1, 2]);
        });
        for pool in pools {
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_end_query(commands, pool, 0) };
        }
    });
    let [found] = gpu.query_results::<[u64; 3], 1>(pools[0], 0);
    assert_eq!(found, wanted.map(|(_, count)| count));
    let [found] = gpu.query_results::<u64, 1>(pools[1], 0);
    assert_eq!(found, 4 * 6 * 7);
}

/// Shaders without a picture still run: what they store is there, in both stages.
#[test]
fn invocations_store_where_nothing_is_rasterized() {
    let Some(gpu) = device() else { return };
    let stores = gpu.features.vertex_pipeline_stores_and_atomics == vk::TRUE;
    if !has("stores in mesh shaders", stores) {
        return;
    }
    let task = "
        layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) buffer B { uint sums[2]; };
        void main() { atomicAdd(sums[0], gl_GlobalInvocationID.x); EmitMeshTasksEXT(2, 1, 1); }";
    let mesh = "
        layout(local_size_x = 32) in;
        layout(triangles, max_vertices = 3, max_primitives = 1) out;
        layout(set = 0, binding = 0) buffer B { uint sums[2]; };
        void main() { SetMeshOutputsEXT(0, 0); atomicAdd(sums[1], gl_GlobalInvocationID.x); }";
    let buffer = gpu.buffer_with(&[0u32; 2]);
    let set = gpu.set_of(&[Bound::Storage(buffer)]);
    let mut painting = painting(&gpu, Some(task), mesh);
    painting.fragment = Some(WHITE);
    painting.dynamic = vec![vk::DynamicState::RASTERIZER_DISCARD_ENABLE];
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 4, 4);
    gpu.paint(&canvas, pipeline, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_set_rasterizer_discard_enable(commands, true) };
        gpu.bind_set(commands, painting.layout, set.handle);
        draw(&gpu, commands, [10, 1, 1]);
    });
    // The sums of numbers below 640, and ten times of those below 64.
    assert_eq!(buffer.read::<u32>(), [639 * 640 / 2, 10 * (63 * 64 / 2)]);
}

/// Two workgroups wait for each other, of the task shader and then of the mesh shader. Vulkan
/// promises no such progress, but workers take workgroups in order, and two of them one each.
#[test]
fn two_workgroups_wait_for_each_other() {
    let variables = [("TUFF_THREADS", "2"), ("LP_NUM_THREADS", "2")];
    if !alone("two_workgroups_wait_for_each_other", &variables) {
        return;
    }
    let Some(gpu) = device() else { return };
    let stores = gpu.features.vertex_pipeline_stores_and_atomics == vk::TRUE;
    if !has("stores in mesh shaders", stores) {
        return;
    }
    const WAIT: &str = "
        layout(set = 0, binding = 0) coherent buffer B { uint started[2]; uint met[2]; };
        void wait(uint stage) {
            atomicAdd(started[stage], 1u);
            uint turns = 0u;
            while (atomicAdd(started[stage], 0u) < 2u && turns < 1u << 25) turns++;
            if (turns < 1u << 25) atomicAdd(met[stage], 1u);
        }";
    let task = format!(
        "layout(local_size_x = 1) in; {WAIT}
        void main() {{ wait(0); EmitMeshTasksEXT(1, 1, 1); }}"
    );
    let mesh = format!(
        "layout(local_size_x = 1) in; {WAIT}
        layout(triangles, max_vertices = 3, max_primitives = 1) out;
        void main() {{ SetMeshOutputsEXT(0, 0); wait(1); }}"
    );
    let buffer = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[Bound::Storage(buffer)]);
    let mut painting = painting(&gpu, Some(&task), &mesh);
    painting.fragment = Some(WHITE);
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 4, 4);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_set(commands, painting.layout, set.handle);
        draw(&gpu, commands, [2, 1, 1]);
    });
    assert_eq!(buffer.read::<u32>(), [2; 4]);
}

#[test]
fn views_run_mesh_shaders_of_their_own() {
    let Some(gpu) = device() else { return };
    let views = gpu.optional.mesh_shader.multiview_mesh_shader == vk::TRUE;
    if !has("views with mesh shaders", views) {
        return;
    }
    let mesh = format!(
        "{} void main() {{
            SetMeshOutputsEXT(1, 1);
            point(0, gl_ViewIndex, 1, 5 + gl_ViewIndex);
        }}",
        head(4, 1, 1)
    );
    let mut painting = painting(&gpu, None, &mesh);
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
        draw(&gpu, commands, [1, 1, 1]);
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

/// Stages that come from parts of pipelines.
#[test]
fn parts_of_pipelines_have_mesh_shaders() {
    use vk::GraphicsPipelineLibraryFlagsEXT as Part;
    // Older layers want vertex shaders and blend state of parts that have neither.
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = drawing(gpu) else { return };
    let feature = gpu.optional.pipeline_parts.graphics_pipeline_library;
    if !has("VK_EXT_graphics_pipeline_library", feature == vk::TRUE) {
        return;
    }
    let task = "void main() { EmitMeshTasksEXT(16, 1, 1); }";
    let mesh = format!(
        "{} void main() {{
            SetMeshOutputsEXT(1, 1);
            point(0, gl_WorkGroupID.x % 4, gl_WorkGroupID.x / 4, gl_WorkGroupID.x);
        }}",
        head(4, 1, 1)
    );
    let painting = painting(&gpu, Some(task), &mesh);
    let parts = [
        Part::PRE_RASTERIZATION_SHADERS,
        Part::FRAGMENT_SHADER,
        Part::FRAGMENT_OUTPUT_INTERFACE,
    ];
    let libraries = parts.map(|part| gpu.painting_part(&painting, part));
    let pipeline = gpu.linked(&libraries, painting.layout);
    let canvas = gpu.canvas(RGBA, 4, 4);
    gpu.paint(&canvas, pipeline, |commands| {
        draw(&gpu, commands, [1, 1, 1])
    });
    let expected: Vec<_> = (0..16).map(Some).collect();
    assert_eq!(numbers(&gpu, &canvas), expected);
}
