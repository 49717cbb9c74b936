//! Removes unnecessary constructs: constant conditions, blocks with a single exit at their end,
//! loops without a back-edge, unreachable code after a construct, blocks around an `if` that
//! decides which lanes leave them or leave them early, and `if`s so small that both sides cost less
//! than the branch.

use smallvec::smallvec;

use super::cost::cost;
use super::substitution::Substitution;
use crate::ir::{Body, Function, Inst, Label, Node, Op, Terminator, Value};

/// Largest cost of both sides of an `if` that is computed in all lanes.
const MAX_FLAT_COST: u32 = 8;

/// Simplifies control flow, inner constructs first.
pub fn simplify_control_flow(function: &mut Function) {
    let body = Box::new(std::mem::take(&mut function.body));
    let mut simplifier = Simplifier {
        substitution: Substitution::identity(function),
        constants: vec![None; function.value_types.len()],
        branches: vec![0; function.labels as usize],
        open: Vec::new(),
    };
    simplifier.count_branches(&body, 1);
    function.body = simplifier.simplify(body);
}

struct Simplifier {
    substitution: Substitution,
    /// The known conditions.
    constants: Vec<Option<bool>>,
    /// The number of `br`s to each label.
    branches: Vec<i32>,
    /// The bodies in progress, innermost last.
    open: Vec<SimplifiedBody>,
}

/// A body in progress: its finished and its pending nodes.
struct SimplifiedBody {
    body: Box<Body>,
    rest: std::vec::IntoIter<Node>,
    /// The code after the blocks that are flattened into this body, innermost last.
    after: Vec<After>,
    of: Of,
}

/// The code after a block with a single exit at its end.
struct After {
    /// The values that the block's end passes on, and their names after it.
    end: Terminator,
    results: Vec<Value>,
    rest: std::vec::IntoIter<Node>,
}

/// The owner of a body.
enum Of {
    Function,
    Block {
        label: Label,
        results: Vec<Value>,
    },
    Then {
        head: IfHead,
        else_body: Box<Body>,
    },
    Else {
        head: IfHead,
        then_body: Box<Body>,
    },
    Loop {
        label: Label,
        params: Vec<Value>,
        init: Vec<Value>,
    },
    /// A loop without a back-edge.
    Once,
}

/// An `if` without its bodies.
struct IfHead {
    condition: Value,
    label: Label,
    results: Vec<Value>,
}

/// Whether code after a node is reachable.
enum Flow {
    On,
    Ends(Terminator),
}

impl Simplifier {
    /// Adds the `br`s of a body to the counts, or subtracts them.
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

    fn simplify(&mut self, body: Box<Body>) -> Body {
        self.enter(body, Of::Function);
        while let Some(open) = self.open.last_mut() {
            match open.rest.next() {
                Some(Node::Inst(mut inst)) => {
                    visit_inst(&self.substitution, &mut self.constants, &mut inst);
                    open.body.nodes.push(Node::Inst(inst));
                }
                Some(construct) => self.enter_construct(construct),
                None => match open.after.pop() {
                    Some(After { end, results, rest }) => {
                        for (&result, &arg) in results.iter().zip(end.operands()) {
                            self.substitution.replace(result, arg);
                        }
                        open.rest = rest;
                    }
                    None => {
                        self.substitution.resolve_terminator(&mut open.body.end);
                        if let Some(body) = self.leave() {
                            return *body;
                        }
                    }
                },
            }
        }
        unreachable!("the function's body is the last one that is left")
    }

    fn enter(&mut self, mut body: Box<Body>, of: Of) {
        // Nodes before the first construct are not moved.
        let is_construct = |node: &Node| !matches!(node, Node::Inst(_));
        let first = body.nodes.iter().position(is_construct);
        let rest = body.nodes.split_off(first.unwrap_or(body.nodes.len()));
        for node in &mut body.nodes {
            if let Node::Inst(inst) = node {
                visit_inst(&self.substitution, &mut self.constants, inst);
            }
        }
        body.nodes.reserve(rest.len());
        self.open.push(SimplifiedBody {
            body,
            rest: rest.into_iter(),
            after: Vec::new(),
            of,
        });
    }

