//! The interface between drawing stages and the rasterizer: rows of inputs and outputs, and facts
//! of geometry and fragment shaders.
//!
//! The text form of each is one dotted word. [`fmt::Display`] and [`std::str::FromStr`] are
//! inverse.

use std::fmt;
use std::str::FromStr;

/// The position at which a fragment's varying is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Position {
    /// The pixel's centre.
    Center,
    /// A position in the covered part of the pixel (`Centroid`).
    Centroid,
    /// The invocation's sample (`Sample`).
    Sample,
}

/// The interpolation of a fragment's varying from the vertices' outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum VaryingMode {
    /// The word of the provoking vertex.
    Flat,
    /// Perspective-correct.
    Smooth(Position),
    /// Linear on the screen (`NoPerspective`).
    Linear(Position),
    /// The word of a vertex (`PerVertexKHR`).
    PerVertex(u8),
}

/// The output of the previous stage that is the source of a varying.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum VaryingPlace {
    Location(u16),
    /// Tessellation evaluation: a word of the whole patch, as are tessellation levels.
    Patch(u16),
    TessLevelOuter,
    TessLevelInner,
    /// Fragment: a word of a mesh shader's primitive (`PerPrimitiveEXT`).
    Primitive(u16),
    /// Tessellation evaluation and geometry stage, as `PointSize`.
    Position,
    PointSize,
    ClipDistance,
    CullDistance,
}

/// An input word from the previous stage. Words of a geometry shader belong to a vertex of its
/// primitive ([`VaryingMode::PerVertex`]); words of an evaluation shader belong to a vertex of the
/// patch, or to the patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Varying {
    pub place: VaryingPlace,
    /// Word of the location or of the position, or index of the distance.
    pub component: u8,
    pub mode: VaryingMode,
}

impl Varying {
    /// The vertex of a per-vertex word, otherwise 0.
    pub fn vertex(&self) -> u8 {
        match self.mode {
            VaryingMode::PerVertex(vertex) => vertex,
            _ => 0,
        }
    }

    /// The output of the previous stage.
    pub fn output(&self) -> OutputRow {
        match self.place {
            VaryingPlace::Location(location) => OutputRow::Location {
                location,
                component: self.component,
                index: 0,
            },
            VaryingPlace::Patch(location) => OutputRow::Patch {
                location,
                component: self.component,
            },
            VaryingPlace::Primitive(location) => OutputRow::Primitive {
                location,
                component: self.component,
            },
            VaryingPlace::TessLevelOuter => OutputRow::TessLevelOuter(self.component),
            VaryingPlace::TessLevelInner => OutputRow::TessLevelInner(self.component),
            VaryingPlace::Position => OutputRow::Position(self.component),
            VaryingPlace::PointSize => OutputRow::PointSize,
            VaryingPlace::ClipDistance => OutputRow::ClipDistance(self.component),
            VaryingPlace::CullDistance => OutputRow::CullDistance(self.component),
        }
    }
}

/// A barycentric coordinate (`BaryCoordKHR`, `BaryCoordNoPerspKHR`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Barycentric {
    pub vertex: u8,
    pub perspective: bool,
    pub position: Position,
}

/// An output word of a vertex or fragment invocation, or of each vertex that a geometry invocation
/// emits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum OutputRow {
    /// A varying of a stage before rasterization; a colour of the fragment stage, `index` 1 for the
    /// second source of blending.
    Location {
        location: u16,
        component: u8,
        index: u8,
    },
    /// Tessellation control: a value of the whole patch, as are tessellation levels.
    Patch {
        location: u16,
        component: u8,
    },
    TessLevelOuter(u8),
    TessLevelInner(u8),
    /// Mesh: a value of a primitive.
    Primitive {
        location: u16,
        component: u8,
    },
    /// Mesh: the vertex index of a corner of the primitive.
    PrimitiveIndex(u8),
    /// Mesh: not 0 if the primitive is discarded.
    CullPrimitive,
    Position(u8),
    PointSize,
    ClipDistance(u8),
    CullDistance(u8),
    Layer,
    ViewportIndex,
    /// Geometry and mesh stage.
    PrimitiveId,
    /// `PrimitiveShadingRateKHR`.
    ShadingRate,
    FragDepth,
    FragStencilRef,
    SampleMask,
}

