//! Runs test programs, several at a time, and prints their progress.
//!
//! Each program runs its tests one after the other, so a test's time ends when the next one starts.

use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use std::process::ExitStatus;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::programs::Program;
use super::times::Times;

/// After this time without output, the running tests are printed.
const SILENCE: Duration = Duration::from_secs(30);

/// The interval at which output is read.
const LOOK: Duration = Duration::from_millis(20);

/// Number of slowest tests to print.
const SLOWEST: usize = 10;

/// The options of a run.
pub struct Order {
    pub at_a_time: usize,
    /// Prints the output of successful programs, too.
    pub is_loud: bool,
    /// The folder of their output files.
    pub folder: PathBuf,
}

/// The outcome of a run.
#[derive(Default)]
pub struct Outcome {
    /// Programs that failed, by name.
    pub failed: Vec<String>,
    /// Each test, or single-test program, with its time.
    tests: Vec<(Duration, String)>,
}

impl Outcome {
    /// The summary: the slowest tests, failed programs, and counts. A failed program counts once.
    pub fn text(mut self) -> String {
        self.tests.sort_by(|a, b| b.cmp(a));
        let mut lines = vec!["The slowest tests:".to_owned()];
        let slowest = self.tests.iter().take(SLOWEST);
        lines.extend(
            slowest.map(|(took, name)| format!("    {:6.1} s  {name}", took.as_secs_f64())),
        );
        lines.extend(self.failed.iter().map(|name| format!("FAILED: {name}")));
        let failed = self.failed.len();
        let passed = self.tests.len().saturating_sub(failed);
        lines.push(format!("{passed} passed, {failed} failed"));
        lines.join("\n")
    }
}

/// A running program.
struct Running {
    name: String,
    /// The current test and its start.
    test: Option<(String, Instant)>,
    started: Instant,
    tests_done: usize,
}

/// State that all runners share.
struct Board {
    waiting: VecDeque<Program>,
    running: Vec<Running>,
    programs_done: usize,
    tests_done: usize,
    /// Totals of all finished programs.
    seconds_done: f64,
    outcome: Outcome,
    times: Times,
}

/// The messages of runners.
enum News {
    Done {
        line: String,
        /// The output of a failed program, or of one with printed output.
        said: Option<String>,
    },
    Over,
}

