//! How scalars lie in rows, and loops over them.

use std::marker::PhantomData;

use half::f16;
use lanes::LaneMask;

use crate::SUBGROUP_SIZE;
use crate::interp::machine::{Instr, Machine};
use crate::interp::tier::Kernel;

/// A scalar type as it lies in a row.
pub(in crate::interp) trait Lane: Copy {
    type Slot: Copy + Default;
    fn read(slot: Self::Slot) -> Self;
    fn write(self) -> Self::Slot;
}

macro_rules! lane {
    ($t:ty, $slot:ty, $s:ident => $read:expr, $v:ident => $write:expr) => {
        impl Lane for $t {
            type Slot = $slot;
            #[inline(always)]
            fn read($s: $slot) -> Self {
                $read
            }
            #[inline(always)]
            fn write(self) -> $slot {
                let $v = self;
                $write
            }
        }
    };
}
lane!(bool, u32, s => s != 0, v => if v { !0 } else { 0 });
lane!(u8, u32, s => s as u8, v => v as u32);
lane!(u16, u32, s => s as u16, v => v as u32);
lane!(u32, u32, s => s, v => v);
lane!(u64, u64, s => s, v => v);
lane!(f16, u32, s => f16::from_bits(s as u16), v => v.to_bits() as u32);
lane!(f32, f32, s => s, v => v);
lane!(f64, f64, s => s, v => v);

/// A scalar type that kernels compute with, and how sixteen of a row come to it: `Held` is what a
/// lane is between the row and the operation.
pub(in crate::interp) trait Block: Copy {
    type Slot: Copy;
    type Held: Copy + Default;
    /// # Safety
    /// The lanes are there, and the machine has the type's instructions.
    unsafe fn load(from: *const [Self::Slot; SUBGROUP_SIZE]) -> [Self::Held; SUBGROUP_SIZE];
    /// # Safety
    /// As for [`Self::load`].
    unsafe fn store(held: [Self::Held; SUBGROUP_SIZE], to: *mut [Self::Slot; SUBGROUP_SIZE]);
    fn of(held: Self::Held) -> Self;
    fn held(self) -> Self::Held;
}

impl<T: Lane> Block for T {
    type Slot = T::Slot;
    type Held = T::Slot;
    #[inline(always)]
    unsafe fn load(from: *const [T::Slot; SUBGROUP_SIZE]) -> [T::Slot; SUBGROUP_SIZE] {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { *from }
    }
    #[inline(always)]
    unsafe fn store(held: [T::Slot; SUBGROUP_SIZE], to: *mut [T::Slot; SUBGROUP_SIZE]) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { *to = held }
    }
    #[inline(always)]
    fn of(held: T::Slot) -> T {
        T::read(held)
    }
    #[inline(always)]
    fn held(self) -> T::Slot {
        self.write()
    }
}

/// An operation on one, two or three scalars.
pub(in crate::interp) trait Unary<A, R> {
    fn call(a: A) -> R;
}
pub(in crate::interp) trait Binary<A, B, R> {
    fn call(a: A, b: B) -> R;
}
pub(in crate::interp) trait Ternary<A, B, C, R> {
    fn call(a: A, b: B, c: C) -> R;
}

pub(in crate::interp) struct Map1<O, A, R>(PhantomData<(O, A, R)>);
pub(in crate::interp) struct Map2<O, A, B, R>(PhantomData<(O, A, B, R)>);
pub(in crate::interp) struct Map3<O, A, B, C, R>(PhantomData<(O, A, B, C, R)>);

/// Sixteen lanes of a row.
///
/// # Safety
/// The row is a frame's, as `Machine::row` gives it, and `subgroup` one of the wave's.
#[inline(always)]
pub(super) unsafe fn at<S>(
    (base, step): (*mut u8, usize),
    subgroup: u16,
) -> *mut [S; SUBGROUP_SIZE] {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { base.add(subgroup as usize * step).cast() }
}

/// Sixteen lanes of a row, and how far it is to those of the next subgroup: 0 in uniform rows.
pub(super) struct Blocks<S> {
    pub at: *mut [S; SUBGROUP_SIZE],
    step: usize,
}

impl<S> Blocks<S> {
    /// # Safety
    /// As [`at`].
    #[inline(always)]
    pub unsafe fn new(row: (*mut u8, usize), subgroup: u16) -> Self {
        Self {
            // SAFETY: the caller keeps the contract of this function.
            at: unsafe { at(row, subgroup) },
            step: row.1,
        }
    }

