//! Strided loads and stores, in every tier, against copies byte by byte.

use std::fmt::Write;

use super::{Bench, on_tiers};
use crate::SUBGROUP_SIZE;
use crate::ir::Type;

const COUNT: usize = 16;
const MEMORY_BYTES: u32 = 2048;

/// A program that copies scalars in workgroup memory in lanes whose input 4 is not zero: from the
/// offset in input 0, as far apart as input 1 says, to the places of inputs 2 and 3.
fn program(ty: Type) -> String {
    let values: Vec<String> = (0..COUNT).map(|k| format!("v{}", 10 + k)).collect();
    let results: Vec<String> = values
        .iter()
        .map(|value| format!("{value}: {ty}"))
        .collect();
    let mut text = format!(
        "module compute
        inputs workgroup_id.0, workgroup_id.1, workgroup_id.2, num_workgroups.0, num_workgroups.1
        output_rows 0
        shared {MEMORY_BYTES}
        func f0 {{\n"
    );
    for input in 0..5 {
        writeln!(text, "v{input}: i32 = input[{input}]").unwrap();
    }
    writeln!(
        text,
        "v5: i32 = const 0
        v6: i1 = ine v4, v5
        if v6, L0 {{
            {} = load.shared.strided v0, v1
            store.shared.strided v2, v3, {}
            br L0
        }} else {{
            br L0
        }}
        end
        }}",
        results.join(", "),
        values.join(", ")
    )
    .unwrap();
    text
}

/// A copy of each lane: from where, by which stride, to where, by which, and whether it is done.
type Copies = [[u32; 5]; SUBGROUP_SIZE];

/// The memory after the copies.
fn copied(memory: &[u8], size: usize, copies: &Copies) -> Vec<u8> {
    let at = |first: u32, stride: u32, k: usize| {
        let at = first.wrapping_add(stride.wrapping_mul(k as u32)) as usize;
        (at + size <= memory.len()).then_some(at..at + size)
    };
    let mut result = memory.to_vec();
    for &[from, stride, to, step, _] in copies.iter().filter(|copy| copy[4] != 0) {
        for k in 0..COUNT {
            let scalar = match at(from, stride, k) {
                Some(range) => memory[range].to_vec(),
                None => vec![0; size],
            };
            if let Some(range) = at(to, step, k) {
                result[range].copy_from_slice(&scalar);
            }
        }
    }
    result
}

#[test]
fn scalars_are_as_far_apart_as_the_stride_says() {
    for ty in [Type::I8, Type::F16, Type::I32] {
        let text = program(ty);
        let size = ty.size_bytes();
        let lane = |k: usize| k as u32 * size;
        // Lines of a matrix; one behind the other, apart, and over each other.
        let line = SUBGROUP_SIZE as u32 * size;
        let mut cases: Vec<Box<dyn Fn(usize) -> [u32; 5]>> = Vec::new();
        for (from, stride) in [(0, line), (size, 48), (7, line + 3), (3, 0), (1999, line)] {
            for to in [1024, 1024 + 7 * line] {
                cases.push(Box::new(move |k| {
                    [from + lane(k), stride, to + lane(k), line, 1]
                }));
            }
        }
        // Places and strides of each lane's own; backwards; from before the beginning.
        cases.push(Box::new(move |k| {
            [(k as u32 * 37) % 500, 5 + k as u32, 1024 + lane(k), line, 1]
        }));
        cases.push(Box::new(move |k| {
            [
                600 + lane(k),
                line.wrapping_neg(),
                1024 + lane(15 - k),
                line,
                1,
            ]
        }));
        cases.push(Box::new(move |k| {
            [
                lane(k).wrapping_sub(2 * line),
                line,
                1024 + lane(k),
                line,
                1,
            ]
        }));
        // Far outside, and some lanes only.
        cases.push(Box::new(move |k| {
            [lane(k), 0x4000_0000, 1024 + lane(k), line, 1]
        }));
        cases.push(Box::new(move |k| {
            [lane(k), line, 1024 + lane(k), line, (k % 3) as u32]
        }));
        for (index, case) in cases.iter().enumerate() {
            let copies: Copies = std::array::from_fn(case);
            let memory: Vec<u8> = (0..MEMORY_BYTES).map(|k| (k * 7 + k / 256) as u8).collect();
            let expected = copied(&memory, size as usize, &copies);
            on_tiers(|tier| {
                let mut bench = Bench::new(&text, tier, 1);
                for (word, bytes) in bench.shared.iter_mut().zip(memory.as_chunks::<8>().0) {
                    *word = u64::from_le_bytes(*bytes);
                }
                for row in 0..5 {
                    bench.input(row, |lane| copies[lane][row]);
                }
                bench.run_to_end();
                let found = bench.shared.iter().flat_map(|word| word.to_le_bytes());
                let found: Vec<u8> = found.collect();
                assert!(found == expected, "{ty}, case {index}, {tier:?}");
            });
        }
    }
}
