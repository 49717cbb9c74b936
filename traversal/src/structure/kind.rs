//! Kinds of structures, and what may be wrong with one.

/// What a structure holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Kind {
    /// A bottom level of triangles.
    Triangles = 1,
    /// A bottom level of boxes.
    Aabbs = 2,
    /// A top level.
    Instances = 3,
    /// A bottom level of spheres or of linear swept spheres.
    Swept = 4,
    /// A bottom level of triangles that move.
    Motion = 5,
    /// A top level whose instances may move.
    MotionInstances = 6,
}

impl Kind {
    /// A top level.
    #[inline(always)]
    pub fn is_top(self) -> bool {
        matches!(self, Kind::Instances | Kind::MotionInstances)
    }

    pub(super) fn of(word: u16) -> Option<Kind> {
        match word {
            1 => Some(Kind::Triangles),
            2 => Some(Kind::Aabbs),
            3 => Some(Kind::Instances),
            4 => Some(Kind::Swept),
            5 => Some(Kind::Motion),
            6 => Some(Kind::MotionInstances),
            _ => None,
        }
    }
}

/// Why bytes are not a structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StructureError {
    /// Shorter than what the header says, or than a header.
    Truncated,
    /// Not a structure of ours, or of another version.
    NotAStructure,
    /// A count, an offset or an index points outside, or backwards.
    Corrupt,
    /// The caller's destination is too small or not aligned to 256 bytes.
    Destination,
}

impl std::fmt::Display for StructureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            StructureError::Truncated => "the structure is cut short",
            StructureError::NotAStructure => "not an acceleration structure of this version",
            StructureError::Corrupt => "the structure is corrupt",
            StructureError::Destination => "the destination is too small or misaligned",
        })
    }
}

impl std::error::Error for StructureError {}
