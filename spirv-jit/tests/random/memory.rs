//! Accesses to variables and buffers.

use spirv_jit::environment::reference;
use spirv_jit::ir::op::{Access, DescriptorBinding};
use spirv_jit::ir::{Node, Op, Space, Type, Value, VariableId};

use super::Generator;
use crate::observe::{READABLE_WORDS, WRITABLE_WORDS};

impl Generator<'_> {
    /// A fixed row; of each variable, the even ones are read as integers of any width, the odd ones
    /// as floats or as parts of the former.
    pub fn variable_access(&mut self, nodes: &mut Vec<Node>) {
        let index = self.random.below(self.function.variables.len());
        let variable = VariableId(index as u32);
        let rows = self.function.variables[index].rows;
        let row = self.random.below(rows as usize) as u32;
        let mut types = match (index % 4, row % 2) {
            (0, _) => vec![Type::I32],
            (1, 0) if row + 1 < rows => vec![Type::I64, Type::I64, Type::I32],
            (1, _) => vec![Type::I32],
            (2, _) => vec![Type::F32],
            _ => vec![[Type::I1, Type::I16, Type::F16][row as usize % 3]],
        };
        let ty = types.swap_remove(self.random.below(types.len()));
        if self.random.one_in(2) {
            let value = self.pick(ty, nodes);
            self.emit(Op::VarStore(variable, row), &[value], &[], nodes);
        } else {
            let value = self.emit_one(Op::VarLoad(variable, row), &[], ty, nodes);
            self.visible.push(value);
        }
    }

    /// An access through an address: of a variable of words, at a fixed row or any.
    pub fn private_access(&mut self, nodes: &mut Vec<Node>) {
        let index = self.random.below(self.function.variables.len()) & !3;
        let rows = self.function.variables[index].rows;
        let address = self.emit_one(
            Op::VarAddress(VariableId(index as u32)),
            &[],
            Type::I32,
            nodes,
        );
        let count = self.constant(rows as u64, Type::I32, nodes);
        let row = if self.random.one_in(2) {
            let row = self.random.below(rows as usize) as u64;
            self.constant(row, Type::I32, nodes)
        } else {
            let any = self.pick(Type::I32, nodes);
            self.emit_one(Op::URem, &[any, count], Type::I32, nodes)
        };
        let address = self.emit_one(Op::IAdd, &[address, row], Type::I32, nodes);
        let access = Access::plain(Space::Private);
        if self.random.one_in(2) {
            let value = self.pick(Type::I32, nodes);
            self.emit(Op::Store(access), &[address, value], &[], nodes);
        } else {
            let value = self.emit_one(Op::Load(access), &[address], Type::I32, nodes);
            self.visible.push(value);
        }
    }

    /// A descriptor of a buffer: one that was used before, maybe before a yield, or a new one, the
    /// null descriptor in some lanes.
    fn descriptor(&mut self, which: usize, nodes: &mut Vec<Node>) -> Value {
        let known: Vec<Value> = (self.buffers.iter())
            .filter(|(value, of)| *of == which && self.visible.contains(value))
            .map(|&(value, _)| value)
            .collect();
        if !known.is_empty() && self.random.one_in(2) {
            return known[self.random.below(known.len())];
        }
        let descriptor = if which == 2 && self.random.one_in(2) {
            self.emit_one(Op::PushConstants, &[], Type::Descriptor, nodes)
        } else {
            let mut index = self.constant(0, Type::I32, nodes);
            if self.random.one_in(2) {
                let any = self.pick(Type::I32, nodes);
                let one = self.constant(1, Type::I32, nodes);
                index = self.emit_one(Op::And, &[any, one], Type::I32, nodes);
            }
            let binding = DescriptorBinding {
                set: 0,
                first: which as u32,
                count: 1,
                dynamic: false,
            };
            let (at, named) = (Op::DescriptorAt, Op::DescriptorReference(binding));
            match self.random.below(3) {
                // Any number may be a reference: to the push constants, what is only read, nothing
                // at all.
                0 if which == 2 => {
                    let numbers = [
                        reference::of(reference::PUSH_CONSTANTS, 0),
                        reference::of(reference::SETS, 0),
                        reference::of(reference::SETS, 2),
                        reference::of(reference::DYNAMIC, 0),
                        0,
                        u64::MAX,
                    ];
                    let [a, b] = [0; 2].map(|_| numbers[self.random.below(numbers.len())]);
                    let [a, b] = [a, b].map(|bits| self.constant(bits, Type::I64, nodes));
                    let which = self.pick(Type::I1, nodes);
                    let reference = self.emit_one(Op::Select, &[which, a, b], Type::I64, nodes);
                    self.emit_one(at, &[reference], Type::Descriptor, nodes)
                }
                1 => {
                    let reference = self.emit_one(named, &[index], Type::I64, nodes);
                    self.emit_one(at, &[reference], Type::Descriptor, nodes)
                }
                _ => self.emit_one(Op::Descriptor(binding), &[index], Type::Descriptor, nodes),
            }
        };
        self.buffers.push((descriptor, which));
        self.visible.push(descriptor);
        descriptor
    }

    pub fn buffer_access(&mut self, nodes: &mut Vec<Node>) {
        let access = Access {
            space: Space::Buffer,
            volatile: self.random.one_in(10),
            constant: false,
            alignment: 0,
            is_strided: false,
        };
        let which = self.random.below(3);
        let descriptor = self.descriptor(which, nodes);
        let words = if which == 1 {
            WRITABLE_WORDS
        } else {
            READABLE_WORDS
        };
        // An index often the same, otherwise the program's; in the buffer that is written, only
        // into the lane's own words.
        let index = if self.random.one_in(2) {
            self.constant(1, Type::I32, nodes)
        } else {
            self.pick(Type::I32, nodes)
        };
        // Few places to write, so that they are read again; the last of the others have neighbours
        // outside.
        let places = if which == 1 { 2 } else { words };
        let mask = self.constant(places as u64 - 1, Type::I32, nodes);
        let index = self.emit_one(Op::And, &[index, mask], Type::I32, nodes);
        let mut offset = {
            let scale = self.constant(4, Type::I32, nodes);
            self.emit_one(Op::IMul, &[index, scale], Type::I32, nodes)
        };
        if which == 1 {
            let lane = self.emit_one(Op::Input(0), &[], Type::I32, nodes);
            let stride = self.constant(WRITABLE_WORDS as u64 * 4, Type::I32, nodes);
            let own = self.emit_one(Op::IMul, &[lane, stride], Type::I32, nodes);
            offset = self.emit_one(Op::IAdd, &[own, offset], Type::I32, nodes);
        }
        if which == 1 && self.random.one_in(4) {
            return self.atomic(descriptor, offset, access, nodes);
        }
        if which == 1 && self.random.one_in(2) {
            let value = self.word(nodes);
            self.emit(Op::Store(access), &[descriptor, offset, value], &[], nodes);
            return;
        }
        // Neighbours, in any order, to be combined, if nothing is written between them; before the
        // beginning, to wrap.
        for _ in 0..1 + self.random.below(4) {
            let apart = self.random.below(5) as i32 - (which != 1) as i32;
            let distance = self.constant((4 * apart) as u32 as u64, Type::I32, nodes);
            let at = self.emit_one(Op::IAdd, &[offset, distance], Type::I32, nodes);
            if which == 1 && self.random.one_in(4) {
                let value = self.word(nodes);
                self.emit(Op::Store(access), &[descriptor, at, value], &[], nodes);
                continue;
            }
            self.load(access, &[descriptor, at], nodes);
        }
    }

    /// Neighbours at device addresses in the buffer that is only read, or nowhere. All of them are
    /// inside: what is partly outside may be read as zero or not.
    pub fn global_access(&mut self, nodes: &mut Vec<Node>) {
        let descriptor = self.descriptor(0, nodes);
        let base = self.emit_one(Op::DescriptorAddress, &[descriptor], Type::I64, nodes);
        let index = self.pick(Type::I32, nodes);
        let mask = self.constant(READABLE_WORDS as u64 / 2 - 1, Type::I32, nodes);
        let index = self.emit_one(Op::And, &[index, mask], Type::I32, nodes);
        let index = self.emit_one(Op::UConvert, &[index], Type::I64, nodes);
        let scale = self.constant(4, Type::I64, nodes);
        let offset = self.emit_one(Op::IMul, &[index, scale], Type::I64, nodes);
        let address = self.emit_one(Op::IAdd, &[base, offset], Type::I64, nodes);
        for _ in 0..2 + self.random.below(4) {
            let distance = 4 * self.random.below(6) as u64;
            let distance = self.constant(distance, Type::I64, nodes);
            let at = self.emit_one(Op::IAdd, &[address, distance], Type::I64, nodes);
            self.load(Access::plain(Space::Global), &[at], nodes);
        }
    }

    /// A load of one scalar or two, of some type.
    fn load(&mut self, access: Access, address: &[Value], nodes: &mut Vec<Node>) {
        const TYPES: [Type; 6] = [
            Type::I32,
            Type::I32,
            Type::F32,
            Type::F32,
            Type::I64,
            Type::I16,
        ];
        let ty = TYPES[self.random.below(TYPES.len())];
        let types = [ty; 2];
        let count = 1 + self.random.below(2);
        for value in self.emit(Op::Load(access), address, &types[..count], nodes) {
            let shown = match ty {
                Type::I16 => self.emit_one(Op::UConvert, &[value], Type::I32, nodes),
                _ => value,
            };
            self.show(shown);
        }
    }
}
