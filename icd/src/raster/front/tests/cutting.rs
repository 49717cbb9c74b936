//! From draws to chunks: segments, numbers, attributes, rounds, threads.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ash::vk::{self, PrimitiveTopology as Topology};
use smallvec::smallvec;
use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::ir::text::parse_module;
use spirv_jit::reach::{Range, Reach};

use super::super::topology;
use super::*;
use crate::command::graphics::DrawCall;
use crate::object::graphics_state::{MAX_VERTEX_INPUTS, VertexAttribute, VertexBinding};
use crate::raster::front::{FrontEnd, Rounds};
use crate::raster::{Context, Draw, IndexBuffer, Stages, Targets, VertexBuffer, Work};
use crate::wave::{Budget, Limits, Stopped, Workers};

/// Passes an attribute on as the position, then `VertexIndex`, `InstanceIndex`, `DrawIndex`,
/// `ViewIndex`, and an attribute's word.
const PASS_ON: &str = "
    module vertex
    inputs attribute.0.0, attribute.0.1, attribute.0.2, attribute.0.3, vertex_index.0, instance_index.0, draw_index.0, view_index.0, attribute.1.0
    output_rows 9
    outputs position.0, position.1, position.2, position.3, location.0.0.0, location.0.1.0, location.0.2.0, location.0.3.0, location.1.0.0
    func f0 {
        v0: i32 = input[0]
        v1: i32 = input[1]
        v2: i32 = input[2]
        v3: i32 = input[3]
        v4: i32 = input[4]
        v5: i32 = input[5]
        v6: i32 = input[6]
        v7: i32 = input[7]
        v8: i32 = input[8]
        end(v0, v1, v2, v3, v4, v5, v6, v7, v8)
    }";

/// Words a vertex.
const WORDS: usize = 9;

/// Positions of vertices: all on the screen, none of the same place.
fn positions(count: usize) -> Vec<[f32; 4]> {
    let mut random = Random::with_seed(50);
    (0..count)
        .map(|_| [random.f64() as f32, random.f64() as f32, 0.5, 1.0])
        .collect()
}

fn reach_of(buffers: &[(u64, usize)]) -> Reach {
    Reach::new(
        buffers
            .iter()
            .map(|&(start, size)| Range {
                start,
                size_bytes: size as u64,
            })
            .collect(),
    )
}

fn draw(state: GraphicsState, positions: &[[f32; 4]], calls: &[DrawCall]) -> Draw {
    let mut state = state;
    state.vertex_input.bindings.push(VertexBinding {
        binding: 0,
        stride_bytes: 16,
        per_instance: false,
        divisor: 1,
    });
    state.vertex_input.attributes.push(VertexAttribute {
        location: 0,
        binding: 0,
        format: vk::Format::R32G32B32A32_SFLOAT,
        offset_bytes: 0,
    });
    let mut buffers = [VertexBuffer::default(); MAX_VERTEX_INPUTS];
    buffers[0] = VertexBuffer {
        address: positions.as_ptr() as u64,
        size_bytes: size_of_val(positions) as u64,
        stride_bytes: None,
    };
    let program = Program::new(&parse_module(PASS_ON).unwrap()).unwrap();
    Draw {
        stages: Arc::new(Stages::from_iter([Arc::new(program)])),
        state: Arc::new(state),
        environment: Arc::new(Environment::unbound()),
        keep: Arc::new(()),
        vertex_buffers: Arc::new(buffers),
        indices: None,
        calls: calls.iter().copied().collect(),
        counters: smallvec![Arc::default()],
        feedback: None,
    }
}

fn call(count: u32, instances: u32) -> DrawCall {
    DrawCall {
        first: 0,
        count,
        vertex_offset: 0,
        first_instance: 0,
        instances,
        draw_index: 0,
        groups: [0; 3],
    }
}

fn targets(view_mask: u32) -> Targets {
    Targets {
        clamps_to_one: false,
        area: area(),
        layers: 8,
        view_mask,
        samples: 1,
        colors: [None; 8],
        depth: None,
        stencil: None,
        rates: None,
    }
}

