//! Loads of consecutive scalars made one: what a shader reads as `v[3 * i]`, `v[3 * i + 1]`, `v[3 * i + 2]`.

use foldhash::HashMap;

use smallvec::{SmallVec, smallvec};

use super::effects::Effects;
use crate::ir::op::Access;
use crate::ir::{Body, Function, Inst, Node, Op, Space, Type, Value};

/// Scalars of one load.
const MAX_SCALARS: usize = 16;

/// Terms of an address beyond which it is taken as it is.
const MAX_TERMS: usize = 4;

/// Merges loads of one body between which nothing is written.
pub fn merge_loads(function: &mut Function) {
    let mut body = std::mem::replace(
        &mut function.body,
        Body {
            nodes: Vec::new(),
            end: crate::ir::Terminator::Unreachable,
        },
    );
    let mut merger = Merger {
        sums: vec![None; function.value_types.len()],
        function,
    };
    merger.walk(&mut body);
    function.body = body;
}

/// An integer as a constant and terms times factors, modulo its width.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Sum {
    constant: u64,
    /// In order of values; no factor is zero.
    terms: SmallVec<[(Value, u64); 2]>,
}

impl Sum {
    fn of_value(value: Value) -> Sum {
        Sum {
            constant: 0,
            terms: smallvec![(value, 1)],
        }
    }

    fn plus(&self, other: &Sum) -> Option<Sum> {
        let mut sum = self.clone();
        sum.constant = sum.constant.wrapping_add(other.constant);
        for &(value, factor) in &other.terms {
            match sum.terms.binary_search_by_key(&value, |&(value, _)| value) {
                Ok(at) => sum.terms[at].1 = sum.terms[at].1.wrapping_add(factor),
                Err(at) => sum.terms.insert(at, (value, factor)),
            }
        }
        sum.terms.retain(|&mut (_, factor)| factor != 0);
        (sum.terms.len() <= MAX_TERMS).then_some(sum)
    }

    fn times(&self, factor: u64) -> Sum {
        let mut product = self.clone();
        product.constant = product.constant.wrapping_mul(factor);
        for term in &mut product.terms {
            term.1 = term.1.wrapping_mul(factor);
        }
        product.terms.retain(|&mut (_, factor)| factor != 0);
        product
    }

    /// Factors and constant reduced to the address's width.
    fn reduced(mut self, ty: Type) -> Sum {
        let mask = u64::MAX >> (64 - ty.bits());
        self.constant &= mask;
        for term in &mut self.terms {
            term.1 &= mask;
        }
        self.terms.retain(|&mut (_, factor)| factor != 0);
        self
    }
}

/// What loads must share to be merged.
#[derive(PartialEq, Eq, Hash)]
struct Family {
    access: Access,
    descriptor: Option<Value>,
    ty: Type,
    terms: SmallVec<[(Value, u64); 2]>,
}

/// A load that may be merged.
struct Candidate {
    /// Index of the node.
    node: usize,
    /// Constant part of the address, signed.
    constant: i64,
    scalars: usize,
}

struct Merger<'a> {
    function: &'a mut Function,
    /// Integers of address width as sums, where that says more than the value itself.
    sums: Vec<Option<Sum>>,
}

