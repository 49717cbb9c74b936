//! Atomics on real memory, in lane order: a kernel for each operation and width.
//!
//! If all lanes of a subgroup access one address, the operations run in registers, and one
//! compare-and-swap writes the last result. Workgroup memory belongs to the worker that runs the
//! workgroup, so accesses to it need no lock.
//!
//! No access overlaps a locked one. So the addresses of the next subgroup are found, and their
//! memory is asked for, before a subgroup's operations.

use std::marker::PhantomData;
use std::sync::atomic::{AtomicU16, AtomicU32, AtomicU64, Ordering};

use half::f16;
use lanes::{LaneMask, Row, prefetch_line};

use super::code::AtomicPlan;
use super::gather::{Gather, Layout};
use super::kernels::{Binary, Lane, ops};
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::region::region;
use super::tier::{Kernel, Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::eval::{self, Float, Int};
use crate::ir::op::AtomicOp;
use crate::ir::{Space, Type};

const ORDER: Ordering = Ordering::SeqCst;

/// The kernel of an atomic on values of a type; `None` if the type has no such operation. The
/// instruction names the plan in `x` and the result in `d`, and `y` is not zero if that is used.
/// Accesses that are outside the memory or misaligned read zero and change nothing; so do helper
/// invocations.
pub(super) fn handler(op: AtomicOp, ty: Type) -> Option<Handler> {
    if ty.bits() < 16 {
        return None;
    }
    Some(match op {
        AtomicOp::Load => of_bits::<Load>(ty),
        AtomicOp::Store => of_bits::<Store>(ty),
        AtomicOp::Exchange => of_bits::<Exchange>(ty),
        AtomicOp::CompareExchange => of_bits::<CompareExchange>(ty),
        AtomicOp::IAdd => of_bits::<Add>(ty),
        AtomicOp::ISub => of_bits::<Subtract>(ty),
        AtomicOp::SMin => of_bits::<Update<ops::smin>>(ty),
        AtomicOp::UMin => of_bits::<Update<ops::umin>>(ty),
        AtomicOp::SMax => of_bits::<Update<ops::smax>>(ty),
        AtomicOp::UMax => of_bits::<Update<ops::umax>>(ty),
        AtomicOp::And => of_bits::<Update<ops::and>>(ty),
        AtomicOp::Or => of_bits::<Update<ops::or>>(ty),
        AtomicOp::Xor => of_bits::<Update<ops::xor>>(ty),
        AtomicOp::FAdd => return of_floats::<ops::fadd>(ty),
        AtomicOp::FMin => return of_floats::<ops::fmin>(ty),
        AtomicOp::FMax => return of_floats::<ops::fmax>(ty),
        AtomicOp::FAddFlushed => of_flushed::<ops::fadd>(),
        AtomicOp::FMinFlushed => of_flushed::<ops::fmin>(),
        AtomicOp::FMaxFlushed => of_flushed::<ops::fmax>(),
    })
}

fn of_bits<O: Atomic<u16> + Atomic<u32> + Atomic<u64>>(ty: Type) -> Handler {
    match ty.bits() {
        16 => Portable::handler::<Performing<O, u16>>(),
        64 => Portable::handler::<Performing<O, u64>>(),
        _ => Portable::handler::<Performing<O, u32>>(),
    }
}

fn of_flushed<O: Binary<f32, f32, f32> + 'static>() -> Handler {
    Portable::handler::<Performing<UpdateFloat<Flushed<O>, f32>, u32>>()
}

fn of_floats<O>(ty: Type) -> Option<Handler>
where
    O: Binary<f16, f16, f16> + Binary<f32, f32, f32> + Binary<f64, f64, f64> + 'static,
{
    Some(match ty {
        Type::F16 => Portable::handler::<Performing<UpdateFloat<O, f16>, u16>>(),
        Type::F32 => Portable::handler::<Performing<UpdateFloat<O, f32>, u32>>(),
        Type::F64 => Portable::handler::<Performing<UpdateFloat<O, f64>, u64>>(),
        _ => return None,
    })
}

