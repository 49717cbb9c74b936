//! Split barriers: subgroups wait for the others to have come, not to wait, too.

use super::{run, words, zeros};
use crate::compute::tests::workgroups::guarded;

/// Each subgroup but the last one spins between both halves, until the last one, which has gone
/// past the second, has stored a word.
#[test]
fn an_arrival_lets_others_go_on() {
    let text = |invocations: u32| {
        let last = (invocations - 1) / 16;
        format!(
            "module compute
            inputs subgroup_id.0, local_invocation_index.0
            local_size {invocations}, 1, 1
            func f0 {{
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = const {last}
                v4: i32 = const 1
                barrier_arrive
                v5: i1 = ine v2, v3
                if v5, L0 {{
                    loop L1 {{
                        v6: i32 = load.buffer v1, v0
                        v7: i1 = ieq v6, v0
                        if v7, L2 {{
                            br L1
                        }} else {{
                            br L2
                        }}
                        br L0
                    }}
                    unreachable
                }} else {{
                    br L0
                }}
                barrier_wait
                v8: i1 = ieq v2, v3
                if v8, L3 {{
                    store.buffer v1, v0, v4
                    br L3
                }} else {{
                    br L3
                }}
                v10: i32 = const 4
                v11: i32 = atomic.iadd.buffer v1, v10, v4
                end
            }}"
        )
    };
    for invocations in [33, 64, 1024] {
        let out = zeros(2);
        let text = text(invocations);
        assert_eq!(run(&text, 1, [0; 3], [1, 1, 1], &out, &guarded()), Ok(()));
        assert_eq!(words(&out), [1, invocations]);
    }
}

/// Each invocation hands its number to the one in the next subgroup, turn after turn. Between both
/// halves subgroups work for different times, some of them long enough to run out of fuel.
#[test]
fn what_comes_before_an_arrival_is_there_after_the_wait() {
    let text = |invocations: u32, turns: u32| {
        let bytes = 8 * invocations;
        let half = 4 * invocations;
        format!(
            "module compute
            inputs local_invocation_index.0, subgroup_id.0
            local_size {invocations}, 1, 1
            shared {bytes}
            func f0 {{
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = input[1]
                v4: i32 = const 1
                v5: i32 = const 2
                v6: i32 = shl v2, v5
                v7: i32 = const 16
                v8: i32 = iadd v2, v7
                v9: i32 = const {invocations}
                v10: i32 = urem v8, v9
                v11: i32 = shl v10, v5
                v12: i32 = const {half}
                v13: i32 = const {turns}
                v14: i32 = const 7919
                block L9 -> (v15: i32) {{
                    loop L0 (v16: i32, v17: i32) = (v0, v2) {{
                        v18: i1 = ult v16, v13
                        if v18, L1 {{
                            br L1
                        }} else {{
                            br L9(v17)
                        }}
                        v19: i32 = and v16, v4
                        v20: i32 = imul v19, v12
                        v21: i32 = iadd v11, v20
                        store.shared v21, v17
                        barrier_arrive
                        v22: i32 = iadd v16, v3
                        v23: i32 = const 3
                        v24: i32 = and v22, v23
                        v25: i32 = imul v24, v14
                        block L2 {{
                            loop L3 (v26: i32) = (v0) {{
                                v27: i1 = ult v26, v25
                                if v27, L4 {{
                                    br L4
                                }} else {{
                                    br L2
                                }}
                                v28: i32 = iadd v26, v4
                                br L3(v28)
                            }}
                            unreachable
                        }}
                        barrier_wait
                        v29: i32 = iadd v6, v20
                        v30: i32 = load.shared v29
                        v31: i32 = iadd v16, v4
                        br L0(v31, v30)
                    }}
                    unreachable
                }}
                store.buffer v1, v6, v15
                end
            }}"
        )
    };
    for (invocations, turns) in [(16, 5), (48, 1), (48, 7), (256, 6), (1024, 3)] {
        for threads in [1, 3] {
            let out = zeros(invocations as usize);
            let text = text(invocations, turns);
            let count = [1, 1, 1];
            assert_eq!(run(&text, threads, [0; 3], count, &out, &guarded()), Ok(()));
            for (index, word) in (0..).zip(words(&out)) {
                let from = (index + 16 * invocations - 16 * turns % invocations) % invocations;
                assert_eq!(word, from, "{invocations} × {turns}: {index}");
            }
        }
    }
}

/// Subgroups that end before a barrier are not waited for; and halves without the other one.
#[test]
fn nothing_hangs() {
    for halves in [
        "barrier_arrive\nbarrier_wait",
        "barrier_wait",
        "barrier_arrive",
        "barrier_arrive\nbarrier_arrive\nbarrier_wait",
        "barrier_arrive\nbarrier\nbarrier_wait",
    ] {
        let text = format!(
            "module compute
            inputs subgroup_id.0
            local_size 64, 1, 1
            func f0 {{
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = const 1
                v4: i1 = ieq v2, v3
                if v4, L0 {{
                    end
                }} else {{
                    br L0
                }}
                {halves}
                v5: i32 = atomic.iadd.buffer v1, v0, v3
                end
            }}"
        );
        let out = zeros(1);
        assert_eq!(run(&text, 1, [0; 3], [1, 1, 1], &out, &guarded()), Ok(()));
        assert_eq!(words(&out), [48], "{halves}");
    }
}
