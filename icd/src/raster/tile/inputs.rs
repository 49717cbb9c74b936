//! The inputs of fragment programs and their sources: varyings, planes, built-ins (spec,
//! "Fragment Shader Interpolation").

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::program::{
    Builtin, InputRow, PassThrough, Position, Varying, VaryingMode, VaryingPlace,
};

use super::interpolation::number;
use super::lanes::{LANE_X, LANE_Y, Row};
use super::samples::Locations;
use crate::object::shading_rate::Rate;
use crate::raster::primitive::{Chunk, PlaneEquation, Record};

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

/// Which barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BarycentricMode {
    pub(super) perspective: bool,
    pub(super) position: Position,
}

impl BarycentricMode {
    pub(super) fn index(self) -> usize {
        let position = match self.position {
            Position::Center => 0,
            Position::Centroid => 1,
            Position::Sample => 2,
        };
        position + if self.perspective { 3 } else { 0 }
    }
}

/// How rows are filled: a program's inputs, or the outputs of one that computes nothing.
pub struct Inputs {
    pub(super) fills: Vec<InputRowSource>,
    /// The rows that are varyings, and their words.
    varyings: Vec<(usize, u32)>,
    /// The coordinates of the varyings, where all have the same.
    pub(super) common: Option<BarycentricMode>,
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

/// The coordinates of all varyings, if there is one and they are the same.
fn common(fills: &[InputRowSource]) -> Option<BarycentricMode> {
    let mut weights = fills.iter().filter_map(|fill| match *fill {
        InputRowSource::Varying(_, weights) => Some(weights),
        _ => None,
    });
    let first = weights.next()?;
    weights.all(|other| other == first).then_some(first)
}

/// The rows that are varyings, and their words.
fn varyings(fills: &[InputRowSource]) -> Vec<(usize, u32)> {
    let of_rows = fills.iter().enumerate();
    let words = of_rows.filter_map(|(row, fill)| match *fill {
        InputRowSource::Varying(word, _) => Some((row, word)),
        _ => None,
    });
    words.collect()
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

/// The varyings of one primitive.
#[derive(Default)]
pub struct Steps {
    /// By row of inputs, of a varying: its value at the first vertex, and the differences of the
    /// others. Other rows hold anything.
    pub rows: SmallVec<[[f32; 3]; 16]>,
    /// A bit for each of the first rows: the varying has the bits of the first vertex everywhere.
    pub constant: u64,
}

impl Steps {
    /// The rows that are constant in both, with the same value.
    pub fn shared(&self, other: &Self) -> u64 {
        let mut shared = self.constant & other.constant;
        let mut left = shared;
        while left != 0 {
            let row = left.trailing_zeros() as usize;
            left &= left - 1;
            let [first, second] = [self.rows[row][0], other.rows[row][0]];
            if first.to_bits() != second.to_bits() {
                shared &= !(1 << row);
            }
        }
        shared
    }
}

/// Bits of −0.
const NEGATIVE_ZERO: u32 = 0x8000_0000;

/// Numbers of planes up to which all sums and products in the coordinates of pixels are finite.
const TAME: f32 = 1e20;

/// Whether the weights of a primitive's vertices are finite at all pixels.
#[inline(always)]
fn is_tame(record: &Record) -> bool {
    let [_, second, third] = &record.perspective;
    let size = |it: &PlaneEquation| it.at.abs() + it.dx.abs() + it.dy.abs();
    record.is_affine && size(second) + size(third) < TAME
}

/// Sixteen fragments: four quads of one or several primitives.
pub struct Fragments<'a> {
    pub records: [&'a Record; 4],
    /// Of each quad's record.
    pub chunks: [&'a Chunk; 4],
    /// First pixels of the quads.
    pub x: &'a [i32; 4],
    pub y: &'a [i32; 4],
    /// Samples that the invocations are for, where there is one for each.
    pub sample: &'a [u8; 4],
    /// Covered lanes, by sample.
    pub coverage: &'a [u16],
}

impl<'a> Fragments<'a> {
    /// λᵢ of a quad's record (`NoPerspective`).
    #[inline(always)]
    pub fn linear(&self, quad: usize) -> &'a [PlaneEquation; 3] {
        self.chunks[quad].linear_of(self.records[quad])
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
        Self {
            common: common(&fills),
            varyings: varyings(&fills),
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
        Self {
            common: common(&fills),
            varyings: varyings(&fills),
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

    /// The steps from which the varyings of one primitive's fragments are computed.
    pub fn steps(&self, record: &Record, chunk: &Chunk, steps: &mut Steps) {
        let outputs = &chunk.outputs[..];
        steps.rows.resize(self.fills.len(), [0.0; 3]);
        let rows = &mut steps.rows[..];
        let mut constant = 0;
        for &(row, word) in &self.varyings {
            let [first, second, third] = [
                number(outputs, record.vertices[0].wrapping_add(word)),
                number(outputs, record.vertices[1].wrapping_add(word)),
                number(outputs, record.vertices[2].wrapping_add(word)),
            ];
            let (second, third) = (second - first, third - first);
            rows[row] = [first, second, third];
            // A negative zero plus a positive one is a positive one.
            let is_constant = (second == 0.0) & (third == 0.0) & (first.to_bits() != NEGATIVE_ZERO);
            constant |= u64::from(is_constant) << (row & 63);
        }
        let is_exact = rows.len() <= 64 && is_tame(record);
        steps.constant = if is_exact { constant } else { 0 };
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
