//! Removes code without effect: instructions, results and parameters of constructs, stores to rows
//! that are never read, functions that are never called, unused variables and input rows.

use super::row_index::RowIndex;
use super::substitution::{Substitution, rewrite_function};
use crate::ir::{Body, Function, FunctionId, Inst, Module, Node, Op, Step, Terminator, Value};

/// Removes dead code from one function.
pub fn eliminate_dead_code(function: &mut Function) {
    let rows = ReadRows::new(function);
    let mut graph = UseGraph::new(function);
    graph.add_body(&function.body, &|inst| rows.keeps(inst));
    let live = graph.mark();
    rewrite_function(
        function,
        &Substitution::identity(function),
        &|value| !live[value.index()],
        &|inst| inst.results.iter().any(|value| live[value.index()]) || rows.keeps(inst),
    );
    // Loads are cut after the last used scalar.
    function.body.visit_insts_mut(&mut |inst| {
        if matches!(inst.op, Op::Load(access) if !access.volatile) {
            let used = inst.results.iter().rposition(|value| live[value.index()]);
            inst.results.truncate(used.map_or(1, |last| last + 1));
        }
    });
}

/// Rows of variables that are read, at fixed rows or through an address.
struct ReadRows {
    /// `None`: all rows count as read.
    index: Option<RowIndex>,
    fixed: Vec<bool>,
    addressed: Vec<bool>,
}

impl ReadRows {
    fn new(function: &Function) -> Self {
        let mut rows = Self {
            index: None,
            fixed: Vec::new(),
            addressed: vec![false; function.variables.len()],
        };
        if let Some(index) = RowIndex::new(function, |_| true) {
            rows.fixed.resize(index.count, false);
            if index.count > 0 {
                rows.collect(function, &index);
            }
            rows.index = Some(index);
        }
        rows
    }

    fn collect(&mut self, function: &Function, index: &RowIndex) {
        function.body.visit_insts(&mut |inst| match inst.op {
            Op::VarLoad(variable, row) => {
                let at = index.place(variable, row);
                let rows = function.ty(inst.results[0]).rows() as usize;
                self.fixed[at..at + rows].fill(true);
            }
            Op::VarAddress(variable) => self.addressed[variable.index()] = true,
            _ => {}
        });
    }

    /// Whether an instruction has an effect apart from its results.
    fn keeps(&self, inst: &Inst) -> bool {
        match inst.op {
            // The high row of a 64-bit store is the next one; nearly always both are read.
            Op::VarStore(variable, row) => {
                let Some(index) = &self.index else {
                    return true;
                };
                let at = index.place(variable, row);
                self.addressed[variable.index()] || self.fixed[at] || self.fixed[at + 1]
            }
            _ => !inst.op.is_removable(),
        }
    }
}

/// The use graph: for each value, the values that it is computed from.
struct UseGraph {
    /// First entry in `edges`, plus one.
    first: Vec<u32>,
    /// An operand and the next entry, plus one.
    edges: Vec<(Value, u32)>,
    roots: Vec<Value>,
    /// Results or parameters by label.
    taken: Vec<Vec<Value>>,
}

impl UseGraph {
    fn new(function: &Function) -> Self {
        Self {
            first: vec![0; function.value_types.len()],
            edges: Vec::with_capacity(function.value_types.len() * 2),
            roots: Vec::new(),
            taken: vec![Vec::new(); function.labels as usize],
        }
    }

    fn add(&mut self, value: Value, operand: Value) {
        self.edges.push((operand, self.first[value.index()]));
        self.first[value.index()] = self.edges.len() as u32;
    }

    fn add_passed(&mut self, label: usize, args: &[Value]) {
        for (index, &arg) in args.iter().enumerate() {
            self.add(self.taken[label][index], arg);
        }
    }

