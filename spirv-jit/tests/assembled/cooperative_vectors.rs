//! Cooperative vectors (`SPV_NV_cooperative_vector`): expectations are sums of small integers.

use half::f16;
use rspirv::spirv::{
    BuiltIn, Capability, CooperativeMatrixOperands, CooperativeVectorMatrixLayout as Layout,
    Decoration, GlslStd450Op as GLOp, Op, StorageClass,
};
use shaders::compute::{Memory, compile, dispatch};
use shaders::request;
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

const BUFFER: StorageClass = StorageClass::StorageBuffer;
/// Bytes of a vector in a buffer, and of all vectors.
const VECTOR_BYTES: usize = 64;
const INVOCATIONS: usize = 20;
/// Where the matrix and the bias begin, behind the vectors.
const MATRIX: usize = INVOCATIONS * VECTOR_BYTES;
const BIAS: usize = MATRIX + 1024;
const INPUT_BYTES: usize = BIAS + 64;

/// A component type, by its number in the extension.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    F16 = 0,
    F32 = 1,
    S8 = 3,
    S32 = 5,
    U8 = 7,
    U32 = 9,
    PackedS8 = 1_000_491_000,
    PackedU8 = 1_000_491_001,
    E4M3 = 1_000_491_002,
    E5M2 = 1_000_491_003,
}

impl Kind {
    fn is_float(self) -> bool {
        matches!(self, Kind::F16 | Kind::F32 | Kind::E4M3 | Kind::E5M2)
    }

    fn bytes(self) -> usize {
        match self {
            Kind::F16 => 2,
            Kind::F32 | Kind::S32 | Kind::U32 => 4,
            _ => 1,
        }
    }

    /// The bytes of a small number.
    fn encode(self, number: i32) -> Vec<u8> {
        let half = f16::from_f32(number as f32).to_bits();
        match self {
            Kind::F16 => half.to_le_bytes().to_vec(),
            Kind::F32 => (number as f32).to_le_bytes().to_vec(),
            Kind::S32 | Kind::U32 => number.to_le_bytes().to_vec(),
            Kind::E5M2 => vec![(half >> 8) as u8],
            // A number from 1 to 15 is 2^n (1 + m / 8); the exponent's bias is 7, not 15.
            Kind::E4M3 if number == 0 => vec![0],
            Kind::E4M3 => {
                let sign = if number < 0 { 0x80 } else { 0 };
                vec![sign | ((half & 0x7fff) >> 7) as u8 - 64]
            }
            _ => vec![number as u8],
        }
    }
}

/// A module whose invocations have a vector each.
struct Vectors {
    a: Assembler,
    /// `LocalInvocationIndex`.
    index: u32,
}

impl Vectors {
    fn new() -> Self {
        let mut a = Assembler::new();
        for capability in [
            Capability::CooperativeVectorNV,
            Capability::Float16,
            Capability::Int8,
            Capability::ReplicatedCompositesEXT,
        ] {
            a.capability(capability);
        }
        a.invocations = INVOCATIONS as u32;
        let pointer = a.pointer(StorageClass::Input, a.word);
        let index = a.value(pointer, Op::Variable, &[StorageClass::Input as u32]);
        a.decorate(
            index,
            Decoration::BuiltIn,
            &[BuiltIn::LocalInvocationIndex as u32],
        );
        a.interface.push(index);
        Self { a, index }
    }

    /// The type of values that hold components.
    fn component(&mut self, kind: Kind) -> u32 {
        match kind {
            Kind::F16 => self.a.global(Op::TypeFloat, &[16]),
            Kind::F32 => self.a.global(Op::TypeFloat, &[32]),
            Kind::S8 | Kind::U8 => self.a.global(Op::TypeInt, &[8, 0]),
            _ => self.a.word,
        }
    }

