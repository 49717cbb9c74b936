//! Values that are computed directly in the destination of a branch's copy: a loop's parameter, or
//! a construct's result.
//!
//! Kernels compute inactive lanes of a subgroup, too. So a value may share the row of its copy only
//! if no lane that is inactive at the value's definition still needs that row:
//!
//! * a loop's parameter, if there is one branch to the loop's start and the value is defined
//!   directly in the loop's body: all lanes that are in the loop are active there, none waits for
//!   the next iteration yet;
//! * an `if`'s result, for values defined directly in the first body, if that has no other branch
//!   to the construct's end: the lanes of the second body write the row later.
//!
//! The allocation checks whether a parameter's old value is still used afterwards.

use foldhash::HashMap;

use crate::ir::{Body, Label, Node, Step, Terminator, Value};

/// A value and the destination of its copy.
pub(crate) struct Candidate {
    pub from: Value,
    pub to: Value,
    /// `to` is a loop's parameter, which may be used before `from` is defined. A construct's result
    /// may not.
    pub is_parameter: bool,
}

/// A function's candidates, inner constructs first.
pub(crate) fn candidates(body: &Body) -> Vec<Candidate> {
    let mut analysis = CoalescingAnalysis {
        branches: HashMap::default(),
        candidates: Vec::new(),
    };
    analysis.walk(body);
    analysis.candidates
}

struct CoalescingAnalysis<'b> {
    /// By label of closed constructs: the number of branches, and the arguments of one of them.
    branches: HashMap<Label, (u32, &'b [Value])>,
    candidates: Vec<Candidate>,
}

impl<'b> CoalescingAnalysis<'b> {
    fn walk(&mut self, body: &'b Body) {
        for step in body.steps() {
            match step {
                Step::Inst(_) | Step::Open(_) => {}
                Step::Else(node) => {
                    if let Node::If {
                        label,
                        results,
                        then_body,
                        ..
                    } = node
                        && let Terminator::Br(to, args) = &then_body.end
                        && to == label
                        && self
                            .branches
                            .get(label)
                            .is_some_and(|&(count, _)| count == 1)
                    {
                        self.propose(then_body, args, results, false);
                    }
                }
                Step::Close(node) => {
                    if let Node::Loop {
                        label,
                        params,
                        body,
                        ..
                    } = node
                        && let Some(&(1, args)) = self.branches.get(label)
                    {
                        self.propose(body, args, params, true);
                    }
                }
                Step::End(body) => {
                    if let Terminator::Br(label, args) = &body.end {
                        let (count, taken) = self.branches.entry(*label).or_default();
                        *count += 1;
                        *taken = args;
                    }
                }
            }
        }
    }

    fn propose(&mut self, body: &Body, from: &[Value], to: &[Value], is_parameter: bool) {
        let mut direct: Vec<Value> = Vec::new();
        for node in &body.nodes {
            match node {
                Node::Inst(inst) => direct.extend(&inst.results),
                Node::Block { results, .. } | Node::If { results, .. } => direct.extend(results),
                Node::Loop { .. } => {}
            }
        }
        direct.sort_unstable();
        for (&from, &to) in from.iter().zip(to) {
            if direct.binary_search(&from).is_ok() {
                self.candidates.push(Candidate {
                    from,
                    to,
                    is_parameter,
                });
            }
        }
    }
}