/// Runs programs, several at a time and the longest first, and prints each at its end.
///
/// # Errors
/// A program cannot be started.
pub fn run(mut programs: Vec<Program>, times: Times, order: &Order) -> Result<Outcome> {
    std::fs::create_dir_all(&order.folder)
        .with_context(|| format!("making {}", order.folder.display()))?;
    let at_a_time = order.at_a_time;
    // Programs without a known time may be long.
    let length = |program: &Program| times.of(&program.name).unwrap_or(f64::MAX);
    programs.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let all = (
        programs.len(),
        programs.iter().map(|it| it.tests.len().max(1)).sum(),
    );
    let board = Mutex::new(Board {
        waiting: programs.into(),
        running: Vec::new(),
        programs_done: 0,
        tests_done: 0,
        seconds_done: 0.0,
        outcome: Outcome::default(),
        times,
    });
    let start = Instant::now();
    let (sender, news) = channel();
    std::thread::scope(|scope| -> Result<()> {
        let runners: Vec<_> = (0..at_a_time)
            .map(|_| {
                let (board, sender) = (&board, sender.clone());
                scope.spawn(move || {
                    let done = run_some(board, &sender, order);
                    // The receiver lives until all are over.
                    let _ = sender.send(News::Over);
                    done
                })
            })
            .collect();
        let mut over = 0;
        while over < at_a_time {
            match news.recv_timeout(SILENCE) {
                Ok(News::Over) => over += 1,
                Ok(News::Done { line, said }) => {
                    let head = head(&lock(&board), all, at_a_time, start);
                    println!("{head} {line}");
                    if let Some(said) = said {
                        println!("{said}");
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    let board = lock(&board);
                    let running = board.running.iter().map(running_text);
                    let running: Vec<_> = running.collect();
                    let head = head(&board, all, at_a_time, start);
                    println!("{head} running: {}", running.join(", "));
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        for runner in runners {
            runner
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        }
        Ok(())
    })?;
    let board = board.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(board.outcome)
}

/// The progress of the whole run.
fn head(
    board: &Board,
    (programs, tests): (usize, usize),
    at_a_time: usize,
    start: Instant,
) -> String {
    let waiting = board.waiting.iter();
    let mut left: Vec<_> = waiting
        .map(|it| (it.name.as_str(), it.tests.len()))
        .collect();
    left.extend(board.running.iter().map(|it| (it.name.as_str(), 1)));
    let done = (board.tests_done, board.seconds_done);
    let gone: f64 = (board.running.iter())
        .map(|it| it.started.elapsed().as_secs_f64())
        .sum();
    let about = board.times.left(&left, at_a_time, done);
    let about = about.map_or(String::new(), |seconds| {
        let seconds = (seconds - gone / at_a_time as f64).max(0.0);
        format!(", about {} left", minutes(seconds))
    });
    let running: usize = board.running.iter().map(|it| it.tests_done).sum();
    format!(
        "[{}/{programs} programs, {}/{tests} tests, {}{about}]",
        board.programs_done,
        board.tests_done + running,
        minutes(start.elapsed().as_secs_f64())
    )
}

/// Minutes and seconds.
fn minutes(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

fn running_text(running: &Running) -> String {
    match &running.test {
        Some((test, since)) => {
            let seconds = since.elapsed().as_secs();
            format!("{} {test} ({seconds} s)", running.name)
        }
        None => running.name.clone(),
    }
}

/// A runner that panicked has printed a message; its results are still reported.
fn lock(board: &Mutex<Board>) -> MutexGuard<'_, Board> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs programs until none is left.
fn run_some(board: &Mutex<Board>, news: &Sender<News>, order: &Order) -> Result<()> {
    loop {
        let program = {
            let mut board = lock(board);
            let Some(program) = board.waiting.pop_front() else {
                return Ok(());
            };
            board.running.push(Running {
                name: program.name.clone(),
                test: None,
                started: Instant::now(),
                tests_done: 0,
            });
            program
        };
        let start = Instant::now();
        let (status, said, tests) = run_one(&program, order, board)?;
        let took = start.elapsed();
        let mut board = lock(board);
        board.running.retain(|it| it.name != program.name);
        board.programs_done += 1;
        board.tests_done += program.tests.len().max(1);
        board.seconds_done += took.as_secs_f64();
        board.times.note(&program.name, took);
        board.outcome.tests.extend(tests);
        let end = match status.success() {
            true => "ok",
            false => "FAILED",
        };
        if !status.success() {
            board.outcome.failed.push(program.name.clone());
        }
        let count = match program.tests.len() {
            0 => String::new(),
            1 => "1 test, ".into(),
            count => format!("{count} tests, "),
        };
        let line = format!(
            "{}: {count}{:.1} s ... {end}",
            program.name,
            took.as_secs_f64()
        );
        let is_heard = order.is_loud || !status.success();
        let said = is_heard.then(|| format!("{said}\n{}: {status}", program.name));
        // The receiver lives until all are over.
        let _ = news.send(News::Done { line, said });
    }
}

/// Runs a program. Returns its status, its output, and the time of each test.
///
/// The output goes to a file, because another process could keep a pipe open, for example a server
/// that a test left running.
fn run_one(
    program: &Program,
    order: &Order,
    board: &Mutex<Board>,
) -> Result<(ExitStatus, String, Vec<(Duration, String)>)> {
    let name = program.name.replace(['/', ' '], "-");
    let path = order.folder.join(name).with_extension("txt");
    let shown = path.display();
    let file = File::create(&path).with_context(|| format!("writing {shown}"))?;
    let mut written = File::open(&path).with_context(|| format!("reading {shown}"))?;
    let mut command = program.command();
    command
        .stdout(file.try_clone().context("the file of a program")?)
        .stderr(file);
    let child = command.spawn();
    let mut child = child.with_context(|| format!("starting {}", program.name))?;
    let mut watch = Watch::new(&program.tests);
    let mut said = Vec::new();
    let status = loop {
        let ended = child.try_wait().context("waiting for a test program")?;
        let before = said.len();
        written
            .read_to_end(&mut said)
            .with_context(|| format!("reading {shown}"))?;
        if watch.look(&said[before..], Instant::now()) {
            let mut board = lock(board);
            if let Some(running) = (board.running.iter_mut()).find(|it| it.name == program.name) {
                running.test = watch.current.clone();
                running.tests_done = watch.took.len();
            }
        }
        if let Some(status) = ended {
            break status;
        }
        std::thread::sleep(LOOK);
    };
    let tests = watch.end(Instant::now()).into_iter();
    let named = tests.map(|(took, test)| (took, format!("{} {test}", program.name)));
    let text = String::from_utf8_lossy(&said).into_owned();
    Ok((status, text, named.collect()))
}

/// Finds the current test from a program's output. Programs that tests start may print the same
/// test again.
struct Watch<'a> {
    /// The tests that have not started.
    waiting: Vec<&'a str>,
    current: Option<(String, Instant)>,
    took: Vec<(Duration, String)>,
    line: Vec<u8>,
}

impl<'a> Watch<'a> {
    fn new(tests: &'a [String]) -> Watch<'a> {
        Watch {
            waiting: tests.iter().map(String::as_str).collect(),
            current: None,
            took: Vec::new(),
            line: Vec::new(),
        }
    }

    /// Reads more bytes. Returns whether a test has started.
    fn look(&mut self, bytes: &[u8], now: Instant) -> bool {
        let mut is_new = false;
        for &byte in bytes {
            match byte {
                b'\n' => self.line.clear(),
                _ => self.line.push(byte),
            }
            // `test NAME ... `, and `test NAME - should panic ... `.
            if byte == b' ' && self.line.ends_with(b" ... ") {
                is_new |= self.start(now);
            }
        }
        is_new
    }

    /// The current line may be the start of a test.
    fn start(&mut self, now: Instant) -> bool {
        let line = String::from_utf8_lossy(&self.line);
        let Some(rest) = line.strip_prefix("test ") else {
            return false;
        };
        let name = rest.split(' ').next().unwrap_or_default();
        let Some(place) = self.waiting.iter().position(|test| *test == name) else {
            return false;
        };
        let name = self.waiting.swap_remove(place).to_owned();
        self.finish(now);
        self.current = Some((name, now));
        true
    }

    fn finish(&mut self, now: Instant) {
        if let Some((name, since)) = self.current.take() {
            self.took.push((now - since, name));
        }
    }

    fn end(mut self, now: Instant) -> Vec<(Duration, String)> {
        self.finish(now);
        self.took
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Output of a program with a test that runs the program again.
    #[test]
    fn tests_are_timed_by_when_the_next_one_starts() {
        let names = ["a::first", "b::alone", "c::last"].map(str::to_owned);
        let mut watch = Watch::new(&names);
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        assert!(!watch.look(b"\nrunning 3 tests\ntest a::fi", at(0)));
        assert!(watch.look(b"rst ... ", at(1)));
        assert!(!watch.look(b"ok\n", at(2)));
        assert!(watch.look(
            b"test b::alone - should panic ... \nrunning 1 test\n",
            at(3)
        ));
        assert!(!watch.look(
            b"test b::alone - should panic ... ok\n\ntest result: ok. 1 passed\n",
            at(4)
        ));
        assert!(!watch.look(b"ok\ntest unknown ... \n", at(5)));
        assert!(watch.look(b"test c::last ... ok\n", at(6)));
        let took: Vec<_> = watch
            .end(at(10))
            .into_iter()
            .map(|(took, name)| (took.as_secs(), name))
            .collect();
        let expected = [(2, "a::first"), (3, "b::alone"), (4, "c::last")];
        assert_eq!(took, expected.map(|(took, name)| (took, name.to_owned())));
    }

    #[test]
    fn what_fails_is_named_and_heard() {
        let folder = std::env::temp_dir().join(format!("tuff-runs-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let shell = |name: &str, line: &str| {
            let mut shell = std::process::Command::new("sh");
            shell.args(["-c", line]).current_dir(&folder);
            Program::alone(name, &shell)
        };
        // A program's child that continues to run is not waited for.
        let programs = vec![
            shell("good", "sleep 60 & exit 0"),
            shell("bad", "echo why >&2; exit 3"),
            shell("dead", "kill $$"),
        ];
        let order = Order {
            at_a_time: 2,
            is_loud: false,
            folder: folder.clone(),
        };
        let outcome = run(programs, Times::read(&folder.join("times")), &order).unwrap();
        let said = std::fs::read_to_string(folder.join("bad.txt")).unwrap();
        let times = Times::read(&folder.join("times"));
        std::fs::remove_dir_all(&folder).unwrap();
        let mut failed = outcome.failed.clone();
        failed.sort();
        assert_eq!(failed, ["bad", "dead"]);
        assert!(outcome.text().contains("FAILED: bad"));
        assert_eq!(said, "why\n");
        assert!(times.of("good").is_some());
    }

    /// On this very program, some of whose tests are run again.
    #[test]
    fn what_programs_print_tells_their_tests() {
        let mut again = std::process::Command::new(std::env::current_exe().unwrap());
        again.args(["--test-threads=1", "test::times::", "test::programs::"]);
        let program = Program::of_tests("again", &again).unwrap();
        let mut expected = program.tests.clone();
        expected.sort();
        assert!(expected.len() > 1, "{expected:?}");
        let folder = std::env::temp_dir().join(format!("tuff-again-{}", std::process::id()));
        let order = Order {
            at_a_time: 1,
            is_loud: false,
            folder: folder.clone(),
        };
        let outcome = run(vec![program], Times::read(&folder.join("times")), &order).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(outcome.failed, [""; 0]);
        let seen = outcome.tests.into_iter().map(|(_, name)| name);
        let mut seen: Vec<_> = seen.map(|it| it.replacen("again ", "", 1)).collect();
        seen.sort();
        assert_eq!(seen, expected);
    }
}
