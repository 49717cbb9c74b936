//! Unrolls loops that count from a constant to a constant in a few steps, so that values computed
//! from the counter become constant, too.
//!
//! Each iteration becomes a block that the back-edges leave. Lanes wait at its end as they did at
//! the loop's head. Loops that yield stay, so that waves in different iterations can still be
//! merged.

use foldhash::{HashSet, HashSetExt};
use smallvec::smallvec;

use super::edit::{Edit, Fate, edit_body};
use super::effects::{Effects, find_effects};
use super::fold_constants::fold;
use super::renaming::Renaming;
use crate::ir::{Body, Function, Inst, Label, Node, Op, Space, Step, Terminator, Type, Value};

/// Largest number of unrolled iterations.
const MAX_ITERATIONS: usize = 32;

/// Largest number of nodes of an unrolled loop.
const MAX_NODES: usize = 400;

/// Largest number of nodes of an unrolled loop whose counter is an index into per-lane memory: with
/// constant indices, values replace the memory.
const MAX_NODES_OF_INDEX: usize = 1_200;

/// The growth in nodes that is always allowed.
const BUDGET_FLOOR: usize = 2_048;

/// Unrolls loops, inner ones first. Returns whether it unrolled any.
pub fn unroll_loops(function: &mut Function) -> bool {
    let mut body = std::mem::take(&mut function.body);
    let count = function.value_types.len();
    let mut unroller = Unroller {
        effects: find_effects(&body, function.labels),
        constants: vec![None; count],
        sums: vec![None; count],
        addresses: vec![false; count],
        renaming: Renaming {
            values: (0..count as u32).map(Value).collect(),
            labels: (0..function.labels).map(Label).collect(),
        },
        budget: BUDGET_FLOOR.max(2 * count_nodes(&body)),
        function,
    };
    let budget = unroller.budget;
    edit_body(&mut body, &mut unroller);
    let unrolled = unroller.budget < budget;
    function.body = body;
    unrolled
}

/// Nodes and terminators.
fn count_nodes(body: &Body) -> usize {
    let mut count = 1;
    body.visit(&mut |node| count += 1 + node.bodies().count());
    count
}

/// A loop's counter.
struct Counts {
    /// The index of the parameter.
    param: usize,
    /// Its values.
    counts: Vec<u64>,
}

struct Unroller<'a> {
    function: &'a mut Function,
    effects: Vec<Effects>,
    constants: Vec<Option<u64>>,
    /// Integers that are another plus a constant.
    sums: Vec<Option<(Value, u64)>>,
    /// Addresses of variables.
    addresses: Vec<bool>,
    /// The identity, except while an iteration is copied.
    renaming: Renaming,
    budget: usize,
}

impl Edit for Unroller<'_> {
    fn inst(&mut self, inst: &mut Inst, _: &mut Vec<Node>) -> bool {
        self.learn(inst);
        true
    }

    fn close(&mut self, construct: &mut Node, before: &mut Vec<Node>) -> Fate {
        if let Node::Loop {
            label,
            params,
            init,
            body,
        } = construct
            && let Some(counts) = self.find_counts(*label, params, init, body)
        {
            self.unroll(*label, params, init, body, &counts, before);
            // The end of a loop is unreachable.
            return Fate::Ends;
        }
        Fate::Stays
    }
}

