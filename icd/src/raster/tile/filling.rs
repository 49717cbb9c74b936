//! The input rows of a wave's fragments, filled row by row: each row is looked up once a wave.

use lanes::vector::Vector;
use spirv_jit::program::{AlignedRow, Position};

use super::coarse::Spread;
use super::inputs::{BarycentricMode, InputRowSource, Inputs, ModeRows, Steps};
use super::interpolation::{interpolate, perspective_weights, plane_at};
use super::lanes::Row;
use super::pack::Pack;
use super::samples::from_center;
use super::shares::{Share, Shares, record_of};
use crate::raster::Chunk;
use crate::raster::primitive::Record;

/// The fragments of a wave.
#[derive(Clone, Copy)]
pub struct WaveFragments<'a> {
    pub chunks: &'a [Chunk],
    pub packs: &'a [Pack],
    /// Of packs whose fragments are of several pixels.
    pub spread: &'a [Spread],
}

/// The input rows of a wave's subgroups.
pub struct InputRows<'a> {
    /// Rows of states, one state after the other.
    pub states: &'a mut [AlignedRow],
    /// Rows of one state, and the first of its inputs.
    pub rows: usize,
    pub first: usize,
}

impl InputRows<'_> {
    #[inline(always)]
    fn of(&mut self, subgroup: usize, row: usize) -> &mut Row {
        &mut self.states[subgroup * self.rows + self.first + row].0
    }

    /// Writes the lanes of a share to one of its subgroup's rows.
    #[inline(always)]
    fn put<V: Vector>(&mut self, v: V, share: &Share, row: usize, words: V::I) {
        let row = self.of(share.subgroup, row);
        let words = match share.lanes {
            u16::MAX => words,
            lanes => v.select(lanes, words, v.load_i(row)),
        };
        v.store_i(words, row);
    }
}

impl Inputs {
    /// Fills all rows of a wave.
    #[inline(always)]
    pub fn fill<V: Vector>(
        &self,
        v: V,
        fragments: WaveFragments<'_>,
        shares: &Shares,
        rows: &mut InputRows<'_>,
    ) {
        for of_mode in &self.modes {
            for share in &shares.list {
                let weights = Filling::new(v, self, fragments, share).weights(of_mode.mode);
                let steps = &shares.steps(share)[of_mode.varyings.clone()];
                self.fill_interpolated(v, share, of_mode, steps, weights, rows);
            }
        }
        let is_center = self.position == Position::Center;
        for (row, fill) in self.fills.iter().enumerate() {
            match *fill {
                InputRowSource::Varying(..) | InputRowSource::Barycentric(..) => {}
                InputRowSource::CoordX if is_center => {
                    self.fill_coordinate(v, fragments.packs, |it| &it.places.x, 0, row, rows);
                }
                InputRowSource::CoordY if is_center => {
                    self.fill_coordinate(v, fragments.packs, |it| &it.places.y, 1, row, rows);
                }
                _ if fill.is_of_primitive() => {
                    for share in &shares.list {
                        let (record, chunk) = record_of(fragments.chunks, share.origin);
                        let word = self.word(fill, record, chunk);
                        rows.put(v, share, row, v.splat_i(word as i32));
                    }
                }
                _ => {
                    for share in &shares.list {
                        let words = Filling::new(v, self, fragments, share).row(fill);
                        rows.put(v, share, row, words);
                    }
                }
            }
        }
    }

    /// Fills x or y of `FragCoord` at the fragments' centres.
    #[inline(always)]
    fn fill_coordinate<V: Vector>(
        &self,
        v: V,
        packs: &[Pack],
        quads: impl Fn(&Pack) -> &[i32; 4],
        axis: usize,
        row: usize,
        rows: &mut InputRows<'_>,
    ) {
        let in_quad = v.load(&self.in_quad[axis]);
        for (subgroup, pack) in packs.iter().enumerate() {
            let quads = v.to_f(v.quads(&quads(pack).map(|it| it as u32)));
            let numbers = v.add(v.add(quads, in_quad), v.splat(0.5));
            v.store(numbers, rows.of(subgroup, row));
        }
    }

    /// Fills the rows of a share that follow from barycentric coordinates of one kind, which stay
    /// in registers.
    #[inline(always)]
    fn fill_interpolated<V: Vector>(
        &self,
        v: V,
        share: &Share,
        of_mode: &ModeRows,
        steps: &[Steps],
        [second, third]: [V::F; 2],
        rows: &mut InputRows<'_>,
    ) {
        let varyings = &self.varyings[of_mode.varyings.clone()];
        for (varying, steps) in varyings.iter().zip(steps) {
            let steps = [v.splat(steps[0]), v.splat(steps[1]), v.splat(steps[2])];
            let numbers = interpolate(v, steps[0], [steps[1], steps[2]], [second, third]);
            rows.put(v, share, varying.row, v.bits_of(numbers));
        }
        for &(row, vertex) in &of_mode.barycentrics {
            let numbers = match vertex {
                0 => v.sub(v.sub(v.splat(1.0), second), third),
                1 => second,
                _ => third,
            };
            rows.put(v, share, row, v.bits_of(numbers));
        }
    }
}

