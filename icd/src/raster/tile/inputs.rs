//! The inputs of fragment programs, sixteen lanes at a time: varyings, planes, built-ins (spec, "Fragment Shader Interpolation").

use spirv_jit::Program;
use spirv_jit::program::{
    AlignedRow, Builtin, InputRow, OutputRow, Passed, Position, Varying, VaryingMode, VaryingPlace,
};

use super::lanes::{Floats, LANE_X, LANE_Y, Row, bits_of, spread, tiered};
use super::samples::{MAX_SAMPLES, from_center, locations};
use crate::raster::primitive::{Plane, Record};

/// One row of inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fill {
    Constant(u32),
    /// A word of the provoking vertex, or of vertex 0 to 2.
    Flat(u32),
    PerVertex(u32, usize),
    /// A word's interpolation.
    Varying(u32, Weights),
    Barycentric(usize, Weights),
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
    SampleCount,
    /// The values, or the derivatives, of planes at the pixel's centre.
    Planes(bool, usize),
}

/// Which barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Weights {
    perspective: bool,
    position: Position,
}

impl Weights {
    fn index(self) -> usize {
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
    fills: Vec<Fill>,
    samples: u32,
    /// Where built-ins are evaluated.
    position: Position,
}

/// What sixteen fragments are: four quads of one or several primitives.
pub struct Fragments<'a> {
    pub records: [&'a Record; 4],
    /// Outputs of the vertices of each quad's chunk.
    pub outputs: [&'a [u32]; 4],
    /// All quads have the same record.
    pub is_uniform: bool,
    /// First pixels of the quads.
    pub x: [i32; 4],
    pub y: [i32; 4],
    /// Samples that the invocations are for, where there is one for each.
    pub sample: [u8; 4],
    /// Covered lanes, by sample.
    pub coverage: &'a [u16; MAX_SAMPLES],
}

impl Inputs {
    /// Links a program to the outputs of the vertex stage. `per_sample`: invocations are for one sample; `everything`: and so are inputs that do not say so.
    pub fn new(
        fragment: &Program,
        vertex: &Program,
        samples: u32,
        per_sample: bool,
        everything: bool,
    ) -> Self {
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
                varying_fill(word_of(vertex, &varying), varying.mode, place)
            }
            InputRow::Barycentric(it) => Fill::Barycentric(
                usize::from(it.vertex.min(2)),
                Weights {
                    perspective: it.perspective,
                    position: place(it.position),
                },
            ),
            InputRow::Builtin(builtin, component) => builtin_fill(builtin, component.into()),
            _ => Fill::Constant(0),
        };
        Self {
            fills: fragment.inputs().iter().map(fill).collect(),
            samples,
            position: match per_sample && samples > 1 {
                true => Position::Sample,
                false => Position::Center,
            },
        }
    }

    /// Of a program that computes nothing, its outputs instead.
    pub fn passed(&self, outputs: &[Passed]) -> Self {
        let fill = |output: &Passed| match *output {
            Passed::Constant(word) => Fill::Constant(word),
            Passed::Input(row) => {
                (self.fills.get(row as usize).copied()).unwrap_or(Fill::Constant(0))
            }
        };
        Self {
            fills: outputs.iter().map(fill).collect(),
            ..*self
        }
    }

    /// Rows to fill.
    pub fn len(&self) -> usize {
        self.fills.len()
    }

    /// Whether rows are the same for all fragments of a primitive.
    pub fn is_constant(&self) -> bool {
        self.fills.iter().all(|fill| {
            matches!(
                fill,
                Fill::Constant(_)
                    | Fill::Flat(_)
                    | Fill::PerVertex(..)
                    | Fill::Front
                    | Fill::Layer
                    | Fill::Viewport
                    | Fill::Primitive
                    | Fill::View
            )
        })
    }

    /// Fills the input rows of a subgroup.
    pub fn fill(
        &self,
        tier: spirv_jit::interp::TierKind,
        fragments: &Fragments<'_>,
        rows: &mut [AlignedRow],
    ) {
        match fragments.is_uniform {
            true => fill_uniform(tier, self, fragments, rows),
            false => fill_mixed(tier, self, fragments, rows),
        }
    }
}

/// The word that a varying comes from; none where the vertex stage does not write it.
fn word_of(vertex: &Program, varying: &Varying) -> Option<u32> {
    let wanted = match varying.place {
        VaryingPlace::Location(location) => OutputRow::Location {
            location,
            component: varying.component,
            index: 0,
        },
        VaryingPlace::ClipDistance => OutputRow::ClipDistance(varying.component),
        VaryingPlace::CullDistance => OutputRow::CullDistance(varying.component),
    };
    let index = vertex.outputs().iter().position(|row| *row == wanted)?;
    Some(index as u32)
}

