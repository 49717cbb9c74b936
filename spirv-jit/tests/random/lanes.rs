//! Operations across lanes, and atomics.

use spirv_jit::ir::op::{Access, AtomicOp, ReduceOp, SubgroupOp};
use spirv_jit::ir::{Node, Op, Type, Value};

use super::Generator;

const INTEGERS: [Type; 4] = [Type::I8, Type::I16, Type::I32, Type::I64];
const FLOATS: [Type; 3] = [Type::F16, Type::F32, Type::F64];
const OF_INTEGERS: [ReduceOp; 9] = [
    ReduceOp::IAdd,
    ReduceOp::IMul,
    ReduceOp::SMin,
    ReduceOp::UMin,
    ReduceOp::SMax,
    ReduceOp::UMax,
    ReduceOp::And,
    ReduceOp::Or,
    ReduceOp::Xor,
];
const OF_FLOATS: [ReduceOp; 4] = [
    ReduceOp::FAdd,
    ReduceOp::FMul,
    ReduceOp::FMin,
    ReduceOp::FMax,
];
const ATOMICS: [AtomicOp; 13] = [
    AtomicOp::Load,
    AtomicOp::Store,
    AtomicOp::Exchange,
    AtomicOp::CompareExchange,
    AtomicOp::IAdd,
    AtomicOp::ISub,
    AtomicOp::SMin,
    AtomicOp::UMin,
    AtomicOp::SMax,
    AtomicOp::UMax,
    AtomicOp::And,
    AtomicOp::Or,
    AtomicOp::Xor,
];

impl Generator<'_> {
    /// A subgroup operation whose result follows from the active lanes alone: no shuffle, which may
    /// read others.
    pub fn subgroup_operation(&mut self, nodes: &mut Vec<Node>) {
        let float = self.random.one_in(2);
        let (ty, reduce) = match float {
            true => (
                FLOATS[self.random.below(FLOATS.len())],
                OF_FLOATS[self.random.below(OF_FLOATS.len())],
            ),
            false => (
                INTEGERS[self.random.below(INTEGERS.len())],
                OF_INTEGERS[self.random.below(OF_INTEGERS.len())],
            ),
        };
        let cluster = 1 << self.random.below(5);
        let (op, from, to) = match self.random.below(12) {
            0 => (SubgroupOp::Elect, vec![], Type::I1),
            1 => (SubgroupOp::All, vec![Type::I1], Type::I1),
            2 => (SubgroupOp::Any, vec![Type::I1], Type::I1),
            3 => (SubgroupOp::Ballot, vec![Type::I1], Type::I32),
            4 => (SubgroupOp::AllEqual, vec![ty], Type::I1),
            5 => (SubgroupOp::BroadcastFirst, vec![ty], ty),
            6 => {
                let op = SubgroupOp::Reduce {
                    op: reduce,
                    cluster,
                };
                (op, vec![ty], ty)
            }
            7 => (SubgroupOp::InclusiveScan(reduce), vec![ty], ty),
            8 => (SubgroupOp::ExclusiveScan(reduce), vec![ty], ty),
            9 => (SubgroupOp::Match, vec![ty], Type::I32),
            10 => {
                let op = SubgroupOp::PartitionedInclusiveScan(reduce);
                (op, vec![ty, Type::I32], ty)
            }
            _ => {
                let op = SubgroupOp::PartitionedReduce(reduce);
                (op, vec![ty, Type::I32], ty)
            }
        };
        let args: Vec<Value> = from.iter().map(|&ty| self.pick(ty, nodes)).collect();
        let value = self.emit_one(Op::Subgroup(op), &args, to, nodes);
        self.visible.push(value);
    }

    /// An atomic on a word of the lane's own.
    pub fn atomic(
        &mut self,
        descriptor: Value,
        offset: Value,
        access: Access,
        nodes: &mut Vec<Node>,
    ) {
        let op = ATOMICS[self.random.below(ATOMICS.len())];
        let count = match op {
            AtomicOp::Load => 0,
            AtomicOp::CompareExchange => 2,
            _ => 1,
        };
        let mut args = vec![descriptor, offset];
        for _ in 0..count {
            args.push(self.pick(Type::I32, nodes));
        }
        let access = Access {
            volatile: true,
            ..access
        };
        if op == AtomicOp::Store {
            self.emit(Op::Atomic(op, access), &args, &[], nodes);
        } else {
            let old = self.emit_one(Op::Atomic(op, access), &args, Type::I32, nodes);
            self.visible.push(old);
        }
    }
}
