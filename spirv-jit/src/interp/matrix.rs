//! Products of matrices, on rows.
//!
//! [`eval::matrix`] defines the results. Every factor is widened to f32, integers of 8 bits too: a
//! sum of 16 products of such is exact. An element of `a` is the same number for a whole row of
//! the results, so that each step is a row of `b`, times that number, added to the row of sums. The
//! rounding of products is part of the definition: products of 16-bit floats are exact, but those
//! of others are not, and no tier fuses.

use std::marker::PhantomData;

use lanes::vector::{self, Vector};
use lanes::{AlignedRow, Row, Tier as TierKind};

use super::code::ProductPlan;
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::tier::{Kernel, Portable, Tier};
use crate::eval::matrix::accumulate;
use crate::ir::op::{Component, MatrixProduct};

const SIZE: usize = MatrixProduct::SIZE;

/// The kernel of products: `x` is the plan.
pub(super) fn handler(tier: TierKind) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => super::tier::Avx2::handler::<Product<vector::Avx2, 4>>(),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => super::tier::Avx512::handler::<Product<vector::Avx512, 8>>(),
        _ => Portable::handler::<Product<vector::Portable, 1>>(),
    }
}

/// `SUMS` rows of the results at once: as many as the registers hold, since each sum waits for the
/// one before it.
struct Product<V, const SUMS: usize>(PhantomData<V>);

impl<V: Vector + 'static, const SUMS: usize> Kernel for Product<V, SUMS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let ProductPlan { product, operands } = m.code.products[i.x as usize];
        let operands = &m.code.operands[operands as usize..][..4 * SIZE];
        // SAFETY: the tier is the token's; rows are the program's, and those of the results are
        // not among the others.
        unsafe {
            let v = V::new();
            for &subgroup in m.listed() {
                let row = |operand: Operand| &*m.block::<u32>(operand, subgroup);
                let mut right = [AlignedRow::default(); SIZE];
                for k in 0..SIZE {
                    let factor = widen(v, product.b, row(operands[SIZE + k]));
                    v.store(factor, &mut right[k].0);
                }
                for first in (0..SIZE).step_by(SUMS) {
                    let mut left = [AlignedRow::default(); SUMS];
                    let mut sums = [v.splat(0.0); SUMS];
                    for k in 0..SUMS {
                        let factor = widen(v, product.a, row(operands[first + k]));
                        v.store(factor, &mut left[k].0);
                        if product.sum.is_float() {
                            sums[k] = widen(v, product.sum, row(operands[2 * SIZE + first + k]));
                        }
                    }
                    for step in 0..SIZE {
                        let factor = v.load(&right[step].0);
                        for k in 0..SUMS {
                            let other = v.splat(f32::from_bits(left[k].0[step]));
                            sums[k] = v.add(sums[k], v.mul(other, factor));
                        }
                    }
                    for k in 0..SUMS {
                        let c = row(operands[2 * SIZE + first + k]);
                        let to = m.block::<u32>(operands[3 * SIZE + first + k], subgroup);
                        finish(v, &product, sums[k], c, &mut *to);
                    }
                }
            }
        }
    }
}

/// A row of components as f32.
#[inline(always)]
pub(super) fn widen<V: Vector>(v: V, component: Component, row: &Row) -> V::F {
    let words = v.load_i(row);
    match component {
        Component::F16 => v.quiet_half_to_f(words),
        Component::BFloat16 => v.bits_to_f(v.left_i(words, 16)),
        Component::S8 => v.to_f(v.right_i(v.left_i(words, 24), 24)),
        Component::U8 => v.to_f(words),
        Component::E5M2 => v.quiet_half_to_f(v.left_i(words, 8)),
        Component::E4M3 => {
            // As in `float8`.
            let magnitude = v.and_i(words, v.splat_i(0x7f));
            let sign = v.left_i(v.and_i(words, v.splat_i(0x80)), 8);
            let half = v.or_i(sign, v.left_i(magnitude, 7));
            let number = v.mul(v.quiet_half_to_f(half), v.splat(256.0));
            let is_number = v.ne_i(magnitude, v.splat_i(0x7f));
            let nan = v.splat_i(f32::NAN.to_bits() as i32);
            v.bits_to_f(v.select(is_number, v.bits_of(number), nan))
        }
        _ => v.bits_to_f(words),
    }
}

/// Writes a row of results from their sums.
#[inline(always)]
fn finish<V: Vector>(v: V, product: &MatrixProduct, sums: V::F, c: &Row, to: &mut Row) {
    match product.sum {
        Component::F16 => v.store_i(v.to_half(sums), to),
        Component::F32 => v.store(sums, to),
        Component::BFloat16 => {
            let bits = v.bits_of(sums);
            let high = v.right_u(bits, 16);
            let up = v.add_i(v.and_i(high, v.splat_i(1)), v.splat_i(0x7fff));
            let nearest = v.right_u(v.add_i(bits, up), 16);
            let nan = v.or_i(high, v.splat_i(0x40));
            v.store_i(v.select(v.eq(sums, sums), nearest, nan), to);
        }
        _ => {
            v.store_i(v.to_i(sums), to);
            for k in 0..SIZE {
                to[k] = accumulate(product, c[k], to[k] as i32);
            }
        }
    }
}
