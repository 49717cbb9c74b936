//! Replaces parameters and results of constructs that always hold one value with that value.

use super::substitution::{Substitution, rewrite_function};
use crate::ir::{Body, Function, Label, Node, Step, Terminator, Value};

/// Largest number of rounds. Each resolves the parameters of nested loops that the previous one
/// left.
const MAX_ROUNDS: usize = 4;

/// Replaces a block's results for which every `br` passes the same outer value, and loop parameters
/// that never change.
pub fn prune_parameters(function: &mut Function) {
    let mut substitution = Substitution::identity(function);
    for round in 0..MAX_ROUNDS {
        let mut pruner = Pruner {
            substitution: &mut substitution,
            position: vec![0; function.value_types.len()],
            next_position: 1,
            incoming: vec![Vec::new(); function.labels as usize],
            replaced: 0,
        };
        pruner.define(&function.params);
        pruner.walk(&function.body);
        if pruner.replaced == 0 {
            if round == 0 {
                return;
            }
            break;
        }
    }
    rewrite_function(
        function,
        &substitution,
        &|value| substitution.is_replaced(value),
        &|_| true,
    );
}

/// The arguments passed to a construct for one of its values.
#[derive(Clone, Copy, PartialEq)]
enum Incoming {
    None,
    One(Value),
    Many,
}

impl Incoming {
    fn add(&mut self, value: Value) {
        *self = match *self {
            Incoming::None => Incoming::One(value),
            Incoming::One(one) if one == value => Incoming::One(one),
            _ => Incoming::Many,
        }
    }
}

struct Pruner<'a> {
    substitution: &'a mut Substitution,
    /// The position of each definition in tree order. A value used in a construct and defined
    /// before it is visible after it.
    position: Vec<u32>,
    next_position: u32,
    incoming: Vec<Vec<Incoming>>,
    replaced: usize,
}

impl Pruner<'_> {
    fn define(&mut self, values: &[Value]) {
        for value in values {
            self.position[value.index()] = self.next_position;
        }
        self.next_position += 1;
    }

    fn open(&mut self, label: Label, count: usize) -> u32 {
        self.incoming[label.index()] = vec![Incoming::None; count];
        self.next_position += 1;
        self.next_position - 1
    }

    fn walk(&mut self, body: &Body) {
        // The position at which each open construct began.
        let mut begins = Vec::new();
        for step in body.steps() {
            match step {
                Step::Inst(inst) => self.define(&inst.results),
                Step::Open(node) => {
                    let Some(label) = node.label() else { continue };
                    begins.push(self.open(label, node.definitions().len()));
                    if let Node::Loop { params, .. } = node {
                        self.define(params);
                    }
                }
                Step::Else(_) => {}
                Step::End(body) => {
                    if let Terminator::Br(label, args) = &body.end {
                        for (incoming, &arg) in self.incoming[label.index()].iter_mut().zip(args) {
                            incoming.add(self.substitution.resolve(arg));
                        }
                    }
                }
                Step::Close(node) => {
                    let begin = begins.pop().unwrap_or(0);
                    match node {
                        Node::Inst(_) => {}
                        Node::Block { label, results, .. } | Node::If { label, results, .. } => {
                            self.close(*label, results, begin);
                        }
                        Node::Loop {
                            label,
                            params,
                            init,
                            ..
                        } => self.close_loop(*label, params, init),
                    }
                }
            }
        }
    }

    fn close(&mut self, label: Label, results: &[Value], begin: u32) {
        for (index, &result) in results.iter().enumerate() {
            if let Incoming::One(value) = self.incoming[label.index()][index] {
                let value = self.substitution.resolve(value);
                if self.position[value.index()] < begin {
                    self.replace(result, value);
                }
            }
        }
        self.define(results);
    }

    fn close_loop(&mut self, label: Label, params: &[Value], init: &[Value]) {
        for (index, (&param, &init)) in params.iter().zip(init).enumerate() {
            let init = self.substitution.resolve(init);
            let stays = match self.incoming[label.index()][index] {
                Incoming::None => true,
                Incoming::One(value) => {
                    let value = self.substitution.resolve(value);
                    value == param || value == init
                }
                Incoming::Many => false,
            };
            if stays {
                self.replace(param, init);
            }
        }
    }

    fn replace(&mut self, value: Value, replacement: Value) {
        if !self.substitution.is_replaced(value) {
            self.substitution.replace(value, replacement);
            self.replaced += 1;
        }
    }
}
