mod budget;
mod split_barriers;
mod workgroups;

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, MAX_SETS};
use spirv_jit::ir::text::parse_module;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::{Dispatch, Dispatcher};
use crate::wave::Workers;
use crate::wave::{Limits, Stopped};

fn no_limits() -> Limits {
    Limits::default()
}

/// Runs a program with `out` as its buffer (set 0, entry 0).
fn run(
    text: &str,
    threads: usize,
    base: [u32; 3],
    count: [u32; 3],
    out: &[AtomicU32],
    limits: &Limits,
) -> Result<(), Stopped> {
    // Programs have native code once the settings are read.
    crate::settings::settings();
    let program = Program::new(&parse_module(text).unwrap()).unwrap();
    let entry = Descriptor {
        address: out.as_ptr() as u64,
        size_bytes: size_of_val(out) as u64,
        ..Descriptor::NULL
    };
    let mut sets = [DescriptorSet::NONE; MAX_SETS];
    sets[0] = DescriptorSet {
        entries: &entry,
        count: 1,
        ..DescriptorSet::NONE
    };
    let environment = Environment {
        number: Environment::next_number(),
        sets,
        ..Environment::unbound()
    };
    let workers = Workers::new(threads);
    Dispatcher::default().run(
        &workers,
        &Dispatch {
            program: &program,
            base,
            count,
            environment: &environment,
            limits,
            observer: None,
        },
    )
}

fn zeros(len: usize) -> Vec<AtomicU32> {
    (0..len).map(|_| AtomicU32::new(0)).collect()
}

fn words(out: &[AtomicU32]) -> Vec<u32> {
    out.iter()
        .map(|word| word.load(Ordering::Relaxed))
        .collect()
}

#[test]
fn every_invocation_runs_once() {
    // Adds 1 + 1000 × workgroup to the word of each invocation's global id.
    let text = |[x, y]: [u32; 2]| {
        format!(
            "module compute
            inputs global_invocation_id.0, global_invocation_id.1, workgroup_id.0, workgroup_id.1
            local_size {x}, {y}, 1
            func f0 {{
                v0: i32 = const 0
                v1: i64 = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = input[1]
                v4: i32 = const 1024
                v5: i32 = imul v3, v4
                v6: i32 = iadd v5, v2
                v7: i32 = const 2
                v8: i32 = shl v6, v7
                v9: i32 = input[2]
                v10: i32 = input[3]
                v11: i32 = imul v10, v4
                v12: i32 = iadd v11, v9
                v13: i32 = const 1000
                v14: i32 = imul v12, v13
                v15: i32 = const 1
                v16: i32 = iadd v14, v15
                v17: i32 = atomic.iadd.buffer v1, v8, v16
                end
            }}"
        )
    };
    for local in [[1, 1], [16, 1], [5, 3], [7, 5], [32, 8]] {
        for threads in [1, 3] {
            let (base, count) = ([2, 1, 0], [9, 11, 1]);
            let out = zeros(1024 * 128);
            let result = run(&text(local), threads, base, count, &out, &no_limits());
            assert_eq!(result, Ok(()));
            for (index, word) in words(&out).into_iter().enumerate() {
                let id = [index as u32 % 1024, index as u32 / 1024];
                let group = [id[0] / local[0], id[1] / local[1]];
                let inside = (0..2).all(|i| (base[i]..base[i] + count[i]).contains(&group[i]));
                let expected = if inside {
                    1 + 1000 * (group[0] + 1024 * group[1])
                } else {
                    0
                };
                assert_eq!(word, expected, "{local:?} {id:?}");
            }
        }
    }
}

#[test]
fn a_barrier_orders_shared_memory() {
    // Each workgroup of 40 writes its indices to shared memory and reads them back reversed.
    let text = "module compute
        inputs local_invocation_index.0, workgroup_id.0
        local_size 40, 1, 1
        shared 160
        func f0 {
            v0: i32 = const 0
            v1: i64 = descriptor[set 0, first 0, count 1] v0
            v2: i32 = input[0]
            v3: i32 = input[1]
            v4: i32 = const 2
            v5: i32 = shl v2, v4
            v6: i32 = const 40
            v7: i32 = imul v3, v6
            v8: i32 = iadd v7, v2
            store.shared v5, v8
            barrier
            v9: i32 = const 156
            v10: i32 = isub v9, v5
            v11: i32 = load.shared v10
            v12: i32 = shl v8, v4
            store.buffer v1, v12, v11
            end
        }";
    let out = zeros(40 * 100);
    assert_eq!(
        run(text, 2, [0; 3], [100, 1, 1], &out, &no_limits()),
        Ok(())
    );
    for (index, word) in words(&out).into_iter().enumerate() {
        assert_eq!(word as usize, index / 40 * 40 + 39 - index % 40);
    }
}