fn varying_fill(
    word: Option<u32>,
    mode: VaryingMode,
    place: impl Fn(Position) -> Position,
) -> Fill {
    let Some(word) = word else {
        return Fill::Constant(0);
    };
    let weights = |perspective, position| {
        Fill::Varying(
            word,
            Weights {
                perspective,
                position: place(position),
            },
        )
    };
    match mode {
        VaryingMode::Flat => Fill::Flat(word),
        VaryingMode::PerVertex(vertex) => Fill::PerVertex(word, usize::from(vertex.min(2))),
        VaryingMode::Smooth(position) => weights(true, position),
        VaryingMode::Linear(position) => weights(false, position),
    }
}

fn builtin_fill(builtin: Builtin, component: usize) -> Fill {
    match (builtin, component) {
        (Builtin::FragCoord, 0) => Fill::CoordX,
        (Builtin::FragCoord, 1) => Fill::CoordY,
        (Builtin::FragCoord, 2) => Fill::Depth,
        (Builtin::FragCoord, _) => Fill::InverseW,
        (Builtin::FrontFacing, _) => Fill::Front,
        (Builtin::PointCoord, _) => Fill::PointCoord(component.min(1)),
        (Builtin::SampleId, _) => Fill::SampleId,
        (Builtin::SamplePosition, _) => Fill::SamplePosition(component.min(1)),
        (Builtin::SampleMask, _) => Fill::SampleMask,
        (Builtin::Layer | Builtin::AttachmentLayer, _) => Fill::Layer,
        (Builtin::ViewportIndex, _) => Fill::Viewport,
        (Builtin::PrimitiveId, _) => Fill::Primitive,
        (Builtin::ViewIndex, _) => Fill::View,
        (Builtin::SampleCount, _) => Fill::SampleCount,
        (Builtin::PerspectivePlanes, _) => Fill::Planes(true, component.min(8)),
        (Builtin::LinearPlanes, _) => Fill::Planes(false, component.min(8)),
        _ => Fill::Constant(0),
    }
}

tiered! {
    fn fill_uniform(inputs: &Inputs, fragments: &Fragments<'_>, rows: &mut [AlignedRow]) {
        Filling::<true>::new(inputs, fragments).fill(rows);
    }
}

tiered! {
    fn fill_mixed(inputs: &Inputs, fragments: &Fragments<'_>, rows: &mut [AlignedRow]) {
        Filling::<false>::new(inputs, fragments).fill(rows);
    }
}

/// Rows of a subgroup while they are filled. `UNIFORM`: of one record.
struct Filling<'a, const UNIFORM: bool> {
    inputs: &'a Inputs,
    fragments: &'a Fragments<'a>,
    /// By index of [`Weights`]: the coordinates of the second and third vertex, once they are known.
    weights: [Option<[Floats; 2]>; 6],
}

impl<'a, const UNIFORM: bool> Filling<'a, UNIFORM> {
    #[inline(always)]
    fn new(inputs: &'a Inputs, fragments: &'a Fragments<'a>) -> Self {
        Self {
            inputs,
            fragments,
            weights: [None; 6],
        }
    }

    /// A value of each lane's record.
    #[inline(always)]
    fn of_records<T: Copy>(&self, value: impl Fn(&Record) -> T) -> [T; 16] {
        match UNIFORM {
            true => [value(self.fragments.records[0]); 16],
            false => spread(self.fragments.records.map(value)),
        }
    }

    /// A word of a vertex of each lane's record.
    #[inline(always)]
    fn of_vertices(&self, word: u32, vertex: impl Fn(&Record) -> usize) -> Row {
        let fragments = self.fragments;
        let of_quad = |quad: usize| {
            let record = fragments.records[quad];
            let place = record.vertices[vertex(record)].wrapping_add(word) as usize;
            fragments.outputs[quad].get(place).copied().unwrap_or(0)
        };
        match UNIFORM {
            true => [of_quad(0); 16],
            false => spread([of_quad(0), of_quad(1), of_quad(2), of_quad(3)]),
        }
    }

    #[inline(always)]
    fn numbers_of_vertices(&self, word: u32, vertex: usize) -> Floats {
        let row = self.of_vertices(word, |_| vertex);
        super::lanes::floats_of(&row)
    }

