//! The inputs of fragment programs and their sources: varyings, planes, built-ins (spec,
//! "Fragment Shader Interpolation").

use std::ops::Range;

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::program::{
    Builtin, InputRow, PassThrough, Position, Varying, VaryingMode, VaryingPlace,
};

use super::interpolation::number;
use super::lanes::{LANE_X, LANE_Y, Row};
use super::samples::Locations;
use crate::object::shading_rate::Rate;
use crate::raster::primitive::{Chunk, Record};

/// One row of inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InputRowSource {
    Constant(u32),
    /// A word of the provoking vertex, or of vertex 0 to 2.
    Flat(u32),
    PerVertex(u32, usize),
    /// A word that a mesh program gave to the primitive.
    OfPrimitive(u32),
    /// A word's interpolation.
    Varying(u32, BarycentricMode),
    Barycentric(usize, BarycentricMode),
    /// x or y of the fragment.
    CoordX,
    CoordY,
    Depth,
    InverseW,
    PointCoord(usize),
    SampleId,
    SamplePosition(usize),
    SampleMask,
    Front,
    Layer,
    Viewport,
    Primitive,
    View,
    SampleLocations(usize),
    /// The values, or the derivatives, of planes at the pixel's centre.
    Planes(bool, usize),
}

impl InputRowSource {
    /// Whether a row is the same in all fragments of a primitive.
    pub(super) fn is_of_primitive(self) -> bool {
        matches!(
            self,
            Self::Constant(_)
                | Self::Flat(_)
                | Self::PerVertex(..)
                | Self::OfPrimitive(_)
                | Self::Front
                | Self::Layer
                | Self::Viewport
                | Self::Primitive
                | Self::View
                | Self::SampleLocations(_)
        )
    }
}

/// Which barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BarycentricMode {
    pub(super) perspective: bool,
    pub(super) position: Position,
}

/// A row of inputs that is a word's interpolation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct InterpolatedRow {
    pub row: usize,
    pub word: u32,
}

/// The rows that follow from barycentric coordinates of one kind.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ModeRows {
    pub mode: BarycentricMode,
    /// Of [`Inputs::varyings`].
    pub varyings: Range<usize>,
    /// Rows that are the coordinate of a vertex, and the vertex.
    pub barycentrics: SmallVec<[(usize, usize); 2]>,
}

/// A varying of a primitive: its value at the first vertex, and the differences of the others.
pub type Steps = [f32; 3];

/// How rows are filled: a program's inputs, or the outputs of one that computes nothing.
pub struct Inputs {
    pub(super) fills: Vec<InputRowSource>,
    /// The coordinates that rows need, with those rows.
    pub(super) modes: SmallVec<[ModeRows; 1]>,
    /// The rows that are varyings, by mode.
    pub(super) varyings: Vec<InterpolatedRow>,
    /// Samples of a fragment.
    pub(super) locations: Locations,
    /// Those of a pixel along each axis, [packed](Locations::packed).
    pub(super) packed: [u32; 2],
    /// Lanes' fragments in their quads: columns and rows of the centres, from the quad's first
    /// pixel's centre on.
    pub(super) in_quad: [Row; 2],
    /// Where built-ins are evaluated.
    pub(super) position: Position,
}

/// A row of outputs that only the primitive and the pixel's centre decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slope {
    Constant(u32),
    /// A word of the provoking vertex, or of vertex 0 to 2.
    Flat(u32),
    PerVertex(u32, usize),
    /// A word that a mesh program gave to the primitive.
    OfPrimitive(u32),
    Front,
    Layer,
    Viewport,
    Primitive,
    View,
    /// A word's interpolation, with perspective or without.
    Varying(u32, bool),
}

/// The rows that follow from barycentric coordinates: by mode, and the varyings among them.
fn interpolated(fills: &[InputRowSource]) -> (SmallVec<[ModeRows; 1]>, Vec<InterpolatedRow>) {
    let mut modes: SmallVec<[ModeRows; 1]> = SmallVec::new();
    let mut varyings = Vec::new();
    for fill in fills {
        let (InputRowSource::Varying(_, mode) | InputRowSource::Barycentric(_, mode)) = *fill
        else {
            continue;
        };
        if modes.iter().any(|it| it.mode == mode) {
            continue;
        }
        let first = varyings.len();
        let mut barycentrics = SmallVec::new();
        for (row, fill) in fills.iter().enumerate() {
            match *fill {
                InputRowSource::Varying(word, of) if of == mode => {
                    varyings.push(InterpolatedRow { row, word });
                }
                InputRowSource::Barycentric(vertex, of) if of == mode => {
                    barycentrics.push((row, vertex));
                }
                _ => {}
            }
        }
        modes.push(ModeRows {
            mode,
            varyings: first..varyings.len(),
            barycentrics,
        });
    }
    (modes, varyings)
}