    fn enter_construct(&mut self, node: Node) {
        match node {
            Node::Inst(_) => {}
            Node::Block {
                label,
                results,
                body,
            } => self.enter_block(label, results, body),
            Node::If {
                condition,
                label,
                results,
                then_body,
                else_body,
            } => {
                let condition = self.substitution.resolve(condition);
                if let Some(holds) = self.constants[condition.index()] {
                    let (taken, dropped) = match holds {
                        true => (then_body, else_body),
                        false => (else_body, then_body),
                    };
                    self.count_branches(&dropped, -1);
                    self.enter_block(label, results, taken);
                    return;
                }
                let head = IfHead {
                    condition,
                    label,
                    results,
                };
                self.enter(then_body, Of::Then { head, else_body });
            }
            Node::Loop {
                label,
                params,
                mut init,
                body,
            } => {
                self.substitution.resolve_all(&mut init);
                if self.is_left(label) {
                    let of = Of::Loop {
                        label,
                        params,
                        init,
                    };
                    self.enter(body, of);
                } else {
                    for (&param, &init) in params.iter().zip(&init) {
                        self.substitution.replace(param, init);
                    }
                    self.enter(body, Of::Once);
                }
            }
        }
    }

    /// Enters a block. A block with a single exit at its end is flattened into the enclosing body,
    /// so a node in nested ones is moved once, not once for each block.
    fn enter_block(&mut self, label: Label, results: Vec<Value>, mut body: Box<Body>) {
        let at_end = matches!(body.end, Terminator::Br(to, _) if to == label);
        match self.open.last_mut() {
            Some(open) if at_end && self.branches[label.index()] == 1 => {
                let inside = std::mem::take(&mut body.nodes).into_iter();
                open.after.push(After {
                    end: std::mem::replace(&mut body.end, Terminator::Unreachable),
                    results,
                    rest: std::mem::replace(&mut open.rest, inside),
                });
            }
            _ => self.enter(body, Of::Block { label, results }),
        }
    }

    /// Adds the innermost body's construct to the enclosing body, and leaves that one, too, if the
    /// rest is unreachable. Returns the function's body at the end.
    fn leave(&mut self) -> Option<Box<Body>> {
        while let Some(SimplifiedBody { body, of, .. }) = self.open.pop() {
            if let Of::Then { head, else_body } = of {
                let then_body = body;
                self.enter(else_body, Of::Else { head, then_body });
                return None;
            }
            let Some(mut around) = self.open.pop() else {
                return Some(body);
            };
            let Flow::Ends(end) = self.close(body, of, &mut around.body.nodes) else {
                self.open.push(around);
                return None;
            };
            let after = std::mem::take(&mut around.after).into_iter().rev();
            let (ends, rests): (Vec<_>, Vec<_>) =
                after.map(|after| (after.end, after.rest)).unzip();
            for node in around.rest.by_ref().chain(rests.into_iter().flatten()) {
                (node.bodies()).for_each(|body| self.count_branches(body, -1));
            }
            for end in ends.iter().chain([&around.body.end]) {
                if let Terminator::Br(label, _) = end {
                    self.branches[label.index()] -= 1;
                }
            }
            around.body.end = end;
            self.open.push(around);
        }
        None
    }

    fn close(&mut self, mut body: Box<Body>, of: Of, out: &mut Vec<Node>) -> Flow {
        match of {
            Of::Function | Of::Then { .. } => Flow::On,
            Of::Block { label, results } => self.close_block(label, results, body, out),
            Of::Else {
                head,
                mut then_body,
            } => {
                let IfHead {
                    condition,
                    label,
                    mut results,
                } = head;
                if self.flatten(
                    condition,
                    label,
                    &mut results,
                    &mut then_body,
                    &mut body,
                    out,
                ) {
                    return Flow::On;
                }
                let is_left = self.is_left(label);
                if !is_left {
                    results.clear();
                }
                out.push(Node::If {
                    condition,
                    label,
                    results,
                    then_body,
                    else_body: body,
                });
                match is_left {
                    true => Flow::On,
                    false => Flow::Ends(Terminator::Unreachable),
                }
            }
            Of::Loop {
                label,
                params,
                init,
            } => {
                out.push(Node::Loop {
                    label,
                    params,
                    init,
                    body,
                });
                Flow::Ends(Terminator::Unreachable)
            }
            Of::Once => {
                out.append(&mut body.nodes);
                Flow::Ends(std::mem::replace(&mut body.end, Terminator::Unreachable))
            }
        }
    }