/// All chunks of a batch, in order.
fn chunks(
    work: &[Work],
    targets: &Targets,
    reach: &Reach,
    threads: usize,
    limits: &Limits,
) -> Result<Vec<Chunk>, Stopped> {
    let workers = Workers::new(threads);
    let context = Context {
        workers: &workers,
        limits,
        reach,
        counts: None,
    };
    let front = FrontEnd::default();
    let mut rounds = Rounds::new(targets, threads);
    let mut all = Vec::new();
    while let Some(chunks) = front.next_round(context, targets, work, &mut rounds)? {
        all.extend(chunks);
    }
    Ok(all)
}

/// The contents of a primitive: its number, its vertices' indices, instance, view, and its
/// provoking vertex.
type PrimitiveContents = (u32, [u32; 3], u32, u32, u8);

fn made(chunks: &[Chunk]) -> Vec<PrimitiveContents> {
    chunks
        .iter()
        .flat_map(|chunk| {
            chunk.records.iter().map(|record| {
                let word = |vertex: u32, word: usize| {
                    assert_eq!(vertex as usize % WORDS, 0);
                    chunk.outputs[vertex as usize + word]
                };
                let first = record.vertices[0];
                (
                    record.primitive_id,
                    record.vertices.map(|vertex| word(vertex, 4)),
                    word(first, 5),
                    word(first, 7),
                    record.provoking,
                )
            })
        })
        .collect()
}

/// The primitives that the specification requires, segment after segment of the index stream.
fn expected(
    topology: Topology,
    indices: &[u32],
    restart: Option<u32>,
    instances: u32,
) -> Vec<PrimitiveContents> {
    let mut all = Vec::new();
    for instance in 0..instances {
        let mut id = 0;
        let segments: Vec<&[u32]> = match restart {
            Some(restart) => indices.split(|index| *index == restart).collect(),
            None => vec![indices],
        };
        for segment in segments {
            for primitive in 0..topology::count(topology, segment.len() as u32) {
                let vertices = topology::vertices(topology, primitive, false);
                all.push((
                    id,
                    vertices.map(|vertex| segment[vertex as usize]),
                    instance,
                    0,
                    0,
                ));
                id += 1;
            }
        }
    }
    all
}

/// No triangle of these is empty but by chance, and points are all drawn.
fn is_degenerate(positions: &[[f32; 4]], vertices: [u32; 3]) -> bool {
    let [a, b, c] = vertices.map(|index| positions[index as usize]);
    let snap = |p: [f32; 4]| {
        [0, 1].map(|axis| ((f64::from(p[axis]) + 1.0) * 32.0 * 256.0).round_ties_even() as i64)
    };
    let [a, b, c] = [snap(a), snap(b), snap(c)];
    (b[0] - a[0]) * (c[1] - a[1]) == (c[0] - a[0]) * (b[1] - a[1])
}

#[test]
fn restarts_cut_segments_and_numbers_go_on() {
    let mut random = Random::with_seed(51);
    let positions = positions(250);
    for round in 0..12 {
        let topology = [
            Topology::TRIANGLE_STRIP,
            Topology::TRIANGLE_FAN,
            Topology::TRIANGLE_LIST,
            Topology::POINT_LIST,
        ][round % 4];
        let wide = round % 3;
        let custom = (round % 8 > 3).then_some(17);
        let restart = custom.unwrap_or([0xFF, 0xFFFF, u32::MAX][wide]);
        let length = if round < 4 { 60 } else { 9000 };
        let indices: Vec<u32> = (0..length)
            .map(
                |_| match random.u64(..if round % 2 == 0 { 9 } else { 900 }) {
                    0 => restart,
                    _ => random.u64(..250) as u32,
                },
            )
            .collect();
        let bytes: Vec<u8> = indices
            .iter()
            .flat_map(|index| index.to_le_bytes().into_iter().take(1 << wide))
            .collect();
        // Points: what covers no pixel has no record, so all triangles of the expectation that do
        // are looked for.
        let mut state = state();
        state.topology = topology;
        state.primitive_restart = true;
        let mut draw = draw(state, &positions, &[call(length, 2)]);
        draw.indices = Some(IndexBuffer {
            address: bytes.as_ptr() as u64,
            size_bytes: bytes.len() as u64,
            ty: [
                vk::IndexType::UINT8_KHR,
                vk::IndexType::UINT16,
                vk::IndexType::UINT32,
            ][wide],
            restart: custom,
        });
        let counters = Arc::clone(&draw.counters[0]);
        let reach = reach_of(&[
            (positions.as_ptr() as u64, size_of_val(&*positions)),
            (bytes.as_ptr() as u64, bytes.len()),
        ]);
        let chunks = chunks(
            &[Work::Draw(draw)],
            &targets(0),
            &reach,
            2,
            &Limits::default(),
        )
        .unwrap();
        let got = made(&chunks);
        let want = expected(topology, &indices, Some(restart), 2);
        assert_eq!(
            counters.input_primitives.load(Ordering::Relaxed),
            want.len() as u64
        );
        // All that has a record, in order; what has none is empty or between samples.
        let mut rest = want.iter();
        for made in &got {
            assert!(rest.any(|want| want == made), "{made:?}");
        }
        if topology == Topology::POINT_LIST {
            assert_eq!(got.len(), want.len());
        } else {
            let large = want
                .iter()
                .filter(|want| !is_degenerate(&positions, want.1));
            assert!(got.len() * 10 >= large.count() * 9);
        }
        for chunk in &chunks {
            assert!(chunk.records.len() <= crate::raster::CHUNK_PRIMITIVES);
        }
    }
}

