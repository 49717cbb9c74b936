//! Modules at ten times SPIR-V's universal limits: they are compiled, stored, loaded and run on a
//! thread with a small stack, since no function of the compiler recurses to a depth that a module
//! chooses. What each gives follows from how it was written.

use std::thread;

use rspirv::spirv::{FunctionControl, LoopControl, Op, SelectionControl, StorageClass};
use shaders::compute::{Memory, dispatch};
use shaders::request;
use spirv_jit::Program;
use spirv_jit::ir::{binary, text, verify};
use spirv_jit::program::Stage;

use crate::assembler::{Assembler, put};

/// Ten times the limit of control flow nesting.
const NESTING: u32 = 10_230;

/// How many of nested loops count.
const COUNTING: u32 = NESTING.div_ceil(100);

/// Ten times the limit of nested structures.
const TYPES: u32 = 2_550;

const STACK_BYTES: usize = 256 << 10;

/// The results of modules for words, compiled and run on a small stack.
fn expect(words: Vec<u32>, cases: &'static [(u32, u32)]) {
    let small = thread::Builder::new().stack_size(STACK_BYTES);
    let ran = small.spawn(move || {
        let module = spirv_jit::program::compile_module(&request(Stage::Compute, &words));
        let module = module.unwrap_or_else(|error| panic!("{error}"));
        let stored = binary::encode(&module);
        let loaded = binary::decode(&stored).unwrap();
        verify(&loaded).unwrap();
        assert!(loaded == module, "bytes do not give the module back");
        let printed = text::parse_module(&text::print_module(&module)).unwrap();
        assert!(printed == module, "text does not give the module back");
        let copy = loaded.clone();
        drop(loaded);
        shaders::code_pages::allow_native_code();
        let program = Program::new(&copy).unwrap_or_else(|error| panic!("{error}"));
        for &(given, result) in cases {
            let mut memory = Memory {
                buffers: vec![(0, vec![given]), (16, vec![0])],
                ..Memory::default()
            };
            dispatch(&program, 1, &mut memory);
            assert_eq!(memory.buffers[1].1, [result], "for {given}");
        }
    });
    ran.unwrap().join().unwrap();
}

/// `if (x > 0) { n++; if (x > 1) { n++; … } }`
#[test]
fn nested_selections() {
    let mut a = Assembler::new();
    let counter = a.counter();
    a.read();
    let mut merges = Vec::new();
    for level in 0..NESTING {
        let limit = a.number(level);
        let condition = a.make(a.bool, Op::UGreaterThan, &[a.given, limit]);
        let (inside, merge) = (a.id(), a.id());
        let control = SelectionControl::NONE.bits();
        a.act(Op::SelectionMerge, &[merge, control]);
        a.act(Op::BranchConditional, &[condition, inside, merge]);
        a.label(inside);
        a.count(counter);
        merges.push(merge);
    }
    for merge in merges.into_iter().rev() {
        a.act(Op::Branch, &[merge]);
        a.label(merge);
    }
    expect(
        a.finish_counter(counter),
        &[(0, 0), (1, 1), (1_500, 1_500), (20_000, NESTING)],
    );
}

/// `if (x == 0) n = 0; else if (x == 1) n = 1; else if (x == 2) n = 4; …`
#[test]
fn chains_of_else_if() {
    let mut a = Assembler::new();
    let counter = a.counter();
    a.read();
    let mut merges = Vec::new();
    for level in 0..NESTING {
        let number = a.number(level);
        let condition = a.make(a.bool, Op::IEqual, &[a.given, number]);
        let (inside, otherwise, merge) = (a.id(), a.id(), a.id());
        let control = SelectionControl::NONE.bits();
        a.act(Op::SelectionMerge, &[merge, control]);
        a.act(Op::BranchConditional, &[condition, inside, otherwise]);
        a.label(inside);
        let value = a.make(a.word, Op::IMul, &[number, number]);
        a.act(Op::Store, &[counter, value]);
        a.act(Op::Branch, &[merge]);
        a.label(otherwise);
        merges.push(merge);
    }
    for merge in merges.into_iter().rev() {
        a.act(Op::Branch, &[merge]);
        a.label(merge);
    }
    expect(
        a.finish_counter(counter),
        &[(3, 9), (10_229, 10_229 * 10_229), (10_230, 0)],
    );
}

