//! Runs the files in `filetests/`: a module, what to do with it, and what must come out.
//!
//! ```text
//! ; What this case shows.
//! pass promote_variables, eliminate_dead_code
//! run 5, 0xffffffff -> 4, 0x3f800000
//!
//! module compute
//! …
//!
//! expect
//!
//! module compute
//! …
//! ```
//!
//! A `run` line gives words for the input rows and the output words that must come of them,
//! computed by hand. Besides, every module runs on made-up inputs as it is, after its passes and
//! after all passes, and must do the same.
//!
//! `native avx2` in place of `pass` expects the listing of the module's native code. `lower`
//! expects the IR of SPIR-V in the syntax of `spirv-as`: a compute shader's body, between the
//! declarations in `filetests/lower/prelude.txt` and the store of `%result`. Lines above one that
//! says `main` are more declarations. A `run` line then gives the words `%x` and `%y`, and the
//! result.
//!
//! `TUFF_BLESS=1 cargo test -p spirv-jit --test filetests` rewrites the expectations; read the
//! difference before you commit it.

mod observe;
mod spirv_text;

use std::path::{Path, PathBuf};

use observe::{Outcome, execute, execute_on};
use shaders::compute::{Memory, dispatch};
use spirv_jit::ir::text::{parse_module, print_module};
use spirv_jit::ir::{Module, verify};
use spirv_jit::pass::{self, optimize, run_pass};
use spirv_jit::program::Stage;
use spirv_jit::{Program, Tier};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("filetests")
}

fn files() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = ["", "lower", "native"]
        .into_iter()
        .flat_map(|folder| std::fs::read_dir(root().join(folder)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ir"))
        .collect();
    files.sort();
    files
}

/// A file's task.
enum Task<'a> {
    Pass(Vec<&'a str>),
    Lower,
    Native(Tier),
}

/// A case's parts: comment, task and `run` lines, input, expectation.
struct FileTest<'a> {
    head: &'a str,
    task: Task<'a>,
    /// Inputs and outputs.
    runs: Vec<(Vec<u32>, Vec<u32>)>,
    input: &'a str,
    expectation: &'a str,
}

fn split_case(text: &str) -> Result<FileTest<'_>, String> {
    let head_end = text.find("\n\n").ok_or("no input")? + 2;
    let (head, rest) = text.split_at(head_end);
    let task = head.lines().find_map(|line| match line.split_once(' ') {
        None if line == "lower" => Some(Task::Lower),
        Some(("native", "avx2")) => Some(Task::Native(Tier::Avx2)),
        Some(("pass", passes)) => Some(Task::Pass(passes.split(',').map(str::trim).collect())),
        _ => None,
    });
    let (input, expectation) = match rest.split_once("\nexpect\n") {
        Some((input, expectation)) => (input, expectation.trim_start()),
        None => (rest, ""),
    };
    Ok(FileTest {
        head,
        task: task.ok_or("no line says what to do")?,
        runs: head
            .lines()
            .filter_map(|line| line.strip_prefix("run "))
            .map(parse_run)
            .collect::<Result<_, _>>()?,
        input,
        expectation,
    })
}

fn parse_run(line: &str) -> Result<(Vec<u32>, Vec<u32>), String> {
    let words = |list: &str| -> Result<Vec<u32>, String> {
        list.split(',')
            .map(str::trim)
            .filter(|word| !word.is_empty())
            .map(|word| match word.strip_prefix("0x") {
                Some(digits) => u32::from_str_radix(digits, 16),
                None => word.parse::<i64>().map(|number| number as u32),
            })
            .map(|number| number.map_err(|error| error.to_string()))
            .collect()
    };
    let (inputs, outputs) = line.split_once("->").ok_or("`run` without `->`")?;
    Ok((words(inputs)?, words(outputs)?))
}

/// The output of a case; `None` for native code of a tier that the machine lacks.
fn apply(case: &FileTest<'_>) -> Result<Option<String>, String> {
    if let Task::Lower = case.task {
        return lowered(case).map(Some);
    }
    let mut module = parse_module(case.input)?;
    verify(&module)?;
    if let Task::Pass(passes) = &case.task {
        for pass in passes {
            if !run_pass(pass, &mut module) {
                return Err(format!("no pass `{pass}`"));
            }
            verify(&module).map_err(|message| format!("after {pass}: {message}"))?;
        }
    }
    check_runs(case, &module)?;
    let Task::Native(tier) = case.task else {
        return Ok(Some(print_module(&module)));
    };
    if !Tier::available().contains(&tier) {
        return Ok(None);
    }
    shaders::code_pages::allow_native_code();
    let program = Program::with_tier(&module, tier).map_err(|error| error.to_string())?;
    Ok(Some(program.native_text().unwrap_or_default()))
}

