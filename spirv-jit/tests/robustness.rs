//! Words that no compiler made: an error, or a program that runs and keeps to what is bound; never
//! a panic.

use fastrand::Rng;
use proptest::prelude::*;
use shaders::corrupt::run::run;
use shaders::corrupt::{corrupt, try_module};
use shaders::request;
use shaders::samples::samples;
use spirv_jit::ir::binary;
use spirv_jit::program::{InputRow, SiteKind, Stage, compile_module, from_bytes};

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

/// The requests that the scheduler of a stage can answer.
fn answers(stage: Stage, kind: &SiteKind) -> bool {
    use Stage::*;
    match kind {
        SiteKind::Barrier => stage.has_workgroups() || stage == TessellationControl,
        SiteKind::BarrierArrive | SiteKind::BarrierWait => stage == Compute,
        SiteKind::RayQueryProceed => true,
        SiteKind::ReportIntersection { .. } => stage == Intersection,
        SiteKind::ReorderThread => stage == RayGeneration,
        SiteKind::ExecuteCallable { .. } => {
            matches!(stage, RayGeneration | ClosestHit | Miss | Callable)
        }
        _ => matches!(stage, RayGeneration | ClosestHit | Miss),
    }
}

/// Modules as a pipeline cache keeps them, in which some bytes are others: refused, or programs
/// that run and that schedulers can serve.
#[test]
fn damaged_modules_of_caches_are_refused_or_fit_their_stage() {
    let kept: Vec<Vec<u8>> = samples()
        .iter()
        .filter_map(|(stage, words)| compile_module(&request(*stage, words)).ok())
        .map(|module| binary::encode(&module))
        .collect();
    let mut random = Rng::with_seed(number("TUFF_SEED").unwrap_or(4));
    let mut taken = 0;
    for round in 0..number("TUFF_CORRUPTIONS").unwrap_or(4000) {
        let mut bytes = kept[random.usize(..kept.len())].clone();
        // The head, which is text, and the names of operations come first.
        let end = match random.bool() {
            true => bytes.len(),
            false => bytes.len().min(400),
        };
        for _ in 0..random.usize(1..=3) {
            let at = random.usize(..end);
            bytes[at] = match random.u8(..4) {
                0 => random.u8(..),
                1 => bytes[at] ^ 1 << random.u8(..8),
                2 => b'0' + random.u8(..10),
                _ => bytes[at].wrapping_add(1),
            };
        }
        let Ok(program) = from_bytes(&bytes) else {
            continue;
        };
        taken += 1;
        let stage = program.stage();
        for site in program.sites() {
            assert!(answers(stage, site), "{round}: {site:?} in {stage:?}");
        }
        for row in program.inputs() {
            if let InputRow::Builtin(builtin, word) = row {
                assert!(*word < builtin.words(), "{round}: {row:?}");
            }
        }
        for word in program.query_words() {
            let words = word.fact.words();
            assert!(usize::from(word.component) < words, "{round}: {word:?}");
        }
        run(&program, &mut random, MARGIN);
    }
    assert!(taken > 100, "{taken}");
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
