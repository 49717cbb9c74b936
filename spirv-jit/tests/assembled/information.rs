//! Debug information whose operands are literals in the places of ids (`OpenCL.DebugInfo.100`).

use rspirv::spirv::Op;

use crate::assembler::Assembler;
use crate::expect;

/// Literals beyond the bound of ids, and one that is the id of a value in another block.
#[test]
fn literals_are_no_ids() {
    for name in ["OpenCL.DebugInfo.100", "DebugInfo"] {
        let mut a = Assembler::new();
        let set = a.import(name);
        a.inform(set, &[1, 1_000_000, 2_000_000, u32::MAX]);
        a.read();
        a.make(a.void, Op::ExtInst, &[set, 2, 1_000_000, 900]);
        let result = a.make(a.word, Op::IMul, &[a.given, a.numbers[7]]);
        expect(&a.finish(result), &[(1, 7), (6, 42)]);
    }
}

/// Sets of instructions that do something are refused where they are not known.
#[test]
fn other_sets_are_refused() {
    let mut a = Assembler::new();
    let set = a.import("OpenCL.std");
    a.read();
    let result = a.make(a.word, Op::ExtInst, &[set, 1, a.given]);
    let words = a.finish(result);
    let request = shaders::request(spirv_jit::program::Stage::Compute, &words);
    let error = spirv_jit::compile(&request).err().expect("an unknown set");
    assert!(error.to_string().contains("OpenCL.std"), "{error}");
}
