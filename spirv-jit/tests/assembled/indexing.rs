//! 64-bit indexing (`SPV_EXT_shader_64bit_indexing`): indices and lengths past 4 GiB.

use effort::sparse::Sparse;
use rspirv::spirv::{Capability, ExecutionMode, Op, StorageClass};
use shaders::compute::{Memory, compile, dispatch_over};
use shaders::request;
use spirv_jit::Program;
use spirv_jit::environment::Descriptor;
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

/// Words of the buffer that shaders read.
const WORDS: u64 = (9 << 30) / 4;

/// A module with 64-bit indexing, integers of 64 bits, and pointers to words in storage buffers.
struct Wide {
    a: Assembler,
    long: u32,
    pointer: u32,
}

impl Wide {
    fn new() -> Self {
        let mut a = Assembler::new();
        a.capability(Capability::Int64);
        a.capability(Capability::Shader64BitIndexingEXT);
        a.modes.push((ExecutionMode::Shader64BitIndexingEXT, &[]));
        let long = a.global(Op::TypeInt, &[64, 0]);
        let pointer = a.pointer(StorageClass::StorageBuffer, a.word);
        Self { a, long, pointer }
    }

    fn number(&mut self, number: u64) -> u32 {
        let words = [number as u32, (number >> 32) as u32];
        self.a.value(self.long, Op::Constant, &words)
    }

    /// The word that the input's second and third words count, a 64-bit index.
    fn given_index(&mut self) -> u32 {
        let zero = self.a.numbers[0];
        let [low, high] = [1, 2].map(|k| {
            let chain = [self.a.input, zero, self.a.numbers[k]];
            let at = self.a.make(self.pointer, Op::AccessChain, &chain);
            let word = self.a.make(self.a.word, Op::Load, &[at]);
            self.a.make(self.long, Op::UConvert, &[word])
        });
        let bits = self.number(32);
        let high = (self.a).make(self.long, Op::ShiftLeftLogical, &[high, bits]);
        self.a.make(self.long, Op::BitwiseOr, &[low, high])
    }

    fn at(&mut self, index: u32) -> u32 {
        let chain = [self.a.input, self.a.numbers[0], index];
        self.a.make(self.pointer, Op::AccessChain, &chain)
    }
}

/// Runs a module over a large buffer, of which the caller says some words by their index; returns
/// the words of the result.
fn run(program: &Program, memory: &Sparse, size_bytes: u64) -> [u32; 2] {
    let mut result = Memory {
        buffers: vec![(16, vec![0; 2])],
        ..Memory::default()
    };
    let large = Descriptor {
        address: memory.as_mut_ptr() as u64,
        size_bytes,
        ..Descriptor::NULL
    };
    dispatch_over(program, 1, &mut result, &[(0, large)]);
    result.buffers[0].1[..].try_into().unwrap()
}

/// A buffer whose words 1 and 2 are an index, and where each word at such an index is known.
fn filled(indices: &[u64]) -> Sparse {
    let memory = Sparse::new(4 * WORDS);
    for &index in indices {
        if index < WORDS {
            memory.write(4 * index, &value(index).to_ne_bytes());
        }
    }
    memory
}

fn value(index: u64) -> u32 {
    (index as u32).wrapping_mul(0x9e37_79b9) ^ 0x5555_0001
}

fn choose(memory: &Sparse, index: u64) {
    memory.write(4, &index.to_ne_bytes());
}

/// Indices inside and outside; products with four may wrap.
const INDICES: [u64; 10] = [
    3,
    (1 << 29) - 1,
    1 << 30,
    (1 << 30) + 3,
    WORDS - 1,
    WORDS,
    1 << 32,
    1 << 62,
    (1 << 62) + (1 << 30),
    u64::MAX,
];

#[test]
fn indices_have_64_bits() {
    let mut w = Wide::new();
    let index = w.given_index();
    let at = w.at(index);
    let loaded = w.a.make(w.a.word, Op::Load, &[at]);
    let nine = w.a.numbers[9];
    let (device, relaxed) = (w.a.numbers[1], w.a.numbers[0]);
    w.a.act(Op::AtomicStore, &[at, device, relaxed, nine]);
    let program = compile(&w.a.finish(loaded));
    let memory = filled(&INDICES);
    for index in INDICES {
        choose(&memory, index);
        let [loaded, _] = run(&program, &memory, 4 * WORDS);
        let is_inside = index < WORDS;
        assert_eq!(
            loaded,
            if is_inside { value(index) } else { 0 },
            "{index:#x}"
        );
        if is_inside {
            assert_eq!(memory.word(4 * index), 9, "{index:#x}");
        }
    }
    // The first words are what the test wrote.
    assert_eq!(memory.word(0), 0);
}

#[test]
fn constant_indices_have_64_bits() {
    for index in INDICES {
        let mut w = Wide::new();
        let constant = w.number(index);
        let at = w.at(constant);
        let loaded = w.a.make(w.a.word, Op::Load, &[at]);
        let program = compile(&w.a.finish(loaded));
        let memory = filled(&INDICES);
        let wanted = if index < WORDS { value(index) } else { 0 };
        assert_eq!(run(&program, &memory, 4 * WORDS)[0], wanted, "{index:#x}");
    }
}

