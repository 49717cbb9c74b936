//! Values of more scalars than are taken apart: made, moved, chosen, given to functions, and
//! refused beyond a frame's bound.

use rspirv::spirv::{FunctionControl, Op, SelectionControl, StorageClass};
use shaders::request;
use spirv_jit::program::Stage;

use crate::assembler::{Assembler, put};
use crate::expect;

/// Elements of an array of words that is taken apart no more.
const COUNT: u32 = 20_001;

/// An array of words, and a pointer to one of a function.
fn array(a: &mut Assembler, count: u32) -> (u32, u32) {
    let count = a.number(count);
    let ty = a.global(Op::TypeArray, &[a.word, count]);
    (ty, a.pointer(StorageClass::Function, ty))
}

fn variable(a: &mut Assembler, pointer: u32, initializer: &[u32]) -> u32 {
    let class = StorageClass::Function as u32;
    a.make(pointer, Op::Variable, &[&[class], initializer].concat())
}

/// An element at the place that the word says.
fn element(a: &mut Assembler, array: u32) -> u32 {
    let pointer = a.pointer(StorageClass::Function, a.word);
    a.make(pointer, Op::AccessChain, &[array, a.given])
}

#[test]
fn null_is_zero_everywhere() {
    let mut a = Assembler::new();
    let (ty, pointer) = array(&mut a, COUNT);
    let null = a.value(ty, Op::ConstantNull, &[]);
    let array = variable(&mut a, pointer, &[null]);
    a.read();
    let at = element(&mut a, array);
    let before = a.make(a.word, Op::Load, &[at]);
    let five = a.make(a.word, Op::IAdd, &[before, a.numbers[5]]);
    a.act(Op::Store, &[at, five]);
    let after = a.make(a.word, Op::Load, &[at]);
    expect(&a.finish(after), &[(0, 5), (16_384, 5), (COUNT - 1, 5)]);
}

/// A constant table goes through variables, a composite and a function that chooses between two.
#[test]
fn values_go_where_others_go() {
    let mut a = Assembler::new();
    let (ty, pointer) = array(&mut a, COUNT);
    let numbers: Vec<u32> = (0..COUNT).map(|k| a.number(3 * k + 1)).collect();
    let table = a.value(ty, Op::ConstantComposite, &numbers);
    let null = a.value(ty, Op::ConstantNull, &[]);
    let pair = a.global(Op::TypeStruct, &[ty, a.word, ty]);
    let pairs = a.pointer(StorageClass::Function, pair);
    // `value(bool first, T a, T b) { if (first) return a; return b; }`
    let signature = a.global(Op::TypeFunction, &[ty, a.bool, ty, ty]);
    let (choose, from) = (a.id(), a.body.len());
    let control = FunctionControl::NONE.bits();
    let head = [ty, choose, control, signature];
    put(&mut a.body, Op::Function, &head);
    let first = a.make(a.bool, Op::FunctionParameter, &[]);
    let one = a.make(ty, Op::FunctionParameter, &[]);
    let other = a.make(ty, Op::FunctionParameter, &[]);
    let [entry, inside, merge] = [(); 3].map(|()| a.id());
    a.label(entry);
    let control = SelectionControl::NONE.bits();
    a.act(Op::SelectionMerge, &[merge, control]);
    a.act(Op::BranchConditional, &[first, inside, merge]);
    a.label(inside);
    a.act(Op::ReturnValue, &[one]);
    a.label(merge);
    a.act(Op::ReturnValue, &[other]);
    a.act(Op::FunctionEnd, &[]);
    a.cut_function(from);

    let copied = variable(&mut a, pointer, &[table]);
    let target = variable(&mut a, pairs, &[]);
    let last = variable(&mut a, pointer, &[null]);
    a.read();
    let whole = a.make(ty, Op::Load, &[copied]);
    let limit = a.number(10_000);
    let low = a.make(a.bool, Op::ULessThan, &[a.given, limit]);
    let zeros = a.make(ty, Op::CopyObject, &[null]);
    let inserted = a.make(ty, Op::CompositeInsert, &[a.numbers[7], zeros, 12_000]);
    let chosen = a.make(ty, Op::FunctionCall, &[choose, low, whole, inserted]);
    let both = a.make(
        pair,
        Op::CompositeConstruct,
        &[chosen, a.numbers[2], inserted],
    );
    a.act(Op::Store, &[target, both]);
    let back = a.make(pair, Op::Load, &[target]);
    let part = a.make(ty, Op::CompositeExtract, &[back, 0]);
    let two = a.make(a.word, Op::CompositeExtract, &[back, 1]);
    let selected = a.make(ty, Op::Select, &[low, part, part]);
    a.act(Op::Store, &[last, selected]);
    let at = element(&mut a, last);
    let found = a.make(a.word, Op::Load, &[at]);
    let seven = a.make(a.word, Op::CompositeExtract, &[back, 2, 12_000]);
    let constant = a.make(a.word, Op::CompositeExtract, &[table, 20_000]);
    let mut sum = a.make(a.word, Op::IAdd, &[found, two]);
    for more in [seven, constant] {
        sum = a.make(a.word, Op::IAdd, &[sum, more]);
    }
    let rest = 2 + 7 + 60_001;
    let cases = [
        (0, 1 + rest),
        (9_999, 29_998 + rest),
        (12_000, 7 + rest),
        (12_001, rest),
    ];
    expect(&a.finish(sum), &cases);
}

