//! Drawing: coverage, vertices and indices, instances, depth, blending, indirect draws, queries.

use tuff_tests::*;

const CORNERS: &str = "
    layout(location = 0) in vec4 position;
    layout(location = 1) in vec4 color;
    layout(location = 0) out vec4 shade;
    void main() { gl_Position = position; shade = color; gl_PointSize = 1.0; }";

const SHADE: &str = "
    layout(location = 0) in vec4 shade;
    layout(location = 0) out vec4 color;
    void main() { color = shade; }";

#[test]
fn a_triangle_covers_every_pixel_with_its_own_place() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 70, 33);
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(floor(gl_FragCoord.xy), 0.0, gl_FragCoord.z * 255.0) / 255.0; }";
    let pipeline = gpu.painting(&Painting::new(&gpu, COVER, fragment, RGBA));
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 3));
    for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let place = [(index % 70) as u8, (index / 70) as u8];
        assert_eq!(color[..2], place, "pixel {index}");
        assert!(
            color[3].abs_diff(128) <= 1,
            "depth of pixel {index}: {}",
            color[3]
        );
    }
}

/// Random triangles: pixels whose centre is clearly inside are covered, those clearly outside are
/// not.
#[test]
fn coverage_is_that_of_pixel_centres() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    const SIZE: u32 = 96;
    let mut random = Rng::with_seed(11);
    let painting = Painting::new(&gpu, CORNERS, SHADE, RGBA).with_corners();
    let pipeline = gpu.painting(&painting);
    for round in 0..24 {
        let scale = [4.0, 1.2, 0.2][round % 3];
        let points: [[f32; 2]; 3] =
            std::array::from_fn(|_| std::array::from_fn(|_| between(&mut random, -scale, scale)));
        let corners = points.map(|[x, y]| Corner::at(x, y, [1.0; 4]));
        let vertices = gpu.buffer_with(&corners);
        let canvas = gpu.canvas(RGBA, SIZE, SIZE);
        gpu.paint(&canvas, pipeline, |commands| {
            gpu.bind_vertices(commands, &vertices);
            gpu.draw_vertices(commands, 3);
        });
        let half = f64::from(SIZE) / 2.0;
        let screen = points.map(|point| point.map(|it| (f64::from(it) + 1.0) * half));
        for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
            let pixel = [index as u32 % SIZE, index as u32 / SIZE].map(|it| f64::from(it) + 0.5);
            if let Some(inside) = is_inside(&screen, pixel) {
                assert_eq!(
                    color[0] == 255,
                    inside,
                    "round {round}, pixel {pixel:?} of {screen:?}"
                );
            }
        }
    }
}

/// Whether a point is inside of a triangle; none if it is near an edge: vertices are snapped to a
/// grid.
fn is_inside(triangle: &[[f64; 2]; 3], [x, y]: [f64; 2]) -> Option<bool> {
    const NEAR: f64 = 1.0 / 8.0;
    let distance = |from: [f64; 2], to: [f64; 2]| {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        ((x - from[0]) * dy - (y - from[1]) * dx) / dx.hypot(dy)
    };
    let edges: [f64; 3] =
        std::array::from_fn(|edge| distance(triangle[edge], triangle[(edge + 1) % 3]));
    let inside = edges.iter().all(|&it| it > NEAR) || edges.iter().all(|&it| it < -NEAR);
    // Near an edge's line, though beyond its ends, is left open, too.
    let near = edges.iter().any(|it| it.abs() <= NEAR);
    (!near).then_some(inside)
}

