//! The rows that the subgroups of a wave read and write.

use lanes::vector::Vector;
use lanes::{LANES, LaneMask, Row};

use super::ImageOp;

/// Most operand rows of an operation that is done here: four coordinates, a reference for depths,
/// six derivatives and three offsets, and room.
pub const MAX_OPERANDS: usize = 16;

/// The rows of an operand or a result, one for each subgroup of a wave.
#[derive(Clone, Copy)]
pub struct Rows {
    /// The row of subgroup 0. Null if the result is not wanted.
    pub first: *mut Row,
    /// Distance from one subgroup's row to the next one's: 0 if all share a row.
    pub step_bytes: usize,
}

impl Rows {
    /// A result that is not wanted.
    pub const NONE: Rows = Rows {
        first: std::ptr::null_mut(),
        step_bytes: 0,
    };

    /// # Safety
    /// The subgroup has a row.
    #[inline(always)]
    unsafe fn of(self, subgroup: u16) -> *mut Row {
        // SAFETY: the caller guarantees that the subgroup has a row.
        unsafe { self.first.byte_add(subgroup as usize * self.step_bytes) }
    }
}

/// Subgroups that perform an operation on one image, and their rows of 32-bit words.
///
/// Users rely on this: subgroups' numbers are less than the number of `lanes`, operands are as many
/// as [`ImageOp::operand_rows`] says, each subgroup has a row of each operand and each wanted
/// result, and no result's row is an operand's.
#[derive(Clone, Copy)]
pub struct Wave<'a> {
    /// Their numbers.
    pub subgroups: &'a [u16],
    /// The lanes that take part, by a subgroup's number.
    pub lanes: &'a [LaneMask],
    pub operands: &'a [Rows],
    pub results: [Rows; 4],
    /// Samples are at the derivatives of their coordinates, which stand in the place of the
    /// operands for these.
    pub derives: bool,
}

impl Wave<'_> {
    /// The lanes of the subgroup at an index.
    ///
    /// # Safety
    /// As all of these: the index is that of a subgroup, and there is such an operand.
    #[inline(always)]
    pub(super) unsafe fn mask(&self, index: usize) -> u16 {
        // SAFETY: the caller passes indices that exist; each subgroup has its rows ([`Wave`]).
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            self.lanes.get_unchecked(subgroup as usize).bits()
        }
    }

    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn operand(&self, index: usize, operand: usize) -> &Row {
        // SAFETY: the caller passes indices that exist; each subgroup has its rows ([`Wave`]).
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            &*self.operands.get_unchecked(operand).of(subgroup)
        }
    }

    /// The operand rows of a subgroup, and how many these are.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn operand_rows(&self, index: usize) -> ([&Row; MAX_OPERANDS], usize) {
        let count = self.operands.len().min(MAX_OPERANDS);
        let mut rows = [&[0; LANES]; MAX_OPERANDS];
        for (operand, row) in rows.iter_mut().enumerate().take(count) {
            // SAFETY: the caller keeps the contract of `Self::mask`.
            *row = unsafe { self.operand(index, operand) };
        }
        (rows, count)
    }

    /// The depth that texels are compared with.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn reference(&self, op: &ImageOp, index: usize) -> &Row {
        // SAFETY: the caller guarantees that the index is that of a subgroup, and there is such an
        // operand.
        unsafe { self.operand(index, op.coordinate_count()) }
    }

    /// Bias, level or derivatives.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn lod(&self, op: &ImageOp, index: usize, part: usize) -> &Row {
        // SAFETY: the caller guarantees that the index is that of a subgroup, and there is such an
        // operand.
        unsafe { self.operand(index, op.rows_before_lod() + part) }
    }

    /// A sample's offset along an axis: the last operands are these.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn offset(&self, op: &ImageOp, index: usize, axis: usize) -> &Row {
        // SAFETY: the caller guarantees that the index is that of a subgroup, and there is such an
        // operand.
        unsafe { self.operand(index, self.operands.len() - op.spatial_count() + axis) }
    }

    /// Writes a subgroup's results, those that are wanted.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn put<V: Vector>(&self, v: V, index: usize, values: [V::I; 4]) {
        // SAFETY: the caller guarantees that the index is that of a subgroup, and there is such an
        // operand. One by one: a loop would keep the values in memory.
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            put_one(v, self.results[0], subgroup, values[0]);
            put_one(v, self.results[1], subgroup, values[1]);
            put_one(v, self.results[2], subgroup, values[2]);
            put_one(v, self.results[3], subgroup, values[3]);
        }
    }

    /// Writes one of a subgroup's results, which is wanted.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn put_component<V: Vector>(
        &self,
        v: V,
        index: usize,
        component: usize,
        value: V::I,
    ) {
        // SAFETY: the caller passes indices that exist; each subgroup has its rows ([`Wave`]).
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            v.store_i(value, &mut *self.results[component].of(subgroup));
        }
    }

    /// Writes a subgroup's results, all of which are wanted.
    ///
    /// # Safety
    /// As [`Self::mask`].
    #[inline(always)]
    pub(super) unsafe fn put_all<V: Vector>(&self, v: V, index: usize, values: [V::F; 4]) {
        // SAFETY: the caller passes an index that exists; each subgroup has its rows ([`Wave`]).
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            v.store(values[0], &mut *self.results[0].of(subgroup));
            v.store(values[1], &mut *self.results[1].of(subgroup));
            v.store(values[2], &mut *self.results[2].of(subgroup));
            v.store(values[3], &mut *self.results[3].of(subgroup));
        }
    }

    /// As [`Self::put`], of numbers.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    pub(super) unsafe fn put_numbers<V: Vector>(&self, v: V, index: usize, values: [V::F; 4]) {
        let words = [
            v.bits_of(values[0]),
            v.bits_of(values[1]),
            v.bits_of(values[2]),
            v.bits_of(values[3]),
        ];
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.put(v, index, words) };
    }
}

/// # Safety
/// The result has a row for the subgroup, or is not wanted.
#[inline(always)]
unsafe fn put_one<V: Vector>(v: V, result: Rows, subgroup: u16, value: V::I) {
    if !result.first.is_null() {
        // SAFETY: the caller guarantees that the result has a row for the subgroup, or is not
        // wanted.
        unsafe { v.store_i(value, &mut *result.of(subgroup)) };
    }
}

/// A wave of one subgroup, of which some lanes take part.
pub(super) fn of_one<R>(
    operands: &[&Row],
    mask: u16,
    results: &mut [Row],
    then: impl FnOnce(&Wave<'_>) -> R,
) -> R {
    let one = |first| Rows {
        first,
        step_bytes: 0,
    };
    let mut rows = [Rows::NONE; MAX_OPERANDS];
    for (rows, operand) in rows.iter_mut().zip(operands) {
        *rows = one((&raw const **operand).cast_mut());
    }
    let mut wanted = [Rows::NONE; 4];
    for (rows, result) in wanted.iter_mut().zip(results) {
        *rows = one(result);
    }
    then(&Wave {
        subgroups: &[0],
        lanes: &[LaneMask::from_bits(mask)],
        operands: &rows[..operands.len()],
        results: wanted,
        derives: false,
    })
}