/// A memory cell of some width, as bits. All operations are sequentially consistent.
trait Cell: Int + Lane {
    /// The contents.
    ///
    /// # Safety
    /// Of all functions: the cell may be read and written, and is aligned to its size.
    unsafe fn load(at: *mut Self) -> Self;
    /// Stores `new` if the cell holds `old`; otherwise returns the contents as an error.
    unsafe fn replace(at: *mut Self, old: Self, new: Self) -> Result<Self, Self>;
    unsafe fn fetch_store(at: *mut Self, value: Self) -> Self;
    unsafe fn fetch_add(at: *mut Self, value: Self) -> Self;
}

macro_rules! cell {
    ($($bits:ident $atomic:ident),*) => {$(
        impl Cell for $bits {
            #[inline(always)]
            unsafe fn load(at: *mut Self) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $atomic::from_ptr(at) }.load(ORDER)
            }
            #[inline(always)]
            unsafe fn replace(at: *mut Self, old: Self, new: Self) -> Result<Self, Self> {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $atomic::from_ptr(at) }.compare_exchange(old, new, ORDER, ORDER)
            }
            #[inline(always)]
            unsafe fn fetch_store(at: *mut Self, value: Self) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $atomic::from_ptr(at) }.swap(value, ORDER)
            }
            #[inline(always)]
            unsafe fn fetch_add(at: *mut Self, value: Self) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $atomic::from_ptr(at) }.fetch_add(value, ORDER)
            }
        }
    )*};
}
cell!(u16 AtomicU16, u32 AtomicU32, u64 AtomicU64);

/// An atomic operation on a cell.
trait Atomic<T: Cell>: 'static {
    /// The operation has a result: the old contents.
    const GIVES: bool = true;
    /// The operation changes nothing.
    const READS: bool = false;
    /// The new contents.
    fn update(old: T, value: T, comparator: T) -> T;
    /// Performs one lane's operation; returns the old contents.
    ///
    /// # Safety
    /// As for [`Cell`].
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, comparator: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let mut old = T::load(at);
            while let Err(other) = T::replace(at, old, Self::update(old, value, comparator)) {
                old = other;
            }
            old
        }
    }
}

struct Load;

impl<T: Cell> Atomic<T> for Load {
    const READS: bool = true;
    #[inline(always)]
    fn update(old: T, _: T, _: T) -> T {
        old
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, _: T, _: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::load(at) }
    }
}

/// A store: an exchange without a result.
struct Store;

impl<T: Cell> Atomic<T> for Store {
    const GIVES: bool = false;
    #[inline(always)]
    fn update(_: T, value: T, _: T) -> T {
        value
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, _: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::fetch_store(at, value) }
    }
}

struct Exchange;

impl<T: Cell> Atomic<T> for Exchange {
    #[inline(always)]
    fn update(_: T, value: T, _: T) -> T {
        value
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, _: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::fetch_store(at, value) }
    }
}

struct CompareExchange;

impl<T: Cell> Atomic<T> for CompareExchange {
    #[inline(always)]
    fn update(old: T, value: T, comparator: T) -> T {
        if old == comparator { value } else { old }
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, comparator: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::replace(at, comparator, value) }.unwrap_or_else(|old| old)
    }
}

struct Add;

impl<T: Cell> Atomic<T> for Add {
    #[inline(always)]
    fn update(old: T, value: T, _: T) -> T {
        old.add(value)
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, _: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::fetch_add(at, value) }
    }
}

struct Subtract;

impl<T: Cell> Atomic<T> for Subtract {
    #[inline(always)]
    fn update(old: T, value: T, _: T) -> T {
        old.sub(value)
    }
    #[inline(always)]
    unsafe fn perform(at: *mut T, value: T, _: T) -> T {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { T::fetch_add(at, T::ZERO.sub(value)) }
    }
}

/// An update by an integer operation.
struct Update<O>(PhantomData<O>);

impl<T: Cell, O: Binary<T, T, T> + 'static> Atomic<T> for Update<O> {
    #[inline(always)]
    fn update(old: T, value: T, _: T) -> T {
        O::call(old, value)
    }
}

/// An update by an operation on floats of type `F`.
struct UpdateFloat<O, F>(PhantomData<(O, F)>);

