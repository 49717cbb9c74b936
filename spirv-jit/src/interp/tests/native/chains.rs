//! Long chains of dependent operations, which code computes for several halves of subgroups in
//! turn.

use std::fmt::Write;

use super::{Writer, check};
use crate::ir::Type;

/// Operations of a chain.
const LENGTH: usize = 150;

#[test]
fn words() {
    let mut w = Writer::new(3, 2);
    let [x, y, z] = [0, 1, 2].map(|k| w.line(Type::I32, &format!("input[{k}]")));
    let mut chain = x;
    for k in 0..LENGTH {
        chain = match k % 3 {
            0 => w.op(Type::I32, "imul", &[&chain, &y]),
            1 => w.op(Type::I32, "iadd", &[&chain, &z]),
            _ => w.op(Type::I32, "xor", &[&chain, &y]),
        };
    }
    let is_less = w.op(Type::I1, "slt", &[&chain, &z]);
    let chosen = w.op(Type::I32, "select", &[&is_less, &y, &chain]);
    check(w, &[chain, chosen], &[false, false]);
}

#[test]
fn floats() {
    let mut w = Writer::new(3, 1);
    let [x, y, z] = [0, 1, 2].map(|k| w.line(Type::F32, &format!("input[{k}]")));
    let mut chain = x;
    for k in 0..LENGTH {
        chain = match k % 4 {
            0 => w.op(Type::F32, "ffma", &[&chain, &y, &z]),
            1 => w.op(Type::F32, "fdiv", &[&z, &chain]),
            2 => w.op(Type::F32, "fmin", &[&chain, &y]),
            _ => w.op(Type::F32, "ffract", &[&chain]),
        };
    }
    check(w, &[chain], &[true]);
}

/// Rows of 64-bit lanes are two, and those of conversions differ in length.
#[test]
fn long_words() {
    let mut w = Writer::new(3, 2);
    let [x, y, z] = [0, 1, 2].map(|k| w.line(Type::I32, &format!("input[{k}]")));
    let factor = w.op(Type::I64, "pack64", &[&y, &z]);
    let mut chain = w.op(Type::I64, "sconvert", &[&x]);
    for k in 0..LENGTH {
        chain = match k % 5 {
            0 => w.op(Type::I64, "imul", &[&chain, &factor]),
            1 => w.op(Type::I64, "iadd", &[&chain, &factor]),
            2 => {
                let low = w.op(Type::I32, "uconvert", &[&chain]);
                w.op(Type::I64, "uconvert", &[&low])
            }
            3 => w.op(Type::I64, "imul", &[&chain, &chain]),
            _ => w.op(Type::I64, "xor", &[&chain, &factor]),
        };
    }
    let outputs = w.words(&chain);
    check(w, &outputs, &[false, false]);
}

/// Each result is rounded, whether the next operation takes it as it was rounded or from its row.
#[test]
fn halves() {
    let mut w = Writer::new(3, 3);
    let [x, y, z] = [0, 1, 2].map(|k| {
        let word = w.line(Type::I32, &format!("input[{k}]"));
        let short = w.op(Type::I16, "uconvert", &[&word]);
        w.op(Type::F16, "bitcast", &[&short])
    });
    let (mut chain, mut bits) = (x, Vec::new());
    for k in 0..LENGTH {
        chain = match k % 7 {
            0 => w.op(Type::F16, "fadd", &[&chain, &y]),
            1 => w.op(Type::F16, "fmul", &[&chain, &chain]),
            2 => {
                let wide = w.op(Type::F32, "fconvert", &[&chain]);
                let sum = w.op(Type::F32, "fadd", &[&wide, &wide]);
                w.op(Type::F16, "fconvert", &[&sum])
            }
            3 => w.op(Type::F16, "fneg", &[&chain]),
            4 => w.op(Type::F16, "fsub", &[&z, &chain]),
            5 => w.op(Type::F16, "ffma", &[&chain, &z, &y]),
            _ => w.op(Type::F16, "fmin", &[&chain, &z]),
        };
        if k % 50 == 20 {
            let short = w.bits(Type::F16, &chain);
            bits.push(w.op(Type::I32, "uconvert", &[&short]));
        }
    }
    check(w, &bits, &[false; 3]);
}

/// A chain in a branch ends with copies for the lanes that took it.
#[test]
fn copies_for_active_lanes() {
    let mut w = Writer::new(3, 1);
    let [x, y, z] = [0, 1, 2].map(|k| w.line(Type::I32, &format!("input[{k}]")));
    let condition = w.op(Type::I1, "slt", &[&x, &y]);
    let chosen = format!("v{}", w.next);
    w.next += 1;
    writeln!(w.text, "if {condition}, L0 -> ({chosen}: i32) {{").unwrap();
    let mut chain = x.clone();
    for k in 0..LENGTH {
        let operand = if k % 2 == 0 { &y } else { &z };
        let name = ["imul", "iadd", "xor"][k % 3];
        chain = w.op(Type::I32, name, &[&chain, operand]);
    }
    writeln!(w.text, "br L0({chain})\n}} else {{\nbr L0({z})\n}}").unwrap();
    let sum = w.op(Type::I32, "iadd", &[&chosen, &y]);
    check(w, &[sum], &[false]);
}
