//! Products of a matrix in memory and a vector of each lane, on rows.
//!
//! [`eval::matrix`](crate::eval::matrix) defines the results. A component of the vector is a row,
//! and an element of a matrix that lanes share is one number: each step adds a row, times that
//! number, to a row of sums. Matrices are widened to f32 in tiles of 16 by 16 elements, 16 rows at
//! a time, for all subgroups of a wave that share them. Every product of elements of 8 bits, and a
//! sum of 16 such products, is exact in f32.
//!
//! Lanes whose matrices lie elsewhere have their turns one after another.

use std::marker::PhantomData;
use std::mem::MaybeUninit;

use lanes::vector::{self, Vector};
use lanes::{AlignedRow, LaneMask, Row, Tier as TierKind};

use super::code::VectorPlan;
use super::machine::{Handler, Instr, Machine};
use super::matrix::widen;
use super::operand::Operand;
use super::region::{Region, region};
use super::tier::{Kernel, Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::ir::Space;
use crate::ir::op::{Component, VectorProduct};

/// Rows and columns of a tile.
const TILE: usize = 16;

/// The kernel of products: `x` is the plan.
pub(super) fn handler(tier: TierKind) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => super::tier::Avx2::handler::<Product<vector::Avx2, 4>>(),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => super::tier::Avx512::handler::<Product<vector::Avx512, 16>>(),
        _ => Portable::handler::<Product<vector::Portable, 1>>(),
    }
}

/// The operands of a product by their parts.
struct Parts<'c> {
    address: &'c [Operand],
    stride: Operand,
    vector: &'c [Operand],
    added: &'c [Operand],
    results: &'c [Operand],
}

impl<'c> Parts<'c> {
    #[inline(always)]
    fn new(m: &Machine<'c>, plan: &VectorPlan) -> Parts<'c> {
        let (rows, columns) = (plan.rows as usize, plan.columns as usize);
        let all = &m.code.operands[plan.operands as usize..];
        let (address, rest) = all.split_at(plan.space.address_operands());
        let (vector, rest) = rest[1..].split_at(columns);
        let (added, rest) = rest.split_at(if plan.product.adds { rows } else { 0 });
        Parts {
            address,
            stride: all[address.len()],
            vector,
            added,
            results: &rest[..rows],
        }
    }
}

/// Rows of 32-bit floats that a kernel writes before it reads them.
struct Scratch([MaybeUninit<AlignedRow>; VectorProduct::MAX_COMPONENTS]);

impl Scratch {
    #[inline(always)]
    fn new() -> Scratch {
        Scratch([const { MaybeUninit::uninit() }; VectorProduct::MAX_COMPONENTS])
    }

    #[inline(always)]
    fn write<V: Vector>(&mut self, v: V, at: usize, row: V::F) {
        // SAFETY: a row is words, of any bits, and is only written.
        v.store(row, unsafe { &mut (*self.0[at].as_mut_ptr()).0 });
    }

    /// Rows that were written.
    ///
    /// # Safety
    /// All of them were.
    #[inline(always)]
    unsafe fn rows(&self, first: usize, count: usize) -> &[AlignedRow] {
        let rows = &self.0[first..first + count];
        // SAFETY: the caller keeps the contract of this function.
        unsafe { std::slice::from_raw_parts(rows.as_ptr().cast(), count) }
    }
}

/// `SUMS` rows of the results at once: as many as the registers hold, since each sum waits for the
/// one before it.
struct Product<V, const SUMS: usize>(PhantomData<V>);

impl<V: Vector + 'static, const SUMS: usize> Kernel for Product<V, SUMS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.vector_products[i.x as usize];
        let parts = Parts::new(m, plan);
        let columns = parts.vector.len();
        let mut factors = Scratch::new();
        // Subgroups that share a matrix widen it once.
        let is_shared = plan.space != Space::Shared
            && (parts.address.iter().chain([&parts.stride])).all(|operand| operand.is_uniform());
        let together = match is_shared {
            true => VectorProduct::MAX_COMPONENTS / columns,
            false => 1,
        };
        // SAFETY: the tier is the token's; rows are the program's, and those of the results are
        // not among the others.
        unsafe {
            let v = V::new();
            for subgroups in m.listed().chunks(together) {
                for (k, &subgroup) in subgroups.iter().enumerate() {
                    let first = k * columns;
                    match plan.product.vector {
                        Component::F16 => {
                            let component = Component::F16;
                            widen_all(
                                v,
                                m,
                                component,
                                parts.vector,
                                subgroup,
                                (&mut factors, first),
                            );
                        }
                        other => {
                            widen_all(v, m, other, parts.vector, subgroup, (&mut factors, first));
                        }
                    }
                }
                let factors = factors.rows(0, subgroups.len() * columns);
                let matrix = |subgroup, lane| Matrix {
                    region: region(m, plan.space, parts.address, subgroup, lane),
                    stride_bytes: m.lane(parts.stride, subgroup, lane, false),
                    product: plan.product,
                };
                if is_shared {
                    let matrix = matrix(subgroups[0], 0);
                    let all = (subgroups, LaneMask::ALL);
                    multiply::<V, SUMS>(v, m, &matrix, &parts, factors, all);
                    continue;
                }
                let subgroup = subgroups[0];
                let active = m.active[subgroup as usize];
                let mut left = active;
                while !left.is_empty() {
                    let lane = left.first();
                    let lanes = lanes_like(m, plan, &parts, (subgroup, lane), left);
                    let matrix = matrix(subgroup, lane);
                    let lanes_written = match lanes == active {
                        true => LaneMask::ALL,
                        false => lanes,
                    };
                    let some = (subgroups, lanes_written);
                    multiply::<V, SUMS>(v, m, &matrix, &parts, factors, some);
                    left -= lanes;
                }
            }
        }
    }
}

