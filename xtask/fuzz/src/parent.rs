//! Starting children, noticing how they die, and keeping what killed them.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::case::{FuzzTarget, Which};
use crate::child::progress_text;
use crate::world::World;

/// How long a child runs, mostly, once its first case is done: on a loaded machine a device and its
/// shaders may take longer.
const SLICE: Duration = Duration::from_secs(5);

/// How long the parent looks away.
const NAP: Duration = Duration::from_millis(20);

/// How much processor time one case may take: far more than a dispatch until the device is lost.
const PATIENCE: Duration = Duration::from_secs(20);

/// How long a case may take that waits for something, whatever else the machine does.
const LONG_PATIENCE: Duration = Duration::from_secs(240);

/// How long a case is made smaller.
const MINIMISING: Duration = Duration::from_secs(60);

/// Cases that a child is given: more than it comes to.
const MANY: u64 = 1 << 40;

/// The variable that says after how many seconds the driver gives a dispatch up.
pub const TIMEOUT_NAME: &str = "TUFF_TIMEOUT";

/// Its value for the driver under test.
const TIMEOUT: &str = "0.5";

/// How much a run does.
#[derive(Clone, Copy, Debug)]
pub enum Amount {
    /// All targets in turn, for so long.
    Time(Duration),
    /// So many cases of each target.
    Cases(u64),
}

/// How a child ended.
#[derive(Clone, Debug, PartialEq, Eq)]
enum End {
    /// Of itself, or because its time was over.
    Well,
    /// It died or was killed: its message.
    Badly(String),
}

pub struct Parent {
    out: PathBuf,
}

/// Runs this program once more, with the time limit that its children have.
pub fn again() -> Result<ExitCode> {
    let status = Command::new(std::env::current_exe()?)
        .args(std::env::args_os().skip(1))
        .env(TIMEOUT_NAME, TIMEOUT)
        .status()
        .context("starting the case")?;
    Ok(match status.success() {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    })
}

impl Parent {
    pub fn new(out: &Path) -> Result<Parent> {
        let out = std::path::absolute(out)?;
        std::fs::create_dir_all(&out).with_context(|| format!("making {}", out.display()))?;
        Ok(Parent { out })
    }

    /// Runs targets in turn. Fails if anything was found.
    pub fn run(
        &self,
        targets: &[&'static FuzzTarget],
        seed: u64,
        amount: Amount,
    ) -> Result<ExitCode> {
        // Panics, and says why, where no device is to be had. To a child any panic of the harness
        // is an answer: without a driver no case would fail.
        drop(World::open());
        let mut next: BTreeMap<&str, u64> = BTreeMap::new();
        let mut findings = 0;
        // Runs cases of a target in a child, which ends by itself or by its time.
        let mut some = |target: &'static FuzzTarget, most: Option<u64>, time| -> Result<u64> {
            let number = next.entry(target.name).or_default();
            let first = Which {
                target,
                seed,
                number: *number,
                kept: None,
            };
            let count = most.map_or(MANY, |most| most - *number);
            let (reached, ended) = self.child(&first, count, time)?;
            if let End::Badly(how) = ended {
                let which = Which {
                    number: reached,
                    ..first
                };
                self.keep(which, &how)?;
                findings += 1;
            }
            *number = reached + 1;
            Ok(*number)
        };
        match amount {
            Amount::Time(time) => {
                let end = Instant::now() + time;
                let slice = SLICE.min(time / targets.len().max(1) as u32);
                while Instant::now() < end {
                    for &target in targets {
                        some(target, None, Some(slice))?;
                    }
                }
            }
            Amount::Cases(cases) => {
                for &target in targets {
                    // A child that died is followed by one that goes on behind its last case.
                    while cases > 0 && some(target, Some(cases), None)? < cases {}
                }
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

    /// Runs cases in a child, for some time at most; returns at which one it was, and how it ended.
    fn child(&self, first: &Which, count: u64, time: Option<Duration>) -> Result<(u64, End)> {
        let progress = self.out.join(format!("{}.progress", first.target.name));
        let log = self.log(first.target);
        std::fs::write(&progress, progress_text(first.number))?;
        let file = File::create(&log)?;
        let mut child = Command::new(std::env::current_exe()?)
            .args(["child", &first.to_string(), &count.to_string()])
            .arg(&progress)
            .env(TIMEOUT_NAME, TIMEOUT)
            .env("RUST_BACKTRACE", "1")
            .stdout(Stdio::null())
            .stderr(file)
            .spawn()
            .context("starting a child")?;
        let reached = || -> u64 {
            let text = std::fs::read_to_string(&progress).unwrap_or_default();
            text.parse().unwrap_or(first.number)
        };
        // In naps, not by the clock: who is stopped for a while, child and parent alike, does not
        // hang.
        let most = |time: Duration| (time.as_millis() / NAP.as_millis()) as u32;
        let (mut at, mut naps, mut naps_at_case) = (first.number, 0, 0);
        let mut used_before = Duration::ZERO;
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
                used_before = processor_time(&child);
            }
            let used = processor_time(&child).saturating_sub(used_before);
            if used > PATIENCE || naps_at_case > most(LONG_PATIENCE) {
                stop(&mut child)?;
                break End::Badly("it hangs".into());
            }
            // One that has run for long is given the time to show that it hangs.
            let is_over = time.is_some_and(|time| naps > most(time));
            if is_over && naps_at_case < most(Duration::from_secs(1)) {
                stop(&mut child)?;
                break End::Well;
            }
            std::thread::sleep(NAP);
            naps_at_case += 1;
            naps += u32::from(at != first.number);
        };
        // The driver has to catch its panics, and should not have them. That a handle is none is
        // what it says of it.
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

    fn log(&self, target: &FuzzTarget) -> PathBuf {
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
            Ok(self.child(&some, 1, None)?.1 != End::Well)
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

/// Processor time of a child so far (proc(5), `/proc/PID/stat`: fields 14 and 15, in hundredths of
/// a second).
fn processor_time(child: &Child) -> Duration {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap_or_default();
    // The second field is a name in parentheses, which may have blanks.
    let rest = stat.rsplit(')').next().unwrap_or_default();
    let fields = rest.split_whitespace().skip(11).take(2);
    let ticks: u64 = fields.filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}

fn stop(child: &mut Child) -> Result<()> {
    child.kill()?;
    child.wait()?;
    Ok(())
}
