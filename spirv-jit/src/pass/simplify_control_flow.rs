//! Constructs that are not needed: conditions that are constant, blocks that are left in one way at their end, loops without a back-edge, what
//! follows a construct that nothing comes out of, blocks around an `if` that decides who leaves them; and `if`s so small that both sides
//! cost less than the branch.

use smallvec::smallvec;

use super::cost::cost;
use super::substitution::Substitution;
use crate::ir::{Body, Function, Inst, Label, Node, Op, Terminator, Value};

/// The most that both sides of an `if` may cost to be computed in all lanes.
const MAX_FLAT_COST: u32 = 8;

/// Simplifies control flow, inner constructs first.
pub fn simplify_control_flow(function: &mut Function) {
    let mut body = std::mem::replace(&mut function.body, unreachable());
    let mut simplifier = Simplifier {
        substitution: Substitution::identity(function),
        constants: vec![None; function.value_types.len()],
        branches: vec![0; function.labels as usize],
    };
    simplifier.count_branches(&body, 1);
    simplifier.simplify_body(&mut body);
    function.body = body;
}

fn unreachable() -> Body {
    Body {
        nodes: Vec::new(),
        end: Terminator::Unreachable,
    }
}

struct Simplifier {
    substitution: Substitution,
    /// Conditions that are known.
    constants: Vec<Option<bool>>,
    /// How many `br` lead to each label.
    branches: Vec<i32>,
}

/// Whether anything comes after a node.
enum Flow {
    On,
    Ends(Terminator),
}

impl Simplifier {
    /// Adds the `br`s of a body to the counts, or takes them away.
    fn count_branches(&mut self, body: &Body, step: i32) {
        body.visit_bodies(&mut |body| {
            if let Terminator::Br(label, _) = body.end {
                self.branches[label.index()] += step;
            }
        });
    }

    fn is_left(&self, label: Label) -> bool {
        self.branches[label.index()] > 0
    }

    fn simplify_body(&mut self, body: &mut Body) {
        // Nodes before the first construct stay in place.
        let is_construct = |node: &Node| !matches!(node, Node::Inst(_));
        let first = body.nodes.iter().position(is_construct);
        let nodes = body.nodes.split_off(first.unwrap_or(body.nodes.len()));
        for node in &mut body.nodes {
            if let Node::Inst(inst) = node {
                self.visit_inst(inst);
            }
        }
        body.nodes.reserve(nodes.len());
        let mut nodes = nodes.into_iter();
        while let Some(node) = nodes.next() {
            let Flow::Ends(end) = self.simplify_node(node, &mut body.nodes) else {
                continue;
            };
            for node in nodes {
                (node.bodies()).for_each(|body| self.count_branches(body, -1));
            }
            if let Terminator::Br(label, _) = body.end {
                self.branches[label.index()] -= 1;
            }
            body.end = end;
            return;
        }
        self.substitution.resolve_terminator(&mut body.end);
    }

    fn visit_inst(&mut self, inst: &mut Inst) {
        self.substitution.resolve_all(&mut inst.args);
        if let (Op::Const(bits), [result]) = (&inst.op, &inst.results[..]) {
            self.constants[result.index()] = Some(*bits != 0);
        }
    }

    fn simplify_node(&mut self, mut node: Node, out: &mut Vec<Node>) -> Flow {
        match &mut node {
            Node::Inst(inst) => self.visit_inst(inst),
            Node::Block {
                label,
                results,
                body,
            } => {
                let (label, results) = (*label, std::mem::take(results));
                let body = std::mem::replace(body, Box::new(unreachable()));
                return self.simplify_block(label, results, body, out);
            }
            Node::If {
                condition,
                label,
                results,
                then_body,
                else_body,
            } => {
                *condition = self.substitution.resolve(*condition);
                if let Some(holds) = self.constants[condition.index()] {
                    let (taken, dropped) = match holds {
                        true => (then_body, else_body),
                        false => (else_body, then_body),
                    };
                    self.count_branches(dropped, -1);
                    let (label, results) = (*label, std::mem::take(results));
                    let body = std::mem::replace(taken, Box::new(unreachable()));
                    return self.simplify_block(label, results, body, out);
                }
                self.simplify_body(then_body);
                self.simplify_body(else_body);
                if self.flatten(*condition, *label, results, then_body, else_body, out) {
                    return Flow::On;
                }
                if !self.is_left(*label) {
                    results.clear();
                    out.push(node);
                    return Flow::Ends(Terminator::Unreachable);
                }
            }
            Node::Loop {
                label,
                params,
                init,
                body,
            } => {
                self.substitution.resolve_all(init);
                if !self.is_left(*label) {
                    for (&param, &init) in params.iter().zip(init.iter()) {
                        self.substitution.replace(param, init);
                    }
                    self.simplify_body(body);
                    out.append(&mut body.nodes);
                    let end = std::mem::replace(&mut body.end, Terminator::Unreachable);
                    return Flow::Ends(end);
                }
                self.simplify_body(body);
                out.push(node);
                return Flow::Ends(Terminator::Unreachable);
            }
        }
        out.push(node);
        Flow::On
    }

