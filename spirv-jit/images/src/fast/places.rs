//! Where the lanes of a chunk sample: coordinates along the axes of the image or of a face, and
//! layers.

use lanes::Row;
use lanes::vector::{Task, Vector};

use super::super::chunk::ChunkRows;
use super::super::cube;
use super::super::rows::Wave;
use super::Fast;
use super::levels::LevelRows;

/// Where a level is sampled, and which one.
pub(super) type At<'b> = (&'b Places, Option<&'b LevelRows>);

/// Places of the lanes of a chunk.
pub(super) struct Places {
    /// Where these are not the operands' coordinates: on faces of cubes, along footprints.
    pub coordinates: [ChunkRows; 3],
    pub has_coordinates: bool,
    /// Byte offsets of the layers.
    pub layers: ChunkRows,
    /// On cubes: the layers of first faces, and the faces.
    pub first_faces: ChunkRows,
    pub faces: ChunkRows,
}

impl Places {
    #[inline(always)]
    pub fn new(has_coordinates: bool) -> Places {
        Places {
            coordinates: [const { ChunkRows::new() }; 3],
            has_coordinates,
            layers: ChunkRows::new(),
            first_faces: ChunkRows::new(),
            faces: ChunkRows::new(),
        }
    }

    /// The coordinates along an axis.
    ///
    /// # Safety
    /// As [`Wave::mask`]; coordinates were put where they are not the operands.
    #[inline(always)]
    pub unsafe fn coordinate<'w>(
        &'w self,
        wave: &'w Wave<'_>,
        index: usize,
        axis: usize,
    ) -> &'w Row {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match self.has_coordinates {
                true => self.coordinates[axis].row(index),
                false => wave.operand(index, axis),
            }
        }
    }
}

impl Fast<'_> {
    /// Whether lanes sample layers, of arrays or of cubes.
    #[inline(always)]
    pub(super) fn has_layers(&self) -> bool {
        self.is_cube || self.op.arrayed
    }
}

/// Puts layers, and the places on cubes, where the image has layers.
pub(super) struct PutPlaces<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub places: &'b mut Places,
}

impl<V: Vector> Task<V> for PutPlaces<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let places = self.places;
        let layers = fast.image.layer_count.max(1) as i32;
        let stride = v.splat_i(fast.image.layer_stride_bytes as i32);
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller keeps the contract of `Fast::sample`.
            unsafe {
                if !fast.is_cube {
                    let coordinate = wave.operand(index, fast.spatial);
                    let layer = nearest_layer(v, coordinate, layers - 1);
                    places.layers.put(v, index, v.mul_i(layer, stride));
                    continue;
                }
                let direction = [
                    v.load(wave.operand(index, 0)),
                    v.load(wave.operand(index, 1)),
                    v.load(wave.operand(index, 2)),
                ];
                let ([s, t], face) = cube::place_in_vectors(v, direction);
                let first_face = match fast.op.arrayed {
                    true => {
                        let last = (layers / 6).max(1) - 1;
                        let cube = nearest_layer(v, wave.operand(index, 3), last);
                        v.mul_i(cube, v.splat_i(6))
                    }
                    false => v.splat_i(0),
                };
                let layer = v.min_i(v.add_i(first_face, face), v.splat_i(layers - 1));
                places.coordinates[0].put(v, index, v.bits_of(s));
                places.coordinates[1].put(v, index, v.bits_of(t));
                places.layers.put(v, index, v.mul_i(layer, stride));
                places.first_faces.put(v, index, first_face);
                places.faces.put(v, index, face);
            }
        }
    }
}

/// The nearest layer to a coordinate ("Array Layer Selection").
#[inline(always)]
fn nearest_layer<V: Vector>(v: V, coordinate: &Row, last: i32) -> V::I {
    let layer = v.round_ties_even(v.load(coordinate));
    let layer = v.max(layer, v.splat(0.0));
    v.to_i(v.min(layer, v.splat(last as f32)))
}
