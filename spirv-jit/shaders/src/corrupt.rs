//! Corruptions of modules, and compiling and running what comes out: for the tests of robustness
//! and for the fuzz targets.

pub mod run;

use fastrand::Rng;
use spirv_jit::program::Stage;

use crate::code_pages::allow_native_code;
use crate::request;

/// Compiles all the way and [runs](run::run) what is taken; whatever comes out is fine.
pub fn try_module(stage: Stage, words: &[u32], margin: usize) {
    allow_native_code();
    if let Ok(program) = spirv_jit::compile(&request(stage, words)) {
        let seed = words
            .iter()
            .fold(1u64, |seed, &word| seed.rotate_left(7) ^ u64::from(word));
        run::run(&program, &mut Rng::with_seed(seed), margin);
    }
}

/// A word of any kind: small, special, a number, all bits.
fn word(random: &mut Rng) -> u32 {
    match random.u8(..16) {
        0..6 => random.u32(..32),
        6 => u32::MAX - random.u32(..4),
        7 => 1 << random.u32(..32),
        8..11 => (random.u32(..2000) as f32 / 100.0 - 10.0).to_bits(),
        _ => random.u32(..),
    }
}

/// Changes up to three places.
pub fn corrupt(words: &mut Vec<u32>, random: &mut Rng) {
    for _ in 0..random.u8(1..=3) {
        let at = random.usize(..words.len());
        let bound = words.get(3).copied().unwrap_or(1).max(1);
        match random.u8(..10) {
            0 => words[at] = random.u32(..),
            1 => words[at] ^= 1 << random.u32(..32),
            // Another id in bounds: well-formed but ill-typed.
            2..=4 => words[at] = random.u32(..bound),
            5 => words.truncate(at.max(1)),
            6 => {
                let from = random.usize(..words.len());
                words[at] = words[from];
            }
            // An instruction twice, or not at all.
            7 => {
                if let Some((start, end)) = instruction(words, at) {
                    let copy = words[start..end].to_vec();
                    words.splice(start..start, copy);
                }
            }
            8 => {
                if let Some((start, end)) = instruction(words, at) {
                    words.drain(start..end);
                }
            }
            _ => words[at] = words[at].wrapping_add(1),
        }
    }
}

/// The instruction that a word belongs to.
fn instruction(words: &[u32], at: usize) -> Option<(usize, usize)> {
    let mut start = 5;
    loop {
        let count = (*words.get(start)? >> 16) as usize;
        let end = start + count;
        if count == 0 || end > words.len() {
            return None;
        }
        if at < end {
            return (at >= start).then_some((start, end));
        }
        start = end;
    }
}
