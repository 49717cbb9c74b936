//! Words that no compiler made: an error, or a program that runs and keeps to what is bound; never a panic.

use fastrand::Rng;
use proptest::prelude::*;
use shaders::corrupt::{corrupt, try_module};
use shaders::samples::samples;
use spirv_jit::program::Stage;

/// Words around each buffer that programs may not write.
const MARGIN: usize = 1024;

/// A number from the environment.
fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

#[test]
fn corrupted_modules_are_refused_or_compiled() {
    let samples = samples();
    let mut random = Rng::with_seed(number("TUFF_SEED").unwrap_or(0x1234_5678_9abc_def1));
    let rounds = number("TUFF_CORRUPTIONS").unwrap_or(u64::from(effort::rounds(1500)));
    for _ in 0..rounds {
        let (stage, words) = &samples[random.usize(..samples.len())];
        let mut words = words.clone();
        corrupt(&mut words, &mut random);
        try_module(*stage, &words, MARGIN);
    }
}

/// Swaps ids of single operands, which keeps the grammar and breaks the types.
#[test]
fn swapped_operands_are_refused_or_compiled() {
    let samples = samples();
    let mut random = Rng::with_seed(99);
    for _ in 0..effort::rounds(1500) {
        let (stage, words) = &samples[random.usize(..samples.len())];
        let mut words = words.clone();
        let [a, b] = [(); 2].map(|()| random.usize(5..words.len()));
        let small = |word: u32| word < words[3];
        if small(words[a]) && small(words[b]) {
            words.swap(a, b);
        }
        try_module(*stage, &words, MARGIN);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(256)))]

    #[test]
    fn arbitrary_words_are_refused(mut words in prop::collection::vec(any::<u32>(), 0..200)) {
        for (word, start) in words.iter_mut().zip([0x0723_0203, 0x0001_0600, 0, 100, 0]) {
            *word = start;
        }
        try_module(Stage::Compute, &words, MARGIN);
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
        try_module(Stage::Compute, &words, MARGIN);
    }
}