/// The kind of primitives that a geometry shader emits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Emits {
    #[default]
    Points,
    LineStrips,
    TriangleStrips,
}

/// The facts of a geometry shader that the rasterizer needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GeometryFacts {
    /// Vertices of an input primitive, with adjacent ones.
    pub vertices: u32,
    pub emits: Emits,
    /// Invocations for each primitive.
    pub invocations: u32,
    /// Largest number of vertices that an invocation emits.
    pub max_vertices: u32,
    /// The shader emits to several streams.
    pub streams: bool,
}

/// A shader's guarantee about the depth that it writes (`DepthGreater` and others).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthMode {
    Any,
    Greater,
    Less,
    Unchanged,
}

/// The invocations that `OpBeginInvocationInterlockEXT` separates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Interlock {
    PixelOrdered,
    PixelUnordered,
    SampleOrdered,
    SampleUnordered,
}

/// The facts of a fragment shader that the rasterizer needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FragmentFacts {
    /// `EarlyFragmentTests`.
    pub early_tests: bool,
    /// The mode of the written depth, if the shader writes it.
    pub depth: Option<DepthMode>,
    /// Lanes may become helpers, or end, before the program does.
    pub discards: bool,
    /// Stores or atomics.
    pub writes_memory: bool,
    /// It runs once for each sample: it reads `SampleId`, `SamplePosition` or a `Sample` input.
    pub per_sample: bool,
    /// It reads input attachments.
    pub reads_attachments: bool,
    pub interlock: Option<Interlock>,
    /// `PostDepthCoverage`.
    pub post_depth_coverage: bool,
    /// `RequireFullQuadsKHR`.
    pub full_quads: bool,
    pub writes_sample_mask: bool,
    pub writes_stencil_ref: bool,
    /// Written locations, a bit each.
    pub color_mask: u32,
    /// It writes the second source of blending.
    pub dual_source: bool,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Position::Center => "center",
            Position::Centroid => "centroid",
            Position::Sample => "sample",
        })
    }
}

impl FromStr for Position {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        match text {
            "center" => Ok(Position::Center),
            "centroid" => Ok(Position::Centroid),
            "sample" => Ok(Position::Sample),
            _ => Err(()),
        }
    }
}

impl fmt::Display for Varying {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place {
            VaryingPlace::Location(location) => write!(f, "varying.{location}")?,
            VaryingPlace::Patch(location) => write!(f, "varying.patch_{location}")?,
            VaryingPlace::Primitive(location) => write!(f, "varying.primitive_{location}")?,
            VaryingPlace::TessLevelOuter => f.write_str("varying.tess_outer")?,
            VaryingPlace::TessLevelInner => f.write_str("varying.tess_inner")?,
            VaryingPlace::Position => f.write_str("varying.position")?,
            VaryingPlace::PointSize => f.write_str("varying.point_size")?,
            VaryingPlace::ClipDistance => f.write_str("varying.clip")?,
            VaryingPlace::CullDistance => f.write_str("varying.cull")?,
        }
        write!(f, ".{}", self.component)?;
        match self.mode {
            VaryingMode::Flat => f.write_str(".flat"),
            VaryingMode::Smooth(position) => write!(f, ".smooth.{position}"),
            VaryingMode::Linear(position) => write!(f, ".linear.{position}"),
            VaryingMode::PerVertex(vertex) => write!(f, ".vertex.{vertex}"),
        }
    }
}

impl FromStr for Varying {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let words: Vec<&str> = text.split('.').collect();
        let ["varying", place, component, mode @ ..] = words.as_slice() else {
            return Err(());
        };
        Ok(Varying {
            place: match *place {
                "tess_outer" => VaryingPlace::TessLevelOuter,
                "tess_inner" => VaryingPlace::TessLevelInner,
                "position" => VaryingPlace::Position,
                "point_size" => VaryingPlace::PointSize,
                "clip" => VaryingPlace::ClipDistance,
                "cull" => VaryingPlace::CullDistance,
                place => match place.split_once('_') {
                    Some(("patch", place)) => VaryingPlace::Patch(place.parse().map_err(drop)?),
                    Some(("primitive", place)) => {
                        VaryingPlace::Primitive(place.parse().map_err(drop)?)
                    }
                    _ => VaryingPlace::Location(place.parse().map_err(drop)?),
                },
            },
            component: component.parse().map_err(drop)?,
            mode: match mode {
                ["flat"] => VaryingMode::Flat,
                ["smooth", position] => VaryingMode::Smooth(position.parse()?),
                ["linear", position] => VaryingMode::Linear(position.parse()?),
                ["vertex", vertex] => VaryingMode::PerVertex(vertex.parse().map_err(drop)?),
                _ => return Err(()),
            },
        })
    }
}

