//! Stages that are not compiled together: parts of pipelines, and shader objects; and draws on a
//! condition.

use ash::{ext, khr};
use tuff_tests::*;

/// A varying of each kind, by location and component alone.
const VERTEX: &str = "
    layout(push_constant) uniform Push { float depth; };
    layout(location = 3, component = 1) out vec2 place;
    layout(location = 1) flat out uint number;
    void main() {
        place = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
        number = 7u;
        gl_Position = vec4(place, depth, 1.0);
    }";

const FRAGMENT: &str = "
    layout(location = 1) flat in uint number;
    layout(location = 3, component = 1) in vec2 place;
    layout(location = 0) out vec4 color;
    void main() {
        color = vec4(float(number), 0.0, floor((place * 0.5 + 0.5) * 16.0)) / 255.0;
    }";

fn expected() -> Vec<[u8; 4]> {
    (0..16)
        .flat_map(|y| (0..16).map(move |x| [7, 0, x, y]))
        .collect()
}

fn draw(gpu: &Gpu, commands: vk::CommandBuffer, layout: vk::PipelineLayout) {
    gpu.push(commands, layout, &0.5f32);
    gpu.draw_vertices(commands, 3);
}

#[test]
fn parts_are_linked() {
    use vk::GraphicsPipelineLibraryFlagsEXT as Part;
    // Older layers want blend state of pipelines that have it from a library.
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.drawing() else { return };
    let feature = gpu.optional.pipeline_parts.graphics_pipeline_library;
    if !has("VK_EXT_graphics_pipeline_library", feature == vk::TRUE) {
        return;
    }
    let painting = Painting::new(&gpu, VERTEX, FRAGMENT, RGBA);
    let parts = [
        Part::VERTEX_INPUT_INTERFACE,
        Part::PRE_RASTERIZATION_SHADERS,
        Part::FRAGMENT_SHADER,
        Part::FRAGMENT_OUTPUT_INTERFACE,
    ];
    let libraries = parts.map(|part| gpu.painting_part(&painting, part));
    let pipeline = gpu.linked(&libraries, painting.layout);
    let canvas = gpu.canvas(RGBA, 16, 16);
    gpu.paint(&canvas, pipeline, |commands| {
        draw(&gpu, commands, painting.layout)
    });
    assert_eq!(gpu.colors(&canvas), expected());
}