/// A fan of triangles around a point, drawn so that each adds one: every pixel is covered once,
/// whatever lies on shared edges.
#[test]
fn neighbours_cover_each_pixel_once() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    const SIZE: u32 = 64;
    let mut random = Rng::with_seed(5);
    let canvas = gpu.canvas(RGBA, SIZE, SIZE);
    let one = [1.0 / 255.0; 4];
    let mut corners = Vec::new();
    // A grid of quads with random inner vertices on a grid of half pixels, where centres lie, too.
    const CELLS: usize = 8;
    let place = |cell: usize, random: &mut Rng| match cell {
        0 => -1.0,
        CELLS => 1.0,
        _ => -1.0 + (cell as f32 * 16.0 + random.u32(..9) as f32 - 4.0) / SIZE as f32,
    };
    let grid: Vec<[f32; 2]> = (0..=CELLS)
        .flat_map(|y| (0..=CELLS).map(move |x| (x, y)))
        .map(|(x, y)| [place(x, &mut random), place(y, &mut random)])
        .collect();
    for y in 0..CELLS {
        for x in 0..CELLS {
            let at = |dx: usize, dy: usize| {
                let [x, y] = grid[(y + dy) * (CELLS + 1) + x + dx];
                Corner::at(x, y, one)
            };
            corners.extend([at(0, 0), at(1, 0), at(0, 1), at(1, 0), at(1, 1), at(0, 1)]);
        }
    }
    let vertices = gpu.buffer_with(&corners);
    let mut painting = Painting::new(&gpu, CORNERS, SHADE, RGBA).with_corners();
    painting.blend[0] = painting.blend[0]
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE);
    let pipeline = gpu.painting(&painting);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_vertices(commands, &vertices);
        gpu.draw_vertices(commands, corners.len() as u32);
    });
    assert_eq!(gpu.colors(&canvas), [[1; 4]; (SIZE * SIZE) as usize]);
}

/// Rectangles of two triangles each, which differ in a corner: a fragment has the values of the
/// triangle that it lies in. All of the first rectangle have one plane.
#[test]
fn halves_of_rectangles_have_their_own_values() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    const SIZE: [f64; 2] = [21.0, 13.0];
    const STEP: u32 = 24;
    const KINDS: u32 = 5;
    let vertex = "
        layout(location = 0) in vec4 position;
        layout(location = 1) in vec4 color;
        layout(location = 0) out vec3 shade;
        layout(location = 1) flat out float level;
        void main() { gl_Position = position; shade = color.rgb; level = color.a; }";
    let fragment = "
        layout(location = 0) in vec3 shade;
        layout(location = 1) flat in float level;
        layout(location = 0) out vec4 color;
        void main() { color = vec4(0.25 + 0.5 * shade, level); }";
    let [width, height] = [KINDS * STEP, 18];
    // Colours and depths of the corners by kind, and corners of the second triangle.
    let corner = |kind: u32, [u, v]: [u32; 2], second: bool| -> ([f32; 4], f32) {
        let is_fourth = u + v == 2;
        let mut color = [u as f32, v as f32, 0.5, 1.0];
        let mut depth = 0.5;
        match kind {
            1 if is_fourth => color[0] = 0.25,
            2 if second => color[3] = 0.75,
            // A plane, but not along the sides.
            3 => color[2] = (u + 2 * v) as f32 / 3.0,
            4 if is_fourth => depth = 0.25,
            _ => {}
        }
        (color, depth)
    };
    let mut corners = Vec::new();
    for kind in 0..KINDS {
        for (second, three) in [
            (false, [[0, 0], [1, 0], [0, 1]]),
            (true, [[1, 0], [1, 1], [0, 1]]),
        ] {
            for place in three {
                let (color, depth) = corner(kind, place, second);
                let x = 2.0 + f64::from(kind * STEP) + f64::from(place[0]) * SIZE[0];
                let y = 3.0 + f64::from(place[1]) * SIZE[1];
                let at = |place: f64, size: u32| (place / f64::from(size) * 2.0 - 1.0) as f32;
                corners.push(Corner {
                    position: [at(x, width), at(y, height), depth, 1.0],
                    color,
                });
            }
        }
    }
    let vertices = gpu.buffer_with(&corners);
    let canvas = gpu.canvas(RGBA, width, height);
    let pipeline = gpu.painting(&Painting::new(&gpu, vertex, fragment, RGBA).with_corners());
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_vertices(commands, &vertices);
        gpu.draw_vertices(commands, corners.len() as u32);
    });
    for (index, found) in (0..).zip(gpu.colors(&canvas)) {
        let (x, y) = (index % width, index / width);
        let kind = x / STEP;
        let u = (f64::from(x % STEP) + 0.5 - 2.0) / SIZE[0];
        let v = (f64::from(y) + 0.5 - 3.0) / SIZE[1];
        if !(0.0..1.0).contains(&u) || !(0.0..1.0).contains(&v) {
            assert_eq!(found, [0; 4], "pixel {x}, {y}");
            continue;
        }
        let second = u + v > 1.0;
        if kind != 0 && (u + v - 1.0).abs() < 1e-3 {
            continue;
        }
        let color = |place| corner(kind, place, second).0.map(f64::from);
        let (near, across, down) = match second {
            false => (color([0, 0]), color([1, 0]), color([0, 1])),
            true => (color([1, 1]), color([0, 1]), color([1, 0])),
        };
        let [u, v] = if second { [1.0 - u, 1.0 - v] } else { [u, v] };
        for component in 0..4 {
            let [a, b, c] = [near, across, down].map(|it| it[component]);
            let value = a + u * (b - a) + v * (c - a);
            let value = if component < 3 {
                0.25 + 0.5 * value
            } else {
                value
            };
            let error = (f64::from(found[component]) - 255.0 * value).abs();
            assert!(
                error < 1.0,
                "pixel {x}, {y}: {found:?}, not {value} at {component}"
            );
        }
    }
}