impl Unroller<'_> {
    fn learn(&mut self, inst: &Inst) {
        let Some(&result) = inst.results.first() else {
            return;
        };
        match inst.op {
            Op::Const(bits) => self.constants[result.index()] = Some(bits),
            Op::VarAddress(_) => self.addresses[result.index()] = true,
            Op::IAdd => {
                self.sums[result.index()] =
                    self.constant(inst.args[1]).map(|step| (inst.args[0], step));
            }
            _ => {}
        }
    }

    fn constant(&self, value: Value) -> Option<u64> {
        self.constants.get(value.index()).copied().flatten()
    }

    /// The counter's value in each iteration, ending with the value that leaves the loop; `None`
    /// unless these are a few constants.
    fn find_counts(
        &mut self,
        label: Label,
        params: &[Value],
        init: &[Value],
        body: &Body,
    ) -> Option<Counts> {
        let effects = self.effects.get(label.index())?;
        if effects.yields {
            return None;
        }
        let exit = find_exit(label, body, |value| self.constant(value).is_some())?;
        let comparison = exit.comparison;
        let on_left = self.constant(comparison.args[1]);
        let (counter, limit) = match on_left {
            Some(limit) => (comparison.args[0], limit),
            None => (comparison.args[1], self.constant(comparison.args[0])?),
        };
        let index = params.iter().position(|&param| param == counter)?;
        let mut step = None;
        if !self.find_step(label, index, counter, body, &mut step) {
            return None;
        }
        let (step, mut count) = (step?, self.constant(init[index])?);
        let ty = self.function.ty(counter);
        let size = count_nodes(body);
        let most = match self.indexes(counter, body) {
            true => MAX_NODES_OF_INDEX,
            false => MAX_NODES,
        };
        let mut counts = vec![count];
        loop {
            let args = match on_left {
                Some(_) => [count, limit],
                None => [limit, count],
            };
            if (fold(&comparison.op, ty, Type::I1, &args)? != 0) == exit.leaves_if {
                break;
            }
            count = fold(&Op::IAdd, ty, ty, &[count, step])?;
            counts.push(count);
            // The last iteration is only the exit: a single iteration replaces the loop.
            let iterations = counts.len() - 1;
            let fits = iterations == 1 || counts.len() * size <= most;
            if iterations > MAX_ITERATIONS || !fits || iterations * size > self.budget {
                return None;
            }
        }
        self.budget = (self.budget).saturating_sub((counts.len() - 1).max(1) * size);
        Some(Counts {
            param: index,
            counts,
        })
    }

    /// Whether a loop accesses per-lane memory at an address that is constant if the counter is.
    fn indexes(&self, counter: Value, body: &Body) -> bool {
        let mut follows = HashSet::new();
        follows.insert(counter);
        let mut any = false;
        body.visit_insts(&mut |inst| {
            let is_known = |arg: &Value| {
                self.constant(*arg).is_some()
                    || self.addresses[arg.index()]
                    || follows.contains(arg)
            };
            let is_counted = inst.args.iter().any(|arg| follows.contains(arg));
            match inst.op {
                Op::Load(access) | Op::Store(access) => {
                    any |= access.space == Space::Private && follows.contains(&inst.args[0]);
                }
                op if op.is_pure() && is_counted && inst.args.iter().all(is_known) => {
                    follows.extend(inst.results.iter().copied());
                }
                _ => {}
            }
        });
        any
    }

    /// Whether all back-edges add one constant to the counter.
    fn find_step(
        &self,
        label: Label,
        index: usize,
        counter: Value,
        body: &Body,
        step: &mut Option<u64>,
    ) -> bool {
        body.steps().all(|at| match at {
            Step::End(Body {
                end: Terminator::Br(target, args),
                ..
            }) if *target == label => match self.sums.get(args[index].index()).copied().flatten() {
                Some((base, more)) if base == counter => *step.get_or_insert(more) == more,
                _ => false,
            },
            _ => true,
        })
    }

    /// Emits the iterations, the last one only up to the exit.
    fn unroll(
        &mut self,
        label: Label,
        params: &[Value],
        init: &[Value],
        body: &Body,
        counts: &Counts,
        out: &mut Vec<Node>,
    ) {
        let (mut values, mut labels) = (Vec::new(), Vec::new());
        list_definitions(body, &mut values, &mut labels);
        // Copies of copies: inner loops have added to the tables.
        self.extend_identity();
        let mut current = init.to_vec();
        let counter_type = self.function.ty(params[counts.param]);
        for &count in &counts.counts {
            let count_value = self.function.new_value(counter_type);
            out.push(Node::Inst(Inst {
                op: Op::Const(count),
                args: smallvec![],
                results: smallvec![count_value],
                source: 0,
            }));
            current[counts.param] = count_value;
            for (&param, &value) in params.iter().zip(&current) {
                self.renaming.values[param.index()] = value;
            }
            for &value in &values {
                let ty = self.function.ty(value);
                self.renaming.values[value.index()] = self.function.new_value(ty);
            }
            for &inner in &labels {
                self.renaming.labels[inner.index()] = self.function.new_label();
            }
            let end = self.function.new_label();
            self.renaming.labels[label.index()] = end;
            let mut copy = body.clone();
            self.renaming.rename_body(&mut copy);
            current = params
                .iter()
                .map(|&param| self.function.new_value(self.function.ty(param)))
                .collect();
            out.push(Node::Block {
                label: end,
                results: current.clone(),
                body: copy.into(),
            });
        }
        for &value in values.iter().chain(params) {
            self.renaming.values[value.index()] = value;
        }
        for label in labels.into_iter().chain([label]) {
            self.renaming.labels[label.index()] = label;
        }
        self.extend_identity();
        self.learn_copies(out);
    }

    fn extend_identity(&mut self) {
        let renaming = &mut self.renaming;
        let values = renaming.values.len() as u32..self.function.value_types.len() as u32;
        renaming.values.extend(values.map(Value));
        let labels = renaming.labels.len() as u32..self.function.labels;
        renaming.labels.extend(labels.map(Label));
        self.constants.resize(renaming.values.len(), None);
        self.sums.resize(renaming.values.len(), None);
        self.addresses.resize(renaming.values.len(), false);
        self.effects
            .resize(renaming.labels.len(), Effects::default());
    }

    /// Constants and sums in copies, for enclosing loops.
    fn learn_copies(&mut self, nodes: &[Node]) {
        for node in nodes {
            if let Node::Inst(inst) = node {
                self.learn(inst);
            }
            for body in node.bodies() {
                body.visit_insts(&mut |inst| self.learn(inst));
            }
        }
    }
}

/// The first test of every iteration.
struct Exit<'b> {
    comparison: &'b Inst,
    /// The outcome for which lanes leave the loop.
    leaves_if: bool,
}

