//! The guard around each entry point: a panic never crosses the C boundary.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

use ash::vk;
use log::Level;
use parking_lot::Mutex;

use crate::VkResult;
use crate::float_environment::DefaultEnvironment;

/// The value that an entry point returns after a panic.
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

/// Runs an entry point's body in the default floating-point environment; a panic is logged once and
/// becomes [`OnPanic::on_panic`].
pub fn guard<R: OnPanic>(name: &str, body: impl FnOnce() -> R) -> R {
    let _environment = DefaultEnvironment::enter();
    catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|payload| {
        log::error!("{name} panicked: {}", panic_text(&*payload));
        R::on_panic()
    })
}

thread_local! {
    /// Where this thread panicked last.
    static PANICKED_AT: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Where any thread of the driver panicked last: a pool hands a worker's panic to the thread that
/// waits for it.
static LAST_PANIC_AT: Mutex<String> = Mutex::new(String::new());

/// From now on the panics of this library are printed where they are caught, as `TUFF_LOG` has it,
/// and not when they begin. (The standard library is linked statically: the application's own
/// panics have another hook.)
pub fn catch_panic_messages() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            let place = info.location().map(|place| format!(" at {place}"));
            let place = place.unwrap_or_default();
            log::debug!("panic{place}");
            LAST_PANIC_AT.lock().clone_from(&place);
            PANICKED_AT.with(|at| *at.borrow_mut() = place);
        }));
    });
}

/// The message of a panic, and where it was: on this thread, or else the last on any.
pub fn panic_text(payload: &(dyn std::any::Any + Send)) -> String {
    let mut place = PANICKED_AT.with(|at| std::mem::take(&mut *at.borrow_mut()));
    if place.is_empty() {
        place.clone_from(&LAST_PANIC_AT.lock());
    }
    format!("{}{place}", panic_message(payload))
}

/// The text of a panic, where it has one.
fn panic_message(payload: &(dyn std::any::Any + Send)) -> &str {
    payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}

/// Says that a command was refused: every error has a line, if only for those who ask for warnings.
/// That a format is not supported is the answer to a question.
pub fn refused(name: &str, code: vk::Result) {
    let level = match code {
        vk::Result::ERROR_FORMAT_NOT_SUPPORTED => Level::Debug,
        _ => Level::Warn,
    };
    if code.as_raw() < 0 {
        log::log!(level, "{name}: {code:?}");
    }
}

/// As [`guard`], for entry points that return `VkResult`. An error is [logged](refused).
pub fn guard_result(name: &str, body: impl FnOnce() -> VkResult) -> vk::Result {
    let result = guard(name, body);
    if let Err(code) = result {
        refused(name, code);
    }
    code(result)
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