/// Binds a vertex and a fragment shader, and sets all state that draws with shader objects need.
fn bind_shaders(
    gpu: &Gpu,
    commands: vk::CommandBuffer,
    [vertex, fragment]: [vk::ShaderEXT; 2],
    canvas: &Canvas,
    attachments: usize,
) {
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let mut flags = vec![vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
    // Stages that a device has are bound to nothing, if to no shader.
    if gpu.features.geometry_shader == vk::TRUE {
        flags.push(vk::ShaderStageFlags::GEOMETRY);
    }
    if gpu.features.tessellation_shader == vk::TRUE {
        flags.push(vk::ShaderStageFlags::TESSELLATION_CONTROL);
        flags.push(vk::ShaderStageFlags::TESSELLATION_EVALUATION);
    }
    if gpu.optional.mesh_shader.mesh_shader == vk::TRUE {
        flags.push(vk::ShaderStageFlags::TASK_EXT);
        flags.push(vk::ShaderStageFlags::MESH_EXT);
    }
    let mut shaders = vec![vertex, fragment];
    shaders.resize(flags.len(), vk::ShaderEXT::null());
    let device = &gpu.device;
    let viewport = vk::Viewport {
        width: canvas.width as f32,
        height: canvas.height as f32,
        max_depth: 1.0,
        ..Default::default()
    };
    // SAFETY: the command buffer is being recorded.
    unsafe {
        objects.cmd_bind_shaders(commands, &flags, &shaders);
        device.cmd_set_viewport_with_count(commands, &[viewport]);
        device.cmd_set_scissor_with_count(commands, &[canvas.area()]);
        device.cmd_set_rasterizer_discard_enable(commands, false);
        objects.cmd_set_vertex_input(commands, &[], &[]);
        let topology = vk::PrimitiveTopology::TRIANGLE_LIST;
        device.cmd_set_primitive_topology(commands, topology);
        device.cmd_set_primitive_restart_enable(commands, false);
        objects.cmd_set_rasterization_samples(commands, vk::SampleCountFlags::TYPE_1);
        objects.cmd_set_sample_mask(commands, vk::SampleCountFlags::TYPE_1, &[u32::MAX]);
        objects.cmd_set_alpha_to_coverage_enable(commands, false);
        if gpu.features.alpha_to_one == vk::TRUE {
            objects.cmd_set_alpha_to_one_enable(commands, false);
        }
        objects.cmd_set_polygon_mode(commands, vk::PolygonMode::FILL);
        device.cmd_set_cull_mode(commands, vk::CullModeFlags::NONE);
        device.cmd_set_front_face(commands, vk::FrontFace::CLOCKWISE);
        if gpu.features.depth_clamp == vk::TRUE {
            objects.cmd_set_depth_clamp_enable(commands, false);
        }
        if gpu.optional.depth_clip.depth_clip_enable == vk::TRUE {
            objects.cmd_set_depth_clip_enable(commands, true);
        }
        device.cmd_set_depth_bias_enable(commands, false);
        device.cmd_set_depth_test_enable(commands, false);
        device.cmd_set_depth_write_enable(commands, false);
        device.cmd_set_depth_bounds_test_enable(commands, false);
        device.cmd_set_stencil_test_enable(commands, false);
        if gpu.optional.shading_rate.pipeline_fragment_shading_rate == vk::TRUE {
            let keep = vk::FragmentShadingRateCombinerOpKHR::KEEP;
            gpu.set_shading_rate(commands, [1, 1], [keep; 2]);
        }
        if gpu.features.logic_op == vk::TRUE {
            objects.cmd_set_logic_op_enable(commands, false);
        }
        let disabled = vec![vk::FALSE; attachments];
        objects.cmd_set_color_blend_enable(commands, 0, &disabled);
        let equations = vec![vk::ColorBlendEquationEXT::default(); attachments];
        objects.cmd_set_color_blend_equation(commands, 0, &equations);
        let all = vec![vk::ColorComponentFlags::RGBA; attachments];
        objects.cmd_set_color_write_mask(commands, 0, &all);
    }
}

#[test]
fn shader_objects_draw_from_source_and_binary() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 246));
    let Some(gpu) = gpu.drawing() else { return };
    if !has(
        "VK_EXT_shader_object",
        gpu.optional.shader_object.shader_object == vk::TRUE,
    ) {
        return;
    }
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let layout = gpu.layout(&[]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let spirv = vk::ShaderCodeTypeEXT::SPIRV;
    let stages = [(Stage::Vertex, VERTEX), (Stage::Fragment, FRAGMENT)];
    let compiled = stages.map(|(stage, source)| {
        gpu.shader_object(stage, spirv, bytemuck::cast_slice(&glsl(stage, source)))
    });
    // SAFETY: the shaders are of this device.
    let binaries = compiled.map(|it| unsafe { objects.get_shader_binary_data(it) }.unwrap());
    let again: [_; 2] = std::array::from_fn(|index| {
        let binary = vk::ShaderCodeTypeEXT::BINARY;
        gpu.shader_object(stages[index].0, binary, &binaries[index])
    });
    for shaders in [compiled, again] {
        let pass = Pass::black(&canvas);
        gpu.draw(&pass, |commands| {
            bind_shaders(&gpu, commands, shaders, &canvas, 1);
            draw(&gpu, commands, layout);
        });
        assert_eq!(gpu.colors(&canvas), expected());
    }
}

/// `vkCmdSetFragmentShadingRateKHR`: four pixels have what their fragment's middle has.
#[test]
fn shader_objects_have_rates() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 246));
    let Some(gpu) = gpu.drawing() else { return };
    let has_objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    let has_rates = gpu.optional.shading_rate.pipeline_fragment_shading_rate == vk::TRUE;
    if !has("VK_EXT_shader_object", has_objects) || !has("fragment shading rates", has_rates) {
        return;
    }
    let layout = gpu.layout(&[]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let spirv = vk::ShaderCodeTypeEXT::SPIRV;
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(gl_FragCoord.xy, gl_ShadingRateEXT, 0.0) / 255.0; }";
    let stages = [(Stage::Vertex, VERTEX), (Stage::Fragment, fragment)];
    let shaders = stages.map(|(stage, source)| {
        gpu.shader_object(stage, spirv, bytemuck::cast_slice(&glsl(stage, source)))
    });
    gpu.draw(&Pass::black(&canvas), |commands| {
        bind_shaders(&gpu, commands, shaders, &canvas, 1);
        let keep = vk::FragmentShadingRateCombinerOpKHR::KEEP;
        gpu.set_shading_rate(commands, [2, 2], [keep; 2]);
        draw(&gpu, commands, layout);
    });
    for (index, color) in (0..=u8::MAX).zip(gpu.colors(&canvas)) {
        let middle = |at: u8| at / 2 * 2 + 1;
        let expected = [middle(index % 16), middle(index / 16), 5, 0];
        assert_eq!(color, expected, "pixel {index}");
    }
}

