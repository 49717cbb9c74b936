//! Sixteen lanes in the registers of an instruction set, for code where loops over lanes do not become good vectors by themselves:
//! gathers, minima with a definite NaN, conversions of numbers known to be in range.
//!
//! Every operation gives the same bits in all three; NaN payloads aside, and where a comment says that a result is unspecified.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub(crate) use portable::Portable;

use crate::program::Row;

/// An instruction set, as a token: whoever makes one knows that the machine has it. Where code is compiled for the set too, all of this is inlined.
pub(crate) trait Vector: Copy {
    /// Numbers and words of sixteen lanes.
    type F: Copy;
    type I: Copy;

    /// # Safety
    /// The machine has the instruction set.
    unsafe fn new() -> Self;

    fn splat(self, x: f32) -> Self::F;
    fn splat_i(self, x: i32) -> Self::I;
    fn load(self, row: &Row) -> Self::F;
    fn store(self, a: Self::F, row: &mut Row);
    fn store_i(self, a: Self::I, row: &mut Row);
    /// The words as numbers.
    fn bits_to_f(self, a: Self::I) -> Self::F;

    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a / divisor`, for a divisor of 255 or 65535 and `a` between 0 and `divisor + 1`. Correctly rounded, though no division where there
    /// are fused multiply-adds: that was checked for every such `a`.
    fn div_units(self, a: Self::F, divisor: f32) -> Self::F;
    fn floor(self, a: Self::F) -> Self::F;
    fn ceil(self, a: Self::F) -> Self::F;
    fn round_ties_even(self, a: Self::F) -> Self::F;
    /// `a < b ? a : b`, and `a > b ? a : b`: with a NaN, `b`.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Truncated; unspecified for what no `i32` holds.
    fn to_i(self, a: Self::F) -> Self::I;
    fn to_f(self, a: Self::I) -> Self::F;

    fn add_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn mul_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn and_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn xor_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// All ones where negative, else zero.
    fn sign_i(self, a: Self::I) -> Self::I;
    /// The word's byte `index` (0 to 3).
    fn byte(self, a: Self::I, index: u32) -> Self::I;

    /// A bit per lane.
    fn ne_i(self, a: Self::I, b: Self::I) -> u16;
    fn gt(self, a: Self::F, b: Self::F) -> u16;

    /// Words at byte offsets, which are unsigned up to `i32::MAX`.
    ///
    /// # Safety
    /// Four bytes are readable at each.
    unsafe fn gather(self, base: *const u8, offsets: Self::I) -> Self::I;

    /// Words at byte offsets, and those right behind them.
    ///
    /// # Safety
    /// Eight bytes are readable at each.
    unsafe fn gather_pairs(self, base: *const u8, offsets: Self::I) -> (Self::I, Self::I);

    /// `a + w (b - a)`: exact where the weight is zero or the ends are equal.
    #[inline(always)]
    fn lerp(self, a: Self::F, b: Self::F, w: Self::F) -> Self::F {
        self.add(a, self.mul(w, self.sub(b, a)))
    }
}
