//! Several workgroups in a wave, with memory and barriers of their own.

use std::time::{Duration, Instant};

use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::ir::text::parse_module;

use super::super::{Dispatch, Plan};
use super::{no_limits, run, words, zeros};
use crate::wave::Limits;

/// A guard against hanging: nothing here takes as long.
pub fn guarded() -> Limits {
    Limits {
        deadline: Some(Instant::now() + Duration::from_secs(120)),
        ..no_limits()
    }
}

/// Workgroups of a step.
fn per_step(text: &str, workgroups: u32, workers: usize) -> u64 {
    let program = Program::new(&parse_module(text).unwrap()).unwrap();
    let dispatch = Dispatch {
        program: &program,
        base: [0; 3],
        count: [workgroups, 1, 1],
        environment: &Environment::unbound(),
        limits: &no_limits(),
        observer: None,
    };
    Plan::new(&dispatch, workers).workgroups_per_step
}

/// Workgroups of so many invocations, which reverse their numbers by way of that much memory, in as
/// many turns as the workgroup's number says: after an odd number of turns they stand in reverse.
/// Each invocation stores its number at the end.
fn reversing(invocations: u32, shared_bytes: u32) -> String {
    let last = 4 * (invocations - 1);
    format!(
        "module compute
        inputs local_invocation_index.0, workgroup_id.0
        local_size {invocations}, 1, 1
        shared {shared_bytes}
        func f0 {{
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = input[1]
            v4: i32 = const 1
            v5: i32 = const 2
            v6: i32 = shl v2, v5
            v7: i32 = const {last}
            v8: i32 = isub v7, v6
            v20: i32 = const {invocations}
            v21: i32 = imul v3, v20
            v22: i32 = iadd v21, v2
            block L3 -> (v30: i32) {{
                loop L0 (v9: i32, v10: i32) = (v0, v22) {{
                    v11: i1 = ult v9, v3
                    if v11, L1 {{
                        br L1
                    }} else {{
                        br L3(v10)
                    }}
                    store.shared v6, v10
                    barrier
                    v12: i32 = load.shared v8
                    barrier
                    v13: i32 = iadd v9, v4
                    br L0(v13, v12)
                }}
                unreachable
            }}
            v23: i32 = shl v22, v5
            store.buffer v1, v23, v30
            end
        }}"
    )
}

#[test]
fn workgroups_of_a_wave_have_memory_and_barriers_of_their_own() {
    for invocations in [1, 7, 16, 17, 40, 64, 100, 255, 1024] {
        let workgroups = 37.min(4096 / invocations);
        let text = reversing(invocations, 4 * invocations);
        for threads in [1, 3] {
            let out = zeros((invocations * workgroups) as usize);
            let count = [workgroups, 1, 1];
            assert_eq!(run(&text, threads, [0; 3], count, &out, &guarded()), Ok(()));
            for (index, word) in words(&out).into_iter().enumerate() {
                let (workgroup, index) = (index as u32 / invocations, index as u32 % invocations);
                let from = match workgroup % 2 {
                    0 => index,
                    _ => invocations - 1 - index,
                };
                assert_eq!(
                    word,
                    workgroup * invocations + from,
                    "{invocations}: {workgroup}, {index}"
                );
            }
        }
    }
}

#[test]
fn steps_have_as_many_workgroups_as_fit() {
    // A wave has sixteen subgroups.
    assert_eq!(per_step(&reversing(64, 1 << 10), 1000, 1), 4);
    assert_eq!(per_step(&reversing(40, 1 << 10), 1000, 1), 5);
    assert_eq!(per_step(&reversing(1024, 1 << 10), 1000, 1), 1);
    // 256 KiB of workgroup memory.
    assert_eq!(per_step(&reversing(16, 64 << 10), 1000, 1), 4);
    assert_eq!(per_step(&reversing(16, 48 << 10), 1000, 1), 5);
    // A step for each worker.
    assert_eq!(per_step(&reversing(16, 1 << 10), 24, 8), 3);
    assert_eq!(per_step(&reversing(16, 1 << 10), 5, 8), 1);
    // Workgroups that may wait for each other.
    let waits =
        reversing(16, 1 << 10).replace("v13:", "v40: i32 = load.buffer.volatile v1, v0\nv13:");
    assert_eq!(per_step(&waits, 1000, 1), 1);
}

