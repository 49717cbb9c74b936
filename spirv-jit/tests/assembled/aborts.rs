//! Invocations that abort with a message (`SPV_KHR_abort`).

use std::sync::Arc;

use rspirv::spirv::{BuiltIn, Decoration, Op, SelectionControl, StorageClass};
use shaders::compute::{Memory, compile, dispatch, dispatch_until};
use shaders::request;
use spirv_jit::abort::{Aborts, MAX_MESSAGE_BYTES};
use spirv_jit::program::Stage;

use crate::assembler::Assembler;

const CAPABILITY: u32 = 5120;
const ABORT: u32 = 5121;

/// A module whose invocations of these numbers, counted from 1, abort: with a structure of the
/// number and, at an offset, another word. Others write 7.
fn module(a: Assembler, offset: u32) -> Vec<u32> {
    let mut a = a;
    a.invocations = 40;
    let class = StorageClass::Input;
    let of_input = a.pointer(class, a.word);
    let index = a.value(of_input, Op::Variable, &[class as u32]);
    let builtin = BuiltIn::LocalInvocationIndex as u32;
    a.decorate(index, Decoration::BuiltIn, &[builtin]);
    a.interface.push(index);
    let message = a.global(Op::TypeStruct, &[a.word, a.word]);
    let laid_out = a.global(Op::TypeStruct, &[a.word, a.word]);
    a.decorate_member(laid_out, 0, Decoration::Offset, &[0]);
    a.decorate_member(laid_out, 1, Decoration::Offset, &[offset]);
    a.read();
    let index = a.make(a.word, Op::Load, &[index]);
    let number = a.make(a.word, Op::IAdd, &[index, a.numbers[1]]);
    let aborts = a.make(a.bool, Op::IEqual, &[number, a.given]);
    let (then, after) = (a.id(), a.id());
    let made = a.make(message, Op::CompositeConstruct, &[number, a.numbers[9]]);
    let none = SelectionControl::NONE.bits();
    a.act(Op::SelectionMerge, &[after, none]);
    a.act(Op::BranchConditional, &[aborts, then, after]);
    a.label(then);
    a.act_newer(ABORT, &[laid_out, made]);
    a.label(after);
    let result = a.numbers[7];
    a.finish(result)
}

fn declared() -> Assembler {
    let mut a = Assembler::new();
    a.newer_capability(CAPABILITY);
    a
}

/// Runs a module; gives the messages, and what it wrote.
fn run(words: &[u32], given: u32, takes: bool) -> (Vec<u8>, u32) {
    let aborts = Arc::new(Aborts::new().unwrap());
    let mut memory = Memory {
        buffers: vec![(0, vec![given]), (16, vec![0])],
        ..Memory::default()
    };
    let program = compile(words);
    match takes {
        true => dispatch_until(&program, 1, &mut memory, &aborts),
        false => dispatch(&program, 1, &mut memory),
    }
    let messages = aborts.with_messages(<[u8]>::to_vec);
    assert_eq!(aborts.happened(), !messages.is_empty());
    (messages, memory.buffers[1].1[0])
}

#[test]
fn an_invocation_ends_with_its_message() {
    let words = module(declared(), 12);
    let (messages, written) = run(&words, 33, true);
    let mut expected = 16u64.to_ne_bytes().to_vec();
    for word in [33u32, 0, 0, 9] {
        expected.extend(word.to_ne_bytes());
    }
    assert_eq!((messages, written), (expected, 7));
    let (messages, written) = run(&words, 99, true);
    assert_eq!((messages, written), (Vec::new(), 7));
    // Where the feature is off.
    let (messages, written) = run(&words, 33, false);
    assert_eq!((messages, written), (Vec::new(), 7));
}

/// The message with which a module is refused.
fn refused(words: &[u32]) -> String {
    let error = spirv_jit::compile(&request(Stage::Compute, words)).err();
    error.expect("refused").to_string()
}

#[test]
fn aborts_that_are_refused() {
    let message = refused(&module(Assembler::new(), 4));
    assert!(message.contains("needs the capability"), "{message}");
    let most = MAX_MESSAGE_BYTES as u32 - 4;
    assert!(run(&module(declared(), most), 5, true).0.len() == 8 + most as usize + 4);
    for offset in [most + 1, u32::MAX] {
        let message = refused(&module(declared(), offset));
        assert!(message.contains("abort message of"), "{message}");
    }
    for operands in [0, 1, 3] {
        let mut a = declared();
        let operands = vec![a.word; operands];
        a.act_newer(ABORT, &operands);
        let next = a.id();
        a.label(next);
        let result = a.numbers[0];
        let message = refused(&a.finish(result));
        assert!(message.contains("5121"), "{message}");
    }
    // A word in the place of two.
    let mut a = declared();
    let ty = a.global(Op::TypeStruct, &[a.word, a.word]);
    let operands = [ty, a.numbers[1]];
    a.act_newer(ABORT, &operands);
    let next = a.id();
    a.label(next);
    let result = a.numbers[0];
    let message = refused(&a.finish(result));
    assert!(message.contains("type"), "{message}");
}
