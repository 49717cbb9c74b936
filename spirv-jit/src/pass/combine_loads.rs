//! Combines loads of neighbouring memory: members of a record that are read by separate loads
//! are found and checked together.
//!
//! Only loads of one body are combined, with no writes, ordered accesses or constructs between
//! them. So the lanes and the memory are those of the first load, at which the combined load is
//! performed. It reads from the first byte to the last of the separate loads, in scalars of the
//! same widths, so that each scalar is inside or outside of its buffer, and wraps, as before.
//! Scalars of 64 bits at device addresses may be read as two words.

use foldhash::HashMap;
use smallvec::{SmallVec, smallvec};

use super::edit::{Edit, Fate, edit_body, edit_nodes};
use super::effects::Effects;
use crate::ir::op::Access;
use crate::ir::{Body, Function, Inst, Node, Op, Space, Type, Value};

/// Largest size of a combined load: the size that is loaded for several lanes together.
const MAX_BYTES: i64 = 16;

const WORD_BYTES: i64 = 4;

/// Combines loads. Returns whether it combined any.
pub fn combine_loads(function: &mut Function) -> bool {
    let mut body = std::mem::take(&mut function.body);
    let mut combiner = Combiner {
        known: vec![ValueFacts::default(); function.value_types.len()],
        instructions: 0,
        has_combined: false,
        function,
        stretch: Stretch::default(),
        here: Here::default(),
        outer: Vec::new(),
    };
    edit_body(&mut body, &mut combiner);
    let has_combined = combiner.has_combined;
    function.body = body;
    has_combined
}

/// A multiple of a value plus a constant, modulo the width; without a base only the constant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Linear {
    base: Option<Value>,
    factor: u64,
    constant: u64,
}

/// Facts about a value.
#[derive(Clone, Copy, Default)]
struct ValueFacts {
    /// The number of instructions before its definition; 0 for results and parameters of
    /// constructs.
    place: u32,
    /// The computation of an integer, if it is a multiple or a sum.
    linear: Option<Linear>,
}

/// The properties that loads must share to be combined.
#[derive(PartialEq, Eq, Hash)]
struct Family {
    space: Space,
    constant: bool,
    descriptor: Option<Value>,
    base: Option<Value>,
    factor: u64,
    /// The scalar type, which must be equal; `None` for words, which combine with all words.
    ty: Option<Type>,
}

/// A load that may be combined with others of its family.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Index of the node.
    node: usize,
    /// Bytes from the family's first load.
    distance: i64,
    bytes: i64,
    ty: Type,
    alignment: u8,
}

impl Candidate {
    fn end(&self) -> i64 {
        self.distance + self.bytes
    }
}

/// Loads to combine.
struct Group {
    /// In order of address.
    loads: Vec<Candidate>,
    /// Type of the combined load's scalars.
    ty: Type,
}

/// The loads of a family.
struct Loads {
    /// The constant of the first one's address.
    constant: u64,
    /// As in [`Family`].
    ty: Option<Type>,
    loads: Vec<Candidate>,
}

/// The loads of a stretch of instructions within which loads may move.
#[derive(Default)]
struct Stretch {
    indices: HashMap<Family, usize>,
    /// In order of their first loads.
    families: Vec<Loads>,
}

struct Combiner<'a> {
    function: &'a mut Function,
    known: Vec<ValueFacts>,
    /// The number of visited instructions.
    instructions: u32,
    has_combined: bool,
    stretch: Stretch,
    here: Here,
    /// The states of the enclosing bodies.
    outer: Vec<Here>,
}

/// The state of a body.
#[derive(Default)]
struct Here {
    /// Nodes so far.
    nodes: usize,
    groups: Vec<Group>,
}

impl Edit for Combiner<'_> {
    fn inst(&mut self, inst: &mut Inst, _: &mut Vec<Node>) -> bool {
        let index = self.here.nodes;
        self.here.nodes += 1;
        self.learn(inst);
        let effects = Effects::of(&inst.op);
        if effects.writes_outer || effects.yields {
            self.stretch.end(&mut self.here.groups);
        } else if let Op::Load(access) = inst.op {
            self.add_load(index, access, inst);
        }
        true
    }

    fn open(&mut self, _: &mut Node) {
        self.stretch.end(&mut self.here.groups);
        self.here.nodes += 1;
        self.outer.push(std::mem::take(&mut self.here));
    }

    fn end(&mut self, body: &mut Body) {
        let mut groups = std::mem::take(&mut self.here).groups;
        self.stretch.end(&mut groups);
        if !groups.is_empty() {
            self.has_combined = true;
            self.apply(body, &groups);
        }
    }

    fn close(&mut self, _: &mut Node, _: &mut Vec<Node>) -> Fate {
        self.here = self.outer.pop().unwrap_or_default();
        Fate::Stays
    }
}