/// A stage between the two, whose varyings have the locations of both.
const GEOMETRY: &str = "
    layout(triangles) in; layout(triangle_strip, max_vertices = 3) out;
    layout(location = 3, component = 1) in vec2 from[];
    layout(location = 1) flat in uint numbers[];
    layout(location = 3, component = 1) out vec2 place;
    layout(location = 1) flat out uint number;
    void main() {
        for (int i = 0; i < 3; i++) {
            gl_Position = gl_in[i].gl_Position; place = from[i].yx; number = numbers[i] + 1; EmitVertex();
        }
    }";

/// The varyings' places are turned about, and the number is one more.
fn expected_behind_geometry() -> Vec<[u8; 4]> {
    let turned = |index: usize| {
        let (x, y) = (index % 16, index / 16);
        [8, 0, y as u8, x as u8]
    };
    (0..256).map(turned).collect()
}

fn draws_geometry(gpu: &Gpu) -> bool {
    has("geometry shaders", gpu.features.geometry_shader == vk::TRUE)
}

#[test]
fn parts_with_a_geometry_shader_are_linked() {
    use vk::GraphicsPipelineLibraryFlagsEXT as Part;
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.drawing() else { return };
    let parts = gpu.optional.pipeline_parts.graphics_pipeline_library == vk::TRUE;
    if !has("VK_EXT_graphics_pipeline_library", parts) || !draws_geometry(&gpu) {
        return;
    }
    let mut painting = Painting::new(&gpu, VERTEX, FRAGMENT, RGBA);
    painting.geometry = Some(GEOMETRY);
    let parts = [
        Part::VERTEX_INPUT_INTERFACE | Part::FRAGMENT_OUTPUT_INTERFACE,
        Part::PRE_RASTERIZATION_SHADERS,
        Part::FRAGMENT_SHADER,
    ];
    let libraries = parts.map(|part| gpu.painting_part(&painting, part));
    let pipeline = gpu.linked(&libraries, painting.layout);
    let canvas = gpu.canvas(RGBA, 16, 16);
    gpu.paint(&canvas, pipeline, |commands| {
        draw(&gpu, commands, painting.layout)
    });
    assert_eq!(gpu.colors(&canvas), expected_behind_geometry());
}

/// A geometry shader is bound to the others, and taken away again.
#[test]
fn geometry_shaders_are_bound_and_unbound() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 246));
    let Some(gpu) = gpu.drawing() else { return };
    let has_objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    if !has("VK_EXT_shader_object", has_objects) || !draws_geometry(&gpu) {
        return;
    }
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let layout = gpu.layout(&[]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let compile = |stage, source| {
        let words = glsl(stage, source);
        gpu.shader_object(
            stage,
            vk::ShaderCodeTypeEXT::SPIRV,
            bytemuck::cast_slice(&words),
        )
    };
    let shaders = [
        compile(Stage::Vertex, VERTEX),
        compile(Stage::Fragment, FRAGMENT),
    ];
    let between = compile(Stage::Geometry, GEOMETRY);
    let stages = [vk::ShaderStageFlags::GEOMETRY];
    for (shader, expected) in [
        (between, expected_behind_geometry()),
        (vk::ShaderEXT::null(), expected()),
    ] {
        gpu.draw(&Pass::black(&canvas), |commands| {
            bind_shaders(&gpu, commands, shaders, &canvas, 1);
            // SAFETY: the command buffer is being recorded, and the shaders are of this device.
            unsafe {
                objects.cmd_bind_shaders(commands, &stages, &[between]);
                objects.cmd_bind_shaders(commands, &stages, &[shader]);
            }
            draw(&gpu, commands, layout);
        });
        assert_eq!(gpu.colors(&canvas), expected);
    }
}

