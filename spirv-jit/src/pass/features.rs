//! What a module has, by which passes are left out that would find nothing to do.

use crate::ir::{Body, Module, Node, Op};

/// What occurs in some function.
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
            features.add(&function.body);
        }
        features
    }

    fn add(&mut self, body: &Body) {
        for node in &body.nodes {
            match node {
                Node::Inst(inst) => match inst.op {
                    Op::VarAddress(_) => self.addresses = true,
                    Op::VarLoad(..) | Op::VarStore(..) => self.variables = true,
                    _ => {}
                },
                Node::Block { body, .. } => self.add(body),
                Node::Loop { body, .. } => {
                    self.loops = true;
                    self.add(body);
                }
                Node::If {
                    then_body,
                    else_body,
                    ..
                } => {
                    self.add(then_body);
                    self.add(else_body);
                }
            }
        }
    }
}