/// A strip of quads, one pixel each: index types, first index, vertex offset and restart.
#[test]
fn indices_choose_vertices() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 8, 2);
    // Vertices of columns: 2i above, 2i + 1 below; vertex 0 is somewhere else.
    let mut corners = vec![Corner::at(9.0, 9.0, [1.0; 4])];
    for column in 0..9 {
        let x = -1.0 + 0.25 * column as f32;
        corners.extend([Corner::at(x, -1.0, [1.0; 4]), Corner::at(x, 1.0, [1.0; 4])]);
    }
    let vertices = gpu.buffer_with(&corners);
    let mut painting = Painting::new(&gpu, CORNERS, SHADE, RGBA).with_corners();
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    painting.restart = true;
    let pipeline = gpu.painting(&painting);
    // Columns 1, 2 and, after the restart, 5; the first index and the offset are skipped over.
    let (short, long) = (u16::MAX, u32::MAX);
    let shorts: [u16; 14] = [0, 0, 2, 3, 4, 5, 6, 7, short, 10, 11, 12, 13, 0];
    let longs = shorts.map(|it| if it == short { long } else { u32::from(it) });
    let (shorts, longs) = (gpu.buffer_with(&shorts), gpu.buffer_with(&longs));
    for (indices, ty) in [
        (shorts, vk::IndexType::UINT16),
        (longs, vk::IndexType::UINT32),
    ] {
        gpu.paint(&canvas, pipeline, |commands| {
            gpu.bind_vertices(commands, &vertices);
            gpu.bind_indices(commands, &indices, ty);
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_draw_indexed(commands, 11, 1, 2, 1, 0) };
        });
        let row = [0, 255, 255, 0, 0, 255, 0, 0].map(|it| [it; 4]);
        assert_eq!(gpu.colors(&canvas), [row, row].concat(), "{ty:?}");
    }
}

/// Each instance is a column of its own colour; attributes advance by instance, from the first
/// instance on.
#[test]
fn instances_have_their_own_attributes() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 4, 1);
    let vertex = "
        layout(location = 0) in float column;
        layout(location = 0) out vec4 shade;
        void main() {
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            gl_Position = vec4((column + corner.x) * 0.5 - 1.0, corner.y * 2.0 - 1.0, 0.0, 1.0);
            shade = vec4(gl_InstanceIndex, column, 0.0, 255.0) / 255.0;
        }";
    let mut painting = Painting::new(&gpu, vertex, SHADE, RGBA);
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    painting.bindings.push(
        vk::VertexInputBindingDescription::default()
            .stride(4)
            .input_rate(vk::VertexInputRate::INSTANCE),
    );
    let format = vk::Format::R32_SFLOAT;
    painting
        .attributes
        .push(vk::VertexInputAttributeDescription::default().format(format));
    let pipeline = gpu.painting(&painting);
    let columns = gpu.buffer_with(&[9.0f32, 9.0, 3.0, 1.0]);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_vertices(commands, &columns);
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_draw(commands, 4, 2, 0, 2) };
    });
    let expected = [[0; 4], [3, 1, 0, 255], [0; 4], [2, 3, 0, 255]];
    assert_eq!(gpu.colors(&canvas), expected);
}

