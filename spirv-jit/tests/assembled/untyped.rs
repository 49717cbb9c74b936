//! Pointers without a pointee (`SPV_KHR_untyped_pointers`): what lies in memory is what each access
//! says.

use rspirv::spirv::{Capability, Decoration, Op, StorageClass};
use shaders::compute::{Memory, compile, dispatch};
use shaders::request;
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

const BUFFER: u32 = StorageClass::StorageBuffer as u32;
const WORKGROUP: u32 = StorageClass::Workgroup as u32;

/// A module with an untyped pointer type to storage buffers.
struct Untyped {
    a: Assembler,
    pointer: u32,
    /// A block of words, as long as its buffer.
    words: u32,
}

impl Untyped {
    fn new() -> Self {
        let mut a = Assembler::new();
        a.capability(Capability::UntypedPointersKHR);
        let pointer = a.global(Op::TypeUntypedPointerKHR, &[BUFFER]);
        let words = a.open_array(a.word, 4);
        let words = a.block(&[(words, 0)]);
        Self { a, pointer, words }
    }

    /// An untyped pointer to a word of a buffer.
    fn at(&mut self, buffer: u32, index: usize) -> u32 {
        let Self { a, pointer, words } = self;
        let chain = [*words, buffer, a.numbers[0], a.numbers[index]];
        a.make(*pointer, Op::UntypedAccessChainKHR, &chain)
    }

    fn load(&mut self, ty: u32, from: u32) -> u32 {
        self.a.make(ty, Op::Load, &[from])
    }
}

/// Runs a module over the words of its input; returns three words of its result.
fn run(words: &[u32], input: &[u32]) -> [u32; 3] {
    let mut memory = Memory {
        buffers: vec![(0, input.to_vec()), (16, vec![0; 3])],
        ..Memory::default()
    };
    dispatch(&compile(words), 1, &mut memory);
    memory.buffers[1].1[..].try_into().unwrap()
}