impl Combiner<'_> {
    /// Records the computation of an instruction's results.
    fn learn(&mut self, inst: &Inst) {
        self.instructions += 1;
        for result in &inst.results {
            self.known[result.index()].place = self.instructions;
        }
        if matches!(
            inst.op,
            Op::Const(_) | Op::IAdd | Op::ISub | Op::IMul | Op::Shl
        ) {
            let result = inst.results[0];
            let ty = self.function.ty(result);
            if matches!(ty, Type::I32 | Type::I64) {
                self.known[result.index()].linear = self.linear_of(inst, ty);
            }
        }
    }

    fn linear(&self, value: Value) -> Linear {
        self.known[value.index()].linear.unwrap_or(Linear {
            base: Some(value),
            factor: 1,
            constant: 0,
        })
    }

    fn linear_of(&self, inst: &Inst, ty: Type) -> Option<Linear> {
        let mask = u64::MAX >> (64 - ty.bits());
        if let Op::Const(bits) = inst.op {
            return Some(Linear {
                base: None,
                factor: 0,
                constant: bits & mask,
            });
        }
        let [mut a, mut b] = [inst.args[0], inst.args[1]].map(|arg| self.linear(arg));
        if a.base.is_none() && matches!(inst.op, Op::IAdd | Op::IMul) {
            (a, b) = (b, a);
        }
        if b.base.is_some() {
            return None;
        }
        let (by, more) = match inst.op {
            Op::IAdd => (1, b.constant),
            Op::ISub => (1, b.constant.wrapping_neg()),
            Op::IMul => (b.constant, 0),
            // Counts are modulo the width.
            _ => (1 << (b.constant % ty.bits() as u64), 0),
        };
        Some(Linear {
            base: a.base,
            factor: a.factor.wrapping_mul(by) & mask,
            constant: a.constant.wrapping_mul(by).wrapping_add(more) & mask,
        })
    }

    fn add_load(&mut self, node: usize, access: Access, inst: &Inst) {
        let ty = self.function.ty(inst.results[0]);
        let bytes = inst.results.len() as i64 * ty.size_bytes() as i64;
        if access.space == Space::Private || access.is_strided || bytes > MAX_BYTES {
            return;
        }
        let address = inst.args[access.space.address_operands() - 1];
        let linear = self.linear(address);
        let alone = match ty.size_bytes() {
            4 => None,
            // If a buffer ends inside a scalar, the whole scalar reads as zero. Device addresses
            // have no such guarantee.
            8 if access.space == Space::Global => None,
            _ => Some(ty),
        };
        let family = Family {
            space: access.space,
            constant: access.constant,
            descriptor: access.space.is_buffer().then(|| inst.args[0]),
            base: linear.base,
            factor: linear.factor,
            ty: alone,
        };
        let stretch = &mut self.stretch;
        let next = stretch.families.len();
        let index = *stretch.indices.entry(family).or_insert(next);
        if index == next {
            stretch.families.push(Loads {
                constant: linear.constant,
                ty: alone,
                loads: Vec::new(),
            });
        }
        let family = &mut stretch.families[index];
        let apart = linear.constant.wrapping_sub(family.constant);
        let distance = match self.function.ty(address) {
            Type::I32 => apart as u32 as i32 as i64,
            _ => apart as i64,
        };
        // Larger distances cannot be near the first load, and distances must not overflow.
        if distance.unsigned_abs() > i32::MAX as u64 {
            return;
        }
        family.loads.push(Candidate {
            node,
            distance,
            bytes,
            ty,
            alignment: access.alignment,
        });
    }

    /// Inserts each combined load at its first load, and the conversions of results at each load.
    fn apply(&mut self, body: &mut Body, groups: &[Group]) {
        let mut replacements: HashMap<usize, Vec<Node>> = HashMap::default();
        for group in groups {
            self.replace(group, &body.nodes, &mut replacements);
        }
        let mut index = 0;
        edit_nodes(&mut body.nodes, |_, before| {
            let replacement = replacements.remove(&index);
            index += 1;
            let stays = replacement.is_none();
            before.extend(replacement.into_iter().flatten());
            stays
        });
    }

    fn replace(
        &mut self,
        group: &Group,
        nodes: &[Node],
        replacements: &mut HashMap<usize, Vec<Node>>,
    ) {
        let load = |node: usize| match &nodes[node] {
            Node::Inst(inst) => inst,
            _ => unreachable!("only loads are combined"),
        };
        let first = group.first().node;
        let mut inst = load(first).clone();
        let mut emitted = Vec::new();
        let address = self.lowest_address(group, load, &mut emitted);
        *inst.args.last_mut().expect("a load has an address") = address;
        if let Op::Load(access) = &mut inst.op {
            let alignments = group.loads.iter().map(|load| load.alignment);
            access.alignment = alignments.max().unwrap_or(0);
        }
        let scalars = self.scalars(group, load);
        inst.results = scalars.clone();
        let source = inst.source;
        emitted.push(Node::Inst(inst));
        for candidate in &group.loads {
            let parts = replacements.entry(candidate.node).or_default();
            if candidate.node == first {
                parts.append(&mut emitted);
            }
            for (k, &result) in load(candidate.node).results.iter().enumerate() {
                let at = group.index(candidate, k);
                let (op, args) = match candidate.ty.bits() > group.ty.bits() {
                    true => (Op::Pack64, smallvec![scalars[at], scalars[at + 1]]),
                    false if scalars[at] == result => continue,
                    false => (Op::Bitcast, smallvec![scalars[at]]),
                };
                parts.push(Node::Inst(Inst {
                    op,
                    args,
                    results: smallvec![result],
                    source,
                }));
            }
        }
    }

    /// The combined load's results: those of its loads, if the type is the same.
    fn scalars<'n>(
        &mut self,
        group: &Group,
        load: impl Fn(usize) -> &'n Inst,
    ) -> SmallVec<[Value; 2]> {
        let mut scalars = vec![None; group.count()];
        for candidate in group.loads.iter().filter(|load| load.ty == group.ty) {
            for (k, &result) in load(candidate.node).results.iter().enumerate() {
                scalars[group.index(candidate, k)].get_or_insert(result);
            }
        }
        (scalars.into_iter())
            .map(|scalar| scalar.unwrap_or_else(|| self.function.new_value(group.ty)))
            .collect()
    }

    /// The address of a group's lowest load, as a value that is visible at the first load.
    fn lowest_address<'n>(
        &mut self,
        group: &Group,
        load: impl Fn(usize) -> &'n Inst,
        emitted: &mut Vec<Node>,
    ) -> Value {
        let address = |inst: &Inst| *inst.args.last().expect("a load has an address");
        let (lowest, first) = (&group.loads[0], group.first());
        let first_load = load(first.node);
        let first_address = address(first_load);
        if first.distance == lowest.distance {
            return first_address;
        }
        let lowest_address = address(load(lowest.node));
        let place = |value: Value| self.known[value.index()].place;
        if place(lowest_address) < place(first_load.results[0]) {
            return lowest_address;
        }
        let ty = self.function.ty(first_address);
        let apart = (lowest.distance - first.distance) as u64 & (u64::MAX >> (64 - ty.bits()));
        let mut emit = |op, args| {
            let result = self.function.new_value(ty);
            emitted.push(Node::Inst(Inst {
                op,
                args,
                results: smallvec![result],
                source: first_load.source,
            }));
            result
        };
        let apart = emit(Op::Const(apart), smallvec![]);
        emit(Op::IAdd, smallvec![first_address, apart])
    }
}

