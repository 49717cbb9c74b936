//! Stretches of native code as instructions.

use super::machine::{Instr, Machine};
use crate::native::Code;

/// Where a stretch's code is, in an instruction's two words.
pub(super) fn words(address: u64) -> (u32, u32) {
    (address as u32, (address >> 32) as u32)
}

/// The stretch whose code is at the address in `x` and `y`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs, which owns the code.
pub(super) unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
    let address = i.x as usize | (i.y as usize) << 32;
    let (runs, count) = m.runs();
    // SAFETY: as the caller promises; subgroups are the wave's, whose frames follow one another.
    unsafe {
        let code = std::mem::transmute::<usize, Code>(address);
        for &subgroup in runs {
            let frame = m.vectors.add(subgroup as usize * m.frame_bytes);
            let lanes = m.active.as_ptr().add(subgroup as usize);
            code(frame, m.uniforms, count, m.frame_bytes, lanes);
        }
    }
}