/// Rows of components as f32, written to scratch rows from one on. Callers name the most common
/// component, so that the loop is compiled for it.
///
/// # Safety
/// As [`Kernel::run`].
#[inline(always)]
unsafe fn widen_all<V: Vector>(
    v: V,
    m: &Machine<'_>,
    component: Component,
    rows: &[Operand],
    subgroup: u16,
    (to, first): (&mut Scratch, usize),
) {
    for (k, &row) in rows.iter().enumerate() {
        // SAFETY: the caller keeps the contract of this function.
        let row = unsafe { &*m.block::<u32>(row, subgroup) };
        to.write(v, first + k, widen(v, component, row));
    }
}

/// The lanes of some whose matrix is the one of a lane.
///
/// # Safety
/// As [`Kernel::run`]; the lane is one of them.
#[inline(always)]
unsafe fn lanes_like(
    m: &Machine<'_>,
    plan: &VectorPlan,
    parts: &Parts<'_>,
    (subgroup, lane): (u16, usize),
    among: LaneMask,
) -> LaneMask {
    let mut lanes = among;
    // SAFETY: the caller keeps the contract of `Kernel::run`; the lane is one of them; rows are
    // read as the types of an address say.
    unsafe {
        let (place, rest) = (parts.address[0], &parts.address[1..]);
        if !place.is_uniform() {
            let places = &*m.block::<u64>(place, subgroup);
            lanes &= same(places, lane);
        }
        match plan.space {
            Space::Buffer if !rest[0].is_uniform() => {
                lanes &= same(&*m.block::<u32>(rest[0], subgroup), lane);
            }
            Space::Buffer64 if !rest[0].is_uniform() => {
                lanes &= same(&*m.block::<u64>(rest[0], subgroup), lane);
            }
            _ => {}
        }
        if !parts.stride.is_uniform() {
            lanes &= same(&*m.block::<u32>(parts.stride, subgroup), lane);
        }
    }
    lanes
}

/// The lanes that have a lane's number.
#[inline(always)]
fn same<T: Copy + PartialEq>(numbers: &[T; SUBGROUP_SIZE], lane: usize) -> LaneMask {
    let number = numbers[lane & (SUBGROUP_SIZE - 1)];
    let mut bits = 0u16;
    for (lane, &other) in numbers.iter().enumerate() {
        bits |= u16::from(other == number) << lane;
    }
    LaneMask::from_bits(bits)
}

/// A matrix that lanes share.
struct Matrix {
    region: Region,
    stride_bytes: u64,
    product: VectorProduct,
}

