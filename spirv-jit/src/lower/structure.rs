//! Turns the control flow graph into a tree: the body of each block, and the target of each branch.
//!
//! The walk follows the merge instructions of structured control flow (SPIR-V specification,
//! section Structured Control Flow). A branch to a block that an enclosing construct has announced
//! (merge block, continue target, loop header), or to a [join](super::join_points), becomes a `br`
//! to that construct's label. Any other block is lowered in place, once. A function that breaks the
//! rules reaches a block twice and is refused.
//!
//! A list of tasks holds the remaining work: a function may nest constructs as deeply as its
//! size allows.

use foldhash::{HashMap, HashSet};

use rspirv::spirv::Op;

use super::flow::{BlockIndex, Flow};
use super::join_points::find_join_points;
use crate::Error;
use crate::parse::{Function, Id, Merge, ParsedModule};

/// A body of the plan.
pub(super) type BodyIndex = usize;
/// A label of the plan.
pub(super) type LabelIndex = usize;

/// The condition of a plan's `if`.
#[derive(Clone, Debug)]
pub(super) enum Condition {
    /// A boolean id.
    Id(Id),
    /// Whether the switch's selector is one of these literals.
    Cases(Vec<u64>),
}

#[derive(Clone, Debug)]
pub(super) enum ControlStep {
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
    /// The terminator of a block that ends the function or the invocation.
    Exit(BlockIndex),
    Unreachable,
}

#[derive(Debug)]
pub(super) struct PlanBody {
    /// The enclosing body; the root encloses itself.
    parent: BodyIndex,
    pub steps: Vec<ControlStep>,
    pub end: End,
}

/// A function's tree. Body 0 is the root.
#[derive(Debug)]
pub(super) struct Plan {
    pub bodies: Vec<PlanBody>,
    pub labels: usize,
    /// Ids with uses after the end of their definition's body, which need variables.
    pub escapes: HashSet<Id>,
    nesting: Nesting,
}

impl Plan {
    /// Whether a body is or encloses another one.
    pub fn encloses(&self, outer: BodyIndex, inner: BodyIndex) -> bool {
        self.nesting.encloses(outer, inner)
    }
}

/// Bodies numbered so that the ones inside a body follow it.
#[derive(Debug)]
struct Nesting {
    /// By body: its number, and one past the last number inside it.
    ranges: Vec<(usize, usize)>,
}

impl Nesting {
    fn of(bodies: &[PlanBody]) -> Self {
        // A body is created after its enclosing one.
        let mut sizes = vec![1; bodies.len()];
        for (index, body) in bodies.iter().enumerate().skip(1).rev() {
            sizes[body.parent] += sizes[index];
        }
        let mut ranges = vec![(0, bodies.len()); bodies.len()];
        let mut next: Vec<usize> = vec![1; bodies.len()];
        for (index, body) in bodies.iter().enumerate().skip(1) {
            let begin = next[body.parent];
            next[body.parent] += sizes[index];
            next[index] = begin + 1;
            ranges[index] = (begin, begin + sizes[index]);
        }
        Self { ranges }
    }

    fn encloses(&self, outer: BodyIndex, inner: BodyIndex) -> bool {
        let (begin, end) = self.ranges[outer];
        (begin..end).contains(&self.ranges[inner].0)
    }
}

/// Creates the plan of a function.
pub(super) fn plan_function(module: &ParsedModule, function: &Function) -> Result<Plan, Error> {
    if function.blocks.is_empty() {
        return Err(Error::invalid(function.offset, "the function has no body"));
    }
    let flow = Flow { module, function };
    let mut planner = Planner {
        flow,
        bodies: Vec::new(),
        labels: 0,
        targets: HashMap::default(),
        join_points: find_join_points(flow),
        block_body: vec![None; function.blocks.len()],
        tasks: Vec::new(),
    };
    let root = planner.new_body(0);
    planner.tasks.push(Task::Walk {
        body: root,
        from: None,
        to: 0,
    });
    while let Some(task) = planner.tasks.pop() {
        planner.perform(task)?;
    }
    let nesting = Nesting::of(&planner.bodies);
    let escapes = planner.find_escapes(&nesting);
    Ok(Plan {
        bodies: planner.bodies,
        labels: planner.labels,
        escapes,
        nesting,
    })
}

