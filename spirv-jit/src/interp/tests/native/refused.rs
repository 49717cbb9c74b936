//! Where the system refuses executable memory.

#![cfg(all(target_arch = "x86_64", target_os = "linux"))]

use lanes::Tier as TierKind;

use super::{Writer, assert_alike, run};
use crate::ir::{Module, Type};
use crate::native::Executable;
use crate::program::Program;

/// Has the calling thread's `mprotect` refuse executable pages, as services under
/// `MemoryDenyWriteExecute` and SELinux have it.
fn deny_executable_pages() {
    use libc::{BPF_ABS, BPF_JEQ, BPF_JMP, BPF_JSET, BPF_K, BPF_LD, BPF_RET, BPF_W};
    let filter = |code: u32, jt, jf, k| libc::sock_filter {
        code: code as u16,
        jt,
        jf,
        k,
    };
    // Of `seccomp_data`: the system call's number, and the lower half of its third argument.
    let (number, protection) = (0, 16 + 2 * 8);
    let allow = libc::SECCOMP_RET_ALLOW;
    let refuse = libc::SECCOMP_RET_ERRNO | libc::EPERM as u32;
    let mut filters = [
        filter(BPF_LD | BPF_W | BPF_ABS, 0, 0, number),
        filter(BPF_JMP | BPF_JEQ | BPF_K, 0, 3, libc::SYS_mprotect as u32),
        filter(BPF_LD | BPF_W | BPF_ABS, 0, 0, protection),
        filter(BPF_JMP | BPF_JSET | BPF_K, 0, 1, libc::PROT_EXEC as u32),
        filter(BPF_RET | BPF_K, 0, 0, refuse),
        filter(BPF_RET | BPF_K, 0, 0, allow),
    ];
    let program = libc::sock_fprog {
        len: filters.len() as u16,
        filter: filters.as_mut_ptr(),
    };
    // SAFETY: the filter is read during the call; both bind this thread alone.
    unsafe {
        assert_eq!(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), 0);
        let mode = libc::SECCOMP_MODE_FILTER;
        assert_eq!(libc::prctl(libc::PR_SET_SECCOMP, mode, &program), 0);
    }
}

fn module() -> Module {
    let mut w = Writer::new(2, 2);
    let a = w.line(Type::F32, "input[0]");
    let b = w.line(Type::F32, "input[1]");
    let product = w.op(Type::F32, "fmul", &[&a, &b]);
    let sum = w.op(Type::F32, "fadd", &[&product, &a]);
    let least = w.op(Type::F32, "fmin", &[&sum, &product]);
    w.end(&[sum, least]).0
}

#[test]
fn programs_without_executable_memory_are_interpreted() {
    let module = module();
    let tier = TierKind::best();
    let native = Program::with_tier(&module, tier).unwrap();
    assert_eq!(native.has_native_code(), tier != TierKind::Portable);
    let expected = run(native, 1, 3);
    let refused = std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            deny_executable_pages();
            assert!(Executable::new(&[0xc3]).is_none());
            let program = Program::with_tier(&module, tier).unwrap();
            assert!(!program.has_native_code());
            run(program, 1, 3)
        });
        thread.join().unwrap()
    });
    assert_alike(&refused, &expected, &[true; 2], || "refused".into());
}

/// Pages that hold code may be read and run, and not written.
#[test]
fn code_is_not_writable() {
    let code = Executable::new(&[0xc3]).expect("memory");
    let address = code.start() as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").expect("maps");
    // Neighbouring pages of other programs may stand in the same line.
    let holds = |line: &&str| {
        let mut ends = line.split([' ', '-']);
        let mut end = || usize::from_str_radix(ends.next()?, 16).ok();
        matches!((end(), end()), (Some(from), Some(to)) if (from..to).contains(&address))
    };
    let line = maps.lines().find(holds);
    let line = line.unwrap_or_else(|| panic!("{address:x} in {maps}"));
    assert_eq!(line.split(' ').nth(1), Some("r-xp"));
}