impl Matrix {
    /// Widens up to 16 rows from one on: a tile for each 16 columns. Lines that a tile lacks are
    /// zeros.
    ///
    /// # Safety
    /// The region is one of memory that is alive.
    #[inline(always)]
    unsafe fn fill<V: Vector>(
        &self,
        v: V,
        (top, rows): (usize, usize),
        columns: usize,
        tiles: &mut Scratch,
    ) {
        for left in (0..columns).step_by(TILE) {
            let (lines, first) = match self.product.by_columns {
                true => (TILE.min(columns - left), (left, top)),
                false => (rows, (top, left)),
            };
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                match self.product.matrix {
                    Component::F16 => {
                        self.fill_tile(v, Component::F16, first, lines, (tiles, left));
                    }
                    other => self.fill_tile(v, other, first, lines, (tiles, left)),
                }
            }
            for line in lines..TILE {
                tiles.write(v, left + line, v.splat(0.0));
            }
        }
    }

    /// Lines of a tile, whose first element is at `(line, first)`. Callers name the most common
    /// component, so that the loop is compiled for it.
    ///
    /// # Safety
    /// As [`Self::fill`].
    #[inline(always)]
    unsafe fn fill_tile<V: Vector>(
        &self,
        v: V,
        component: Component,
        (line, first): (usize, usize),
        lines: usize,
        (to, at): (&mut Scratch, usize),
    ) {
        for k in 0..lines {
            // SAFETY: the caller keeps the contract of this function.
            let part = unsafe { self.part(v, component, line + k, first) };
            to.write(v, at + k, part);
        }
    }

    /// 16 elements of a line as f32, from one on; zeros where memory ends.
    ///
    /// # Safety
    /// As [`Self::fill`].
    #[inline(always)]
    unsafe fn part<V: Vector>(
        &self,
        v: V,
        component: Component,
        line: usize,
        first: usize,
    ) -> V::F {
        let size = component.ty().size_bytes() as usize;
        let skip = line as u64 * self.stride_bytes + (first * size) as u64;
        let mut words: Row = [0; TILE];
        // SAFETY: as many bytes are inside. Others may write them meanwhile, which the memory
        // model of the shader language forbids the application.
        unsafe {
            let copy;
            let at = match self.region.bytes(skip, TILE * size) {
                Some(at) => at,
                None => {
                    copy = self.copy(skip, size);
                    copy.as_ptr()
                }
            };
            match size {
                1 => {
                    let bytes = at.cast::<[u8; TILE]>().read_unaligned();
                    for k in 0..TILE {
                        words[k] = bytes[k].into();
                    }
                }
                2 => {
                    let halves = at.cast::<[u16; TILE]>().read_unaligned();
                    for k in 0..TILE {
                        words[k] = halves[k].into();
                    }
                }
                _ => words = at.cast::<Row>().read_unaligned(),
            }
        }
        widen(v, component, &words)
    }

    /// The bytes of 16 elements of so many bytes each, of which some are outside.
    ///
    /// # Safety
    /// As [`Self::fill`].
    #[cold]
    #[inline(never)]
    unsafe fn copy(&self, skip: u64, size: usize) -> [u8; size_of::<Row>()] {
        let mut bytes = [0; size_of::<Row>()];
        for (k, element) in bytes.chunks_exact_mut(size).take(TILE).enumerate() {
            if let Some(at) = self.region.bytes(skip + (k * size) as u64, size) {
                // SAFETY: the element is inside.
                unsafe { element.as_mut_ptr().copy_from_nonoverlapping(at, size) };
            }
        }
        bytes
    }
}

/// The products of a matrix and the vectors of some lanes of each subgroup, whose components are
/// `factors`.
///
/// # Safety
/// As [`Kernel::run`]; the region is as [`Matrix::fill`] wants it.
#[inline(always)]
unsafe fn multiply<V: Vector, const SUMS: usize>(
    v: V,
    m: &Machine<'_>,
    matrix: &Matrix,
    parts: &Parts<'_>,
    factors: &[AlignedRow],
    (subgroups, lanes): (&[u16], LaneMask),
) {
    let columns = parts.vector.len();
    let mut tiles = Scratch::new();
    for top in (0..parts.results.len()).step_by(TILE) {
        let rows = TILE.min(parts.results.len() - top);
        // SAFETY: the caller keeps the contract of `Kernel::run`; the region is as `Matrix::fill`
        // wants it; all lines of tiles are written.
        unsafe {
            matrix.fill(v, (top, rows), columns, &mut tiles);
            let tiles = tiles.rows(0, columns.next_multiple_of(TILE));
            for (&subgroup, factors) in subgroups.iter().zip(factors.chunks_exact(columns)) {
                let added = parts.added.get(top..top + rows).unwrap_or_default();
                let results = &parts.results[top..top + rows];
                let rows = (added, results);
                match matrix.product.sum {
                    Component::F16 => {
                        let sum = Component::F16;
                        add_up::<V, SUMS>(
                            v,
                            m,
                            (matrix, sum),
                            rows,
                            (tiles, factors),
                            (subgroup, lanes),
                        );
                    }
                    sum => {
                        add_up::<V, SUMS>(
                            v,
                            m,
                            (matrix, sum),
                            rows,
                            (tiles, factors),
                            (subgroup, lanes),
                        );
                    }
                }
            }
        }
    }
}

