//! Copies of bodies under new names: of an iteration.

use crate::ir::{Body, Label, Node, Terminator, Value};

/// New names for what a copy of a body uses and defines.
pub struct Renaming {
    pub values: Vec<Value>,
    pub labels: Vec<Label>,
}

impl Renaming {
    fn rename(&self, value: &mut Value) {
        *value = self.values[value.index()];
    }

    fn rename_all(&self, values: &mut [Value]) {
        for value in values {
            self.rename(value);
        }
    }

    fn rename_label(&self, label: &mut Label) {
        *label = self.labels[label.index()];
    }

    /// Renames everything in a body.
    pub fn rename_body(&self, body: &mut Body) {
        for node in &mut body.nodes {
            match node {
                Node::Inst(inst) => {
                    self.rename_all(&mut inst.args);
                    self.rename_all(&mut inst.results);
                }
                Node::Block {
                    label,
                    results,
                    body,
                } => {
                    self.rename_label(label);
                    self.rename_all(results);
                    self.rename_body(body);
                }
                Node::If {
                    condition,
                    label,
                    results,
                    then_body,
                    else_body,
                } => {
                    self.rename(condition);
                    self.rename_label(label);
                    self.rename_all(results);
                    self.rename_body(then_body);
                    self.rename_body(else_body);
                }
                Node::Loop {
                    label,
                    params,
                    init,
                    body,
                } => {
                    self.rename_label(label);
                    self.rename_all(params);
                    self.rename_all(init);
                    self.rename_body(body);
                }
            }
        }
        match &mut body.end {
            Terminator::Br(label, args) => {
                self.rename_label(label);
                self.rename_all(args);
            }
            Terminator::Return(args) | Terminator::End(args) => self.rename_all(args),
            Terminator::Unreachable => {}
        }
    }
}
