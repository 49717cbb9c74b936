//! Derivatives of the coordinates of samples, along the screen.

use lanes::vector::{Portable, Vector};
use lanes::{LANES, LaneMask, Row, quad};

use super::ImageOp;

/// The derivatives of a sample's coordinates, of which it has one to three: in x, then in y.
#[inline(always)]
pub(super) fn derivatives<V: Vector>(v: V, op: &ImageOp, rows: &[&Row], active: u16) -> [Row; 6] {
    let spatial = op.spatial_count().min(3);
    let mut derived = [[0; LANES]; 6];
    for axis in 0..spatial {
        let coordinate = v.load(rows[axis]);
        v.store(
            v.derivative::<{ quad::X }>(coordinate, active),
            &mut derived[axis],
        );
        let y = v.derivative::<{ quad::Y }>(coordinate, active);
        v.store(y, &mut derived[spatial + axis]);
    }
    derived
}

/// The derivatives of a sample's coordinates where no tier is chosen: the first operand rows are
/// the coordinates.
pub fn derivatives_of(op: &ImageOp, rows: &[&Row], active: LaneMask) -> [Row; 6] {
    derivatives(Portable, op, rows, active.bits())
}

/// Puts derivatives in the place of their operands.
#[inline(always)]
pub fn put_derivatives<'r>(op: &ImageOp, derived: &'r [Row; 6], rows: &mut [&'r Row]) {
    let places = &mut rows[op.rows_before_lod()..];
    for (place, row) in places.iter_mut().zip(derived).take(2 * op.spatial_count()) {
        *place = row;
    }
}
