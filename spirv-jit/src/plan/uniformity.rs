//! Which values are the same in all invocations of a dispatch: they are computed once per run, in the prologue, and survive yields for
//! nothing.
//!
//! Constants, dispatch words, descriptors, and pure operations on such. Loads count only from push constants, which nothing
//! can write meanwhile.

use crate::ir::{Function, Inst, Op, Space};

/// Per value of a function: the same in the whole dispatch.
pub(super) fn find_uniform_values(function: &Function) -> Vec<bool> {
    let mut finder = Finder {
        uniform: vec![false; function.value_types.len()],
        push_constants: vec![false; function.value_types.len()],
    };
    function.body.visit_insts(&mut |inst| finder.visit(inst));
    finder.uniform
}

struct Finder {
    uniform: Vec<bool>,
    /// The value is the descriptor of the push constants.
    push_constants: Vec<bool>,
}

impl Finder {
    fn visit(&mut self, inst: &Inst) {
        let uniform_args = inst.args.iter().all(|arg| self.uniform[arg.index()]);
        let uniform = uniform_args
            && match &inst.op {
                Op::Input(_) => false,
                Op::DescriptorAddress | Op::BufferSize => true,
                Op::Load(access) => {
                    access.space == Space::Buffer
                        && !access.volatile
                        && self.push_constants[inst.args[0].index()]
                }
                op => op.is_pure(),
            };
        if uniform {
            for result in &inst.results {
                self.uniform[result.index()] = true;
            }
        }
        if inst.op == Op::PushConstants {
            self.push_constants[inst.results[0].index()] = true;
        }
    }
}