impl fmt::Display for Barycentric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.perspective { "smooth" } else { "linear" };
        write!(f, "barycentric.{}.{kind}.{}", self.vertex, self.position)
    }
}

impl FromStr for Barycentric {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let words: Vec<&str> = text.split('.').collect();
        let [
            "barycentric",
            vertex,
            kind @ ("smooth" | "linear"),
            position,
        ] = words.as_slice()
        else {
            return Err(());
        };
        Ok(Barycentric {
            vertex: vertex.parse().map_err(drop)?,
            perspective: *kind == "smooth",
            position: position.parse()?,
        })
    }
}

impl fmt::Display for OutputRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OutputRow::Location {
                location,
                component,
                index,
            } => write!(f, "location.{location}.{component}.{index}"),
            OutputRow::Patch {
                location,
                component,
            } => write!(f, "patch.{location}.{component}"),
            OutputRow::Primitive {
                location,
                component,
            } => write!(f, "primitive.{location}.{component}"),
            OutputRow::PrimitiveIndex(corner) => write!(f, "primitive_index.{corner}"),
            OutputRow::CullPrimitive => f.write_str("cull_primitive"),
            OutputRow::TessLevelOuter(index) => write!(f, "tess_outer.{index}"),
            OutputRow::TessLevelInner(index) => write!(f, "tess_inner.{index}"),
            OutputRow::Position(component) => write!(f, "position.{component}"),
            OutputRow::PointSize => f.write_str("point_size"),
            OutputRow::ClipDistance(index) => write!(f, "clip_distance.{index}"),
            OutputRow::CullDistance(index) => write!(f, "cull_distance.{index}"),
            OutputRow::Layer => f.write_str("layer"),
            OutputRow::ViewportIndex => f.write_str("viewport_index"),
            OutputRow::PrimitiveId => f.write_str("primitive_id"),
            OutputRow::ShadingRate => f.write_str("shading_rate"),
            OutputRow::FragDepth => f.write_str("frag_depth"),
            OutputRow::FragStencilRef => f.write_str("frag_stencil_ref"),
            OutputRow::SampleMask => f.write_str("sample_mask"),
        }
    }
}

impl FromStr for OutputRow {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let words: Vec<&str> = text.split('.').collect();
        let number = |word: &str| word.parse().map_err(drop);
        Ok(match words.as_slice() {
            ["patch", location, component] => OutputRow::Patch {
                location: location.parse().map_err(drop)?,
                component: number(component)?,
            },
            ["primitive", location, component] => OutputRow::Primitive {
                location: location.parse().map_err(drop)?,
                component: number(component)?,
            },
            ["primitive_index", corner] => OutputRow::PrimitiveIndex(number(corner)?),
            ["cull_primitive"] => OutputRow::CullPrimitive,
            ["tess_outer", index] => OutputRow::TessLevelOuter(number(index)?),
            ["tess_inner", index] => OutputRow::TessLevelInner(number(index)?),
            ["location", location, component, index] => OutputRow::Location {
                location: location.parse().map_err(drop)?,
                component: number(component)?,
                index: number(index)?,
            },
            ["position", component] => OutputRow::Position(number(component)?),
            ["point_size"] => OutputRow::PointSize,
            ["clip_distance", index] => OutputRow::ClipDistance(number(index)?),
            ["cull_distance", index] => OutputRow::CullDistance(number(index)?),
            ["layer"] => OutputRow::Layer,
            ["viewport_index"] => OutputRow::ViewportIndex,
            ["primitive_id"] => OutputRow::PrimitiveId,
            ["shading_rate"] => OutputRow::ShadingRate,
            ["frag_depth"] => OutputRow::FragDepth,
            ["frag_stencil_ref"] => OutputRow::FragStencilRef,
            ["sample_mask"] => OutputRow::SampleMask,
            _ => return Err(()),
        })
    }
}