fn slope(fill: &InputRowSource) -> Option<Slope> {
    Some(match *fill {
        InputRowSource::Constant(word) => Slope::Constant(word),
        InputRowSource::Flat(word) => Slope::Flat(word),
        InputRowSource::PerVertex(word, vertex) => Slope::PerVertex(word, vertex),
        InputRowSource::OfPrimitive(word) => Slope::OfPrimitive(word),
        InputRowSource::Front => Slope::Front,
        InputRowSource::Layer => Slope::Layer,
        InputRowSource::Viewport => Slope::Viewport,
        InputRowSource::Primitive => Slope::Primitive,
        InputRowSource::View => Slope::View,
        InputRowSource::Varying(word, weights) if weights.position == Position::Center => {
            Slope::Varying(word, weights.perspective)
        }
        _ => return None,
    })
}

/// Whether coverage decides what a row is.
fn sees_coverage(fill: &InputRowSource) -> bool {
    match fill {
        InputRowSource::Varying(_, weights) | InputRowSource::Barycentric(_, weights) => {
            weights.position == Position::Centroid
        }
        InputRowSource::SampleMask => true,
        _ => false,
    }
}

impl Inputs {
    /// Links a program to the outputs of the stage before it. `locations`: of a pixel's samples;
    /// `per_sample`: invocations are for one
    /// sample; `everything`: and so are inputs that do not say so.
    pub fn new(
        fragment: &Program,
        before: Option<&Program>,
        locations: Locations,
        rate: Rate,
        per_sample: bool,
        everything: bool,
    ) -> Self {
        let packed = [0, 1].map(|axis| locations.packed(axis));
        let locations = match rate.is_one() {
            true => locations,
            false => locations.of_pixels(rate),
        };
        let samples = locations.len();
        let place = |position| match position {
            _ if samples == 1 => Position::Center,
            Position::Center if everything => Position::Sample,
            Position::Sample if !per_sample => Position::Center,
            // The invocation covers one sample: that is where its covered part is.
            Position::Centroid if per_sample => Position::Sample,
            position => position,
        };
        let fill = |row: &InputRow| match *row {
            InputRow::Varying(varying) => {
                let word = word_of(before, &varying);
                let of_vertex = vertex_words(before);
                match (word, varying.place) {
                    (Some(word), VaryingPlace::Primitive(_)) => {
                        InputRowSource::OfPrimitive(word.saturating_sub(of_vertex))
                    }
                    _ => varying_fill(word, varying.mode, place),
                }
            }
            InputRow::Barycentric(it) => InputRowSource::Barycentric(
                usize::from(it.vertex.min(2)),
                BarycentricMode {
                    perspective: it.perspective,
                    position: place(it.position),
                },
            ),
            InputRow::Builtin(Builtin::ShadingRate, _) => InputRowSource::Constant(rate.word()),
            InputRow::Builtin(builtin, component) => builtin_fill(builtin, component.into()),
            _ => InputRowSource::Constant(0),
        };
        let fills: Vec<InputRowSource> = fragment.inputs().iter().map(fill).collect();
        let (modes, varyings) = interpolated(&fills);
        Self {
            modes,
            varyings,
            fills,
            locations,
            packed,
            in_quad: in_quad(rate),
            position: match per_sample && samples > 1 {
                true => Position::Sample,
                false => Position::Center,
            },
        }
    }

    /// Of a program that computes nothing, its outputs instead.
    pub fn pass_through(&self, outputs: &[PassThrough]) -> Self {
        let fill = |output: &PassThrough| match *output {
            PassThrough::Constant(word) => InputRowSource::Constant(word),
            PassThrough::Input(row) => {
                (self.fills.get(row as usize).copied()).unwrap_or(InputRowSource::Constant(0))
            }
        };
        let fills: Vec<InputRowSource> = outputs.iter().map(fill).collect();
        let (modes, varyings) = interpolated(&fills);
        Self {
            modes,
            varyings,
            fills,
            ..*self
        }
    }

    /// Whether coverage decides what rows are.
    pub fn see_coverage(&self) -> bool {
        self.fills.iter().any(sees_coverage)
    }

    /// The slopes of the first `rows` rows for the fragments of one primitive; none if they depend
    /// on more than pixel centres.
    pub fn slopes(&self, rows: usize) -> Option<Vec<Slope>> {
        self.fills.iter().take(rows).map(slope).collect()
    }

