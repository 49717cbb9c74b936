//! Loops as native code: those whose bodies are pure operations, operations across lanes, branches,
//! loads of words, and private memory.

use foldhash::{HashMap, HashSet};
use smallvec::SmallVec;

use super::alike::{Extent, alike};
use super::loop_facts::{indirect_loads, needs_both_halves, stores_words, used};
use super::native::{ALIGNMENT, Native};
use super::ways::{Open, Ways};
use super::{Emitter, instr};
use crate::interp::code::LoopPlan;
use crate::interp::native;
use crate::interp::operand::Operand;
use crate::ir::op::{Access, SubgroupOp};
use crate::ir::stage::Stage;
use crate::ir::{Body, Inst, Label, Node, Op, Space, Step, Terminator, Type, Value, VariableId};
use crate::native::{
    Encoding, IrOperand, Lanes, ListedTurns, MAX_REGIONS, PrivateRow, Sameness, Turns, ValueRow,
    WORKGROUP,
};
use crate::plan::takes_helpers;

/// Operations in branches, at most: code computes all of them in each turn, whichever way lanes go.
const MOST_IN_BRANCHES: usize = 96;

/// Parameters of loops that both halves of a subgroup take together, at most, without those that
/// are the same in all lanes: more have too few registers.
const MOST_PAIRED: usize = 4;

/// Operations of a turn of all subgroups that take it together, at most: a processor looks so far
/// ahead.
const MOST_OPERATIONS: usize = 256;

/// Branches of a turn, at least, with which a loop is native code that takes one subgroup after
/// another. With fewer, the interpreter is faster: its operations of several subgroups overlap.
const LEAST_BRANCHES: usize = 3;

/// Operations of a turn, at least, with which such a loop is native code with fewer branches, too:
/// so many do not wait for each other.
const LEAST_ALONE: usize = 32;

/// Operations of a turn, at least, for each load from a place that another load decides: gathers of
/// words that lie apart are slower than the interpreter's loads.
const OPERATIONS_OF_LOAD: usize = 16;

/// A loop's code.
struct Written {
    code: Vec<u8>,
    /// Of a turn of one subgroup.
    operations: usize,
    branches: usize,
    /// As [`LoopPlan`] has them.
    left_to: u32,
    shared: Vec<(Operand, bool)>,
    regions: Vec<(Operand, bool)>,
    takes_own: bool,
}

/// Whether a private row holds all of a value.
fn is_row(place: &IrOperand) -> bool {
    place.ty.rows() == 1 && place.ty != Type::I1
}

/// Whether a place is of a word of each lane.
fn is_word(place: &IrOperand) -> bool {
    place.ty.rows() == 1 && place.ty.size_bytes() == 4
}

impl<'m> Emitter<'m> {
    /// Emits a loop, whose parameters are in their rows, as native code; false if it has none.
    /// `mask` is its label's.
    pub(super) fn emit_turns(&mut self, node: &'m Node, mask: u32) -> bool {
        let Some(single) = self.assemble_turns(node, 1) else {
            return false;
        };
        let is_across = matches!(node, Node::Loop { body, .. } if needs_both_halves(body));
        let together = (self.most_together(&single, is_across).iter())
            .find_map(|&count| Some((count, self.assemble_turns(node, count)?)));
        let is_slow = together.is_none()
            && single.branches < LEAST_BRANCHES
            && single.operations < LEAST_ALONE;
        if is_slow || single.operations < OPERATIONS_OF_LOAD * indirect_loads(node) {
            return false;
        }
        let (together, shared, mut code) = match together {
            Some((count, written)) => (count, written.shared, written.code),
            None => (1, Vec::new(), Vec::new()),
        };
        code.resize(code.len().next_multiple_of(ALIGNMENT), 0);
        let run = super::Instr {
            a: Operand::number(self.code.loops.len() as u32),
            ..instr(native::run_loop)
        };
        let turns = ListedTurns {
            together,
            single: code.len(),
        };
        self.code.loops.push(LoopPlan {
            label: mask,
            left_to: single.left_to,
            together,
            single: turns.single,
            shared,
            regions: single.regions,
            takes_own: single.takes_own,
        });
        code.extend(single.code);
        self.push_native(&code, single.operations.max(1), Some(turns), run);
        true
    }

