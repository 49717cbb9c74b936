//! Messages of shaders: words of each invocation, for the dispatch's
//! [`Prints`](crate::printf::Prints).

use super::machine::{Instr, Machine};
use crate::printf::{MAX_KEY_WORDS, Record};

/// Adds message `x` of each active lane that is no helper invocation.
///
/// # Safety
/// As [`Kernel::run`](super::tier::Kernel::run).
#[cold]
pub(super) unsafe fn debug_printf(m: &mut Machine<'_>, i: &Instr) {
    let Some(prints) = &m.environment.prints else {
        return;
    };
    let plan = &m.code.prints[i.x as usize];
    let operands = &m.code.operands[plan.operands..][..plan.count];
    let (key, arguments) = operands.split_at(plan.key_words);
    for &subgroup in m.listed() {
        for lane in m.effective(subgroup) {
            // SAFETY: the caller keeps the contract of `Kernel::run`; operands are rows of the
            // program's words.
            let word = |&operand| unsafe { (*m.block::<u32>(operand, subgroup))[lane] };
            let mut record = Record {
                key: [0; MAX_KEY_WORDS],
                order: m.order,
                program: m.program,
                site: i.x,
                words: arguments.iter().map(word).collect(),
            };
            record.key[0] = plan.rank;
            for (place, operand) in record.key[1..].iter_mut().zip(key) {
                *place = word(operand);
            }
            prints.add(record);
        }
    }
}
