//! Transform feedback: what is captured and where, in which order, counters, streams, queries.

use ash::ext;
use tuff_tests::*;
use vk::PrimitiveTopology as Topology;

/// Captures the index of each vertex.
const INDEX: &str = "
    layout(location = 0, xfb_buffer = 0, xfb_stride = 4, xfb_offset = 0) flat out uint index;
    void main() { index = gl_VertexIndex; gl_Position = vec4(0.0, 0.0, 0.5, 1.0); gl_PointSize = 1.0; }";

const BLANK: u32 = 0xDEAD_BEEF;

/// A buffer to capture to, with its offset and size.
type Target<'a> = (&'a Buffer, u64, u64);

struct Capturing {
    gpu: Gpu,
    commands: ext::transform_feedback::Device,
}

impl Capturing {
    fn new() -> Option<Self> {
        Self::on(Gpu::new())
    }

    fn on(gpu: Gpu) -> Option<Self> {
        let gpu = gpu.drawing()?.with("transform feedback", |gpu| {
            gpu.optional.transform_feedback.transform_feedback == vk::TRUE
        })?;
        let commands = ext::transform_feedback::Device::new(&gpu.instance, &gpu.device);
        Some(Self { gpu, commands })
    }

    fn with_streams() -> Option<Self> {
        let Self { gpu, commands } = Self::new()?;
        let gpu = gpu.with("geometry streams", |gpu| {
            gpu.features.geometry_shader == vk::TRUE
                && gpu.optional.transform_feedback.geometry_streams == vk::TRUE
        })?;
        Some(Self { gpu, commands })
    }

    /// A pipeline that draws nothing.
    fn pipeline(&self, vertex: &str, geometry: Option<&str>, topology: Topology) -> vk::Pipeline {
        let mut painting = Painting::new(&self.gpu, vertex, WHITE, RGBA);
        painting.geometry = geometry;
        painting.topology = topology;
        painting.fragment = None;
        painting.rasterization = painting.rasterization.rasterizer_discard_enable(true);
        self.gpu.painting(&painting)
    }

    fn blank(&self, words: usize) -> Buffer {
        self.gpu.buffer_with(&vec![BLANK; words])
    }

    fn bind(&self, commands: vk::CommandBuffer, first: u32, targets: &[Target<'_>]) {
        let buffers: Vec<_> = targets.iter().map(|it| it.0.handle).collect();
        let offsets: Vec<_> = targets.iter().map(|it| it.1).collect();
        let sizes: Vec<_> = targets.iter().map(|it| it.2).collect();
        // SAFETY: the command buffer is being recorded, and the slices have equal lengths.
        unsafe {
            (self.commands.fp().cmd_bind_transform_feedback_buffers_ext)(
                commands,
                first,
                targets.len() as u32,
                buffers.as_ptr(),
                offsets.as_ptr(),
                sizes.as_ptr(),
            );
        }
    }

    /// Records commands during transform feedback, with a counter for each of the first buffers.
    fn capture(
        &self,
        commands: vk::CommandBuffer,
        counters: &[(&Buffer, u64)],
        record: impl FnOnce(),
    ) {
        let buffers: Vec<_> = counters.iter().map(|it| it.0.handle).collect();
        let offsets: Vec<_> = counters.iter().map(|it| it.1).collect();
        let count = counters.len() as u32;
        // SAFETY: the command buffer is being recorded.
        unsafe {
            (self.commands.fp().cmd_begin_transform_feedback_ext)(
                commands,
                0,
                count,
                buffers.as_ptr(),
                offsets.as_ptr(),
            );
        }
        record();
        // SAFETY: the command buffer is being recorded.
        unsafe {
            (self.commands.fp().cmd_end_transform_feedback_ext)(
                commands,
                0,
                count,
                buffers.as_ptr(),
                offsets.as_ptr(),
            );
        }
    }

    /// Runs a pass without a trace in its attachment.
    fn pass(&self, record: impl FnOnce(vk::CommandBuffer)) {
        let canvas = self.gpu.canvas(RGBA, 4, 4);
        self.gpu.run(|commands| {
            self.gpu
                .record_pass(commands, &Pass::black(&canvas), record);
        });
    }

    fn use_pipeline(&self, commands: vk::CommandBuffer, pipeline: vk::Pipeline) {
        let point = vk::PipelineBindPoint::GRAPHICS;
        // SAFETY: the command buffer is being recorded.
        unsafe { self.gpu.device.cmd_bind_pipeline(commands, point, pipeline) };
    }

    fn draw(&self, commands: vk::CommandBuffer, vertices: u32, instances: u32) {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.gpu
                .device
                .cmd_draw(commands, vertices, instances, 0, 0)
        };
    }