    /// Where lanes lie in their pixels, from the centre.
    #[inline(always)]
    fn inside_pixel(&self, position: Position) -> [Floats; 2] {
        let locations = locations(self.inputs.samples);
        let mut places = [[0.0; 16]; 2];
        match position {
            Position::Center => {}
            Position::Sample => {
                let of_quad = |quad: usize, axis: usize| {
                    let sample = usize::from(self.fragments.sample[quad]) % locations.len();
                    from_center(locations[sample])[axis]
                };
                for (axis, row) in places.iter_mut().enumerate() {
                    *row = spread([
                        of_quad(0, axis),
                        of_quad(1, axis),
                        of_quad(2, axis),
                        of_quad(3, axis),
                    ]);
                }
            }
            Position::Centroid => {
                let masks = &self.fragments.coverage[..locations.len()];
                let all = masks.iter().fold(u16::MAX, |all, mask| all & mask);
                for lane in 0..16 {
                    let covers = |mask: &u16| mask >> lane & 1 != 0;
                    let first = masks.iter().position(covers);
                    if let (Some(first), false) = (first, covers(&all)) {
                        let [x, y] = from_center(locations[first]);
                        (places[0][lane], places[1][lane]) = (x, y);
                    }
                }
            }
        }
        places
    }

    /// Coordinates from the records' origins on.
    #[inline(always)]
    fn coordinates(&self, position: Position) -> [Floats; 2] {
        let origin_x = self.of_records(|record| record.origin[0]);
        let origin_y = self.of_records(|record| record.origin[1]);
        let (quads_x, quads_y) = (spread(self.fragments.x), spread(self.fragments.y));
        let [mut x, mut y] = self.inside_pixel(position);
        for lane in 0..16 {
            let from_x = quads_x[lane].wrapping_sub(origin_x[lane]);
            let from_y = quads_y[lane].wrapping_sub(origin_y[lane]);
            x[lane] += from_x.wrapping_add(LANE_X[lane] & 1) as f32;
            y[lane] += from_y.wrapping_add(LANE_Y[lane] & 1) as f32;
        }
        [x, y]
    }

    #[inline(always)]
    fn plane(&self, [x, y]: &[Floats; 2], plane: impl Fn(&Record) -> Plane) -> Floats {
        let planes = self.of_records(plane);
        let mut values = [0.0; 16];
        for lane in 0..16 {
            let Plane { at, dx, dy } = planes[lane];
            values[lane] = at + dx * x[lane] + dy * y[lane];
        }
        values
    }

    /// 1 / w: the sum of the perspective planes.
    #[inline(always)]
    fn inverse_w(&self, at: &[Floats; 2]) -> Floats {
        let planes = [0, 1, 2].map(|vertex| self.plane(at, |record| record.perspective[vertex]));
        let mut sums = [0.0; 16];
        for lane in 0..16 {
            sums[lane] = planes[0][lane] + planes[1][lane] + planes[2][lane];
        }
        sums
    }

    /// Barycentric coordinates of the second and third vertex.
    #[inline(always)]
    fn weights(&mut self, weights: Weights) -> [Floats; 2] {
        if let Some(known) = self.weights[weights.index()] {
            return known;
        }
        let at = self.coordinates(weights.position);
        let found = match weights.perspective {
            false => [1, 2].map(|vertex| self.plane(&at, |record| record.linear[vertex])),
            true => {
                let planes =
                    [0, 1, 2].map(|vertex| self.plane(&at, |record| record.perspective[vertex]));
                let mut found = [[0.0; 16]; 2];
                for lane in 0..16 {
                    let sum = planes[0][lane] + planes[1][lane] + planes[2][lane];
                    found[0][lane] = planes[1][lane] / sum;
                    found[1][lane] = planes[2][lane] / sum;
                }
                found
            }
        };
        self.weights[weights.index()] = Some(found);
        found
    }

    #[inline(always)]
    fn fill(mut self, rows: &mut [AlignedRow]) {
        let inputs = self.inputs;
        for (row, fill) in rows.iter_mut().zip(&inputs.fills) {
            row.0 = self.row(fill);
        }
    }

