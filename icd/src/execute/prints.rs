//! Messages of shaders (`NonSemantic.DebugPrintf`): a buffer before a command runs, and the texts
//! when it is complete.

#![forbid(unsafe_code)]

use std::sync::Arc;

use spirv_jit::Program;
use spirv_jit::printf::Prints;

use super::engine::Engine;
use crate::settings::settings;

/// The message buffer of a command; `None` if none of its programs prints.
pub(super) fn of<'a>(mut programs: impl Iterator<Item = &'a Arc<Program>>) -> Option<Arc<Prints>> {
    let limit_bytes = settings().prints?;
    (programs.any(|program| program.prints())).then(|| Arc::new(Prints::new(limit_bytes)))
}

/// Prints the messages of a command's programs in the order of its invocations, and the number of
/// messages that did not fit.
pub(super) fn print<'a>(
    engine: &Engine,
    prints: &Prints,
    programs: impl Iterator<Item = &'a Arc<Program>> + Clone,
) {
    let taken = prints.take();
    let limit = settings().prints.unwrap_or(0);
    let (mut texts, mut left, mut dropped) = (Vec::new(), limit, taken.dropped);
    let mut records = taken.records.iter();
    for record in records.by_ref() {
        let mut programs = programs.clone();
        let program = programs.find(|program| program.number() == record.program);
        let Some(text) = program.and_then(|program| program.printed(record)) else {
            continue;
        };
        // The line break included.
        let Some(rest) = left.checked_sub(text.len() + 1) else {
            dropped += 1;
            break;
        };
        left = rest;
        texts.push(text);
    }
    dropped += records.len() as u64;
    if dropped > 0 {
        texts.push(format!(
            "{dropped} more messages of shaders are past TUFF_DEBUG_PRINTF_BYTES ({limit})"
        ));
    }
    engine.print(&texts);
}