impl Group {
    /// The first load in the body.
    fn first(&self) -> &Candidate {
        let first = self.loads.iter().min_by_key(|load| load.node);
        first.expect("a group has loads")
    }

    /// The index of the combined load's scalar with which a load's result begins.
    fn index(&self, load: &Candidate, result: usize) -> usize {
        let begin = load.distance - self.loads[0].distance;
        let at = begin + result as i64 * load.ty.size_bytes() as i64;
        (at / self.ty.size_bytes() as i64) as usize
    }

    /// Scalars of the combined load.
    fn count(&self) -> usize {
        let end = self.loads.iter().map(Candidate::end).max();
        let bytes = end.expect("a group has loads") - self.loads[0].distance;
        (bytes / self.ty.size_bytes() as i64) as usize
    }
}

impl Stretch {
    /// Selects the loads to combine, and starts a new stretch.
    fn end(&mut self, groups: &mut Vec<Group>) {
        if self.families.is_empty() {
            return;
        }
        self.indices.clear();
        for mut family in self.families.drain(..) {
            family.loads.sort_by_key(|load| (load.distance, load.node));
            let mut rest = &family.loads[..];
            while rest.len() > 1 {
                let group = longest_group(family.ty, rest);
                let taken = group.as_ref().map_or(1, |group| group.loads.len());
                groups.extend(group);
                rest = &rest[taken..];
            }
        }
    }
}

