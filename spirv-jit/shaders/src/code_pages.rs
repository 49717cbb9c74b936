//! Executable pages for programs of tests, examples and searches, so that these run native code as
//! the driver does.

use std::ptr::NonNull;

use spirv_jit::native::{CodePages, provide};

/// Has programs that are made from now on run native code.
pub fn allow_native_code() {
    // SAFETY: both functions' documentation promises it.
    provide(Some(unsafe { CodePages::new(map, unmap) }));
}

/// Copies code into new pages, which are made read-only and executable then. `None` where the
/// system refuses that.
pub fn map(code: &[u8]) -> Option<NonNull<u8>> {
    let length = code.len().max(1);
    // SAFETY: new pages, which no other code knows yet; they are as long as the copied code.
    unsafe {
        let start = libc::mmap(
            std::ptr::null_mut(),
            length,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
            -1,
            0,
        );
        if start == libc::MAP_FAILED {
            return None;
        }
        let start = NonNull::new(start.cast::<u8>())?;
        start.copy_from_nonoverlapping(NonNull::from(code).cast(), code.len());
        let rights = libc::PROT_READ | libc::PROT_EXEC;
        if libc::mprotect(start.as_ptr().cast(), length, rights) != 0 {
            unmap(start, code.len());
            return None;
        }
        Some(start)
    }
}

/// Gives the pages of code back.
///
/// # Safety
/// [`map`] gave them for code of this length, and nothing runs it any more.
pub unsafe fn unmap(start: NonNull<u8>, length: usize) {
    // SAFETY: the caller's promise.
    unsafe { libc::munmap(start.as_ptr().cast(), length.max(1)) };
}

#[cfg(all(test, feature = "glsl", target_arch = "x86_64"))]
mod tests {
    use spirv_jit::Tier;
    use spirv_jit::program::Stage;

    use crate::{compute, glsl};

    #[test]
    fn programs_of_tests_have_native_code() {
        let source = "
            layout(local_size_x = 16) in;
            layout(set = 0, binding = 0) buffer B { float x[]; };
            void main() {
                float y = x[gl_LocalInvocationIndex];
                x[gl_LocalInvocationIndex] = y * y + y;
            }";
        let program = compute::compile(&glsl(Stage::Compute, source));
        assert_eq!(program.has_native_code(), Tier::best() != Tier::Portable);
    }
}