/// The IR of a case in SPIR-V.
fn lowered(case: &FileTest<'_>) -> Result<String, String> {
    let prelude = std::fs::read_to_string(root().join("lower/prelude.txt")).unwrap();
    let (declarations, body) = match case.input.split_once("main\n") {
        Some((declarations, body)) => (declarations, body),
        None => ("", case.input),
    };
    let (before, after) = prelude
        .split_once("BODY\n")
        .ok_or("no place for the body")?;
    let (types, start) = before
        .split_once("DECLARATIONS\n")
        .ok_or("no place for more")?;
    let text = [types, declarations, start, body, "\n", after].concat();
    let words = spirv_text::assemble(&text)?;
    let module = shaders::lower(&shaders::request(Stage::Compute, &words));
    let module = module.map_err(|error| error.to_string())?;
    let mut optimised = module.clone();
    optimize(&mut optimised).map_err(|error| error.to_string())?;
    let mut programs = Vec::new();
    for module in [&module, &optimised] {
        for &tier in Tier::available() {
            let program = Program::with_tier(module, tier).map_err(|error| error.to_string())?;
            programs.push((tier, program));
        }
    }
    for (inputs, outputs) in &case.runs {
        for (tier, program) in &programs {
            let mut memory = Memory {
                buffers: vec![(0, inputs.clone()), (16, vec![0; outputs.len()])],
                ..Memory::default()
            };
            dispatch(program, 1, &mut memory);
            let found = &memory.buffers[1].1;
            if found != outputs {
                return Err(format!("{inputs:x?} gives {found:x?} on {tier:?}"));
            }
        }
    }
    Ok(print_module(&module))
}

/// The module as it came, after the case's passes and after all of them must do the same, and what
/// the `run` lines say.
fn check_runs(case: &FileTest<'_>, after_passes: &Module) -> Result<(), String> {
    let original = parse_module(case.input)?;
    let mut optimised = original.clone();
    optimize(&mut optimised).map_err(|error| error.to_string())?;
    for seed in 0..4 {
        let expected = execute(&original, seed, None).without_payloads();
        for &tier in Tier::available() {
            if execute_on(tier, &original, seed, None).without_payloads() != expected {
                return Err(format!("{tier:?} gives something else"));
            }
        }
        for module in [after_passes, &optimised] {
            let actual = execute(module, seed, None)
                .with_payload_of(&original, seed)
                .with_outputs_of(&original, module)
                .without_payloads();
            if actual != expected {
                let text = print_module(module);
                return Err(format!("{expected:?} becomes {actual:?} in\n{text}"));
            }
        }
    }
    for (inputs, outputs) in &case.runs {
        for module in [&original, after_passes, &optimised] {
            let outcome = execute(module, 0, Some(inputs)).with_outputs_of(&original, module);
            let Outcome::Ended(seen) = outcome else {
                return Err("ran out of fuel".into());
            };
            let first: Vec<u32> = seen.outputs.iter().map(|row| row[0]).collect();
            if first != *outputs {
                return Err(format!(
                    "{inputs:x?} gives {first:x?} in\n{}",
                    print_module(module)
                ));
            }
        }
    }
    Ok(())
}

#[test]
fn each_pass_has_a_case() {
    let texts: Vec<String> = (files().iter())
        .map(|path| std::fs::read_to_string(path).unwrap())
        .collect();
    let cases: Vec<FileTest<'_>> = texts.iter().map(|text| split_case(text).unwrap()).collect();
    for pass in pass::names() {
        let has_case = (cases.iter())
            .any(|case| matches!(&case.task, Task::Pass(passes) if passes.contains(&pass)));
        assert!(has_case, "{pass}");
    }
}

#[test]
fn files_give_what_they_expect() {
    let bless = std::env::var_os("TUFF_BLESS").is_some();
    let mut failures = Vec::new();
    let files = files();
    assert!(files.len() >= 150, "the files are found");
    for path in &files {
        let text = std::fs::read_to_string(path).unwrap();
        let outcome = split_case(&text).and_then(|case| Ok((apply(&case)?, case)));
        let (output, case) = match outcome {
            Ok((Some(output), case)) => (output, case),
            Ok((None, _)) => continue,
            Err(message) => {
                failures.push(format!("{}: {message}", path.display()));
                continue;
            }
        };
        if output == case.expectation {
            continue;
        }
        if bless {
            let input = case.input.trim_end();
            let blessed = format!("{}{input}\n\nexpect\n\n{output}", case.head);
            std::fs::write(path, blessed).unwrap();
        } else {
            failures.push(format!(
                "{}: gives\n{output}\ninstead of\n{}",
                path.display(),
                case.expectation
            ));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}
