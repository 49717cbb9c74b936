//! Optimization passes on the IR. Each pass is a verb-object function in a file of that name. The
//! verifier runs between passes in debug builds.
//!
//! [`configure`] disables passes by name, or all `passes` (`TUFF_DISABLE` of the driver), and
//! prints every module to standard error (`TUFF_PRINT`): `ir` before the passes, `pass` after them,
//! and the name of a pass after that pass.

#![forbid(unsafe_code)]

pub mod combine_loads;
mod cost;
mod edit;
mod effects;
pub mod eliminate_common_subexpressions;
pub mod eliminate_dead_code;
mod features;
mod fold_constants;
mod note_effects;
pub mod promote_in_loops;
pub mod promote_variables;
pub mod prune_parameters;
mod renaming;
pub mod resolve_variable_addresses;
mod row_index;
pub mod simplify;
pub mod simplify_control_flow;
mod substitution;
pub mod tabulate_variables;
mod trim_outputs;
mod trim_workgroup_memory;
pub mod unroll_loops;

use std::sync::OnceLock;

use self::features::Features;
use crate::error::{Error, ErrorKind};
use crate::ir::{self, Module, text::print_module};

/// A pass by name.
pub struct Pass {
    pub name: &'static str,
    run: Run,
}

/// The scope of a pass.
enum Run {
    Module(fn(&mut Module)),
    Function(fn(&mut ir::Function)),
}

macro_rules! pass {
    ($kind:ident, $file:ident, $name:ident) => {
        Pass {
            name: stringify!($name),
            run: Run::$kind($file::$name),
        }
    };
}

/// The passes, in no order.
pub const PASSES: &[Pass] = &[
    pass!(Function, simplify, simplify),
    pass!(
        Function,
        resolve_variable_addresses,
        resolve_variable_addresses
    ),
    Pass {
        name: PROMOTE_IN_LOOPS,
        run: Run::Function(|function| {
            promote_in_loops::promote_in_loops(function);
        }),
    },
    pass!(Function, promote_variables, promote_variables),
    pass!(Function, prune_parameters, prune_parameters),
    pass!(Function, simplify_control_flow, simplify_control_flow),
    pass!(
        Function,
        eliminate_common_subexpressions,
        eliminate_common_subexpressions
    ),
    Pass {
        name: UNROLL,
        run: Run::Function(|function| {
            unroll_loops::unroll_loops(function);
        }),
    },
    pass!(Function, eliminate_dead_code, eliminate_dead_code),
    Pass {
        name: COMBINE,
        run: Run::Function(|function| {
            combine_loads::combine_loads(function);
        }),
    },
    pass!(Module, eliminate_dead_code, eliminate_unused_tables),
    pass!(Function, tabulate_variables, tabulate_variables),
];

/// Passes that always run last, once, because later stages rely on their results.
const LAST: &[Pass] = &[
    pass!(Module, trim_outputs, trim_outputs),
    pass!(Module, trim_workgroup_memory, trim_workgroup_memory),
    pass!(Module, note_effects, note_effects),
];

/// The names of all passes of [`run_pass`].
pub fn names() -> impl Iterator<Item = &'static str> {
    PASSES.iter().chain(LAST).map(|pass| pass.name)
}

/// Passes and their conditions.
type Stages = &'static [(When, &'static [&'static str])];

/// Passes before loops are unrolled.
const BEFORE: Stages = &[
    (When::Addresses, &["simplify"]),
    (When::Addresses, ADDRESSES),
    (When::Variables, &["promote_variables"]),
    (
        When::Always,
        &[
            "simplify",
            "simplify_control_flow",
            "prune_parameters",
            "simplify",
            "eliminate_common_subexpressions",
        ],
    ),
];

/// Unrolling, and the passes that benefit from it. Nested loops may be unrolled next.
const ROUND: Stages = &[
    (When::Loops, &[UNROLL]),
    (
        When::Unrolled,
        &[
            "simplify_control_flow",
            "prune_parameters",
            "simplify",
            "simplify_control_flow",
        ],
    ),
    (When::UnrolledAddresses, ADDRESSES),
    (When::UnrolledVariables, &["promote_variables"]),
    (
        When::Unrolled,
        &[
            "prune_parameters",
            "simplify",
            "eliminate_common_subexpressions",
        ],
    ),
];

/// Passes after that, with every fixed row known. Loads with unused results are removed before
/// others are combined.
const AFTER: Stages = &[
    (When::LoopsAndAddresses, &[PROMOTE_IN_LOOPS]),
    (
        When::InLoops,
        &[
            "promote_variables",
            "prune_parameters",
            "simplify",
            "eliminate_common_subexpressions",
        ],
    ),
    (When::Addresses, &["tabulate_variables"]),
    (When::Always, &["eliminate_dead_code", COMBINE]),
    (
        When::Combined,
        &[
            "simplify",
            "eliminate_common_subexpressions",
            "eliminate_dead_code",
        ],
    ),
    (When::Always, &["eliminate_unused_tables"]),
];

/// The condition of a pass.
#[derive(Clone, Copy, PartialEq)]
enum When {
    Always,
    /// The module takes an address of a variable.
    Addresses,
    /// The module accesses a variable.
    Variables,
    /// The module has a loop.
    Loops,
    /// The module has a loop and takes an address of a variable.
    LoopsAndAddresses,
    /// A loop has got variables of its own.
    InLoops,
    /// A loop was unrolled.
    Unrolled,
    /// A loop was unrolled, and the module takes an address of a variable.
    UnrolledAddresses,
    /// A loop was unrolled, and the module accesses a variable.
    UnrolledVariables,
    /// Loads were combined.
    Combined,
}

const UNROLL: &str = "unroll_loops";
const PROMOTE_IN_LOOPS: &str = "promote_in_loops";
const COMBINE: &str = "combine_loads";

/// Resolves addresses to rows and removes the rest of them, so that variables can be promoted.
const ADDRESSES: &[&str] = &["resolve_variable_addresses", "eliminate_dead_code"];

/// All passes in order, as if each had work to do.
pub fn order() -> impl Iterator<Item = &'static str> {
    let stages = [BEFORE, ROUND, AFTER];
    stages
        .into_iter()
        .flatten()
        .flat_map(|(_, names)| *names)
        .copied()
}

