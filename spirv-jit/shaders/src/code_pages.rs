//! Executable pages for programs of tests, examples and searches, so that these run native code as
//! the driver does: its own source.

#[cfg_attr(unix, path = "../../../icd/src/os/unix/executable.rs")]
#[cfg_attr(windows, path = "../../../icd/src/os/windows/executable.rs")]
mod executable;

use spirv_jit::native::CodePages;

pub use executable::{map, unmap};

// SAFETY: `map` and `unmap` keep the trait's contract, as they document.
const CODE_PAGES: CodePages = unsafe { CodePages::new(map, unmap) };

/// Has programs that are made from now on run native code.
pub fn allow_native_code() {
    spirv_jit::native::provide(Some(CODE_PAGES));
}