    /// The words that so many vertices of a topology leave.
    fn captured(&self, pipeline: vk::Pipeline, vertices: u32, words: usize) -> Vec<u32> {
        let buffer = self.blank(words + 1);
        self.pass(|commands| {
            self.use_pipeline(commands, pipeline);
            self.bind(commands, 0, &[(&buffer, 0, buffer.size_bytes)]);
            self.capture(commands, &[], || self.draw(commands, vertices, 1));
        });
        let mut all: Vec<u32> = buffer.read();
        assert_eq!(all.pop(), Some(BLANK));
        all
    }
}

/// Strips and fans become primitives of their own, as section "Primitive Topologies" lists them;
/// vertices that are only adjacent are left out.
#[test]
fn topologies_become_separate_primitives() {
    let Some(it) = Capturing::new() else { return };
    let mut cases: Vec<(_, _, &[u32])> = vec![
        (Topology::POINT_LIST, 3, &[0, 1, 2]),
        (Topology::LINE_LIST, 5, &[0, 1, 2, 3]),
        (Topology::LINE_STRIP, 4, &[0, 1, 1, 2, 2, 3]),
        (Topology::TRIANGLE_LIST, 7, &[0, 1, 2, 3, 4, 5]),
        (Topology::TRIANGLE_STRIP, 5, &[0, 1, 2, 1, 3, 2, 2, 3, 4]),
        (Topology::TRIANGLE_FAN, 5, &[1, 2, 0, 2, 3, 0, 3, 4, 0]),
    ];
    if it.gpu.features.geometry_shader == vk::TRUE {
        cases.extend([
            (Topology::LINE_LIST_WITH_ADJACENCY, 8, &[1, 2, 5, 6][..]),
            (Topology::LINE_STRIP_WITH_ADJACENCY, 5, &[1, 2, 2, 3]),
            (
                Topology::TRIANGLE_LIST_WITH_ADJACENCY,
                12,
                &[0, 2, 4, 6, 8, 10],
            ),
            (
                Topology::TRIANGLE_STRIP_WITH_ADJACENCY,
                8,
                &[0, 2, 4, 2, 6, 4],
            ),
        ]);
    }
    for (topology, vertices, expected) in cases {
        let pipeline = it.pipeline(INDEX, None, topology);
        let words = it.captured(pipeline, vertices, expected.len());
        assert_eq!(words, expected, "{topology:?}");
    }
}

/// With the last vertex as the provoking one, each triangle ends with it.
#[test]
fn the_provoking_vertex_is_kept() {
    let Some(it) = Capturing::new() else { return };
    let features = it.gpu.optional.provoking_vertex;
    if features.provoking_vertex_last != vk::TRUE
        || features.transform_feedback_preserves_provoking_vertex != vk::TRUE
    {
        return;
    }
    let mut mode = vk::PipelineRasterizationProvokingVertexStateCreateInfoEXT::default()
        .provoking_vertex_mode(vk::ProvokingVertexModeEXT::LAST_VERTEX);
    let mut painting = Painting::new(&it.gpu, INDEX, WHITE, RGBA);
    painting.topology = Topology::TRIANGLE_STRIP;
    painting.fragment = None;
    painting.rasterization = (painting.rasterization)
        .rasterizer_discard_enable(true)
        .push_next(&mut mode);
    let pipeline = it.gpu.painting(&painting);
    let words = it.captured(pipeline, 5, 9);
    let provoking: Vec<_> = words.chunks(3).map(|triangle| triangle[2]).collect();
    assert_eq!(provoking, [2, 3, 4]);
    for (first, triangle) in (0..).zip(words.chunks(3)) {
        let mut sorted = triangle.to_vec();
        sorted.sort_unstable();
        assert_eq!(sorted, [first, first + 1, first + 2]);
    }
}

