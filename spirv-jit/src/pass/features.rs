//! The features of a module, by which passes without work are skipped.

use crate::ir::{Module, Node, Op};

/// The features that occur in some function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Features {
    /// `var_address`.
    pub addresses: bool,
    /// Accesses to variables at fixed rows.
    pub variables: bool,
    pub loops: bool,
}

impl Features {
    /// Of a module as it is now.
    pub fn of(module: &Module) -> Self {
        let mut features = Self::default();
        for function in &module.functions {
            function.body.visit(&mut |node| match node {
                Node::Inst(inst) => match inst.op {
                    Op::VarAddress(_) => features.addresses = true,
                    Op::VarLoad(..) | Op::VarStore(..) => features.variables = true,
                    _ => {}
                },
                Node::Loop { .. } => features.loops = true,
                _ => {}
            });
        }
        features
    }
}