/// Two triangles at two depths, in either order: the nearer one is seen, and its depth stays.
#[test]
fn the_nearer_triangle_is_seen() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let vertex = "
        layout(push_constant) uniform Push { float depth; };
        void main() {
            gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, depth, 1.0);
        }";
    let fragment = "
        layout(push_constant) uniform Push { float depth; };
        layout(location = 0) out vec4 color;
        void main() { color = vec4(depth); }";
    let canvas = gpu.canvas(RGBA, 20, 20);
    for format in [vk::Format::D16_UNORM, vk::Format::D32_SFLOAT] {
        let depth = gpu.canvas(format, 20, 20);
        let mut painting = Painting::new(&gpu, vertex, fragment, RGBA);
        painting.depth = format;
        painting.depth_stencil = painting
            .depth_stencil
            .depth_test_enable(true)
            .depth_write_enable(true)
            .depth_compare_op(vk::CompareOp::LESS);
        let pipeline = gpu.painting(&painting);
        for order in [[0.25f32, 0.75], [0.75, 0.25]] {
            let pass = Pass {
                depth: Some(depth),
                clear_depth: Some((1.0, 0)),
                ..Pass::black(&canvas)
            };
            gpu.draw(&pass, |commands| {
                gpu.bind(commands, pipeline);
                for depth in order {
                    gpu.push(commands, painting.layout, &depth);
                    gpu.draw_vertices(commands, 3);
                }
            });
            assert_eq!(gpu.colors(&canvas), [[64; 4]; 400], "{format:?} {order:?}");
            let aspect = vk::ImageAspectFlags::DEPTH;
            if format == vk::Format::D16_UNORM {
                let depths: Vec<u16> = gpu.texels(&depth, aspect);
                assert!(
                    depths.iter().all(|it| it.abs_diff(16384) <= 1),
                    "{depths:?}"
                );
            } else {
                assert_eq!(gpu.texels::<f32>(&depth, aspect), [0.25; 400]);
            }
        }
    }
}

/// Stencil counts how often each pixel is drawn, and then masks.
#[test]
fn stencil_counts_and_masks() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let format = vk::Format::S8_UINT;
    if !has(
        "stencil attachments",
        gpu.supports(format, vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT),
    ) {
        return;
    }
    let (canvas, stencil) = (gpu.canvas(RGBA, 16, 16), gpu.canvas(format, 16, 16));
    let vertex = "
        void main() {
            float right = gl_InstanceIndex == 0 ? 1.0 : 0.0;
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            gl_Position = vec4(corner.x == 0.0 ? -1.0 : right, corner.y * 2.0 - 1.0, 0.0, 1.0);
        }";
    let face = |compare, pass| {
        vk::StencilOpState::default()
            .compare_op(compare)
            .pass_op(pass)
            .compare_mask(0xff)
            .write_mask(0xff)
            .reference(2)
    };
    let make = |face: vk::StencilOpState, mask: vk::ColorComponentFlags| {
        let mut painting = Painting::new(&gpu, vertex, WHITE, RGBA);
        painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
        painting.stencil = format;
        painting.blend[0] = painting.blend[0].color_write_mask(mask);
        painting.depth_stencil = painting
            .depth_stencil
            .stencil_test_enable(true)
            .front(face)
            .back(face);
        gpu.painting(&painting)
    };
    let count = face(vk::CompareOp::ALWAYS, vk::StencilOp::INCREMENT_AND_CLAMP);
    let count = make(count, vk::ColorComponentFlags::empty());
    let mask = make(
        face(vk::CompareOp::EQUAL, vk::StencilOp::KEEP),
        vk::ColorComponentFlags::RGBA,
    );
    let pass = Pass {
        stencil: Some(stencil),
        clear_depth: Some((0.0, 0)),
        ..Pass::black(&canvas)
    };
    gpu.draw(&pass, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            gpu.bind(commands, count);
            gpu.device.cmd_draw(commands, 4, 2, 0, 0);
            gpu.bind(commands, mask);
            gpu.device.cmd_draw(commands, 4, 1, 0, 0);
        }
    });
    let counts: Vec<u8> = gpu.texels(&stencil, vk::ImageAspectFlags::STENCIL);
    for (index, (count, color)) in counts.into_iter().zip(gpu.colors(&canvas)).enumerate() {
        let left = index % 16 < 8;
        assert_eq!(
            (count, color[0]),
            if left { (2, 255) } else { (1, 0) },
            "pixel {index}"
        );
    }
}

