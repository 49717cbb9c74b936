//! Words that no compiler made: an error, never a panic.

mod support;

use proptest::prelude::*;
use spirv_jit::program::Stage;
use spirv_jit::{CompileRequest, Program};
use support::{all_capabilities, bindings, glsl};

/// Compiles all the way; whatever comes out is fine.
fn try_compile(stage: Stage, words: &[u32]) {
    let capabilities = all_capabilities();
    let request = CompileRequest {
        words,
        entry_point: "main",
        stage,
        specialization: &[],
        bindings: &bindings,
        capabilities: &capabilities,
        accuracy: spirv_jit::Accuracy::Spec,
    };
    let _: Result<std::sync::Arc<Program>, _> = spirv_jit::compile(&request);
}

fn samples() -> Vec<(Stage, Vec<u32>)> {
    let compute = [
        include_str!("shaders/arithmetic.comp"),
        include_str!("shaders/images.comp"),
        include_str!("shaders/memory.comp"),
        include_str!("shaders/subgroups.comp"),
    ];
    let mut samples: Vec<_> = compute
        .iter()
        .map(|source| (Stage::Compute, glsl(Stage::Compute, source)))
        .collect();
    let control = "layout(set = 0, binding = 0) buffer B { int data[]; };
        int f(int x, inout int y) { for (int i = 0; i < x; i++) { if (i == y) continue; switch (i) { case 1: y++; case 2: return y; default: break; } y += i; } return y; }
        void main() { int y = data[0]; data[1] = f(data[2], y); data[y] = y > 3 && data[4] < 2 ? 1 : f(3, y); }";
    samples.push((Stage::Compute, glsl(Stage::Compute, control)));
    let hit = "layout(location = 0) rayPayloadInEXT vec4 payload; hitAttributeEXT vec2 b;
        layout(shaderRecordEXT) buffer R { vec4 tint; };
        void main() { payload += tint * b.x; if (b.y > 0.5) ignoreIntersectionEXT; if (payload.x > 1.0) terminateRayEXT; }";
    samples.push((Stage::AnyHit, glsl(Stage::AnyHit, hit)));
    samples
}

/// A small generator of its own: the same corruptions on every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

fn corrupt(words: &mut Vec<u32>, random: &mut Random) {
    for _ in 0..1 + random.below(3) {
        let at = random.below(words.len());
        let bound = words.get(3).copied().unwrap_or(1).max(1);
        match random.below(8) {
            0 => words[at] = random.next() as u32,
            1 => words[at] ^= 1 << random.below(32),
            // Another id in bounds: well-formed but ill-typed.
            2..=4 => words[at] = (random.next() % bound as u64) as u32,
            5 => words.truncate(at.max(1)),
            6 => {
                let from = random.below(words.len());
                words[at] = words[from];
            }
            _ => words[at] = words[at].wrapping_add(1),
        }
    }
}

#[test]
fn corrupted_modules_are_refused_or_compiled() {
    let samples = samples();
    let mut random = Random(0x1234_5678_9abc_def1);
    let rounds = std::env::var("TUFF_CORRUPTIONS").map_or(1500, |count| count.parse().unwrap());
    for _ in 0..rounds {
        let (stage, words) = &samples[random.below(samples.len())];
        let mut words = words.clone();
        corrupt(&mut words, &mut random);
        try_compile(*stage, &words);
    }
}

/// Swaps ids of single operands, which keeps the grammar and breaks the types.
#[test]
fn swapped_operands_are_refused_or_compiled() {
    let samples = samples();
    let mut random = Random(99);
    for _ in 0..1500 {
        let (stage, words) = &samples[random.below(samples.len())];
        let mut words = words.clone();
        let (a, b) = (
            5 + random.below(words.len() - 5),
            5 + random.below(words.len() - 5),
        );
        let small = |word: u32| word < words[3];
        if small(words[a]) && small(words[b]) {
            words.swap(a, b);
        }
        try_compile(*stage, &words);
    }
}

proptest! {
    #[test]
    fn arbitrary_words_are_refused(mut words in prop::collection::vec(any::<u32>(), 0..200)) {
        for (word, start) in words.iter_mut().zip([0x0723_0203, 0x0001_0600, 0, 100, 0]) {
            *word = start;
        }
        try_compile(Stage::Compute, &words);
    }

    #[test]
    fn arbitrary_instructions_are_refused(
        instructions in prop::collection::vec((0u32..450, prop::collection::vec(0u32..40, 0..6)), 0..60),
    ) {
        let mut words = vec![0x0723_0203, 0x0001_0600, 0, 40, 0];
        for (opcode, operands) in instructions {
            words.push((operands.len() as u32 + 1) << 16 | opcode);
            words.extend(operands);
        }
        try_compile(Stage::Compute, &words);
    }
}
