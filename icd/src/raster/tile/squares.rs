//! Squares that a primitive covers as a whole: straight to the wave.

use super::coverage::Square;
use super::pack::{Origin, Pack};
use super::plan::{Fragment, Order};
use super::samples::{any, count};
use super::visit::{Current, Visit};
use crate::raster::primitive::Record;
use crate::wave::Stopped;

impl<'a> Visit<'a> {
    /// Adds the fragments of squares to the wave; no test comes before the program.
    pub(super) fn squares(
        &mut self,
        current: Current<'a>,
        fragment: &Fragment<'_>,
        origin: Origin,
        record: &Record,
        squares: &[Square],
    ) -> Result<(), Stopped> {
        let Current {
            plan, is_counted, ..
        } = current;
        let masks = plan.whole();
        if any(&masks) == 0 {
            return Ok(());
        }
        let whole = Pack::whole(origin, record.layer.into(), &masks);
        let corner = [self.bounds.left, self.bounds.top];
        for square in squares {
            let ([left, top], size) = (square.place(corner), i32::from(square.size));
            if is_counted && plan.order == Order::Early {
                self.counts.samples += (size * size / 16) as u64 * count(&masks);
            }
            for y in (top..top + size).step_by(4) {
                for x in (left..left + size).step_by(4) {
                    self.worker.packs.add_whole(&whole, [x, y]);
                    if self.worker.packs.packs.len() >= fragment.subgroups {
                        self.run_wave()?;
                    }
                }
            }
        }
        Ok(())
    }
}