/// The error of a module that is refused.
fn refusal(words: &[u32]) -> String {
    match spirv_jit::compile(&request(Stage::Compute, words)) {
        Ok(_) => panic!("the module is taken"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn loads_and_stores_say_what_lies_there() {
    let mut u = Untyped::new();
    let float = u.a.global(Op::TypeFloat, &[32]);
    let pair = u.a.global(Op::TypeVector, &[float, 2]);
    let from = u.at(u.a.input, 1);
    let loaded = u.load(pair, from);
    let [x, y] = [0, 1].map(|k| u.a.make(float, Op::CompositeExtract, &[loaded, k]));
    let product = u.a.make(float, Op::FMul, &[x, y]);
    let to = u.at(u.a.result, 2);
    u.a.act(Op::Store, &[to, product]);
    let sum = u.a.make(float, Op::FAdd, &[x, y]);
    let bits = u.a.make(u.a.word, Op::Bitcast, &[sum]);
    let input = [0, 1.5f32.to_bits(), (-4.0f32).to_bits()];
    let expected = [(1.5f32 - 4.0).to_bits(), 0, (1.5f32 * -4.0).to_bits()];
    assert_eq!(run(&u.a.finish(bits), &input), expected);
}

/// A matrix lies as the member of the chain's type says.
#[test]
fn chains_lead_through_a_type_of_their_own() {
    let mut u = Untyped::new();
    let float = u.a.global(Op::TypeFloat, &[32]);
    let pair = u.a.global(Op::TypeVector, &[float, 2]);
    let matrix = u.a.global(Op::TypeMatrix, &[pair, 2]);
    let block = u.a.block(&[(u.a.word, 0), (matrix, 4)]);
    u.a.decorate_member(block, 1, Decoration::RowMajor, &[]);
    u.a.decorate_member(block, 1, Decoration::MatrixStride, &[12]);
    let one = u.a.numbers[1];
    let chain = [block, u.a.input, one];
    let at = (u.a).make(u.pointer, Op::UntypedInBoundsAccessChainKHR, &chain);
    let loaded = u.load(matrix, at);
    let corner = u.a.make(float, Op::CompositeExtract, &[loaded, 1, 1]);
    // The second column, which starts in the first row.
    let chain = [block, u.a.input, one, one];
    let column = u.a.make(u.pointer, Op::UntypedAccessChainKHR, &chain);
    let upper = u.load(float, column);
    let sum = u.a.make(float, Op::FAdd, &[corner, upper]);
    let bits = u.a.make(u.a.word, Op::Bitcast, &[sum]);
    // Behind a word, rows of two numbers, twelve bytes apart.
    let input = [9.0, 1.0, 2.0, 7.0, 3.0, 4.0].map(f32::to_bits);
    let expected = (4.0f32 + 2.0).to_bits();
    assert_eq!(run(&u.a.finish(bits), &input)[0], expected);
}

#[test]
fn elements_are_as_far_apart_as_the_pointers_type_says() {
    let mut u = Untyped::new();
    let strided = u.a.global(Op::TypeUntypedPointerKHR, &[BUFFER]);
    u.a.decorate(strided, Decoration::ArrayStride, &[8]);
    let chain = [u.words, u.a.input, u.a.numbers[0], u.a.numbers[1]];
    let base = u.a.make(strided, Op::UntypedAccessChainKHR, &chain);
    let chain = [u.a.word, base, u.a.numbers[2]];
    let at = u.a.make(u.pointer, Op::UntypedPtrAccessChainKHR, &chain);
    let loaded = u.load(u.a.word, at);
    // Two elements of eight bytes behind the word 1.
    let input = [10, 11, 12, 13, 14, 15, 16];
    assert_eq!(run(&u.a.finish(loaded), &input)[0], 15);
}

#[test]
fn lengths_count_elements_of_the_given_block() {
    let mut u = Untyped::new();
    let pair = u.a.global(Op::TypeVector, &[u.a.word, 2]);
    let pairs = u.a.open_array(pair, 8);
    let block = u.a.block(&[(u.a.word, 0), (pairs, 4)]);
    let length = [block, u.a.input, 1];
    let length = u.a.make(u.a.word, Op::UntypedArrayLengthKHR, &length);
    // Twenty-eight bytes, of which the first four are no element.
    assert_eq!(run(&u.a.finish(length), &[0; 7])[0], 3);
}

#[test]
fn copies_take_the_type_that_one_side_has_or_bytes() {
    let mut u = Untyped::new();
    let typed = u.a.pointer(StorageClass::StorageBuffer, u.a.word);
    let chain = [u.a.result, u.a.numbers[0], u.a.numbers[1]];
    let to = u.a.make(typed, Op::AccessChain, &chain);
    let from = u.at(u.a.input, 2);
    u.a.act(Op::CopyMemory, &[to, from]);
    // Of seven bytes the last three go to the last word.
    let (to, from) = (u.at(u.a.result, 1), u.at(u.a.input, 0));
    u.a.act(Op::CopyMemorySized, &[to, from, u.a.numbers[7]]);
    let (to, from) = (u.at(u.a.result, 2), u.at(u.a.input, 2));
    u.a.act(Op::CopyMemorySized, &[to, from, u.a.numbers[2]]);
    let input = [0x0403_0201, 0x0807_0605, 0x0C0B_0A09];
    let five = u.a.numbers[5];
    let words = u.a.finish(five);
    assert_eq!(run(&words, &input), [5, 0x0403_0201, 0x0007_0A09]);
}

#[test]
fn atomics_take_the_type_of_their_result() {
    let mut u = Untyped::new();
    let signed = u.a.global(Op::TypeInt, &[32, 1]);
    let at = u.at(u.a.result, 1);
    let (device, relaxed) = (u.a.numbers[1], u.a.numbers[0]);
    let minus_three = u.a.value(signed, Op::Constant, &[-3i32 as u32]);
    let nine = u.a.numbers[9];
    u.a.act(Op::AtomicStore, &[at, device, relaxed, nine]);
    let least = [at, device, relaxed, minus_three];
    let before = u.a.make(signed, Op::AtomicSMin, &least);
    let before = u.a.make(u.a.word, Op::Bitcast, &[before]);
    assert_eq!(run(&u.a.finish(before), &[0]), [9, -3i32 as u32, 0]);
}

#[test]
fn pointers_are_chosen() {
    for (given, expected) in [(1, 21), (0, 22)] {
        let mut u = Untyped::new();
        (u.a).capability(Capability::VariablePointersStorageBuffer);
        u.a.read();
        let [first, second] = [1, 2].map(|index| u.at(u.a.input, index));
        let condition = [u.a.given, u.a.numbers[0]];
        let condition = u.a.make(u.a.bool, Op::INotEqual, &condition);
        let chosen = [condition, first, second];
        let chosen = u.a.make(u.pointer, Op::Select, &chosen);
        let loaded = u.load(u.a.word, chosen);
        assert_eq!(run(&u.a.finish(loaded), &[given, 21, 22])[0], expected);
    }
}

/// Blocks of workgroup memory lie in one place if they are `Aliased`, and only then.
#[test]
fn workgroup_memory_is_shared_by_aliased_blocks() {
    for (is_aliased, expected) in [(true, 7), (false, 5)] {
        let mut u = Untyped::new();
        (u.a).capability(Capability::WorkgroupMemoryExplicitLayoutKHR);
        let pointer = u.a.global(Op::TypeUntypedPointerKHR, &[WORKGROUP]);
        let data = u.a.block(&[(u.a.word, 0)]);
        let variables = [(); 2].map(|()| {
            let held = [WORKGROUP, data];
            u.a.value(pointer, Op::UntypedVariableKHR, &held)
        });
        for (variable, number) in variables.into_iter().zip([5, 7]) {
            u.a.interface.push(variable);
            if is_aliased {
                u.a.decorate(variable, Decoration::Aliased, &[]);
            }
            u.a.act(Op::Store, &[variable, u.a.numbers[number]]);
        }
        let loaded = u.load(u.a.word, variables[0]);
        assert_eq!(run(&u.a.finish(loaded), &[0])[0], expected);
    }
}

#[test]
fn data_needs_a_type_and_a_layout() {
    let mut u = Untyped::new();
    let class = StorageClass::Private as u32;
    u.a.global(Op::TypeUntypedPointerKHR, &[class]);
    let zero = u.a.numbers[0];
    let message = refusal(&u.a.finish(zero));
    assert!(message.contains("Private is not supported"), "{message}");

    let mut u = Untyped::new();
    u.a.value(u.pointer, Op::UntypedVariableKHR, &[BUFFER]);
    let message = refusal(&u.a.finish(zero));
    assert!(message.contains("without a data type"), "{message}");

    let mut u = Untyped::new();
    let (to, from) = (u.at(u.a.result, 1), u.at(u.a.input, 0));
    u.a.act(Op::CopyMemory, &[to, from]);
    let message = refusal(&u.a.finish(zero));
    assert!(message.contains("is not a type"), "{message}");

    let mut u = Untyped::new();
    u.a.read();
    let (to, from) = (u.at(u.a.result, 1), u.at(u.a.input, 0));
    u.a.act(Op::CopyMemorySized, &[to, from, u.a.given]);
    let message = refusal(&u.a.finish(zero));
    assert!(message.contains("whose size is no constant"), "{message}");
}