/// A task and a mesh shader that draw what [`VERTEX`] draws, from one payload.
const WORKGROUPS: [&str; 2] = [
    "
    taskPayloadSharedEXT uint number;
    void main() { number = 7; EmitMeshTasksEXT(1, 1, 1); }",
    "
    layout(local_size_x = 3) in;
    layout(triangles, max_vertices = 3, max_primitives = 1) out;
    taskPayloadSharedEXT uint number;
    layout(location = 3, component = 1) out vec2 places[];
    layout(location = 1) flat out uint numbers[];
    void main() {
        SetMeshOutputsEXT(3, 1);
        uint i = gl_LocalInvocationIndex;
        vec2 place = vec2(i & 1u, i >> 1) * 4.0 - 1.0;
        places[i] = place;
        gl_MeshVerticesEXT[i].gl_Position = vec4(place, 0.0, 1.0);
        numbers[i] = number;
        gl_PrimitiveTriangleIndicesEXT[0] = uvec3(0, 1, 2);
    }",
];

/// A task and a mesh shader are bound in the place of a vertex shader.
#[test]
fn mesh_shaders_are_bound() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.drawing() else { return };
    let has_objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    let features = &gpu.optional.mesh_shader;
    let has_stages = features.task_shader == vk::TRUE && features.mesh_shader == vk::TRUE;
    if !has("VK_EXT_shader_object", has_objects) || !has("mesh shaders", has_stages) {
        return;
    }
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let meshes = ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let compile = |stage, source| {
        let words = glsl(stage, source);
        let code = bytemuck::cast_slice(&words);
        gpu.shader_object(stage, vk::ShaderCodeTypeEXT::SPIRV, code)
    };
    let fragment = compile(Stage::Fragment, FRAGMENT);
    let between = [Stage::Task, Stage::Mesh];
    let compiled: [_; 2] = std::array::from_fn(|at| compile(between[at], WORKGROUPS[at]));
    // SAFETY: the shaders are of this device.
    let binaries = compiled.map(|it| unsafe { objects.get_shader_binary_data(it) }.unwrap());
    let again: [_; 2] = std::array::from_fn(|at| {
        gpu.shader_object(between[at], vk::ShaderCodeTypeEXT::BINARY, &binaries[at])
    });
    for bound in [compiled, again] {
        gpu.draw(&Pass::black(&canvas), |commands| {
            bind_shaders(
                &gpu,
                commands,
                [vk::ShaderEXT::null(), fragment],
                &canvas,
                1,
            );
            // SAFETY: the command buffer is being recorded, and the shaders are of this device.
            unsafe {
                objects.cmd_bind_shaders(commands, &between.map(stage_flag), &bound);
                meshes.cmd_draw_mesh_tasks(commands, 1, 1, 1);
            }
        });
        assert_eq!(gpu.colors(&canvas), expected());
    }
}

/// A control and an evaluation shader that draw what [`VERTEX`] draws by itself.
const TESSELLATION: [&str; 2] = [
    "
    layout(vertices = 3) out;
    layout(location = 3, component = 1) in vec2 places[];
    layout(location = 1) in uint numbers[];
    layout(location = 0) out vec3 all[];
    void main() {
        all[gl_InvocationID] = vec3(places[gl_InvocationID], numbers[gl_InvocationID]);
        gl_out[gl_InvocationID].gl_Position = gl_in[gl_InvocationID].gl_Position;
        gl_TessLevelOuter = float[](1.0, 1.0, 1.0, 1.0);
        gl_TessLevelInner = float[](1.0, 1.0);
    }",
    "
    layout(triangles) in;
    layout(location = 0) in vec3 all[];
    layout(location = 3, component = 1) out vec2 place;
    layout(location = 1) flat out uint number;
    void main() {
        vec3 at = gl_TessCoord;
        vec3 sum = all[0] * at.x + all[1] * at.y + all[2] * at.z;
        gl_Position = gl_in[0].gl_Position * at.x + gl_in[1].gl_Position * at.y + gl_in[2].gl_Position * at.z;
        place = sum.xy;
        number = uint(sum.z + 0.5);
    }",
];

fn draws_patches(gpu: &Gpu) -> bool {
    let tessellates = gpu.features.tessellation_shader == vk::TRUE;
    has("tessellation shaders", tessellates)
}