/// The usual blending of a translucent colour over another one.
#[test]
fn translucent_colours_are_blended() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(1.0, 0.5, 0.0, 0.25); }";
    let mut painting = Painting::new(&gpu, COVER, fragment, RGBA);
    painting.blend[0] = painting.blend[0]
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::SRC_ALPHA)
        .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ZERO)
        .color_blend_op(vk::BlendOp::ADD);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 9, 9);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0, 0.0, 1.0, 1.0]],
        ..Pass::default()
    };
    gpu.draw(&pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 3);
    });
    let expected = [0.25f32, 0.125, 0.75, 0.25].map(|it| (it * 255.0).round() as u8);
    for color in gpu.colors(&canvas) {
        for (got, want) in color.into_iter().zip(expected) {
            assert!(got.abs_diff(want) <= 1, "{color:?} is not {expected:?}");
        }
    }
}

/// Modes of `VK_EXT_blend_operation_advanced` on opaque colours, computed by hand. A second draw
/// blends over the first one's result.
#[test]
fn colours_are_blended_by_advanced_operations() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let coherent = gpu
        .optional
        .advanced_blend
        .advanced_blend_coherent_operations;
    if !has("advancedBlendCoherentOperations", coherent == vk::TRUE) {
        return;
    }
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(0.5, 0.25, 1.0, 1.0); }";
    let pipeline = |op| {
        let mut painting = Painting::new(&gpu, COVER, fragment, RGBA);
        painting.blend[0] = painting.blend[0]
            .blend_enable(true)
            .color_blend_op(op)
            .alpha_blend_op(op);
        gpu.painting(&painting)
    };
    let check = |ops: &[vk::BlendOp], expected: [f32; 4]| {
        let pipelines: Vec<vk::Pipeline> = ops.iter().map(|&op| pipeline(op)).collect();
        let canvas = gpu.canvas(RGBA, 5, 5);
        let pass = Pass {
            colors: &[canvas],
            clears: &[[0.5, 1.0, 0.25, 1.0]],
            ..Pass::default()
        };
        gpu.draw(&pass, |commands| {
            for &pipeline in &pipelines {
                gpu.bind(commands, pipeline);
                gpu.draw_vertices(commands, 3);
            }
        });
        let expected = expected.map(|it| (it * 255.0).round() as u8);
        for color in gpu.colors(&canvas) {
            for (got, want) in color.into_iter().zip(expected) {
                let near = got.abs_diff(want) <= 2;
                assert!(near, "{ops:?}: {color:?} is not {expected:?}");
            }
        }
    };
    check(&[vk::BlendOp::MULTIPLY_EXT], [0.25, 0.25, 0.25, 1.0]);
    check(&[vk::BlendOp::SCREEN_EXT], [0.75, 1.0, 1.0, 1.0]);
    check(&[vk::BlendOp::DIFFERENCE_EXT], [0.0, 0.75, 0.75, 1.0]);
    // The difference, then its exclusion with the same colour: s + d - 2sd.
    let both = [vk::BlendOp::DIFFERENCE_EXT, vk::BlendOp::EXCLUSION_EXT];
    check(&both, [0.5, 0.625, 0.25, 1.0]);
    check(&[vk::BlendOp::DARKEN_EXT], [0.5, 0.25, 0.25, 1.0]);
    let mut properties = vk::PhysicalDeviceBlendOperationAdvancedPropertiesEXT::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut properties);
    // SAFETY: the chain is one structure of an extension that is there.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut all);
    }
    if properties.advanced_blend_all_operations == vk::TRUE {
        check(&[vk::BlendOp::XOR_EXT], [0.0; 4]);
        check(&[vk::BlendOp::GREEN_EXT], [0.5, 0.25, 0.25, 1.0]);
        check(&[vk::BlendOp::MINUS_CLAMPED_EXT], [0.0, 0.75, 0.0, 0.0]);
    }
}