    /// Goes on to the next subgroup. Behind the wave's last it leads nowhere.
    #[inline(always)]
    pub fn go_on(&mut self) {
        self.at = self.at.wrapping_byte_add(self.step);
    }
}

impl<O: Unary<A, R>, A: Block, R: Block> Kernel for Map1<O, A, R> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: rows are the program's; a block is read before it is written, so that in-place is
        // sound.
        unsafe {
            let (a, d) = (m.row(i.a), m.row(i.d));
            let (runs, count) = m.runs();
            for &subgroup in runs {
                let mut a = Blocks::<A::Slot>::new(a, subgroup);
                let mut d = Blocks::<R::Slot>::new(d, subgroup);
                for _ in 0..count {
                    let x = A::load(a.at);
                    let mut r = [R::Held::default(); SUBGROUP_SIZE];
                    for k in 0..SUBGROUP_SIZE {
                        r[k] = O::call(A::of(x[k])).held();
                    }
                    R::store(r, d.at);
                    a.go_on();
                    d.go_on();
                }
            }
        }
    }
}

impl<O: Binary<A, B, R>, A: Block, B: Block, R: Block> Kernel for Map2<O, A, B, R> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: as for `Map1`.
        unsafe {
            let (a, b, d) = (m.row(i.a), m.row(i.b), m.row(i.d));
            let (runs, count) = m.runs();
            for &subgroup in runs {
                let mut a = Blocks::<A::Slot>::new(a, subgroup);
                let mut b = Blocks::<B::Slot>::new(b, subgroup);
                let mut d = Blocks::<R::Slot>::new(d, subgroup);
                for _ in 0..count {
                    let (x, y) = (A::load(a.at), B::load(b.at));
                    let mut r = [R::Held::default(); SUBGROUP_SIZE];
                    for k in 0..SUBGROUP_SIZE {
                        r[k] = O::call(A::of(x[k]), B::of(y[k])).held();
                    }
                    R::store(r, d.at);
                    a.go_on();
                    b.go_on();
                    d.go_on();
                }
            }
        }
    }
}

impl<O, A: Block, B: Block, C: Block, R: Block> Kernel for Map3<O, A, B, C, R>
where
    O: Ternary<A, B, C, R>,
{
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: as for `Map1`.
        unsafe {
            let (a, b, c, d) = (m.row(i.a), m.row(i.b), m.row(i.c), m.row(i.d));
            let (runs, count) = m.runs();
            for &subgroup in runs {
                let mut a = Blocks::<A::Slot>::new(a, subgroup);
                let mut b = Blocks::<B::Slot>::new(b, subgroup);
                let mut c = Blocks::<C::Slot>::new(c, subgroup);
                let mut d = Blocks::<R::Slot>::new(d, subgroup);
                for _ in 0..count {
                    let (x, y, z) = (A::load(a.at), B::load(b.at), C::load(c.at));
                    let mut r = [R::Held::default(); SUBGROUP_SIZE];
                    for k in 0..SUBGROUP_SIZE {
                        r[k] = O::call(A::of(x[k]), B::of(y[k]), C::of(z[k])).held();
                    }
                    R::store(r, d.at);
                    a.go_on();
                    b.go_on();
                    c.go_on();
                    d.go_on();
                }
            }
        }
    }
}

/// The lanes' sign bits.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(in crate::interp) fn sign_bits(lanes: &[u32; SUBGROUP_SIZE]) -> LaneMask {
    use std::arch::x86_64::*;
    // SAFETY: every x86-64 processor has SSE2; the lanes are four registers.
    unsafe {
        let at = lanes.as_ptr().cast::<__m128i>();
        let quarter = |k: usize| _mm_loadu_si128(at.add(k));
        // Saturated, so that signs stay.
        let low = _mm_packs_epi32(quarter(0), quarter(1));
        let high = _mm_packs_epi32(quarter(2), quarter(3));
        LaneMask::from_bits(_mm_movemask_epi8(_mm_packs_epi16(low, high)) as u16)
    }
}

/// The lanes' sign bits.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(in crate::interp) fn sign_bits(lanes: &[u32; SUBGROUP_SIZE]) -> LaneMask {
    let mut bits = [0u32; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        bits[k] = if lanes[k] >> 31 != 0 { 1 << k } else { 0 };
    }
    LaneMask::from_bits(bits.iter().fold(0, |all, bit| all | bit) as u16)
}