    #[inline(always)]
    fn row(&mut self, fill: &Fill) -> Row {
        let position = self.inputs.position;
        let fragments = self.fragments;
        match *fill {
            Fill::Constant(word) => [word; 16],
            Fill::Flat(word) => {
                self.of_vertices(word, |record| usize::from(record.provoking.min(2)))
            }
            Fill::PerVertex(word, vertex) => self.of_vertices(word, |_| vertex),
            Fill::Varying(word, weights) => {
                let [second, third] = self.weights(weights);
                let values = [0, 1, 2].map(|vertex| self.numbers_of_vertices(word, vertex));
                let mut row = [0; 16];
                for lane in 0..16 {
                    let [first, at_second, at_third] = values.map(|value| value[lane]);
                    // A varying that is the same at all vertices comes out as it is.
                    let number = first
                        + second[lane] * (at_second - first)
                        + third[lane] * (at_third - first);
                    row[lane] = number.to_bits();
                }
                row
            }
            Fill::Barycentric(vertex, weights) => {
                let [second, third] = self.weights(weights);
                let mut row = [0; 16];
                for lane in 0..16 {
                    let number = match vertex {
                        0 => 1.0 - second[lane] - third[lane],
                        1 => second[lane],
                        _ => third[lane],
                    };
                    row[lane] = number.to_bits();
                }
                row
            }
            Fill::CoordX | Fill::CoordY => {
                let is_x = *fill == Fill::CoordX;
                let [x, y] = self.inside_pixel(position);
                let (from, lanes) = match is_x {
                    true => (fragments.x, &LANE_X),
                    false => (fragments.y, &LANE_Y),
                };
                let (from, inside) = (spread(from), if is_x { x } else { y });
                let mut row = [0; 16];
                for lane in 0..16 {
                    let pixel = (from[lane] + (lanes[lane] & 1)) as f32;
                    row[lane] = (pixel + (0.5 + inside[lane])).to_bits();
                }
                row
            }
            Fill::Depth => {
                let at = self.coordinates(position);
                bits_of(&self.plane(&at, |record| record.depth))
            }
            Fill::InverseW => {
                let at = self.coordinates(position);
                bits_of(&self.inverse_w(&at))
            }
            Fill::PointCoord(axis) => {
                let at = self.coordinates(position);
                bits_of(&self.plane(&at, |record| record.point_coord[axis]))
            }
            Fill::SampleId => spread(fragments.sample.map(u32::from)),
            Fill::SamplePosition(axis) => {
                let inside = self.inside_pixel(position);
                let mut row = [0; 16];
                for lane in 0..16 {
                    row[lane] = (0.5 + inside[axis][lane]).to_bits();
                }
                row
            }
            Fill::SampleMask => self.sample_mask(),
            Fill::Front => self.of_records(|record| u32::from(record.front)),
            Fill::Layer => self.of_records(|record| record.layer),
            Fill::Viewport => self.of_records(|record| record.viewport),
            Fill::Primitive => self.of_records(|record| record.primitive_id),
            Fill::View => self.of_records(|record| record.view_index),
            Fill::SampleCount => [self.inputs.samples; 16],
            Fill::Planes(perspective, index) => self.planes(perspective, index),
        }
    }

    #[inline(always)]
    fn sample_mask(&self) -> Row {
        let mut row = [0; 16];
        for (sample, mask) in (0..self.inputs.samples).zip(self.fragments.coverage) {
            for lane in 0..16 {
                let is_its = self.inputs.position != Position::Sample
                    || u32::from(self.fragments.sample[lane / 4]) == sample;
                row[lane] |= u32::from(is_its && mask >> lane & 1 != 0) << sample;
            }
        }
        row
    }

    #[inline(always)]
    fn planes(&self, perspective: bool, index: usize) -> Row {
        let plane = |record: &Record| match perspective {
            true => record.perspective[index % 3],
            false => record.linear[index % 3],
        };
        match index / 3 {
            0 => bits_of(&self.plane(&self.coordinates(Position::Center), plane)),
            1 => self.of_records(|record| plane(record).dx.to_bits()),
            _ => self.of_records(|record| plane(record).dy.to_bits()),
        }
    }
}

tiered! {
    /// Depths of fragments of one record at a sample: those of its plane, clamped to a range where there is one.
    pub fn depths(record: &Record, x: i32, y: i32, location: [i32; 2], range: Option<[f32; 2]>) -> Floats {
        let [inside_x, inside_y] = from_center(location);
        let from_x = x.wrapping_sub(record.origin[0]);
        let from_y = y.wrapping_sub(record.origin[1]);
        let Plane { at, dx, dy } = record.depth;
        let mut depths = [0.0; 16];
        for lane in 0..16 {
            let x = inside_x + from_x.wrapping_add(LANE_X[lane]) as f32;
            let y = inside_y + from_y.wrapping_add(LANE_Y[lane]) as f32;
            depths[lane] = clamp(at + dx * x + dy * y, range);
        }
        depths
    }
}

/// Clamps a depth to a range, whose ends come in any order.
#[inline(always)]
pub fn clamp(depth: f32, range: Option<[f32; 2]>) -> f32 {
    let Some([near, far]) = range else {
        return depth;
    };
    let (least, most) = if near < far { (near, far) } else { (far, near) };
    let depth = if depth > least { depth } else { least };
    if depth < most { depth } else { most }
}
