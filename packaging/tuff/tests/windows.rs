//! The program on Windows: the registry, exit codes, Ctrl-C, and lines of its shells. Under Wine by
//! `cargo xtask test --target x86_64-pc-windows-gnu`.

#![cfg(windows)]

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use windows_sys::Win32::System::Console::{
    AllocConsole, CTRL_C_EVENT, FreeConsole, GenerateConsoleCtrlEvent, SetConsoleCtrlHandler,
};

/// A folder with a manifest and the library that it names, gone at the end. Its name has a space
/// and letters outside of ASCII.
struct Installed(PathBuf);

impl Installed {
    fn new(name: &str) -> Installed {
        let name = format!("tuff {name} {} Jürgen ż", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder).expect("a folder can be made");
        fs::write(folder.join("lib.dll"), "").expect("written");
        let manifest = r#"{"ICD": {"library_path": ".\\lib.dll"}}"#;
        fs::write(folder.join("tuff_icd.json"), manifest).expect("written");
        Installed(folder)
    }

    fn manifest(&self) -> String {
        self.0.join("tuff_icd.json").display().to_string()
    }

    fn tuff(&self, words: &[&str]) -> Command {
        let mut tuff = Command::new(env!("CARGO_BIN_EXE_tuff"));
        tuff.args(["--manifest", &self.manifest()]).args(words);
        tuff
    }

    fn output(&self, words: &[&str]) -> Output {
        self.tuff(words).output().expect("it starts")
    }
}

impl Drop for Installed {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The output of `reg query` for both halves.
fn registered() -> String {
    let of = |root: &str| {
        let key = format!(r"{root}\SOFTWARE\Khronos\Vulkan\Drivers");
        let reg = Command::new("reg").args(["query", &key]).output();
        text(&reg.expect("reg starts").stdout)
    };
    of("HKLM") + &of("HKCU")
}

#[test]
fn drivers_are_registered_and_taken_out() {
    let installed = Installed::new("install");
    // Other versions may be registered.
    let before = registered();
    let output = installed.output(&["install"]);
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    assert!(said.starts_with("registered for "), "{said}");
    let found = registered();
    let mut lines = found.lines().filter(|line| !before.contains(line));
    let line = lines.find(|line| line.contains("tuff_icd.json"));
    let line = line.expect("the value").trim();
    assert!(
        line.contains("REG_DWORD") && line.ends_with("0x0"),
        "{line}"
    );
    // The loader reads nothing else.
    assert!(line.is_ascii(), "{line}");
    let path = line.split("    ").next().expect("a path");
    assert!(fs::read(path).is_ok(), "{path}");
    let again = installed.output(&["install"]);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert_eq!(registered(), found);
    let info = text(&installed.output(&["info"]).stdout);
    assert!(
        info.contains("  registered  for ") && info.contains(path),
        "{info}"
    );
    // The files may be gone.
    fs::remove_file(installed.0.join("lib.dll")).expect("removed");
    fs::remove_file(installed.manifest()).expect("removed");
    let output = installed.output(&["uninstall"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(!registered().contains(path));
    let output = installed.output(&["uninstall"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("is not registered"),
        "{output:?}"
    );
    let output = installed.output(&["install"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("tuff_icd.json cannot be read"),
        "{output:?}"
    );
}

#[test]
fn programs_end_as_they_do_alone() {
    let installed = Installed::new("run");
    for code in [0, 7, 300] {
        let output = installed.output(&["run", "--", "cmd", "/c", &format!("exit {code}")]);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
    }
    let missing = installed.output(&["run", "no-such-program"]);
    assert_eq!(missing.status.code(), Some(127));
    assert!(text(&missing.stderr).contains("no-such-program: no such program"));
    let folder = installed.0.display().to_string();
    let output = installed.output(&["run", &folder]);
    assert_eq!(output.status.code(), Some(126), "{}", text(&output.stderr));
    let variable = installed.output(&["run", "cmd", "/c", "echo %VK_DRIVER_FILES%"]);
    assert!(
        text(&variable.stdout).contains("tuff_icd.json"),
        "{variable:?}"
    );
}

#[test]
fn shells_get_lines_that_they_read() {
    let installed = Installed::new("env");
    let output = installed.output(&["env"]);
    let lines = text(&output.stdout);
    assert!(
        output.status.success() && lines.is_ascii(),
        "{lines}{}",
        text(&output.stderr)
    );
    assert!(
        lines.contains("$env:VK_DRIVER_FILES = '") && lines.contains("[char]0x00fc"),
        "{lines}"
    );
    // A code page without the letters is an error that says what to do.
    let output = installed.output(&["env", "--shell", "cmd"]);
    match output.status.success() {
        true => assert!(text(&output.stdout).contains("set \"VK_DRIVER_FILES=")),
        false => assert!(text(&output.stderr).contains("chcp 65001"), "{output:?}"),
    }
}

/// Set for the children of the next test: the part of it that is theirs.
const PART: &str = "TUFF_TEST_PART";

#[test]
fn ctrl_c_is_the_programs() {
    const CODE: i32 = 42;
    unsafe extern "system" fn end(_: u32) -> i32 {
        std::process::exit(CODE)
    }
    let own = std::env::current_exe().expect("this program");
    let own = own.display().to_string();
    let words = ["--exact", "ctrl_c_is_the_programs", "--nocapture"];
    match std::env::var(PART).as_deref() {
        Ok("program") => {
            // SAFETY: the handler ends the process.
            unsafe { SetConsoleCtrlHandler(Some(end), 1) };
            eprintln!("waits");
            std::thread::sleep(Duration::from_secs(60));
        }
        Ok(_) => {
            unsafe extern "system" fn stay(_: u32) -> i32 {
                1
            }
            // SAFETY: plain system calls; the handler touches nothing.
            unsafe {
                FreeConsole();
                AllocConsole();
                SetConsoleCtrlHandler(Some(stay), 1);
            }
            let installed = Installed::new("ctrl");
            let mut tuff = installed.tuff(&["run", &own]);
            tuff.args(words).env(PART, "program");
            tuff.stderr(Stdio::piped()).stdout(Stdio::null());
            let mut child = tuff.spawn().expect("it starts");
            let mut said = BufReader::new(child.stderr.take().expect("a pipe")).lines();
            assert!(said.any(|line| line.is_ok_and(|line| line.contains("waits"))));
            // SAFETY: a plain system call. All processes of the console are told.
            let sent = unsafe { GenerateConsoleCtrlEvent(CTRL_C_EVENT, 0) };
            assert_ne!(sent, 0, "{}", std::io::Error::last_os_error());
            let rest: Vec<String> = said.map_while(Result::ok).collect();
            assert_eq!(
                child.wait().expect("it ends").code(),
                Some(CODE),
                "{rest:?}"
            );
        }
        Err(_) => {
            // A child can have a console of its own.
            let mut child = Command::new(&own);
            let output = child.args(words).env(PART, "console").output();
            let output = output.expect("it starts");
            let (said, errors) = (text(&output.stdout), text(&output.stderr));
            assert!(output.status.success(), "{said}{errors}");
        }
    }
}
