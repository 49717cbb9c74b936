//! Transform feedback: the primitives of the last stage before rasterization, written to buffers.
//!
//! Chunks are made side by side, and list the vertices of the primitives to be captured. Once a
//! round of them is done, each list gets its place in the buffers, in the order of the chunks. So
//! primitives lie in the order that the specification requires, for any number of threads, and the
//! lists can be written side by side, too.

use std::sync::atomic::{AtomicU64, Ordering};

use half::f16;
use rayon::prelude::*;
use spirv_jit::Program;
use spirv_jit::program::{FeedbackFacts, FeedbackWidth, MAX_FEEDBACK_BUFFERS};
use spirv_jit::reach::Reach;

use super::primitive::Captured;
use super::{Chunk, Context, Draw, Work};
use crate::wave::reachable::writable;

/// Bytes of a round that are less work than waking others up.
const FEW_BYTES: u64 = 1 << 16;

/// A bound buffer.
#[derive(Debug, Default)]
pub struct FeedbackTarget {
    /// Device address of its first byte at its offset; 0 for none.
    pub address: u64,
    /// From there on.
    pub size_bytes: u64,
    /// Where the next primitive goes.
    pub next_bytes: AtomicU64,
}

/// Transform feedback from its beginning to its end.
#[derive(Debug, Default)]
pub struct TransformFeedback {
    pub targets: [FeedbackTarget; MAX_FEEDBACK_BUFFERS],
}

/// Primitives that have their places in buffers.
struct Placed<'a> {
    captured: &'a Captured,
    chunk: &'a Chunk,
    draw: &'a Draw,
    facts: &'a FeedbackFacts,
    /// Those that there is room for.
    primitives: u64,
    /// Offsets of the first one.
    starts: [u64; MAX_FEEDBACK_BUFFERS],
}

/// Captured words that follow each other: where they come from, and where they go.
struct Move {
    /// The first one, of the outputs of a vertex; zeros if there is none.
    word: Option<usize>,
    words: usize,
    buffer: usize,
    offset_bytes: usize,
    width: FeedbackWidth,
}

impl Move {
    /// Takes a move behind this one, if both are copied as one.
    fn join(&mut self, next: &Self) -> bool {
        let joins = (self.width, next.width) == (FeedbackWidth::Word, FeedbackWidth::Word)
            && self.buffer == next.buffer
            && self.offset_bytes + self.words * size_of::<u32>() == next.offset_bytes
            && (self.word).is_some_and(|word| next.word == Some(word + self.words));
        self.words += if joins { next.words } else { 0 };
        joins
    }
}

/// Writes all that the chunks of a round have captured.
pub fn write(context: Context<'_>, work: &[Work], chunks: &[Chunk]) {
    let mut placed = Vec::new();
    let mut bytes = 0;
    for chunk in chunks {
        for captured in &chunk.captured {
            if let Some(Work::Draw(draw)) = work.get(captured.draw as usize)
                && let Some(facts) = draw.stages.last().and_then(Program::transform_feedback)
                && let Some(feedback) = &draw.feedback
            {
                let it = place(draw, facts, feedback, captured, chunk);
                bytes += it.bytes();
                placed.push(it);
            }
        }
    }
    let reach = context.reach;
    if bytes <= FEW_BYTES || placed.len() == 1 {
        placed.iter().for_each(|it| it.write(reach));
    } else {
        (context.workers).install(|| placed.par_iter().for_each(|it| it.write(reach)));
    }
}