    fn vector(&mut self, component: u32, count: usize) -> u32 {
        let count = self.a.number(count as u32);
        self.a
            .global(Op::TypeCooperativeVectorNV, &[component, count])
    }

    /// The array of a buffer.
    fn array(&mut self, buffer: u32) -> u32 {
        let words = self.a.open_array(self.a.word, 4);
        let pointer = self.a.pointer(BUFFER, words);
        self.a
            .make(pointer, Op::AccessChain, &[buffer, self.a.numbers[0]])
    }

    /// Where the invocation's vector begins: `first` and so many vectors behind it.
    fn offset(&mut self, first: u32) -> u32 {
        let index = self.a.make(self.a.word, Op::Load, &[self.index]);
        let bytes = self.a.number(VECTOR_BYTES as u32);
        let distance = self.a.make(self.a.word, Op::IMul, &[index, bytes]);
        let first = self.a.number(first);
        self.a.make(self.a.word, Op::IAdd, &[distance, first])
    }

    /// The invocation's vector of the input.
    fn load(&mut self, ty: u32) -> u32 {
        let offset = self.offset(0);
        let input = self.a.input;
        let array = self.array(input);
        self.a
            .make(ty, Op::CooperativeVectorLoadNV, &[array, offset])
    }

    /// Stores the invocation's result and ends the module.
    fn finish(mut self, value: u32) -> Vec<u32> {
        let offset = self.offset(64);
        let result = self.a.result;
        let array = self.array(result);
        self.a
            .act(Op::CooperativeVectorStoreNV, &[array, offset, value]);
        let zero = self.a.numbers[0];
        self.a.finish(zero)
    }
}

/// The vectors of the result.
fn run(words: &[u32], input: &[u8]) -> Vec<Vec<u8>> {
    let input = input
        .as_chunks::<4>()
        .0
        .iter()
        .map(|bytes| u32::from_le_bytes(*bytes));
    let result = vec![0; 16 + INVOCATIONS * VECTOR_BYTES / 4];
    let mut memory = Memory {
        buffers: vec![(0, input.collect()), (16, result)],
        ..Memory::default()
    };
    dispatch(&compile(words), 1, &mut memory);
    let bytes: Vec<u8> = memory.buffers[1].1[16..]
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .collect();
    bytes.chunks(VECTOR_BYTES).map(<[u8]>::to_vec).collect()
}

fn write(kind: Kind, memory: &mut [u8], number: i32) {
    let bytes = kind.encode(number);
    memory[..bytes.len()].copy_from_slice(&bytes);
}

/// Kinds of a product: of the input, as what it is read, of the matrix, and of bias and result.
type Kinds = [Kind; 4];

