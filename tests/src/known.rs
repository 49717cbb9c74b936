//! Failures of other drivers that are known, each with its reason: nothing is ever skipped.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::Gpu;

/// Runs a check that is known to fail, for the reason given, on drivers whose device's name
/// contains `driver`. There it must fail: when it starts to pass, the exception has to go.
pub fn unless_known(gpu: &Gpu, driver: &str, reason: &str, check: impl FnOnce()) {
    if !gpu.name().contains(driver) {
        return check();
    }
    match catch_unwind(AssertUnwindSafe(check)) {
        Ok(()) => panic!("this passes now: it was thought that on {driver} {reason}"),
        Err(_) => println!("known to fail on {driver}: {reason}"),
    }
}
