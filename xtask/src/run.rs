//! `cargo xtask env` and `cargo xtask run`: the user's programs on Tuff.

use std::ffi::{OsStr, OsString};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::driver::{self, Driver};
use crate::system::{self, LOADER};
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Tell what the rays of this pixel do: `x,y` or `x,y,z` (TUFF_CAPTURE_PIXEL)
    #[arg(long, value_name = "X,Y")]
    capture_pixel: Option<OsString>,
    /// The folder for that; without a pixel, for maps of all rays (TUFF_CAPTURE)
    #[arg(long, value_name = "FOLDER")]
    capture: Option<OsString>,
    /// The program and its arguments
    #[arg(required = true, trailing_var_arg = true, value_name = "PROGRAM")]
    program: Vec<OsString>,
}

/// Runs a program on the driver, and returns its exit code.
pub fn run(options: &Options) -> Result<ExitCode> {
    let (name, arguments) = options.program.split_first().context("no program given")?;
    // Before minutes of building.
    require_program(name, std::env::var_os("PATH").as_deref())?;
    system::require(&[&LOADER])?;
    let driver = Driver::build(&[])?;
    let mut program = Command::new(name);
    driver.select_for(&mut program);
    program.args(arguments).envs(options.variables());
    workspace::run(program)
}

impl Options {
    /// The driver's variables for the options.
    fn variables(&self) -> impl Iterator<Item = (&'static str, &OsString)> {
        let pixel = self.capture_pixel.iter();
        let folder = self.capture.iter();
        (pixel.map(|it| ("TUFF_CAPTURE_PIXEL", it))).chain(folder.map(|it| ("TUFF_CAPTURE", it)))
    }
}

/// Checks that a program can be started, by its path or by a name in a folder of `search`.
fn require_program(name: &OsStr, search: Option<&OsStr>) -> Result<()> {
    let shown = name.display();
    if name.as_encoded_bytes().contains(&b'/') {
        let path = Path::new(name);
        match path.metadata() {
            Err(error) => bail!("{shown} cannot be run: {error}"),
            Ok(file) if file.is_dir() => bail!("{shown} cannot be run: it is a folder"),
            Ok(_) if !is_executable(path) => {
                bail!("{shown} cannot be run: it is not executable; `chmod +x {shown}` makes it so")
            }
            Ok(_) => return Ok(()),
        }
    }
    let mut folders = std::env::split_paths(search.unwrap_or_default());
    if !folders.any(|folder| is_executable(&folder.join(name))) {
        let here = match is_executable(Path::new(name)) {
            true => format!("; did you mean ./{shown}?"),
            false => String::new(),
        };
        bail!("there is no program {shown} in the folders of PATH{here}");
    }
    Ok(())
}

fn is_executable(path: &Path) -> bool {
    (path.metadata()).is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

/// Prints lines for a shell's `eval`: nothing else may reach standard output.
pub fn print_environment() -> Result<ExitCode> {
    let driver = Driver::build(&[])?;
    for (name, value) in driver::environment(&driver.manifest) {
        let quoted = value.display().to_string().replace('\'', r"'\''");
        println!("export {name}='{quoted}'");
    }
    if let Err(missing) = system::require(&[&LOADER]) {
        eprintln!("note: {missing:#}");
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_become_variables() {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            options: Options,
        }
        let parse = |line: &str| {
            let line = <Line as clap::Parser>::try_parse_from(line.split(' '))?;
            let variables = line.options.variables();
            let variables = variables.map(|(name, value)| format!("{name}={}", value.display()));
            Ok::<_, clap::Error>((variables.collect::<Vec<_>>(), line.options.program.len()))
        };
        assert_eq!(parse("run sh -c true").unwrap(), (vec![], 3));
        let (variables, words) =
            parse("run --capture-pixel 3,4 --capture here -- sh --capture x").unwrap();
        assert_eq!(variables, ["TUFF_CAPTURE_PIXEL=3,4", "TUFF_CAPTURE=here"]);
        assert_eq!(words, 3);
        let (variables, _) = parse("run --capture here -- sh").unwrap();
        assert_eq!(variables, ["TUFF_CAPTURE=here"]);
    }

    #[test]
    fn programs_are_looked_for_first() {
        let path = OsStr::new("/usr/bin:/bin");
        let require = |name: &str| require_program(OsStr::new(name), Some(path));
        require("sh").unwrap();
        require("/bin/sh").unwrap();
        for (name, expected) in [
            ("no-such-program", "there is no program no-such-program"),
            ("/no/such/program", "cannot be run: No such file"),
            ("/usr/bin/", "it is a folder"),
            ("/etc/passwd", "`chmod +x /etc/passwd`"),
        ] {
            let message = require(name).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