/// A product of a matrix of 5 rows and 9 columns.
fn check(kinds: Kinds, layout: Layout, transposes: bool, adds: bool) {
    const ROWS: usize = 5;
    const COLUMNS: usize = 9;
    let [input, interpretation, matrix, sum] = kinds;
    let is_signed = |kind: Kind| !matches!(kind, Kind::U8 | Kind::U32 | Kind::PackedU8);
    let number = |kind: Kind, seed: usize| match is_signed(kind) {
        true => (seed * 7 % 11) as i32 - 5,
        false => (seed * 7 % 11) as i32,
    };
    let component = |invocation: usize, k: usize| number(interpretation, 3 * invocation + k);
    let element = |row: usize, column: usize| number(matrix, 2 * row + 5 * column + 1);
    let bias = |row: usize| if adds { row as i32 + 1 } else { 0 };

    let mut memory = vec![0; INPUT_BYTES];
    for invocation in 0..INVOCATIONS {
        for k in 0..COLUMNS {
            let kind = if input == Kind::U32 { Kind::U8 } else { input };
            let at = invocation * VECTOR_BYTES + k * kind.bytes();
            write(kind, &mut memory[at..], component(invocation, k));
        }
    }
    // As the layouts are documented: lines of 16 elements here.
    let stride = match layout {
        Layout::RowMajorNV | Layout::ColumnMajorNV => 48,
        _ => 16 * matrix.bytes(),
    };
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let by_columns = (layout == Layout::ColumnMajorNV) != transposes;
            let (line, place) = if by_columns {
                (column, row)
            } else {
                (row, column)
            };
            let at = MATRIX + line * stride + place * matrix.bytes();
            write(matrix, &mut memory[at..], element(row, column));
        }
        write(sum, &mut memory[BIAS + row * sum.bytes()..], bias(row));
    }

    let mut v = Vectors::new();
    let (given, result) = (v.component(input), v.component(sum));
    let result = if result == given || sum == input {
        given
    } else {
        result
    };
    let count = if input == Kind::U32 {
        COLUMNS.div_ceil(4)
    } else {
        COLUMNS
    };
    let types = [v.vector(given, count), v.vector(result, ROWS)];
    let loaded = v.load(types[0]);
    let buffer = v.a.input;
    let array = v.array(buffer);
    let mut operands = vec![loaded, v.a.number(interpretation as u32)];
    operands.extend([array, v.a.number(MATRIX as u32), v.a.number(matrix as u32)]);
    if adds {
        operands.extend([array, v.a.number(BIAS as u32), v.a.number(sum as u32)]);
    }
    let transpose = match transposes {
        true => v.a.value(v.a.bool, Op::ConstantTrue, &[]),
        false => v.a.value(v.a.bool, Op::ConstantFalse, &[]),
    };
    operands.extend([v.a.number(ROWS as u32), v.a.number(COLUMNS as u32)]);
    operands.extend([v.a.number(layout as u32), transpose, v.a.number(48)]);
    if is_signed(interpretation) && !interpretation.is_float() {
        operands.push(CooperativeMatrixOperands::MATRIX_B_SIGNED_COMPONENTS_KHR.bits());
    }
    let op = match adds {
        true => Op::CooperativeVectorMatrixMulAddNV,
        false => Op::CooperativeVectorMatrixMulNV,
    };
    let product = v.a.make(types[1], op, &operands);
    let found = run(&v.finish(product), &memory);
    for (invocation, found) in found.iter().enumerate() {
        for row in 0..ROWS {
            let products = (0..COLUMNS).map(|k| component(invocation, k) * element(row, k));
            let expected = sum.encode(bias(row) + products.sum::<i32>());
            assert_eq!(
                found[row * sum.bytes()..][..sum.bytes()],
                expected,
                "{kinds:?}, {layout:?}, {transposes}, {adds}: row {row} of {invocation}"
            );
        }
    }
}

#[test]
fn matrices_in_memory_are_multiplied() {
    use Kind::{E4M3, E5M2, F16, F32, PackedS8, PackedU8, S8, S32, U8, U32};
    let products = [
        [F16, F16, F16, F16],
        [U32, PackedS8, S8, S32],
        [S8, S8, S8, S32],
        [F32, S8, S8, S32],
        [F16, E4M3, E4M3, F16],
        [F16, E5M2, E5M2, F16],
        [F16, F16, F16, F32],
        [F32, F32, F32, F32],
        [F32, F16, F16, F32],
        [U8, U8, U8, U32],
        [U8, U8, S8, S32],
        [S32, S8, S8, S32],
        [U32, PackedU8, S8, S32],
    ];
    for kinds in products {
        for layout in [Layout::RowMajorNV, Layout::ColumnMajorNV] {
            check(kinds, layout, false, true);
        }
        for layout in [Layout::InferencingOptimalNV, Layout::TrainingOptimalNV] {
            check(kinds, layout, false, false);
            check(kinds, layout, true, true);
        }
    }
}