    /// Adds the steps of a primitive's varyings, one for each of [`Self::varyings`]. Returns where
    /// the first one is.
    pub fn steps(&self, record: &Record, chunk: &Chunk, steps: &mut Vec<Steps>) -> usize {
        let first_step = steps.len();
        let outputs = &chunk.outputs[..];
        steps.extend(self.varyings.iter().map(|varying| {
            let [first, second, third] = [
                number(outputs, record.vertices[0].wrapping_add(varying.word)),
                number(outputs, record.vertices[1].wrapping_add(varying.word)),
                number(outputs, record.vertices[2].wrapping_add(varying.word)),
            ];
            [first, second - first, third - first]
        }));
        first_step
    }

    /// The word of a row that is [of a primitive](InputRowSource::is_of_primitive).
    pub(super) fn word(&self, fill: &InputRowSource, record: &Record, chunk: &Chunk) -> u32 {
        let of = |first: u32, word: u32| {
            let place = first.wrapping_add(word) as usize;
            chunk.outputs.get(place).copied().unwrap_or(0)
        };
        match *fill {
            InputRowSource::Constant(word) => word,
            InputRowSource::Flat(word) => {
                of(record.vertices[usize::from(record.provoking.min(2))], word)
            }
            InputRowSource::PerVertex(word, vertex) => of(record.vertices[vertex], word),
            InputRowSource::OfPrimitive(word) => of(record.words, word),
            InputRowSource::Front => record.front.into(),
            InputRowSource::Layer => record.layer.into(),
            InputRowSource::Viewport => record.viewport.into(),
            InputRowSource::Primitive => record.primitive_id,
            InputRowSource::View => record.view_index.into(),
            InputRowSource::SampleLocations(axis) => self.packed[axis],
            _ => 0,
        }
    }
}

/// Columns and rows of the lanes' centres in a quad of fragments.
fn in_quad(rate: Rate) -> [Row; 2] {
    [LANE_X, LANE_Y].map(|lanes| {
        let axis = usize::from(lanes == LANE_Y);
        let size = rate.pixels()[axis] as f32;
        lanes.map(|lane| ((lane & 1) as f32 * size + (size - 1.0) / 2.0).to_bits())
    })
}

/// The word that a varying comes from; none where the stage before does not write it.
fn word_of(before: Option<&Program>, varying: &Varying) -> Option<u32> {
    let wanted = varying.output();
    let index = before?.outputs().iter().position(|row| *row == wanted)?;
    Some(index as u32)
}

/// Words of a vertex of a mesh program, which those of a primitive follow.
pub fn vertex_words(before: Option<&Program>) -> u32 {
    let facts = before.and_then(Program::mesh);
    facts.map_or(0, |facts| facts.vertices.len() as u32)
}

fn varying_fill(
    word: Option<u32>,
    mode: VaryingMode,
    place: impl Fn(Position) -> Position,
) -> InputRowSource {
    let Some(word) = word else {
        return InputRowSource::Constant(0);
    };
    let weights = |perspective, position| {
        InputRowSource::Varying(
            word,
            BarycentricMode {
                perspective,
                position: place(position),
            },
        )
    };
    match mode {
        VaryingMode::Flat => InputRowSource::Flat(word),
        VaryingMode::PerVertex(vertex) => {
            InputRowSource::PerVertex(word, usize::from(vertex.min(2)))
        }
        VaryingMode::Smooth(position) => weights(true, position),
        VaryingMode::Linear(position) => weights(false, position),
    }
}

fn builtin_fill(builtin: Builtin, component: usize) -> InputRowSource {
    match (builtin, component) {
        (Builtin::FragCoord, 0) => InputRowSource::CoordX,
        (Builtin::FragCoord, 1) => InputRowSource::CoordY,
        (Builtin::FragCoord, 2) => InputRowSource::Depth,
        (Builtin::FragCoord, _) => InputRowSource::InverseW,
        (Builtin::FrontFacing, _) => InputRowSource::Front,
        (Builtin::PointCoord, _) => InputRowSource::PointCoord(component.min(1)),
        (Builtin::SampleId, _) => InputRowSource::SampleId,
        (Builtin::SamplePosition, _) => InputRowSource::SamplePosition(component.min(1)),
        (Builtin::SampleMask, _) => InputRowSource::SampleMask,
        (Builtin::Layer | Builtin::AttachmentLayer, _) => InputRowSource::Layer,
        (Builtin::ViewportIndex, _) => InputRowSource::Viewport,
        (Builtin::PrimitiveId, _) => InputRowSource::Primitive,
        (Builtin::ViewIndex, _) => InputRowSource::View,
        (Builtin::SampleLocations, _) => InputRowSource::SampleLocations(component.min(1)),
        (Builtin::PerspectivePlanes, _) => InputRowSource::Planes(true, component.min(8)),
        (Builtin::LinearPlanes, _) => InputRowSource::Planes(false, component.min(8)),
        _ => InputRowSource::Constant(0),
    }
}
