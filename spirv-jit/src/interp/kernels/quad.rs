//! Derivatives: differences between the lanes of quads.

use std::marker::PhantomData;

use half::f16;
use lanes::vector::{self, Vector};
use lanes::{Tier as TierKind, quad};

use super::lane::{Lane, at};
use crate::SUBGROUP_SIZE;
use crate::eval::{self, Float};
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Kernel, Portable, Tier};
use crate::ir::{Op, Type};

/// The kernel of `derivative_x` or `derivative_y` on floats of a type.
pub(in crate::interp) fn derivative(tier: TierKind, op: &Op, ty: Type) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<crate::interp::tier::Avx2, vector::Avx2>(op, ty),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<crate::interp::tier::Avx512, vector::Avx512>(op, ty),
        _ => in_tier::<Portable, vector::Portable>(op, ty),
    }
}

fn in_tier<T: Tier, V: Vector + 'static>(op: &Op, ty: Type) -> Handler {
    match (op, ty) {
        (Op::DerivativeX, Type::F16) => Portable::handler::<Derivative<f16, { quad::X }>>(),
        (Op::DerivativeX, Type::F64) => T::handler::<Derivative<f64, { quad::X }>>(),
        (Op::DerivativeX, _) => T::handler::<Slope<V, { quad::X }>>(),
        (_, Type::F16) => Portable::handler::<Derivative<f16, { quad::Y }>>(),
        (_, Type::F64) => T::handler::<Derivative<f64, { quad::Y }>>(),
        (_, _) => T::handler::<Slope<V, { quad::Y }>>(),
    }
}

/// Of 32-bit floats.
struct Slope<V, const AXIS: usize>(PhantomData<V>);

impl<V: Vector, const AXIS: usize> Kernel for Slope<V, AXIS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: the tier is the token's; rows are the program's; a block is read before it is
        // written.
        unsafe {
            let v = V::new();
            let (a, d) = (m.row(i.a), m.row(i.d));
            for &subgroup in m.listed() {
                let active = m.active[subgroup as usize].bits();
                let slope = v.derivative::<AXIS>(v.load(&*at::<u32>(a, subgroup)), active);
                v.store(slope, &mut *at::<u32>(d, subgroup));
            }
        }
    }
}

struct Derivative<F, const AXIS: usize>(PhantomData<F>);

impl<F: Lane + Float, const AXIS: usize> Kernel for Derivative<F, AXIS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: rows are the program's; a block is read before it is written.
        unsafe {
            let (a, d) = (m.row(i.a), m.row(i.d));
            for &subgroup in m.listed() {
                let x = *at::<F::Slot>(a, subgroup);
                let mut values = [F::read(F::Slot::default()); SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    values[k] = F::read(x[k]);
                }
                let active = m.active[subgroup as usize].bits();
                let results = eval::quad::derivative::<F, AXIS>(&values, active);
                let mut r = [F::Slot::default(); SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    r[k] = results[k].write();
                }
                *at::<F::Slot>(d, subgroup) = r;
            }
        }
    }
}