/// Lane 31 sets a flag that lane 0, in another subgroup of its wave, spins for.
const SPIN: &str = "module compute
    inputs local_invocation_index.0
    local_size 32, 1, 1
    func f0 {
        v0: i32 = const 0
        v1: i64 = descriptor[set 0, first 0, count 1] v0
        v2: i32 = input[0]
        v3: i1 = ieq v2, v0
        v9: i32 = const 1
        if v3, L0 {
            loop L1 {
                v4: i32 = atomic.iadd.buffer v1, v0, v0
                v5: i1 = ieq v4, v0
                if v5, L2 {
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
        v6: i32 = const 31
        v7: i1 = ieq v2, v6
        if v7, L3 {
            v8: i32 = atomic.iadd.buffer v1, v0, v9
            br L3
        } else {
            br L3
        }
        end
    }";

#[test]
fn a_spinning_subgroup_does_not_hold_up_its_wave() {
    let out = zeros(1);
    assert_eq!(run(SPIN, 1, [0; 3], [1, 1, 1], &out, &no_limits()), Ok(()));
    assert_eq!(words(&out), [1]);
}

#[test]
fn a_spinning_workgroup_does_not_hold_up_its_neighbours() {
    // Workgroups of one invocation: the first spins until the second has set the flag.
    let text = SPIN
        .replace("local_invocation_index", "workgroup_id")
        .replace("local_size 32", "local_size 1")
        .replace("const 31", "const 1");
    let out = zeros(1);
    assert_eq!(run(&text, 1, [0; 3], [5, 1, 1], &out, &no_limits()), Ok(()));
    assert_eq!(words(&out), [1]);
}

#[test]
fn small_workgroups_share_subgroups() {
    // Every invocation of workgroups of three counts one.
    let text = |across: &str| {
        format!(
            "module compute
            inputs workgroup_id.0, local_invocation_index.0
            local_size 3, 1, 1
            func f0 {{
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = input[1]
                v4: i32 = const 12
                v5: i32 = imul v2, v4
                v6: i32 = const 2
                v7: i32 = shl v3, v6
                v8: i32 = iadd v5, v7
                {across}
                v9: i32 = const 1
                v10: i32 = atomic.iadd.buffer v1, v8, v9
                end
            }}"
        )
    };
    for (across, workgroups, subgroups) in [("", 10, 2), ("v20: i32 = lane_index", 10, 10)] {
        let text = text(across);
        let program = Program::new(&parse_module(&text).unwrap()).unwrap();
        let environment = Environment::unbound();
        let dispatch = Dispatch {
            program: &program,
            base: [0; 3],
            count: [workgroups, 1, 1],
            environment: &environment,
            limits: &no_limits(),
            observer: None,
        };
        let plan = super::Plan::new(&dispatch, 1);
        assert_eq!(plan.subgroups(workgroups as usize).count, subgroups);
        // However many subgroups run together, the same ones are filled.
        let in_step = plan.workgroups_per_step as usize * plan.invocations;
        assert!(!plan.packed || in_step.is_multiple_of(SUBGROUP_SIZE));
        let out = zeros(3 * 1000);
        assert_eq!(
            run(&text, 2, [0; 3], [999, 1, 1], &out, &no_limits()),
            Ok(())
        );
        let words = words(&out);
        assert!(words[..3 * 999].iter().all(|&word| word == 1));
        assert_eq!(words[3 * 999..], [0; 3]);
    }
}

#[test]
fn a_dispatch_that_hangs_is_stopped() {
    // Without lane 31 nothing sets the flag.
    let text = SPIN.replace("local_size 32", "local_size 31");
    let limits = Limits {
        deadline: Some(Instant::now() + Duration::from_millis(50)),
        ..no_limits()
    };
    let result = run(&text, 2, [0; 3], [64, 1, 1], &zeros(1), &limits);
    assert_eq!(result, Err(Stopped::TimedOut));
}

#[test]
fn queries_of_nothing_end_at_once() {
    // One query without a structure, and one whose object would lie outside the lane's memory.
    let text = "module compute
        inputs local_invocation_index.0
        query_words committed.t.0
        local_size 20, 1, 1
        func f0 {
            var0: 16 rows zero
            v0: i32 = const 0
            v1: i64 = descriptor[set 0, first 0, count 1] v0
            v2: i32 = const 1
            v3: i32 = var.address[var0]
            var.store[var0, 1] v2
            v4: i1 = ray_query_proceed v3
            v5: i32 = iadd v3, v2
            v6: i1 = ray_query_proceed v5
            v7: i1 = or v4, v6
            v8: i32 = var.load[var0, 1]
            v9: i32 = const 100
            v10: i32 = select v7, v0, v9
            v11: i32 = iadd v10, v8
            v12: i32 = input[0]
            v13: i32 = const 2
            v14: i32 = shl v12, v13
            store.buffer v1, v14, v11
            end
        }";
    let out = zeros(20);
    assert_eq!(run(text, 1, [0; 3], [1; 3], &out, &no_limits()), Ok(()));
    assert_eq!(words(&out), [100; 20]);
}

#[test]
fn a_shader_that_only_asks_is_stopped() {
    let text = "module compute
        local_size 32, 1, 1
        func f0 {
            var0: 15 rows zero
            v0: i32 = const 1
            v1: i32 = var.address[var0]
            loop L0 {
                var.store[var0, 1] v0
                v2: i1 = ray_query_proceed v1
                br L0
            }
            unreachable
        }";
    let limits = Limits {
        deadline: Some(Instant::now() + Duration::from_millis(20)),
        ..no_limits()
    };
    let result = run(text, 2, [0; 3], [64, 1, 1], &zeros(1), &limits);
    assert_eq!(result, Err(Stopped::TimedOut));
}