/// Many primitives, in order of instance and primitive, whichever threads shade them.
#[test]
fn primitives_stay_in_order() {
    let Some(it) = Capturing::new() else { return };
    const VERTICES: u32 = 30_000;
    let vertex = "
        layout(location = 0, xfb_buffer = 0, xfb_stride = 8, xfb_offset = 4) flat out uint place;
        void main() { place = gl_InstanceIndex * 30000 + gl_VertexIndex; gl_Position = vec4(0.0); }";
    let pipeline = it.pipeline(vertex, None, Topology::TRIANGLE_LIST);
    let buffer = it.blank(4 * VERTICES as usize);
    it.pass(|commands| {
        it.use_pipeline(commands, pipeline);
        it.bind(commands, 0, &[(&buffer, 0, buffer.size_bytes)]);
        it.capture(commands, &[], || it.draw(commands, VERTICES, 2));
    });
    let words: Vec<u32> = buffer.read();
    for (place, pair) in (0..).zip(words.chunks(2)) {
        assert_eq!(pair, [BLANK, place]);
    }
}

/// Built-ins, distances, arrays, matrices, doubles and members of blocks, at their offsets; other
/// bytes stay as they are.
#[test]
fn outputs_lie_at_their_offsets() {
    let Some(it) = Capturing::new() else { return };
    let vertex = "
        layout(xfb_buffer = 0, xfb_stride = 48) out;
        layout(xfb_buffer = 1, xfb_stride = 40) out;
        layout(xfb_buffer = 0) out gl_PerVertex {
            layout(xfb_offset = 4) vec4 gl_Position;
            layout(xfb_offset = 20) float gl_PointSize;
            layout(xfb_offset = 28) float gl_ClipDistance[2];
        };
        layout(location = 1, component = 1, xfb_buffer = 1, xfb_offset = 0) out vec2 v[2];
        layout(location = 4, xfb_buffer = 1, xfb_offset = 20) out mat2 m;
        layout(location = 8, xfb_buffer = 0) out Block {
            float before; layout(xfb_offset = 40) flat ivec2 kept; float after;
        };
        void main() {
            gl_Position = vec4(1.0, 2.0, 3.0, 4.0); gl_PointSize = 5.0;
            gl_ClipDistance[0] = 6.0; gl_ClipDistance[1] = 0.0;
            v[0] = vec2(8.0, 9.0); v[1] = vec2(10.0, 11.0); m = mat2(12.0, 13.0, 14.0, 15.0);
            before = 1.0; kept = ivec2(gl_VertexIndex, -1); after = 2.0;
        }";
    let pipeline = it.pipeline(vertex, None, Topology::POINT_LIST);
    let (one, two) = (it.blank(24), it.blank(20));
    it.pass(|commands| {
        it.use_pipeline(commands, pipeline);
        it.bind(commands, 0, &[(&one, 0, 96), (&two, 0, 80)]);
        it.capture(commands, &[], || it.draw(commands, 2, 1));
    });
    let floats = |values: &[f32]| values.iter().map(|it| it.to_bits()).collect::<Vec<_>>();
    let (one, two): (Vec<u32>, Vec<u32>) = (one.read(), two.read());
    for vertex in 0..2 {
        let here = &one[12 * vertex..][..12];
        let mut expected = vec![BLANK];
        expected.extend(floats(&[1.0, 2.0, 3.0, 4.0, 5.0]));
        expected.push(BLANK);
        expected.extend(floats(&[6.0, 0.0]));
        expected.extend([BLANK, vertex as u32, u32::MAX]);
        assert_eq!(here, expected);
        let mut expected = floats(&[8.0, 9.0, 10.0, 11.0]);
        expected.push(BLANK);
        expected.extend(floats(&[12.0, 13.0, 14.0, 15.0]));
        expected.push(BLANK);
        assert_eq!(two[10 * vertex..][..10], expected);
    }
}

