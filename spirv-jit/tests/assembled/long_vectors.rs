//! Vectors of one, five and more components (`SPV_EXT_long_vector`), each against a loop over
//! components.

use rspirv::spirv::{
    Capability, Decoration, FunctionControl, GlslStd450Op as Extended, GroupOperation, Op, Scope,
    SelectionControl, StorageClass,
};
use shaders::compute::{Memory, compile, compile_as, dispatch};
use shaders::request;
use spirv_jit::lower::MAX_VECTOR_COMPONENTS;
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

const BUFFER: StorageClass = StorageClass::StorageBuffer;

/// Components of the vectors: odd numbers, powers of two, and the most.
const SIZES: [u32; 7] = [1, 5, 7, 8, 16, 33, MAX_VECTOR_COMPONENTS];

/// A module with vectors of words, three of which are read and one of which is written.
struct Long {
    a: Assembler,
    vector: u32,
    /// To a vector in a storage buffer.
    pointer: u32,
    sources: u32,
    target: u32,
}

impl Long {
    fn new(count: u32) -> Self {
        let mut a = Assembler::new();
        a.capability(Capability::LongVectorEXT);
        let vector = a.global(Op::TypeVector, &[a.word, count]);
        let array = a.open_array(vector, 4 * count);
        let block = a.block(&[(array, 0)]);
        let pointer_to_block = a.pointer(BUFFER, block);
        let [sources, target] = [2, 3].map(|binding| {
            let variable = a.value(pointer_to_block, Op::Variable, &[BUFFER as u32]);
            a.decorate(variable, Decoration::DescriptorSet, &[0]);
            a.decorate(variable, Decoration::Binding, &[binding]);
            a.interface.push(variable);
            variable
        });
        let pointer = a.pointer(BUFFER, vector);
        Self {
            a,
            vector,
            pointer,
            sources,
            target,
        }
    }

    fn load(&mut self, index: usize) -> u32 {
        let chain = [self.sources, self.a.numbers[0], self.a.numbers[index]];
        let at = self.a.make(self.pointer, Op::AccessChain, &chain);
        self.a.make(self.vector, Op::Load, &[at])
    }

    /// Stores a vector, writes the given word as the result, and ends the module.
    fn finish(mut self, vector: u32) -> Vec<u32> {
        let zero = self.a.numbers[0];
        let chain = [self.target, zero, zero];
        let at = self.a.make(self.pointer, Op::AccessChain, &chain);
        self.a.act(Op::Store, &[at, vector]);
        self.a.finish(zero)
    }

    fn vector_of(&mut self, component: u32, count: u32) -> u32 {
        self.a.global(Op::TypeVector, &[component, count])
    }
}

/// Three vectors of words that differ.
fn sources(count: u32) -> [Vec<u32>; 3] {
    let word = |k: u32| (k + 1).wrapping_mul(0x9e37_79b9) ^ (k << 7);
    [0, 1, 2].map(|which| (0..count).map(|k| word(3 * k + which)).collect())
}

/// The vector that a module stores.
fn run(words: &[u32], count: u32, given: u32) -> Vec<u32> {
    let mut memory = Memory {
        buffers: vec![
            (0, vec![given]),
            (16, vec![0]),
            (32, sources(count).concat()),
            (48, vec![0xdead_beef; count as usize]),
        ],
        ..Memory::default()
    };
    dispatch(&compile(words), 1, &mut memory);
    memory.buffers.pop().unwrap().1
}

#[track_caller]
fn expect(words: &[u32], count: u32, given: u32, wanted: impl Fn(usize, [u32; 3]) -> u32) {
    let [a, b, c] = sources(count);
    let wanted: Vec<u32> = (0..count as usize)
        .map(|k| wanted(k, [a[k], b[k], c[k]]))
        .collect();
    assert_eq!(run(words, count, given), wanted, "{count} components");
}

