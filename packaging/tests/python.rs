//! The Python package on Windows, with substitutes for Windows' interfaces. packaging/python/tests
//! tests the wheel on Linux.

use std::path::Path;
use std::process::Command;

/// Replaces Python's modules by substitutes for those of Windows: `rights` is the integrity level,
/// `registered` the manifests in the registry, and `has_loader` whether the system has a loader.
const WINDOWS: &str = r#"
import ctypes, os, sys, types, subprocess, signal
sys.path.insert(0, sys.argv[1])
sys.platform, os.pathsep = "win32", ";"
rights, registered, has_loader, opened = 0x2000, [], True, []

class Function:
    def __init__(self, function): self.function = function
    def __call__(self, *words): return self.function(*words)

def integrity(token, kind, label, size, length):
    assert kind == 25
    label[0] = 1
    return 1

def WinDLL(name):
    return types.SimpleNamespace(
        GetCurrentProcess=Function(lambda: 1), CloseHandle=Function(lambda token: 1),
        OpenProcessToken=Function(lambda process, access, token: 1), GetTokenInformation=Function(integrity),
        GetSidSubAuthorityCount=Function(lambda sid: [1]), GetSidSubAuthority=Function(lambda sid, index: [rights]))

def CDLL(name, mode=0, winmode=None):
    if name == "vulkan-1.dll":
        assert winmode == 0
        if not has_loader: raise OSError("not found")
    opened.append(name)
    return object()

class Key:
    def __enter__(self): return self
    def __exit__(self, *_): pass

ctypes.WinDLL, ctypes.CDLL = WinDLL, CDLL
sys.modules["winreg"] = types.SimpleNamespace(
    HKEY_LOCAL_MACHINE=0, OpenKey=lambda root, key: Key(), QueryInfoKey=lambda key: (0, len(registered), 0),
    EnumValue=lambda key, index: (registered[index], 0, 4))
os.environ["PATH"] = "C:\\Windows"
os.path.samefile = lambda a, b: str(a) == str(b)
import tuff

def error():
    try: tuff.activate()
    except RuntimeError as error: return str(error)

assert tuff.program().name == "tuff.exe"
"#;

fn runs(test: &str) {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("python");
    let mut python = Command::new("python3");
    python.env("PYTHONDONTWRITEBYTECODE", "1");
    python
        .args(["-c", &format!("{WINDOWS}{test}")])
        .arg(sources);
    let output = python.output().expect("python3 starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
}

#[test]
fn the_driver_is_selected() {
    runs(
        r#"
os.environ["VK_ADD_DRIVER_FILES"] = "C:\\other.json"
assert error() is None
assert os.environ["VK_DRIVER_FILES"] == str(tuff.manifest())
assert os.environ["PATH"] == "C:\\Windows" and "VK_ADD_DRIVER_FILES" not in os.environ
"#,
    );
}

#[test]
fn a_loader_that_came_along_is_opened_and_found_by_children() {
    runs(
        r#"
has_loader = False
assert "winget install KhronosGroup.VulkanRT" in error()
from pathlib import Path
own = Path("/prefix/lib/tuff/loader/vulkan-1.dll")
tuff.loader = lambda: own
assert error() is None
assert opened == [str(own)], opened
assert os.environ["PATH"] == f"C:\\Windows;{own.parent}"
"#,
    );
}

#[test]
fn administrators_need_a_registered_driver() {
    runs(
        r#"
rights = 0x3000
assert "say `tuff install`" in error()
registered.append("C:\\other.json")
assert "say `tuff install`" in error()
registered.append(str(tuff.manifest()))
assert error() is None
"#,
    );
}

#[test]
fn the_command_ends_with_the_program() {
    runs(
        r#"
import tuff.__main__
for code, expected in [(0, 0), (7, 7), (0xC000013A, 0xC000013A - (1 << 32))]:
    subprocess.call = lambda words: code
    try: tuff.__main__.main()
    except SystemExit as end: assert end.code == expected, end.code
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
"#,
    );
}