/// Takes room for primitives in all buffers of their stream: whole ones, as many as fit.
fn place<'a>(
    draw: &'a Draw,
    facts: &'a FeedbackFacts,
    feedback: &TransformFeedback,
    captured: &'a Captured,
    chunk: &'a Chunk,
) -> Placed<'a> {
    let corners = u64::from(captured.corners.max(1));
    let count = captured.vertices.len() as u64 / corners;
    let mut starts = [0; MAX_FEEDBACK_BUFFERS];
    let mut primitives = count;
    let of_stream = || {
        let buffers = facts.buffers.iter().zip(&feedback.targets).enumerate();
        buffers.filter_map(|(index, (buffer, target))| {
            let buffer = buffer.filter(|it| it.stream == captured.stream)?;
            Some((index, u64::from(buffer.stride_bytes) * corners, target))
        })
    };
    for (index, size_bytes, target) in of_stream() {
        starts[index] = target.next_bytes.load(Ordering::Relaxed);
        let room = target.size_bytes.saturating_sub(starts[index]);
        primitives = primitives.min(room.checked_div(size_bytes).unwrap_or(count));
    }
    for (_, size_bytes, target) in of_stream() {
        let taken = primitives * size_bytes;
        target.next_bytes.fetch_add(taken, Ordering::Relaxed);
    }
    let is_captured = of_stream().next().is_some();
    for counters in &draw.counters {
        if counters.stream == u32::from(captured.stream) {
            let written = if is_captured { primitives } else { 0 };
            counters.written.fetch_add(written, Ordering::Relaxed);
            counters.needed.fetch_add(count, Ordering::Relaxed);
        }
    }
    Placed {
        captured,
        chunk,
        draw,
        facts,
        primitives,
        starts,
    }
}

impl Placed<'_> {
    fn vertices(&self) -> &[u32] {
        let all = &self.chunk.captured_vertices[self.captured.vertices.clone()];
        &all[..self.primitives as usize * usize::from(self.captured.corners)]
    }

    fn stride_bytes(&self, buffer: usize) -> usize {
        let of_stream = self.facts.buffers[buffer].filter(|it| it.stream == self.captured.stream);
        of_stream.map_or(0, |it| it.stride_bytes as usize)
    }

    fn bytes(&self) -> u64 {
        let strides: usize = (0..MAX_FEEDBACK_BUFFERS)
            .map(|it| self.stride_bytes(it))
            .sum();
        (self.vertices().len() * strides) as u64
    }

    fn write(&self, reach: &Reach) {
        let (Some(last), Some(feedback)) = (self.draw.stages.last(), &self.draw.feedback) else {
            return;
        };
        let vertices = self.vertices();
        let mut strides = [0; MAX_FEEDBACK_BUFFERS];
        let mut memory: [&mut [u8]; MAX_FEEDBACK_BUFFERS] = Default::default();
        for (buffer, memory) in memory.iter_mut().enumerate() {
            let target = &feedback.targets[buffer];
            strides[buffer] = self.stride_bytes(buffer);
            let size_bytes = (vertices.len() * strides[buffer]) as u64;
            let address = target.address.wrapping_add(self.starts[buffer]);
            // SAFETY: an application writes this range by nothing else until the command ends, and
            // each list of primitives has a range of its own.
            *memory = unsafe { writable(reach, address, size_bytes) };
        }
        let mut moves: Vec<Move> = Vec::new();
        for word in &self.facts.words {
            let next = Move {
                word: last.outputs().iter().position(|row| *row == word.row),
                words: 1,
                buffer: word.buffer.into(),
                offset_bytes: word.offset_bytes as usize,
                width: word.width,
            };
            let is_there = !memory[next.buffer].is_empty();
            if is_there && !moves.last_mut().is_some_and(|last| last.join(&next)) {
                moves.push(next);
            }
        }
        for (place, &first) in vertices.iter().enumerate() {
            for it in &moves {
                let words = it.word.and_then(|word| {
                    let outputs = self.chunk.outputs.get(first as usize + word..)?;
                    outputs.get(..it.words)
                });
                let start = place * strides[it.buffer] + it.offset_bytes;
                let to = &mut memory[it.buffer][start..];
                if let (FeedbackWidth::Word, Some(words)) = (it.width, words) {
                    let (to, _) = to.as_chunks_mut();
                    for (to, word) in to[..it.words].iter_mut().zip(words) {
                        *to = word.to_le_bytes();
                    }
                    continue;
                }
                let word = words.map_or(0, |words| words[0]);
                let word = match it.width {
                    FeedbackWidth::Half => f16::from_f32(f32::from_bits(word)).to_bits().into(),
                    _ => word,
                };
                let bytes = &word.to_le_bytes()[..it.width.size_bytes() as usize];
                to[..bytes.len()].copy_from_slice(bytes);
            }
        }
    }
}