#[test]
fn integers_are_computed_component_by_component() {
    for count in SIZES {
        let mut l = Long::new(count);
        let glsl = l.a.import("GLSL.std.450");
        let bools = l.vector_of(l.a.bool, count);
        let (a, b, c) = (l.load(0), l.load(1), l.load(2));
        let v = l.vector;
        let product = l.a.make(v, Op::IMul, &[a, b]);
        let shifted = l.a.make(v, Op::ShiftRightLogical, &[product, c]);
        let is_less = l.a.make(bools, Op::ULessThan, &[a, c]);
        let negated = l.a.make(v, Op::SNegate, &[a]);
        let chosen = l.a.make(v, Op::Select, &[is_less, shifted, negated]);
        let clamped = [glsl, Extended::UMin as u32, chosen, b];
        let clamped = l.a.make(v, Op::ExtInst, &clamped);
        expect(&l.finish(clamped), count, 0, |_, [a, b, c]| {
            let shifted = a.wrapping_mul(b) >> (c % 32);
            let chosen = if a < c { shifted } else { a.wrapping_neg() };
            chosen.min(b)
        });
    }
}

#[test]
fn floats_are_converted_and_summed() {
    for count in SIZES {
        let mut l = Long::new(count);
        let glsl = l.a.import("GLSL.std.450");
        let float = l.a.global(Op::TypeFloat, &[32]);
        let floats = l.vector_of(float, count);
        let (a, b) = (l.load(0), l.load(1));
        let mask = l.a.number(0xff);
        let mask = vec![mask; count as usize];
        let mask = l.a.value(l.vector, Op::ConstantComposite, &mask);
        let [a, b] = [a, b].map(|it| {
            let small = l.a.make(l.vector, Op::BitwiseAnd, &[it, mask]);
            l.a.make(floats, Op::ConvertUToF, &[small])
        });
        let dot = l.a.make(float, Op::Dot, &[a, b]);
        let scaled = l.a.make(floats, Op::VectorTimesScalar, &[a, dot]);
        let fma = [glsl, Extended::Fma as u32, a, b, scaled];
        let fma = l.a.make(floats, Op::ExtInst, &fma);
        let result = l.a.make(l.vector, Op::Bitcast, &[fma]);
        let [xs, ys, _] = sources(count);
        let small = |word: &u32| (word & 0xff) as f32;
        let mut pairs = xs.iter().zip(&ys).map(|(x, y)| small(x) * small(y));
        let first = pairs.next().unwrap();
        let dot = pairs.fold(first, |sum, product| sum + product);
        expect(&l.finish(result), count, 0, |_, [a, b, _]| {
            small(&a).mul_add(small(&b), small(&a) * dot).to_bits()
        });
    }
}

#[test]
fn components_are_picked_and_replaced() {
    for count in SIZES {
        let last = count - 1;
        for given in [0, last / 2, last] {
            let mut l = Long::new(count);
            l.a.read();
            let (a, b) = (l.load(0), l.load(1));
            let v = l.vector;
            let indices = (0..count).map(|k| if k % 2 == 0 { last - k } else { count + k });
            let shuffle: Vec<u32> = [a, b].into_iter().chain(indices).collect();
            let shuffled = l.a.make(v, Op::VectorShuffle, &shuffle);
            let word = l.a.word;
            let picked = (l.a).make(word, Op::VectorExtractDynamic, &[b, l.a.given]);
            let inserted = [shuffled, picked, l.a.given];
            let inserted = l.a.make(v, Op::VectorInsertDynamic, &inserted);
            let end = l.a.make(word, Op::CompositeExtract, &[a, last]);
            let replaced = l.a.make(v, Op::CompositeInsert, &[end, inserted, 0]);
            let [xs, ys, _] = sources(count);
            expect(&l.finish(replaced), count, given, |k, _| match k {
                0 => xs[last as usize],
                k if k == given as usize => ys[k],
                k if k % 2 == 0 => xs[last as usize - k],
                k => ys[k],
            });
        }
    }
}