    fn add_body(&mut self, body: &Body, keeps: &dyn Fn(&Inst) -> bool) {
        for step in body.steps() {
            match step {
                Step::Inst(inst) => self.add_inst(inst, keeps(inst)),
                Step::Open(node) => {
                    if let Some(label) = node.label() {
                        self.taken[label.index()] = node.definitions().to_vec();
                    }
                    match node {
                        Node::If { condition, .. } => self.roots.push(*condition),
                        Node::Loop { label, init, .. } => self.add_passed(label.index(), init),
                        _ => {}
                    }
                }
                Step::End(body) => match &body.end {
                    Terminator::Br(label, args) => self.add_passed(label.index(), args),
                    end => self.roots.extend(end.operands()),
                },
                Step::Else(_) | Step::Close(_) => {}
            }
        }
    }

    fn add_inst(&mut self, inst: &Inst, keeps: bool) {
        match inst.results.first() {
            Some(&first) if !keeps => {
                for &arg in &inst.args {
                    self.add(first, arg);
                }
                for &other in &inst.results[1..] {
                    self.add(other, first);
                }
            }
            _ if keeps => self.roots.extend(&inst.args),
            _ => {}
        }
    }

    fn mark(self) -> Vec<bool> {
        let mut live = vec![false; self.first.len()];
        let mut work = self.roots;
        while let Some(value) = work.pop() {
            if std::mem::replace(&mut live[value.index()], true) {
                continue;
            }
            let mut edge = self.first[value.index()];
            while edge != 0 {
                let (operand, next) = self.edges[edge as usize - 1];
                if !live[operand.index()] {
                    work.push(operand);
                }
                edge = next;
            }
        }
        live
    }
}

/// Removes functions that the entry does not reach, and unused variables and input rows.
pub fn eliminate_unused_tables(module: &mut Module) {
    eliminate_unused_functions(module);
    let mut used_inputs = vec![false; module.inputs.len()];
    for function in &mut module.functions {
        let mut used_variables = vec![false; function.variables.len()];
        function
            .body
            .visit_insts_mut(&mut |Inst { op, .. }| match op {
                Op::Input(index) => used_inputs[*index as usize] = true,
                Op::VarLoad(variable, _) | Op::VarStore(variable, _) | Op::VarAddress(variable) => {
                    used_variables[variable.index()] = true;
                }
                _ => {}
            });
        let numbers = keep_used(&mut function.variables, &used_variables);
        function
            .body
            .visit_insts_mut(&mut |Inst { op, .. }| match op {
                Op::VarLoad(variable, _) | Op::VarStore(variable, _) | Op::VarAddress(variable) => {
                    variable.0 = numbers[variable.index()];
                }
                _ => {}
            });
    }
    let numbers = keep_used(&mut module.inputs, &used_inputs);
    for function in &mut module.functions {
        function.body.visit_insts_mut(&mut |Inst { op, .. }| {
            if let Op::Input(index) = op {
                *index = numbers[*index as usize];
            }
        });
    }
}

/// Removes functions that the entry does not reach.
fn eliminate_unused_functions(module: &mut Module) {
    let mut used = vec![false; module.functions.len()];
    let mut work = vec![0];
    while let Some(index) = work.pop() {
        if !std::mem::replace(&mut used[index], true) {
            module.functions[index]
                .body
                .visit_insts_mut(&mut |Inst { op, .. }| {
                    if let Op::Call(callee) = op {
                        work.push(callee.index());
                    }
                });
        }
    }
    if used.iter().all(|&used| used) {
        return;
    }
    let numbers = keep_used(&mut module.functions, &used);
    for function in &mut module.functions {
        function.body.visit_insts_mut(&mut |Inst { op, .. }| {
            if let Op::Call(callee) = op {
                *callee = FunctionId(numbers[callee.index()]);
            }
        });
    }
}

/// Drops unused entries; returns the new index of each used one.
fn keep_used<T>(items: &mut Vec<T>, used: &[bool]) -> Vec<u32> {
    let mut numbers = Vec::with_capacity(used.len());
    let mut next = 0;
    for &used in used {
        numbers.push(next);
        next += used as u32;
    }
    let mut marks = used.iter();
    items.retain(|_| *marks.next().expect("as many marks as items"));
    numbers
}
