//! The outputs that transform feedback captures (`XfbBuffer`, `XfbStride`, `Offset`, `Stream`).

use rspirv::spirv::{Decoration, ExecutionMode};

use super::Lowerer;
use super::types::TypeKind;
use crate::Error;
use crate::ir::Type;
use crate::ir::transform_feedback::{
    FeedbackBuffer, FeedbackFacts, FeedbackWidth, FeedbackWord, MAX_STREAMS,
};
use crate::parse::Id;

/// A captured output or block member.
struct Piece {
    ty: Id,
    /// Its first row in the variable's value.
    row: usize,
    buffer: u32,
    offset_bytes: u32,
    stride_bytes: u32,
    stream: u32,
}

/// Decorations of a variable or a member for its capture.
#[derive(Clone, Copy)]
struct Said {
    buffer: Option<u32>,
    stride_bytes: Option<u32>,
    stream: Option<u32>,
}

impl Said {
    fn new(find: impl Fn(Decoration) -> Option<u32>) -> Self {
        Self {
            buffer: find(Decoration::XfbBuffer),
            stride_bytes: find(Decoration::XfbStride),
            stream: find(Decoration::Stream),
        }
    }

    fn or(self, outer: Self) -> Self {
        Self {
            buffer: self.buffer.or(outer.buffer),
            stride_bytes: self.stride_bytes.or(outer.stride_bytes),
            stream: self.stream.or(outer.stream),
        }
    }
}

impl Lowerer<'_> {
    /// The facts of the entry point's capture, if it has the mode `Xfb`.
    pub(super) fn feedback_facts(&mut self) -> Result<Option<FeedbackFacts>, Error> {
        let is_captured = (self.execution_modes()).any(|(mode, _)| mode == ExecutionMode::Xfb);
        if !is_captured {
            return Ok(None);
        }
        let mut facts = FeedbackFacts::default();
        for id in self.interface.output_variables.clone() {
            for piece in self.captured_pieces(id)? {
                self.capture(id, &piece, &mut facts)?;
            }
        }
        match facts.fits() {
            true => Ok(Some(facts)),
            false => Err(self
                .b
                .invalid("a captured output does not fit in its stride")),
        }
    }

    /// The captured parts of a variable. Elements of an array of blocks go to consecutive buffers.
    fn captured_pieces(&self, id: Id) -> Result<Vec<Piece>, Error> {
        let annotations = &self.module.annotations;
        let pointee = self.variables[&id].pointee;
        let of_variable = Said::new(|decoration| annotations.id(id, decoration));
        let mut pieces = Vec::new();
        let mut push = |said: Said, offset: Option<u32>, element: u32, ty: Id, row: usize| {
            if let (Some(buffer), Some(offset_bytes)) = (said.buffer, offset) {
                pieces.push(Piece {
                    ty,
                    row,
                    buffer: buffer.saturating_add(element),
                    offset_bytes,
                    stride_bytes: said.stride_bytes.unwrap_or(0),
                    stream: said.stream.unwrap_or(0),
                });
            }
        };
        let offset = annotations.id(id, Decoration::Offset);
        if offset.is_some() {
            push(of_variable, offset, 0, pointee, 0);
            return Ok(pieces);
        }
        let (mut ty, mut elements) = (pointee, 1u32);
        while let TypeKind::Array { element, count } = *self.types.kind(ty)? {
            (ty, elements) = (element, elements.saturating_mul(count));
        }
        let TypeKind::Struct { members } = self.types.kind(ty)? else {
            return Ok(pieces);
        };
        let mut row = 0;
        for element in 0..elements {
            for (index, &member) in (0..).zip(members.iter()) {
                let find = |decoration| annotations.member(ty, index, decoration);
                let said = Said::new(find).or(of_variable);
                push(said, find(Decoration::Offset), element, member, row);
                row += self.types.info(member)?.rows as usize;
            }
        }
        Ok(pieces)
    }

    /// Adds the words of a piece: consecutive scalars, each aligned to its size.
    fn capture(&mut self, id: Id, piece: &Piece, facts: &mut FeedbackFacts) -> Result<(), Error> {
        let buffer = match facts.buffers.get_mut(piece.buffer as usize) {
            Some(buffer) if piece.stream < MAX_STREAMS => buffer,
            _ => return Err(self.b.invalid("no such buffer or stream to capture to")),
        };
        let stream = piece.stream as u8;
        let known = buffer.get_or_insert(FeedbackBuffer {
            stride_bytes: 0,
            stream,
        });
        known.stride_bytes = known.stride_bytes.max(piece.stride_bytes);
        if known.stream != stream {
            return Err(self.b.invalid("a buffer captures outputs of two streams"));
        }
        let words = self.interface_words(id)?;
        let (mut row, mut offset) = (piece.row, piece.offset_bytes);
        for &ty in self.types.leaves(piece.ty)?.iter() {
            let (width, size_bytes) = match ty {
                Type::I8 => (FeedbackWidth::Byte, 1),
                Type::I16 => (FeedbackWidth::Short, 2),
                Type::F16 => (FeedbackWidth::Half, 2),
                _ => (FeedbackWidth::Word, 4 * ty.rows()),
            };
            offset = offset.saturating_add(size_bytes - 1) / size_bytes * size_bytes;
            for part in 0..ty.rows() {
                let Some(&word) = words.get(row) else {
                    return Err(self.b.invalid("a value lacks words"));
                };
                facts.words.push(FeedbackWord {
                    buffer: piece.buffer as u8,
                    offset_bytes: offset.saturating_add(4 * part),
                    width,
                    row: self.output_row(word)?,
                });
                row += 1;
            }
            offset = offset.saturating_add(size_bytes);
        }
        Ok(())
    }
}
