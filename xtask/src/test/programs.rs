//! Test programs: cargo builds them, and each is asked for its tests.

use std::io::BufReader;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use crate::environment;

/// A program that succeeds or fails: a program of tests, or a program that is a single test.
pub struct Program {
    /// The name for output: `icd`, `traversal/packets`.
    pub name: String,
    executable: PathBuf,
    /// The working folder: that of its package, as under cargo.
    folder: PathBuf,
    /// The names of its tests; empty for a single test.
    pub tests: Vec<String>,
    arguments: Vec<String>,
    variables: Vec<(String, Option<String>)>,
    stack: Stack,
}

/// The stack of a program's first thread, on which its tests run.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Stack {
    /// The system's limit.
    Usual,
    /// As small as that of Rust's threads, since code that needs more would fail in applications.
    Small,
}

/// Bytes of the stack of a thread of Rust's (std::thread, "Stack size").
const SMALL_STACK_BYTES: libc::rlim_t = 2 << 20;

impl Program {
    /// The selection of programs.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.executable);
        environment::give_back(&mut command);
        command
            .current_dir(&self.folder)
            .env("CARGO_MANIFEST_DIR", &self.folder)
            .args(&self.arguments)
            .stdin(Stdio::null());
        for (name, value) in &self.variables {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        if self.stack == Stack::Small {
            // SAFETY: between fork and exec only a system call is made.
            unsafe { command.pre_exec(limit_stack) };
        }
        command
    }

    /// A program of tests, run like this command.
    ///
    /// # Errors
    /// It does not list its tests.
    #[cfg(test)]
    pub fn of_tests(name: &str, command: &Command) -> Result<Program> {
        let mut program = Program::alone(name, command);
        program.tests = list(&program)?;
        Ok(program)
    }

    /// A program that is a single test, run like this command.
    pub fn alone(name: &str, command: &Command) -> Program {
        let text = |word: &std::ffi::OsStr| word.to_string_lossy().into_owned();
        Program {
            name: name.into(),
            executable: command.get_program().into(),
            folder: (command.get_current_dir())
                .map_or_else(|| crate::workspace::root().into(), Into::into),
            tests: Vec::new(),
            arguments: command.get_args().map(text).collect(),
            variables: variables(command),
            stack: Stack::Usual,
        }
    }
}

/// Limits the stack of this process's first thread.
fn limit_stack() -> std::io::Result<()> {
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: the calls fill and read the structure.
    let code = unsafe {
        libc::getrlimit(libc::RLIMIT_STACK, &raw mut limit);
        limit.rlim_cur = SMALL_STACK_BYTES.min(limit.rlim_max);
        libc::setrlimit(libc::RLIMIT_STACK, &raw const limit)
    };
    match code {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

/// The variables that a command sets and removes.
fn variables(command: &Command) -> Vec<(String, Option<String>)> {
    let text = |word: &std::ffi::OsStr| word.to_string_lossy().into_owned();
    let set = command.get_envs();
    set.map(|(name, value)| (text(name), value.map(text)))
        .collect()
}

/// The environment in which the programs of some packages run.
pub struct Surroundings {
    /// Variables to set, or to remove if they have no value.
    variables: Vec<(String, Option<String>)>,
    stack: Stack,
}

impl Surroundings {
    /// The variables that a command sets and removes, and a stack.
    pub fn of(command: &Command, stack: Stack) -> Self {
        Self {
            variables: variables(command),
            stack,
        }
    }
}

/// Builds test programs with a cargo command, to which it adds `--no-run`. `surroundings` returns
/// the environment for the programs of a package's folder; `None` leaves them out. `arguments` are
/// arguments of the programs, which select the tests.
///
/// # Errors
/// A program cannot be built, or does not list its tests.
pub fn build<'a>(
    mut cargo: Command,
    arguments: &[String],
    surroundings: impl Fn(&str) -> Option<&'a Surroundings>,
) -> Result<Vec<Program>> {
    cargo.args(["--no-run", "--message-format", "json-render-diagnostics"]);
    let mut child = cargo
        .stdout(Stdio::piped())
        .spawn()
        .context("starting cargo")?;
    let stdout = child.stdout.take().context("cargo's output")?;
    let messages = serde_json::Deserializer::from_reader(BufReader::new(stdout));
    let mut programs = Vec::new();
    for message in messages.into_iter::<Value>() {
        let message = message.context("what cargo says")?;
        let Some(program) = program(&message, arguments) else {
            continue;
        };
        let package = program.folder.file_name().and_then(|it| it.to_str());
        if let Some(around) = package.and_then(&surroundings) {
            programs.push(Program {
                variables: around.variables.clone(),
                stack: around.stack,
                ..program
            });
        }
    }
    let status = child.wait().context("waiting for cargo")?;
    ensure!(status.success(), "building the tests failed");
    for program in &mut programs {
        program.tests = list(program)?;
    }
    programs.retain(|program| !program.tests.is_empty());
    Ok(programs)
}

/// The test program of a message of cargo (The Cargo Book, "External tools").
fn program(message: &Value, arguments: &[String]) -> Option<Program> {
    let executable = message["executable"].as_str()?;
    if message["profile"]["test"] != true {
        return None;
    }
    let manifest = PathBuf::from(message["manifest_path"].as_str()?);
    let folder = manifest.parent()?.to_path_buf();
    let (package, target) = (folder.file_name()?.to_str()?, &message["target"]);
    let name = match (target["kind"][0].as_str()?, target["name"].as_str()?) {
        ("test", name) => format!("{package}/{name}"),
        ("bin", name) => format!("{package}/{name} (program)"),
        _ => package.to_owned(),
    };
    // Two concurrent tests crash some older validation layers (1.3.239: Vulkan-ValidationLayers
    // issue 4391).
    let mut words = arguments.to_vec();
    if !(words.iter()).any(|word| word.starts_with("--test-threads")) {
        words.push("--test-threads=1".into());
    }
    Some(Program {
        name,
        executable: executable.into(),
        folder,
        tests: Vec::new(),
        arguments: words,
        variables: Vec::new(),
        stack: Stack::Usual,
    })
}

/// The names of a program's tests.
fn list(program: &Program) -> Result<Vec<String>> {
    let mut command = program.command();
    let output = command.arg("--list").output();
    let output = output.with_context(|| format!("starting {}", program.name))?;
    let errors = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{}: {errors}", program.name);
    let text = String::from_utf8_lossy(&output.stdout);
    let names = text.lines().filter_map(|line| line.strip_suffix(": test"));
    Ok(names.map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_cargo_name_programs() {
        let message = |kind: &str, name: &str, test: bool| {
            serde_json::json!({
                "reason": "compiler-artifact",
                "manifest_path": "/tuff/icd/Cargo.toml",
                "target": {"kind": [kind], "name": name},
                "profile": {"test": test},
                "executable": "/tuff/target/debug/deps/it-0123",
            })
        };
        for (message, expected) in [
            (message("lib", "vulkan_tuff", true), Some("icd")),
            (message("test", "audit", true), Some("icd/audit")),
            (message("bin", "icd", true), Some("icd/icd (program)")),
            (message("bin", "other", false), None),
            (serde_json::json!({"reason": "build-finished"}), None),
        ] {
            let found = program(&message, &[]);
            assert_eq!(found.map(|it| it.name).as_deref(), expected);
        }
    }
}
