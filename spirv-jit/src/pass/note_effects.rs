//! Effects of an optimized fragment shader, which allow early tests or require masks in the
//! rasterizer.

use crate::ir::{Module, Op, Space};

/// Records whether invocations may become helpers, and whether they write memory.
pub fn note_effects(module: &mut Module) {
    let Some(mut facts) = module.fragment else {
        return;
    };
    for function in &module.functions {
        function.body.visit_insts(&mut |inst| match &inst.op {
            Op::Demote => facts.discards = true,
            Op::Store(access) => facts.writes_memory |= access.space != Space::Private,
            Op::Atomic(..) | Op::DebugPrintf(_) | Op::AbortMessage => facts.writes_memory = true,
            Op::Image(image) => facts.writes_memory |= !image.is_read(),
            _ => {}
        });
    }
    module.fragment = Some(facts);
}
