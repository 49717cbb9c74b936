//! Switches in the plan: cases one after the other, and those that fall through into each other together.

use foldhash::{HashMap, HashSet};

use rspirv::spirv::Op;

use super::structure::{BlockIndex, BodyIndex, Condition, End, MAX_DEPTH, Planner, Step, too_deep};
use crate::Error;
use crate::parse::{Id, Merge};

/// A switch, cases with one target put together.
struct Switch {
    at: BlockIndex,
    default: BlockIndex,
    cases: Vec<(BlockIndex, Vec<u64>)>,
    /// Where a target is in `cases`.
    index: HashMap<BlockIndex, usize>,
}

impl Planner<'_> {
    /// Cases one after the other: lanes that take one leave from inside its `if`. Cases that fall through into each other share one.
    pub(super) fn visit_switch(
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
            return Err(too_deep());
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
    fn fall_through_chains(&mut self, switch: &Switch) -> Result<Vec<Vec<BlockIndex>>, Error> {
        let mut entries: Vec<BlockIndex> = switch.cases.iter().map(|case| case.0).collect();
        if !entries.contains(&switch.default) {
            entries.push(switch.default);
        }
        let inside: HashSet<BlockIndex> = entries
            .iter()
            .copied()
            .filter(|&entry| self.target(entry).is_none())
            .collect();
        let mut falls: HashMap<BlockIndex, Vec<BlockIndex>> = HashMap::default();
        for &entry in entries.iter().filter(|entry| inside.contains(entry)) {
            falls.insert(entry, self.falls_into(switch.at, entry, &inside)?);
        }
        let order = order_cases(&entries, &falls)
            .ok_or_else(|| Error::invalid(self.block(switch.at).offset, "cases form a loop"))?;
        Ok(group_cases(&order, &falls))
    }

    /// The cases that control flow can get into from a case of the switch at a block without leaving it. Each block is looked at for one case
    /// only, but again for each switch around it: of that, there is a limit.
    fn falls_into(
        &mut self,
        at: BlockIndex,
        entry: BlockIndex,
        inside: &HashSet<BlockIndex>,
    ) -> Result<Vec<BlockIndex>, Error> {
        let mut found = Vec::new();
        let mut work = vec![entry];
        while let Some(block) = work.pop() {
            self.looks = self.looks.checked_sub(1).ok_or_else(too_deep)?;
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
                } else if self.seen_by[to].replace(at) != Some(at) {
                    work.push(to);
                }
            }
        }
        Ok(found)
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
        let mut index: HashMap<BlockIndex, usize> = HashMap::default();
        for (literal, label) in self.switch_cases(at) {
            let target = self.find(at, label)?;
            let slot = *index.entry(target).or_insert_with(|| {
                cases.push((target, Vec::new()));
                cases.len() - 1
            });
            cases[slot].1.push(literal);
        }
        Ok(Switch {
            at,
            default,
            cases,
            index,
        })
    }
}

impl Switch {
    fn literals(&self, target: BlockIndex) -> impl Iterator<Item = u64> {
        let case = self.index.get(&target).map(|&index| &self.cases[index]);
        case.into_iter().flat_map(|case| case.1.iter().copied())
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
    let mut group: HashMap<BlockIndex, usize> = HashMap::default();
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