/// Parts that are taken apart make up a value that is not.
#[test]
fn small_parts_make_a_large_value() {
    let mut a = Assembler::new();
    let (part, parts) = array(&mut a, 5_000);
    let four = a.numbers[4];
    let ty = a.global(Op::TypeArray, &[part, four]);
    let pointer = a.pointer(StorageClass::Function, ty);
    let numbers: Vec<u32> = (0..5_000).map(|k| a.number(k)).collect();
    let table = a.value(part, Op::ConstantComposite, &numbers);
    let null = a.value(part, Op::ConstantNull, &[]);
    let from = variable(&mut a, parts, &[table]);
    let array = variable(&mut a, pointer, &[]);
    a.read();
    let loaded = a.make(part, Op::Load, &[from]);
    let whole = a.make(ty, Op::CompositeConstruct, &[null, loaded, table, null]);
    let whole = a.make(ty, Op::CompositeInsert, &[loaded, whole, 3]);
    a.act(Op::Store, &[array, whole]);
    let word = a.pointer(StorageClass::Function, a.word);
    let mut sum = a.numbers[0];
    for k in 0..4 {
        let at = a.make(word, Op::AccessChain, &[array, a.numbers[k], a.given]);
        let found = a.make(a.word, Op::Load, &[at]);
        sum = a.make(a.word, Op::IAdd, &[sum, found]);
    }
    expect(&a.finish(sum), &[(0, 0), (1, 3), (4_999, 3 * 4_999)]);
}

/// A loop hands two values on, and swaps them in each turn.
#[test]
fn values_change_places_in_a_loop() {
    let mut a = Assembler::new();
    let (ty, pointer) = array(&mut a, COUNT);
    let zero = a.value(ty, Op::ConstantNull, &[]);
    let last = variable(&mut a, pointer, &[]);
    a.read();
    let entry = a.id();
    a.act(Op::Branch, &[entry]);
    a.label(entry);
    let marked = a.make(ty, Op::CompositeInsert, &[a.numbers[9], zero, 20_000]);
    let [header, target, merge, x, y, turn, next] = [(); 7].map(|()| a.id());
    a.act(Op::Branch, &[header]);
    a.label(header);
    put(&mut a.body, Op::Phi, &[ty, x, marked, entry, y, target]);
    put(&mut a.body, Op::Phi, &[ty, y, zero, entry, x, target]);
    let count = [a.word, turn, a.numbers[0], entry, next, target];
    put(&mut a.body, Op::Phi, &count);
    let goes_on = a.make(a.bool, Op::ULessThan, &[turn, a.given]);
    a.act(Op::LoopMerge, &[merge, target, 0]);
    a.act(Op::BranchConditional, &[goes_on, target, merge]);
    a.label(target);
    let sum = [a.word, next, turn, a.numbers[1]];
    put(&mut a.body, Op::IAdd, &sum);
    a.act(Op::Branch, &[header]);
    a.label(merge);
    a.act(Op::Store, &[last, x]);
    let end = a.number(20_000);
    let pointer = a.pointer(StorageClass::Function, a.word);
    let at = a.make(pointer, Op::AccessChain, &[last, end]);
    let result = a.make(a.word, Op::Load, &[at]);
    expect(&a.finish(result), &[(0, 9), (1, 0), (2, 9), (7, 0)]);
}

/// The message says how much is allowed; no memory is taken for what is not.
#[test]
fn larger_values_are_refused() {
    for count in [300_000, u32::MAX] {
        let mut a = Assembler::new();
        let (ty, pointer) = array(&mut a, count);
        let null = a.value(ty, Op::ConstantNull, &[]);
        let array = variable(&mut a, pointer, &[null]);
        a.read();
        let at = element(&mut a, array);
        let result = a.make(a.word, Op::Load, &[at]);
        let words = a.finish(result);
        let error = spirv_jit::compile(&request(Stage::Compute, &words)).err();
        let error = error.expect("a variable beyond the bound").to_string();
        assert!(error.contains("262144 words"), "{error}");
    }
}