/// Draws whose numbers, and whose number, stand in a buffer.
#[test]
fn indirect_draws_read_their_parameters() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has(
        "multiDrawIndirect",
        gpu.features.multi_draw_indirect == vk::TRUE,
    ) {
        return;
    }
    let vertex = "
        void main() {
            vec2 corner = vec2(gl_VertexIndex & 1, (gl_VertexIndex >> 1) & 1);
            gl_Position = vec4((float(gl_VertexIndex >> 2) + corner.x) * 0.5 - 1.0, corner.y * 2.0 - 1.0, 0.0, 1.0);
        }";
    let mut painting = Painting::new(&gpu, vertex, WHITE, RGBA);
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    let pipeline = gpu.painting(&painting);
    // Columns 0, 2, 3: count, instances, first, first instance; a word of padding.
    let draws = gpu.buffer_with(&[4u32, 1, 0, 0, 7, 4, 1, 8, 0, 7, 4, 1, 12, 0, 7]);
    let count = gpu.buffer_with(&[9u32, 2]);
    let canvas = gpu.canvas(RGBA, 4, 1);
    let pass = Pass::black(&canvas);
    let columns = |record: &dyn Fn(vk::CommandBuffer)| {
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            record(commands);
        });
        gpu.colors(&canvas)
            .into_iter()
            .map(|color| color[0] / 255)
            .collect::<Vec<_>>()
    };
    let (device, draws) = (&gpu.device, draws.handle);
    // SAFETY: the command buffer is being recorded.
    let three = columns(&|it| unsafe { device.cmd_draw_indirect(it, draws, 0, 3, 20) });
    assert_eq!(three, [1, 0, 1, 1]);
    // SAFETY: the command buffer is being recorded.
    let second = columns(&|it| unsafe { device.cmd_draw_indirect(it, draws, 20, 1, 20) });
    assert_eq!(second, [0, 0, 1, 0]);
    if gpu.features12.draw_indirect_count == vk::TRUE {
        let (draw, count) = (device.fp_v1_2().cmd_draw_indirect_count, count.handle);
        // SAFETY: the command buffer is being recorded.
        let two = columns(&|it| unsafe { draw(it, draws, 0, count, 4, 3, 20) });
        assert_eq!(two, [1, 0, 1, 0]);
    }
}

