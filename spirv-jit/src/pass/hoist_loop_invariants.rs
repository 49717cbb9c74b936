//! Pure operations on values from outside a loop, moved before it. Not out of a loop that yields: what lives across a yield is stored and loaded
//! there, which costs more than most operations.

use super::cost::cost;
use super::edit::edit_nodes;
use super::effects::{Effects, find_effects};
use crate::ir::{Body, Function, Node, Op, Value};

/// Moves each invariant as far out as it may go.
pub fn hoist_loop_invariants(function: &mut Function) {
    let mut hoister = Hoister {
        effects: find_effects(&function.body, function.labels),
        depth: vec![0; function.value_types.len()],
        loops: Vec::new(),
    };
    hoister.walk(&mut function.body);
}

/// An open loop.
struct Loop {
    yields: bool,
    /// What goes before it.
    hoisted: Vec<Node>,
}

struct Hoister {
    effects: Vec<Effects>,
    /// In how many loops each value is defined.
    depth: Vec<u32>,
    loops: Vec<Loop>,
}

impl Hoister {
    fn walk(&mut self, body: &mut Body) {
        edit_nodes(&mut body.nodes, |node, before| {
            match node {
                Node::Inst(inst) => {
                    let target = self.target(&inst.op, &inst.args);
                    for result in &inst.results {
                        self.depth[result.index()] = target as u32;
                    }
                    if target < self.loops.len() {
                        self.loops[target].hoisted.push(Node::Inst(inst.clone()));
                        return false;
                    }
                }
                Node::Block { results, body, .. } => {
                    self.walk(body);
                    self.define(results);
                }
                Node::If {
                    results,
                    then_body,
                    else_body,
                    ..
                } => {
                    self.walk(then_body);
                    self.walk(else_body);
                    self.define(results);
                }
                Node::Loop {
                    label,
                    params,
                    body: inside,
                    ..
                } => {
                    self.loops.push(Loop {
                        yields: self.effects[label.index()].yields,
                        hoisted: Vec::new(),
                    });
                    self.define(params);
                    self.walk(inside);
                    let done = self.loops.pop().expect("pushed above");
                    before.extend(done.hoisted);
                }
            }
            true
        });
    }

    fn define(&mut self, values: &[Value]) {
        for value in values {
            self.depth[value.index()] = self.loops.len() as u32;
        }
    }

    /// How many loops the operation will stand in.
    fn target(&self, op: &Op, args: &[Value]) -> usize {
        let here = self.loops.len();
        // Inputs are read where they lie; outside they would only take up a place.
        if !op.is_pure() || matches!(op, Op::Input(_)) {
            return here;
        }
        let needed = args.iter().map(|arg| self.depth[arg.index()]).max();
        let needed = needed.unwrap_or(0) as usize;
        if cost(op) == 0 {
            return needed;
        }
        let mut target = here;
        while target > needed && !self.loops[target - 1].yields {
            target -= 1;
        }
        target
    }
}