/// Workgroup 1 spins until workgroup 0 has passed a barrier. Its loads are plain, so that both run
/// in one wave.
#[test]
fn a_barrier_is_released_for_its_workgroup_alone() {
    let text = "module compute
        inputs local_invocation_index.0, workgroup_id.0
        local_size 32, 1, 1
        func f0 {
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = input[1]
            v4: i32 = const 1
            v5: i1 = ieq v3, v4
            if v5, L0 {
                loop L1 {
                    v6: i32 = load.buffer v1, v0
                    v7: i1 = ieq v6, v0
                    if v7, L2 {
                        br L1
                    } else {
                        br L2
                    }
                    br L0
                }
                unreachable
            } else {
                br L0
            }
            barrier
            v8: i32 = or v2, v3
            v9: i1 = ieq v8, v0
            if v9, L3 {
                store.buffer v1, v0, v4
                br L3
            } else {
                br L3
            }
            barrier
            v10: i32 = const 4
            v11: i32 = atomic.iadd.buffer v1, v10, v4
            end
        }";
    assert_eq!(per_step(text, 2, 1), 2);
    let out = zeros(2);
    assert_eq!(run(text, 1, [0; 3], [2, 1, 1], &out, &guarded()), Ok(()));
    assert_eq!(words(&out), [1, 64]);
}

/// Workgroups wait in pairs, each for the other. With two workers they end if they start in order:
/// one that waits alone is the last that has started.
#[test]
fn workgroups_that_may_wait_start_in_order() {
    let text = "module compute
        inputs workgroup_id.0
        local_size 1, 1, 1
        func f0 {
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = const 1
            v4: i32 = const 2
            v5: i32 = lshr v2, v3
            v6: i32 = shl v5, v4
            v7: i32 = atomic.iadd.buffer v1, v6, v3
            block L2 {
                loop L0 {
                    v8: i32 = atomic.iadd.buffer v1, v6, v0
                    v9: i1 = ult v8, v4
                    if v9, L1 {
                        br L0
                    } else {
                        br L1
                    }
                    br L2
                }
                unreachable
            }
            barrier
            end
        }";
    let out = zeros(50);
    assert_eq!(run(text, 2, [0; 3], [100, 1, 1], &out, &guarded()), Ok(()));
    assert_eq!(words(&out), [2; 50]);
}

/// Workgroup 1 comes to a barrier in a loop again and again, until workgroup 0, which has left the
/// loop, has gone on.
#[test]
fn a_workgroup_that_has_left_a_loop_goes_on() {
    let text = "module compute
        inputs local_invocation_index.0, workgroup_id.0
        local_size 32, 1, 1
        func f0 {
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = input[1]
            v4: i32 = const 1
            loop L1 {
                v5: i32 = load.buffer v1, v0
                barrier
                v6: i32 = isub v4, v3
                v7: i32 = or v5, v6
                v8: i1 = ieq v7, v0
                if v8, L2 {
                    br L1
                } else {
                    br L2
                }
                v9: i32 = or v2, v3
                v10: i1 = ieq v9, v0
                if v10, L3 {
                    store.buffer v1, v0, v4
                    br L3
                } else {
                    br L3
                }
                v11: i32 = const 4
                v12: i32 = atomic.iadd.buffer v1, v11, v4
                end
            }
            unreachable
        }";
    assert_eq!(per_step(text, 2, 1), 2);
    let out = zeros(2);
    assert_eq!(run(text, 1, [0; 3], [2, 1, 1], &out, &guarded()), Ok(()));
    assert_eq!(words(&out), [1, 64]);
}