/// Only whole primitives are written, and only inside the bound range; the counter and the query
/// count exactly.
#[test]
fn a_full_buffer_takes_whole_primitives_alone() {
    let Some(it) = Capturing::new() else { return };
    let pipeline = it.pipeline(INDEX, None, Topology::TRIANGLE_LIST);
    let buffer = it.blank(32);
    let counter = it.blank(2);
    let ty = vk::QueryType::TRANSFORM_FEEDBACK_STREAM_EXT;
    let pool = it.gpu.queries(ty, 1);
    let canvas = it.gpu.canvas(RGBA, 4, 4);
    it.gpu.run(|commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            it.gpu.device.cmd_reset_query_pool(commands, pool, 0, 1);
            it.gpu
                .device
                .cmd_fill_buffer(commands, counter.handle, 4, 4, 0);
        }
        it.gpu.barrier(commands);
        it.gpu
            .record_pass(commands, &Pass::black(&canvas), |commands| {
                it.use_pipeline(commands, pipeline);
                // Room for seven triangles and two vertices.
                it.bind(commands, 0, &[(&buffer, 8, 4 * 23)]);
                // SAFETY: the command buffer is being recorded.
                unsafe {
                    let flags = vk::QueryControlFlags::empty();
                    (it.commands.fp().cmd_begin_query_indexed_ext)(commands, pool, 0, flags, 0);
                }
                it.capture(commands, &[(&counter, 4)], || it.draw(commands, 30, 1));
                // SAFETY: the command buffer is being recorded.
                unsafe { (it.commands.fp().cmd_end_query_indexed_ext)(commands, pool, 0, 0) };
            });
    });
    let mut expected = vec![BLANK; 32];
    for vertex in 0..21 {
        expected[2 + vertex] = vertex as u32;
    }
    assert_eq!(buffer.read::<u32>(), expected);
    assert_eq!(counter.read::<u32>(), [BLANK, 84]);
    let mut results = [[0u64; 2]; 1];
    let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
    // SAFETY: the pool is of this device.
    unsafe { (it.gpu.device).get_query_pool_results(pool, 0, &mut results, flags) }
        .expect("vkGetQueryPoolResults");
    assert_eq!(results, [[7, 10]]);
}

/// Transform feedback that was ended goes on where its counter says, and a draw takes its number of
/// vertices from there.
#[test]
fn captures_go_on_from_counters() {
    let Some(it) = Capturing::new() else { return };
    let pipeline = it.pipeline(INDEX, None, Topology::POINT_LIST);
    let (buffer, counter, again) = (it.blank(8), it.gpu.buffer(4), it.blank(8));
    let canvas = it.gpu.canvas(RGBA, 4, 4);
    it.gpu.run(|commands| {
        let pass = Pass::black(&canvas);
        it.gpu.record_pass(commands, &pass, |commands| {
            it.use_pipeline(commands, pipeline);
            it.bind(commands, 0, &[(&buffer, 0, 32)]);
            it.capture(commands, &[(&counter, 0)], || it.draw(commands, 2, 1));
            it.draw(commands, 4, 1);
        });
        it.gpu.barrier(commands);
        it.gpu.record_pass(commands, &pass, |commands| {
            it.bind(commands, 0, &[(&buffer, 0, 32)]);
            it.capture(commands, &[(&counter, 0)], || it.draw(commands, 3, 1));
        });
        it.gpu.barrier(commands);
        it.gpu.record_pass(commands, &pass, |commands| {
            it.bind(commands, 0, &[(&again, 0, 32)]);
            it.capture(commands, &[], || {
                // SAFETY: the command buffer is being recorded.
                unsafe {
                    let from = counter.handle;
                    (it.commands.fp().cmd_draw_indirect_byte_count_ext)(
                        commands, 1, 0, from, 0, 4, 4,
                    );
                }
            });
        });
    });
    assert_eq!(buffer.read::<u32>(), [0, 1, 0, 1, 2, BLANK, BLANK, BLANK]);
    assert_eq!(counter.read::<u32>(), [20]);
    assert_eq!(again.read::<u32>()[..5], [0, 1, 2, 3, BLANK]);
}

