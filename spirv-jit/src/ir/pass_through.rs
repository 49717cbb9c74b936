//! Pass-through programs: each output is a constant or an input row. The outputs can be computed
//! without running the program.

#![forbid(unsafe_code)]

use std::collections::HashMap;

use super::module::{Module, Node, Terminator};
use super::{Op, Value};

/// The source of a passed output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassThrough {
    Constant(u32),
    /// An index in [`Module::inputs`].
    Input(u32),
}

/// The outputs of a pass-through module.
pub fn pass_through(module: &Module) -> Option<Vec<PassThrough>> {
    let body = &module.functions.first()?.body;
    let mut known: HashMap<Value, PassThrough> = HashMap::new();
    for node in &body.nodes {
        let Node::Inst(inst) = node else {
            return None;
        };
        let passed = match (&inst.op, inst.args.as_slice()) {
            (Op::Const(bits), _) => PassThrough::Constant(*bits as u32),
            (Op::Input(row), _) => PassThrough::Input(*row),
            (Op::Bitcast, [from]) => *known.get(from)?,
            _ => return None,
        };
        known.insert(*inst.results.first()?, passed);
    }
    let Terminator::End(outputs) = &body.end else {
        return None;
    };
    outputs
        .iter()
        .map(|value| known.get(value).copied())
        .collect()
}
