//! Random structured programs: what the passes make of one must do the same as it did before, in every lane and bit.
//!
//! `TUFF_SEED=N` runs one program and prints it; `TUFF_CASES=N` sets how many are made.

mod observe;
mod random;

use observe::{Outcome, execute};
use spirv_jit::ir::Module;
use spirv_jit::ir::text::{parse_module, print_module};
use spirv_jit::ir::verify;
use spirv_jit::pass::{optimize, order, run_pass};

/// The first pass after which the program does something else, by applying the passes in their order.
fn find_culprit(original: &Module, seed: u64, expected: &Outcome) -> String {
    let mut module = original.clone();
    for name in order() {
        let before = print_module(&module);
        run_pass(name, &mut module);
        if execute(&module, seed, None) != *expected {
            return format!(
                "{name} makes of\n{before}\nthis:\n{}",
                print_module(&module)
            );
        }
    }
    "no single pass".into()
}

fn check(seed: u64) {
    let original = random::random_module(seed);
    if let Err(message) = verify(&original) {
        panic!("seed {seed}: {message}\n{}", print_module(&original));
    }
    assert_eq!(
        parse_module(&print_module(&original)).as_ref(),
        Ok(&original)
    );
    let expected = execute(&original, seed, None);
    let mut optimised = original.clone();
    optimize(&mut optimised).unwrap();
    let actual = execute(&optimised, seed, None);
    if actual != expected {
        let culprit = find_culprit(&original, seed, &expected);
        panic!("seed {seed}: {culprit}\n{expected:?}\n{actual:?}");
    }
}

#[test]
fn passes_keep_what_programs_do() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    if let Some(seed) = number("TUFF_SEED") {
        eprintln!("{}", print_module(&random::random_module(seed)));
        check(seed);
        return;
    }
    (0..number("TUFF_CASES").unwrap_or(2_000)).for_each(check);
}