impl<F: Float, O: Binary<F, F, F> + 'static> Atomic<F::Bits> for UpdateFloat<O, F>
where
    F::Bits: Cell,
{
    #[inline(always)]
    fn update(old: F::Bits, value: F::Bits, _: F::Bits) -> F::Bits {
        O::call(F::from_bits(old), F::from_bits(value)).bits()
    }
}

/// An operation whose denormal results are flushed.
struct Flushed<O>(PhantomData<O>);

impl<O: Binary<f32, f32, f32>> Binary<f32, f32, f32> for Flushed<O> {
    #[inline(always)]
    fn call(a: f32, b: f32) -> f32 {
        eval::fflush_denormal(O::call(a, b))
    }
}

/// The addresses that lanes of a subgroup access.
struct Places {
    /// By lane, where they differ.
    at: [*mut u8; SUBGROUP_SIZE],
    /// Lanes whose address is inside the memory and aligned.
    inside: LaneMask,
    /// The address of all these lanes, where they have the same.
    one: Option<*mut u8>,
}

impl Places {
    const NONE: Places = Places {
        at: [std::ptr::null_mut(); SUBGROUP_SIZE],
        inside: LaneMask::NONE,
        one: None,
    };

    /// Asks for the memory of lanes whose addresses differ: operations that are one behind another
    /// would wait for each address by itself.
    fn prefetch(&self) {
        for lane in 0..SUBGROUP_SIZE {
            if self.inside.contains(lane) {
                prefetch_line(self.at[lane]);
            }
        }
    }
}

/// Finds the addresses of the lanes of a listed subgroup, by its number in the list, if there is
/// one. `reads`: helper invocations take part.
///
/// # Safety
/// The operands are the plan's.
#[inline(never)]
unsafe fn find_places(
    m: &Machine<'_>,
    space: Space,
    address: &[Operand],
    (number, reads): (usize, bool),
    size: u64,
    places: &mut Places,
) {
    (places.inside, places.one) = (LaneMask::NONE, None);
    let Some(&subgroup) = m.listed().get(number) else {
        return;
    };
    let lanes = match reads {
        true => m.active[subgroup as usize],
        false => m.effective(subgroup),
    };
    if lanes.is_empty() {
        return;
    }
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let shares = match space {
            Space::Buffer => m.common(address[0], subgroup, lanes).is_some(),
            _ => space == Space::Shared,
        };
        if !shares {
            let mut is_one = true;
            for lane in lanes {
                let place = region(m, space, address, subgroup, lane).at(0, size);
                let place = place.filter(|place| (*place as u64).is_multiple_of(size));
                if let Some(place) = place {
                    let inside = places.inside;
                    is_one &= inside.is_empty() || places.at[inside.first()] == place;
                    places.at[lane] = place;
                    places.inside.insert(lane);
                }
            }
            if is_one && !places.inside.is_empty() {
                places.one = Some(places.at[places.inside.first()]);
            } else if space != Space::Private {
                places.prefetch();
            }
            return;
        }
        let region = region(m, space, address, subgroup, lanes.first());
        let offsets = &*m.block::<u32>(address[address.len() - 1], subgroup);
        let Some(last) = region.size_bytes.min(1 << 32).checked_sub(size) else {
            return;
        };
        let filled;
        let filled = match lanes {
            LaneMask::ALL => offsets,
            _ => {
                filled = Portable::fill(offsets, lanes);
                &filled
            }
        };
        places.inside = match Portable::layout(filled, last as u32, 0) {
            Layout::Same => {
                let place = region.base.add(filled[0] as usize);
                if (place as u64).is_multiple_of(size) {
                    (places.inside, places.one) = (lanes, Some(place));
                }
                return;
            }
            Layout::Outside(inside) => lanes & inside,
            _ => lanes,
        };
        let mut low: Row = [0; SUBGROUP_SIZE];
        for k in 0..SUBGROUP_SIZE {
            places.at[k] = region.base.wrapping_add(offsets[k] as usize);
            low[k] = (region.base as u32).wrapping_add(offsets[k]);
        }
        places.inside -= LaneMask::with_any(&low, size as u32 - 1);
        if space != Space::Shared {
            places.prefetch();
        }
    }
}

