//! Memory of invocations in flight, and limits while it is made.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::{no_limits, run, words, zeros};
use crate::wave::{Budget, Limits, Stopped};

/// Counts one for each invocation by way of private memory of that many rows.
fn counting(invocations: u32, rows: u32) -> String {
    format!(
        "module compute
        inputs global_invocation_id.0
        local_size {invocations}, 1, 1
        func f0 {{
            var0: {rows} rows zero
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = const 2
            v4: i32 = shl v2, v3
            v5: i32 = const 1
            var.store[var0, 7] v5
            v6: i32 = var.load[var0, 7]
            v7: i32 = atomic.iadd.buffer v1, v4, v6
            end
        }}"
    )
}

fn within(bytes: usize) -> Limits {
    Limits {
        memory: Arc::new(Budget::new(bytes)),
        ..no_limits()
    }
}

#[test]
fn workers_without_memory_leave_the_work_to_others() {
    // 256 KiB a subgroup, 4 MiB and a little a step.
    const STEP: usize = 4 << 20;
    let text = counting(64, 4096);
    let invocations = 64 * 64;
    for workers in [1, 2, 20] {
        let bytes = workers * (STEP + (1 << 20));
        let limits = within(bytes);
        let out = zeros(invocations);
        let result = run(&text, 8, [0; 3], [64, 1, 1], &out, &limits);
        assert_eq!(result, Ok(()), "room for {workers}");
        assert_eq!(words(&out), vec![1; invocations]);
        assert!(limits.memory.take(bytes), "not all was given back");
    }
    for threads in [1, 8] {
        let limits = within(STEP);
        let out = zeros(invocations);
        let result = run(&text, threads, [0; 3], [64, 1, 1], &out, &limits);
        assert_eq!(result, Err(Stopped::OutOfMemory));
        assert_eq!(words(&out), vec![0; invocations]);
        assert!(limits.stopped_at.get().is_some(), "the place is told");
        assert!(limits.memory.take(STEP), "not all was given back");
    }
}

#[test]
fn limits_hold_while_memory_is_made() {
    // 64 MiB and a little for one workgroup, which burns next to no fuel.
    let text = counting(1024, 1 << 14);
    for cancelled in [false, true] {
        let limits = no_limits();
        limits.cancelled.store(cancelled, Ordering::Relaxed);
        let out = zeros(1024);
        let result = run(&text, 1, [0; 3], [1, 1, 1], &out, &limits);
        let expected = match cancelled {
            true => Err(Stopped::TimedOut),
            false => Ok(()),
        };
        assert_eq!(result, expected);
        assert_eq!(words(&out), vec![u32::from(!cancelled); 1024]);
    }
}