    fn simplify_block(
        &mut self,
        label: Label,
        mut results: Vec<Value>,
        mut body: Box<Body>,
        out: &mut Vec<Node>,
    ) -> Flow {
        self.simplify_body(&mut body);
        if !self.is_left(label) {
            out.append(&mut body.nodes);
            return Flow::Ends(body.end);
        }
        if self.is_decided_by_if(label, &body) {
            self.become_if(label, results, *body, out);
            return Flow::On;
        }
        match &mut body.end {
            Terminator::Br(target, args)
                if *target == label && self.branches[label.index()] == 1 =>
            {
                for (result, arg) in results.drain(..).zip(args) {
                    self.substitution.replace(result, *arg);
                }
                out.append(&mut body.nodes);
            }
            _ => out.push(Node::Block {
                label,
                results,
                body,
            }),
        }
        Flow::On
    }

    /// Whether a block ends in an `if` of which one side leaves the block for what comes behind it, and the other goes on to the block's
    /// end, which leads elsewhere. Nothing else leads to either label.
    fn is_decided_by_if(&self, own: Label, body: &Body) -> bool {
        let Some(Node::If {
            label,
            then_body,
            else_body,
            ..
        }) = body.nodes.last()
        else {
            return false;
        };
        let leads =
            |side: &Body, to: Label| matches!(side.end, Terminator::Br(label, _) if label == to);
        let decides = leads(then_body, own) && leads(else_body, *label)
            || leads(then_body, *label) && leads(else_body, own);
        decides && self.branches[own.index()] == 1 && self.branches[label.index()] == 1
    }

    /// Puts the `if` in the place of a block that [it decides](Self::is_decided_by_if): what came behind it belongs to the side that goes on.
    fn become_if(&mut self, own: Label, own_results: Vec<Value>, body: Body, out: &mut Vec<Node>) {
        let Body { mut nodes, mut end } = body;
        if let Some(Node::If {
            label,
            results,
            then_body,
            else_body,
            ..
        }) = nodes.last_mut()
        {
            let side = match &then_body.end {
                Terminator::Br(target, _) if target == label => then_body,
                _ => else_body,
            };
            if let Terminator::Br(_, args) = &side.end {
                for (&result, &arg) in results.iter().zip(args) {
                    self.substitution.replace(result, arg);
                }
            }
            self.branches[label.index()] -= 1;
            self.substitution.resolve_terminator(&mut end);
            side.end = end;
            *label = own;
            *results = own_results;
        }
        out.append(&mut nodes);
    }

    /// Replaces an `if` by both sides and choices, where that is cheaper; whether it did.
    fn flatten(
        &mut self,
        condition: Value,
        label: Label,
        results: &mut Vec<Value>,
        then_body: &mut Body,
        else_body: &mut Body,
        out: &mut Vec<Node>,
    ) -> bool {
        let (Some(on_true), Some(on_false)) =
            (flat_exit(then_body, label), flat_exit(else_body, label))
        else {
            return false;
        };
        let total: u32 = [&*then_body, &*else_body]
            .into_iter()
            .flat_map(|body| &body.nodes)
            .map(|node| match node {
                Node::Inst(inst) => cost(&inst.op),
                _ => u32::MAX / 64,
            })
            .fold(0, u32::saturating_add);
        if total.saturating_add(results.len() as u32) > MAX_FLAT_COST {
            return false;
        }
        out.append(&mut then_body.nodes);
        out.append(&mut else_body.nodes);
        for (index, result) in results.drain(..).enumerate() {
            let (x, y) = (on_true[index], on_false[index]);
            if x == y {
                self.substitution.replace(result, x);
            } else {
                out.push(Node::Inst(Inst {
                    op: Op::Select,
                    args: smallvec![condition, x, y],
                    results: smallvec![result],
                    source: 0,
                }));
            }
        }
        true
    }
}

/// The values that a body of pure operations passes to its own construct.
fn flat_exit(body: &Body, own: Label) -> Option<Vec<Value>> {
    let pure = |node: &Node| matches!(node, Node::Inst(inst) if inst.op.is_pure());
    match &body.end {
        Terminator::Br(label, args) if *label == own && body.nodes.iter().all(pure) => {
            Some(args.clone())
        }
        _ => None,
    }
}
