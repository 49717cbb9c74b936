//! Arrays and loops.

use super::{QUADS, Task, Vector};
use crate::bounds::quiet;
use crate::{LANES, Row, Tier, halves, map};

#[derive(Clone, Copy)]
pub struct Portable;

type F = [f32; LANES];
type I = [i32; LANES];

#[inline(always)]
fn zip<T: Copy, U: Copy + Default>(a: &[T; 16], b: &[T; 16], f: impl Fn(T, T) -> U) -> [U; 16] {
    let mut out = [U::default(); LANES];
    for lane in 0..LANES {
        out[lane] = f(a[lane], b[lane]);
    }
    out
}

#[inline(always)]
fn bits<T: Copy>(a: &[T; 16], b: &[T; 16], f: impl Fn(T, T) -> bool) -> u16 {
    (0..LANES).fold(0, |all, lane| all | (f(a[lane], b[lane]) as u16) << lane)
}

impl Vector for Portable {
    type F = F;
    type I = I;

    const TIER: Tier = Tier::Portable;
    const IS_MACHINES: bool = false;

    #[inline(always)]
    unsafe fn new() -> Self {
        Portable
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        [x; LANES]
    }
    #[inline(always)]
    fn splat_i(self, x: i32) -> I {
        [x; LANES]
    }
    #[inline(always)]
    fn load(self, row: &Row) -> F {
        map(row, f32::from_bits)
    }
    #[inline(always)]
    fn store(self, a: F, row: &mut Row) {
        *row = map(&a, f32::to_bits);
    }
    #[inline(always)]
    fn load_i(self, row: &Row) -> I {
        map(row, |x| x as i32)
    }
    #[inline(always)]
    fn store_i(self, a: I, row: &mut Row) {
        *row = map(&a, |x| x as u32);
    }
    #[inline(always)]
    fn bits_to_f(self, a: I) -> F {
        map(&a, |x| f32::from_bits(x as u32))
    }
    #[inline(always)]
    fn bits_of(self, a: F) -> I {
        map(&a, |x| x.to_bits() as i32)
    }
    #[inline(always)]
    fn add(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| x + y)
    }
    #[inline(always)]
    fn sub(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| x - y)
    }
    #[inline(always)]
    fn mul(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| x * y)
    }
    #[inline(always)]
    fn add_exact_product(self, sum: F, a: F, b: F) -> F {
        self.add(sum, self.mul(a, b))
    }
    #[inline(always)]
    fn div_units(self, a: F, divisor: f32) -> F {
        map(&a, |x| x / divisor)
    }
    #[inline(always)]
    fn quotient(self, a: F, divisor: F, _: F, _: F) -> F {
        self.div(a, divisor)
    }
    #[inline(always)]
    fn div(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| x / y)
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        map(&a, f32::sqrt)
    }
    #[inline(always)]
    fn scaled(self, a: F, scale: f32) -> I {
        /// 1.5 · 2^52: the last place of a sum with it is worth 1. The product is exact.
        const ROUNDER: f64 = 6_755_399_441_055_744.0;
        map(&a, |x| (x as f64 * scale as f64 + ROUNDER).to_bits() as i32)
    }
    #[inline(always)]
    fn floor(self, a: F) -> F {
        map(&a, f32::floor)
    }
    #[inline(always)]
    fn ceil(self, a: F) -> F {
        map(&a, f32::ceil)
    }
    #[inline(always)]
    fn round_ties_even(self, a: F) -> F {
        map(&a, f32::round_ties_even)
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| {
            let x = quiet(x);
            if x < y { x } else { y }
        })
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        zip(&a, &b, |x, y| {
            let x = quiet(x);
            if x > y { x } else { y }
        })
    }
    #[inline(always)]
    fn to_i(self, a: F) -> I {
        map(&a, |x| x as i32)
    }
    #[inline(always)]
    fn to_f(self, a: I) -> F {
        map(&a, |x| x as f32)
    }
    #[inline(always)]
    fn to_half(self, a: F) -> I {
        map(&a, |x| halves::f32_to_half(x) as i32)
    }
    #[inline(always)]
    fn quiet_half_to_f(self, half: I) -> F {
        map(&half, |x| halves::half_to_f32(x as u16))
    }
    #[inline(always)]
    fn add_i(self, a: I, b: I) -> I {
        zip(&a, &b, i32::wrapping_add)
    }
    #[inline(always)]
    fn sub_i(self, a: I, b: I) -> I {
        zip(&a, &b, i32::wrapping_sub)
    }
    #[inline(always)]
    fn mul_i(self, a: I, b: I) -> I {
        zip(&a, &b, i32::wrapping_mul)
    }
    #[inline(always)]
    fn and_i(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| x & y)
    }
    #[inline(always)]
    fn or_i(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| x | y)
    }
    #[inline(always)]
    fn xor_i(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| x ^ y)
    }
    #[inline(always)]
    fn left_i(self, a: I, bits: u32) -> I {
        map(&a, |x| x << bits)
    }
    #[inline(always)]
    fn right_u(self, a: I, bits: u32) -> I {
        map(&a, |x| (x as u32 >> bits) as i32)
    }
    #[inline(always)]
    fn right_i(self, a: I, bits: u32) -> I {
        map(&a, |x| x >> bits)
    }
    #[inline(always)]
    fn left_each(self, a: I, bits: I) -> I {
        zip(&a, &bits, |x, n| {
            (x as u32).checked_shl(n as u32).unwrap_or(0) as i32
        })
    }
    #[inline(always)]
    fn right_each(self, a: I, bits: I) -> I {
        zip(&a, &bits, |x, n| {
            (x as u32).checked_shr(n as u32).unwrap_or(0) as i32
        })
    }
    #[inline(always)]
    fn table(self, table: &[f32; 16], index: I) -> F {
        map(&index, |i| table[i as usize & 15])
    }
    #[inline(always)]
    fn min_u(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| (x as u32).min(y as u32) as i32)
    }
    #[inline(always)]
    fn min_i(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| if x < y { x } else { y })
    }
    #[inline(always)]
    fn max_i(self, a: I, b: I) -> I {
        zip(&a, &b, |x, y| if x > y { x } else { y })
    }
    #[inline(always)]
    fn sign_i(self, a: I) -> I {
        map(&a, |x| x >> 31)
    }
    #[inline(always)]
    fn byte(self, a: I, index: u32) -> I {
        map(&a, |x| x >> (8 * index) & 0xff)
    }
    #[inline(always)]
    fn keep(self, a: I, mask: u16) -> I {
        let mut out = a;
        for lane in 0..LANES {
            out[lane] &= -((mask >> lane & 1) as i32);
        }
        out
    }
    #[inline(always)]
    fn ne_i(self, a: I, b: I) -> u16 {
        bits(&a, &b, |x, y| x != y)
    }
    #[inline(always)]
    fn lt_u(self, a: I, b: I) -> u16 {
        bits(&a, &b, |x, y| (x as u32) < y as u32)
    }
    #[inline(always)]
    fn gt(self, a: F, b: F) -> u16 {
        bits(&a, &b, |x, y| x > y)
    }
    #[inline(always)]
    fn at_least(self, a: F, b: F) -> I {
        let mut ones = [0; LANES];
        for lane in 0..LANES {
            ones[lane] = if a[lane] >= b[lane] { -1 } else { 0 };
        }
        ones
    }
    #[inline(always)]
    fn ge(self, a: F, b: F) -> u16 {
        bits(&a, &b, |x, y| x >= y)
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> u16 {
        bits(&a, &b, |x, y| x == y)
    }
    #[inline(always)]
    fn select(self, mask: u16, a: I, b: I) -> I {
        let mut out = b;
        for lane in 0..LANES {
            if mask >> lane & 1 != 0 {
                out[lane] = a[lane];
            }
        }
        out
    }
    #[inline(always)]
    fn quads(self, words: &[u32; 4]) -> I {
        let mut lanes = [0; LANES];
        for lane in 0..LANES {
            lanes[lane] = words[lane / 4] as i32;
        }
        lanes
    }

    #[inline(always)]
    fn sides<const AXIS: usize>(self, a: F) -> (F, F) {
        let (mut first, mut second) = (a, a);
        for lane in 0..LANES {
            first[lane] = a[lane & !AXIS];
            second[lane] = a[lane | AXIS];
        }
        (first, second)
    }

    #[inline(always)]
    unsafe fn load_quads(self, at: *const u8, stride_bytes: usize) -> I {
        let mut out = [0; LANES];
        for row in 0..4 {
            // SAFETY: the caller guarantees that sixteen bytes are readable at `at` and 1 to 3
            // strides behind it.
            let words = unsafe {
                let row = at.add(row * stride_bytes);
                row.cast::<[i32; 4]>().read_unaligned()
            };
            let first = 8 * (row / 2) + 2 * (row % 2);
            [out[first], out[first + 1], out[first + 4], out[first + 5]] = words;
        }
        out
    }
    #[inline(always)]
    unsafe fn store_quads(self, a: I, at: *mut u8, stride_bytes: usize) {
        for row in 0..4 {
            let first = 8 * (row / 2) + 2 * (row % 2);
            let words = [a[first], a[first + 1], a[first + 4], a[first + 5]];
            // SAFETY: the caller guarantees that sixteen bytes are writable at `at` and 1 to 3
            // strides behind it.
            unsafe {
                let row = at.add(row * stride_bytes);
                row.cast::<[i32; 4]>().write_unaligned(words);
            }
        }
    }
    #[inline(always)]
    unsafe fn load_quads_of_shorts(self, at: *const u8, stride_bytes: usize) -> I {
        let mut out = [0; LANES];
        for lane in 0..LANES {
            let (column, row) = (QUADS[0][lane] as usize, QUADS[1][lane] as usize);
            // SAFETY: the caller guarantees that eight bytes are readable at `at` and 1 to 3
            // strides behind it.
            let short = unsafe {
                let row = at.add(row * stride_bytes).cast::<u16>();
                row.add(column).read_unaligned()
            };
            out[lane] = short.into();
        }
        out
    }
    #[inline(always)]
    unsafe fn store_quads_of_shorts(self, a: I, at: *mut u8, stride_bytes: usize) {
        for lane in 0..LANES {
            let (column, row) = (QUADS[0][lane] as usize, QUADS[1][lane] as usize);
            // SAFETY: the caller guarantees that eight bytes are writable at `at` and 1 to 3
            // strides behind it.
            unsafe {
                let row = at.add(row * stride_bytes).cast::<u16>();
                row.add(column).write_unaligned(a[lane] as u16);
            }
        }
    }
    #[inline(always)]
    fn of_bytes(self, bytes: [u64; 2]) -> I {
        let mut out = [0; LANES];
        for lane in 0..LANES {
            out[lane] = (bytes[lane / 8] >> (lane % 8 * 8) & 0xff) as i32;
        }
        out
    }
    #[inline(always)]
    fn to_bytes(self, a: I) -> [u64; 2] {
        let mut bytes = [0; 2];
        for lane in 0..LANES {
            bytes[lane / 8] |= (a[lane] as u64 & 0xff) << (lane % 8 * 8);
        }
        bytes
    }
    #[inline(always)]
    unsafe fn load_each_quad(self, at: [*const u8; 4], stride_bytes: usize) -> I {
        let mut out = [0; LANES];
        for lane in 0..LANES {
            let row = at[lane / 4].wrapping_add(lane / 2 % 2 * stride_bytes);
            // SAFETY: the caller guarantees that eight bytes are readable at each place and a
            // stride behind it.
            out[lane] = unsafe { row.cast::<i32>().add(lane % 2).read_unaligned() };
        }
        out
    }
    #[inline(always)]
    unsafe fn put_each_quad<const WORDS: usize>(
        self,
        words: [I; WORDS],
        mask: u16,
        at: [*mut u8; 4],
        stride_bytes: usize,
    ) {
        for lane in 0..LANES {
            if mask >> lane & 1 == 0 {
                continue;
            }
            let row = at[lane / 4].wrapping_add(lane / 2 % 2 * stride_bytes);
            for (index, word) in words.iter().enumerate() {
                let place = lane % 2 * WORDS + index;
                // SAFETY: the caller guarantees that two texels are readable and writable at each
                // place and a stride behind it.
                unsafe { row.cast::<i32>().add(place).write_unaligned(word[lane]) };
            }
        }
    }
    #[inline(always)]
    unsafe fn load_quads_of_pairs(self, at: *const u8, stride_bytes: usize) -> (I, I) {
        let (mut a, mut b) = ([0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let (column, row) = (QUADS[0][lane] as usize, QUADS[1][lane] as usize);
            // SAFETY: the caller guarantees that 32 bytes are readable at `at` and 1 to 3 strides
            // behind it.
            let pair = unsafe {
                let row = at.add(row * stride_bytes).cast::<[i32; 2]>();
                row.add(column).read_unaligned()
            };
            [a[lane], b[lane]] = pair;
        }
        (a, b)
    }
    #[inline(always)]
    unsafe fn store_quads_of_pairs(self, a: I, b: I, at: *mut u8, stride_bytes: usize) {
        for lane in 0..LANES {
            let (column, row) = (QUADS[0][lane] as usize, QUADS[1][lane] as usize);
            // SAFETY: the caller guarantees that 32 bytes are writable at `at` and 1 to 3 strides
            // behind it.
            unsafe {
                let row = at.add(row * stride_bytes).cast::<[i32; 2]>();
                row.add(column).write_unaligned([a[lane], b[lane]]);
            }
        }
    }
    #[inline(always)]
    unsafe fn gather(self, base: *const u8, offsets: I) -> I {
        // SAFETY: the caller guarantees that four bytes are readable at each.
        map(&offsets, |offset| unsafe {
            let at = base.add(offset as u32 as usize);
            at.cast::<i32>().read_unaligned()
        })
    }
    #[inline(always)]
    unsafe fn gather_scalars<T: Copy + Into<u32>>(self, base: *const u8, offsets: I) -> I {
        // SAFETY: the caller guarantees that a scalar is readable at each.
        map(&offsets, |offset| unsafe {
            let at = base.add(offset as u32 as usize);
            at.cast::<T>().read_unaligned().into() as i32
        })
    }
    #[inline(always)]
    unsafe fn gather_pairs(self, base: *const u8, offsets: I) -> (I, I) {
        // SAFETY: the caller guarantees that eight bytes are readable at each.
        unsafe {
            (
                self.gather(base, offsets),
                self.gather(base.wrapping_add(4), offsets),
            )
        }
    }
    #[inline(always)]
    unsafe fn gather_quads(self, base: *const u8, offsets: I) -> [I; 4] {
        // SAFETY: the caller guarantees that sixteen bytes are readable at each.
        unsafe {
            [
                self.gather(base, offsets),
                self.gather(base.wrapping_add(4), offsets),
                self.gather(base.wrapping_add(8), offsets),
                self.gather(base.wrapping_add(12), offsets),
            ]
        }
    }

    #[inline(never)]
    unsafe fn apart<T: Task<Self>>(self, task: T) -> T::Output {
        // SAFETY: the caller keeps the contract of `Task::run` of the task.
        unsafe { task.run(self) }
    }
}