/// `OpArrayLength` of 64 and of 32 bits, which are the most where there are more elements.
#[test]
fn lengths_have_64_bits() {
    let sizes = [0, 3, 4, 8, (1 << 32) + 8, (1 << 34) + 4, (9 << 30) - 1];
    for is_long in [true, false] {
        let mut w = Wide::new();
        let ty = if is_long { w.long } else { w.a.word };
        let length = w.a.make(ty, Op::ArrayLength, &[w.a.input, 0]);
        let (mut low, zero) = (length, w.a.numbers[0]);
        if is_long {
            let bits = w.number(32);
            let high = (w.a).make(w.long, Op::ShiftRightLogical, &[length, bits]);
            let high = w.a.make(w.a.word, Op::UConvert, &[high]);
            let chain = [w.a.result, zero, w.a.numbers[1]];
            let at = w.a.make(w.pointer, Op::AccessChain, &chain);
            w.a.act(Op::Store, &[at, high]);
            low = w.a.make(w.a.word, Op::UConvert, &[length]);
        }
        let program = compile(&w.a.finish(low));
        let Some(memory) = Sparse::if_promised(1 << 35) else {
            println!("the system has no memory for 32 GB of addresses");
            return;
        };
        for size_bytes in sizes {
            let [low, high] = run(&program, &memory, size_bytes);
            let found = u64::from(low) | u64::from(high) << 32;
            let most = if is_long { u64::MAX } else { u32::MAX.into() };
            assert_eq!(found, (size_bytes / 4).min(most), "{size_bytes:#x}");
        }
    }
}

/// Pointers that are chosen, and elements counted from them in both directions.
#[test]
fn pointers_have_offsets_of_64_bits() {
    let mut w = Wide::new();
    (w.a).capability(Capability::VariablePointersStorageBuffer);
    let strided = w.a.global(
        Op::TypePointer,
        &[StorageClass::StorageBuffer as u32, w.a.word],
    );
    (w.a).decorate(strided, rspirv::spirv::Decoration::ArrayStride, &[4]);
    let index = w.given_index();
    let middle = w.number(1 << 30);
    let zero = w.a.numbers[0];
    let [first, second] = [index, middle].map(|index| {
        let chain = [w.a.input, zero, index];
        w.a.make(strided, Op::AccessChain, &chain)
    });
    let is_small = w.a.make(w.a.bool, Op::ULessThan, &[index, middle]);
    let chosen = w.a.make(strided, Op::Select, &[is_small, second, first]);
    // Beyond the end and back.
    let far = w.number(1 << 40);
    let back = w.number(0u64.wrapping_sub((1 << 40) - 2));
    let away = w.a.make(strided, Op::PtrAccessChain, &[chosen, far]);
    let near = w.a.make(strided, Op::PtrAccessChain, &[away, back]);
    let loaded = w.a.make(w.a.word, Op::Load, &[near]);
    let program = compile(&w.a.finish(loaded));
    let memory = filled(&[(1 << 30) + 2, (1 << 31) + 2]);
    for (index, wanted) in [(5, (1 << 30) + 2), (1 << 31, (1 << 31) + 2)] {
        choose(&memory, index);
        assert_eq!(
            run(&program, &memory, 4 * WORDS)[0],
            value(wanted),
            "{index:#x}"
        );
    }
}

/// A signed index below zero is outside, also a narrow one.
#[test]
fn negative_indices_are_outside() {
    let mut w = Wide::new();
    let signed = w.a.global(Op::TypeInt, &[32, 1]);
    w.a.read();
    let index = w.a.make(signed, Op::Bitcast, &[w.a.given]);
    let at = w.at(index);
    let loaded = w.a.make(w.a.word, Op::Load, &[at]);
    let program = compile(&w.a.finish(loaded));
    let memory = filled(&[u64::from(u32::MAX - 1), 7]);
    for (index, wanted) in [(-2i32, 0), (7, value(7))] {
        memory.write(0, &index.to_ne_bytes());
        assert_eq!(run(&program, &memory, 4 * WORDS)[0], wanted, "{index}");
    }
}

/// The pipeline asks for the same as the execution mode.
#[test]
fn pipelines_ask_for_64_bits() {
    let mut w = Wide::new();
    w.a.modes.clear();
    let index = w.given_index();
    let at = w.at(index);
    let loaded = w.a.make(w.a.word, Op::Load, &[at]);
    let words = w.a.finish(loaded);
    let mut request = request(Stage::Compute, &words);
    request.indexes_in_64_bits = true;
    let program = spirv_jit::compile(&request).unwrap();
    let memory = filled(&INDICES);
    choose(&memory, WORDS - 1);
    assert_eq!(run(&program, &memory, 4 * WORDS)[0], value(WORDS - 1));
}

/// A length of 64 bits needs 64-bit indexing.
#[test]
fn long_lengths_ask_for_it() {
    let mut w = Wide::new();
    w.a.modes.clear();
    let length = w.a.make(w.long, Op::ArrayLength, &[w.a.input, 0]);
    let low = w.a.make(w.a.word, Op::UConvert, &[length]);
    let words = w.a.finish(low);
    let refused = spirv_jit::compile(&request(Stage::Compute, &words));
    assert!(refused.is_err());
}