/// The facts' words in the text form, in order.
impl fmt::Display for GeometryFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let emits = match self.emits {
            Emits::Points => "points",
            Emits::LineStrips => "line_strips",
            Emits::TriangleStrips => "triangle_strips",
        };
        write!(
            f,
            "{emits}, vertices.{}, invocations.{}, max_vertices.{}",
            self.vertices, self.invocations, self.max_vertices
        )?;
        f.write_str(if self.streams { ", streams" } else { "" })
    }
}

impl GeometryFacts {
    /// Notes one word of the text form; false if it is none.
    pub fn set(&mut self, word: &str) -> bool {
        let (name, number) = match word.split_once('.') {
            Some((name, number)) => (name, number.parse().ok()),
            None => (word, None),
        };
        match (name, number) {
            ("streams", None) => self.streams = true,
            ("points", None) => self.emits = Emits::Points,
            ("line_strips", None) => self.emits = Emits::LineStrips,
            ("triangle_strips", None) => self.emits = Emits::TriangleStrips,
            ("vertices", Some(number)) => self.vertices = number,
            ("invocations", Some(number)) => self.invocations = number,
            ("max_vertices", Some(number)) => self.max_vertices = number,
            _ => return false,
        }
        true
    }
}

/// The facts' words in the text form, in order.
impl fmt::Display for FragmentFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut words = Vec::new();
        let flags = [
            (self.early_tests, "early_tests"),
            (self.discards, "discards"),
            (self.writes_memory, "writes_memory"),
            (self.per_sample, "per_sample"),
            (self.reads_attachments, "reads_attachments"),
            (self.post_depth_coverage, "post_depth_coverage"),
            (self.full_quads, "full_quads"),
            (self.writes_sample_mask, "writes_sample_mask"),
            (self.writes_stencil_ref, "writes_stencil_ref"),
            (self.dual_source, "dual_source"),
        ];
        words.extend(flags.iter().filter(|(set, _)| *set).map(|(_, word)| *word));
        words.extend(self.depth.map(|mode| match mode {
            DepthMode::Any => "depth.any",
            DepthMode::Greater => "depth.greater",
            DepthMode::Less => "depth.less",
            DepthMode::Unchanged => "depth.unchanged",
        }));
        words.extend(self.interlock.map(|interlock| match interlock {
            Interlock::PixelOrdered => "interlock.pixel_ordered",
            Interlock::PixelUnordered => "interlock.pixel_unordered",
            Interlock::SampleOrdered => "interlock.sample_ordered",
            Interlock::SampleUnordered => "interlock.sample_unordered",
        }));
        let colors = format!("colors.{}", self.color_mask);
        words.push(&colors);
        f.write_str(&words.join(", "))
    }
}

impl FragmentFacts {
    /// Notes one word of the text form; false if it is none.
    pub fn set(&mut self, word: &str) -> bool {
        match word {
            "early_tests" => self.early_tests = true,
            "discards" => self.discards = true,
            "writes_memory" => self.writes_memory = true,
            "per_sample" => self.per_sample = true,
            "reads_attachments" => self.reads_attachments = true,
            "post_depth_coverage" => self.post_depth_coverage = true,
            "full_quads" => self.full_quads = true,
            "writes_sample_mask" => self.writes_sample_mask = true,
            "writes_stencil_ref" => self.writes_stencil_ref = true,
            "dual_source" => self.dual_source = true,
            "depth.any" => self.depth = Some(DepthMode::Any),
            "depth.greater" => self.depth = Some(DepthMode::Greater),
            "depth.less" => self.depth = Some(DepthMode::Less),
            "depth.unchanged" => self.depth = Some(DepthMode::Unchanged),
            "interlock.pixel_ordered" => self.interlock = Some(Interlock::PixelOrdered),
            "interlock.pixel_unordered" => self.interlock = Some(Interlock::PixelUnordered),
            "interlock.sample_ordered" => self.interlock = Some(Interlock::SampleOrdered),
            "interlock.sample_unordered" => self.interlock = Some(Interlock::SampleUnordered),
            _ => match word.strip_prefix("colors.").map(str::parse) {
                Some(Ok(mask)) => self.color_mask = mask,
                _ => return false,
            },
        }
        true
    }
}
