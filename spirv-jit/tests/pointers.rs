//! `OpPtrAccessChain` and `OpPtrDiff`, and the strides that both use.

use rspirv::binary::Assemble;
use rspirv::dr::{Builder, Operand};
use rspirv::spirv::{
    AddressingModel, Capability, Decoration, ExecutionMode, ExecutionModel, FunctionControl,
    MemoryAccess, MemoryModel, StorageClass, Word,
};
use shaders::compute::{Memory, compile, dispatch};

/// A compute shader of one invocation. Binding 0 is a buffer of words.
struct Shader {
    b: Builder,
    word: Word,
    signed: Word,
    class: StorageClass,
    /// Pointer to a word, in steps of four bytes.
    place: Word,
    /// The buffer at binding 0, as a pointer to its block.
    buffer: Word,
    interface: Vec<Word>,
}

impl Shader {
    /// `class`: that of pointers to the words.
    fn new(class: StorageClass, addressing: AddressingModel) -> Shader {
        let mut b = Builder::new();
        b.set_version(1, 4);
        for capability in [
            Capability::Shader,
            Capability::Int64,
            Capability::Int16,
            Capability::VariablePointersStorageBuffer,
            Capability::VariablePointers,
            Capability::PhysicalStorageBufferAddresses,
        ] {
            b.capability(capability);
        }
        b.memory_model(addressing, MemoryModel::GLSL450);
        let (word, signed) = (b.type_int(32, 0), b.type_int(32, 1));
        let mut shader = Shader {
            b,
            word,
            signed,
            class,
            place: 0,
            buffer: 0,
            interface: Vec::new(),
        };
        shader.place = shader.pointer(class, word, Some(4));
        shader
    }

    fn stride(&mut self, ty: Word, bytes: u32) {
        let bytes = [Operand::LiteralBit32(bytes)];
        self.b.decorate(ty, Decoration::ArrayStride, bytes);
    }

    /// A pointer type of its own, with a stride.
    fn pointer(&mut self, class: StorageClass, to: Word, stride: Option<u32>) -> Word {
        let id = self.b.id();
        self.b.type_pointer(Some(id), class, to);
        if let Some(bytes) = stride {
            self.stride(id, bytes);
        }
        id
    }

    /// The type of a block of one array as long as its buffer.
    fn block(&mut self, element: Word, stride: u32) -> Word {
        let id = self.b.id();
        let array = self.b.type_runtime_array_id(Some(id), element);
        self.stride(array, stride);
        let block = self.b.type_struct([array]);
        self.b.decorate(block, Decoration::Block, []);
        let offset = [Operand::LiteralBit32(0)];
        self.b.member_decorate(block, 0, Decoration::Offset, offset);
        block
    }

    /// A storage buffer of such a block.
    fn buffer(&mut self, binding: u32, element: Word, stride: u32) -> Word {
        let block = self.block(element, stride);
        let pointer = self.pointer(StorageClass::StorageBuffer, block, None);
        let buffer = (self.b).variable(pointer, None, StorageClass::StorageBuffer, None);
        for (decoration, number) in [
            (Decoration::DescriptorSet, 0),
            (Decoration::Binding, binding),
        ] {
            let number = [Operand::LiteralBit32(number)];
            self.b.decorate(buffer, decoration, number);
        }
        self.interface.push(buffer);
        buffer
    }

    fn number(&mut self, number: u32) -> Word {
        self.b.constant_bit32(self.word, number)
    }

    fn begin(&mut self) -> Word {
        let void = self.b.type_void();
        let signature = self.b.type_function(void, []);
        let begun = (self.b).begin_function(void, None, FunctionControl::NONE, signature);
        self.b.begin_block(None).unwrap();
        begun.unwrap()
    }

    fn end(mut self, main: Word) -> Vec<u32> {
        self.b.ret().unwrap();
        self.b.end_function().unwrap();
        let model = ExecutionModel::GLCompute;
        self.b.entry_point(model, main, "main", self.interface);
        (self.b).execution_mode(main, ExecutionMode::LocalSize, [1, 1, 1]);
        self.b.module().assemble()
    }