/// A geometry shader whose stream 0 is drawn, and whose streams are captured to their own buffers.
const STREAMS: &str = "
    layout(points) in; layout(points, max_vertices = 8) out;
    layout(location = 0) flat in uint index[];
    layout(location = 0, stream = 0, xfb_buffer = 0, xfb_stride = 4, xfb_offset = 0) out uint a;
    layout(location = 1, stream = 1, xfb_buffer = 1, xfb_stride = 8, xfb_offset = 4) out uint b;
    void main() {
        for (uint i = 0; i < index[0]; i++) {
            b = 100 * index[0] + i;
            EmitStreamVertex(1); EndStreamPrimitive(1);
        }
        a = index[0]; gl_Position = vec4(0.0, 0.0, 0.5, 1.0); gl_PointSize = 1.0;
        EmitStreamVertex(0); EndStreamPrimitive(0);
    }";

/// Hands its index on, and captures nothing.
const PLAIN: &str = "
    layout(location = 0) flat out uint index;
    void main() { index = gl_VertexIndex; gl_Position = vec4(0.0); }";

#[test]
fn streams_go_to_their_own_buffers() {
    let Some(it) = Capturing::with_streams() else {
        return;
    };
    let pipeline = it.pipeline(PLAIN, Some(STREAMS), Topology::POINT_LIST);
    let (one, two) = (it.blank(8), it.blank(20));
    let generated = it.gpu.optional.primitives_generated;
    let counts = generated.primitives_generated_query_with_non_zero_streams == vk::TRUE
        && generated.primitives_generated_query_with_rasterizer_discard == vk::TRUE;
    let ty = match counts {
        true => vk::QueryType::PRIMITIVES_GENERATED_EXT,
        false => vk::QueryType::OCCLUSION,
    };
    let pool = it.gpu.queries(ty, 1);
    let canvas = it.gpu.canvas(RGBA, 4, 4);
    it.gpu.run(|commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe { it.gpu.device.cmd_reset_query_pool(commands, pool, 0, 1) };
        it.gpu
            .record_pass(commands, &Pass::black(&canvas), |commands| {
                it.use_pipeline(commands, pipeline);
                it.bind(commands, 0, &[(&one, 0, 32), (&two, 0, 80)]);
                if counts {
                    let flags = vk::QueryControlFlags::empty();
                    // SAFETY: the command buffer is being recorded.
                    unsafe {
                        (it.commands.fp().cmd_begin_query_indexed_ext)(commands, pool, 0, flags, 1)
                    };
                }
                it.capture(commands, &[], || it.draw(commands, 4, 1));
                if counts {
                    // SAFETY: the command buffer is being recorded.
                    unsafe { (it.commands.fp().cmd_end_query_indexed_ext)(commands, pool, 0, 1) };
                }
            });
    });
    assert_eq!(one.read::<u32>()[..5], [0, 1, 2, 3, BLANK]);
    let two: Vec<u32> = two.read();
    let expected = [100, 200, 201, 300, 301, 302];
    for (pair, expected) in two.chunks(2).zip(expected) {
        assert_eq!(pair, [BLANK, expected]);
    }
    assert_eq!(two[12..], [BLANK; 8]);
    if counts {
        let [count]: [u64; 1] = it.gpu.query_results(pool, 0);
        assert_eq!(count, 6);
    }
}

