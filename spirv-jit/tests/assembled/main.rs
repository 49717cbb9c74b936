//! Modules written instruction by instruction: forms that compilers of GLSL do not make.

mod aborts;
mod assembler;
mod bfloat16;
mod constant_data;
mod cooperative_matrices;
mod cooperative_vectors;
mod denormals;
mod depth;
mod heaps;
mod indexing;
mod information;
mod large;
mod long_vectors;
mod meets;
mod split_barriers;
mod untyped;

use shaders::compute::{Memory, compile, dispatch};

/// The results of a module for each of some words.
fn expect(words: &[u32], cases: &[(u32, u32)]) {
    let program = compile(words);
    for &(given, result) in cases {
        let mut memory = Memory {
            buffers: vec![(0, vec![given]), (16, vec![0])],
            ..Memory::default()
        };
        dispatch(&program, 1, &mut memory);
        assert_eq!(memory.buffers[1].1, [result], "for {given}");
    }
}