#[test]
fn vertices_are_shaded_once() {
    let positions = positions(64);
    let indices: Vec<u16> = (0..600).map(|i| (i * 7 % 64) as u16).collect();
    let mut draw = draw(state(), &positions, &[call(600, 3)]);
    draw.indices = Some(IndexBuffer {
        address: indices.as_ptr() as u64,
        size_bytes: 1200,
        ty: vk::IndexType::UINT16,
        restart: None,
    });
    let counters = Arc::clone(&draw.counters[0]);
    let reach = Reach::everywhere();
    let chunks = chunks(
        &[Work::Draw(draw)],
        &targets(0b101),
        &reach,
        1,
        &Limits::default(),
    )
    .unwrap();
    // Of each instance in each view once, as all of it is one chunk or two.
    let invocations = counters.vertex_invocations.load(Ordering::Relaxed);
    assert!((64 * 6..64 * 8).contains(&invocations), "{invocations}");
    let views: Vec<u32> = made(&chunks).iter().map(|made| made.3).collect();
    assert!(views.contains(&0) && views.contains(&2) && !views.contains(&1));
    for chunk in &chunks {
        for record in &chunk.records {
            assert_eq!(record.layer, u16::from(record.view_index));
        }
    }
}

#[test]
fn what_lies_past_buffers_reads_as_zero() {
    let positions = positions(8);
    // Past the index buffer, index 0; past the vertex buffer, position (0, 0, 0, 0), which is
    // nowhere.
    let indices: Vec<u32> = vec![1, 2, 3, 100, 4, 5];
    let mut state = state();
    state.topology = Topology::POINT_LIST;
    let mut draw = draw(state, &positions, &[call(12, 1)]);
    draw.indices = Some(IndexBuffer {
        address: indices.as_ptr() as u64,
        size_bytes: 24,
        ty: vk::IndexType::UINT32,
        restart: None,
    });
    let all = chunks(
        &[Work::Draw(draw)],
        &targets(0),
        &Reach::everywhere(),
        1,
        &Limits::default(),
    )
    .unwrap();
    let indices: Vec<u32> = made(&all).iter().map(|made| made.1[0]).collect();
    assert_eq!(indices, [1, 2, 3, 4, 5, 0, 0, 0, 0, 0, 0]);
    // Nothing is there at all.
    let draw = self::draw(
        GraphicsState { ..super::state() },
        &positions,
        &[call(12, 1)],
    );
    let all = chunks(
        &[Work::Draw(draw)],
        &targets(0),
        &Reach::default(),
        1,
        &Limits::default(),
    )
    .unwrap();
    assert!(made(&all).is_empty());
    assert!(all[0].outputs.chunks(WORDS).all(|it| it[..4] == [0; 4]));
}

