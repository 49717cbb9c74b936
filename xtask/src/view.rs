//! `cargo xtask view`: the page that `tuff view` makes of a capture.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// The folder of the capture: `cargo xtask run --capture FOLDER` writes it
    folder: PathBuf,
    /// Do not open the page
    #[arg(long)]
    no_open: bool,
}

pub fn view(options: &Options) -> Result<ExitCode> {
    workspace::build_release_quietly("tuff")?;
    let mut tuff = workspace::program("tuff")?;
    tuff.arg("view").arg(&options.folder);
    if options.no_open {
        tuff.arg("--no-open");
    }
    workspace::run(tuff)
}