    /// The word at an index of the buffer.
    fn at(&mut self, index: u32) -> Word {
        let (zero, index) = (self.number(0), self.number(index));
        let chain = [zero, index];
        (self.b)
            .access_chain(self.place, None, self.buffer, chain)
            .unwrap()
    }

    /// The form of accesses to the words.
    fn access(&self) -> (Option<MemoryAccess>, Vec<Operand>) {
        match self.class {
            StorageClass::PhysicalStorageBuffer => {
                (Some(MemoryAccess::ALIGNED), vec![Operand::LiteralBit32(4)])
            }
            _ => (None, Vec::new()),
        }
    }

    fn load(&mut self, place: Word) -> Word {
        let (access, operands) = self.access();
        self.b
            .load(self.word, None, place, access, operands)
            .unwrap()
    }

    fn store(&mut self, place: Word, value: Word) {
        let (access, operands) = self.access();
        self.b.store(place, value, access, operands).unwrap();
    }
}

/// The words that binding 0 holds after a run.
fn run(words: &[u32], buffer: Vec<u32>, push_constants: Vec<u32>) -> Vec<u32> {
    let mut memory = Memory {
        buffers: vec![(0, buffer), (16, vec![0; 64])],
        push_constants,
        ..Memory::default()
    };
    dispatch(&compile(words), 1, &mut memory);
    memory.buffers.swap_remove(0).1
}

/// Steps from word 8, which holds −3, by integers of each type, and stores the loaded words at the
/// start of the buffer.
fn step_back(mut shader: Shader, start: impl FnOnce(&mut Shader)) -> Vec<u32> {
    let short = shader.b.type_int(16, 0);
    let minus_one = shader.number(u32::MAX);
    let minus_two = shader.b.constant_bit32(shader.signed, -2i32 as u32);
    let main = shader.begin();
    start(&mut shader);
    let from = shader.at(8);
    let step = shader.load(from);
    let signed = shader.b.bitcast(shader.signed, None, step).unwrap();
    let short = shader.b.u_convert(short, None, step).unwrap();
    let other = shader.b.type_int(64, 1);
    let wide = shader.b.s_convert(other, None, signed).unwrap();
    let steps = [step, signed, short, wide, minus_one, minus_two];
    let loaded: Vec<Word> = steps
        .into_iter()
        .map(|step| {
            let (b, place) = (&mut shader.b, shader.place);
            let place = b.ptr_access_chain(place, None, from, step, []).unwrap();
            shader.load(place)
        })
        .collect();
    // Out of the buffer, and back.
    let far = shader.number(0u32.wrapping_sub(50));
    let back = shader.number(45);
    let mut place = from;
    for step in [far, back] {
        place = (shader
            .b
            .ptr_access_chain(shader.place, None, place, step, []))
        .unwrap();
    }
    let beyond = shader.load(place);
    for (at, value) in (0..).zip(loaded.into_iter().chain([beyond])) {
        let to = shader.at(at);
        shader.store(to, value);
    }
    shader.end(main)
}

/// Words that name their index, except word 8, which is the step.
fn ramp() -> Vec<u32> {
    let mut words: Vec<u32> = (0..16).map(|k| 0x100 + k).collect();
    words[8] = -3i32 as u32;
    words
}

const STEPPED: [u32; 7] = [0x105, 0x105, 0x105, 0x105, 0x107, 0x106, 0x103];

#[test]
fn steps_in_a_buffer_are_signed() {
    let mut shader = Shader::new(StorageClass::StorageBuffer, AddressingModel::Logical);
    shader.buffer = shader.buffer(0, shader.word, 4);
    let words = step_back(shader, |_| {});
    assert_eq!(run(&words, ramp(), Vec::new())[..7], STEPPED);
}

