//! The input rows of a subgroup of fragments, filled.

use lanes::vector::Vector;
use spirv_jit::program::{AlignedRow, Position};

use super::inputs::{BarycentricMode, Fragments, InputRowSource, Inputs, Steps};
use super::interpolation::{interpolate, perspective_weights};
use super::lanes::{Row, lanes_of};
use super::samples::from_center;
use crate::raster::primitive::{PlaneEquation, Record};

impl Inputs {
    /// Fills the input rows of a subgroup of one primitive, with its [`Self::steps`]; or some of
    /// their lanes, without the rows of `held`, a bit each, which are filled already.
    #[inline(always)]
    pub fn fill_uniform<V: Vector>(
        &self,
        v: V,
        fragments: &Fragments<'_>,
        steps: &Steps,
        (lanes, held): (u16, u64),
        rows: &mut [AlignedRow],
    ) {
        let mut filling = Filling::<V, true>::new(v, self, fragments, &steps.rows);
        (filling.lanes, filling.held) = (lanes, held);
        filling.constant = steps.constant;
        filling.fill(rows);
    }

    /// Fills those of a subgroup of several.
    #[inline(always)]
    pub fn fill_mixed<V: Vector>(&self, v: V, fragments: &Fragments<'_>, rows: &mut [AlignedRow]) {
        Filling::<V, false>::new(v, self, fragments, &[]).fill(rows);
    }
}

/// Whether a row is one of the first ones that have a bit.
#[inline(always)]
fn is_in(rows: u64, row: usize) -> bool {
    rows >> (row & 63) & 1 != 0
}

/// Rows of a subgroup while they are filled. `UNIFORM`: of one record.
struct Filling<'a, V: Vector, const UNIFORM: bool> {
    v: V,
    inputs: &'a Inputs,
    fragments: &'a Fragments<'a>,
    /// Of one record.
    steps: &'a [[f32; 3]],
    /// The lanes that are filled.
    lanes: u16,
    /// Rows that are not filled, and those whose varying is constant: a bit each.
    held: u64,
    constant: u64,
    /// By index of [`BarycentricMode`]: the coordinates of the second and third vertex, once they
    /// are known.
    weights: [Option<[V::F; 2]>; 6],
}

impl<'a, V: Vector, const UNIFORM: bool> Filling<'a, V, UNIFORM> {
    #[inline(always)]
    fn new(v: V, inputs: &'a Inputs, fragments: &'a Fragments<'a>, steps: &'a [[f32; 3]]) -> Self {
        Self {
            v,
            inputs,
            fragments,
            steps,
            lanes: u16::MAX,
            held: 0,
            constant: 0,
            weights: [None; 6],
        }
    }

    /// A value of each lane's quad.
    #[inline(always)]
    fn by_quad(&self, value: impl Fn(usize) -> u32) -> V::I {
        match UNIFORM {
            true => self.v.splat_i(value(0) as i32),
            false => self.v.quads(&[value(0), value(1), value(2), value(3)]),
        }
    }

    /// A value of each lane's record.
    #[inline(always)]
    fn of_records(&self, value: impl Fn(&Record) -> u32) -> V::I {
        self.by_quad(|quad| value(self.fragments.records[quad]))
    }

    #[inline(always)]
    fn number_by_quad(&self, value: impl Fn(usize) -> f32) -> V::F {
        (self.v).bits_to_f(self.by_quad(|quad| value(quad).to_bits()))
    }

    /// A word of a vertex, or of the primitive, of each lane's record, by its first word.
    #[inline(always)]
    fn of_vertices(&self, word: u32, first: impl Fn(&Record) -> u32) -> V::I {
        let fragments = self.fragments;
        let of = |quad: usize| {
            let record = fragments.records[quad];
            let place = first(record).wrapping_add(word) as usize;
            fragments.chunks[quad]
                .outputs
                .get(place)
                .copied()
                .unwrap_or(0)
        };
        // Not in a loop: that would put them together in memory, where a load waits for the stores.
        match UNIFORM {
            true => self.v.splat_i(of(0) as i32),
            false => self.v.quads(&[of(0), of(1), of(2), of(3)]),
        }
    }