/// A part of the walk.
enum Task {
    /// Lower a block and its successors into a body, until a terminator ends it.
    Walk {
        body: BodyIndex,
        /// The block that the edge comes from, if phis take their values there.
        from: Option<BlockIndex>,
        to: BlockIndex,
    },
    /// Lower the terminator of a block whose code stands in the body.
    Branch { body: BodyIndex, at: BlockIndex },
    /// End the innermost construct that has announced a block.
    Withdraw(BlockIndex),
}

struct Planner<'a> {
    flow: Flow<'a>,
    bodies: Vec<PlanBody>,
    labels: usize,
    /// Labels that enclosing constructs have announced for a block, innermost last.
    targets: HashMap<BlockIndex, Vec<LabelIndex>>,
    /// By block: the join blocks that it immediately dominates, in the order of control flow.
    join_points: HashMap<BlockIndex, Vec<BlockIndex>>,
    /// The body that a block is lowered in.
    block_body: Vec<Option<BodyIndex>>,
    /// Last first.
    tasks: Vec<Task>,
}

/// A conditional branch: condition, target if true, target if false.
struct Fork {
    condition: Id,
    yes: BlockIndex,
    no: BlockIndex,
}

impl Planner<'_> {
    fn new_body(&mut self, parent: BodyIndex) -> BodyIndex {
        self.bodies.push(PlanBody {
            parent,
            steps: Vec::new(),
            end: End::Unreachable,
        });
        self.bodies.len() - 1
    }

    fn new_label(&mut self) -> LabelIndex {
        self.labels += 1;
        self.labels - 1
    }

    fn announce(&mut self, block: BlockIndex, label: LabelIndex) {
        self.targets.entry(block).or_default().push(label);
    }

    fn target(&self, block: BlockIndex) -> Option<LabelIndex> {
        self.targets.get(&block)?.last().copied()
    }

    /// Adds tasks before all others, to be performed in this order.
    fn next<const N: usize>(&mut self, tasks: [Task; N]) {
        self.tasks.extend(tasks.into_iter().rev());
    }

    fn perform(&mut self, task: Task) -> Result<(), Error> {
        match task {
            Task::Walk { body, from, to } => self.visit(body, from, to),
            Task::Branch { body, at } => self.visit_terminator(body, at),
            Task::Withdraw(block) => {
                if let Some(labels) = self.targets.get_mut(&block) {
                    labels.pop();
                }
                Ok(())
            }
        }
    }

    /// Opens a block in a body.
    fn open_block(&mut self, outer: BodyIndex, label: LabelIndex) -> BodyIndex {
        let body = self.new_body(outer);
        let step = ControlStep::Block { label, body };
        self.bodies[outer].steps.push(step);
        body
    }

    /// Lowers one block.
    fn visit(
        &mut self,
        body: BodyIndex,
        from: Option<BlockIndex>,
        to: BlockIndex,
    ) -> Result<(), Error> {
        if let Some(from) = from
            && self.has_phis(to)
        {
            self.bodies[body].steps.push(ControlStep::Edge(from, to));
        }
        if let Some(label) = self.target(to) {
            self.bodies[body].end = End::Br(label);
            return Ok(());
        }
        let block = self.flow.block(to);
        if self.block_body[to].is_some() {
            return Err(Error::invalid(
                block.offset,
                "control flow is not structured",
            ));
        }
        match block.merge {
            Some(Merge::Loop(merge, target)) => {
                let merge = self.flow.find(to, merge)?;
                let target = self.flow.find(to, target)?;
                self.visit_loop(body, to, merge, target);
                Ok(())
            }
            Some(Merge::Selection(merge)) => {
                let merge = self.flow.find(to, merge)?;
                self.place(body, to);
                self.visit_selection(body, to, merge)
            }
            None => {
                self.place(body, to);
                self.visit_terminator(body, to)
            }
        }
    }

    fn place(&mut self, body: BodyIndex, block: BlockIndex) {
        self.block_body[block] = Some(body);
        self.bodies[body].steps.push(ControlStep::Code(block));
    }

    fn visit_loop(
        &mut self,
        body: BodyIndex,
        header: BlockIndex,
        merge: BlockIndex,
        target: BlockIndex,
    ) {
        let merge_label = self.new_label();
        let loop_label = self.new_label();
        let merge_body = self.open_block(body, merge_label);
        let loop_body = self.new_body(merge_body);
        self.bodies[merge_body].steps.push(ControlStep::Loop {
            label: loop_label,
            body: loop_body,
        });
        self.announce(merge, merge_label);
        self.next([
            Task::Withdraw(header),
            Task::Withdraw(merge),
            Task::Walk {
                body,
                from: None,
                to: merge,
            },
        ]);
        let mut first = loop_body;
        if target != header {
            let label = self.new_label();
            first = self.open_block(loop_body, label);
            self.announce(target, label);
            self.next([
                Task::Withdraw(target),
                Task::Walk {
                    body: loop_body,
                    from: None,
                    to: target,
                },
            ]);
        }
        self.place(first, header);
        self.announce(header, loop_label);
        self.next([Task::Branch {
            body: first,
            at: header,
        }]);
    }

    fn visit_selection(
        &mut self,
        body: BodyIndex,
        at: BlockIndex,
        merge: BlockIndex,
    ) -> Result<(), Error> {
        let label = self.new_label();
        self.announce(merge, label);
        self.next([
            Task::Withdraw(merge),
            Task::Walk {
                body,
                from: None,
                to: merge,
            },
        ]);
        match self.flow.terminator(at).0 {
            Op::BranchConditional if !self.join_points.contains_key(&at) => {
                let fork = self.fork(at)?;
                if fork.no == fork.yes {
                    let then_body = self.open_block(body, label);
                    self.walk_arms(at, [(then_body, fork.yes)]);
                } else {
                    let (then_body, else_body) = (self.new_body(body), self.new_body(body));
                    self.bodies[body].steps.push(ControlStep::If {
                        at,
                        condition: Condition::Id(fork.condition),
                        label,
                        then_body,
                        else_body,
                    });
                    self.walk_arms(at, [(then_body, fork.yes), (else_body, fork.no)]);
                }
                Ok(())
            }
            Op::BranchConditional | Op::Switch => {
                let inner = self.open_block(body, label);
                self.visit_terminator(inner, at)
            }
            _ => {
                let offset = self.flow.block(at).offset;
                Err(Error::invalid(offset, "a selection must end in a branch"))
            }
        }
    }

    /// The code of the edges from one block, each in its own body.
    fn walk_arms<const N: usize>(&mut self, at: BlockIndex, arms: [(BodyIndex, BlockIndex); N]) {
        let from = Some(at);
        self.next(arms.map(|(body, to)| Task::Walk { body, from, to }));
    }

    /// A block without a merge instruction, or the branch of a construct's header.
    fn visit_terminator(&mut self, body: BodyIndex, at: BlockIndex) -> Result<(), Error> {
        let mut body = body;
        // The last join block is the outermost.
        for join_point in self.join_points.remove(&at).into_iter().flatten().rev() {
            let label = self.new_label();
            let inner = self.open_block(body, label);
            self.announce(join_point, label);
            self.next([
                Task::Withdraw(join_point),
                Task::Walk {
                    body,
                    from: None,
                    to: join_point,
                },
            ]);
            body = inner;
        }
        let (opcode, operands) = self.flow.terminator(at);
        match opcode {
            Op::Branch => {
                let to = self.flow.find(at, operands[0])?;
                self.walk_arms(at, [(body, to)]);
            }
            Op::BranchConditional => self.visit_fork(body, at)?,
            Op::Switch => self.visit_switch(body, at)?,
            _ => self.bodies[body].end = End::Exit(at),
        }
        Ok(())
    }

    fn visit_fork(&mut self, body: BodyIndex, at: BlockIndex) -> Result<(), Error> {
        let fork = self.fork(at)?;
        if fork.yes == fork.no {
            self.walk_arms(at, [(body, fork.yes)]);
            return Ok(());
        }
        let label = self.new_label();
        let (then_body, else_body) = (self.new_body(body), self.new_body(body));
        if self.target(fork.yes).is_some() {
            self.bodies[else_body].end = End::Br(label);
            self.walk_arms(at, [(then_body, fork.yes), (body, fork.no)]);
        } else if self.target(fork.no).is_some() {
            self.bodies[then_body].end = End::Br(label);
            self.walk_arms(at, [(else_body, fork.no), (body, fork.yes)]);
        } else {
            self.walk_arms(at, [(then_body, fork.yes), (else_body, fork.no)]);
        }
        self.bodies[body].steps.push(ControlStep::If {
            at,
            condition: Condition::Id(fork.condition),
            label,
            then_body,
            else_body,
        });
        Ok(())
    }

    /// Cases in sequence: lanes that take a case leave from inside its `if`. The default comes last
    /// and needs no test.
    fn visit_switch(&mut self, body: BodyIndex, at: BlockIndex) -> Result<(), Error> {
        let (default, cases) = self.flow.switch(at)?;
        let mut arms = Vec::with_capacity(cases.len() + 1);
        for (target, literals) in cases {
            if target == default {
                continue;
            }
            let label = self.new_label();
            let (then_body, else_body) = (self.new_body(body), self.new_body(body));
            self.bodies[else_body].end = End::Br(label);
            self.bodies[body].steps.push(ControlStep::If {
                at,
                condition: Condition::Cases(literals),
                label,
                then_body,
                else_body,
            });
            arms.push((then_body, target));
        }
        arms.push((body, default));
        let from = Some(at);
        let arms = arms.into_iter().rev();
        (self.tasks).extend(arms.map(|(body, to)| Task::Walk { body, from, to }));
        Ok(())
    }

    fn fork(&self, at: BlockIndex) -> Result<Fork, Error> {
        let (_, operands) = self.flow.terminator(at);
        Ok(Fork {
            condition: operands[0],
            yes: self.flow.find(at, operands[1])?,
            no: self.flow.find(at, operands[2])?,
        })
    }

    fn has_phis(&self, block: BlockIndex) -> bool {
        let first = self.flow.block(block).instructions.first();
        first.is_some_and(|&index| self.flow.module.instruction(index).opcode == Op::Phi)
    }

    fn find_escapes(&self, nesting: &Nesting) -> HashSet<Id> {
        let Flow { module, function } = self.flow;
        // A function's instructions stand together: where each is lowered, by its index less that
        // of the first.
        let blocks = &function.blocks;
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
            let index = module.definition(id)?.checked_sub(first)?;
            *bodies.get(index as usize)?
        };
        let mut escapes = HashSet::default();
        for (block, body) in function.blocks.iter().zip(&self.block_body) {
            let Some(body) = *body else { continue };
            for &index in block.instructions.iter().chain([&block.terminator]) {
                let instruction = module.instruction(index);
                if instruction.opcode == Op::Phi {
                    for pair in module.operands(instruction).chunks_exact(2) {
                        let from = function.block_index.get(&pair[1]);
                        let from = from.and_then(|&from| self.block_body[from]);
                        if let (Some(at), Some(from)) = (defined(pair[0]), from)
                            && !nesting.encloses(at, from)
                        {
                            escapes.insert(pair[0]);
                        }
                    }
                    continue;
                }
                for id in module.uses(instruction) {
                    if let Some(at) = defined(*id)
                        && !nesting.encloses(at, body)
                    {
                        escapes.insert(*id);
                    }
                }
            }
        }
        escapes
    }
}
