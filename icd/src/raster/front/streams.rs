//! The primitives that the last stage before rasterization makes, by vertex stream: which are
//! captured, and which are drawn.

#![forbid(unsafe_code)]

use std::sync::atomic::Ordering;

use ash::vk::PrimitiveTopology as Topology;
use spirv_jit::Program;
use spirv_jit::program::MAX_STREAMS;

use super::topology::{self, Assembled};
use crate::raster::primitive::Captured;
use crate::raster::{Chunk, Draw};
use crate::wave::Stopped;

/// Counts a draw's primitives, and lists those for transform feedback in the chunk; leaves those
/// that are drawn. `first` is the first word of the primitives' vertices among the outputs, and the
/// words of each.
///
/// # Errors
/// When there is no memory.
pub fn divide(
    draw: &Draw,
    draw_index: u32,
    topology: Topology,
    [first_word, words]: [u32; 2],
    primitives: &mut Vec<Assembled>,
    chunk: &mut Chunk,
) -> Result<(), Stopped> {
    for counters in &draw.counters {
        let of_stream = |it: &&Assembled| u32::from(it.stream) == counters.stream;
        let count = primitives.iter().filter(of_stream).count() as u64;
        counters.generated.fetch_add(count, Ordering::Relaxed);
    }
    let has_streams =
        (draw.stages.last().and_then(Program::geometry)).is_some_and(|facts| facts.streams);
    if draw.feedback.is_some() {
        let corners = topology::kind(topology).map_or(0, topology::PrimitiveKind::corners);
        let vertices = &mut chunk.captured_vertices;
        (vertices.try_reserve(primitives.len() * corners)).map_err(|_| Stopped::OutOfMemory)?;
        let streams = if has_streams { MAX_STREAMS as u8 } else { 1 };
        for stream in 0..streams {
            let start = vertices.len();
            for primitive in primitives.iter().filter(|it| it.stream == stream) {
                let places = primitive.vertices[..corners].iter();
                vertices.extend(places.map(|vertex| first_word + vertex * words));
            }
            if vertices.len() > start {
                chunk.captured.push(Captured {
                    draw: draw_index,
                    stream,
                    corners: corners as u8,
                    vertices: start..vertices.len(),
                });
            }
        }
    }
    let drawn = draw.state.rasterization.stream;
    if has_streams || drawn != 0 {
        primitives.retain(|it| u32::from(it.stream) == drawn);
    }
    Ok(())
}