/// Inputs become 8-bit integers by rounding to the nearest, ties to even, and saturate.
#[test]
fn inputs_are_rounded_and_saturated() {
    let mut memory = vec![0; INPUT_BYTES];
    let numbers = [0.5f32, 1.5, -2.5, 126.6, 127.5, 1e9, -128.4, -129.0, -1e9];
    for (k, number) in numbers.into_iter().enumerate() {
        memory[4 * k..][..4].copy_from_slice(&number.to_le_bytes());
    }
    // One row for each number.
    for k in 0..numbers.len() {
        memory[MATRIX + 16 * k + k] = 1;
    }
    let mut v = Vectors::new();
    let float = v.component(Kind::F32);
    let types = [
        v.vector(float, numbers.len()),
        v.vector(v.a.word, numbers.len()),
    ];
    let loaded = v.load(types[0]);
    let buffer = v.a.input;
    let array = v.array(buffer);
    let kind = v.a.number(Kind::S8 as u32);
    let count = v.a.number(numbers.len() as u32);
    let no = v.a.value(v.a.bool, Op::ConstantFalse, &[]);
    let (matrix, stride) = (v.a.number(MATRIX as u32), v.a.number(16));
    let operands = [
        loaded,
        kind,
        array,
        matrix,
        kind,
        count,
        count,
        v.a.numbers[0],
        no,
        stride,
    ];
    let product = (v.a).make(types[1], Op::CooperativeVectorMatrixMulNV, &operands);
    let found = run(&v.finish(product), &memory);
    let found: Vec<i32> = (found[0].as_chunks::<4>().0.iter())
        .map(|bytes| i32::from_le_bytes(*bytes))
        .take(numbers.len())
        .collect();
    assert_eq!(found, [0, 2, -2, 127, 127, 127, -128, -128, -128]);
}

/// Components by constant and computed indices, in variables, constants, conversions, and
/// operations on all components.
#[test]
fn components_are_like_those_of_vectors() {
    const COUNT: usize = 9;
    let mut v = Vectors::new();
    let half = v.component(Kind::F16);
    let glsl = v.a.import("GLSL.std.450");
    let [halves, words] = [v.vector(half, COUNT), v.vector(v.a.word, COUNT)];
    let of_words = v.a.pointer(StorageClass::Function, words);
    let of_word = v.a.pointer(StorageClass::Function, v.a.word);
    let sevens = [v.a.numbers[7]];
    let sevens = v.a.value(words, Op::ConstantCompositeReplicateEXT, &sevens);
    let class = StorageClass::Function as u32;
    let variable = v.a.make(of_words, Op::Variable, &[class]);
    v.a.read();
    let loaded = v.load(words);
    let sum = v.a.make(words, Op::IAdd, &[loaded, sevens]);
    v.a.act(Op::Store, &[variable, sum]);
    // The component of the given number is doubled.
    let chain = [variable, v.a.given];
    let at = v.a.make(of_word, Op::AccessChain, &chain);
    let component = v.a.make(v.a.word, Op::Load, &[at]);
    let doubled = v.a.make(v.a.word, Op::IAdd, &[component, component]);
    v.a.act(Op::Store, &[at, doubled]);
    let stored = v.a.make(words, Op::Load, &[variable]);
    let floats = v.a.make(halves, Op::ConvertUToF, &[stored]);
    let three =
        v.a.value(half, Op::Constant, &[f16::from_f32(3.0).to_bits().into()]);
    let scaled = v.a.make(halves, Op::VectorTimesScalar, &[floats, three]);
    let fifty =
        v.a.value(half, Op::Constant, &[f16::from_f32(50.0).to_bits().into()]);
    let fifty =
        v.a.make(halves, Op::CompositeConstructReplicateEXT, &[fifty]);
    let operands = [glsl, GLOp::FMin as u32, scaled, fifty];
    let least = v.a.make(halves, Op::ExtInst, &operands);
    let negative = v.a.make(halves, Op::FNegate, &[least]);
    let integers = v.a.make(words, Op::ConvertFToS, &[negative]);
    let third = v.a.make(v.a.word, Op::CompositeExtract, &[integers, 2]);
    let inserted = v.a.make(words, Op::CompositeInsert, &[third, integers, 0]);
    let index = v.a.given;
    let taken =
        v.a.make(v.a.word, Op::VectorExtractDynamic, &[loaded, index]);
    let one = v.a.numbers[1];
    let place = v.a.make(v.a.word, Op::IAdd, &[index, one]);
    let result =
        v.a.make(words, Op::VectorInsertDynamic, &[inserted, taken, place]);
    let found = run(&v.finish(result), &{
        let mut memory = vec![0; INPUT_BYTES];
        for invocation in 0..INVOCATIONS {
            for k in 0..COUNT {
                // The first word of all is the index.
                let number = if (invocation, k) == (0, 0) {
                    4
                } else {
                    invocation + k
                };
                let at = invocation * VECTOR_BYTES + 4 * k;
                write(Kind::S32, &mut memory[at..], number as i32);
            }
        }
        memory
    });
    for (invocation, found) in found.iter().enumerate() {
        let given = |k: usize| {
            if (invocation, k) == (0, 0) {
                4
            } else {
                (invocation + k) as i32
            }
        };
        let scaled = |k: usize| {
            let sum = given(k) + 7;
            -(3 * if k == 4 { 2 * sum } else { sum }).min(50)
        };
        for k in 0..COUNT {
            let expected = match k {
                0 => scaled(2),
                5 => given(4),
                _ => scaled(k),
            };
            assert_eq!(
                found[4 * k..][..4],
                expected.to_le_bytes(),
                "{k} of {invocation}"
            );
        }
    }
}