#[test]
fn parts_with_tessellation_shaders_are_linked() {
    use vk::GraphicsPipelineLibraryFlagsEXT as Part;
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.drawing() else { return };
    let parts = gpu.optional.pipeline_parts.graphics_pipeline_library == vk::TRUE;
    if !has("VK_EXT_graphics_pipeline_library", parts) || !draws_patches(&gpu) {
        return;
    }
    let mut painting = Painting::new(&gpu, VERTEX, FRAGMENT, RGBA);
    painting.tessellation = Some(TESSELLATION);
    painting.control_points = 3;
    painting.topology = vk::PrimitiveTopology::PATCH_LIST;
    let parts = [
        Part::VERTEX_INPUT_INTERFACE | Part::FRAGMENT_OUTPUT_INTERFACE,
        Part::PRE_RASTERIZATION_SHADERS,
        Part::FRAGMENT_SHADER,
    ];
    let libraries = parts.map(|part| gpu.painting_part(&painting, part));
    let pipeline = gpu.linked(&libraries, painting.layout);
    let canvas = gpu.canvas(RGBA, 16, 16);
    gpu.paint(&canvas, pipeline, |commands| {
        draw(&gpu, commands, painting.layout)
    });
    assert_eq!(gpu.colors(&canvas), expected());
}

/// Tessellation shaders are bound to the others, with the vertices of a patch, and taken away
/// again.
#[test]
fn tessellation_shaders_are_bound_and_unbound() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 246));
    let Some(gpu) = gpu.drawing() else { return };
    let has_objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    if !has("VK_EXT_shader_object", has_objects) || !draws_patches(&gpu) {
        return;
    }
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let layout = gpu.layout(&[]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let compile = |stage, source| {
        let words = glsl(stage, source);
        gpu.shader_object(
            stage,
            vk::ShaderCodeTypeEXT::SPIRV,
            bytemuck::cast_slice(&words),
        )
    };
    let shaders = [
        compile(Stage::Vertex, VERTEX),
        compile(Stage::Fragment, FRAGMENT),
    ];
    let between = [
        compile(Stage::TessellationControl, TESSELLATION[0]),
        compile(Stage::TessellationEvaluation, TESSELLATION[1]),
    ];
    let stages = [
        vk::ShaderStageFlags::TESSELLATION_CONTROL,
        vk::ShaderStageFlags::TESSELLATION_EVALUATION,
    ];
    for (bound, topology) in [
        (between, vk::PrimitiveTopology::PATCH_LIST),
        (
            [vk::ShaderEXT::null(); 2],
            vk::PrimitiveTopology::TRIANGLE_LIST,
        ),
    ] {
        gpu.draw(&Pass::black(&canvas), |commands| {
            bind_shaders(&gpu, commands, shaders, &canvas, 1);
            // SAFETY: the command buffer is being recorded, and the shaders are of this device.
            unsafe {
                objects.cmd_bind_shaders(commands, &stages, &between);
                objects.cmd_bind_shaders(commands, &stages, &bound);
                objects.cmd_set_patch_control_points(commands, 3);
                let origin = vk::TessellationDomainOrigin::UPPER_LEFT;
                objects.cmd_set_tessellation_domain_origin(commands, origin);
                gpu.device.cmd_set_primitive_topology(commands, topology);
            }
            draw(&gpu, commands, layout);
        });
        let check = || assert_eq!(gpu.colors(&canvas), expected(), "{topology:?}");
        match topology {
            vk::PrimitiveTopology::PATCH_LIST => check(),
            _ => unless_known(
                &gpu,
                "llvmpipe",
                "nothing is drawn after tessellation shaders are unbound",
                check,
            ),
        }
    }
}

