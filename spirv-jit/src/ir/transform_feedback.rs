//! The facts of transform feedback: the buffer and offset of each captured output word (Vulkan,
//! section "Transform Feedback").
//!
//! The text form of each is one dotted word, as in [`super::interface`].

use std::fmt;

use super::interface::OutputRow;

/// Largest number of buffers of a shader.
pub const MAX_FEEDBACK_BUFFERS: usize = 4;

/// Vertex streams of a geometry shader.
pub const MAX_STREAMS: u32 = 4;

/// The memory form of a captured word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FeedbackWidth {
    Word,
    /// An integer of 16 bits.
    Short,
    /// An integer of 8 bits.
    Byte,
    /// A float of 16 bits; one of 32 in the interface.
    Half,
}

const WIDTHS: [(FeedbackWidth, &str); 4] = [
    (FeedbackWidth::Word, "word"),
    (FeedbackWidth::Short, "short"),
    (FeedbackWidth::Byte, "byte"),
    (FeedbackWidth::Half, "half"),
];

impl FeedbackWidth {
    pub fn size_bytes(self) -> u32 {
        match self {
            FeedbackWidth::Word => 4,
            FeedbackWidth::Short | FeedbackWidth::Half => 2,
            FeedbackWidth::Byte => 1,
        }
    }
}

/// A captured word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FeedbackWord {
    pub buffer: u8,
    /// Offset in the data of a vertex.
    pub offset_bytes: u32,
    pub width: FeedbackWidth,
    /// A missing output is zero.
    pub row: OutputRow,
}

/// A buffer's share of a captured vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedbackBuffer {
    /// Bytes of a vertex (`XfbStride`).
    pub stride_bytes: u32,
    /// The stream of the captured vertices.
    pub stream: u8,
}

/// The facts of a shader with the mode `Xfb`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FeedbackFacts {
    /// The buffers with captured words.
    pub buffers: [Option<FeedbackBuffer>; MAX_FEEDBACK_BUFFERS],
    pub words: Vec<FeedbackWord>,
}

impl FeedbackFacts {
    /// Whether each word is inside its buffer's data of a vertex.
    pub fn fits(&self) -> bool {
        let streams = self.buffers.iter().flatten();
        let known = streams
            .into_iter()
            .all(|it| u32::from(it.stream) < MAX_STREAMS);
        let is_inside = |word: &FeedbackWord| {
            let buffer = self.buffers.get(usize::from(word.buffer));
            let end = u64::from(word.offset_bytes) + u64::from(word.width.size_bytes());
            matches!(buffer, Some(Some(it)) if end <= u64::from(it.stride_bytes))
        };
        known && self.words.iter().all(is_inside)
    }

    /// Parses one word of the text form; false if it is invalid.
    pub fn set(&mut self, word: &str) -> bool {
        self.parse(word).is_some()
    }

    fn parse(&mut self, word: &str) -> Option<()> {
        let mut parts = word.splitn(4, '.');
        let mut part = || parts.next();
        let kind = part()?;
        let buffer: u8 = part()?.parse().ok()?;
        let number = part()?.parse().ok()?;
        let rest = part()?;
        if kind == "buffer" {
            *self.buffers.get_mut(usize::from(buffer))? = Some(FeedbackBuffer {
                stride_bytes: number,
                stream: rest.parse().ok()?,
            });
            return Some(());
        }
        let (width, _) = WIDTHS.iter().find(|(_, name)| *name == kind)?;
        self.words.push(FeedbackWord {
            buffer,
            offset_bytes: number,
            width: *width,
            row: rest.parse().ok()?,
        });
        Some(())
    }
}

/// The facts' words in the text form, in order.
impl fmt::Display for FeedbackFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut words = Vec::new();
        for (index, buffer) in self.buffers.iter().enumerate() {
            if let Some(it) = buffer {
                words.push(format!("buffer.{index}.{}.{}", it.stride_bytes, it.stream));
            }
        }
        for word in &self.words {
            let name = WIDTHS.iter().find(|(width, _)| *width == word.width);
            let name = name.map_or("", |(_, name)| name);
            let (buffer, offset) = (word.buffer, word.offset_bytes);
            words.push(format!("{name}.{buffer}.{offset}.{}", word.row));
        }
        f.write_str(&words.join(", "))
    }
}
