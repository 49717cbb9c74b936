//! Cooperative matrices (`SPV_KHR_cooperative_matrix`): expectations are sums of small integers.

use half::{bf16, f16};
use rspirv::spirv::{Capability, CooperativeMatrixOperands, Decoration, Op, StorageClass};
use shaders::compute::{Memory, compile, dispatch};
use shaders::request;
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

const SIZE: usize = 16;
const BUFFER: StorageClass = StorageClass::StorageBuffer;

/// Of components.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    F16,
    BFloat16,
    F32,
    S8,
    U8,
    I32,
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Kind::S8 | Kind::U8 => 1,
            Kind::F16 | Kind::BFloat16 => 2,
            Kind::F32 | Kind::I32 => 4,
        }
    }

    /// The bytes of a number.
    fn encode(self, number: i32) -> Vec<u8> {
        match self {
            Kind::F16 => f16::from_f32(number as f32).to_le_bytes().to_vec(),
            Kind::BFloat16 => bf16::from_f32(number as f32).to_le_bytes().to_vec(),
            Kind::F32 => (number as f32).to_le_bytes().to_vec(),
            Kind::S8 | Kind::U8 => vec![number as u8],
            Kind::I32 => number.to_le_bytes().to_vec(),
        }
    }

    fn ty(self, a: &mut Assembler) -> u32 {
        match self {
            Kind::F16 => a.global(Op::TypeFloat, &[16]),
            Kind::BFloat16 => a.global(Op::TypeFloat, &[16, 0]),
            Kind::F32 => a.global(Op::TypeFloat, &[32]),
            Kind::S8 | Kind::U8 => a.global(Op::TypeInt, &[8, 0]),
            Kind::I32 => a.word,
        }
    }
}

/// How a matrix lies in memory.
#[derive(Clone, Copy)]
struct MatrixLayout {
    column_major: bool,
    /// From line to line.
    stride_bytes: usize,
}

impl MatrixLayout {
    fn offset(self, kind: Kind, row: usize, column: usize) -> usize {
        let (line, place) = match self.column_major {
            true => (column, row),
            false => (row, column),
        };
        line * self.stride_bytes + place * kind.bytes()
    }

    fn write(self, kind: Kind, memory: &mut [u8], number: impl Fn(usize, usize) -> i32) {
        for row in 0..SIZE {
            for column in 0..SIZE {
                let bytes = kind.encode(number(row, column));
                let at = self.offset(kind, row, column);
                memory[at..at + bytes.len()].copy_from_slice(&bytes);
            }
        }
    }
}

/// A module with types of matrices, whose sizes are specialization constants.
struct Matrices {
    a: Assembler,
    scope: u32,
    size: u32,
}

impl Matrices {
    fn new() -> Self {
        let mut a = Assembler::new();
        for capability in [
            Capability::CooperativeMatrixKHR,
            Capability::BFloat16TypeKHR,
            Capability::BFloat16CooperativeMatrixKHR,
            Capability::Float16,
            Capability::Int8,
            Capability::UntypedPointersKHR,
        ] {
            a.capability(capability);
        }
        a.invocations = SIZE as u32;
        // The subgroup.
        let scope = a.number(3);
        let size = a.value(a.word, Op::SpecConstant, &[SIZE as u32]);
        a.decorate(size, Decoration::SpecId, &[0]);
        Self { a, scope, size }
    }

