//! Kinds of structures.

/// The kind of a structure.
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