    #[inline(always)]
    fn numbers_of_vertices(&self, word: u32, vertex: usize) -> V::F {
        (self.v).bits_to_f(self.of_vertices(word, |record| record.vertices[vertex]))
    }

    /// Where lanes lie in their fragments, from the centre.
    #[inline(always)]
    fn inside_pixel(&self, position: Position) -> [V::F; 2] {
        let v = self.v;
        if position == Position::Center {
            return [v.splat(0.0); 2];
        }
        let places = self.samples_in_pixel(position);
        [v.load(&places[0]), v.load(&places[1])]
    }

    /// The same of invocations for a sample, and of centroids.
    #[inline(always)]
    fn samples_in_pixel(&self, position: Position) -> [Row; 2] {
        let locations = &self.inputs.locations;
        let mut places = [[0; 16]; 2];
        match position {
            Position::Center => {}
            Position::Sample => {
                for lane in 0..16 {
                    let sample = usize::from(self.fragments.sample[lane / 4]) % locations.len();
                    let [x, y] = from_center(locations[sample]);
                    (places[0][lane], places[1][lane]) = (x.to_bits(), y.to_bits());
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
                        (places[0][lane], places[1][lane]) = (x.to_bits(), y.to_bits());
                    }
                }
            }
        }
        places
    }

    /// The first column or row of each lane's quad.
    #[inline(always)]
    fn of_quads(&self, quads: &[i32; 4]) -> V::I {
        let [a, b, c, d] = *quads;
        self.v.quads(&[a as u32, b as u32, c as u32, d as u32])
    }

    /// Coordinates from the records' origins on.
    #[inline(always)]
    fn coordinates(&self, position: Position) -> [V::F; 2] {
        let v = self.v;
        let origin_x = self.of_records(|record| i32::from(record.origin[0]) as u32);
        let origin_y = self.of_records(|record| i32::from(record.origin[1]) as u32);
        let x = v.sub_i(self.of_quads(self.fragments.x), origin_x);
        let y = v.sub_i(self.of_quads(self.fragments.y), origin_y);
        // Exact: records start within 2²¹ pixels, and halves fit beside that.
        let x = v.add(v.to_f(x), v.load(&self.inputs.in_quad[0]));
        let y = v.add(v.to_f(y), v.load(&self.inputs.in_quad[1]));
        if position == Position::Center {
            return [x, y];
        }
        let inside = self.inside_pixel(position);
        [v.add(inside[0], x), v.add(inside[1], y)]
    }

    #[inline(always)]
    fn plane(&self, [x, y]: [V::F; 2], plane: impl Fn(usize) -> PlaneEquation) -> V::F {
        let v = self.v;
        let at = self.number_by_quad(|quad| plane(quad).at);
        let dx = self.number_by_quad(|quad| plane(quad).dx);
        let dy = self.number_by_quad(|quad| plane(quad).dy);
        v.add(v.add(at, v.mul(dx, x)), v.mul(dy, y))
    }

    #[inline(always)]
    fn perspective(&self, at: [V::F; 2]) -> [V::F; 3] {
        let records = &self.fragments.records;
        [
            self.plane(at, |quad| records[quad].perspective[0]),
            self.plane(at, |quad| records[quad].perspective[1]),
            self.plane(at, |quad| records[quad].perspective[2]),
        ]
    }

    /// 1 / w: the sum of the perspective planes.
    #[inline(always)]
    fn inverse_w(&self, at: [V::F; 2]) -> V::F {
        let [first, second, third] = self.perspective(at);
        self.v.add(self.v.add(first, second), third)
    }

    #[inline(always)]
    fn linear(&self, at: [V::F; 2]) -> [V::F; 2] {
        let fragments = self.fragments;
        if UNIFORM {
            let linear = fragments.linear(0);
            return [self.plane(at, |_| linear[1]), self.plane(at, |_| linear[2])];
        }
        let linear = [
            fragments.linear(0),
            fragments.linear(1),
            fragments.linear(2),
            fragments.linear(3),
        ];
        [
            self.plane(at, |quad| linear[quad][1]),
            self.plane(at, |quad| linear[quad][2]),
        ]
    }

    /// A bit a quad whose perspective-correct coordinates are the linear ones.
    #[inline(always)]
    fn affine_quads(&self) -> u32 {
        let records = &self.fragments.records;
        if UNIFORM {
            return if records[0].is_affine { 0xf } else { 0 };
        }
        (0..4).fold(0, |quads, quad| {
            quads | u32::from(records[quad].is_affine) << quad
        })
    }

    /// Barycentric coordinates of the second and third vertex.
    #[inline(always)]
    fn weights(&mut self, weights: BarycentricMode) -> [V::F; 2] {
        if let Some(known) = self.weights[weights.index()] {
            return known;
        }
        let at = self.coordinates(weights.position);
        let affine = match weights.perspective {
            true => self.affine_quads(),
            false => 0xf,
        };
        let found = match affine {
            0xf => self.linear(at),
            0 => perspective_weights(self.v, self.perspective(at)),
            _ => {
                let (v, lanes) = (self.v, lanes_of(affine));
                let [a, b] = self.linear(at);
                let [c, d] = perspective_weights(v, self.perspective(at));
                [
                    v.bits_to_f(v.select(lanes, v.bits_of(a), v.bits_of(c))),
                    v.bits_to_f(v.select(lanes, v.bits_of(b), v.bits_of(d))),
                ]
            }
        };
        self.weights[weights.index()] = Some(found);
        found
    }

    #[inline(always)]
    fn fill(mut self, rows: &mut [AlignedRow]) {
        let inputs = self.inputs;
        let Some(common) = inputs.common else {
            for (index, (row, fill)) in rows.iter_mut().zip(&inputs.fills).enumerate() {
                let words = self.row(index, fill);
                self.put(words, row);
            }
            return;
        };
        // Once, and kept in registers: as one of `self.weights` they would be looked up in memory
        // for each row.
        let weights = self.weights(common);
        for (index, (row, fill)) in rows.iter_mut().zip(&inputs.fills).enumerate() {
            let words = match *fill {
                InputRowSource::Varying(..) if is_in(self.held, index) => continue,
                InputRowSource::Varying(..) if is_in(self.constant, index) => {
                    let [first, ..] = self.steps[index];
                    self.v.bits_of(self.v.splat(first))
                }
                InputRowSource::Varying(word, _) => self.varying(index, word, weights),
                _ => self.row(index, fill),
            };
            self.put(words, row);
        }
    }

    #[inline(always)]
    fn put(&self, words: V::I, row: &mut AlignedRow) {
        let v = self.v;
        let words = match self.lanes {
            u16::MAX => words,
            lanes => v.select(lanes, words, v.load_i(&row.0)),
        };
        v.store_i(words, &mut row.0);
    }

    /// A word's interpolation, for the row of that index.
    #[inline(always)]
    fn varying(&self, index: usize, word: u32, weights: [V::F; 2]) -> V::I {
        let v = self.v;
        if UNIFORM {
            let [first, second, third] = self.steps[index];
            let (first, steps) = (v.splat(first), [v.splat(second), v.splat(third)]);
            return v.bits_of(interpolate(v, first, steps, weights));
        }
        let first = self.numbers_of_vertices(word, 0);
        let second = v.sub(self.numbers_of_vertices(word, 1), first);
        let third = v.sub(self.numbers_of_vertices(word, 2), first);
        v.bits_of(interpolate(v, first, [second, third], weights))
    }

    #[inline(always)]
    fn row(&mut self, index: usize, fill: &InputRowSource) -> V::I {
        let v = self.v;
        let position = self.inputs.position;
        let fragments = self.fragments;
        match *fill {
            InputRowSource::Constant(word) => v.splat_i(word as i32),
            InputRowSource::Flat(word) => {
                self.of_vertices(word, |it| it.vertices[usize::from(it.provoking.min(2))])
            }
            InputRowSource::PerVertex(word, vertex) => {
                self.of_vertices(word, |record| record.vertices[vertex])
            }
            InputRowSource::OfPrimitive(word) => self.of_vertices(word, |record| record.words),
            InputRowSource::Varying(word, weights) => {
                let weights = self.weights(weights);
                self.varying(index, word, weights)
            }
            InputRowSource::Barycentric(vertex, weights) => {
                let [second, third] = self.weights(weights);
                v.bits_of(match vertex {
                    0 => v.sub(v.sub(v.splat(1.0), second), third),
                    1 => second,
                    _ => third,
                })
            }
            InputRowSource::CoordX => self.coordinate(fragments.x, 0),
            InputRowSource::CoordY => self.coordinate(fragments.y, 1),
            InputRowSource::Depth => {
                let at = self.coordinates(position);
                v.bits_of(self.plane(at, |quad| fragments.records[quad].depth))
            }
            InputRowSource::InverseW => {
                let at = self.coordinates(position);
                v.bits_of(self.inverse_w(at))
            }
            InputRowSource::PointCoord(axis) => {
                let at = self.coordinates(position);
                let extra = |quad: usize| {
                    let record = fragments.records[quad];
                    fragments.chunks[quad].extra_of(record)
                };
                v.bits_of(self.plane(at, |quad| extra(quad).point_coord[axis]))
            }
            InputRowSource::SampleId => {
                let [a, b, c, d] = *fragments.sample;
                v.quads(&[a.into(), b.into(), c.into(), d.into()])
            }
            InputRowSource::SamplePosition(axis) => {
                let inside = self.inside_pixel(position);
                v.bits_of(v.add(v.splat(0.5), inside[axis]))
            }
            InputRowSource::SampleMask => v.load_i(&self.sample_mask()),
            InputRowSource::Front => self.of_records(|record| u32::from(record.front)),
            InputRowSource::Layer => self.of_records(|record| record.layer.into()),
            InputRowSource::Viewport => self.of_records(|record| record.viewport.into()),
            InputRowSource::Primitive => self.of_records(|record| record.primitive_id),
            InputRowSource::View => self.of_records(|record| record.view_index.into()),
            InputRowSource::SampleLocations(axis) => v.splat_i(self.inputs.packed[axis] as i32),
            InputRowSource::Planes(perspective, index) => self.planes(perspective, index),
        }
    }

    /// x or y of `FragCoord`.
    #[inline(always)]
    fn coordinate(&self, quads: &[i32; 4], axis: usize) -> V::I {
        let v = self.v;
        let inside = self.inside_pixel(self.inputs.position)[axis];
        let quads = v.to_f(self.of_quads(quads));
        let center = v.add(quads, v.load(&self.inputs.in_quad[axis]));
        v.bits_of(v.add(center, v.add(v.splat(0.5), inside)))
    }

    #[inline(always)]
    fn sample_mask(&self) -> Row {
        let mut row = [0; 16];
        for (sample, mask) in (0..self.inputs.locations.len()).zip(self.fragments.coverage) {
            for lane in 0..16 {
                let is_its = self.inputs.position != Position::Sample
                    || usize::from(self.fragments.sample[lane / 4]) == sample;
                row[lane] |= u32::from(is_its && mask >> lane & 1 != 0) << sample;
            }
        }
        row
    }

    #[inline(always)]
    fn planes(&self, perspective: bool, index: usize) -> V::I {
        let fragments = self.fragments;
        let plane = |quad: usize| match perspective {
            true => fragments.records[quad].perspective[index % 3],
            false => fragments.linear(quad)[index % 3],
        };
        match index / 3 {
            0 => {
                let at = self.coordinates(Position::Center);
                self.v.bits_of(self.plane(at, plane))
            }
            1 => self.by_quad(|quad| plane(quad).dx.to_bits()),
            _ => self.by_quad(|quad| plane(quad).dy.to_bits()),
        }
    }
}