/// A pipeline without the mode captures nothing, nor does one that is drawn without transform
/// feedback; generated primitives count all the same.
#[test]
fn primitives_count_without_capture() {
    let Some(it) = Capturing::new() else { return };
    if it
        .gpu
        .optional
        .primitives_generated
        .primitives_generated_query
        != vk::TRUE
    {
        return;
    }
    let mut painting = Painting::new(&it.gpu, COVER, WHITE, RGBA);
    painting.topology = Topology::TRIANGLE_STRIP;
    let pipeline = it.gpu.painting(&painting);
    let canvas = it.gpu.canvas(RGBA, 4, 4);
    let count = it
        .gpu
        .query(vk::QueryType::PRIMITIVES_GENERATED_EXT, |commands, pool| {
            it.gpu
                .record_pass(commands, &Pass::black(&canvas), |commands| {
                    it.use_pipeline(commands, pipeline);
                    // SAFETY: the command buffer is being recorded.
                    unsafe {
                        let flags = vk::QueryControlFlags::empty();
                        it.gpu.device.cmd_begin_query(commands, pool, 0, flags);
                        it.gpu.device.cmd_draw(commands, 3000, 2, 0, 0);
                        it.gpu.device.cmd_end_query(commands, pool, 0);
                    }
                });
        });
    assert_eq!(count, 2 * 2998);
}

/// Bad usage, which validation would refuse: buffers that are missing, ranges without room for a
/// vertex, counters past the end of their buffers and of what was captured. Nothing outside is
/// written, and the device goes on.
#[test]
fn short_and_missing_buffers_take_nothing() {
    let Some(it) = Capturing::on(Gpu::without_validation()) else {
        return;
    };
    // Other drivers need not survive it.
    if !it.gpu.is_tuff() {
        return;
    }
    let pipeline = it.pipeline(INDEX, None, Topology::TRIANGLE_LIST);
    let (buffer, counter) = (it.blank(8), it.gpu.buffer_with(&[1u32 << 30, 12]));
    let missing = vk::Buffer::null();
    it.pass(|commands| {
        it.use_pipeline(commands, pipeline);
        // No buffer was ever bound.
        it.capture(commands, &[(&counter, 8)], || it.draw(commands, 6, 1));
        it.bind(commands, 0, &[(&buffer, 4, 8)]);
        it.capture(commands, &[(&counter, 6)], || it.draw(commands, 6, 1));
        it.bind(commands, 3, &[(&buffer, 0, 32), (&buffer, 0, 32)]);
        it.bind(commands, 0, &[(&buffer, 64, vk::WHOLE_SIZE)]);
        it.capture(commands, &[], || it.draw(commands, 6, 1));
        it.bind(commands, 0, &[(&buffer, 0, 32)]);
        it.capture(commands, &[(&counter, 0)], || it.draw(commands, 6, 1));
        let draw = it.commands.fp().cmd_draw_indirect_byte_count_ext;
        // SAFETY: the command buffer is being recorded.
        unsafe {
            draw(commands, 1, 0, missing, 0, 0, 4);
            draw(commands, 1, 0, counter.handle, 8, 0, 4);
            draw(commands, 1, 0, counter.handle, 4, 0, 0);
            draw(commands, 1, 0, counter.handle, 4, 13, 4);
            (it.commands.fp().cmd_end_transform_feedback_ext)(
                commands,
                0,
                1,
                &counter.handle,
                std::ptr::null(),
            );
        }
    });
    assert_eq!(buffer.read::<u32>(), [BLANK; 8]);
    assert_eq!(counter.read::<u32>(), [1 << 30, 12]);
    let words = it.captured(pipeline, 3, 3);
    assert_eq!(words, [0, 1, 2]);
}