/// The fragments of one share, as if the whole subgroup were of its primitive.
struct Filling<'a, V: Vector> {
    v: V,
    inputs: &'a Inputs,
    pack: &'a Pack,
    record: &'a Record,
    chunk: &'a Chunk,
    spread: Option<&'a Spread>,
}

impl<'a, V: Vector> Filling<'a, V> {
    #[inline(always)]
    fn new(v: V, inputs: &'a Inputs, fragments: WaveFragments<'a>, share: &Share) -> Self {
        let (record, chunk) = record_of(fragments.chunks, share.origin);
        Self {
            v,
            inputs,
            pack: &fragments.packs[share.subgroup],
            record,
            chunk,
            spread: fragments.spread.get(share.subgroup),
        }
    }

    /// Covered lanes, by sample.
    fn coverage(&self) -> &'a [u16] {
        match self.spread {
            Some(spread) => spread.coverage(),
            None => &self.pack.coverage,
        }
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
    #[inline(never)]
    fn samples_in_pixel(&self, position: Position) -> [Row; 2] {
        let locations = &self.inputs.locations;
        let mut places = [[0; 16]; 2];
        match position {
            Position::Center => {}
            Position::Sample => {
                for lane in 0..16 {
                    let sample = usize::from(self.pack.sample[lane / 4]) % locations.len();
                    let [x, y] = from_center(locations[sample]);
                    (places[0][lane], places[1][lane]) = (x.to_bits(), y.to_bits());
                }
            }
            Position::Centroid => {
                let masks = &self.coverage()[..locations.len()];
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
        self.v.quads(&quads.map(|it| it as u32))
    }

    /// Coordinates from the record's origin on.
    #[inline(always)]
    fn coordinates(&self, position: Position) -> [V::F; 2] {
        let v = self.v;
        let places = &self.pack.places;
        let [origin_x, origin_y] = self.record.origin.map(|it| v.splat_i(it.into()));
        let x = v.sub_i(self.of_quads(&places.x), origin_x);
        let y = v.sub_i(self.of_quads(&places.y), origin_y);
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
    fn perspective(&self, at: [V::F; 2]) -> [V::F; 3] {
        let [first, second, third] = &self.record.perspective;
        [
            plane_at(self.v, first, at),
            plane_at(self.v, second, at),
            plane_at(self.v, third, at),
        ]
    }

    /// Barycentric coordinates of the second and third vertex.
    #[inline(always)]
    fn weights(&self, mode: BarycentricMode) -> [V::F; 2] {
        let at = self.coordinates(mode.position);
        if mode.perspective && !self.record.is_affine {
            return perspective_weights(self.v, self.perspective(at));
        }
        let [_, second, third] = self.chunk.linear_of(self.record);
        [plane_at(self.v, second, at), plane_at(self.v, third, at)]
    }

    /// A row that differs among the fragments of a primitive.
    #[inline(always)]
    fn row(&self, fill: &InputRowSource) -> V::I {
        let (v, position) = (self.v, self.inputs.position);
        let places = &self.pack.places;
        match *fill {
            InputRowSource::CoordX => self.coordinate(&places.x, 0),
            InputRowSource::CoordY => self.coordinate(&places.y, 1),
            InputRowSource::Depth => {
                let at = self.coordinates(position);
                v.bits_of(plane_at(v, &self.record.depth, at))
            }
            InputRowSource::InverseW => {
                // The sum of the perspective planes.
                let [first, second, third] = self.perspective(self.coordinates(position));
                v.bits_of(v.add(v.add(first, second), third))
            }
            InputRowSource::PointCoord(axis) => {
                let at = self.coordinates(position);
                let extra = self.chunk.extra_of(self.record);
                v.bits_of(plane_at(v, &extra.point_coord[axis], at))
            }
            InputRowSource::SampleId => v.quads(&self.pack.sample.map(u32::from)),
            InputRowSource::SamplePosition(axis) => {
                let inside = self.inside_pixel(position);
                v.bits_of(v.add(v.splat(0.5), inside[axis]))
            }
            InputRowSource::SampleMask => v.load_i(&self.sample_mask()),
            InputRowSource::Planes(perspective, index) => self.planes(perspective, index),
            // The others are [of a primitive](InputRowSource::is_of_primitive), or follow from its
            // barycentric coordinates.
            _ => v.splat_i(0),
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

    #[inline(never)]
    fn sample_mask(&self) -> Row {
        let mut row = [0; 16];
        for (sample, mask) in (0..self.inputs.locations.len()).zip(self.coverage()) {
            for lane in 0..16 {
                let is_its = self.inputs.position != Position::Sample
                    || usize::from(self.pack.sample[lane / 4]) == sample;
                row[lane] |= u32::from(is_its && mask >> lane & 1 != 0) << sample;
            }
        }
        row
    }

    #[inline(always)]
    fn planes(&self, perspective: bool, index: usize) -> V::I {
        let v = self.v;
        let plane = match perspective {
            true => &self.record.perspective[index % 3],
            false => &self.chunk.linear_of(self.record)[index % 3],
        };
        match index / 3 {
            0 => v.bits_of(plane_at(v, plane, self.coordinates(Position::Center))),
            1 => v.splat_i(plane.dx.to_bits() as i32),
            _ => v.splat_i(plane.dy.to_bits() as i32),
        }
    }
}