    /// How many subgroups may take a loop together: the most first. `is_across`: see
    /// [`needs_both_halves`].
    fn most_together(&self, single: &Written, is_across: bool) -> &'static [usize] {
        let is_long = |count: usize| count * single.operations > MOST_OPERATIONS;
        let encoding = self.native.as_ref().map(Native::encoding);
        match encoding {
            _ if is_long(2) => &[],
            Some(Encoding::Evex) if !is_long(4) => &[4, 2],
            Some(Encoding::Vex) if !is_long(4) && !is_across => &[4, 2],
            _ => &[2],
        }
    }

    /// The code of a loop that so many subgroups take together.
    fn assemble_turns(&self, node: &'m Node, subgroups: usize) -> Option<Written> {
        let Ways {
            turns,
            branches,
            left_to,
            regions,
            shared,
            ..
        } = self.turns(node, subgroups)?;
        let copies = turns.copies();
        let params = match node {
            Node::Loop { params, .. } => &params[..],
            _ => &[],
        };
        let shared = (params.iter())
            .filter(|&param| shared.contains(param) && self.operand(*param) != Operand::NONE)
            .map(|&param| (self.operand(param), self.place(param).ty.rows() == 2))
            .collect();
        let takes_own = turns.takes_own();
        let operations = turns.operations() / copies;
        Some(Written {
            code: turns.assemble(Self::fuel_of(operations))?,
            operations,
            branches: branches / copies,
            left_to: left_to?,
            shared,
            regions,
            takes_own,
        })
    }

    fn turns(&self, node: &'m Node, subgroups: usize) -> Option<Ways<'m>> {
        let Node::Loop {
            label,
            params,
            body,
            ..
        } = node
        else {
            return None;
        };
        let encoding = self.native.as_ref()?.encoding();
        let is_uniform = |value| self.operand(value).is_uniform();
        let shared = match subgroups {
            1 => HashSet::default(),
            _ => {
                let loads = !stores_words(body);
                alike(node, Extent::Together { loads }, is_uniform)
            }
        };
        let alike = alike(node, Extent::Subgroup, is_uniform);
        let (params, indices): (Vec<IrOperand>, Vec<usize>) = (params.iter().enumerate())
            .filter(|&(_, &param)| self.operand(param) != Operand::NONE)
            .map(|(k, &param)| (self.place(param), k))
            .unzip();
        let entered: Vec<(IrOperand, Sameness)> = (params.iter())
            .map(|&param| {
                let sameness = match param.value {
                    value if shared.contains(&value) => Sameness::Together,
                    value if alike.contains(&value) => Sameness::Subgroup,
                    _ => Sameness::Nowhere,
                };
                (param, sameness)
            })
            .collect();
        let of_lanes = (entered.iter()).filter(|(_, same)| *same == Sameness::Nowhere);
        let is_paired = of_lanes.count() <= MOST_PAIRED || needs_both_halves(body);
        if subgroups > 1 && !is_paired && encoding == Encoding::Vex {
            return None;
        }
        let mut ways = Ways {
            turns: Turns::new(encoding, is_paired, subgroups),
            open: Vec::new(),
            lanes: None,
            branches: 0,
            left_to: None,
            has_left: false,
            regions: Vec::new(),
            alike,
            shared,
            distances: HashMap::default(),
            bounds: HashMap::default(),
            used: used(body),
        };
        for copy in 0..ways.turns.copies() {
            let first = Open {
                label: *label,
                results: &[],
                joined: None,
                pending: None,
                body: None,
            };
            ways.open.push(first);
            ways.has_left = false;
            ways.lanes = Some(ways.turns.begin(copy, &entered));
            self.follow(body, &params, &indices, &mut ways)?;
            let (lanes, ends) = ways.open.pop()?.joined?;
            ways.turns.end(lanes, &ends);
        }
        Some(ways)
    }

    /// A turn from its start to its end.
    fn follow(
        &self,
        body: &'m Body,
        params: &[IrOperand],
        indices: &[usize],
        ways: &mut Ways<'m>,
    ) -> Option<()> {
        let uniform = &self.plan().uniform;
        let mut in_branches = 0;
        for step in body.steps() {
            match step {
                Step::Inst(inst) => {
                    let in_prologue = inst.results.first().is_some_and(|r| uniform[r.index()]);
                    if in_prologue || ways.lanes.is_none() {
                        continue;
                    }
                    self.note(inst, ways);
                    if self.placed().fusion.absorbs(inst) {
                        continue;
                    }
                    in_branches += (ways.open.len() > 1) as usize;
                    self.operation(inst, ways)?;
                    if in_branches > MOST_IN_BRANCHES {
                        return None;
                    }
                }
                Step::Open(node) => self.open(node, ways)?,
                Step::Else(_) => {
                    ways.lanes = ways.open.last_mut()?.pending.take();
                    ways.end_without();
                    ways.begin_body();
                }
                Step::End(body) => {
                    if let Some(lanes) = ways.end_body() {
                        self.branch(lanes, &body.end, params, indices, ways)?;
                    }
                }
                Step::Close(_) => {
                    self.close(ways)?;
                    ways.end_without();
                }
            }
        }
        Some(())
    }

    /// Notes the distance and the bound of an instruction's result, if they are known.
    fn note(&self, inst: &Inst, ways: &mut Ways<'m>) {
        if let &[result] = &inst.results[..] {
            let distance = self.distance(inst, ways);
            ways.distances
                .extend(distance.map(|distance| (result, distance)));
            ways.bounds
                .extend(self.bound(inst).map(|bound| (result, bound)));
        }
    }

    /// Writes an instruction. `None`: native code does not have it.
    fn operation(&self, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        match inst.op {
            Op::Load(access) => self.load(access, inst, ways),
            Op::Store(access) => self.store(access, inst, ways),
            Op::VarLoad(variable, row) => {
                let row = self.fixed_row(variable, row, inst)?;
                self.load_private(row, inst, ways)
            }
            Op::VarStore(variable, row) => {
                let row = self.fixed_row(variable, row, inst)?;
                self.store_private(row, &inst.args, ways)
            }
            Op::Subgroup(op) => self.across(op, inst, ways),
            Op::LaneIndex => {
                let result = self.place(inst.results[0]);
                ways.turns.lane_index(&result)
            }
            _ => self.fold(inst, ways).or_else(|| self.write(inst, ways)),
        }
    }

    /// Begins a construct; the lanes of a branch are divided.
    fn open(&self, node: &'m Node, ways: &mut Ways<'m>) -> Option<()> {
        let mut open = Open {
            label: node.label()?,
            results: node.definitions(),
            joined: None,
            pending: None,
            body: None,
        };
        match node {
            Node::If { condition, .. } => {
                ways.branches += 1;
                let both = match (ways.lanes, self.leave_together(node, ways)) {
                    (Some(_), Some(both)) => both,
                    (Some(lanes), None) => {
                        let condition = self.place(*condition);
                        let both = ways.turns.split(lanes, &condition)?;
                        self.leave_first(node, both, ways)?
                    }
                    (None, _) => [None; 2],
                };
                [ways.lanes, open.pending] = both;
            }
            Node::Loop { .. } => return None,
            _ => {}
        }
        ways.open.push(open);
        if let Node::If { .. } = node {
            ways.begin_body();
        }
        Some(())
    }

    /// Ends the innermost construct: lanes go on from there with its results.
    fn close(&self, ways: &mut Ways<'m>) -> Option<()> {
        let open = ways.open.pop()?;
        if let Some((lanes, results)) = open.joined {
            ways.lanes = Some(lanes);
            let kept = self.kept(open.results);
            for (result, merged) in kept.into_iter().zip(results) {
                ways.turns.define(open.results[result], merged);
            }
        }
        Some(())
    }

    /// The body of a branch that does nothing but leave the loop, if the other one does more:
    /// whether it is the first, the label that lanes leave to, and the values that they take along.
    fn leaving(&self, node: &'m Node, ways: &Ways<'m>) -> Option<(bool, &'m Label, &'m [Value])> {
        let Node::If {
            label: own,
            then_body,
            else_body,
            ..
        } = node
        else {
            return None;
        };
        let leaves = |body: &'m Body| match &body.end {
            Terminator::Br(label, args) if body.nodes.is_empty() => {
                let stays = label == own || ways.open.iter().any(|open| open.label == *label);
                (!stays).then_some((label, &args[..]))
            }
            _ => None,
        };
        match (leaves(then_body), leaves(else_body)) {
            (Some((label, args)), None) => Some((true, label, args)),
            (None, Some((label, args))) => Some((false, label, args)),
            _ => None,
        }
    }

    /// Code for a branch with a condition that is the same in all lanes, one of whose bodies does
    /// nothing but leave the loop. Gives the lanes of both bodies.
    fn leave_together(&self, node: &'m Node, ways: &mut Ways<'m>) -> Option<[Option<Lanes>; 2]> {
        let Node::If { condition, .. } = node else {
            return None;
        };
        let is_same = match ways.turns.copies() {
            1 => ways.alike.contains(condition),
            _ => ways.shared.contains(condition),
        };
        let lanes = ways.lanes.filter(|_| is_same)?;
        let (when, label, args) = self.leaving(node, ways)?;
        let (mask, to) = self.labels.get(label)?;
        if ways.left_to.is_some_and(|other| other != *mask) {
            return None;
        }
        let values: SmallVec<[(IrOperand, ValueRow); 4]> = (to.iter().zip(args))
            .filter(|(to, _)| self.operand(**to) != Operand::NONE)
            .map(|(&to, &from)| {
                let row = ValueRow::Frame(self.operand(to).index());
                (self.place(from), row)
            })
            .collect();
        let condition = (&self.place(*condition), when);
        if !ways.turns.leave_together(lanes, condition, &values) {
            return None;
        }
        ways.left_to = Some(*mask);
        let both = [Some(lanes), None];
        Some(if when { [None, Some(lanes)] } else { both })
    }

    /// Code for a branch whose lanes are divided: those of a body that does nothing but leave the
    /// loop leave at once. Gives the lanes of both bodies.
    fn leave_first(
        &self,
        node: &'m Node,
        [yes, no]: [Lanes; 2],
        ways: &mut Ways<'m>,
    ) -> Option<[Option<Lanes>; 2]> {
        let Some((when, label, args)) = self.leaving(node, ways) else {
            return Some([Some(yes), Some(no)]);
        };
        let (left, rest) = if when { (yes, no) } else { (no, yes) };
        self.leave(left, label, args, ways)?;
        ways.lanes = Some(rest);
        ways.end_without();
        let both = [Some(rest), None];
        Some(if when { [None, Some(rest)] } else { both })
    }

    /// Lanes leave the loop.
    fn leave(
        &self,
        lanes: Lanes,
        label: &Label,
        args: &[Value],
        ways: &mut Ways<'m>,
    ) -> Option<()> {
        let (mask, to) = self.labels.get(label)?;
        if *ways.left_to.get_or_insert(*mask) != *mask {
            return None;
        }
        ways.has_left = true;
        for (&to, &from) in to.iter().zip(args) {
            let row = self.operand(to);
            if row != Operand::NONE {
                let from = self.place(from);
                ways.turns.leave(lanes, &from, ValueRow::Frame(row.index()));
            }
        }
        Some(())
    }

    /// A store of a word of each lane, or to private memory.
    fn store(&self, access: Access, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        let (&row, values) = inst.args.split_first()?;
        match access.space {
            Space::Private if !access.is_strided => {
                self.store_private(self.private_row(row, ways), values, ways)
            }
            // Code does not know which lanes are helper invocations.
            _ if self.module.stage == Stage::Fragment => None,
            Space::Buffer | Space::Shared => self.store_word(access, inst, ways),
            _ => None,
        }
    }

    /// A store of a word of each lane to a buffer or to workgroup memory.
    fn store_word(&self, access: Access, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        let (number, offset, value) = match (access.space, &inst.args[..]) {
            _ if access.volatile || access.is_strided => return None,
            (Space::Buffer, &[descriptor, offset, value]) => {
                (self.region(descriptor, true, ways)?, offset, value)
            }
            // There is a word, where offsets outside of it would go.
            (Space::Shared, &[offset, value]) if self.module.shared_size_bytes >= 4 => {
                (WORKGROUP, offset, value)
            }
            _ => return None,
        };
        let (place, word) = (self.place(offset), self.place(value));
        if !is_word(&word) {
            return None;
        }
        let distance = ways.distances.get(&offset).copied().unwrap_or(0);
        (ways.turns).store(ways.lanes?, number, (&place, distance), &word)
    }

    /// The private row that a value names.
    fn private_row(&self, row: Value, ways: &Ways<'m>) -> PrivateRow {
        let place = self.place(row);
        match ways.alike.contains(&row) || self.operand(row).is_uniform() {
            true => PrivateRow::Alike(place),
            false => PrivateRow::Apart(place),
        }
    }

    fn fixed_row(&self, variable: VariableId, row: u32, inst: &Inst) -> Option<PrivateRow> {
        let ty = self
            .body_function()
            .ty(*inst.results.first().or(inst.args.first())?);
        let row = self.variable_access(variable, row, ty, inst).ok()?;
        Some(PrivateRow::Fixed(row))
    }

    fn load_private(&self, row: PrivateRow, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        let results = self.results(inst, ways);
        if !results.iter().flatten().all(is_row) {
            return None;
        }
        let rows = (row, self.planned.plan.private_rows as u32);
        ways.turns.load_private(ways.lanes?, rows, &results)
    }

    fn store_private(&self, row: PrivateRow, values: &[Value], ways: &mut Ways<'m>) -> Option<()> {
        let values: SmallVec<[IrOperand; 4]> =
            values.iter().map(|&value| self.place(value)).collect();
        if !values.iter().all(is_row) {
            return None;
        }
        let rows = (row, self.planned.plan.private_rows as u32);
        ways.turns.store_private(ways.lanes?, rows, &values)
    }

    /// The results of an instruction, those that are used.
    fn results(&self, inst: &Inst, ways: &Ways<'m>) -> SmallVec<[Option<IrOperand>; 4]> {
        (inst.results.iter())
            .map(|result| ways.used.contains(result).then(|| self.place(*result)))
            .collect()
    }

    /// A load of words.
    fn load(&self, access: Access, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        if let (Space::Private, &[row]) = (access.space, &inst.args[..]) {
            return self.load_private(self.private_row(row, ways), inst, ways);
        }
        let number = match (access.space, &inst.args[..]) {
            _ if access.volatile => return None,
            (Space::Buffer, [descriptor, _]) => self.region(*descriptor, false, ways)?,
            (Space::Shared, [_]) => WORKGROUP,
            _ => return None,
        };
        let offset = self.place(*inst.args.last()?);
        let results = self.results(inst, ways);
        if !results.iter().flatten().all(is_word) {
            return None;
        }
        // Results of such loads are the same in all lanes, also in those that do not come here.
        let is_alike =
            ways.alike.contains(inst.args.last()?) || self.operand(*inst.args.last()?).is_uniform();
        match is_alike {
            true => {
                let is_shared = (inst.results.iter()).all(|result| ways.shared.contains(result));
                (ways.turns).load_at_one_place(number, (&offset, is_shared), &results)
            }
            false => {
                let distance = ways.distances.get(inst.args.last()?).copied();
                (ways.turns).load(
                    ways.lanes?,
                    number,
                    (&offset, distance.unwrap_or(0)),
                    &results,
                )
            }
        }
    }

    /// The number of a buffer among a loop's regions.
    fn region(&self, descriptor: Value, is_written: bool, ways: &mut Ways<'m>) -> Option<usize> {
        let region = (self.operand(descriptor), is_written);
        if !region.0.is_uniform() {
            return None;
        }
        let known = ways.regions.iter().position(|&other| other == region);
        let number = known.unwrap_or(ways.regions.len());
        if number == MAX_REGIONS {
            return None;
        }
        if known.is_none() {
            ways.regions.push(region);
        }
        Some(number)
    }

    /// See [`Ways::bounds`].
    fn bound(&self, inst: &Inst) -> Option<u32> {
        let &[a, b] = &inst.args[..] else {
            return None;
        };
        match inst.op {
            Op::And | Op::UMin => {
                let constants = [a, b]
                    .into_iter()
                    .filter_map(|value| self.place(value).constant);
                constants.min()?.try_into().ok()
            }
            Op::LShr if self.place(a).ty == Type::I32 => {
                u32::MAX.checked_shr(self.place(b).constant?.try_into().ok()?)
            }
            _ => None,
        }
    }

    /// See [`Ways::distances`].
    fn distance(&self, inst: &Inst, ways: &Ways<'m>) -> Option<u32> {
        let &[a, b] = &inst.args[..] else {
            return None;
        };
        let constant = |value| Some(self.place(value).constant? as u32);
        let is_alike = |value| ways.alike.contains(&value) || self.operand(value).is_uniform();
        let known = |value| ways.distances.get(&value).copied();
        match inst.op {
            Op::Shl => known(a)
                .unwrap_or(1)
                .checked_mul(1u32.checked_shl(constant(b)?)?),
            Op::IMul => {
                let (factor, other) = match (constant(a), constant(b)) {
                    (Some(factor), _) => (factor, b),
                    (_, factor) => (factor?, a),
                };
                known(other).unwrap_or(1).checked_mul(factor)
            }
            Op::IAdd if is_alike(a) => known(b),
            Op::IAdd if is_alike(b) => known(a),
            _ => None,
        }
    }

    /// An operation on each lane by itself.
    fn write(&self, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        let is_in =
            |values: &HashSet<Value>| (inst.results.iter()).all(|result| values.contains(result));
        let sameness = if is_in(&ways.shared) {
            Sameness::Together
        } else if is_in(&ways.alike) {
            Sameness::Subgroup
        } else {
            Sameness::Nowhere
        };
        (ways.turns).perform(&inst.results, sameness, |stretch| {
            self.perform(stretch, inst)
        })
    }

    /// An operation on values that are known for each lane.
    fn fold(&self, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        let &[a, b] = &inst.args[..] else {
            return None;
        };
        if let Some(pair) = self.placed().fusion.of(inst) {
            let taken = inst.args[pair.side as usize];
            let &[Some(a), Some(b), _] = &pair.operands else {
                return None;
            };
            let operands = [self.place(a), self.place(b)];
            ways.turns
                .fold(&pair.first, &operands, &self.place(taken))?;
        }
        let operands = [self.place(a), self.place(b)];
        let result = self.place(*inst.results.first()?);
        ways.turns.fold(&inst.op, &operands, &result)
    }

    fn across(&self, op: SubgroupOp, inst: &Inst, ways: &mut Ways<'m>) -> Option<()> {
        // Code does not know which lanes are helper invocations.
        if self.module.stage == Stage::Fragment && !takes_helpers(self.module, op) {
            return None;
        }
        let operands: SmallVec<[IrOperand; 2]> = inst.args.iter().map(|&v| self.place(v)).collect();
        let result = self.place(*inst.results.first()?);
        let most = inst.args.last().and_then(|last| ways.bounds.get(last));
        let most = most.copied().unwrap_or(u32::MAX);
        (ways.turns).across(ways.lanes?, op, &operands, most, &result)
    }

    /// Which of some values have rows.
    fn kept(&self, values: &[Value]) -> SmallVec<[usize; 4]> {
        (0..values.len())
            .filter(|&k| self.operand(values[k]) != Operand::NONE)
            .collect()
    }

    /// The end of a body, to which lanes have come.
    fn branch(
        &self,
        lanes: Lanes,
        end: &Terminator,
        params: &[IrOperand],
        indices: &[usize],
        ways: &mut Ways<'m>,
    ) -> Option<()> {
        let Terminator::Br(label, args) = end else {
            return None;
        };
        let depth = ways.open.iter().position(|open| open.label == *label);
        let Some(depth) = depth else {
            return self.leave(lanes, label, args, ways);
        };
        ways.join_outside(depth);
        let open = &mut ways.open[depth];
        let before = open.joined.take();
        let is_loop = depth == 0;
        let results: Vec<IrOperand> = match is_loop {
            true => params.to_vec(),
            false => {
                let kept = self.kept(open.results);
                (kept.iter().map(|&k| self.place(open.results[k]))).collect()
            }
        };
        let args: Vec<IrOperand> = match is_loop {
            true => indices.iter().map(|&k| self.place(args[k])).collect(),
            false => {
                let kept = self.kept(open.results);
                kept.iter().map(|&k| self.place(args[k])).collect()
            }
        };
        let turns = &mut ways.turns;
        let merged = (args.iter().zip(&results).enumerate())
            .map(|(k, (arg, result))| {
                let others = before.as_ref().map(|(_, results)| results[k]);
                if is_loop {
                    // The row may still be read.
                    let nowhere = IrOperand {
                        row: ValueRow::Forwarded,
                        ..*result
                    };
                    return match (others, ways.open.len()) {
                        (None, 1) => turns.only(arg),
                        _ => turns.merge(lanes, arg, others, &nowhere),
                    };
                }
                turns.merge(lanes, arg, others, result)
            })
            .collect();
        let joined = match before {
            Some((others, _)) => turns.join(others, lanes),
            None => lanes,
        };
        ways.open[depth].joined = Some((joined, merged));
        Some(())
    }
}
