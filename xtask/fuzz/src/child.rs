//! Running cases in this process, until it dies.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};

use crate::case::{Case, Which};
use crate::guard::Host;
use crate::world::World;

/// Cases on one device: what they make is destroyed with it.
const ON_ONE_DEVICE: u64 = 64;

/// The contents of the progress file. It is as long for every number, and overwritten in place: a
/// file that is written anew is empty for a moment, and for good if the process ends just then.
pub fn progress_text(number: u64) -> String {
    format!("{number:020}")
}

/// Runs `count` cases from one on; says in a file which one it is at.
pub fn run(first: &Which, count: u64, progress: Option<&Path>) -> Result<ExitCode> {
    if progress.is_some() {
        // Panics of this program are silent; the driver has its own hook.
        std::panic::set_hook(Box::new(|_| {}));
    }
    let progress = progress.map(|path| File::options().write(true).open(path));
    let progress = progress
        .transpose()
        .context("opening the file of progress")?;
    let host = Host::new();
    let mut world = None;
    let mut which = first.clone();
    for number in first.number..first.number + count {
        which.number = number;
        if let Some(progress) = &progress {
            (progress.write_all_at(progress_text(number).as_bytes(), 0))
                .context("saying how far it is")?;
        }
        let case = Case::new(&which);
        if number % ON_ONE_DEVICE == 0 {
            world = None;
        }
        // The harness panics where a device is lost or a command fails: that is an answer, too. The
        // driver's own panics it has to catch itself.
        let done = catch_unwind(AssertUnwindSafe(|| {
            let world = world.get_or_insert_with(World::open);
            (which.target.run)(world, &case);
            world.check();
        }));
        host.check();
        if done.is_err() {
            // Not to be destroyed as if nothing had happened: waiting for a lost device ends, too.
            let _ = catch_unwind(AssertUnwindSafe(|| drop(world.take())));
        }
    }
    let _ = catch_unwind(AssertUnwindSafe(|| drop(world.take())));
    Ok(ExitCode::SUCCESS)
}
