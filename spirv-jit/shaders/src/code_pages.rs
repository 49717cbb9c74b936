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