/// Up to 16 rows of the results for a subgroup, from the tiles of as many rows of the matrix.
/// Callers name the most common component of sums.
///
/// # Safety
/// As [`Kernel::run`].
#[inline(always)]
unsafe fn add_up<V: Vector, const SUMS: usize>(
    v: V,
    m: &Machine<'_>,
    (matrix, sum): (&Matrix, Component),
    (added, results): (&[Operand], &[Operand]),
    (tiles, factors): (&[AlignedRow], &[AlignedRow]),
    (subgroup, lanes): (u16, LaneMask),
) {
    let product = &matrix.product;
    let is_integer = !sum.is_float();
    let mut sums = [AlignedRow::default(); TILE];
    for (&added, to) in added.iter().zip(&mut sums) {
        // SAFETY: the caller keeps the contract of this function.
        let added = unsafe { &*m.block::<u32>(added, subgroup) };
        match is_integer {
            true => to.0 = *added,
            false => v.store(widen(v, sum, added), &mut to.0),
        }
    }
    // Sums of whole numbers are exact in f32 for the length of a tile.
    let span = if is_integer { TILE } else { tiles.len() };
    for (tiles, factors) in tiles.chunks(span).zip(factors.chunks(span)) {
        for first in (0..results.len()).step_by(SUMS) {
            let sums = &mut sums[first..first + SUMS];
            match (product.by_columns, product.is_exact()) {
                (true, true) => {
                    add::<V, SUMS, true, true>(v, tiles, factors, first, is_integer, sums);
                }
                (true, false) => {
                    add::<V, SUMS, true, false>(v, tiles, factors, first, is_integer, sums);
                }
                (false, true) => {
                    add::<V, SUMS, false, true>(v, tiles, factors, first, is_integer, sums);
                }
                (false, false) => {
                    add::<V, SUMS, false, false>(v, tiles, factors, first, is_integer, sums);
                }
            }
        }
    }
    for (&to, from) in results.iter().zip(&sums) {
        let total = v.load(&from.0);
        let result = match sum {
            Component::F16 => v.to_half(total),
            _ => v.bits_of(total),
        };
        // SAFETY: the caller keeps the contract of this function.
        let to = unsafe { &mut *m.block::<u32>(to, subgroup) };
        let result = match lanes {
            LaneMask::ALL => result,
            _ => v.select(lanes.bits(), result, v.load_i(to)),
        };
        v.store_i(result, to);
    }
}

/// Adds the products of the tiles' rows, from one on, and the factors to rows of sums.
#[inline(always)]
fn add<V: Vector, const SUMS: usize, const BY_COLUMNS: bool, const IS_EXACT: bool>(
    v: V,
    tiles: &[AlignedRow],
    factors: &[AlignedRow],
    first: usize,
    is_integer: bool,
    sums: &mut [AlignedRow],
) {
    let mut parts = [v.splat(0.0); SUMS];
    if !is_integer {
        for k in 0..SUMS {
            parts[k] = v.load(&sums[k].0);
        }
    }
    for (tile, factors) in tiles.chunks_exact(TILE).zip(factors.chunks(TILE)) {
        let rows = &tile[first..first + SUMS];
        for step in 0..factors.len() {
            let factor = v.load(&factors[step].0);
            let column = &tile[step % TILE].0[first..first + SUMS];
            for k in 0..SUMS {
                let element = match BY_COLUMNS {
                    true => column[k],
                    false => rows[k].0[step % TILE],
                };
                let element = v.splat(f32::from_bits(element));
                parts[k] = match IS_EXACT {
                    true => v.add_exact_product(parts[k], element, factor),
                    false => v.add(parts[k], v.mul(element, factor)),
                };
            }
        }
    }
    for k in 0..SUMS {
        match is_integer {
            true => {
                let sum = v.add_i(v.load_i(&sums[k].0), v.to_i(parts[k]));
                v.store_i(sum, &mut sums[k].0);
            }
            false => v.store(parts[k], &mut sums[k].0),
        }
    }
}
