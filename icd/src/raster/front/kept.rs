//! Spans of instances that a worker has assembled. Jobs of other instances list the same vertices.

#![forbid(unsafe_code)]

use std::ops::Range;

use crate::raster::CHUNK_PRIMITIVES;

/// Spans that a worker keeps, and primitives of an instance up to which it does: all spans of the
/// instance fit.
const KEPT: usize = 16;
pub const KEPT_PRIMITIVES: u32 = (KEPT * CHUNK_PRIMITIVES) as u32;

/// The place of a span's first index or vertex, what is added to indices, and its primitives.
pub type SpanSource = (u64, i32, Range<u32>);

/// The primitives of a span as they were listed for one instance.
#[derive(Default)]
pub struct KeptSpan {
    /// The batch and the draw: memory does not change meanwhile.
    of: (u64, u32),
    source: SpanSource,
    /// Of the vertices.
    pub indices: Vec<u32>,
    /// Vertices of the primitives, counted from the span's first one.
    pub primitives: Vec<[u32; 3]>,
}

/// The latest spans.
#[derive(Default)]
pub struct KeptSpans {
    spans: Vec<KeptSpan>,
    /// The next one to be replaced.
    next: usize,
}

impl KeptSpans {
    /// A span of a draw in a batch, if it is kept.
    pub fn find(&self, of: (u64, u32), source: &SpanSource) -> Option<&KeptSpan> {
        let mut spans = self.spans.iter();
        spans.find(|it| it.of == of && it.source == *source)
    }

    /// A span in the place of the oldest one, with nothing listed yet.
    pub fn replace(&mut self, of: (u64, u32), source: SpanSource) -> &mut KeptSpan {
        if self.spans.len() < KEPT {
            self.spans.push(KeptSpan::default());
        }
        let kept = &mut self.spans[self.next];
        self.next = (self.next + 1) % KEPT;
        (kept.of, kept.source) = (of, source);
        kept.indices.clear();
        kept.primitives.clear();
        kept
    }
}
