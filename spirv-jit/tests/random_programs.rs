//! Random structured programs: what the passes make of one must do the same on every tier as it did
//! before, in every lane and bit, with native code and without.
//!
//! `TUFF_SEED=N` runs one program and prints it; `TUFF_CASES=N` sets how many are made, from the
//! first or, with both, from that seed.

mod observe;
mod random;

use observe::{Outcome, execute, execute_interpreted_on, execute_on};
use spirv_jit::Tier;
use spirv_jit::ir::Module;
use spirv_jit::ir::text::{parse_module, print_module};
use spirv_jit::ir::verify;
use spirv_jit::pass::{optimize, order, run_pass};

/// The first pass after which the program does something else, by applying the passes in their
/// order.
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
    for &tier in Tier::available() {
        let interpreted = execute_interpreted_on(tier, &optimised, seed);
        assert_eq!(interpreted, expected, "seed {seed} interpreted on {tier:?}");
        let actual = execute_on(tier, &optimised, seed, None);
        if actual != expected {
            let culprit = find_culprit(&original, seed, &expected);
            panic!("seed {seed} on {tier:?}: {culprit}\n{expected:?}\n{actual:?}");
        }
    }
}

#[test]
fn passes_keep_what_programs_do() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let (seed, cases) = (number("TUFF_SEED"), number("TUFF_CASES"));
    if let (Some(seed), None) = (seed, cases) {
        eprintln!("{}", print_module(&random::random_module(seed)));
        return check(seed);
    }
    let first = seed.unwrap_or(0);
    (first..first + cases.unwrap_or(u64::from(effort::rounds(2_000)))).for_each(check);
}
