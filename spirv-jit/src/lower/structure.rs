//! From the control flow graph to a tree: which block is lowered in which body, and where branches go.
//!
//! A SPIR-V function that keeps the rules of structured control flow (SPIR-V specification, section Structured Control Flow) is walked along
//! its merge instructions. A branch to a block that some enclosing construct has announced (merge block, continue target, loop header, case) becomes
//! a `br` to that construct's label; any other block is lowered in place, once. What breaks the rules reaches a block twice and is refused.

use std::collections::{HashMap, HashSet};

use rspirv::spirv::Op;

use crate::Error;
use crate::parse::{Block, Function, Id, Merge, ParsedModule};

/// Constructs nested in each other. Recursion over bodies, here and in every pass, is bounded by it.
const MAX_DEPTH: usize = 200;

/// A body of the plan.
pub(super) type BodyIndex = usize;
/// A label of the plan.
pub(super) type LabelIndex = usize;
/// A block of the SPIR-V function.
pub(super) type BlockIndex = usize;

/// What an `if` of the plan tests.
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
    /// What phis of the second block take when coming from the first.
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
        targets: HashMap::new(),
        block_body: vec![None; function.blocks.len()],
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

struct Planner<'a> {
    module: &'a ParsedModule,
    function: &'a Function,
    bodies: Vec<PlanBody>,
    labels: usize,
    /// Labels that enclosing constructs have announced for a block, innermost last.
    targets: HashMap<BlockIndex, Vec<LabelIndex>>,
    /// The body that a block is lowered in.
    block_body: Vec<Option<BodyIndex>>,
    depth: usize,
}

/// A conditional branch: condition, target if true, target if false.
struct Fork {
    condition: Id,
    yes: BlockIndex,
    no: BlockIndex,
}

/// A switch, cases with one target put together.
struct Switch {
    at: BlockIndex,
    default: BlockIndex,
    cases: Vec<(BlockIndex, Vec<u64>)>,
}

