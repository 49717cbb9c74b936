//! The guard around each entry point: a panic never crosses the C boundary.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ash::vk;

use crate::VkResult;
use crate::float_environment::DefaultEnvironment;
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

/// Runs an entry point's body in the default floating-point environment; a panic is logged once and becomes [`OnPanic::on_panic`].
pub fn guard<R: OnPanic>(name: &str, body: impl FnOnce() -> R) -> R {
    let _environment = DefaultEnvironment::enter();
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
