//! Workgroup memory of two halves: between two barriers one of them is written, each lane its own
//! words, and what the lanes of its subgroup wrote before is read from the other one.

use spirv_jit::ir::op::Access;
use spirv_jit::ir::{Node, Op, Space, Type};

use super::Generator;

/// Words of a lane in each half.
const WORDS: u32 = 2;
/// Bytes of a half, for two subgroups.
const HALF_BYTES: u32 = 32 * WORDS * 4;
/// Bytes of both halves.
pub const SIZE_BYTES: u32 = 2 * HALF_BYTES;

impl Generator<'_> {
    /// All lanes that are left wait for each other; the halves change places.
    pub fn barrier(&mut self, nodes: &mut Vec<Node>) {
        self.emit(Op::MemoryBarrier, &[], &[], nodes);
        self.emit(Op::Barrier, &[], &[], nodes);
        self.barriers += 1;
    }

    pub fn shared_access(&mut self, nodes: &mut Vec<Node>) {
        let access = Access::plain(Space::Shared);
        let own = self.emit_one(Op::Input(0), &[], Type::I32, nodes);
        let stores = self.random.one_in(2);
        let (lane, half) = if stores || self.random.one_in(3) {
            (own, self.barriers)
        } else {
            // Any lane of the same subgroup.
            let subgroup = self.constant(16, Type::I32, nodes);
            let subgroup = self.emit_one(Op::And, &[own, subgroup], Type::I32, nodes);
            let any = self.pick(Type::I32, nodes);
            let mask = self.constant(15, Type::I32, nodes);
            let any = self.emit_one(Op::And, &[any, mask], Type::I32, nodes);
            let lane = self.emit_one(Op::Or, &[any, subgroup], Type::I32, nodes);
            (lane, self.barriers + 1)
        };
        let word = self.random.below(WORDS as usize) as u32;
        let first = half % 2 * HALF_BYTES + word * 4;
        let stride = self.constant(u64::from(WORDS * 4), Type::I32, nodes);
        let address = self.emit_one(Op::IMul, &[lane, stride], Type::I32, nodes);
        let first = self.constant(first.into(), Type::I32, nodes);
        let address = self.emit_one(Op::IAdd, &[address, first], Type::I32, nodes);
        if stores {
            let value = self.word(nodes);
            self.emit(Op::Store(access), &[address, value], &[], nodes);
        } else {
            let value = self.emit_one(Op::Load(access), &[address], Type::I32, nodes);
            self.show(value);
        }
    }
}
