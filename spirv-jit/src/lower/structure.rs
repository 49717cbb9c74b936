//! From the control flow graph to a tree: which block is lowered in which body, and where branches go.
//!
//! A SPIR-V function that keeps the rules of structured control flow (SPIR-V specification, section Structured Control Flow) is walked along
//! its merge instructions. A branch to a block that some enclosing construct has announced (merge block, continue target, loop header, case) becomes
//! a `br` to that construct's label; any other block is lowered in place, once. What breaks the rules reaches a block twice and is refused.

use foldhash::{HashMap, HashSet};

use rspirv::spirv::Op;

use crate::Error;
use crate::parse::{Block, Function, Id, Merge, ParsedModule};

/// Constructs nested in each other. Recursion over bodies, here and in every pass, is bounded by it.
pub(super) const MAX_DEPTH: usize = 200;

/// A body of the plan.
pub(super) type BodyIndex = usize;
/// A label of the plan.
pub(super) type LabelIndex = usize;
/// A block of the SPIR-V function.
pub(super) type BlockIndex = usize;

/// The condition of an `if` of the plan.
#[derive(Clone, Debug)]
pub(super) enum Condition {
    /// A boolean id.
    Id(Id),
    /// Whether the switch's selector is one of these literals.
    Cases(Vec<u64>),
}

#[derive(Clone, Debug)]
pub(super) enum Step {
    /// The instructions of a block, without its terminator.
    Code(BlockIndex),
    /// The arguments of the second block's phis for an edge from the first.
    Edge(BlockIndex, BlockIndex),
    Block {
        label: LabelIndex,
        body: BodyIndex,
    },
    If {
        /// The block whose terminator decides.
        at: BlockIndex,
        condition: Condition,
        label: LabelIndex,
        then_body: BodyIndex,
        else_body: BodyIndex,
    },
    Loop {
        label: LabelIndex,
        body: BodyIndex,
    },
}

#[derive(Clone, Copy, Debug)]
pub(super) enum End {
    Br(LabelIndex),
    /// The terminator of a block that leaves the function or the invocation.
    Exit(BlockIndex),
    Unreachable,
}

#[derive(Debug)]
pub(super) struct PlanBody {
    parent: Option<BodyIndex>,
    depth: usize,
    pub steps: Vec<Step>,
    pub end: End,
}

/// A function's tree. Body 0 is the root.
#[derive(Debug)]
pub(super) struct Plan {
    pub bodies: Vec<PlanBody>,
    pub labels: usize,
    /// Ids used where their definition's body has ended: they travel through variables.
    pub escapes: HashSet<Id>,
}

impl Plan {
    /// Whether a body is another one or around it.
    pub fn encloses(&self, outer: BodyIndex, inner: BodyIndex) -> bool {
        encloses(&self.bodies, outer, inner)
    }
}

fn encloses(bodies: &[PlanBody], outer: BodyIndex, inner: BodyIndex) -> bool {
    let mut at = inner;
    while bodies[at].depth > bodies[outer].depth {
        match bodies[at].parent {
            Some(parent) => at = parent,
            None => break,
        }
    }
    at == outer
}

/// Blocks that may be looked at for switches: many of few, of many blocks as often as nested switches of use need.
const LOOKS: usize = 200_000;
const LOOKS_PER_BLOCK: usize = 16;

pub(super) fn too_deep() -> Error {
    super::budget("control flow is nested too deeply")
}

/// Makes the plan of a function.
pub(super) fn plan_function(module: &ParsedModule, function: &Function) -> Result<Plan, Error> {
    if function.blocks.is_empty() {
        return Err(Error::invalid(function.offset, "the function has no body"));
    }
    let mut planner = Planner {
        module,
        function,
        bodies: Vec::new(),
        labels: 0,
        targets: HashMap::default(),
        block_body: vec![None; function.blocks.len()],
        seen_by: vec![None; function.blocks.len()],
        looks: LOOKS + LOOKS_PER_BLOCK * function.blocks.len(),
        depth: 0,
    };
    let root = planner.new_body(None);
    planner.walk(root, None, 0)?;
    let escapes = planner.find_escapes();
    Ok(Plan {
        bodies: planner.bodies,
        labels: planner.labels,
        escapes,
    })
}