/// The kernel of an atomic on cells of type `T`.
struct Performing<O, T>(PhantomData<(O, T)>);

impl<O: Atomic<T>, T: Cell> Kernel for Performing<O, T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan: AtomicPlan = m.code.atomics[i.x as usize];
        let operands = &m.code.operands[plan.operands as usize..];
        let (address, values) = operands.split_at(plan.space.address_operands());
        let count = value_count(plan.op);
        let mut places = [Places::NONE; 2];
        let mut old = [T::ZERO; SUBGROUP_SIZE];
        let none = [T::Slot::default(); SUBGROUP_SIZE];
        let find = |m: &Machine<'_>, number: usize, places: &mut Places| {
            let (size, subgroup) = (size_of::<T>() as u64, (number, O::READS));
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program.
            unsafe { find_places(m, plan.space, address, subgroup, size, places) }
        };
        find(m, 0, &mut places[0]);
        for (number, &subgroup) in m.listed().iter().enumerate() {
            find(m, number + 1, &mut places[(number + 1) % 2]);
            let places = &places[number % 2];
            let active = m.active[subgroup as usize];
            // SAFETY: as above; addresses are checked, and other shader threads access the memory
            // only by atomics or as the application allows.
            unsafe {
                if !places.inside.is_empty() {
                    let operand = |k: usize| match k < count {
                        true => m.block::<T::Slot>(values[k], subgroup).cast_const(),
                        false => &raw const none,
                    };
                    let operands = [operand(0), operand(1)];
                    perform::<O, T>(places, plan.space == Space::Shared, operands, &mut old);
                }
                if O::GIVES && i.y != 0 {
                    let results = &mut *m.block::<T::Slot>(i.d, subgroup);
                    for lane in 0..SUBGROUP_SIZE {
                        if active.contains(lane) {
                            results[lane] = match places.inside.contains(lane) {
                                true => old[lane].write(),
                                false => T::ZERO.write(),
                            };
                        }
                    }
                }
            }
        }
    }
}

/// Performs a subgroup's atomics in lane order and gives the old contents.
///
/// # Safety
/// The addresses may be written. If they are the worker's own, no other thread accesses them. The
/// operands are rows of `T`.
#[inline(always)]
unsafe fn perform<O: Atomic<T>, T: Cell>(
    places: &Places,
    are_own: bool,
    [values, comparators]: [*const [T::Slot; SUBGROUP_SIZE]; 2],
    old: &mut [T; SUBGROUP_SIZE],
) {
    let inside = places.inside;
    // SAFETY: the caller keeps the contract of this function.
    let operands =
        |lane: usize| unsafe { (T::read((*values)[lane]), T::read((*comparators)[lane])) };
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        if let Some(at) = places.one.filter(|_| !O::READS && inside.count() > 1) {
            let at = at.cast::<T>();
            let mut before = if are_own { at.read() } else { T::load(at) };
            loop {
                let mut now = before;
                for lane in 0..SUBGROUP_SIZE {
                    if inside.contains(lane) {
                        let (value, comparator) = operands(lane);
                        old[lane] = now;
                        now = O::update(now, value, comparator);
                    }
                }
                if are_own {
                    return at.write(now);
                }
                match T::replace(at, before, now) {
                    Ok(_) => return,
                    Err(other) => before = other,
                }
            }
        }
        for lane in 0..SUBGROUP_SIZE {
            if !inside.contains(lane) {
                continue;
            }
            let at = places.one.unwrap_or(places.at[lane]).cast::<T>();
            let (value, comparator) = operands(lane);
            old[lane] = match are_own {
                true => {
                    let before = at.read();
                    if !O::READS {
                        at.write(O::update(before, value, comparator));
                    }
                    before
                }
                false => O::perform(at, value, comparator),
            };
        }
    }
}

/// Value operands of an atomic.
pub(super) fn value_count(op: AtomicOp) -> usize {
    match op {
        AtomicOp::Load => 0,
        AtomicOp::CompareExchange => 2,
        _ => 1,
    }
}
