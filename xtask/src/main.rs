//! The commands a person types: `cargo xtask demo | test | fuzz | bench | apps | chart |
//! precision | watertight | profile | audit | vuids | env | run | info | view | install |
//! uninstall | package`.

mod apps;
mod architecture;
mod audit;
mod bench;
mod chart;
mod demo;
mod driver;
mod environment;
mod fuzz;
mod info;
mod install;
mod package;
mod precision;
mod profile;
mod prose;
mod run;
mod skips;
mod slang;
mod system;
mod test;
mod view;
mod vuids;
mod watertight;
mod windows;
mod workspace;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    version,
    about = "What one does with Tuff"
)]
struct Arguments {
    /// Install no packages of the system: say which are missing instead
    #[arg(long, global = true)]
    no_install: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a picture of a landscape (or of a glTF scene) by ray tracing through Vulkan
    Demo(demo::Options),
    /// Run every test: units, properties, filetests, and the black-box tests through the loader
    Test(test::Options),
    /// Feed the driver with nonsense, in processes that may die
    Fuzz(fuzz::Options),
    /// Print the export lines that make a shell's Vulkan applications use Tuff
    Env,
    /// Run a program on Tuff
    Run(run::Options),
    /// Install the driver and its manifest where the Vulkan loader looks
    Install(install::Options),
    /// Remove what `install` put there
    Uninstall(install::Options),
    /// Show the loader, drivers and limits that programs find here, and how to fix problems
    Info(info::Options),
    /// Make a page of a capture, and a picture of each map, and open it where a browser is
    View(view::Options),
    /// Build what users install: a Python wheel, a Debian package and a tarball; for Windows a zip
    Package(package::Options),
    /// Measure: `bench traversal` compares walks and builds with Embree's
    Bench(bench::Options),
    /// Hold applications that you have built against another driver: their speed and their pictures
    Apps(apps::Options),
    /// Measure how exact the float functions are, and write docs/precision.md
    Precision(precision::Options),
    /// Send rays at the seams of closed meshes, and count those that are lost
    Watertight(watertight::Options),
    /// Draw accuracy against cost, where methods fail, and what specialisations bring
    Chart(chart::Options),
    /// Sample a workload with perf, and draw where its time goes as a flame graph
    Profile(profile::Options),
    /// Run slangpy's ray tracing examples, compiled by the Slang compiler; fetches both
    Slang(slang::Options),
    /// Write docs/valid-usage.md: the code that checks each rule of valid usage
    Vuids,
    /// Hold the driver's tables against the Vulkan registry (vk.xml)
    Audit(audit::Options),
}

fn main() -> ExitCode {
    end_with_the_reader();
    // A program with an unknown path was not started by cargo.
    if let Ok(target) = workspace::target() {
        // SAFETY: no other thread runs yet.
        unsafe { environment::restore(&target) };
    }
    let arguments = Arguments::parse();
    if arguments.no_install {
        system::install_nothing();
    }
    let done: Result<ExitCode> = match arguments.command {
        Command::Demo(options) => demo::demo(&options),
        Command::Test(options) => test::test(&options),
        Command::Fuzz(options) => fuzz::fuzz(&options),
        Command::Env => run::print_environment(),
        Command::Run(options) => run::run(&options),
        Command::Install(options) => install::install(&options),
        Command::Uninstall(options) => install::uninstall(&options),
        Command::Info(options) => info::info(&options),
        Command::View(options) => view::view(&options),
        Command::Package(options) => package::package(&options),
        Command::Bench(options) => bench::bench(&options),
        Command::Apps(options) => apps::apps(&options),
        Command::Precision(options) => precision::precision(&options),
        Command::Watertight(options) => watertight::watertight(&options),
        Command::Chart(options) => chart::chart(&options),
        Command::Profile(options) => profile::profile(&options),
        Command::Audit(options) => audit::audit(&options),
        Command::Slang(options) => slang::slang(&options),
        Command::Vuids => vuids::write(),
    };
    done.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}

/// A reader that closes its end (`cargo xtask info | head`) ends this program by SIGPIPE, like
/// other programs. Rust's programs ignore that signal by default, and would panic at the next
/// print.
fn end_with_the_reader() {
    // SAFETY: the default action installs no handler, and no other thread runs yet.
    unsafe { libc::signal(libc::SIGPIPE, libc::SIG_DFL) };
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn usage_is_what_a_person_types() {
        let mut command = Arguments::command();
        command.build();
        let usage = command.render_usage().to_string();
        assert!(usage.starts_with("Usage: cargo xtask "), "{usage}");
        let version = command.render_version();
        assert_eq!(
            version.trim(),
            concat!("cargo xtask ", env!("CARGO_PKG_VERSION"))
        );
        command.debug_assert();
    }

    #[test]
    fn limits_are_told_and_checked_first() {
        let parse = |line: &str| {
            let words = ["xtask", "demo"].into_iter().chain(line.split(' '));
            Arguments::try_parse_from(words)
                .err()
                .map(|error| error.to_string())
        };
        assert!(parse("--size 640x360 --spp 4 --tile 1/4 --frame 3").is_none());
        assert!(parse("--window --size 640x360 --frames 3").is_none());
        for (line, expected) in [
            ("--size 640", "a size is like 1280x720"),
            ("--size 0x4", "a side is 1 to 16384 pixels"),
            ("--spp 0", "samples per pixel are 1 to 65536"),
            ("--threads 0", "1..=1024"),
            ("--tile 4/4", "a tile is like 0/4"),
            ("--frames 3", "--window"),
            ("--window --compare", "cannot be used with"),
        ] {
            let message = parse(line).expect("it is refused");
            assert!(message.contains(expected), "{line}: {message}");
        }
        let help = parse("--help").expect("help ends it");
        assert!(
            help.contains("16384 a side") && help.contains("1 to 65536"),
            "{help}"
        );
    }
}