impl Planner<'_> {
    fn new_body(&mut self, parent: Option<BodyIndex>) -> BodyIndex {
        self.bodies.push(PlanBody {
            parent,
            depth: parent.map_or(0, |parent| self.bodies[parent].depth + 1),
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

    fn withdraw(&mut self, block: BlockIndex) {
        if let Some(stack) = self.targets.get_mut(&block) {
            stack.pop();
        }
    }

    fn target(&self, block: BlockIndex) -> Option<LabelIndex> {
        self.targets.get(&block)?.last().copied()
    }

    fn block(&self, index: BlockIndex) -> &Block {
        &self.function.blocks[index]
    }

    fn find(&self, at: BlockIndex, label: Id) -> Result<BlockIndex, Error> {
        let found = self.function.block_index.get(&label).copied();
        found.ok_or_else(|| {
            let offset = self.block(at).offset;
            Error::invalid(offset, format!("branch to {label}, which is no block here"))
        })
    }

    /// A body of its own for what follows an edge.
    fn walk_arm(
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
    fn walk(
        &mut self,
        body: BodyIndex,
        from: Option<BlockIndex>,
        to: BlockIndex,
    ) -> Result<(), Error> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(super::budget("control flow is nested too deeply"));
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

    /// Cases one after the other: lanes that take one leave from inside its `if`. Cases that fall through into each other share one.
    fn visit_switch(
        &mut self,
        body: BodyIndex,
        at: BlockIndex,
    ) -> Result<Option<(Option<BlockIndex>, BlockIndex)>, Error> {
        let switch = self.switch(at)?;
        let mut chains = self.fall_through_chains(&switch)?;
        // The default's chain comes last and needs no test.
        let last = chains
            .iter()
            .position(|chain| chain.contains(&switch.default))
            .map(|index| chains.remove(index))
            .unwrap_or_else(|| vec![switch.default]);
        for chain in chains {
            let literals = chain
                .iter()
                .flat_map(|target| switch.literals(*target))
                .collect();
            let label = self.new_label();
            let then_body = self.new_body(Some(body));
            self.visit_chain(then_body, &switch, &chain)?;
            let else_body = self.new_body(Some(body));
            self.bodies[else_body].end = End::Br(label);
            self.bodies[body].steps.push(Step::If {
                at,
                condition: Condition::Cases(literals),
                label,
                then_body,
                else_body,
            });
        }
        if let [only] = last[..] {
            return Ok(Some((Some(at), only)));
        }
        self.visit_chain(body, &switch, &last)?;
        Ok(None)
    }

    /// Cases that fall through, first to last: each is entered by a `br` out of the blocks before it.
    fn visit_chain(
        &mut self,
        body: BodyIndex,
        switch: &Switch,
        chain: &[BlockIndex],
    ) -> Result<(), Error> {
        if let [only] = *chain {
            return self.walk(body, Some(switch.at), only);
        }
        self.depth += chain.len();
        if self.depth > MAX_DEPTH {
            return Err(super::budget("control flow is nested too deeply"));
        }
        let mut parents = vec![body];
        let mut labels = Vec::new();
        for &target in chain.iter().rev() {
            let label = self.new_label();
            let outer = parents[parents.len() - 1];
            let inner = self.new_body(Some(outer));
            self.bodies[outer]
                .steps
                .push(Step::Block { label, body: inner });
            self.announce(target, label);
            parents.push(inner);
            labels.push(label);
        }
        self.dispatch(parents[chain.len()], switch, chain)?;
        for (position, &target) in chain.iter().enumerate() {
            self.withdraw(target);
            let outer = parents[chain.len() - 1 - position];
            self.walk(outer, None, target)?;
        }
        self.depth -= chain.len();
        Ok(())
    }

    fn dispatch(
        &mut self,
        body: BodyIndex,
        switch: &Switch,
        chain: &[BlockIndex],
    ) -> Result<(), Error> {
        let otherwise = if chain.contains(&switch.default) {
            switch.default
        } else {
            chain[chain.len() - 1]
        };
        for &target in chain.iter().filter(|&&target| target != otherwise) {
            let label = self.new_label();
            let then_body = self.walk_arm(body, switch.at, target)?;
            let else_body = self.new_body(Some(body));
            self.bodies[else_body].end = End::Br(label);
            self.bodies[body].steps.push(Step::If {
                at: switch.at,
                condition: Condition::Cases(switch.literals(target).collect()),
                label,
                then_body,
                else_body,
            });
        }
        self.walk(body, Some(switch.at), otherwise)
    }

    /// Cases grouped so that each falls through only into later ones of its group. Targets that leave the switch are groups of their own.
    fn fall_through_chains(&self, switch: &Switch) -> Result<Vec<Vec<BlockIndex>>, Error> {
        let mut entries: Vec<BlockIndex> = switch.cases.iter().map(|case| case.0).collect();
        if !entries.contains(&switch.default) {
            entries.push(switch.default);
        }
        let inside: HashSet<BlockIndex> = entries
            .iter()
            .copied()
            .filter(|&entry| self.target(entry).is_none())
            .collect();
        let mut falls: HashMap<BlockIndex, Vec<BlockIndex>> = HashMap::new();
        let mut owner: HashMap<BlockIndex, BlockIndex> = HashMap::new();
        for &entry in entries.iter().filter(|entry| inside.contains(entry)) {
            falls.insert(entry, self.falls_into(entry, &inside, &mut owner));
        }
        let order = order_cases(&entries, &falls)
            .ok_or_else(|| Error::invalid(self.block(switch.at).offset, "cases form a loop"))?;
        Ok(group_cases(&order, &falls))
    }

    /// The cases that control flow can get into from a case without leaving the switch. Each block is looked at for one case only.
    fn falls_into(
        &self,
        entry: BlockIndex,
        inside: &HashSet<BlockIndex>,
        owner: &mut HashMap<BlockIndex, BlockIndex>,
    ) -> Vec<BlockIndex> {
        let mut found = Vec::new();
        let mut work = vec![entry];
        while let Some(block) = work.pop() {
            let (opcode, operands) = self.terminator(block);
            let targets: Vec<Id> = match opcode {
                Op::Branch => vec![operands[0]],
                Op::BranchConditional => operands[1..3].to_vec(),
                Op::Switch => self.switch_labels(block),
                _ => Vec::new(),
            };
            let merge = match self.block(block).merge {
                Some(Merge::Selection(merge)) => vec![merge],
                Some(Merge::Loop(merge, target)) => vec![merge, target],
                None => Vec::new(),
            };
            for label in targets.into_iter().chain(merge) {
                let Some(&to) = self.function.block_index.get(&label) else {
                    continue;
                };
                if self.target(to).is_some() {
                    continue;
                }
                if inside.contains(&to) {
                    if to != entry && !found.contains(&to) {
                        found.push(to);
                    }
                } else if owner.insert(to, entry).is_none() {
                    work.push(to);
                }
            }
        }
        found
    }

    fn terminator(&self, block: BlockIndex) -> (Op, &[u32]) {
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

    /// Words of a case literal: two if the selector has 64 bits.
    fn literal_words(&self, block: BlockIndex) -> usize {
        let instruction = self.module.instruction(self.block(block).terminator);
        let uses = self.module.uses(instruction).len();
        let operands = self.module.operands(instruction).len();
        // Selector, default and one label a case are ids; the rest is literals.
        let cases = uses.saturating_sub(2);
        if cases > 0 && operands >= 2 + 3 * cases {
            2
        } else {
            1
        }
    }

    fn switch_cases(&self, block: BlockIndex) -> impl Iterator<Item = (u64, Id)> {
        let (_, operands) = self.terminator(block);
        let width = self.literal_words(block);
        operands[2..].chunks_exact(width + 1).map(move |case| {
            let high = if width == 2 { case[1] as u64 } else { 0 };
            (case[0] as u64 | high << 32, case[width])
        })
    }

    fn switch_labels(&self, block: BlockIndex) -> Vec<Id> {
        let (_, operands) = self.terminator(block);
        let cases = self.switch_cases(block).map(|case| case.1);
        cases.chain([operands[1]]).collect()
    }

    fn switch(&self, at: BlockIndex) -> Result<Switch, Error> {
        let (_, operands) = self.terminator(at);
        let default = self.find(at, operands[1])?;
        let mut cases: Vec<(BlockIndex, Vec<u64>)> = Vec::new();
        let mut index: HashMap<BlockIndex, usize> = HashMap::new();
        for (literal, label) in self.switch_cases(at) {
            let target = self.find(at, label)?;
            let slot = *index.entry(target).or_insert_with(|| {
                cases.push((target, Vec::new()));
                cases.len() - 1
            });
            cases[slot].1.push(literal);
        }
        Ok(Switch { at, default, cases })
    }

    fn has_phis(&self, block: BlockIndex) -> bool {
        let first = self.block(block).instructions.first();
        first.is_some_and(|&index| self.module.instruction(index).opcode == Op::Phi)
    }

    fn find_escapes(&self) -> HashSet<Id> {
        let mut defined: HashMap<Id, BodyIndex> = HashMap::new();
        for (block, body) in self.function.blocks.iter().zip(&self.block_body) {
            let Some(body) = *body else { continue };
            for &index in &block.instructions {
                let instruction = self.module.instruction(index);
                // Phis are variables already.
                if instruction.result != 0 {
                    defined.insert(instruction.result, body);
                }
            }
        }
        let mut escapes = HashSet::new();
        for (block, body) in self.function.blocks.iter().zip(&self.block_body) {
            let Some(body) = *body else { continue };
            for &index in block.instructions.iter().chain([&block.terminator]) {
                let instruction = self.module.instruction(index);
                if instruction.opcode == Op::Phi {
                    for pair in self.module.operands(instruction).chunks_exact(2) {
                        let from = self.function.block_index.get(&pair[1]);
                        let from = from.and_then(|&from| self.block_body[from]);
                        if let (Some(at), Some(from)) = (defined.get(&pair[0]), from)
                            && !encloses(&self.bodies, *at, from)
                        {
                            escapes.insert(pair[0]);
                        }
                    }
                    continue;
                }
                for id in self.module.uses(instruction) {
                    if let Some(&at) = defined.get(id)
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

impl Switch {
    fn literals(&self, target: BlockIndex) -> impl Iterator<Item = u64> {
        let cases = self.cases.iter().filter(move |case| case.0 == target);
        cases.flat_map(|case| case.1.iter().copied())
    }
}

/// Cases in an order where each comes before those it falls into; `None` if there is none.
fn order_cases(
    entries: &[BlockIndex],
    falls: &HashMap<BlockIndex, Vec<BlockIndex>>,
) -> Option<Vec<BlockIndex>> {
    let mut incoming: HashMap<BlockIndex, usize> = entries.iter().map(|&e| (e, 0)).collect();
    for to in falls.values().flatten() {
        *incoming.get_mut(to)? += 1;
    }
    let mut ready: Vec<BlockIndex> = entries.iter().rev().copied().collect();
    ready.retain(|entry| incoming[entry] == 0);
    let mut order = Vec::new();
    while let Some(entry) = ready.pop() {
        order.push(entry);
        for &to in falls.get(&entry).into_iter().flatten() {
            let count = incoming.get_mut(&to)?;
            *count -= 1;
            if *count == 0 {
                ready.push(to);
            }
        }
    }
    (order.len() == entries.len()).then_some(order)
}

/// Groups of cases that are connected by falling through, each in the given order.
fn group_cases(
    order: &[BlockIndex],
    falls: &HashMap<BlockIndex, Vec<BlockIndex>>,
) -> Vec<Vec<BlockIndex>> {
    let mut group: HashMap<BlockIndex, usize> = HashMap::new();
    let mut groups: Vec<Vec<BlockIndex>> = Vec::new();
    // Later cases first: a case joins (and unites) the groups of those it falls into.
    for &entry in order.iter().rev() {
        let mut joined: Vec<usize> = falls
            .get(&entry)
            .into_iter()
            .flatten()
            .filter_map(|to| group.get(to).copied())
            .collect();
        joined.sort_unstable();
        joined.dedup();
        let home = joined.first().copied().unwrap_or_else(|| {
            groups.push(Vec::new());
            groups.len() - 1
        });
        for &other in joined.iter().skip(1) {
            for moved in std::mem::take(&mut groups[other]) {
                group.insert(moved, home);
                groups[home].push(moved);
            }
        }
        group.insert(entry, home);
        groups[home].push(entry);
    }
    let position: HashMap<BlockIndex, usize> = order
        .iter()
        .enumerate()
        .map(|(index, &e)| (e, index))
        .collect();
    let mut groups: Vec<_> = groups.into_iter().filter(|g| !g.is_empty()).collect();
    for group in &mut groups {
        group.sort_by_key(|entry| position[entry]);
    }
    groups.sort_by_key(|group| position[&group[0]]);
    groups
}