/// Finds the `if` near a loop's head with one side that leaves the loop and another that continues,
/// if only operations precede it and its condition compares a value with a constant.
fn find_exit(label: Label, body: &Body, is_constant: impl Fn(Value) -> bool) -> Option<Exit<'_>> {
    let mut insts = Vec::new();
    for node in &body.nodes {
        match node {
            Node::Inst(inst) => insts.push(inst),
            Node::If {
                condition,
                label: own,
                then_body,
                else_body,
                ..
            } => {
                let comparison = insts.iter().find(|inst| inst.results.contains(condition))?;
                let compares = matches!(
                    comparison.op,
                    Op::SLt | Op::SLe | Op::ULt | Op::ULe | Op::IEq | Op::INe
                );
                // The check of a side walks through all of it.
                if !compares || !comparison.args.iter().any(|&arg| is_constant(arg)) {
                    return None;
                }
                let leaves = |side: &Body| !reaches(side, &[label, *own]);
                let leaves_if = match (leaves(then_body), leaves(else_body)) {
                    (true, false) => true,
                    (false, true) => false,
                    _ => return None,
                };
                return Some(Exit {
                    comparison,
                    leaves_if,
                });
            }
            _ => return None,
        }
    }
    None
}

/// Whether a body has a `br` to one of the labels.
fn reaches(body: &Body, labels: &[Label]) -> bool {
    body.steps().any(|step| {
        matches!(step, Step::End(body)
            if matches!(&body.end, Terminator::Br(label, _) if labels.contains(label)))
    })
}

/// Values and labels that a body defines.
fn list_definitions(body: &Body, values: &mut Vec<Value>, labels: &mut Vec<Label>) {
    body.visit(&mut |node| {
        values.extend(node.definitions());
        labels.extend(node.label());
    });
}

#[cfg(test)]
mod tests {
    use crate::ir::text::parse_module;
    use crate::ir::{Module, Node, verify};
    use crate::pass::optimize;

    /// A loop of so many iterations, each of which adds `added` and goes through `fillers` more
    /// operations; optimised.
    fn summed(iterations: u32, fillers: usize, added: &str) -> Module {
        let fillers: String = (0..fillers)
            .map(|at| format!("v{}: i32 = imul v{}, v0\n", 100 + at, 99 + at))
            .collect();
        let text = format!(
            "module compute
            inputs local_invocation_index.0
            output_rows 0
            func f0 {{
                var0: 64 rows zero
                v0: i32 = input[0]
                v1: i32 = const 0
                v2: i32 = const 1
                v3: i32 = const {iterations}
                v4: descriptor = descriptor[set 0, first 0, count 1] v1
                var.store[var0, 3] v0
                block L0 -> (v5: i32) {{
                    loop L1 (v6: i32, v7: i32) = (v1, v0) {{
                        v8: i1 = slt v6, v3
                        if v8, L2 {{
                            br L2
                        }} else {{
                            br L0(v7)
                        }}
                        v9: i32 = iadd v6, v2
                        {added}
                        v99: i32 = iadd v7, v30
                        {fillers}
                        br L1(v9, v{})
                    }}
                    unreachable
                }}
                store.buffer v4, v1, v5
                end
            }}",
            99 + fillers.lines().count()
        );
        let mut module = parse_module(&text).unwrap();
        verify(&module).unwrap();
        optimize(&mut module).unwrap();
        module
    }

    fn has_loop(module: &Module) -> bool {
        let mut any = false;
        let body = &module.functions[0].body;
        body.visit(&mut |node| any |= matches!(node, Node::Loop { .. }));
        any
    }

    const BY_COUNTER: &str = "v28: i32 = var.address[var0]
        v29: i32 = iadd v28, v6
        v30: i32 = load.private v29";
    const BY_OTHER: &str = "v28: i32 = var.address[var0]
        v27: i32 = iadd v28, v0
        v29: i32 = iadd v27, v6
        v30: i32 = load.private v29";
    const COUNTER: &str = "v30: i32 = or v6, v2";

    #[test]
    fn what_an_index_costs_pays_for_longer_code() {
        assert!(!has_loop(&summed(20, 5, COUNTER)));
        assert!(has_loop(&summed(20, 30, COUNTER)));
        let by_counter = summed(20, 30, BY_COUNTER);
        assert!(!has_loop(&by_counter));
        assert!(by_counter.functions[0].variables.is_empty(), "promoted");
        assert!(has_loop(&summed(20, 60, BY_COUNTER)));
        assert!(has_loop(&summed(20, 30, BY_OTHER)));
    }

    #[test]
    fn the_limit_counts_turns() {
        assert!(!has_loop(&summed(32, 1, COUNTER)));
        assert!(has_loop(&summed(33, 1, COUNTER)));
    }

    #[test]
    fn a_single_iteration_takes_the_place_of_its_loop() {
        assert!(!has_loop(&summed(1, 900, COUNTER)));
        assert!(has_loop(&summed(2, 900, COUNTER)));
    }
}
