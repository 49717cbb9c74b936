//! Calls replaced by the callee's body: always where it is the only call, otherwise while the module stays inside a budget, callees first.

use smallvec::smallvec;

use super::eliminate_dead_code::eliminate_unused_functions;
use super::renaming::Renaming;
use crate::ir::{
    Body, Function, Inst, Label, Module, Node, Op, Terminator, Type, Value, VariableId,
};

/// Instructions that a module may always grow to.
const BUDGET_FLOOR: usize = 16_384;

/// Nesting that inlining does not exceed.
const MAX_DEPTH: usize = 500;

/// Rows of a variable that must start as zero in a loop, beyond which its function is called instead.
const MAX_ZEROED_ROWS: u32 = 64;

/// Inlines what the budget allows, and removes functions without a call left.
pub fn inline_functions(module: &mut Module) {
    let count = module.functions.len();
    if count == 1 {
        return;
    }
    let mut facts: Vec<Facts> = module.functions.iter().map(Facts::of).collect();
    let mut calls = vec![0usize; count];
    for fact in &facts {
        for callee in &fact.callees {
            calls[*callee] += 1;
        }
    }
    let total: usize = facts.iter().map(|fact| fact.size).sum();
    let mut budget = (3 * total).max(BUDGET_FLOOR);
    for index in callees_first(&facts) {
        if facts[index].callees.is_empty() {
            continue;
        }
        let mut caller = std::mem::replace(&mut module.functions[index], nothing());
        let mut body = std::mem::replace(&mut caller.body, nothing().body);
        let mut inliner = Inliner {
            functions: &module.functions,
            facts: &facts,
            calls: &calls,
            caller: &mut caller,
            budget: &mut budget,
        };
        inliner.inline_calls(&mut body, 1, false);
        caller.body = body;
        facts[index] = Facts::of(&caller);
        module.functions[index] = caller;
    }
    eliminate_unused_functions(module);
}

/// A function without a body, for the time that its own is being rewritten.
fn nothing() -> Function {
    Function {
        name: String::new(),
        params: Vec::new(),
        results: Vec::new(),
        value_types: Vec::new(),
        labels: 0,
        variables: Vec::new(),
        body: Body {
            nodes: Vec::new(),
            end: Terminator::Unreachable,
        },
    }
}

/// What decides about inlining a function.
#[derive(Default)]
struct Facts {
    /// Instructions and constructs.
    size: usize,
    depth: usize,
    /// Functions called, once each call.
    callees: Vec<usize>,
}

impl Facts {
    fn of(function: &Function) -> Facts {
        let mut facts = Facts::default();
        facts.add(&function.body, 1);
        facts
    }

    fn add(&mut self, body: &Body, depth: usize) {
        self.depth = self.depth.max(depth);
        self.size += body.nodes.len() + 1;
        for node in &body.nodes {
            match node {
                Node::Inst(inst) => {
                    if let Op::Call(callee) = inst.op {
                        self.callees.push(callee.index());
                    }
                }
                Node::Block { body, .. } | Node::Loop { body, .. } => self.add(body, depth + 1),
                Node::If {
                    then_body,
                    else_body,
                    ..
                } => {
                    self.add(then_body, depth + 1);
                    self.add(else_body, depth + 1);
                }
            }
        }
    }
}

/// All functions, each after those it calls.
fn callees_first(facts: &[Facts]) -> Vec<usize> {
    let mut order = Vec::with_capacity(facts.len());
    let mut seen = vec![false; facts.len()];
    for root in 0..facts.len() {
        if std::mem::replace(&mut seen[root], true) {
            continue;
        }
        let mut stack = vec![(root, 0)];
        while let Some((function, next)) = stack.last_mut() {
            match facts[*function].callees.get(*next) {
                Some(&callee) => {
                    *next += 1;
                    if !std::mem::replace(&mut seen[callee], true) {
                        stack.push((callee, 0));
                    }
                }
                None => {
                    order.push(*function);
                    stack.pop();
                }
            }
        }
    }
    order
}

struct Inliner<'a> {
    functions: &'a [Function],
    facts: &'a [Facts],
    /// Calls of each function in the whole module as it came.
    calls: &'a [usize],
    /// Its body is being walked; this is the rest.
    caller: &'a mut Function,
    budget: &'a mut usize,
}

impl Inliner<'_> {
    fn inline_calls(&mut self, body: &mut Body, depth: usize, in_loop: bool) {
        for node in &mut body.nodes {
            match node {
                Node::Inst(inst) => {
                    if let Op::Call(callee) = inst.op
                        && self.takes(callee.index(), depth, in_loop)
                    {
                        *node = self.inlined(inst, callee.index(), in_loop);
                    }
                }
                Node::Block { body, .. } => self.inline_calls(body, depth + 1, in_loop),
                Node::Loop { body, .. } => self.inline_calls(body, depth + 1, true),
                Node::If {
                    then_body,
                    else_body,
                    ..
                } => {
                    self.inline_calls(then_body, depth + 1, in_loop);
                    self.inline_calls(else_body, depth + 1, in_loop);
                }
            }
        }
    }

    /// Decides about a call, and pays for it.
    fn takes(&mut self, callee: usize, depth: usize, in_loop: bool) -> bool {
        let facts = &self.facts[callee];
        if depth + facts.depth > MAX_DEPTH {
            return false;
        }
        let mut variables = self.functions[callee].variables.iter();
        if in_loop && variables.any(|v| v.zero && v.rows > MAX_ZEROED_ROWS) {
            return false;
        }
        if self.calls[callee] > 1 {
            if facts.size > *self.budget {
                return false;
            }
            *self.budget -= facts.size;
        }
        true
    }

    /// The block that stands for a call.
    fn inlined(&mut self, call: &mut Inst, callee: usize, in_loop: bool) -> Node {
        let callee = &self.functions[callee];
        let label = self.caller.new_label();
        let first = self.caller.value_types.len() as u32;
        let mut values: Vec<Value> = (0..callee.value_types.len() as u32)
            .map(|index| Value(first + index))
            .collect();
        for (param, &arg) in callee.params.iter().zip(&call.args) {
            values[param.index()] = arg;
        }
        let renaming = Renaming {
            values,
            labels: (0..callee.labels)
                .map(|index| Label(self.caller.labels + index))
                .collect(),
            first_variable: self.caller.variables.len() as u32,
            returns_to: Some(label),
        };
        self.caller.value_types.extend(&callee.value_types);
        self.caller.labels += callee.labels;
        let mut body = callee.body.clone();
        renaming.rename_body(&mut body);
        let mut zeroing = Vec::new();
        for (index, variable) in callee.variables.iter().enumerate() {
            // Entered again in each iteration.
            if variable.zero && in_loop {
                let variable_id = VariableId(renaming.first_variable + index as u32);
                for row in 0..variable.rows {
                    let zero = self.caller.new_value(Type::I32);
                    zeroing.push(inst(Op::Const(0), None, Some(zero)));
                    zeroing.push(inst(Op::VarStore(variable_id, row), Some(zero), None));
                }
            }
        }
        self.caller
            .variables
            .extend(callee.variables.iter().cloned());
        body.nodes.splice(0..0, zeroing);
        Node::Block {
            label,
            results: call.results.to_vec(),
            body: body.into(),
        }
    }
}

fn inst(op: Op, arg: Option<Value>, result: Option<Value>) -> Node {
    Node::Inst(Inst {
        op,
        args: arg.into_iter().collect(),
        results: result.map_or(smallvec![], |result| smallvec![result]),
        source: 0,
    })
}