/// Parts of all lengths make a vector.
#[test]
fn vectors_are_constructed_of_vectors() {
    let mut l = Long::new(8);
    let five = l.vector_of(l.a.word, 5);
    let two = l.vector_of(l.a.word, 2);
    let (a, b) = (l.load(0), l.load(1));
    let first = l.a.make(five, Op::VectorShuffle, &[a, b, 0, 9, 2, 11, 4]);
    let middle = l.a.make(two, Op::VectorShuffle, &[a, b, 13, u32::MAX]);
    let end = l.a.make(l.a.word, Op::CompositeExtract, &[b, 7]);
    let middle = (l.a).make(two, Op::CompositeInsert, &[end, middle, 1]);
    let whole = [first, middle, end];
    let whole = l.a.make(l.vector, Op::CompositeConstruct, &whole);
    expect(&l.finish(whole), 8, 0, |k, [a, b, _]| match k {
        0 | 2 | 4 => a,
        6 => sources(8)[1][7],
        _ => b,
    });
}

/// Variables of every kind of memory, with components at computed indices.
#[test]
fn memories_hold_vectors() {
    for count in SIZES {
        for class in [
            StorageClass::Function,
            StorageClass::Private,
            StorageClass::Workgroup,
        ] {
            let mut l = Long::new(count);
            l.a.read();
            let pointer = l.a.pointer(class, l.vector);
            let component = l.a.pointer(class, l.a.word);
            let variable = match class {
                StorageClass::Function => l.a.make(pointer, Op::Variable, &[class as u32]),
                _ => {
                    let variable = l.a.value(pointer, Op::Variable, &[class as u32]);
                    l.a.interface.push(variable);
                    variable
                }
            };
            let (a, b) = (l.load(0), l.load(1));
            l.a.act(Op::Store, &[variable, a]);
            let at = l.a.make(component, Op::AccessChain, &[variable, l.a.given]);
            let before = l.a.make(l.a.word, Op::Load, &[at]);
            let after = l.a.make(l.a.word, Op::IAdd, &[before, l.a.numbers[9]]);
            l.a.act(Op::Store, &[at, after]);
            let loaded = l.a.make(l.vector, Op::Load, &[variable]);
            let result = l.a.make(l.vector, Op::BitwiseXor, &[loaded, b]);
            let words = l.finish(result);
            for given in [0, count / 2, count - 1] {
                expect(&words, count, given, |k, [a, b, _]| {
                    let more = if k == given as usize { 9 } else { 0 };
                    a.wrapping_add(more) ^ b
                });
            }
        }
    }
}

/// A component at a computed index of a vector in a buffer.
#[test]
fn components_of_buffers_are_reached() {
    for count in SIZES {
        let mut l = Long::new(count);
        l.a.read();
        let component = l.a.pointer(BUFFER, l.a.word);
        let chain = [l.sources, l.a.numbers[0], l.a.numbers[2], l.a.given];
        let at = l.a.make(component, Op::AccessChain, &chain);
        let word = l.a.make(l.a.word, Op::Load, &[at]);
        let all = vec![word; count as usize];
        let result = l.a.make(l.vector, Op::CompositeConstruct, &all);
        let words = l.finish(result);
        for given in [0, count - 1] {
            let wanted = sources(count)[2][given as usize];
            expect(&words, count, given, |_, _| wanted);
        }
    }
}