/// Vectors pass through workgroup memory, at offsets in bytes.
#[test]
fn vectors_pass_through_workgroup_memory() {
    let mut v = Vectors::new();
    let half = v.component(Kind::F16);
    let halves = v.vector(half, 11);
    let length = v.a.number((INVOCATIONS * VECTOR_BYTES / 2) as u32);
    let array = v.a.global(Op::TypeArray, &[half, length]);
    let class = StorageClass::Workgroup;
    let pointer = v.a.pointer(class, array);
    let shared = v.a.value(pointer, Op::Variable, &[class as u32]);
    v.a.interface.push(shared);
    let loaded = v.load(halves);
    let offset = v.offset(0);
    v.a.act(Op::CooperativeVectorStoreNV, &[shared, offset, loaded]);
    let semantics = v.a.number(0x108);
    let two = v.a.numbers[2];
    v.a.act(Op::ControlBarrier, &[two, two, semantics]);
    // The vectors come back in the opposite order.
    let last = v.a.number(((INVOCATIONS - 1) * VECTOR_BYTES) as u32);
    let from = v.a.make(v.a.word, Op::ISub, &[last, offset]);
    let turned =
        v.a.make(halves, Op::CooperativeVectorLoadNV, &[shared, from]);
    let input: Vec<u8> = (0..INPUT_BYTES).map(|k| (k * 7 + k / 64) as u8).collect();
    let found = run(&v.finish(turned), &input);
    for (invocation, found) in found.iter().enumerate() {
        let at = (INVOCATIONS - 1 - invocation) * VECTOR_BYTES;
        assert_eq!(found[..22], input[at..at + 22]);
        assert_eq!(found[22..], [0; VECTOR_BYTES - 22]);
    }
}

#[test]
fn vectors_of_too_many_components_are_refused() {
    for (count, message) in [
        (257, "a vector cannot have 257 components"),
        (0, "a vector cannot have 0 components"),
    ] {
        let mut v = Vectors::new();
        let ty = v.vector(v.a.word, count);
        let loaded = v.load(ty);
        match spirv_jit::compile(&request(Stage::Compute, &v.finish(loaded))) {
            Ok(_) => panic!("the module is taken"),
            Err(error) => assert!(error.to_string().contains(message), "{error}"),
        }
    }
}