pub(super) struct Planner<'a> {
    pub(super) module: &'a ParsedModule,
    pub(super) function: &'a Function,
    pub(super) bodies: Vec<PlanBody>,
    labels: usize,
    /// Labels that enclosing constructs have announced for a block, innermost last.
    targets: HashMap<BlockIndex, Vec<LabelIndex>>,
    /// The body that a block is lowered in.
    block_body: Vec<Option<BodyIndex>>,
    /// The switch that a block was last looked at for.
    pub(super) seen_by: Vec<Option<BlockIndex>>,
    /// Blocks that may still be looked at for switches.
    pub(super) looks: usize,
    pub(super) depth: usize,
}

/// A conditional branch: condition, target if true, target if false.
struct Fork {
    condition: Id,
    yes: BlockIndex,
    no: BlockIndex,
}

impl Planner<'_> {
    pub(super) fn new_body(&mut self, parent: Option<BodyIndex>) -> BodyIndex {
        self.bodies.push(PlanBody {
            parent,
            depth: parent.map_or(0, |parent| self.bodies[parent].depth + 1),
            steps: Vec::new(),
            end: End::Unreachable,
        });
        self.bodies.len() - 1
    }

    pub(super) fn new_label(&mut self) -> LabelIndex {
        self.labels += 1;
        self.labels - 1
    }

    pub(super) fn announce(&mut self, block: BlockIndex, label: LabelIndex) {
        self.targets.entry(block).or_default().push(label);
    }

    pub(super) fn withdraw(&mut self, block: BlockIndex) {
        if let Some(stack) = self.targets.get_mut(&block) {
            stack.pop();
        }
    }

    pub(super) fn target(&self, block: BlockIndex) -> Option<LabelIndex> {
        self.targets.get(&block)?.last().copied()
    }

    pub(super) fn block(&self, index: BlockIndex) -> &Block {
        &self.function.blocks[index]
    }

    pub(super) fn find(&self, at: BlockIndex, label: Id) -> Result<BlockIndex, Error> {
        let found = self.function.block_index.get(&label).copied();
        found.ok_or_else(|| {
            let offset = self.block(at).offset;
            Error::invalid(offset, format!("branch to {label}, which is no block here"))
        })
    }

    /// A body of its own for what follows an edge.
    pub(super) fn walk_arm(
        &mut self,
        parent: BodyIndex,
        from: BlockIndex,
        to: BlockIndex,
    ) -> Result<BodyIndex, Error> {
        let body = self.new_body(Some(parent));
        self.walk(body, Some(from), to)?;
        Ok(body)
    }

    /// Lowers `to` and all that follows it into `body`, until a terminator ends it.
    pub(super) fn walk(
        &mut self,
        body: BodyIndex,
        from: Option<BlockIndex>,
        to: BlockIndex,
    ) -> Result<(), Error> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(too_deep());
        }
        let mut next = Some((from, to));
        while let Some((from, to)) = next {
            next = self.visit(body, from, to)?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Lowers one block; returns the edge to what follows it in the same body.
    fn visit(
        &mut self,
        body: BodyIndex,
        from: Option<BlockIndex>,
        to: BlockIndex,
    ) -> Result<Option<(Option<BlockIndex>, BlockIndex)>, Error> {
        if let Some(from) = from
            && self.has_phis(to)
        {
            self.bodies[body].steps.push(Step::Edge(from, to));
        }
        if let Some(label) = self.target(to) {
            self.bodies[body].end = End::Br(label);
            return Ok(None);
        }
        if self.block_body[to].is_some() {
            let offset = self.block(to).offset;
            return Err(Error::invalid(offset, "control flow is not structured"));
        }
        match self.block(to).merge {
            Some(Merge::Loop(merge, target)) => {
                let merge = self.find(to, merge)?;
                let target = self.find(to, target)?;
                self.visit_loop(body, to, merge, target)?;
                Ok(Some((None, merge)))
            }
            Some(Merge::Selection(merge)) => {
                let merge = self.find(to, merge)?;
                self.place(body, to);
                self.visit_selection(body, to, merge)?;
                Ok(Some((None, merge)))
            }
            None => {
                self.place(body, to);
                self.visit_terminator(body, to)
            }
        }
    }

    fn place(&mut self, body: BodyIndex, block: BlockIndex) {
        self.block_body[block] = Some(body);
        self.bodies[body].steps.push(Step::Code(block));
    }

    fn visit_loop(
        &mut self,
        body: BodyIndex,
        header: BlockIndex,
        merge: BlockIndex,
        target: BlockIndex,
    ) -> Result<(), Error> {
        let merge_label = self.new_label();
        let loop_label = self.new_label();
        let merge_body = self.new_body(Some(body));
        let loop_body = self.new_body(Some(merge_body));
        self.bodies[body].steps.push(Step::Block {
            label: merge_label,
            body: merge_body,
        });
        self.bodies[merge_body].steps.push(Step::Loop {
            label: loop_label,
            body: loop_body,
        });
        self.announce(merge, merge_label);
        if target == header {
            self.place(loop_body, header);
            self.announce(header, loop_label);
            self.walk_terminator(loop_body, header)?;
        } else {
            let label = self.new_label();
            let inner = self.new_body(Some(loop_body));
            self.bodies[loop_body]
                .steps
                .push(Step::Block { label, body: inner });
            self.place(inner, header);
            self.announce(header, loop_label);
            self.announce(target, label);
            self.walk_terminator(inner, header)?;
            self.withdraw(target);
            self.walk(loop_body, None, target)?;
        }
        self.withdraw(header);
        self.withdraw(merge);
        Ok(())
    }

    fn walk_terminator(&mut self, body: BodyIndex, block: BlockIndex) -> Result<(), Error> {
        if let Some((from, to)) = self.visit_terminator(body, block)? {
            self.walk(body, from, to)?;
        }
        Ok(())
    }

    fn visit_selection(
        &mut self,
        body: BodyIndex,
        at: BlockIndex,
        merge: BlockIndex,
    ) -> Result<(), Error> {
        let label = self.new_label();
        self.announce(merge, label);
        let opcode = self.terminator(at).0;
        match opcode {
            Op::BranchConditional => {
                let fork = self.fork(at)?;
                let then_body = self.walk_arm(body, at, fork.yes)?;
                if fork.no == fork.yes {
                    self.bodies[body].steps.push(Step::Block {
                        label,
                        body: then_body,
                    });
                } else {
                    let else_body = self.walk_arm(body, at, fork.no)?;
                    self.bodies[body].steps.push(Step::If {
                        at,
                        condition: Condition::Id(fork.condition),
                        label,
                        then_body,
                        else_body,
                    });
                }
            }
            Op::Switch => {
                let inner = self.new_body(Some(body));
                self.bodies[body]
                    .steps
                    .push(Step::Block { label, body: inner });
                if let Some((from, to)) = self.visit_switch(inner, at)? {
                    self.walk(inner, from, to)?;
                }
            }
            _ => {
                let offset = self.block(at).offset;
                return Err(Error::invalid(offset, "a selection must end in a branch"));
            }
        }
        self.withdraw(merge);
        Ok(())
    }

    /// A block without a merge instruction, or a loop header's own branch.
    fn visit_terminator(
        &mut self,
        body: BodyIndex,
        at: BlockIndex,
    ) -> Result<Option<(Option<BlockIndex>, BlockIndex)>, Error> {
        let (opcode, operands) = self.terminator(at);
        match opcode {
            Op::Branch => {
                let to = self.find(at, operands[0])?;
                Ok(Some((Some(at), to)))
            }
            Op::BranchConditional => self.visit_fork(body, at),
            Op::Switch => self.visit_switch(body, at),
            _ => {
                self.bodies[body].end = End::Exit(at);
                Ok(None)
            }
        }
    }

    fn visit_fork(
        &mut self,
        body: BodyIndex,
        at: BlockIndex,
    ) -> Result<Option<(Option<BlockIndex>, BlockIndex)>, Error> {
        let fork = self.fork(at)?;
        if fork.yes == fork.no {
            return Ok(Some((Some(at), fork.yes)));
        }
        let label = self.new_label();
        let yes_leaves = self.target(fork.yes).is_some();
        let no_leaves = self.target(fork.no).is_some();
        let stay = |planner: &mut Self| {
            let stay = planner.new_body(Some(body));
            planner.bodies[stay].end = End::Br(label);
            stay
        };
        let (then_body, else_body, next) = if yes_leaves {
            let then_body = self.walk_arm(body, at, fork.yes)?;
            (then_body, stay(self), Some((Some(at), fork.no)))
        } else if no_leaves {
            let then_body = stay(self);
            let else_body = self.walk_arm(body, at, fork.no)?;
            (then_body, else_body, Some((Some(at), fork.yes)))
        } else {
            let then_body = self.walk_arm(body, at, fork.yes)?;
            (then_body, self.walk_arm(body, at, fork.no)?, None)
        };
        self.bodies[body].steps.push(Step::If {
            at,
            condition: Condition::Id(fork.condition),
            label,
            then_body,
            else_body,
        });
        Ok(next)
    }

    pub(super) fn terminator(&self, block: BlockIndex) -> (Op, &[u32]) {
        let instruction = self.module.instruction(self.block(block).terminator);
        (instruction.opcode, self.module.operands(instruction))
    }

    fn fork(&self, at: BlockIndex) -> Result<Fork, Error> {
        let (_, operands) = self.terminator(at);
        Ok(Fork {
            condition: operands[0],
            yes: self.find(at, operands[1])?,
            no: self.find(at, operands[2])?,
        })
    }

    fn has_phis(&self, block: BlockIndex) -> bool {
        let first = self.block(block).instructions.first();
        first.is_some_and(|&index| self.module.instruction(index).opcode == Op::Phi)
    }

    fn find_escapes(&self) -> HashSet<Id> {
        // A function's instructions stand together: where each is lowered, by its index less that of the first.
        let blocks = &self.function.blocks;
        let all = blocks.iter().flat_map(|block| &block.instructions);
        let first = all.clone().min().copied().unwrap_or(0);
        let count = all.max().map_or(0, |last| last + 1 - first);
        let mut bodies = vec![None; count as usize];
        for (block, body) in blocks.iter().zip(&self.block_body) {
            for &index in &block.instructions {
                bodies[(index - first) as usize] = *body;
            }
        }
        // Phis are variables already.
        let defined = |id: Id| -> Option<BodyIndex> {
            let index = self.module.definition(id)?.checked_sub(first)?;
            *bodies.get(index as usize)?
        };
        let mut escapes = HashSet::default();
        for (block, body) in self.function.blocks.iter().zip(&self.block_body) {
            let Some(body) = *body else { continue };
            for &index in block.instructions.iter().chain([&block.terminator]) {
                let instruction = self.module.instruction(index);
                if instruction.opcode == Op::Phi {
                    for pair in self.module.operands(instruction).chunks_exact(2) {
                        let from = self.function.block_index.get(&pair[1]);
                        let from = from.and_then(|&from| self.block_body[from]);
                        if let (Some(at), Some(from)) = (defined(pair[0]), from)
                            && !encloses(&self.bodies, at, from)
                        {
                            escapes.insert(pair[0]);
                        }
                    }
                    continue;
                }
                for id in self.module.uses(instruction) {
                    if let Some(at) = defined(*id)
                        && !encloses(&self.bodies, at, body)
                    {
                        escapes.insert(*id);
                    }
                }
            }
        }
        escapes
    }
}
