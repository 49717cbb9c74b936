//! Sixteen lanes in the registers of an instruction set, for code where loops over lanes do not
//! become good vectors by themselves: gathers, minima with a definite NaN, conversions of numbers
//! known to be in range.
//!
//! Every operation gives the same bits in all three; NaN payloads aside, and where a comment says
//! that a result is unspecified.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod neighbours;
mod portable;
#[cfg(target_arch = "x86_64")]
mod quads;
#[cfg(test)]
mod tests;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use portable::Portable;

use crate::{Row, Tier, quad};

/// 1.5 · 2^23: the last place of a sum with it is worth 1, so that a fused multiply-add rounds its
/// product to an integer, once.
#[cfg(target_arch = "x86_64")]
const ROUNDER: f32 = 12_582_912.0;

/// Compiles a function over vectors for each tier of instruction sets; the first argument chooses.
/// Functions that it calls are to be `#[inline(always)]`, and closures do no more than pick values:
/// they are not compiled for the tier.
#[macro_export]
macro_rules! vectors {
    ($(#[$doc:meta])* $vis:vis unsafe fn $($rest:tt)*) => {
        $crate::vectors! { @[unsafe] [$(#[$doc])*] [$vis] $($rest)* }
    };
    ($(#[$doc:meta])* $vis:vis fn $($rest:tt)*) => {
        $crate::vectors! { @[] [$(#[$doc])*] [$vis] $($rest)* }
    };
    (@[$($unsafe:tt)?] [$(#[$doc:meta])*] [$vis:vis]
        $name:ident<$V:ident>($v:ident, $($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$doc])*
        $vis $($unsafe)? fn $name(tier: $crate::Tier, $($arg: $ty),*) $(-> $ret)? {
            use $crate::vector;
            #[inline(always)]
            $($unsafe)? fn body<$V: vector::Vector>($v: $V, $($arg: $ty),*) $(-> $ret)? $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c")]
            $($unsafe)? fn avx2($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: the function's features; the caller keeps the contract of this function.
                unsafe { body(<vector::Avx2 as vector::Vector>::new(), $($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c")]
            $($unsafe)? fn avx512($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: the function's features; the caller keeps the contract of this function.
                unsafe { body(<vector::Avx512 as vector::Vector>::new(), $($arg),*) }
            }
            // SAFETY: a tier is one that the machine has (`Tier::best`); the caller keeps the
            // contract of this function.
            unsafe {
                match tier {
                    #[cfg(target_arch = "x86_64")]
                    $crate::Tier::Avx2 => avx2($($arg),*),
                    #[cfg(target_arch = "x86_64")]
                    $crate::Tier::Avx512 => avx512($($arg),*),
                    _ => body(<vector::Portable as vector::Vector>::new(), $($arg),*),
                }
            }
        }
    };
}

/// Offsets on a cache line of their own: loads of single ones right behind the store of all wait
/// where the store crosses into a second line.
#[cfg(target_arch = "x86_64")]
#[repr(align(64))]
struct Line(Row);

/// Work that [`Vector::apart`] does out of line.
pub trait Task<V: Vector> {
    type Output;

    /// Always inlined, as all that is compiled for an instruction set.
    ///
    /// # Safety
    /// As the task's type says.
    unsafe fn run(self, v: V) -> Self::Output;
}

/// An instruction set, as a token: its creator knows that the machine has the set. In code that is
/// compiled for the set, all of this is inlined.
pub trait Vector: Copy {
    /// Numbers and words of sixteen lanes.
    type F: Copy;
    type I: Copy;

    /// Whether [`Self::words_in_windows`] ever finds some.
    const HAS_WINDOWS: bool = false;

    /// Whether operations are instructions of the machine: versions of code for the common cases
    /// are worth their place.
    const IS_MACHINES: bool = true;
    /// Whether [`Self::blend_neighbours`] is faster than a blend of each component by itself.
    const BLENDS_NEIGHBOURS: bool = false;
    /// The tier of the instruction set.
    const TIER: Tier;

    /// # Safety
    /// The machine has the instruction set.
    unsafe fn new() -> Self;

    fn splat(self, x: f32) -> Self::F;
    fn splat_i(self, x: i32) -> Self::I;
    fn load(self, row: &Row) -> Self::F;
    fn store(self, a: Self::F, row: &mut Row);
    fn load_i(self, row: &Row) -> Self::I;
    fn store_i(self, a: Self::I, row: &mut Row);
    /// The words as numbers, and the numbers' words.
    fn bits_to_f(self, a: Self::I) -> Self::F;
    fn bits_of(self, a: Self::F) -> Self::I;

    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `sum + a * b`, where an `f32` holds the product exactly: fused or not, the bits are equal.
    fn add_exact_product(self, sum: Self::F, a: Self::F, b: Self::F) -> Self::F;
    /// `a / divisor`, for a divisor of 255 or 65535 and `a` between 0 and `divisor + 1`. Correctly
    /// rounded, though no division where there are fused multiply-adds: that was checked for every
    /// such `a`.
    fn div_units(self, a: Self::F, divisor: f32) -> Self::F;
    /// `a / divisor`, correctly rounded without a division: `high` is the rounded reciprocal, `low`
    /// its rounding error. The caller has checked that this holds for all such `a`.
    fn quotient(self, a: Self::F, divisor: Self::F, high: Self::F, low: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// Correctly rounded.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// `a * scale` to the nearest integer, ties to even, rounded once; it lies between -2^22 and
    /// 2^22.
    fn scaled(self, a: Self::F, scale: f32) -> Self::I;
    fn floor(self, a: Self::F) -> Self::F;
    fn ceil(self, a: Self::F) -> Self::F;
    fn round_ties_even(self, a: Self::F) -> Self::F;
    /// `a < b ? a : b`, and `a > b ? a : b`: with a NaN, `b`.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Truncated; unspecified where no `i32` holds the result.
    fn to_i(self, a: Self::F) -> Self::I;
    fn to_f(self, a: Self::I) -> Self::F;
    /// 16-bit floats in the words' low halves, the high ones being zero: nearest, ties to even.
    fn to_half(self, a: Self::F) -> Self::I;
    /// The numbers of those, of which signalling NaNs become quiet, as they do in arithmetic.
    fn quiet_half_to_f(self, half: Self::I) -> Self::F;
    /// The numbers of those: as [`half_to_f32`](crate::halves::half_to_f32).
    #[inline(always)]
    fn half_to_f(self, half: Self::I) -> Self::F {
        let bits = self.bits_of(self.quiet_half_to_f(half));
        let magnitude = self.and_i(half, self.splat_i(0x7fff));
        let is_nan = self.sign_i(self.sub_i(self.splat_i(0x7c00), magnitude));
        let is_signalling = self.xor_i(self.left_i(half, 13), self.splat_i(-1));
        let quiet_bit = self.and_i(is_signalling, self.splat_i(0x0040_0000));
        let was_set = self.and_i(is_nan, quiet_bit);
        self.bits_to_f(self.and_i(bits, self.xor_i(was_set, self.splat_i(-1))))
    }

    fn add_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn mul_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn and_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn or_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn xor_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// Shifted by fewer than 32 bits: to the left, to the right with zeros, to the right with
    /// signs.
    fn left_i(self, a: Self::I, bits: u32) -> Self::I;
    fn right_u(self, a: Self::I, bits: u32) -> Self::I;
    fn right_i(self, a: Self::I, bits: u32) -> Self::I;
    /// Shifted by the lanes' own counts: zero where they are 32 or more as unsigned numbers.
    fn left_each(self, a: Self::I, bits: Self::I) -> Self::I;
    fn right_each(self, a: Self::I, bits: Self::I) -> Self::I;
    /// Entries of a table, by the lanes' four lowest bits.
    fn table(self, table: &[f32; 16], index: Self::I) -> Self::F;
    /// The lesser as unsigned numbers.
    fn min_u(self, a: Self::I, b: Self::I) -> Self::I;
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// All ones where negative, else zero.
    fn sign_i(self, a: Self::I) -> Self::I;
    /// The word's byte `index` (0 to 3).
    fn byte(self, a: Self::I, index: u32) -> Self::I;

    /// Zero but in the lanes of the mask.
    fn keep(self, a: Self::I, mask: u16) -> Self::I;
    /// A bit per lane.
    fn ne_i(self, a: Self::I, b: Self::I) -> u16;
    /// As unsigned numbers.
    fn lt_u(self, a: Self::I, b: Self::I) -> u16;
    fn gt(self, a: Self::F, b: Self::F) -> u16;
    /// `a >= b`, and `a == b`: neither holds of a NaN.
    fn ge(self, a: Self::F, b: Self::F) -> u16;
    fn eq(self, a: Self::F, b: Self::F) -> u16;
    /// All ones where `a >= b`, else zero: of a NaN, too.
    fn at_least(self, a: Self::F, b: Self::F) -> Self::I;
    /// `a` where a word is all ones, `b` where it is zero: cheaper than [`Self::select`] where
    /// masks are no registers of their own.
    #[inline(always)]
    fn pick(self, ones: Self::I, a: Self::I, b: Self::I) -> Self::I {
        self.xor_i(b, self.and_i(self.xor_i(a, b), ones))
    }
    /// `a` in the lanes of the mask, `b` in the others.
    fn select(self, mask: u16, a: Self::I, b: Self::I) -> Self::I;

    /// Four words, four lanes each.
    fn quads(self, words: &[u32; 4]) -> Self::I;

    /// In each lane of a quad (see [`quad`]) the number of the one with the bit
    /// `AXIS` of its index clear, and of the one with it set.
    fn sides<const AXIS: usize>(self, a: Self::F) -> (Self::F, Self::F);

    /// Four words of each of four rows, which become 2×2 quads: lanes 0 and 1 are from the first
    /// row, 2 and 3 from the second, 4 and 5 from the first.
    ///
    /// # Safety
    /// Sixteen bytes are readable at `at` and 1 to 3 strides behind it.
    unsafe fn load_quads(self, at: *const u8, stride_bytes: usize) -> Self::I;

    /// Stores words where [`Self::load_quads`] loads them.
    ///
    /// # Safety
    /// Sixteen bytes are writable at `at` and 1 to 3 strides behind it.
    unsafe fn store_quads(self, a: Self::I, at: *mut u8, stride_bytes: usize);

    /// As [`Self::load_quads`], of numbers of 16 bits.
    ///
    /// # Safety
    /// Eight bytes are readable at `at` and 1 to 3 strides behind it.
    unsafe fn load_quads_of_shorts(self, at: *const u8, stride_bytes: usize) -> Self::I;

    /// Stores the low 16 bits of words where [`Self::load_quads_of_shorts`] loads them.
    ///
    /// # Safety
    /// Eight bytes are writable at `at` and 1 to 3 strides behind it.
    unsafe fn store_quads_of_shorts(self, a: Self::I, at: *mut u8, stride_bytes: usize);

    /// The bytes of two words of 64 bits, the first in the lowest bits, as words.
    fn of_bytes(self, bytes: [u64; 2]) -> Self::I;

    /// The low bytes of words, where [`Self::of_bytes`] takes them from.
    fn to_bytes(self, a: Self::I) -> [u64; 2];

    /// The words of four quads, from the first bytes of their first rows on.
    ///
    /// # Safety
    /// Eight bytes are readable at each place and a stride behind it.
    unsafe fn load_each_quad(self, at: [*const u8; 4], stride_bytes: usize) -> Self::I;

    /// Stores texels of one, two or four words of the mask's lanes to four quads, and rewrites the
    /// old texels of other lanes. It is branch-free: the branches would mispredict.
    ///
    /// # Safety
    /// Two texels are readable and writable at each place and a stride behind it.
    unsafe fn put_each_quad<const WORDS: usize>(
        self,
        words: [Self::I; WORDS],
        mask: u16,
        at: [*mut u8; 4],
        stride_bytes: usize,
    );

    /// As [`Self::load_quads`], of pairs of words: the first ones, and the second ones.
    ///
    /// # Safety
    /// 32 bytes are readable at `at` and 1 to 3 strides behind it.
    unsafe fn load_quads_of_pairs(self, at: *const u8, stride_bytes: usize) -> (Self::I, Self::I);

    /// Stores pairs of words where [`Self::load_quads_of_pairs`] loads them.
    ///
    /// # Safety
    /// 32 bytes are writable at `at` and 1 to 3 strides behind it.
    unsafe fn store_quads_of_pairs(
        self,
        first: Self::I,
        second: Self::I,
        at: *mut u8,
        stride_bytes: usize,
    );

    /// Words at byte offsets, which are unsigned up to `i32::MAX`.
    ///
    /// # Safety
    /// Four bytes are readable at each.
    unsafe fn gather(self, base: *const u8, offsets: Self::I) -> Self::I;

    /// Bytes or shorts at byte offsets, which are unsigned up to `i32::MAX`, as words.
    ///
    /// # Safety
    /// A scalar is readable at each.
    unsafe fn gather_scalars<T: Copy + Into<u32>>(
        self,
        base: *const u8,
        offsets: Self::I,
    ) -> Self::I;

    /// Words at byte offsets, and those right behind them.
    ///
    /// # Safety
    /// Eight bytes are readable at each.
    unsafe fn gather_pairs(self, base: *const u8, offsets: Self::I) -> (Self::I, Self::I);

    /// Four words from byte offsets on: those of all lanes that come first, then the second ones.
    ///
    /// # Safety
    /// Sixteen bytes are readable at each.
    unsafe fn gather_quads(self, base: *const u8, offsets: Self::I) -> [Self::I; 4];

    /// As [`Self::gather`], of offsets in memory: single loads of these do not wait if they were
    /// stored some time before.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn words_at(self, base: *const u8, offsets: &Row) -> Self::I {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.gather(base, self.load_i(offsets)) }
    }

    /// As [`Self::gather_scalars`], of offsets in memory.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn scalars_at<T: Copy + Into<u32>>(self, base: *const u8, offsets: &Row) -> Self::I {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.gather_scalars::<T>(base, self.load_i(offsets)) }
    }

    /// As [`Self::gather_pairs`], of offsets in memory.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn pairs_at(self, base: *const u8, offsets: &Row) -> (Self::I, Self::I) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.gather_pairs(base, self.load_i(offsets)) }
    }

    /// As [`Self::gather_quads`], of offsets in memory.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn quads_at(self, base: *const u8, offsets: &Row) -> [Self::I; 4] {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.gather_quads(base, self.load_i(offsets)) }
    }

    /// Words at byte offsets, as [`Self::words_at`], if [`Self::HAS_WINDOWS`] and the lanes' words
    /// lie in two windows of 64 bytes: on two rows of an image, not far apart. Scalars of `SIZE`
    /// bytes have those behind them on top. `None` if they do not, or if a window is not readable.
    ///
    /// # Safety
    /// `readable` bytes are readable at `base`.
    #[inline(always)]
    unsafe fn words_in_windows<const SIZE: u32>(
        self,
        base: *const u8,
        offsets: &Row,
        readable: u64,
    ) -> Option<Self::I> {
        let _ = (base, offsets, readable);
        None
    }

    /// As [`Self::words_in_windows`], words and those behind them.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn pairs_in_windows(
        self,
        base: *const u8,
        offsets: &Row,
        readable: u64,
    ) -> Option<(Self::I, Self::I)> {
        let _ = (base, offsets, readable);
        None
    }

    /// Texels of four components around sixteen places, linear between them: in two lines, or in
    /// four, which are two slices (`LINES`). An offset is that of a line's left texel; the right
    /// neighbour lies behind it. The weights are those of the right texel, the next line, and the
    /// next slice. `KIND` is one of [`FourOf`]. Components come in memory's order.
    ///
    /// # Safety
    /// Both texels of each line are readable in every lane.
    #[inline(always)]
    unsafe fn blend_neighbours<const KIND: u8, const LINES: usize>(
        self,
        base: *const u8,
        offsets: [Self::I; LINES],
        weights: [Self::F; 3],
    ) -> [Self::F; 4] {
        let mut blended = [self.splat(0.0); 4];
        for (component, number) in blended.iter_mut().enumerate() {
            let mut lines = [self.splat(0.0); LINES];
            for (line, at) in lines.iter_mut().zip(offsets) {
                // SAFETY: the caller guarantees that both texels of each line are readable in every
                // lane.
                let (left, right) = unsafe {
                    (
                        component_at::<Self, KIND>(self, base, at, component),
                        component_at::<Self, KIND>(
                            self,
                            base.add(FourOf::texel_bytes(KIND)),
                            at,
                            component,
                        ),
                    )
                };
                *line = self.lerp(left, right, weights[0]);
            }
            *number = self.lerp(lines[0], lines[1], weights[1]);
            if LINES == 4 {
                let behind = self.lerp(lines[2 % LINES], lines[3 % LINES], weights[1]);
                *number = self.lerp(*number, behind, weights[2]);
            }
        }
        blended
    }

    /// The numbers that a table has for the three lower bytes of words.
    #[inline(always)]
    fn bytes_in<const N: usize>(self, table: &ByteTable, words: [Self::I; N]) -> [[Self::F; 3]; N] {
        gathered_bytes(self, table, words)
    }

    /// Does the task in a function of its own, compiled for the instruction set: keeps rare work
    /// out of the code and the registers of common work.
    ///
    /// # Safety
    /// As [`Task::run`] of the task.
    unsafe fn apart<T: Task<Self>>(self, task: T) -> T::Output;

    /// [`quad::derivative`] of sixteen numbers.
    #[inline(always)]
    fn derivative<const AXIS: usize>(self, a: Self::F, active: u16) -> Self::F {
        let (first, second) = self.sides::<AXIS>(a);
        let both = active & active >> AXIS & if AXIS == quad::X { 0x5555 } else { 0x3333 };
        let difference = self.bits_of(self.sub(second, first));
        self.bits_to_f(self.keep(difference, both | both << AXIS))
    }

    /// `a + w (b - a)`: exact where the weight is zero or the ends are equal.
    #[inline(always)]
    fn lerp(self, a: Self::F, b: Self::F, w: Self::F) -> Self::F {
        self.add(a, self.mul(w, self.sub(b, a)))
    }
}

/// Columns and rows of lanes that are four 2×2 quads, as [`Vector::load_quads`] loads them.
pub const QUADS: [Row; 2] = [
    [0, 1, 0, 1, 2, 3, 2, 3, 0, 1, 0, 1, 2, 3, 2, 3],
    [0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3],
];

/// The components of texels that [`Vector::blend_neighbours`] blends.
pub struct FourOf;

impl FourOf {
    /// Bytes without a sign, as integers.
    pub const BYTES: u8 = 0;
    /// 16-bit numbers without a sign, as integers.
    pub const SHORTS: u8 = 1;
    /// 16-bit floats; signalling NaNs become quiet.
    pub const HALVES: u8 = 2;
    /// 32-bit floats.
    pub const WORDS: u8 = 3;

    const fn texel_bytes(kind: u8) -> usize {
        match kind {
            FourOf::BYTES => 4,
            FourOf::SHORTS | FourOf::HALVES => 8,
            _ => 16,
        }
    }
}

/// A component of the texels at byte offsets.
///
/// # Safety
/// The texels are readable.
#[inline(always)]
unsafe fn component_at<V: Vector, const KIND: u8>(
    v: V,
    base: *const u8,
    offsets: V::I,
    component: usize,
) -> V::F {
    // SAFETY: the caller guarantees that the texels are readable.
    unsafe {
        match KIND {
            FourOf::BYTES => v.to_f(v.gather_scalars::<u8>(base.add(component), offsets)),
            FourOf::SHORTS => v.to_f(v.gather_scalars::<u16>(base.add(2 * component), offsets)),
            FourOf::HALVES => {
                v.quiet_half_to_f(v.gather_scalars::<u16>(base.add(2 * component), offsets))
            }
            _ => v.bits_to_f(v.gather(base.add(4 * component), offsets)),
        }
    }
}

/// Words by a byte, once in their order and once as the planes of their bytes, which permutes take.
#[repr(align(64))]
pub struct ByteTable {
    /// The lowest byte of each word, then the second ones.
    #[cfg(target_arch = "x86_64")]
    planes: [[u8; 256]; 4],
    words: [u32; 256],
}

impl ByteTable {
    pub const fn new(words: [u32; 256]) -> ByteTable {
        #[cfg(target_arch = "x86_64")]
        let planes = {
            let mut planes = [[0; 256]; 4];
            let mut at = 0;
            while at < 4 * 256 {
                planes[at % 4][at / 4] = words[at / 4].to_le_bytes()[at % 4];
                at += 1;
            }
            planes
        };
        ByteTable {
            #[cfg(target_arch = "x86_64")]
            planes,
            words,
        }
    }

    #[inline(always)]
    pub const fn words(&self) -> &[u32; 256] {
        &self.words
    }
}

/// [`Vector::bytes_in`] by gathers.
#[inline(always)]
fn gathered_bytes<V: Vector, const N: usize>(
    v: V,
    table: &ByteTable,
    words: [V::I; N],
) -> [[V::F; 3]; N] {
    let mut entries = [[v.splat(0.0); 3]; N];
    for (word, entries) in words.into_iter().zip(&mut entries) {
        for (index, entry) in entries.iter_mut().enumerate() {
            let at = v.left_i(v.byte(word, index as u32), 2);
            // SAFETY: the table has an entry for every byte.
            *entry = v.bits_to_f(unsafe { v.gather(table.words.as_ptr().cast(), at) });
        }
    }
    entries
}
