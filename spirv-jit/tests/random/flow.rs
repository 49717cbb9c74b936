//! Ways out of constructs: switches whose cases fall through, and leaving in the middle of a body,
//! by any number of levels.

use spirv_jit::ir::{Body, Node, Op, Terminator, Type};

use super::Generator;

impl Generator<'_> {
    /// Blocks in each other, one a case, as lowering makes of a switch: leaving one goes to its
    /// case. A case ends by leaving the switch, by falling through to the next one, or as any body
    /// may.
    pub fn switch(&mut self, depth: usize, nodes: &mut Vec<Node>) {
        let count = 2 + self.random.below(4);
        let chosen = self.pick(Type::I32, nodes);
        let mask = self.constant(3, Type::I32, nodes);
        let selector = self.emit_one(Op::And, &[chosen, mask], Type::I32, nodes);
        let types = self.result_types();
        let merge = self.open(&types, None);
        let merge_index = self.open_labels() - 1;
        // The last case is the outermost.
        let mut cases = Vec::new();
        for _ in 0..count {
            let taken = self.result_types();
            let label = self.open(&taken, None);
            cases.push((label, taken, self.open_labels() - 1));
        }
        cases.reverse();

        let scope = self.scope();
        let mut inside = Vec::new();
        for (number, (_, _, case)) in cases[..count - 1].iter().enumerate() {
            let literal = self.constant(number as u64, Type::I32, &mut inside);
            let equal = self.emit_one(Op::IEq, &[selector, literal], Type::I1, &mut inside);
            self.leave_if(equal, Some(*case), &mut inside);
        }
        let mut end = self.br(cases[count - 1].2, &mut inside);
        for (label, taken, _) in cases {
            self.leave_scope(scope);
            let results = self.close(&taken);
            let body = Box::new(Body { nodes: inside, end });
            inside = vec![Node::Block {
                label,
                results,
                body,
            }];
            for _ in 0..self.random.below(4) {
                self.step(depth + 1, &mut inside);
            }
            end = match self.random.below(3) {
                0 => self.br(self.open_labels() - 1, &mut inside),
                1 => self.br(merge_index, &mut inside),
                _ => self.terminator(Some(merge_index), &mut inside),
            };
        }
        self.leave_scope(scope);
        let results = self.close(&types);
        nodes.push(Node::Block {
            label: merge,
            results,
            body: Box::new(Body { nodes: inside, end }),
        });
    }

    /// Some lanes leave any of the open constructs, or the function.
    pub fn leave(&mut self, nodes: &mut Vec<Node>) {
        let condition = self.pick(Type::I1, nodes);
        let out = match self.open_labels() {
            0 => None,
            _ if self.random.one_in(8) => None,
            open => Some(self.random.below(open)),
        };
        self.leave_if(condition, out, nodes);
    }

    /// Leaves an open construct, or the function for none, where the condition holds.
    fn leave_if(
        &mut self,
        condition: spirv_jit::ir::Value,
        out: Option<usize>,
        nodes: &mut Vec<Node>,
    ) {
        let scope = self.scope();
        let mut leaving = Vec::new();
        let end = match out {
            Some(out) => self.br(out, &mut leaving),
            None => self.exit(&mut leaving),
        };
        self.leave_scope(scope);
        let label = self.function.new_label();
        nodes.push(Node::If {
            condition,
            label,
            results: Vec::new(),
            then_body: Box::new(Body {
                nodes: leaving,
                end,
            }),
            else_body: Box::new(Body {
                nodes: Vec::new(),
                end: Terminator::Br(label, Vec::new()),
            }),
        });
    }
}