impl Merger<'_> {
    fn walk(&mut self, body: &mut Body) {
        let mut families: HashMap<Family, Vec<Candidate>> = HashMap::default();
        let mut merges = Vec::new();
        for (index, node) in body.nodes.iter_mut().enumerate() {
            match node {
                Node::Inst(inst) => {
                    self.learn(inst);
                    let effects = Effects::of(&inst.op);
                    if effects.writes_private || effects.writes_outer {
                        plan_merges(&mut families, &mut merges);
                    } else if let Op::Load(access) = inst.op {
                        let (family, constant) = self.family(access, inst);
                        families.entry(family).or_default().push(Candidate {
                            node: index,
                            constant,
                            scalars: inst.results.len(),
                        });
                    }
                }
                // Fewer lanes may come out of a construct than went in: a load after it must not be made before it.
                Node::Block { body, .. } | Node::Loop { body, .. } => {
                    plan_merges(&mut families, &mut merges);
                    self.walk(body);
                }
                Node::If {
                    then_body,
                    else_body,
                    ..
                } => {
                    plan_merges(&mut families, &mut merges);
                    self.walk(then_body);
                    self.walk(else_body);
                }
            }
        }
        plan_merges(&mut families, &mut merges);
        if !merges.is_empty() {
            self.apply(body, merges);
        }
    }

    fn sum(&self, value: Value) -> Sum {
        match self.sums.get(value.index()) {
            Some(Some(sum)) => sum.clone(),
            _ => Sum::of_value(value),
        }
    }

    fn learn(&mut self, inst: &Inst) {
        let Some(&result) = inst.results.first() else {
            return;
        };
        let ty = self.function.ty(result);
        if !matches!(ty, Type::I32 | Type::I64) {
            return;
        }
        let sum = match inst.op {
            Op::Const(bits) => Some(Sum {
                constant: bits,
                terms: smallvec![],
            }),
            Op::IAdd => self.sum(inst.args[0]).plus(&self.sum(inst.args[1])),
            Op::ISub => self
                .sum(inst.args[0])
                .plus(&self.sum(inst.args[1]).times(u64::MAX)),
            Op::IMul => self
                .constant(inst.args[1])
                .map(|factor| self.sum(inst.args[0]).times(factor)),
            Op::Shl => self
                .constant(inst.args[1])
                .filter(|&count| count < ty.bits() as u64)
                .map(|count| self.sum(inst.args[0]).times(1 << count)),
            _ => None,
        };
        self.sums[result.index()] = sum.map(|sum| sum.reduced(ty));
    }

    fn constant(&self, value: Value) -> Option<u64> {
        match &self.sums[value.index()] {
            Some(sum) if sum.terms.is_empty() => Some(sum.constant),
            _ => None,
        }
    }

    fn family(&self, access: Access, load: &Inst) -> (Family, i64) {
        let address = load.args[access.space.address_operands() - 1];
        let sum = self.sum(address);
        let family = Family {
            access,
            descriptor: (access.space == Space::Buffer).then(|| load.args[0]),
            ty: self.function.ty(load.results[0]),
            terms: sum.terms,
        };
        let constant = match self.function.ty(address) {
            Type::I32 => sum.constant as i32 as i64,
            _ => sum.constant as i64,
        };
        (family, constant)
    }

    /// Puts each merged load where the first of its loads was.
    fn apply(&mut self, body: &mut Body, merges: Vec<Merge>) {
        let mut emitted: HashMap<usize, Vec<Node>> = HashMap::default();
        let mut removed = vec![false; body.nodes.len()];
        for merge in merges {
            let first = merge.loads.iter().map(|load| load.node).min();
            let first = first.expect("a merge of nothing");
            let lowest = merge.loads[0].constant;
            let mut results: SmallVec<[Value; 2]> = smallvec![];
            for load in &merge.loads {
                let Node::Inst(inst) = &body.nodes[load.node] else {
                    continue;
                };
                results.extend(inst.results.iter().copied());
                removed[load.node] = true;
            }
            let Node::Inst(inst) = &body.nodes[first] else {
                continue;
            };
            let mut inst = inst.clone();
            let nodes = emitted.entry(first).or_default();
            let at_first = merge.loads.iter().find(|load| load.node == first);
            let skipped = at_first.map_or(0, |load| lowest.wrapping_sub(load.constant));
            if skipped != 0 {
                let address = inst.args.last_mut().expect("a load has an address");
                let ty = self.function.ty(*address);
                let mask = u64::MAX >> (64 - ty.bits());
                let distance = self.function.new_value(ty);
                let moved = self.function.new_value(ty);
                nodes.push(Node::Inst(Inst {
                    op: Op::Const(skipped as u64 & mask),
                    args: smallvec![],
                    results: smallvec![distance],
                    source: inst.source,
                }));
                nodes.push(Node::Inst(Inst {
                    op: Op::IAdd,
                    args: smallvec![*address, distance],
                    results: smallvec![moved],
                    source: inst.source,
                }));
                *address = moved;
            }
            inst.results = results;
            nodes.push(Node::Inst(inst));
        }
        let nodes = std::mem::take(&mut body.nodes);
        for (index, node) in nodes.into_iter().enumerate() {
            body.nodes
                .extend(emitted.remove(&index).into_iter().flatten());
            if !removed[index] {
                body.nodes.push(node);
            }
        }
    }
}

/// Loads to make one, in order of address.
struct Merge {
    loads: Vec<Candidate>,
}

/// Ends a stretch without writes: finds the runs of consecutive loads in it.
fn plan_merges(families: &mut HashMap<Family, Vec<Candidate>>, merges: &mut Vec<Merge>) {
    for (family, mut candidates) in families.drain() {
        if candidates.len() < 2 {
            continue;
        }
        let unit = match family.access.space {
            Space::Private => family.ty.rows(),
            _ => family.ty.size_bytes(),
        } as i64;
        candidates.sort_by_key(|candidate| candidate.constant);
        let mut run: Vec<Candidate> = Vec::new();
        let mut scalars = 0;
        for candidate in candidates {
            let end = run
                .last()
                .map(|last| last.constant.wrapping_add(last.scalars as i64 * unit));
            let fits = scalars + candidate.scalars <= MAX_SCALARS;
            if end != Some(candidate.constant) || !fits {
                finish_run(&mut run, merges);
                scalars = 0;
            }
            scalars += candidate.scalars;
            run.push(candidate);
        }
        finish_run(&mut run, merges);
    }
    // Families come out of the table in no order.
    merges.sort_by_key(|merge| merge.loads[0].node);
}

fn finish_run(run: &mut Vec<Candidate>, merges: &mut Vec<Merge>) {
    let loads = std::mem::take(run);
    if loads.len() > 1 {
        merges.push(Merge { loads });
    }
}
