//! Facts of tessellation shaders: the subdivision of patches, and the layout of a patch in the
//! memory of a control shader.
//!
//! The text form of each is one dotted word, as in [`super::interface`].

use std::fmt;

use super::interface::OutputRow;
use crate::SUBGROUP_SIZE;

/// Vertices of a patch, at most (`maxTessellationPatchSize`).
pub const MAX_PATCH_VERTICES: u32 = 32;

/// The domain of a patch's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Domain {
    Triangles,
    Quads,
    Isolines,
}

/// The spacing of the vertices on a subdivided edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Spacing {
    Equal,
    FractionalEven,
    FractionalOdd,
}

/// Modes that either tessellation shader may declare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TessellationModes {
    pub domain: Option<Domain>,
    pub spacing: Option<Spacing>,
    /// `VertexOrderCw`.
    pub clockwise: Option<bool>,
    pub point_mode: bool,
}

impl TessellationModes {
    /// These modes, with missing ones from the other stage.
    pub fn or(self, other: Self) -> Self {
        Self {
            domain: self.domain.or(other.domain),
            spacing: self.spacing.or(other.spacing),
            clockwise: self.clockwise.or(other.clockwise),
            point_mode: self.point_mode || other.point_mode,
        }
    }
}

/// The memory form of an interface word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Width {
    Word,
    /// An integer of 16 bits.
    Short,
    /// An integer of 8 bits.
    Byte,
    /// A float of 16 bits; one of 32 in the interface.
    Half,
}

impl Width {
    pub fn size_bytes(self) -> u32 {
        match self {
            Width::Word => 4,
            Width::Short | Width::Half => 2,
            Width::Byte => 1,
        }
    }
}

/// A word of the interface in the memory of a patch, or of a mesh shader's workgroup.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PatchWord {
    pub row: OutputRow,
    /// Offset of the word of the first vertex (or primitive), or of the patch.
    pub offset_bytes: u32,
    /// Bytes between the words of vertices; 0 for a word of the whole patch.
    pub stride_bytes: u32,
    pub width: Width,
}

impl PatchWord {
    /// One past the last byte for this number of vertices.
    pub fn end(&self, vertices: u32) -> u64 {
        let last = u64::from(vertices.max(1) - 1) * u64::from(self.stride_bytes);
        u64::from(self.offset_bytes) + last + u64::from(self.width.size_bytes())
    }
}

/// The facts of a control shader: a subgroup, or two of a workgroup, run the invocations of a
/// patch, and have the patch's inputs and outputs in workgroup memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ControlFacts {
    /// Invocations and output vertices of a patch.
    pub vertices: u32,
    /// Bytes of a patch's values.
    pub patch_bytes: u32,
    /// Words of the vertices of the input patch, which has room for [`MAX_PATCH_VERTICES`].
    pub inputs: Vec<PatchWord>,
    /// Words of the output patch.
    pub outputs: Vec<PatchWord>,
}

impl ControlFacts {
    /// Number of consecutive patches in a workgroup's memory, which one subgroup runs.
    pub fn patches(&self) -> u32 {
        (SUBGROUP_SIZE as u32 / self.vertices.max(1)).max(1)
    }

    /// Subgroups of a workgroup.
    pub fn subgroups(&self) -> u32 {
        self.vertices.div_ceil(SUBGROUP_SIZE as u32).max(1)
    }

    /// Whether everything is inside the memory of a patch.
    pub fn fits(&self, shared_size_bytes: u32) -> bool {
        let is_inside = |word: &PatchWord, vertices| word.end(vertices) <= self.patch_bytes.into();
        let all = u64::from(self.patch_bytes) * u64::from(self.patches());
        (1..=MAX_PATCH_VERTICES).contains(&self.vertices)
            && all <= shared_size_bytes.into()
            && (self.inputs.iter()).all(|word| is_inside(word, MAX_PATCH_VERTICES))
            && (self.outputs.iter()).all(|word| is_inside(word, self.vertices))
    }
}

/// The facts of a tessellation shader.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TessellationFacts {
    pub modes: TessellationModes,
    /// Of a control shader.
    pub control: Option<ControlFacts>,
}

impl fmt::Display for PatchWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = match self.width {
            Width::Word => "word",
            Width::Short => "short",
            Width::Byte => "byte",
            Width::Half => "half",
        };
        let (offset, stride) = (self.offset_bytes, self.stride_bytes);
        write!(f, "{}.at.{offset}.{stride}.{width}", self.row)
    }
}

impl std::str::FromStr for PatchWord {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let mut words = text.rsplitn(5, '.');
        let mut next = || words.next().ok_or(());
        let width = match next()? {
            "word" => Width::Word,
            "short" => Width::Short,
            "byte" => Width::Byte,
            "half" => Width::Half,
            _ => return Err(()),
        };
        let stride_bytes = next()?.parse().map_err(drop)?;
        let offset_bytes = next()?.parse().map_err(drop)?;
        if next()? != "at" {
            return Err(());
        }
        Ok(Self {
            row: next()?.parse()?,
            offset_bytes,
            stride_bytes,
            width,
        })
    }
}

/// The facts' words in the text form, in order.
impl fmt::Display for TessellationFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let modes = self.modes;
        let mut words = Vec::new();
        words.extend(modes.domain.map(|domain| match domain {
            Domain::Triangles => "triangles",
            Domain::Quads => "quads",
            Domain::Isolines => "isolines",
        }));
        words.extend(modes.spacing.map(|spacing| match spacing {
            Spacing::Equal => "equal",
            Spacing::FractionalEven => "fractional_even",
            Spacing::FractionalOdd => "fractional_odd",
        }));
        words.extend(modes.clockwise.map(|it| if it { "cw" } else { "ccw" }));
        words.extend(modes.point_mode.then_some("points"));
        let mut words: Vec<String> = words.into_iter().map(str::to_owned).collect();
        if let Some(control) = &self.control {
            words.push(format!("vertices.{}", control.vertices));
            words.push(format!("patch_bytes.{}", control.patch_bytes));
            words.extend(control.inputs.iter().map(|word| format!("in.{word}")));
            words.extend(control.outputs.iter().map(|word| format!("out.{word}")));
        } else {
            words.push("evaluation".to_owned());
        }
        f.write_str(&words.join(", "))
    }
}

impl TessellationFacts {
    /// Parses one word of the text form; false if it is invalid.
    pub fn set(&mut self, word: &str) -> bool {
        let modes = &mut self.modes;
        match word {
            "triangles" => modes.domain = Some(Domain::Triangles),
            "quads" => modes.domain = Some(Domain::Quads),
            "isolines" => modes.domain = Some(Domain::Isolines),
            "equal" => modes.spacing = Some(Spacing::Equal),
            "fractional_even" => modes.spacing = Some(Spacing::FractionalEven),
            "fractional_odd" => modes.spacing = Some(Spacing::FractionalOdd),
            "cw" => modes.clockwise = Some(true),
            "ccw" => modes.clockwise = Some(false),
            "points" => modes.point_mode = true,
            "evaluation" => self.control = None,
            _ => {
                let control = self.control.get_or_insert_default();
                let Some((name, rest)) = word.split_once('.') else {
                    return false;
                };
                match (name, rest.parse(), rest.parse()) {
                    ("vertices", Ok(number), _) => control.vertices = number,
                    ("patch_bytes", Ok(number), _) => control.patch_bytes = number,
                    ("in", _, Ok(word)) => control.inputs.push(word),
                    ("out", _, Ok(word)) => control.outputs.push(word),
                    _ => return false,
                }
            }
        }
        true
    }
}