/// The locations of attachments belong to the pass (`vkCmdSetRenderingAttachmentLocations`): each
/// pass begins with the attachments' own numbers, and a secondary command buffer with what its
/// inheritance says.
#[test]
fn shader_objects_write_to_the_locations_of_the_pass() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 277));
    let Some(gpu) = gpu.drawing() else { return };
    let objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    let moves = gpu.optional.local_read.dynamic_rendering_local_read == vk::TRUE;
    if !has("VK_EXT_shader_object", objects) || !has("locations of attachments", moves) {
        return;
    }
    let locations = khr::dynamic_rendering_local_read::Device::new(&gpu.instance, &gpu.device);
    let fragment = "
        layout(location = 0) out vec4 first;
        layout(location = 1) out vec4 second;
        void main() { first = vec4(1.0, 0.0, 0.0, 1.0); second = vec4(0.0, 1.0, 0.0, 1.0); }";
    let spirv = vk::ShaderCodeTypeEXT::SPIRV;
    let shaders = [(Stage::Vertex, COVER), (Stage::Fragment, fragment)].map(|(stage, source)| {
        gpu.shader_object(stage, spirv, bytemuck::cast_slice(&glsl(stage, source)))
    });
    let canvases = [gpu.canvas(RGBA, 2, 2), gpu.canvas(RGBA, 2, 2)];
    let pass = Pass {
        colors: &canvases,
        clears: &[BLACK; 2],
        ..Pass::default()
    };
    let swapped =
        vk::RenderingAttachmentLocationInfoKHR::default().color_attachment_locations(&[1, 0]);
    const RED: [u8; 4] = [255, 0, 0, 255];
    const GREEN: [u8; 4] = [0, 255, 0, 255];
    let seen = || canvases.each_ref().map(|canvas| gpu.colors(canvas)[3]);

    // Locations are set, shaders bound, and a pass later all is as at the start.
    gpu.run(|commands| {
        gpu.record_pass(commands, &pass, |commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe { locations.cmd_set_rendering_attachment_locations(commands, &swapped) };
            bind_shaders(&gpu, commands, shaders, &canvases[0], 2);
            gpu.draw_vertices(commands, 3);
        });
    });
    assert_eq!(seen(), [GREEN, RED]);
    gpu.run(|commands| {
        gpu.record_pass(commands, &pass, |commands| {
            bind_shaders(&gpu, commands, shaders, &canvases[0], 2);
            // SAFETY: the command buffer is being recorded.
            unsafe { locations.cmd_set_rendering_attachment_locations(commands, &swapped) };
            gpu.draw_vertices(commands, 3);
        });
        gpu.record_pass(commands, &pass, |commands| {
            gpu.draw_vertices(commands, 3);
        });
    });
    assert_eq!(seen(), [RED, GREEN]);

    // A secondary command buffer that sets no locations has those of its inheritance.
    let formats = [RGBA; 2];
    let mut inherited = swapped;
    let mut rendering = vk::CommandBufferInheritanceRenderingInfo::default()
        .color_attachment_formats(&formats)
        .rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let inheritance = vk::CommandBufferInheritanceInfo::default()
        .push_next(&mut rendering)
        .push_next(&mut inherited);
    let begin = vk::CommandBufferBeginInfo::default()
        .flags(vk::CommandBufferUsageFlags::RENDER_PASS_CONTINUE)
        .inheritance_info(&inheritance);
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .level(vk::CommandBufferLevel::SECONDARY)
        .command_buffer_count(1);
    // SAFETY: the pool is of this device; the structures outlive the calls.
    let secondary = unsafe {
        let secondary = gpu.device.allocate_command_buffers(&info).unwrap()[0];
        gpu.device.begin_command_buffer(secondary, &begin).unwrap();
        bind_shaders(&gpu, secondary, shaders, &canvases[0], 2);
        gpu.draw_vertices(secondary, 3);
        gpu.device.end_command_buffer(secondary).unwrap();
        secondary
    };
    let contents = Pass {
        flags: vk::RenderingFlags::CONTENTS_SECONDARY_COMMAND_BUFFERS,
        ..pass
    };
    gpu.draw(&contents, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            locations.cmd_set_rendering_attachment_locations(commands, &swapped);
            gpu.device.cmd_execute_commands(commands, &[secondary]);
        }
    });
    assert_eq!(seen(), [GREEN, RED]);
}

