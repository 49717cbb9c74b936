//! An application and one run of it.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, Result, bail};

use super::picture::{self, Picture};
use crate::driver;

/// The list of a folder's applications.
const LIST: &str = "apps.txt";

/// A program with its arguments and working folder.
#[derive(Debug, PartialEq, Eq)]
pub struct Application {
    pub name: String,
    folder: PathBuf,
    command: Vec<String>,
}

/// The outcome of one run.
#[derive(Default)]
pub struct RunOutcome {
    /// The reason of a failure.
    pub failure: Option<String>,
    /// Frames a second, as it printed them.
    pub frames: Option<f64>,
    pub wall_seconds: f64,
    pub processor_seconds: f64,
    /// The pictures written to its folder.
    pub pictures: Vec<Picture>,
}

impl Application {
    /// The applications of a folder, by name.
    pub fn in_folder(folder: &Path, arguments: &[String]) -> Result<Vec<Application>> {
        let folder = std::path::absolute(folder)?;
        let list = folder.join(LIST);
        if list.exists() {
            let text = std::fs::read_to_string(&list)
                .with_context(|| format!("reading {}", list.display()))?;
            return listed(&text, &folder);
        }
        let entries = std::fs::read_dir(&folder)
            .with_context(|| format!("looking into {}", folder.display()))?;
        let mut found = Vec::new();
        for entry in entries {
            let path = entry?.path();
            if is_program(&path)? {
                let program = path.to_str().context("the program's path is UTF-8")?;
                let name = path.file_name().unwrap_or_default();
                found.push(Application {
                    name: name.to_string_lossy().into_owned(),
                    folder: folder.clone(),
                    command: [program.to_owned()]
                        .into_iter()
                        .chain(arguments.iter().cloned())
                        .collect(),
                });
            }
        }
        found.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(found)
    }

    /// Runs the application on the driver of a manifest, with a time limit in seconds.
    pub fn run(&self, manifest: &Path, through: Option<&str>, patience: u64) -> Result<RunOutcome> {
        let mut words = through.unwrap_or_default().split_whitespace();
        let mut words: Vec<&str> = words.by_ref().collect();
        words.extend(self.command.iter().map(String::as_str));
        let mut command = Command::new(words[0]);
        command
            .args(&words[1..])
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null());
        for (name, value) in driver::environment(manifest) {
            command.env(name, value);
        }
        command.env_remove("VK_ADD_DRIVER_FILES");
        let before = SystemTime::now();
        let (start, processor) = (Instant::now(), children_seconds());
        let mut child = command
            .spawn()
            .with_context(|| format!("starting {}", words[0]))?;
        let mut pipe = child.stdout.take().context("the output")?;
        let reader = std::thread::spawn(move || {
            let mut text = Vec::new();
            // Output before a read error is used.
            let _ = pipe.read_to_end(&mut text);
            text
        });
        let failure = wait(&mut child, Duration::from_secs(patience))?;
        let wall_seconds = start.elapsed().as_secs_f64();
        let text = reader.join().unwrap_or_default();
        Ok(RunOutcome {
            failure,
            frames: frames(&String::from_utf8_lossy(&text)),
            wall_seconds,
            processor_seconds: children_seconds() - processor,
            pictures: picture::written_since(&self.folder, before)?,
        })
    }
}

/// The applications of a list.
fn listed(text: &str, folder: &Path) -> Result<Vec<Application>> {
    let mut found = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let Some((name, command)) = line.split_once(':') else {
            bail!("a line of {LIST} has no name before a colon: {line}");
        };
        let command: Vec<String> = command.split_whitespace().map(str::to_owned).collect();
        if command.is_empty() {
            bail!("{LIST} has no command for {name}");
        }
        found.push(Application {
            name: name.trim().to_owned(),
            folder: folder.to_owned(),
            command,
        });
    }
    Ok(found)
}

fn is_program(path: &Path) -> Result<bool> {
    use std::os::unix::fs::PermissionsExt;
    let data = std::fs::metadata(path)?;
    let is_library = path.extension().is_some_and(|it| it == "so");
    Ok(data.is_file() && data.permissions().mode() & 0o111 != 0 && !is_library)
}

/// Waits for a child. Returns the reason if it did not succeed in time.
fn wait(child: &mut Child, patience: Duration) -> Result<Option<String>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok((!status.success()).then(|| format!("ended with {status}")));
        }
        if start.elapsed() > patience {
            child.kill()?;
            child.wait()?;
            return Ok(Some(format!("ran over {} s", patience.as_secs())));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The last frame rate of a line: `fps: 25.3`, `25.3 fps`, `FPS = 25`.
fn frames(text: &str) -> Option<f64> {
    let number = |word: &str| -> Option<f64> {
        let word = word.trim_matches(|c: char| !c.is_ascii_digit());
        word.parse().ok().filter(|number: &f64| *number > 0.0)
    };
    text.lines().rev().find_map(|line| {
        let line = line.to_ascii_lowercase();
        let (before, after) = line.split_once("fps")?;
        let behind = after.split_whitespace().find_map(number);
        behind.or_else(|| before.split_whitespace().rev().find_map(number))
    })
}

/// User and system time of the children that have ended.
fn children_seconds() -> f64 {
    // SAFETY: `rusage` is plain data, and the call fills it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        libc::getrusage(libc::RUSAGE_CHILDREN, &mut usage);
        usage
    };
    let seconds = |time: libc::timeval| time.tv_sec as f64 + time.tv_usec as f64 * 1e-6;
    seconds(usage.ru_utime) + seconds(usage.ru_stime)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_found_where_programs_print_them() {
        assert_eq!(frames("device: x\nfps    : 17.371\n"), Some(17.371));
        assert_eq!(frames("12 frames, 25.5 FPS"), Some(25.5));
        assert_eq!(frames("FPS = 30\nbye"), Some(30.0));
        assert_eq!(frames("nothing of 7 the kind"), None);
    }

    #[test]
    fn lists_name_commands() {
        let folder = Path::new("/there");
        let found = listed("# remark\n\nfirst: ./a -w 3\n", folder).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].name, "first");
        assert_eq!(found[0].command, ["./a", "-w", "3"]);
        assert!(listed("no command", folder).is_err());
    }
}