/// Runs all passes in order.
///
/// # Errors
/// A module that the verifier refuses: every pass may rely on it.
pub fn optimize(module: &mut Module) -> Result<(), Error> {
    print_if("ir", "lowered", module);
    ir::verify(module).map_err(|message| Error {
        kind: ErrorKind::Invalid,
        word_offset: None,
        message: format!("lowering made an invalid module: {message}"),
    })?;
    run_passes(module);
    print_if("pass", "optimised", module);
    Ok(())
}

/// Largest depth of nested loops that are unrolled.
const MAX_ROUNDS: usize = 3;

fn run_passes(module: &mut Module) {
    run_stages(BEFORE, module);
    for _ in 0..MAX_ROUNDS {
        if !run_stages(ROUND, module) {
            break;
        }
    }
    run_stages(AFTER, module);
    for pass in LAST {
        run_pass(pass.name, module);
    }
}

/// Whether there was a loop to unroll.
fn run_stages(stages: Stages, module: &mut Module) -> bool {
    let mut unrolled = false;
    let (mut in_loops, mut combined) = (false, false);
    for &(when, names) in stages {
        let features = || Features::of(module);
        let runs = match when {
            When::Always => true,
            When::Addresses => features().addresses,
            When::Variables => features().variables,
            When::Loops => features().loops,
            When::LoopsAndAddresses => features().loops && features().addresses,
            When::InLoops => in_loops,
            When::Unrolled => unrolled,
            When::UnrolledAddresses => unrolled && features().addresses,
            When::UnrolledVariables => unrolled && features().variables,
            When::Combined => combined,
        };
        if !runs {
            continue;
        }
        for name in names {
            match *name {
                _ if disabled(name) => {}
                UNROLL => unrolled = run_telling(UNROLL, unroll_loops::unroll_loops, module),
                PROMOTE_IN_LOOPS => {
                    in_loops =
                        run_telling(PROMOTE_IN_LOOPS, promote_in_loops::promote_in_loops, module)
                }
                COMBINE => combined = run_telling(COMBINE, combine_loads::combine_loads, module),
                _ => {
                    run_pass(name, module);
                }
            }
        }
    }
    unrolled
}

/// Runs a pass on all functions. Returns whether it changed any.
fn run_telling(name: &str, run: fn(&mut ir::Function) -> bool, module: &mut Module) -> bool {
    let mut did = false;
    for function in &mut module.functions {
        did |= run(function);
    }
    print_if(name, name, module);
    check(name, module);
    did
}

/// Whether a name in `TUFF_DISABLE` is that of a pass, or `passes`: all of them.
pub fn is_switch(name: &str) -> bool {
    name == "passes" || PASSES.iter().any(|pass| pass.name == name)
}

/// The process's configuration: names of passes to skip, and of passes after which modules are
/// printed.
#[derive(Default)]
struct Wishes {
    disabled: Vec<String>,
    printed: Vec<String>,
}

static WISHES: OnceLock<Wishes> = OnceLock::new();

/// Sets the passes to skip and to print after, as comma-separated lists of `TUFF_DISABLE` and
/// `TUFF_PRINT`. Only the first call has an effect, and only before a module is compiled.
pub fn configure(disabled: &str, printed: &str) {
    let names = |list: &str| list.split(',').map(|name| name.trim().to_owned()).collect();
    // A later call has no effect, so that all modules of a process are compiled alike.
    let _ = WISHES.set(Wishes {
        disabled: names(disabled),
        printed: names(printed),
    });
}

/// Whether a pass, or every pass, is skipped.
fn disabled(name: &str) -> bool {
    let wishes = WISHES.get_or_init(Wishes::default);
    (wishes.disabled.iter()).any(|switch| switch == name || switch == "passes")
}

/// Runs one pass by name. Returns false for an unknown name.
pub fn run_pass(name: &str, module: &mut Module) -> bool {
    let mut known = PASSES.iter().chain(LAST);
    let Some(pass) = known.find(|pass| pass.name == name) else {
        return false;
    };
    match pass.run {
        Run::Module(run) => run(module),
        Run::Function(run) => module.functions.iter_mut().for_each(run),
    }
    print_if(name, name, module);
    check(name, module);
    true
}

fn check(after: &str, module: &Module) {
    if cfg!(debug_assertions)
        && let Err(message) = ir::verify(module)
    {
        panic!("after {after}: {message}\n{}", print_module(module));
    }
}

/// Prints the module if [`configure`] asked for it.
fn print_if(switch: &str, title: &str, module: &Module) {
    let wishes = WISHES.get_or_init(Wishes::default);
    if wishes.printed.iter().any(|wanted| wanted == switch) {
        eprintln!("; {title}\n{}", print_module(module));
    }
}
