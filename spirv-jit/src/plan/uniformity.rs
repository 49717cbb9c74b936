//! Values that are uniform in a dispatch. They are computed once per run, in the prologue, and need
//! no saving at yields.
//!
//! These are constants, dispatch words, descriptors, and pure operations on uniform values. Loads
//! count if nothing can write the memory meanwhile: push constants, and uniform blocks that every
//! started invocation reads. So do queries of an image's size that every invocation performs. A
//! block or image that no invocation accesses may have been destroyed
//! (`descriptorBindingPartiallyBound`).

use foldhash::{HashMap, HashSet};

use crate::ir::op::DescriptorBinding;
use crate::ir::{Body, Function, Inst, Node, Op, Space, Step, Terminator, Value};

/// Largest number of scalars that the prologue loads from uniform blocks although not every
/// invocation loads them.
const MAX_EARLY_SCALARS: usize = 256;

/// For each value of a function, whether it is uniform in the dispatch. `starts`: each invocation
/// starts with the function, and nothing writes uniform blocks while such invocations run.
pub(super) fn find_uniform_values(function: &Function, starts: bool) -> Vec<bool> {
    let values = function.value_types.len();
    let mut analysis = UniformityAnalysis {
        uniform: vec![false; values],
        push_constants: vec![false; values],
        blocks: HashMap::default(),
        certain: vec![false; if starts { values } else { 0 }],
        read: HashSet::default(),
        early_scalars: 0,
        depths: vec![0; function.labels as usize],
    };
    if starts {
        let mut constants = HashMap::default();
        (function.body).visit_insts(&mut |inst| analysis.note_block(inst, &mut constants));
        analysis.find_certain(&function.body);
    }
    function.body.visit_insts(&mut |inst| analysis.visit(inst));
    analysis.uniform
}

/// A descriptor of a binding: one of a constant number, or of a value.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct DescriptorRef {
    binding: DescriptorBinding,
    index: Result<u64, Value>,
}

/// A body on the path of all invocations.
struct Way {
    /// All or no invocations enter it.
    entered: bool,
    /// Depth of the outermost construct that some lanes have left; 0 is the function.
    left: usize,
}

struct UniformityAnalysis {
    uniform: Vec<bool>,
    /// The value is the descriptor of the push constants.
    push_constants: Vec<bool>,
    /// The descriptor of a value.
    blocks: HashMap<Value, DescriptorRef>,
    /// The value is the first of a load from a uniform block, or of a query of an image's size,
    /// that every invocation performs.
    certain: Vec<bool>,
    /// Uniform blocks that every invocation reads.
    read: HashSet<DescriptorRef>,
    early_scalars: usize,
    /// By label: the nesting depth of its construct, from 1.
    depths: Vec<usize>,
}

impl UniformityAnalysis {
    fn note_block(&mut self, inst: &Inst, constants: &mut HashMap<Value, u64>) {
        match inst.op {
            Op::Const(bits) => {
                constants.insert(inst.results[0], bits);
            }
            Op::Descriptor(binding) => {
                let index = inst.args[0];
                let index = constants.get(&index).copied().ok_or(index);
                (self.blocks).insert(inst.results[0], DescriptorRef { binding, index });
            }
            _ => {}
        }
    }

    /// Whether every invocation reads the uniform block that a load reads.
    fn is_read(&self, load: &Inst) -> bool {
        let block = self.blocks.get(&load.args[0]);
        block.is_some_and(|block| self.read.contains(block))
    }

    /// Whether an instruction was marked by [`Self::find_certain`].
    fn is_certain(&self, inst: &Inst) -> bool {
        let first = inst.results.first().map(|result| result.index());
        first.is_some_and(|at| self.certain.get(at) == Some(&true))
    }

    /// Marks the loads and image size queries that every invocation performs.
    fn find_certain(&mut self, body: &Body) {
        let mut outer: Vec<Way> = Vec::new();
        let mut here = Way {
            entered: true,
            left: usize::MAX,
        };
        let mut steps = body.steps();
        while let Some(step) = steps.next() {
            let depth = outer.len() + 1;
            let certain = here.entered && here.left == usize::MAX;
            match step {
                Step::Inst(inst) => {
                    if certain {
                        self.note_certain(inst);
                    }
                    // An accepted intersection may end the search, and a function may end the
                    // invocation.
                    if matches!(inst.op, Op::ReportIntersection | Op::Call(_)) {
                        here.left = 0;
                    }
                }
                // A loop may never end.
                Step::Open(Node::Loop { .. }) => {
                    steps.skip_construct();
                    here.left = 0;
                }
                Step::Open(node) => {
                    if let Some(label) = node.label() {
                        self.depths[label.index()] = depth;
                    }
                    let inside = Way {
                        entered: certain && matches!(node, Node::Block { .. }),
                        left: usize::MAX,
                    };
                    outer.push(std::mem::replace(&mut here, inside));
                }
                Step::Else(_) => {}
                Step::End(body) => {
                    let end = match &body.end {
                        Terminator::Br(label, _) => self.depths[label.index()],
                        _ => 0,
                    };
                    here.left = here.left.min(end);
                }
                Step::Close(_) => {
                    let inside = here.left;
                    if let Some(around) = outer.pop() {
                        here = around;
                    }
                    if inside < depth - 1 {
                        here.left = here.left.min(inside);
                    }
                }
            }
        }
    }

    fn note_certain(&mut self, inst: &Inst) {
        match inst.op {
            Op::Load(access) if access.constant => {
                self.certain[inst.results[0].index()] = true;
                self.read.extend(self.blocks.get(&inst.args[0]));
            }
            Op::Image(op) if op.is_size_query() => {
                self.certain[inst.results[0].index()] = true;
            }
            _ => {}
        }
    }

    fn visit(&mut self, inst: &Inst) {
        let uniform_args = inst.args.iter().all(|arg| self.uniform[arg.index()]);
        let uniform = uniform_args
            && match &inst.op {
                Op::Input(_) => false,
                Op::DescriptorAddress | Op::BufferSize => true,
                Op::Image(_) => self.is_certain(inst),
                Op::Load(access) if access.space != Space::Buffer || access.volatile => false,
                Op::Load(access) => {
                    let certain = self.is_certain(inst);
                    let early = !certain
                        && access.constant
                        && self.is_read(inst)
                        && self.early_scalars + inst.results.len() <= MAX_EARLY_SCALARS;
                    if early {
                        self.early_scalars += inst.results.len();
                    }
                    self.push_constants[inst.args[0].index()] || certain || early
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