/// `VK_PIPELINE_CREATE_VIEW_INDEX_FROM_DEVICE_INDEX_BIT`: of a device by itself the device index is
/// 0. In libraries the flag is that of the library that a shader comes with, however they are
/// linked.
#[test]
fn view_indices_are_device_indices_where_pipelines_say_so() {
    use vk::GraphicsPipelineLibraryFlagsEXT as Part;
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.drawing() else { return };
    let views = gpu.features11.multiview == vk::TRUE;
    let parts = gpu.optional.pipeline_parts.graphics_pipeline_library == vk::TRUE;
    if !has("multiview", views) || !has("VK_EXT_graphics_pipeline_library", parts) {
        return;
    }
    let vertex = "
        layout(location = 0) flat out int view;
        void main() {
            view = gl_ViewIndex;
            gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, 0.5, 1.0);
        }";
    let fragment = "
        layout(location = 0) flat in int view;
        layout(location = 0) out vec4 color;
        void main() { color = vec4(view, gl_ViewIndex, 7, 9) / 255.0; }";
    let mut painting = Painting::new(&gpu, vertex, fragment, RGBA);
    painting.view_mask = 0b111;
    let canvas = gpu.canvas_of(RGBA, 2, 2, 3, 1);
    let pass = Pass {
        view_mask: 0b111,
        ..Pass::black(&canvas)
    };
    let colors = |pipeline| {
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 3);
        });
        let colors = gpu.colors(&canvas);
        [0, 4, 8].map(|texel| [colors[texel][0], colors[texel][1]])
    };
    let from_device = vk::PipelineCreateFlags::VIEW_INDEX_FROM_DEVICE_INDEX;
    let none = vk::PipelineCreateFlags::empty();
    let whole = |flags| gpu.painting_with(&painting, flags, std::ptr::null());
    assert_eq!(colors(whole(none)), [[0, 0], [1, 1], [2, 2]]);
    assert_eq!(colors(whole(from_device)), [[0, 0]; 3]);

    let library = |parts, flags, keeps| {
        let mut flags = flags | vk::PipelineCreateFlags::LIBRARY_KHR;
        if keeps {
            flags |= vk::PipelineCreateFlags::RETAIN_LINK_TIME_OPTIMIZATION_INFO_EXT;
        }
        gpu.painting_part_with(&painting, parts, flags)
    };
    for optimized in [false, true] {
        let linked = |before, fragment| {
            let first = Part::VERTEX_INPUT_INTERFACE | Part::PRE_RASTERIZATION_SHADERS;
            let second = Part::FRAGMENT_SHADER | Part::FRAGMENT_OUTPUT_INTERFACE;
            let libraries = [
                library(first, before, optimized),
                library(second, fragment, optimized),
            ];
            let flags = match optimized {
                true => vk::PipelineCreateFlags::LINK_TIME_OPTIMIZATION_EXT,
                false => none,
            };
            colors(gpu.linked_with(&libraries, painting.layout, flags))
        };
        assert_eq!(linked(from_device, from_device), [[0, 0]; 3]);
        assert_eq!(linked(from_device, none), [[0, 0], [0, 1], [0, 2]]);
        assert_eq!(linked(none, from_device), [[0, 0], [1, 0], [2, 0]]);
    }
}

/// `VK_SHADER_CREATE_INDEPENDENT_SETS_BIT_KHR`.
const INDEPENDENT_SETS: vk::ShaderCreateFlagsEXT = vk::ShaderCreateFlagsEXT::from_raw(1 << 18);

