//! How instructions name rows of the frame.

/// A row of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Operand(u32);

impl Operand {
    const UNIFORM: u32 = 1 << 31;
    pub(super) const NONE: Operand = Operand(Self::UNIFORM - 1);

    pub(super) fn vector(row: usize) -> Operand {
        Operand(row as u32)
    }

    pub(super) fn uniform(row: usize) -> Operand {
        Operand(row as u32 | Self::UNIFORM)
    }

    pub(super) fn is_uniform(self) -> bool {
        self.0 & Self::UNIFORM != 0
    }

    /// Operand fields that hold a number instead.
    pub(super) fn number(value: u32) -> Operand {
        Operand(value)
    }

    pub(super) fn raw(self) -> u32 {
        self.0
    }

    pub(super) fn index(self) -> usize {
        (self.0 & !Self::UNIFORM) as usize
    }
}