#[test]
fn steps_of_addresses_are_signed() {
    let mut shader = Shader::new(
        StorageClass::PhysicalStorageBuffer,
        AddressingModel::PhysicalStorageBuffer64,
    );
    let block = shader.block(shader.word, 4);
    let address = shader.pointer(StorageClass::PhysicalStorageBuffer, block, None);
    let pushed = shader.b.type_struct([address]);
    shader.b.decorate(pushed, Decoration::Block, []);
    let offset = [Operand::LiteralBit32(0)];
    (shader.b).member_decorate(pushed, 0, Decoration::Offset, offset);
    let to_pushed = shader.pointer(StorageClass::PushConstant, pushed, None);
    let to_address = shader.pointer(StorageClass::PushConstant, address, None);
    let pushed = (shader.b).variable(to_pushed, None, StorageClass::PushConstant, None);
    shader.interface.push(pushed);
    let zero = shader.number(0);
    let words = step_back(shader, |shader| {
        let place = shader.b.access_chain(to_address, None, pushed, [zero]);
        let loaded = shader.b.load(address, None, place.unwrap(), None, []);
        shader.buffer = loaded.unwrap();
    });
    let mut buffer = ramp();
    let address = buffer.as_mut_ptr() as u64;
    let found = run(&words, buffer, vec![address as u32, (address >> 32) as u32]);
    assert_eq!(found[..7], STEPPED);
}

/// Differences of pointers with strides that exceed the element's size.
#[test]
fn differences_count_elements() {
    let mut shader = Shader::new(StorageClass::StorageBuffer, AddressingModel::Logical);
    shader.buffer = shader.buffer(0, shader.word, 4);
    let float = shader.b.type_float(32, None);
    let vector = shader.b.type_vector(float, 3);
    let kinds = [
        (vector, 16),
        (shader.word, 24),
        (vector, 12),
        (shader.word, 4),
    ];
    let kinds: Vec<_> = (1..)
        .zip(kinds)
        .map(|(binding, (ty, stride))| {
            let buffer = shader.buffer(binding, ty, stride);
            let class = StorageClass::StorageBuffer;
            (buffer, shader.pointer(class, ty, Some(stride)))
        })
        .collect();
    let [zero, one] = [0, 1].map(|n| shader.number(n));
    let long = shader.b.type_int(64, 1);
    let main = shader.begin();
    let first = shader.at(0);
    let index = shader.load(first);
    let mut results = Vec::new();
    for (buffer, pointer) in kinds {
        let mut place = |index| (shader.b).access_chain(pointer, None, buffer, [zero, index]);
        let (a, b) = (place(index).unwrap(), place(one).unwrap());
        results.push(shader.b.ptr_diff(shader.signed, None, a, b).unwrap());
        results.push(shader.b.ptr_diff(shader.signed, None, b, a).unwrap());
        let wide = shader.b.ptr_diff(long, None, b, a).unwrap();
        results.push(shader.b.s_convert(shader.signed, None, wide).unwrap());
    }
    for (at, value) in (0..).zip(results) {
        let to = shader.at(at);
        let value = shader.b.bitcast(shader.word, None, value).unwrap();
        shader.store(to, value);
    }
    let words = shader.end(main);
    // The second index is more than 2³¹ bytes from element 1 with strides of 16 and 24.
    for index in [7u32, 0x0900_0001] {
        let mut buffer = vec![0; 12];
        buffer[0] = index;
        let apart = index - 1;
        let expected = [apart, apart.wrapping_neg(), apart.wrapping_neg()].repeat(4);
        assert_eq!(run(&words, buffer, Vec::new()), expected);
    }
}

/// Indices of 64 bits are not cut to 32, constant and computed ones.
#[test]
fn wide_indices_are_whole() {
    let mut shader = Shader::new(StorageClass::StorageBuffer, AddressingModel::Logical);
    shader.buffer = shader.buffer(0, shader.word, 4);
    let long = shader.b.type_int(64, 0);
    let far = shader.b.constant_bit64(long, 1 << 32 | 3);
    let near = shader.b.constant_bit64(long, 2);
    let high = shader.b.constant_bit64(long, 1 << 32);
    let zero = shader.number(0);
    let main = shader.begin();
    let first = shader.at(1);
    let one = shader.load(first);
    let one = shader.b.u_convert(long, None, one).unwrap();
    let computed = shader.b.i_add(long, None, high, one).unwrap();
    let next = shader.b.i_add(long, None, near, one).unwrap();
    let mut results = Vec::new();
    for index in [far, near, computed, next] {
        let chain = [zero, index];
        let place = (shader
            .b
            .access_chain(shader.place, None, shader.buffer, chain))
        .unwrap();
        results.push(shader.load(place));
        if index == far || index == computed {
            shader.store(place, zero);
        }
    }
    for (at, value) in (4..).zip(results) {
        let to = shader.at(at);
        shader.store(to, value);
    }
    let found = run(&shader.end(main), vec![9, 1, 7, 8, 5, 5, 5, 5], Vec::new());
    assert_eq!(found, [9, 1, 7, 8, 0, 7, 0, 8]);
}