/// Loops in loops, each of which turns once, and some of which count. The count is an element of an
/// array at a place that is computed, so that it stays in memory: values that live over many loops
/// have a test of their own.
#[test]
fn nested_loops() {
    let mut a = Assembler::new();
    let class = StorageClass::Function;
    let two = a.numbers[2];
    let ty = a.global(Op::TypeArray, &[a.word, two]);
    let null = a.value(ty, Op::ConstantNull, &[]);
    let pointer = a.pointer(class, ty);
    let array = a.make(pointer, Op::Variable, &[class as u32, null]);
    a.read();
    let pointer = a.pointer(class, a.word);
    let counter = a.make(pointer, Op::AccessChain, &[array, a.given]);
    let never = a.number(u32::MAX);
    let again = a.make(a.bool, Op::IEqual, &[a.given, never]);
    let mut ends = Vec::new();
    for level in 0..NESTING {
        let (header, inside, target, merge) = (a.id(), a.id(), a.id(), a.id());
        a.act(Op::Branch, &[header]);
        a.label(header);
        let control = LoopControl::NONE.bits();
        a.act(Op::LoopMerge, &[merge, target, control]);
        a.act(Op::Branch, &[inside]);
        a.label(inside);
        if level % 100 == 0 {
            a.count(counter);
        }
        ends.push((header, target, merge));
    }
    for (header, target, merge) in ends.into_iter().rev() {
        a.act(Op::Branch, &[target]);
        a.label(target);
        a.act(Op::BranchConditional, &[again, header, merge]);
        a.label(merge);
    }
    expect(a.finish_counter(counter), &[(0, COUNTING), (1, COUNTING)]);
}

/// A switch each case of which falls into the next one.
#[test]
fn cases_that_fall_through() {
    let mut a = Assembler::new();
    let counter = a.counter();
    a.read();
    let labels: Vec<u32> = (0..NESTING).map(|_| a.id()).collect();
    let merge = a.id();
    let control = SelectionControl::NONE.bits();
    a.act(Op::SelectionMerge, &[merge, control]);
    let cases = (0..NESTING).zip(&labels).flat_map(|(k, &label)| [k, label]);
    let operands: Vec<u32> = [a.given, merge].into_iter().chain(cases).collect();
    a.act(Op::Switch, &operands);
    for (k, &label) in labels.iter().enumerate() {
        a.label(label);
        a.count(counter);
        let next = labels.get(k + 1).copied().unwrap_or(merge);
        a.act(Op::Branch, &[next]);
    }
    a.label(merge);
    expect(
        a.finish_counter(counter),
        &[(0, NESTING), (10_000, 230), (10_229, 1), (10_230, 0)],
    );
}

/// Functions each of which calls the next one.
#[test]
fn chains_of_calls() {
    let mut a = Assembler::new();
    a.read();
    let ty = a.global(Op::TypeFunction, &[a.word, a.word]);
    let functions: Vec<u32> = (0..NESTING).map(|_| a.id()).collect();
    let from = a.body.len();
    for (k, &function) in functions.iter().enumerate() {
        let control = FunctionControl::NONE.bits();
        put(&mut a.body, Op::Function, &[a.word, function, control, ty]);
        let parameter = a.make(a.word, Op::FunctionParameter, &[]);
        let label = a.id();
        a.label(label);
        let one = a.numbers[1];
        let more = a.make(a.word, Op::IAdd, &[parameter, one]);
        let result = match functions.get(k + 1) {
            Some(&callee) => a.make(a.word, Op::FunctionCall, &[callee, more]),
            None => more,
        };
        a.act(Op::ReturnValue, &[result]);
        a.act(Op::FunctionEnd, &[]);
    }
    a.cut_function(from);
    let result = a.make(a.word, Op::FunctionCall, &[functions[0], a.given]);
    expect(a.finish(result), &[(7, 7 + NESTING)]);
}

/// Structures in structures, a constant of the outermost, and its innermost member by a path of as
/// many indices.
#[test]
fn nested_types_and_constants() {
    let mut a = Assembler::new();
    let (mut ty, mut value) = (a.word, a.number(40));
    for level in 0..TYPES {
        let number = a.number(level);
        ty = a.global(Op::TypeStruct, &[a.word, ty]);
        value = a.value(ty, Op::ConstantComposite, &[number, value]);
    }
    let class = StorageClass::Function;
    let pointer = a.pointer(class, ty);
    let variable = a.make(pointer, Op::Variable, &[class as u32, value]);
    let copy = a.make(pointer, Op::Variable, &[class as u32]);
    a.read();
    let whole = a.make(ty, Op::Load, &[variable]);
    a.act(Op::Store, &[copy, whole]);
    let whole = a.make(ty, Op::Load, &[copy]);
    let path: Vec<u32> = std::iter::once(whole)
        .chain(std::iter::repeat_n(1, TYPES as usize))
        .collect();
    let innermost = a.make(a.word, Op::CompositeExtract, &path);
    let outermost = a.make(a.word, Op::CompositeExtract, &[whole, 0]);
    let sum = a.make(a.word, Op::IAdd, &[innermost, outermost]);
    let result = a.make(a.word, Op::IAdd, &[sum, a.given]);
    expect(a.finish(result), &[(1, 1 + 40 + TYPES - 1)]);
}
