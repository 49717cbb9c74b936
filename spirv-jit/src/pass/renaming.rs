//! Copies of bodies with new names, for iterations of unrolled loops.

use crate::ir::{Body, Label, Terminator, Value};

/// New names for the values that a copy of a body uses and defines.
pub struct Renaming {
    pub values: Vec<Value>,
    pub labels: Vec<Label>,
}

impl Renaming {
    /// Renames everything in a body.
    pub fn rename_body(&self, body: &mut Body) {
        let value = |value: &mut Value| *value = self.values[value.index()];
        let label = |label: &mut Label| *label = self.labels[label.index()];
        body.visit_operands_mut(&mut { value });
        body.visit_bodies_mut(&mut |body| {
            for node in &mut body.nodes {
                node.definitions_mut().iter_mut().for_each(value);
                node.label_mut().into_iter().for_each(label);
            }
            if let Terminator::Br(target, _) = &mut body.end {
                label(target);
            }
        });
    }
}