/// The first loads of a family, in order of address, that can be combined; `None` for a single one.
fn longest_group(alone: Option<Type>, loads: &[Candidate]) -> Option<Group> {
    let lowest = loads[0].distance;
    let (mut end, mut gap) = (lowest, 0);
    let mut longest = None;
    for (index, load) in loads.iter().enumerate() {
        let is_aligned = (load.distance - lowest).trailing_zeros() >= load.alignment as u32;
        gap += (load.distance - end).max(0);
        end = end.max(load.end());
        let bytes = end - lowest;
        if !is_aligned || bytes > MAX_BYTES || gap > WORD_BYTES {
            break;
        }
        let together = &loads[..=index];
        match scalar_type(alone, together) {
            Some(ty) if index > 0 && is_loaded_well(ty, bytes, gap) => {
                longest = Some((together, ty));
            }
            _ => {}
        }
    }
    longest.map(|(loads, ty)| Group {
        loads: loads.to_vec(),
        ty,
    })
}

/// The scalar type of a combined load: the most frequent one, so that few are converted.
fn scalar_type(alone: Option<Type>, loads: &[Candidate]) -> Option<Type> {
    let fits = |size: i64| {
        let distance = |load: &Candidate| load.distance - loads[0].distance;
        loads.iter().all(|load| distance(load) % size == 0)
    };
    let ty = loads[0].ty;
    if loads.iter().all(|load| load.ty == ty) && fits(ty.size_bytes() as i64) {
        return Some(ty);
    }
    if alone.is_some() || !fits(WORD_BYTES) {
        return None;
    }
    let bytes_of = |floats: bool| -> i64 {
        let loads = loads.iter().filter(|load| (load.ty == Type::F32) == floats);
        loads.map(|load| load.bytes).sum()
    };
    let has_pairs = loads.iter().any(|load| load.ty.bits() == 64);
    Some(match !has_pairs && bytes_of(true) > bytes_of(false) {
        true => Type::F32,
        false => Type::I32,
    })
}

/// Whether scalars of this size, some of them in a gap, are loaded for several lanes together.
fn is_loaded_well(ty: Type, bytes: i64, gap: i64) -> bool {
    match ty.size_bytes() as i64 {
        WORD_BYTES => gap == 0 || bytes == MAX_BYTES,
        8 => gap == 0,
        size => gap == 0 && matches!(bytes / size, 1 | 2 | 4),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::text::parse_module;

    /// The loads that become of some, from `v1` and from 4 and 8 bytes behind it, `v3` and `v5`:
    /// with the types of their results, and which instruction they name as their source.
    fn combined(lines: &str) -> Vec<(Access, Vec<Type>, u32)> {
        let text = format!(
            "module compute
            inputs local_invocation_id.0
            output_rows 0
            func f0 {{
                v0: i32 = input[0]
                v1: i64 = uconvert v0
                v2: i64 = const 4
                v3: i64 = iadd v1, v2
                v4: i64 = const 8
                v5: i64 = iadd v1, v4
                {lines}
                end
            }}"
        );
        let mut module = parse_module(&text).unwrap_or_else(|error| panic!("{error}"));
        let function = &mut module.functions[0];
        let mut source = 0;
        function.body.visit_insts_mut(&mut |inst| {
            source += 1;
            inst.source = source;
        });
        combine_loads(function);
        crate::ir::verify(&module).unwrap_or_else(|error| panic!("{error}"));
        let function = &module.functions[0];
        let mut loads = Vec::new();
        function.body.visit_insts(&mut |inst| {
            if let Op::Load(access) = inst.op {
                let types = inst.results.iter().map(|&result| function.ty(result));
                loads.push((access, types.collect(), inst.source));
            }
        });
        loads
    }

    #[test]
    fn the_first_load_is_the_one_to_blame() {
        let loads = combined(
            "v10: i32 = load.global v5
            v11: i32 = load.global v1
            v12: i32 = load.global v3",
        );
        let [(_, types, source)] = &loads[..] else {
            panic!("{loads:?}");
        };
        assert_eq!((&types[..], *source), (&[Type::I32; 3][..], 7));
    }

    #[test]
    fn alignment_is_that_of_all_or_keeps_loads_apart() {
        let alignments = |text: &str| -> Vec<u8> {
            let loads = combined(text);
            loads.iter().map(|(access, ..)| access.alignment).collect()
        };
        let strictest = alignments(
            "v10: i32 = load.global.align4 v1
            v11: i64 = load.global.align8 v5
            v12: i32 = load.global v3",
        );
        assert_eq!(strictest, [3]);
        let apart = alignments(
            "v10: i32 = load.global.align4 v1
            v11: i64 = load.global.align8 v3",
        );
        assert_eq!(apart, [2, 3]);
    }
}
