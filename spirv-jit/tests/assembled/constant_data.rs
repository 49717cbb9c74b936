//! Constants as data (`SPV_KHR_constant_data`).

use rspirv::spirv::{Decoration, Op, StorageClass};
use shaders::compute::{Memory, compile_as, dispatch};
use shaders::request;
use spirv_jit::program::{CompileRequest, Stage};

use crate::assembler::Assembler;

const CONSTANT_DATA: u32 = 5147;
const SPEC_CONSTANT_DATA: u32 = 5148;

/// A module that reads an element of a constant by the given index. `width`: bits of an element;
/// `length`: of the array, which the pipeline gives as constant 1.
fn module(opcode: u32, width: u32, length: u32, data: &[u32]) -> Vec<u32> {
    let mut a = Assembler::new();
    let element = match width {
        32 => a.word,
        _ => a.global(Op::TypeInt, &[width, 0]),
    };
    let length = a.value(a.word, Op::SpecConstant, &[length]);
    a.decorate(length, Decoration::SpecId, &[1]);
    let array = a.global(Op::TypeArray, &[element, length]);
    let constant = a.newer_value(array, opcode, data);
    if opcode == SPEC_CONSTANT_DATA {
        a.decorate(constant, Decoration::SpecId, &[2]);
    }
    let class = StorageClass::Private;
    let (of_array, of_element) = (a.pointer(class, array), a.pointer(class, element));
    let variable = a.value(of_array, Op::Variable, &[class as u32, constant]);
    a.interface.push(variable);
    a.read();
    let at = a.make(of_element, Op::AccessChain, &[variable, a.given]);
    let read = a.make(element, Op::Load, &[at]);
    let result = match width {
        32 => read,
        _ => a.make(a.word, Op::UConvert, &[read]),
    };
    a.finish(result)
}

/// The elements of the constant.
fn elements(words: &[u32], specialization: &[(u32, &[u8])], count: u32) -> Vec<u32> {
    let program = compile_as(&CompileRequest {
        specialization,
        ..request(Stage::Compute, words)
    });
    let element = |index| {
        let mut memory = Memory {
            buffers: vec![(0, vec![index]), (16, vec![0])],
            ..Memory::default()
        };
        dispatch(&program, 1, &mut memory);
        memory.buffers[1].1[0]
    };
    (0..count).map(element).collect()
}

/// Elements lie without gaps, the lowest bits of a word first; what is left of the last word is
/// ignored.
#[test]
fn elements_are_packed() {
    let data = [0x0403_0201, 0xffff_ff05];
    let bytes = module(CONSTANT_DATA, 8, 5, &data);
    assert_eq!(elements(&bytes, &[], 5), [1, 2, 3, 4, 5]);
    let halves = module(CONSTANT_DATA, 16, 3, &data);
    assert_eq!(elements(&halves, &[], 3), [0x0201, 0x0403, 0xff05]);
    let words = module(CONSTANT_DATA, 32, 2, &data);
    assert_eq!(elements(&words, &[], 2), data);
    let longs = module(CONSTANT_DATA, 64, 2, &[7, 1, 8, 2]);
    assert_eq!(elements(&longs, &[], 2), [7, 8]);
}

/// As much as an instruction has room for.
#[test]
fn the_largest_data() {
    let data: Vec<u32> = (0..65532u32).map(|i| i.wrapping_mul(0x9e37_79b9)).collect();
    let bytes = module(CONSTANT_DATA, 8, 4 * 65532, &data);
    let expected: Vec<u32> = data[..4]
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .map(u32::from)
        .collect();
    assert_eq!(elements(&bytes, &[], 16), expected);
}

/// The pipeline gives other data, and with the array's length another amount.
#[test]
fn data_are_specialized() {
    let words = module(SPEC_CONSTANT_DATA, 16, 3, &[0x0002_0001, 3]);
    assert_eq!(elements(&words, &[], 3), [1, 2, 3]);
    assert_eq!(
        elements(&words, &[(2, &[9, 1, 8, 0, 7, 0])], 3),
        [0x109, 8, 7]
    );
    let given: [(u32, &[u8]); 2] = [(2, &[5, 0, 6, 0, 7, 0, 8, 0, 9, 0]), (1, &[5, 0, 0, 0])];
    assert_eq!(elements(&words, &given, 5), [5, 6, 7, 8, 9]);
}

/// The message with which a module is refused.
fn refused(words: &[u32], specialization: &[(u32, &[u8])]) -> String {
    let request = CompileRequest {
        specialization,
        ..request(Stage::Compute, words)
    };
    let error = spirv_jit::compile(&request).err().expect("refused");
    error.to_string()
}

#[test]
fn data_must_fit_the_type() {
    for length in [1, 2, 4, u32::MAX] {
        let words = module(CONSTANT_DATA, 32, length, &[1, 2, 3]);
        let message = refused(&words, &[]);
        assert!(message.contains("do not fit the length"), "{message}");
    }
    let words = module(SPEC_CONSTANT_DATA, 8, 4, &[1]);
    for given in [&[][..], &[1, 2, 3], &[1, 2, 3, 4, 5]] {
        let message = refused(&words, &[(2, given)]);
        assert!(message.contains("given data do not fit"), "{message}");
    }
    // The length alone.
    let message = refused(&words, &[(1, &[9, 0, 0, 0])]);
    assert!(message.contains("do not fit the length"), "{message}");
}

#[test]
fn only_arrays_of_integers_have_data() {
    let mut a = Assembler::new();
    a.newer_value(a.word, CONSTANT_DATA, &[1]);
    let result = a.numbers[0];
    let message = refused(&a.finish(result), &[]);
    assert!(message.contains("no array"), "{message}");
    for element in [
        |a: &mut Assembler| a.global(Op::TypeFloat, &[32]),
        |a: &mut Assembler| a.bool,
        |a: &mut Assembler| a.global(Op::TypeVector, &[a.word, 2]),
    ] {
        let mut a = Assembler::new();
        let element = element(&mut a);
        let array = a.global(Op::TypeArray, &[element, a.numbers[1]]);
        a.newer_value(array, CONSTANT_DATA, &[1]);
        let result = a.numbers[0];
        let message = refused(&a.finish(result), &[]);
        assert!(message.contains("no integers"), "{message}");
    }
    // An array's constant of the old kind is none.
    let mut a = Assembler::new();
    let array = a.global(Op::TypeArray, &[a.word, a.numbers[1]]);
    a.value(array, Op::Constant, &[1]);
    let result = a.numbers[0];
    let message = refused(&a.finish(result), &[]);
    assert!(message.contains("not a scalar"), "{message}");
}