/// Vectors are operands of phis, arguments and results of functions.
#[test]
fn vectors_go_through_branches_and_calls() {
    for count in SIZES {
        let mut l = Long::new(count);
        let v = l.vector;
        let ty = l.a.global(Op::TypeFunction, &[v, v, v]);
        let function = l.a.id();
        // The function comes first, though the main one is being written.
        let from = l.a.body.len();
        let head = [v, function, FunctionControl::DONT_INLINE.bits(), ty];
        l.a.act(Op::Function, &head);
        let x = l.a.make(v, Op::FunctionParameter, &[]);
        let y = l.a.make(v, Op::FunctionParameter, &[]);
        let label = l.a.id();
        l.a.label(label);
        let difference = l.a.make(v, Op::ISub, &[x, y]);
        l.a.act(Op::ReturnValue, &[difference]);
        l.a.act(Op::FunctionEnd, &[]);
        l.a.cut_function(from);

        l.a.read();
        let (a, b) = (l.load(0), l.load(1));
        let zero = l.a.numbers[0];
        let is_zero = l.a.make(l.a.bool, Op::IEqual, &[l.a.given, zero]);
        let [yes, no, end] = [(); 3].map(|()| l.a.id());
        l.a.act(Op::SelectionMerge, &[end, SelectionControl::NONE.bits()]);
        l.a.act(Op::BranchConditional, &[is_zero, yes, no]);
        l.a.label(yes);
        let forward = l.a.make(v, Op::FunctionCall, &[function, a, b]);
        l.a.act(Op::Branch, &[end]);
        l.a.label(no);
        let backward = l.a.make(v, Op::FunctionCall, &[function, b, a]);
        l.a.act(Op::Branch, &[end]);
        l.a.label(end);
        let phi = l.a.make(v, Op::Phi, &[forward, yes, backward, no]);
        let words = l.finish(phi);
        expect(&words, count, 0, |_, [a, b, _]| a.wrapping_sub(b));
        expect(&words, count, 1, |_, [a, b, _]| b.wrapping_sub(a));
    }
}

#[test]
fn subgroups_reduce_each_component() {
    let mut l = Long::new(7);
    l.a.capability(Capability::GroupNonUniform);
    l.a.capability(Capability::GroupNonUniformArithmetic);
    l.a.invocations = 16;
    let scope = l.a.number(Scope::Subgroup as u32);
    let a = l.load(0);
    let sum = [scope, GroupOperation::Reduce as u32, a];
    let sum = l.a.make(l.vector, Op::GroupNonUniformIAdd, &sum);
    expect(&l.finish(sum), 7, 0, |_, [a, ..]| a.wrapping_mul(16));
}

/// As many bits as components of another width.
#[test]
fn bits_become_components_of_other_widths() {
    let mut l = Long::new(8);
    l.a.capability(Capability::Int16);
    l.a.capability(Capability::Int64);
    let short = l.a.global(Op::TypeInt, &[16, 0]);
    let long = l.a.global(Op::TypeInt, &[64, 0]);
    let shorts = l.vector_of(short, 16);
    let longs = l.vector_of(long, 4);
    let a = l.load(0);
    let halves = l.a.make(shorts, Op::Bitcast, &[a]);
    let swapped: Vec<u32> = (0..16).map(|k| k ^ 1).collect();
    let swap = [&[halves, halves], &swapped[..]].concat();
    let swapped = l.a.make(shorts, Op::VectorShuffle, &swap);
    let pairs = l.a.make(longs, Op::Bitcast, &[swapped]);
    let negated = l.a.make(longs, Op::Not, &[pairs]);
    let back = l.a.make(l.vector, Op::Bitcast, &[negated]);
    expect(&l.finish(back), 8, 0, |_, [a, ..]| !a.rotate_left(16));
}

/// A module whose vectors have as many components as a specialization constant says, 6 at first;
/// the result: their sum, and twice the component that is replaced.
fn specialized() -> Vec<u32> {
    let mut a = Assembler::new();
    a.capability(Capability::LongVectorEXT);
    a.capability(Capability::ReplicatedCompositesEXT);
    let glsl = a.import("GLSL.std.450");
    let count = a.value(a.word, Op::SpecConstant, &[6]);
    a.decorate(count, Decoration::SpecId, &[4]);
    let float = a.global(Op::TypeFloat, &[32]);
    let words = a.global(Op::TypeVectorIdEXT, &[a.word, count]);
    let floats = a.global(Op::TypeVectorIdEXT, &[float, count]);
    let one = a.value(float, Op::Constant, &[1.0f32.to_bits()]);
    let ones = a.value(floats, Op::ConstantCompositeReplicateEXT, &[one]);
    let three = a.numbers[3];
    let threes = a.value(words, Op::SpecConstantCompositeReplicateEXT, &[three]);
    a.read();
    let given = a.given;
    let all = a.make(words, Op::CompositeConstructReplicateEXT, &[given]);
    let sums = a.make(words, Op::IAdd, &[all, threes]);
    let last = a.make(a.word, Op::ISub, &[count, a.numbers[1]]);
    let doubled = a.make(a.word, Op::IMul, &[given, a.numbers[2]]);
    let replaced = a.make(words, Op::VectorInsertDynamic, &[sums, doubled, last]);
    let numbers = a.make(floats, Op::ConvertUToF, &[replaced]);
    let numbers = a.make(floats, Op::ExtInst, &[glsl, Extended::FAbs as u32, numbers]);
    let sum = a.make(float, Op::Dot, &[numbers, ones]);
    let sum = a.make(a.word, Op::ConvertFToU, &[sum]);
    a.finish(sum)
}

