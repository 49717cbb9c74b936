//! Corruptions of modules, and compiling and running what comes out: for the tests of robustness and for the fuzz targets.

pub mod run;

use std::sync::Arc;

use rspirv::spirv::Capability;
use spirv_jit::ir::op::DescriptorBinding;
use spirv_jit::program::Stage;
use spirv_jit::{CompileRequest, Program};

/// Compiles all the way and [runs](run::run) what is taken; whatever comes out is fine.
pub fn try_module(stage: Stage, words: &[u32], margin: usize) {
    if let Some(program) = try_compile(stage, words) {
        let seed = words
            .iter()
            .fold(1u64, |seed, &word| seed.rotate_left(7) ^ u64::from(word));
        run::run(&program, &mut Random(seed | 1), margin);
    }
}

fn try_compile(stage: Stage, words: &[u32]) -> Option<Arc<Program>> {
    let capabilities: Vec<Capability> = (0..8000).filter_map(Capability::from_u32).collect();
    let bindings = |set: u32, binding: u32| {
        Some(DescriptorBinding {
            set,
            first: binding.wrapping_mul(16),
            count: 16,
            dynamic: false,
        })
    };
    let request = CompileRequest {
        words,
        entry_point: "main",
        stage,
        specialization: &[],
        bindings: &bindings,
        capabilities: &capabilities,
        accuracy: spirv_jit::Accuracy::Spec,
        checks_alignment: false,
    };
    spirv_jit::compile(&request).ok()
}

/// A small generator of its own: the same corruptions on every run.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A word of any kind: small, special, a number, all bits.
    pub fn word(&mut self) -> u32 {
        let bits = self.next();
        match bits >> 60 {
            0..6 => (bits % 32) as u32,
            6 => u32::MAX - (bits % 4) as u32,
            7 => 1 << (bits % 32),
            8..11 => ((bits % 2000) as f32 / 100.0 - 10.0).to_bits(),
            _ => bits as u32,
        }
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

/// Changes up to three places.
pub fn corrupt(words: &mut Vec<u32>, random: &mut Random) {
    for _ in 0..1 + random.below(3) {
        let at = random.below(words.len());
        let bound = words.get(3).copied().unwrap_or(1).max(1);
        match random.below(10) {
            0 => words[at] = random.next() as u32,
            1 => words[at] ^= 1 << random.below(32),
            // Another id in bounds: well-formed but ill-typed.
            2..=4 => words[at] = (random.next() % bound as u64) as u32,
            5 => words.truncate(at.max(1)),
            6 => {
                let from = random.below(words.len());
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