    fn close_block(
        &mut self,
        label: Label,
        mut results: Vec<Value>,
        mut body: Box<Body>,
        out: &mut Vec<Node>,
    ) -> Flow {
        if !self.is_left(label) {
            out.append(&mut body.nodes);
            return Flow::Ends(std::mem::replace(&mut body.end, Terminator::Unreachable));
        }
        if self.is_decided_by_if(label, &body) {
            self.become_if(label, results, *body, out);
            return Flow::On;
        }
        if let Some(at) = self.early_exit(label, &body) {
            self.move_rest(label, results, *body, at, out);
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

    /// Whether a block ends in an `if` with one side that leaves the block and another that
    /// continues to the block's end, which leads elsewhere. Nothing else branches to either label.
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

    /// Replaces a block with the [`if` that decides it](Self::is_decided_by_if). The code after the
    /// `if` moves to the side that continues.
    fn become_if(&mut self, own: Label, own_results: Vec<Value>, body: Body, out: &mut Vec<Node>) {
        let mut body = body;
        let mut nodes = std::mem::take(&mut body.nodes);
        let mut end = std::mem::replace(&mut body.end, Terminator::Unreachable);
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

    /// The `if` in a block with one side that leaves the block and another that continues behind
    /// the `if`, where the rest of the block leads to its end, too. Nothing else branches to either
    /// label.
    fn early_exit(&self, own: Label, body: &Body) -> Option<usize> {
        let leads =
            |body: &Body, to: Label| matches!(body.end, Terminator::Br(label, _) if label == to);
        if self.branches[own.index()] != 2 || !leads(body, own) {
            return None;
        }
        (body.nodes.iter()).position(|node| match node {
            Node::If {
                label,
                results,
                then_body,
                else_body,
                ..
            } => {
                let divides = leads(then_body, own) && leads(else_body, *label)
                    || leads(then_body, *label) && leads(else_body, own);
                divides && results.is_empty() && self.branches[label.index()] == 1
            }
            _ => false,
        })
    }

    /// Replaces a block with its [`if` that leaves it early](Self::early_exit), and moves the rest
    /// of the block to the side that continues. Small sides become selects.
    fn move_rest(
        &mut self,
        own: Label,
        mut own_results: Vec<Value>,
        mut body: Body,
        at: usize,
        out: &mut Vec<Node>,
    ) {
        let mut nodes = std::mem::take(&mut body.nodes);
        let end = std::mem::replace(&mut body.end, Terminator::Unreachable);
        let rest = nodes.split_off(at + 1);
        let decider = nodes.pop();
        out.append(&mut nodes);
        let Some(Node::If {
            condition,
            label,
            mut then_body,
            mut else_body,
            ..
        }) = decider
        else {
            return;
        };
        let side = match &then_body.end {
            Terminator::Br(target, _) if *target == label => &mut then_body,
            _ => &mut else_body,
        };
        side.nodes.extend(rest);
        side.end = end;
        self.branches[label.index()] -= 1;
        let results = &mut own_results;
        if !self.flatten(condition, own, results, &mut then_body, &mut else_body, out) {
            out.push(Node::If {
                condition,
                label: own,
                results: own_results,
                then_body,
                else_body,
            });
        }
    }

    /// Replaces an `if` with both sides and selects, if that is cheaper. Returns whether it did.
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

fn visit_inst(substitution: &Substitution, constants: &mut [Option<bool>], inst: &mut Inst) {
    substitution.resolve_all(&mut inst.args);
    if let (Op::Const(bits), [result]) = (&inst.op, &inst.results[..]) {
        constants[result.index()] = Some(*bits != 0);
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