#[test]
fn constants_say_how_many_components_there_are() {
    let words = specialized();
    for (count, given) in [(1u32, 5u32), (2, 6), (6, 7), (37, 8), (1024, 9)] {
        let bytes = count.to_le_bytes();
        let mut request = request(Stage::Compute, &words);
        let given_count = [(4, &bytes[..])];
        if count != 6 {
            request.specialization = &given_count;
        }
        let mut memory = Memory {
            buffers: vec![(0, vec![given]), (16, vec![0])],
            ..Memory::default()
        };
        dispatch(&compile_as(&request), 1, &mut memory);
        let wanted = (count - 1) * (given + 3) + 2 * given;
        assert_eq!(memory.buffers[1].1, [wanted], "{count} components");
    }
}

#[test]
fn what_is_no_vector_is_refused() {
    let is_refused = |words: &[u32]| spirv_jit::compile(&request(Stage::Compute, words)).is_err();
    for count in [0, MAX_VECTOR_COMPONENTS + 1, u32::MAX] {
        let mut a = Assembler::new();
        a.capability(Capability::LongVectorEXT);
        a.global(Op::TypeVector, &[a.word, count]);
        let zero = a.numbers[0];
        assert!(is_refused(&a.finish(zero)), "{count}");
        let mut a = Assembler::new();
        a.capability(Capability::LongVectorEXT);
        let count = a.number(count);
        a.global(Op::TypeVectorIdEXT, &[a.word, count]);
        let zero = a.numbers[0];
        assert!(is_refused(&a.finish(zero)), "{count}");
    }
    for count in [1, 5, 8, 16] {
        let mut a = Assembler::new();
        a.global(Op::TypeVector, &[a.word, count]);
        let zero = a.numbers[0];
        assert!(
            is_refused(&a.finish(zero)),
            "{count} without the capability"
        );
    }
    // No matrix has such columns, and no interface such variables.
    let mut a = Assembler::new();
    a.capability(Capability::LongVectorEXT);
    let float = a.global(Op::TypeFloat, &[32]);
    let vector = a.global(Op::TypeVector, &[float, 5]);
    a.global(Op::TypeMatrix, &[vector, 2]);
    let zero = a.numbers[0];
    assert!(is_refused(&a.finish(zero)));
    let mut a = Assembler::new();
    a.capability(Capability::LongVectorEXT);
    let vector = a.global(Op::TypeVector, &[a.word, 5]);
    let class = StorageClass::Input;
    let pointer = a.pointer(class, vector);
    let variable = a.value(pointer, Op::Variable, &[class as u32]);
    a.interface.push(variable);
    let zero = a.numbers[0];
    assert!(is_refused(&a.finish(zero)));
}

/// Twice the components cost not much more than twice the operations.
#[test]
fn operations_grow_with_the_components() {
    let operations = |count: u32| {
        let mut l = Long::new(count);
        let (a, b) = (l.load(0), l.load(1));
        let mut sum = a;
        for _ in 0..20 {
            sum = l.a.make(l.vector, Op::IMul, &[sum, b]);
            sum = l.a.make(l.vector, Op::IAdd, &[sum, a]);
        }
        let words = l.finish(sum);
        let module = shaders::lower(&request(Stage::Compute, &words)).unwrap();
        let mut count = 0;
        module.functions[0].body.visit_insts(&mut |_| count += 1);
        count
    };
    let (small, large) = (operations(64), operations(1024));
    assert!(large <= 17 * small, "{small}, {large}");
}