#[test]
fn instances_advance_by_their_divisor() {
    let positions = positions(3);
    let values: Vec<u32> = (100..120).collect();
    for (divisor, expected) in [
        (1, [102, 103, 104, 105]),
        (2, [102, 102, 103, 103]),
        (0, [102, 102, 102, 102]),
        (3, [102, 102, 102, 103]),
    ] {
        let mut state = state();
        state.topology = Topology::POINT_LIST;
        let input = &mut state.vertex_input;
        input.bindings.push(VertexBinding {
            binding: 5,
            stride_bytes: 4,
            per_instance: true,
            divisor,
        });
        input.attributes.push(VertexAttribute {
            location: 1,
            binding: 5,
            format: vk::Format::R32_UINT,
            offset_bytes: 0,
        });
        let mut draw = draw(
            state,
            &positions,
            &[DrawCall {
                first_instance: 2,
                ..call(1, 4)
            }],
        );
        Arc::make_mut(&mut draw.vertex_buffers)[5] = VertexBuffer {
            address: values.as_ptr() as u64,
            size_bytes: size_of_val(&*values) as u64,
            stride_bytes: None,
        };
        let all = chunks(
            &[Work::Draw(draw)],
            &targets(0),
            &Reach::everywhere(),
            1,
            &Limits::default(),
        )
        .unwrap();
        let read: Vec<u32> = all[0].outputs.chunks(WORDS).map(|it| it[8]).collect();
        assert_eq!(read, expected, "divisor {divisor}");
        let instances: Vec<u32> = all[0].outputs.chunks(WORDS).map(|it| it[5]).collect();
        assert_eq!(instances, [2, 3, 4, 5]);
    }
}

#[test]
fn chunks_do_not_depend_on_threads() {
    let positions = positions(4000);
    let work = || {
        let mut work = Vec::new();
        for index in 0..40 {
            let calls = [call(3 + index * 90, 1), call(6, 3)];
            work.push(Work::Draw(draw(state(), &positions, &calls)));
        }
        work
    };
    let print = |threads| {
        let all = chunks(
            &work(),
            &targets(0),
            &Reach::everywhere(),
            threads,
            &Limits::default(),
        )
        .unwrap();
        all.iter()
            .map(|chunk| {
                format!(
                    "{:?} {:?} {:?} {:?}",
                    chunk.records, chunk.shapes, chunk.outputs, chunk.bins.shapes
                )
            })
            .collect::<Vec<_>>()
    };
    let one = print(1);
    assert!(one.len() > 20);
    assert_eq!(one, print(3));
}

#[test]
fn a_draw_of_all_vertices_is_stopped() {
    let positions = positions(3);
    for count in [u32::MAX, 2] {
        let limits = Limits {
            deadline: Some(Instant::now() + Duration::from_millis(200)),
            ..Limits::default()
        };
        let mut call = call(count, u32::MAX);
        call.vertex_offset = -1;
        let draw = draw(state(), &positions, &[call]);
        let start = Instant::now();
        let work = [Work::Draw(draw)];
        let workers = Workers::new(2);
        let (front, targets) = (FrontEnd::default(), targets(0));
        let mut rounds = Rounds::new(&targets, 2);
        let context = Context {
            workers: &workers,
            limits: &limits,
            reach: &Reach::everywhere(),
            counts: None,
        };
        let stopped = loop {
            match front.next_round(context, &targets, &work, &mut rounds) {
                Ok(Some(_)) => {}
                Ok(None) => panic!("came to an end"),
                Err(stopped) => break stopped,
            }
        };
        assert_eq!(stopped, Stopped::TimedOut);
        // Far less than all vertices take.
        assert!(start.elapsed() < Duration::from_secs(300));
    }
}

#[test]
fn vertices_are_within_the_budget_of_memory() {
    const BYTES: usize = 64 << 20;
    let positions = positions(3);
    let work = [Work::Draw(draw(state(), &positions, &[call(3, 1)]))];
    for bytes in [0, BYTES] {
        let limits = Limits {
            memory: Arc::new(Budget::new(bytes)),
            ..Limits::default()
        };
        let made = chunks(&work, &targets(0), &Reach::everywhere(), 1, &limits);
        let result = made.map(|chunks| chunks.len());
        let expected = match bytes {
            0 => Err(Stopped::OutOfMemory),
            _ => Ok(1),
        };
        assert_eq!(result, expected);
        assert!(limits.memory.take(bytes), "not all was given back");
    }
}
