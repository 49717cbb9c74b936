//! Values and labels numbered in order of definition, without gaps: tables by value are as short as the program, and its text reads in order.

use crate::ir::{Body, Function, Label, Node, Terminator, Value};

/// Renumbers one function.
pub fn renumber_values(function: &mut Function) {
    let mut numbering = Numbering {
        numbers: vec![Value(u32::MAX); function.value_types.len()],
        next_value: 0,
        labels: vec![Label(u32::MAX); function.labels as usize],
        next_label: 0,
    };
    numbering.define(&mut function.params);
    numbering.visit(&mut function.body);
    let mut types = vec![crate::ir::Type::I1; numbering.next_value as usize];
    for (old, &new) in numbering.numbers.iter().enumerate() {
        if new.0 != u32::MAX {
            types[new.index()] = function.value_types[old];
        }
    }
    function.value_types = types;
    function.labels = numbering.next_label;
}

struct Numbering {
    /// The new number of each value defined so far.
    numbers: Vec<Value>,
    next_value: u32,
    labels: Vec<Label>,
    next_label: u32,
}

impl Numbering {
    fn define(&mut self, values: &mut [Value]) {
        for value in values {
            self.numbers[value.index()] = Value(self.next_value);
            *value = Value(self.next_value);
            self.next_value += 1;
        }
    }

    fn open(&mut self, label: &mut Label) {
        self.labels[label.index()] = Label(self.next_label);
        *label = Label(self.next_label);
        self.next_label += 1;
    }

    fn rename(&self, values: &mut [Value]) {
        for value in values {
            *value = self.numbers[value.index()];
        }
    }

    fn visit(&mut self, body: &mut Body) {
        for node in &mut body.nodes {
            match node {
                Node::Inst(inst) => {
                    self.rename(&mut inst.args);
                    self.define(&mut inst.results);
                }
                Node::Block {
                    label,
                    results,
                    body,
                } => {
                    self.open(label);
                    self.visit(body);
                    self.define(results);
                }
                Node::If {
                    condition,
                    label,
                    results,
                    then_body,
                    else_body,
                } => {
                    *condition = self.numbers[condition.index()];
                    self.open(label);
                    self.visit(then_body);
                    self.visit(else_body);
                    self.define(results);
                }
                Node::Loop {
                    label,
                    params,
                    init,
                    body,
                } => {
                    self.rename(init);
                    self.open(label);
                    self.define(params);
                    self.visit(body);
                }
            }
        }
        match &mut body.end {
            Terminator::Br(label, args) => {
                *label = self.labels[label.index()];
                self.rename(args);
            }
            Terminator::Return(args) | Terminator::End(args) => self.rename(args),
            Terminator::Unreachable => {}
        }
    }
}