/// Samples that pass, and what the stages did.
#[test]
fn queries_count_samples_and_invocations() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    use vk::QueryPipelineStatisticFlags as Statistic;
    let canvas = gpu.canvas(RGBA, 40, 40);
    let pipeline = gpu.painting(&Painting::new(&gpu, COVER, WHITE, RGBA));
    let samples = gpu.queries(vk::QueryType::OCCLUSION, 3);
    let statistics = vk::QueryPoolCreateInfo::default()
        .query_type(vk::QueryType::PIPELINE_STATISTICS)
        .query_count(1)
        .pipeline_statistics(
            Statistic::INPUT_ASSEMBLY_VERTICES
                | Statistic::INPUT_ASSEMBLY_PRIMITIVES
                | Statistic::FRAGMENT_SHADER_INVOCATIONS,
        );
    let counts_stages = gpu.features.pipeline_statistics_query == vk::TRUE;
    let statistics = counts_stages.then(|| gpu.query_pool(&statistics));
    let precise = match gpu.features.occlusion_query_precise == vk::TRUE {
        true => vk::QueryControlFlags::PRECISE,
        false => vk::QueryControlFlags::empty(),
    };
    gpu.run(|commands| {
        let pass = Pass::black(&canvas);
        // SAFETY: the command buffer is being recorded.
        unsafe {
            let device = &gpu.device;
            device.cmd_reset_query_pool(commands, samples, 0, 3);
            let part = vk::Rect2D::default().extent(vk::Extent2D {
                width: 7,
                height: 3,
            });
            if let Some(pool) = statistics {
                device.cmd_reset_query_pool(commands, pool, 0, 1);
                device.cmd_begin_query(commands, pool, 0, vk::QueryControlFlags::empty());
            }
            gpu.record_pass(commands, &pass, |commands| {
                gpu.bind(commands, pipeline);
                device.cmd_begin_query(commands, samples, 0, precise);
                device.cmd_draw(commands, 3, 2, 0, 0);
                device.cmd_end_query(commands, samples, 0);
                device.cmd_begin_query(commands, samples, 1, precise);
                device.cmd_end_query(commands, samples, 1);
                device.cmd_set_scissor(commands, 0, &[part]);
                device.cmd_begin_query(commands, samples, 2, precise);
                device.cmd_draw(commands, 3, 1, 0, 0);
                device.cmd_end_query(commands, samples, 2);
            });
            if let Some(pool) = statistics {
                device.cmd_end_query(commands, pool, 0);
            }
        }
    });
    let counts: [u64; 3] = gpu.query_results(samples, 0);
    if precise.is_empty() {
        assert_eq!(counts.map(|it| it != 0), [true, false, true]);
    } else {
        assert_eq!(counts, [3200, 0, 21]);
    }
    if let Some(pool) = statistics {
        let [[vertices, primitives, fragments]]: [[u64; 3]; 1] = gpu.query_results(pool, 0);
        assert_eq!((vertices, primitives), (9, 3));
        assert!(fragments >= 3221, "{fragments} invocations");
    }
}

/// Fragments store and count.
#[test]
fn fragments_write_buffers() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has(
        "fragmentStoresAndAtomics",
        gpu.features.fragment_stores_and_atomics == vk::TRUE,
    ) {
        return;
    }
    let fragment = "
        layout(set = 0, binding = 0) buffer Out { uint count; uint of[]; };
        layout(location = 0) out vec4 color;
        void main() {
            atomicAdd(count, 1u);
            of[uint(gl_FragCoord.y) * 19u + uint(gl_FragCoord.x)] += 1u;
            color = vec4(1.0);
        }";
    let buffer = gpu.buffer(4 + 4 * 19 * 19);
    let set = gpu.set_of(&[buffer.into()]);
    let mut painting = Painting::new(&gpu, COVER, fragment, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 19, 19);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_set(commands, painting.layout, set.handle);
        gpu.draw_vertices(commands, 3);
    });
    let words: Vec<u32> = buffer.read();
    assert_eq!(words[0], 361);
    assert!(words[1..].iter().all(|&it| it == 1));
}

/// With one sample, alpha to coverage covers no pixels for alpha 0, all for 1, and no fewer for a
/// larger alpha. The number between is the driver's choice; Tuff covers alpha's share of the
/// pixels.
#[test]
fn alpha_becomes_coverage() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    // A varying alpha, of nine columns, and constant ones.
    let alphas = ["floor(gl_FragCoord.x / 8.0) / 8.0", "0.25", "0.0", "1.0"];
    for alpha in alphas {
        let canvas = gpu.canvas(RGBA, 72, 16);
        let fragment = format!(
            "layout(location = 0) out vec4 color;
            void main() {{ color = vec4(1.0, 0.0, 0.0, {alpha}); }}"
        );
        let mut painting = Painting::new(&gpu, COVER, &fragment, RGBA);
        painting.alpha_to_coverage = true;
        let pipeline = gpu.painting(&painting);
        gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 3));
        let mut counts = [0; 9];
        for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
            counts[index % 72 / 8] += usize::from(color[0] == 255);
        }
        let steps: [usize; 9] = match alpha.parse::<f32>() {
            Ok(alpha) => [(alpha * 8.0) as usize; 9],
            Err(_) => std::array::from_fn(|column| column),
        };
        for (count, step) in counts.into_iter().zip(steps) {
            match step {
                0 => assert_eq!(count, 0, "{alpha}"),
                8 => assert_eq!(count, 128, "{alpha}"),
                _ if gpu.is_tuff() => assert_eq!(count, 16 * step, "{alpha}"),
                _ => {}
            }
        }
        assert!(counts.is_sorted(), "{alpha}: {counts:?}");
    }
}

