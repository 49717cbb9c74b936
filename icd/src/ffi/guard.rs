//! The guard around each entry point: a panic never crosses the C boundary.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ash::vk;

use crate::VkResult;
use crate::log::{self, Level};

/// What an entry point gives its caller when it panicked.
pub trait OnPanic {
    fn on_panic() -> Self;
}

impl OnPanic for VkResult {
    fn on_panic() -> Self {
        Err(vk::Result::ERROR_UNKNOWN)
    }
}

macro_rules! default_on_panic {
    ($($ty:ty),*) => {$(
        impl OnPanic for $ty {
            fn on_panic() -> Self {
                Default::default()
            }
        }
    )*};
}
default_on_panic!((), u32, u64, vk::PFN_vkVoidFunction);

/// Runs an entry point's body; a panic is logged once and becomes [`OnPanic::on_panic`].
pub fn guard<R: OnPanic>(name: &str, body: impl FnOnce() -> R) -> R {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|payload| {
        log::write(
            Level::Error,
            &format!("{name} panicked: {}", panic_message(&*payload)),
        );
        R::on_panic()
    })
}

/// The text of a panic, where it has one.
pub fn panic_message(payload: &(dyn std::any::Any + Send)) -> &str {
    payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}

/// The code of a result.
pub fn code(result: VkResult) -> vk::Result {
    match result {
        Ok(()) => vk::Result::SUCCESS,
        Err(code) => code,
    }
}

/// Defines entry points: C functions whose bodies run inside [`guard`]. A body of a function that returns `vk::Result` gives a
/// [`VkResult`].
macro_rules! entry {
    () => {};
    ($(#[$meta:meta])* fn $name:ident($($arg:ident: $ty:ty),* $(,)?) -> vk::Result $body:block $($rest:tt)*) => {
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($($arg: $ty),*) -> vk::Result {
            $crate::ffi::guard::code($crate::ffi::guard::guard(stringify!($name), move || -> $crate::VkResult {
                // SAFETY: the application keeps this command's valid usage: handles are alive and of their type, pointers are valid
                // for what they count, chains are well formed, what is externally synchronised is not used elsewhere.
                #[allow(unused_unsafe)]
                unsafe { $body }
            }))
        }
        $crate::ffi::entry! { $($rest)* }
    };
    ($(#[$meta:meta])* fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block $($rest:tt)*) => {
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($($arg: $ty),*) $(-> $ret)? {
            $crate::ffi::guard::guard(stringify!($name), move || $(-> $ret)? {
                // SAFETY: as above.
                #[allow(unused_unsafe)]
                unsafe { $body }
            })
        }
        $crate::ffi::entry! { $($rest)* }
    };
}
pub(crate) use entry;

/// Defines `vkCmd*` entry points. The body gets the command buffer's recorder under the first argument's name and gives a
/// [`VkResult`]; an error or a panic becomes what `vkEndCommandBuffer` returns.
macro_rules! commands {
    ($($(#[$meta:meta])* fn $name:ident($buffer:ident $(, $arg:ident: $ty:ty)* $(,)?) $body:block)*) => {$(
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($buffer: ash::vk::CommandBuffer $(, $arg: $ty)*) {
            // SAFETY: the handle is a live command buffer.
            let command_buffer = unsafe { $crate::handle::from_handle::<$crate::command::CommandBuffer>($buffer) };
            let mut recording = command_buffer.recording.lock();
            let $buffer = &mut *recording;
            let result = $crate::ffi::guard::guard(stringify!($name), || -> $crate::VkResult {
                // SAFETY: the application keeps this command's valid usage.
                #[allow(unused_unsafe)]
                unsafe { $body }
            });
            if let Err(code) = result {
                recording.fail(code);
            }
        }
    )*};
}
pub(crate) use commands;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error() {
        assert!(
            guard("test", || -> VkResult { panic!("expected by a test") })
                == Err(vk::Result::ERROR_UNKNOWN)
        );
        assert_eq!(guard("test", || -> u64 { panic!("expected by a test") }), 0);
    }
}