/// Moves a pointer inside an array of workgroup memory, whose elements hold their index. `array`
/// and `pointer`: their `ArrayStride`. `is_block`: the module lays out workgroup memory.
fn moved_in_workgroup(array: Option<u32>, pointer: Option<u32>, is_block: bool) -> Vec<u32> {
    let mut shader = Shader::new(StorageClass::StorageBuffer, AddressingModel::Logical);
    shader
        .b
        .capability(Capability::WorkgroupMemoryExplicitLayoutKHR);
    shader.buffer = shader.buffer(0, shader.word, 4);
    let vector = shader.b.type_vector(shader.word, 3);
    let eight = shader.number(8);
    let list = shader.b.type_array(vector, eight);
    if let Some(bytes) = array {
        shader.stride(list, bytes);
    }
    let class = StorageClass::Workgroup;
    let (to_element, to_word) = (
        shader.pointer(class, vector, pointer),
        shader.pointer(class, shader.word, None),
    );
    let whole = shader.b.type_struct([list]);
    if is_block {
        shader.b.decorate(whole, Decoration::Block, []);
        let offset = [Operand::LiteralBit32(0)];
        (shader.b).member_decorate(whole, 0, Decoration::Offset, offset);
    }
    let to_whole = shader.pointer(class, whole, None);
    let variable = shader.b.variable(to_whole, None, class, None);
    shader.interface.push(variable);
    let numbers: Vec<Word> = (0..8).map(|n| shader.number(n)).collect();
    let minus_one = shader.number(u32::MAX);
    let main = shader.begin();
    for &n in &numbers {
        for &component in &numbers[..3] {
            let chain = [numbers[0], n, component];
            let place = shader.b.access_chain(to_word, None, variable, chain);
            shader.b.store(place.unwrap(), n, None, []).unwrap();
        }
    }
    let chain = [numbers[0], numbers[4]];
    let from = (shader.b.access_chain(to_element, None, variable, chain)).unwrap();
    let mut results = Vec::new();
    let mut moved = Vec::new();
    for step in [numbers[1], numbers[3], minus_one] {
        let place = (shader.b.ptr_access_chain(to_element, None, from, step, [])).unwrap();
        let element = shader.b.load(vector, None, place, None, []).unwrap();
        for component in 0..3 {
            results.push(
                (shader
                    .b
                    .composite_extract(shader.word, None, element, [component]))
                .unwrap(),
            );
        }
        moved.push(place);
    }
    results.push(
        shader
            .b
            .ptr_diff(shader.word, None, moved[1], moved[2])
            .unwrap(),
    );
    for (at, value) in (0..).zip(results) {
        let to = shader.at(at);
        shader.store(to, value);
    }
    run(&shader.end(main), vec![9; 10], Vec::new())
}

/// Arrays and pointers both use their strides where the module lays out workgroup memory, and both
/// ignore them elsewhere.
#[test]
fn strides_in_workgroup_memory_are_of_arrays_and_pointers_alike() {
    let cases = [
        (None, None, false),
        (Some(16), Some(16), false),
        // Decorations of types that buffers share.
        (Some(32), None, false),
        (None, Some(32), false),
        (Some(16), Some(16), true),
        (Some(20), Some(20), true),
    ];
    for (array, pointer, is_block) in cases {
        let found = moved_in_workgroup(array, pointer, is_block);
        let expected = [5, 5, 5, 7, 7, 7, 3, 3, 3, 4];
        assert_eq!(found, expected, "{array:?} {pointer:?} {is_block}");
    }
}