    /// A type of matrices of a use: 0 and 1 are factors, 2 is a sum.
    fn ty(&mut self, component: u32, r#use: usize) -> u32 {
        let operands = [
            component,
            self.scope,
            self.size,
            self.size,
            self.a.numbers[r#use],
        ];
        self.a.global(Op::TypeCooperativeMatrixKHR, &operands)
    }

    /// A pointer to a word of a buffer.
    fn at(&mut self, buffer: u32, word: u32) -> u32 {
        let pointer = self.a.pointer(BUFFER, self.a.word);
        let index = self.a.number(word);
        let chain = [buffer, self.a.numbers[0], index];
        self.a.make(pointer, Op::AccessChain, &chain)
    }

    fn finish(self) -> Vec<u32> {
        let zero = self.a.numbers[0];
        self.a.finish(zero)
    }
}

/// The bytes of the result behind its first word.
fn run(words: &[u32], input: &[u8], result_bytes: usize) -> Vec<u8> {
    let input = input.chunks(4).map(|bytes| {
        let mut word = [0; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        u32::from_le_bytes(word)
    });
    let mut memory = Memory {
        buffers: vec![
            (0, input.collect()),
            (16, vec![0; 1 + result_bytes.div_ceil(4)]),
        ],
        ..Memory::default()
    };
    dispatch(&compile(words), 1, &mut memory);
    let words = &memory.buffers[1].1[1..];
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// How memory is accessed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum MatrixAccess {
    /// Through a pointer to words, which strides count; with constant strides.
    Words,
    /// The same with a stride that is loaded.
    Computed,
    /// Through a pointer without a type: strides count bytes.
    Untyped,
}

/// A product of matrices in memory.
fn check_product(kind: Kind, sum: Kind, access: MatrixAccess, column_major: bool) {
    let unit = match access {
        MatrixAccess::Untyped => 1,
        _ => 4,
    };
    // Odd strides, as far as the unit lets them be.
    let layout = |kind: Kind| MatrixLayout {
        column_major,
        stride_bytes: match access {
            MatrixAccess::Untyped => 19 * kind.bytes(),
            _ => 4 * (4 * kind.bytes() + 3),
        },
    };
    let matrices = [(kind, 0), (kind, 1), (sum, 2)];
    let number = |matrix: usize, row: usize, column: usize| {
        let number = ((row * 7 + column * 3 + matrix * 5) % 5) as i32;
        match kind {
            Kind::U8 => number,
            _ => number - 2,
        }
    };
    // The strides come first.
    const AT: usize = 2048;
    let mut input = vec![0; 4 * AT];
    for (index, kind) in [kind, sum].into_iter().enumerate() {
        let stride = layout(kind).stride_bytes / unit;
        input[4 * index..][..4].copy_from_slice(&(stride as u32).to_le_bytes());
    }
    for (index, (kind, _)) in matrices.into_iter().enumerate() {
        let part = &mut input[AT * (index + 1)..];
        layout(kind).write(kind, part, |row, column| number(index, row, column));
    }

    let mut m = Matrices::new();
    let untyped = (m.a).global(Op::TypeUntypedPointerKHR, &[BUFFER as u32]);
    let types = [kind, sum].map(|kind| kind.ty(&mut m.a));
    let types = matrices.map(|(kind, r#use)| (types[(kind == sum) as usize], r#use));
    let types = match kind == sum {
        true => types.map(|(_, r#use)| (types[0].0, r#use)),
        false => types,
    };
    let types = types.map(|(ty, r#use)| m.ty(ty, r#use));
    let major = m.a.numbers[column_major as usize];
    let stride = |m: &mut Matrices, of_sum: bool| match access {
        MatrixAccess::Computed => {
            let at = m.at(m.a.input, of_sum as u32);
            m.a.make(m.a.word, Op::Load, &[at])
        }
        _ => {
            let kind = if of_sum { sum } else { kind };
            m.a.number((layout(kind).stride_bytes / unit) as u32)
        }
    };
    let strides = [false, true].map(|of_sum| stride(&mut m, of_sum));
    let at = |m: &mut Matrices, buffer: u32, bytes: usize| match access {
        MatrixAccess::Untyped => {
            let words = m.a.open_array(m.a.word, 4);
            let index = m.a.number(bytes as u32 / 4);
            let block = m.a.block(&[(words, 0)]);
            let chain = [block, buffer, m.a.numbers[0], index];
            m.a.make(untyped, Op::UntypedAccessChainKHR, &chain)
        }
        _ => m.at(buffer, bytes as u32 / 4),
    };
    let mut loaded = Vec::new();
    for (index, ty) in types.into_iter().enumerate() {
        let input = m.a.input;
        let from = at(&mut m, input, AT * (index + 1));
        let operands = [from, major, strides[(index == 2) as usize]];
        loaded.push(m.a.make(ty, Op::CooperativeMatrixLoadKHR, &operands));
    }
    if kind == Kind::S8 {
        let signed = CooperativeMatrixOperands::MATRIX_A_SIGNED_COMPONENTS_KHR
            | CooperativeMatrixOperands::MATRIX_B_SIGNED_COMPONENTS_KHR
            | CooperativeMatrixOperands::MATRIX_C_SIGNED_COMPONENTS_KHR
            | CooperativeMatrixOperands::MATRIX_RESULT_SIGNED_COMPONENTS_KHR;
        loaded.push(signed.bits());
    }
    let product = (m.a).make(types[2], Op::CooperativeMatrixMulAddKHR, &loaded);
    let result = m.a.result;
    let to = at(&mut m, result, 4);
    let operands = [to, product, major, strides[1]];
    m.a.act(Op::CooperativeMatrixStoreKHR, &operands);

    let mut expected = vec![0; AT];
    layout(sum).write(sum, &mut expected, |row, column| {
        let products = (0..SIZE).map(|k| number(0, row, k) * number(1, k, column));
        number(2, row, column) + products.sum::<i32>()
    });
    let found = run(&m.finish(), &input, AT);
    assert!(
        found == expected,
        "{kind:?} to {sum:?} by {access:?}, column major: {column_major}"
    );
}

#[test]
fn matrices_in_memory_are_multiplied() {
    let kinds = [
        (Kind::F16, Kind::F32),
        (Kind::F16, Kind::F16),
        (Kind::BFloat16, Kind::F32),
        (Kind::BFloat16, Kind::BFloat16),
        (Kind::F32, Kind::F32),
        (Kind::S8, Kind::I32),
        (Kind::U8, Kind::I32),
    ];
    for (kind, sum) in kinds {
        for access in [
            MatrixAccess::Words,
            MatrixAccess::Computed,
            MatrixAccess::Untyped,
        ] {
            for column_major in [false, true] {
                check_product(kind, sum, access, column_major);
            }
        }
    }
}

/// Lengths, components by constant and computed indices, in variables and arrays of matrices,
/// constants, and operations on all components.
#[test]
fn components_are_like_those_of_vectors() {
    let mut m = Matrices::new();
    let ty = m.ty(m.a.word, 2);
    let two = m.a.numbers[2];
    let pair = m.a.global(Op::TypeArray, &[ty, two]);
    let of_pair = m.a.pointer(StorageClass::Function, pair);
    let of_word = m.a.pointer(StorageClass::Function, m.a.word);
    let sevens = m.a.value(ty, Op::ConstantComposite, &[m.a.numbers[7]]);
    let (major, stride) = (m.a.numbers[0], m.a.number(SIZE as u32));
    let variable =
        m.a.make(of_pair, Op::Variable, &[StorageClass::Function as u32]);
    m.a.read();
    let from = m.at(m.a.input, 1);
    let given = [from, major, stride];
    let loaded = m.a.make(ty, Op::CooperativeMatrixLoadKHR, &given);
    let sum = m.a.make(ty, Op::IAdd, &[loaded, sevens]);
    let scaled = m.a.make(ty, Op::MatrixTimesScalar, &[sum, m.a.numbers[3]]);
    let length = m.a.make(m.a.word, Op::CooperativeMatrixLengthKHR, &[ty]);
    let lengths = m.a.make(ty, Op::CompositeConstruct, &[length]);
    let both = m.a.make(pair, Op::CompositeConstruct, &[scaled, lengths]);
    m.a.act(Op::Store, &[variable, both]);
    // The fourth component of the matrix of the given number goes to the sixth of the other.
    let (index, one) = (m.a.given, m.a.numbers[1]);
    let chain = [variable, index, m.a.numbers[3]];
    let at = m.a.make(of_word, Op::AccessChain, &chain);
    let component = m.a.make(m.a.word, Op::Load, &[at]);
    let other = m.a.make(m.a.word, Op::ISub, &[one, index]);
    let chain = [variable, other, m.a.numbers[5]];
    let at = m.a.make(of_word, Op::AccessChain, &chain);
    m.a.act(Op::Store, &[at, component]);
    let stored = m.a.make(pair, Op::Load, &[variable]);
    for part in 0..2u32 {
        let matrix = m.a.make(ty, Op::CompositeExtract, &[stored, part]);
        let matrix = match part {
            0 => matrix,
            // The third component becomes the first.
            _ => {
                let third = m.a.make(m.a.word, Op::CompositeExtract, &[scaled, 2]);
                m.a.make(ty, Op::CompositeInsert, &[third, matrix, 0])
            }
        };
        let to = m.at(m.a.result, 1 + part * 256);
        let operands = [to, matrix, major, stride];
        m.a.act(Op::CooperativeMatrixStoreKHR, &operands);
    }
    let words = m.finish();
    for given in 0..2u32 {
        let numbers: Vec<u32> = std::iter::once(given).chain(100..356).collect();
        let input: Vec<u8> = numbers.iter().flat_map(|word| word.to_le_bytes()).collect();
        let found = run(&words, &input, 2 * 4 * SIZE * SIZE);
        let word = |index: usize| u32::from_le_bytes(found[4 * index..][..4].try_into().unwrap());
        // Components are the implementation's: here they are the rows.
        let scaled = |row: usize, column: usize| 3 * (100 + (SIZE * row + column) as u32 + 7);
        for row in 0..SIZE {
            for column in 0..SIZE {
                let first = match (given, row) {
                    (1, 5) => 16,
                    _ => scaled(row, column),
                };
                let second = match (given, row) {
                    (_, 0) => scaled(2, column),
                    (0, 5) => scaled(3, column),
                    _ => 16,
                };
                let at = SIZE * row + column;
                assert_eq!(
                    [word(at), word(256 + at)],
                    [first, second],
                    "{row}, {column}"
                );
            }
        }
    }
}

/// A matrix is an argument and a result; in workgroup memory its lines become columns.
#[test]
fn matrices_pass_through_functions_and_workgroup_memory() {
    let mut m = Matrices::new();
    let half = Kind::F16.ty(&mut m.a);
    let ty = m.ty(half, 0);
    let length = m.a.number(256);
    let halves = m.a.global(Op::TypeArray, &[half, length]);
    let of_halves = m.a.pointer(StorageClass::Workgroup, halves);
    let of_half = m.a.pointer(StorageClass::Workgroup, half);
    let shared =
        m.a.value(of_halves, Op::Variable, &[StorageClass::Workgroup as u32]);
    m.a.interface.push(shared);
    let semantics = m.a.number(0x108);
    let [rows, columns] = [m.a.numbers[0], m.a.numbers[1]];
    let (eight, sixteen) = (m.a.numbers[8], m.a.number(16));
    let (two, first) = (m.a.numbers[2], m.a.numbers[0]);

    let function = m.a.global(Op::TypeFunction, &[ty, ty]);
    let from = m.a.body.len();
    let twice = m.a.make(ty, Op::Function, &[0, function]);
    let parameter = m.a.make(ty, Op::FunctionParameter, &[]);
    let label = m.a.id();
    m.a.label(label);
    let sum = m.a.make(ty, Op::FAdd, &[parameter, parameter]);
    m.a.act(Op::ReturnValue, &[sum]);
    m.a.act(Op::FunctionEnd, &[]);
    m.a.cut_function(from);

    // Eight words are sixteen halves.
    let from = m.at(m.a.input, 0);
    let loaded =
        m.a.make(ty, Op::CooperativeMatrixLoadKHR, &[from, rows, eight]);
    let doubled = m.a.make(ty, Op::FunctionCall, &[twice, loaded]);
    let at = m.a.make(of_half, Op::AccessChain, &[shared, first]);
    m.a.act(Op::CooperativeMatrixStoreKHR, &[at, doubled, rows, sixteen]);
    m.a.act(Op::ControlBarrier, &[two, two, semantics]);
    let turned =
        m.a.make(ty, Op::CooperativeMatrixLoadKHR, &[at, columns, sixteen]);
    let to = m.at(m.a.result, 1);
    m.a.act(Op::CooperativeMatrixStoreKHR, &[to, turned, rows, eight]);
    let words = m.finish();

    let layout = MatrixLayout {
        column_major: false,
        stride_bytes: 32,
    };
    let (mut input, mut expected) = (vec![0; 512], vec![0; 512]);
    let number = |row: usize, column: usize| (row * SIZE + column) as i32;
    layout.write(Kind::F16, &mut input, number);
    layout.write(Kind::F16, &mut expected, |row, column| {
        2 * number(column, row)
    });
    assert!(run(&words, &input, 512) == expected);
}

/// Components outside of a buffer are zeros, and are not stored.
#[test]
fn components_outside_of_a_buffer_are_zeros() {
    for column_major in [0, 1] {
        let mut m = Matrices::new();
        let ty = m.ty(m.a.word, 2);
        let (major, stride) = (m.a.numbers[column_major], m.a.number(SIZE as u32));
        let from = m.at(m.a.input, 0);
        let loaded =
            m.a.make(ty, Op::CooperativeMatrixLoadKHR, &[from, major, stride]);
        let to = m.at(m.a.result, 1);
        let operands = [to, loaded, major, stride];
        m.a.act(Op::CooperativeMatrixStoreKHR, &operands);
        let input: Vec<u8> = (1..=101u32).flat_map(|word| word.to_le_bytes()).collect();
        // The result ends earlier than the matrix, too.
        let found = run(&m.finish(), &input, 4 * 199);
        let words = found
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| u32::from_le_bytes(*word));
        let expected = (1..=199).map(|word| if word <= 101 { word } else { 0 });
        assert!(words.eq(expected));
    }
}

#[test]
fn other_matrices_are_refused() {
    let refusal = |edit: fn(&mut Matrices)| {
        let mut m = Matrices::new();
        edit(&mut m);
        let ty = m.ty(m.a.word, 2);
        let from = m.at(m.a.input, 0);
        let operands = [from, m.a.numbers[0], m.a.numbers[8]];
        m.a.make(ty, Op::CooperativeMatrixLoadKHR, &operands);
        match spirv_jit::compile(&request(Stage::Compute, &m.finish())) {
            Ok(_) => panic!("the module is taken"),
            Err(error) => error.to_string(),
        }
    };
    for found in [
        refusal(|m| m.size = m.a.numbers[8]),
        refusal(|m| m.scope = m.a.numbers[2]),
    ] {
        let expected = "only 16 by 16 cooperative matrices of a subgroup are supported";
        assert!(found.contains(expected), "{found}");
    }
}
