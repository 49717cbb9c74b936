//! Private memory in loops: an array's element for each lane, by a row that each lane names, or
//! that all do. Lanes have words of their own in each row, so that no lane sees another's.

use super::lower::{LEFT, int};
use super::turns::{Lanes, Turns};
use super::{Class, Form, Held, IrOperand, Stretch, Virtual};
use crate::SUBGROUP_SIZE;
use crate::native::encode::{Constant, Encoding};
use crate::native::opcodes::*;

/// Bytes of a row, as a power of two.
const ROW_BYTES: u32 = (4 * SUBGROUP_SIZE).ilog2();

/// The first private row that lanes access, counted from the first one.
#[derive(Clone, Copy)]
pub(crate) enum PrivateRow {
    /// This one exists.
    Fixed(u32),
    /// All lanes name the same.
    Alike(IrOperand),
    Apart(IrOperand),
}

impl Turns {
    /// Loads words of rows that follow one another, of which there are so many in all. Words of
    /// rows past the last are zero.
    pub fn load_private(
        &mut self,
        lanes: Lanes,
        (row, rows): (PrivateRow, u32),
        results: &[Option<IrOperand>],
    ) -> Option<()> {
        self.takes_private()?;
        self.by_halves(|s, half| {
            for (k, result) in (0..).zip(results) {
                let Some(result) = result else {
                    continue;
                };
                let to = match s.private_row(&row, k)? {
                    Found::Fixed(row) => s.access_row(Form::LoadRow(Some(row)), &[]),
                    Found::Alike(row) => s.access_row(Form::LoadRow(None), &[row]),
                    Found::Apart(row) => {
                        let [place, inside] = s.words_of_rows(row, rows, lanes.0[half]);
                        s.access_row(Form::GatherRows, &[place, inside])
                    }
                };
                s.give(result, Held::One(to));
                s.operations += 1;
                s.end_operation();
            }
            Some(())
        })?;
        Some(())
    }

    /// Stores words as [`Self::load_private`] loads them. Those of rows past the last are dropped.
    pub fn store_private(
        &mut self,
        lanes: Lanes,
        (row, rows): (PrivateRow, u32),
        values: &[IrOperand],
    ) -> Option<()> {
        self.takes_private()?;
        self.by_halves(|s, half| {
            for (k, value) in (0..).zip(values) {
                let Held::One(value) = s.operand(value) else {
                    return None;
                };
                let lanes = lanes.0[half];
                match s.private_row(&row, k)? {
                    Found::Fixed(row) => s.access_row(Form::StoreRow(Some(row)), &[lanes, value]),
                    Found::Alike(row) => s.access_row(Form::StoreRow(None), &[lanes, value, row]),
                    Found::Apart(row) => {
                        let [place, inside] = s.words_of_rows(row, rows, lanes);
                        s.access_row(Form::ScatterRows, &[place, inside, value])
                    }
                };
                s.operations += 1;
                s.end_operation();
            }
            Some(())
        })?;
        Some(())
    }
}

/// As [`PrivateRow`], in registers.
enum Found {
    Fixed(u32),
    Alike(Virtual),
    Apart(Virtual),
}

impl Stretch {
    /// The row so many behind another.
    fn private_row(&mut self, row: &PrivateRow, behind: u32) -> Option<Found> {
        let place = match row {
            PrivateRow::Fixed(row) => return Some(Found::Fixed(row + behind)),
            PrivateRow::Alike(place) | PrivateRow::Apart(place) => place,
        };
        let Held::One(mut first) = self.operand(place) else {
            return None;
        };
        if behind > 0 {
            let behind = self.words(behind);
            first = self.commutative(PADDD, first, behind);
        }
        Some(match row {
            PrivateRow::Apart(_) => Found::Apart(first),
            _ => Found::Alike(first),
        })
    }

    /// Where lanes' words are, in bytes from the first row, and the lanes whose row exists.
    fn words_of_rows(&mut self, row: Virtual, rows: u32, lanes: Virtual) -> [Virtual; 2] {
        let last = self.words(rows.saturating_sub(1));
        let exists = self.compare_words(row, last, int::LE, false);
        let inside = self.both(exists, lanes);
        let place = self.shift(PSHIFTD, LEFT, row, ROW_BYTES);
        let first = (self.side() * SUBGROUP_SIZE / 2) as u32;
        let own = std::array::from_fn(|lane| 4 * (first + lane as u32));
        let own = self.constant(Constant::Words(own));
        [self.commutative(PADDD, place, own), inside]
    }

    /// An access to rows of the subgroup that is being written.
    fn access_row(&mut self, form: Form, from: &[Virtual]) -> Virtual {
        let op = match (form, self.encoding) {
            (Form::GatherRows, _) => PGATHERDD,
            _ => PSCATTERDD,
        };
        self.step(Class::Vector, op, form, from)
    }
}

impl Turns {
    /// Notes that rows are accessed; `None` where halves take turns of their own, which have no
    /// number.
    fn takes_private(&mut self) -> Option<()> {
        self.takes_own = true;
        let is_apart = self.stretch.encoding == Encoding::Vex && self.sides() == 1;
        (!is_apart).then_some(())
    }
}
