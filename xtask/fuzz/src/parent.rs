//! Starting children, noticing how they die, and keeping what killed them.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::case::Which;
use crate::child::progress_text;
use crate::targets::Target;
use crate::world::World;

/// How long a child runs, mostly, once its first case is done: on a loaded machine a device and its shaders may take longer.
const SLICE: Duration = Duration::from_secs(5);

/// How long the parent looks away.
const NAP: Duration = Duration::from_millis(20);

/// How long one case may take: longer than a dispatch until the device is lost.
const PATIENCE: Duration = Duration::from_secs(20);

/// How long a case is made smaller.
const MINIMISING: Duration = Duration::from_secs(60);

/// Cases that a child is given: more than it comes to.
const MANY: u64 = 1 << 40;

/// Seconds after which a dispatch of the driver under test is given up.
const TIMEOUT: &str = "0.5";

/// How a child ended.
#[derive(Clone, Debug, PartialEq, Eq)]
enum End {
    /// Of itself, or because its time was over.
    Well,
    /// It died, or had to be: what was said of it.
    Badly(String),
}

pub struct Parent {
    out: PathBuf,
}

impl Parent {
    pub fn new(out: &Path) -> Result<Parent> {
        let out = std::path::absolute(out)?;
        std::fs::create_dir_all(&out).with_context(|| format!("making {}", out.display()))?;
        Ok(Parent { out })
    }

    /// Runs targets in turn. Fails if anything was found.
    pub fn run(&self, targets: &[&'static Target], seed: u64, time: Duration) -> Result<ExitCode> {
        // Panics, and says why, where no device is to be had. To a child any panic of the harness is an answer: without a driver no case
        // would fail.
        drop(World::open());
        let end = Instant::now() + time;
        let slice = SLICE.min(time / targets.len().max(1) as u32);
        let mut next: BTreeMap<&str, u64> = BTreeMap::new();
        let mut findings = 0;
        while Instant::now() < end {
            for &target in targets {
                let number = next.entry(target.name).or_default();
                let first = Which {
                    target,
                    seed,
                    number: *number,
                    kept: None,
                };
                let (reached, ended) = self.child(&first, MANY, slice)?;
                if let End::Badly(how) = ended {
                    let which = Which {
                        number: reached,
                        ..first
                    };
                    self.keep(which, &how)?;
                    findings += 1;
                }
                *number = reached + 1;
            }
        }
        for (name, count) in next {
            println!("{name}: {count} cases");
        }
        println!("{findings} findings");
        Ok(match findings {
            0 => ExitCode::SUCCESS,
            _ => ExitCode::FAILURE,
        })
    }

    /// Runs cases in a child for some time; returns at which one it was, and how it ended.
    fn child(&self, first: &Which, count: u64, time: Duration) -> Result<(u64, End)> {
        let progress = self.out.join(format!("{}.progress", first.target.name));
        let log = self.log(first.target);
        std::fs::write(&progress, progress_text(first.number))?;
        let file = File::create(&log)?;
        let mut child = Command::new(std::env::current_exe()?)
            .args(["child", &first.to_string(), &count.to_string()])
            .arg(&progress)
            .env("TUFF_TIMEOUT", TIMEOUT)
            .env("RUST_BACKTRACE", "1")
            .stdout(Stdio::null())
            .stderr(file)
            .spawn()
            .context("starting a child")?;
        let reached = || -> u64 {
            let text = std::fs::read_to_string(&progress).unwrap_or_default();
            text.parse().unwrap_or(first.number)
        };
        // In naps, not by the clock: who is stopped for a while, child and parent alike, does not hang.
        let most = |time: Duration| (time.as_millis() / NAP.as_millis()) as u32;
        let (mut at, mut naps, mut naps_at_case) = (first.number, 0, 0);
        let ended = loop {
            if let Some(status) = child.try_wait()? {
                break match status.success() {
                    true => End::Well,
                    false => End::Badly(status.to_string()),
                };
            }
            let case = reached();
            if case != at {
                (at, naps_at_case) = (case, 0);
            }
            if naps_at_case > most(PATIENCE) {
                stop(&mut child)?;
                break End::Badly("it hangs".into());
            }
            // One that has run for long is given the time to show that it hangs.
            if naps > most(time) && naps_at_case < most(Duration::from_secs(1)) {
                stop(&mut child)?;
                break End::Well;
            }
            std::thread::sleep(NAP);
            naps_at_case += 1;
            naps += u32::from(at != first.number);
        };
        // The driver has to catch its panics, and should not have them. That a handle is none is what it says of it.
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        let panicked = (said.lines())
            .filter(|line| line.contains("panicked at") || line.contains("panicked: "))
            .find(|line| !line.contains("not a live handle"));
        Ok((
            reached(),
            match (ended, panicked) {
                (End::Well, Some(line)) => End::Badly(line.to_string()),
                (ended, _) => ended,
            },
        ))
    }

    fn log(&self, target: &Target) -> PathBuf {
        self.out.join(format!("{}.log", target.name))
    }

    /// Makes a case smaller and writes it down.
    fn keep(&self, which: Which, how: &str) -> Result<()> {
        let said = std::fs::read_to_string(self.log(which.target)).unwrap_or_default();
        let smaller = self.minimised(&which)?;
        let name = format!("{}-{}-{}", which.target.name, which.seed, which.number);
        let file = self.out.join(name).with_extension("txt");
        let tail: Vec<&str> = said.lines().rev().take(60).collect();
        let tail: Vec<&str> = tail.into_iter().rev().collect();
        let again = match &smaller {
            Some(smaller) => format!("fuzz again {smaller}"),
            None => format!("fuzz again {which}   (alone, it does no harm)"),
        };
        std::fs::write(&file, format!("{again}\n{how}\n\n{}\n", tail.join("\n")))?;
        println!("FOUND {}: {how}: {again}", file.display());
        Ok(())
    }

    /// The same with as few steps as do it; `None` if it does nothing alone.
    fn minimised(&self, which: &Which) -> Result<Option<Which>> {
        let end = Instant::now() + MINIMISING;
        let dies = |kept: &[u32]| -> Result<bool> {
            if Instant::now() > end {
                return Ok(false);
            }
            let some = Which {
                kept: Some(kept.to_vec()),
                ..which.clone()
            };
            Ok(self.child(&some, 1, PATIENCE)?.1 != End::Well)
        };
        let mut kept: Vec<u32> = (0..which.step_count()).collect();
        if !dies(&kept)? {
            return Ok(None);
        }
        let mut size = kept.len().div_ceil(2);
        while size > 0 {
            let mut start = 0;
            while start < kept.len() {
                let mut fewer = kept.clone();
                fewer.drain(start..(start + size).min(kept.len()));
                if dies(&fewer)? {
                    kept = fewer;
                } else {
                    start += size;
                }
            }
            size /= 2;
        }
        Ok(Some(Which {
            kept: Some(kept),
            ..which.clone()
        }))
    }
}

fn stop(child: &mut Child) -> Result<()> {
    child.kill()?;
    child.wait()?;
    Ok(())
}
