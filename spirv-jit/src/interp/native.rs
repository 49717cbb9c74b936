//! Stretches of native code as instructions.

use std::mem::MaybeUninit;

use lanes::LaneMask;

use super::code::LoopPlan;
use super::control::mask;
use super::machine::{Instr, Machine, NO_LANES, occupied};
use super::operand::Operand;
use crate::native::{Code, LoopCode, LoopContext, Own, Region, STAYING, WORKGROUP, ZEROS};

/// Where a stretch's code is, in an instruction's two words.
pub(super) fn words(address: u64) -> (u32, u32) {
    (address as u32, (address >> 32) as u32)
}

fn address(i: &Instr) -> usize {
    i.x as usize | (i.y as usize) << 32
}

/// The stretch whose code is at the address in `x` and `y`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs, which owns the code.
pub(super) unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
    let (runs, count) = m.runs();
    // SAFETY: the caller guarantees that the instruction was emitted for the program that the
    // machine runs, which owns the code; subgroups are the wave's, whose frames follow one another.
    unsafe {
        let code = std::mem::transmute::<usize, Code>(address(i));
        for &subgroup in runs {
            let frame = m.vectors.add(subgroup as usize * m.frame_bytes);
            let lanes = m.active.as_ptr().add(subgroup as usize);
            code(frame, m.uniforms, count, m.frame_bytes, lanes);
        }
    }
}

/// Whether operands are the same in all subgroups with active lanes, by the first lane of each.
///
/// # Safety
/// The operands are the program's, and tell which have 64 bits.
unsafe fn are_shared(m: &Machine<'_>, operands: &[(Operand, bool)]) -> bool {
    operands.iter().all(|&(operand, is_wide)| {
        let mut scalars = m.listed().iter().map(|&subgroup| {
            let lane = m.active[subgroup as usize].first();
            // SAFETY: as the caller promises; listed subgroups are the wave's, and have lanes.
            unsafe { m.lane(operand, subgroup, lane, is_wide) }
        });
        let first = scalars.next();
        scalars.all(|scalar| Some(scalar) == first)
    })
}

/// Writes where a loop's memory is: the regions that it has, and no others.
///
/// # Safety
/// As [`run`]; the plan is one of the program's, and the context is memory that may be written.
unsafe fn find_memory(
    m: &Machine<'_>,
    plan: &LoopPlan,
    context: *mut LoopContext,
    own: &mut [Own; NO_LANES.len()],
) {
    // SAFETY: the caller keeps the contract of this function. Descriptors are uniform: the same in
    // every lane. A plan has at most `MAX_REGIONS` regions.
    unsafe {
        (*context).private_rows = m.plan.private_rows as u32;
        (*context).zeros = &raw const ZEROS;
        let regions = (&raw mut (*context).regions).cast::<Region>();
        for (k, &(operand, is_written)) in plan.regions.iter().enumerate() {
            let descriptor = m.environment.descriptor(m.lane(operand, 0, 0, true));
            let base = descriptor.address as *const u8;
            let none = match is_written {
                true => &raw const (*context).dropped,
                false => &raw const ZEROS,
            };
            (regions.add(k)).write(Region::new(base, descriptor.size_bytes, none));
        }
        if !plan.takes_own {
            return;
        }
        for &subgroup in m.listed() {
            let (base, size_bytes) = m.workgroup_memory(subgroup);
            let region = Region::new(base, size_bytes, &raw const ZEROS);
            (regions.add(WORKGROUP)).write(region);
            own[subgroup as usize] = Own {
                private: m.state_row(subgroup as usize, m.plan.private).cast(),
                workgroup: region.base(),
            };
        }
    }
}

/// All turns of loop `a`, whose code is at the address in `x` and `y`: lanes that leave it are
/// parked at the label that it is left to, those that stay when the fuel is out at its own.
///
/// # Safety
/// As [`run`].
pub(super) unsafe fn run_loop(m: &mut Machine<'_>, i: &Instr) {
    const { assert!(STAYING == size_of_val(&NO_LANES)) };
    let plan = &m.code.loops[i.a.raw() as usize];
    // Masks of lanes that stay lie behind those of active ones.
    let mut lanes = [m.active, NO_LANES];
    // A turn of a wave costs as much as one of each subgroup, and code counts half subgroups.
    let parts = 2 * m.list_len.max(1) as i64;
    let fuel = m.fuel.min(1 << 40) as i64 * parts;
    let mut context = MaybeUninit::<LoopContext>::uninit();
    let context = context.as_mut_ptr();
    const NONE: Own = Own {
        private: std::ptr::null_mut(),
        workgroup: std::ptr::null(),
    };
    let mut own = [NONE; NO_LANES.len()];
    // SAFETY: the caller keeps the contract of `run`; subgroups are the wave's, whose frames follow
    // one another.
    unsafe {
        (*context).fuel = fuel;
        find_memory(m, plan, context, &mut own);
        let together = std::mem::transmute::<usize, LoopCode>(address(i));
        let single = std::mem::transmute::<usize, LoopCode>(address(i) + plan.single);
        let width = match are_shared(m, &plan.shared) {
            true => plan.together,
            false => usize::MAX,
        };
        let mut rest = m.listed();
        while let Some(&subgroup) = rest.first() {
            let neighbours = (rest.iter().zip(subgroup..)).take_while(|(a, b)| **a == *b);
            let count = neighbours.count();
            rest = &rest[count..];
            let frame = m.vectors.add(subgroup as usize * m.frame_bytes);
            let lanes = lanes.as_mut_ptr().cast::<LaneMask>().add(subgroup as usize);
            (*context).own = own.as_ptr().add(subgroup as usize);
            let all = count / width;
            let done = all * plan.together;
            if all != 0 {
                together(frame, m.uniforms, all, m.frame_bytes, lanes, context);
            }
            if count != done {
                let (frame, lanes) = (frame.add(done * m.frame_bytes), lanes.add(done));
                single(
                    frame,
                    m.uniforms,
                    count - done,
                    m.frame_bytes,
                    lanes,
                    context,
                );
            }
        }
        let [entered, staying] = lanes;
        for (s, parked) in mask(m, plan.left_to).iter_mut().enumerate() {
            *parked |= entered[s] - staying[s];
        }
        *mask(m, plan.label) = staying;
        let burnt = (fuel - (*context).fuel) as u64;
        m.fuel = match occupied(&staying) {
            0 => m.fuel.saturating_sub(burnt.div_ceil(parts as u64)),
            _ => 0,
        };
    }
}