/// Each stage knows the layouts of its own sets; dynamic offsets are those of all sets.
#[test]
fn shader_objects_know_some_of_the_sets() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let has_objects = gpu.optional.shader_object.shader_object == vk::TRUE;
    let is_newer = gpu.optional.maintenance11.maintenance11 == vk::TRUE;
    if !has("VK_EXT_shader_object", has_objects) || !has("VK_KHR_maintenance11", is_newer) {
        return;
    }
    let vertex = "
        layout(set = 1, binding = 0) uniform Depths { float depth; };
        layout(location = 0) flat out uint number;
        void main() {
            vec2 place = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
            number = uint(depth * 64.0);
            gl_Position = vec4(place, depth, 1.0);
        }";
    let fragment = "
        layout(location = 0) flat in uint number;
        layout(set = 0, binding = 0) uniform Before { uint before; };
        layout(set = 2, binding = 1) uniform Behind { uint behind; };
        layout(location = 0) out vec4 color;
        void main() { color = vec4(number, before, behind, 255.0) / 255.0; }";
    let step = gpu.limits.min_uniform_buffer_offset_alignment.max(4) as u32;
    let words = |words: [u32; 3]| {
        let mut room = vec![0u32; 3 * step as usize / 4];
        for (index, word) in words.into_iter().enumerate() {
            room[index * step as usize / 4] = word;
        }
        gpu.buffer_with(&room)
    };
    let depths = words([0.25f32, 0.5, 0.75].map(f32::to_bits));
    let (before, behind) = (words([1, 2, 3]), words([4, 5, 6]));
    let sets = [
        gpu.set(&[(0, &[Bound::UniformDynamic(before, 4)])]),
        gpu.set(&[(0, &[Bound::UniformDynamic(depths, 4)])]),
        gpu.set(&[
            (0, &[Bound::UniformDynamic(before, 4)]),
            (1, &[Bound::UniformDynamic(behind, 4)]),
        ]),
    ];
    let [first, second, third] = sets.map(|set| set.layout);
    let none = vk::DescriptorSetLayout::null();
    let objects = ext::shader_object::Device::new(&gpu.instance, &gpu.device);
    let spirv = vk::ShaderCodeTypeEXT::SPIRV;
    let make = |code_type, codes: [&[u8]; 2]| {
        let [vertex, fragment] = codes;
        [
            gpu.shader_object_with(
                Stage::Vertex,
                (code_type, vertex),
                INDEPENDENT_SETS,
                &[none, second],
            ),
            gpu.shader_object_with(
                Stage::Fragment,
                (code_type, fragment),
                INDEPENDENT_SETS,
                &[first, none, third],
            ),
        ]
    };
    let words = [glsl(Stage::Vertex, vertex), glsl(Stage::Fragment, fragment)];
    let compiled = make(
        spirv,
        [0, 1].map(|stage| bytemuck::cast_slice(&words[stage])),
    );
    // SAFETY: the shaders are of this device.
    let binaries = compiled.map(|it| unsafe { objects.get_shader_binary_data(it) }.unwrap());
    let binary = vk::ShaderCodeTypeEXT::BINARY;
    let again = make(binary, [&binaries[0], &binaries[1]]);
    let layout = gpu.layout_with(
        vk::PipelineLayoutCreateFlags::INDEPENDENT_SETS_EXT,
        &[first, second, third],
    );
    let canvas = gpu.canvas(RGBA, 16, 16);
    let offsets = [step, 2 * step, 0, 2 * step];
    for shaders in [compiled, again] {
        gpu.draw(&Pass::black(&canvas), |commands| {
            bind_shaders(&gpu, commands, shaders, &canvas, 1);
            let handles = sets.map(|set| set.handle);
            let point = vk::PipelineBindPoint::GRAPHICS;
            // SAFETY: the command buffer is being recorded; the sets live as long as the device.
            unsafe {
                let device = &gpu.device;
                device.cmd_bind_descriptor_sets(commands, point, layout, 0, &handles, &offsets);
            }
            gpu.draw_vertices(commands, 3);
        });
        // Of depth 0.75, and the second and third words.
        assert!(gpu.colors(&canvas).iter().all(|&it| it == [48, 2, 6, 255]));
    }
}

#[test]
fn draws_wait_for_a_condition() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let feature = gpu.optional.conditional_rendering.conditional_rendering;
    if !has("VK_EXT_conditional_rendering", feature == vk::TRUE) {
        return;
    }
    let conditions = ext::conditional_rendering::Device::new(&gpu.instance, &gpu.device);
    let painting = Painting::new(&gpu, VERTEX, FRAGMENT, RGBA);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let words = gpu.buffer_with(&[0u32, 256]);
    for (offset, inverted, drawn) in [(0, false, false), (4, false, true), (0, true, true)] {
        let pass = Pass::black(&canvas);
        let flags = match inverted {
            true => vk::ConditionalRenderingFlagsEXT::INVERTED,
            false => vk::ConditionalRenderingFlagsEXT::empty(),
        };
        let begin = vk::ConditionalRenderingBeginInfoEXT::default()
            .buffer(words.handle)
            .offset(offset)
            .flags(flags);
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            // SAFETY: the command buffer is being recorded.
            unsafe { (conditions.fp().cmd_begin_conditional_rendering_ext)(commands, &begin) };
            draw(&gpu, commands, painting.layout);
            // SAFETY: the command buffer is being recorded.
            unsafe { (conditions.fp().cmd_end_conditional_rendering_ext)(commands) };
        });
        assert_eq!(
            gpu.colors(&canvas)[0] != [0; 4],
            drawn,
            "offset {offset}, {inverted}"
        );
    }
}