/// The alpha of a smooth line is the part of each pixel that it covers. It covers pixels inside as
/// a whole, and none far away.
#[test]
fn smooth_lines_fade_at_their_sides() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let is_there = gpu.optional.lines.smooth_lines != 0 && gpu.features.wide_lines != 0;
    if !has("smooth lines", is_there) {
        return;
    }
    // From (2.5, 8.25) to (12.5, 8.25).
    let vertex = "
        void main() {
            float x = gl_VertexIndex == 0 ? 2.5 : 12.5;
            gl_Position = vec4(x / 8.0 - 1.0, 8.25 / 8.0 - 1.0, 0.5, 1.0);
        }";
    let mut mode = vk::PipelineRasterizationLineStateCreateInfoKHR::default()
        .line_rasterization_mode(vk::LineRasterizationModeKHR::RECTANGULAR_SMOOTH);
    let mut painting = Painting::new(&gpu, vertex, WHITE, RGBA);
    painting.topology = vk::PrimitiveTopology::LINE_LIST;
    painting.rasterization = painting.rasterization.line_width(3.0).push_next(&mut mode);
    let pipeline = gpu.painting(&painting);
    let canvas = gpu.canvas(RGBA, 16, 16);
    gpu.paint(&canvas, pipeline, |commands| gpu.draw_vertices(commands, 2));
    for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let [x, y] = [index % 16, index / 16].map(|at| at as f32);
        let overlap = |at: f32, from: f32, to: f32| ((at + 1.0).min(to) - at.max(from)).max(0.0);
        let area = overlap(x, 2.5, 12.5) * overlap(y, 6.75, 9.75);
        let wanted = (area * 255.0).round() as u8;
        let is_near = (0.5..14.5).contains(&x) && (4.5..11.5).contains(&y);
        if gpu.is_tuff() || area == 1.0 || !is_near {
            let is_same = color[3].abs_diff(wanted) <= 1;
            assert!(is_same, "pixel {x}, {y}: {color:?}, and {area} of it");
        }
    }
}

/// The bias by the slope shows in `FragCoord`, with a depth attachment and without.
#[test]
fn depths_are_biased_without_an_attachment() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    // Depths from 0.25 on, 1/32 a pixel.
    let vertex = "
        void main() {
            vec2 at = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
            gl_Position = vec4(at, 0.25 + (at.x + 1.0) / 8.0, 1.0);
        }";
    let fragment = "
        layout(location = 0) out float depth;
        void main() { depth = gl_FragCoord.z; }";
    let format = vk::Format::R32_SFLOAT;
    let canvas = gpu.canvas(format, 8, 1);
    let depth = gpu.canvas(vk::Format::D32_SFLOAT, 8, 1);
    for depth in [None, Some(depth)] {
        let mut painting = Painting::new(&gpu, vertex, fragment, format);
        painting.rasterization = painting
            .rasterization
            .depth_bias_enable(true)
            .depth_bias_slope_factor(2.0);
        painting.depth = depth.map_or(vk::Format::UNDEFINED, |it| it.format);
        let pipeline = gpu.painting(&painting);
        let pass = Pass {
            depth,
            ..Pass::black(&canvas)
        };
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 3);
        });
        for (x, bytes) in gpu.colors(&canvas).into_iter().enumerate() {
            let expected = 0.25 + (x as f32 + 0.5) / 32.0 + 2.0 / 32.0;
            let found = f32::from_le_bytes(bytes);
            assert!(
                (found - expected).abs() < 1e-4,
                "{x}: {found}, not {expected}"
            );
        }
    }
}
