//! Control flow: merges, loops, calls.

use super::outputs;

const HEAD: &str = "module closest_hit\ninputs payload.0\noutput_rows 1\n";

fn check(body: &str, input: fn(usize) -> u32, expected: fn(u32) -> u32) {
    let out = outputs(&format!("{HEAD}{body}"), input);
    for (lane, &word) in out.iter().enumerate() {
        assert_eq!(word, expected(input(lane)), "lane {lane}");
    }
}

#[test]
fn if_merges_both_sides() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 5
            v2: i1 = ult v0, v1
            if v2, L0 -> (v3: i32, v4: i32) {
                v5: i32 = iadd v0, v1
                br L0(v5, v0)
            } else {
                v6: i32 = imul v0, v1
                br L0(v6, v1)
            }
            v7: i32 = xor v3, v4
            end(v7)
        }",
        |lane| lane as u32 * 7 % 11,
        |x| if x < 5 { (x + 5) ^ x } else { (x * 5) ^ 5 },
    );
}

/// Collatz steps: lanes leave the loop at very different times.
#[test]
fn loop_with_divergent_exits() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 1
            v2: i32 = const 0
            v3: i32 = const 3
            block L0 -> (v4: i32) {
                loop L1 (v5: i32, v6: i32) = (v0, v2) {
                    v7: i1 = ule v5, v1
                    if v7, L2 { br L0(v6) } else { br L2 }
                    v8: i32 = and v5, v1
                    v9: i1 = ieq v8, v1
                    if v9, L3 -> (v10: i32) {
                        v11: i32 = imul v5, v3
                        v12: i32 = iadd v11, v1
                        br L3(v12)
                    } else {
                        v13: i32 = lshr v5, v1
                        br L3(v13)
                    }
                    v14: i32 = iadd v6, v1
                    br L1(v10, v14)
                }
                unreachable
            }
            end(v4)
        }",
        |lane| lane as u32 % 97,
        |mut x| {
            let mut steps = 0;
            while x > 1 {
                x = if x % 2 == 1 { x * 3 + 1 } else { x / 2 };
                steps += 1;
            }
            steps
        },
    );
}

/// The back-edge permutes its parameters: copies happen as if all at once.
#[test]
fn loop_parameters_rotate() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 1
            v2: i32 = const 0
            v3: i32 = const 10
            v4: i32 = const 20
            v20: i64 = const 77
            block L0 -> (v5: i32) {
                loop L1 (v6: i32, v7: i32, v8: i32, v9: i32, v21: i64, v22: i64) = (v0, v2, v3, v4, v20, v20) {
                    v10: i1 = ieq v6, v2
                    if v10, L2 {
                        v11: i32 = imul v7, v3
                        v12: i32 = iadd v11, v8
                        v13: i32 = imul v12, v3
                        v14: i32 = iadd v13, v9
                        br L0(v14)
                    } else { br L2 }
                    v15: i32 = isub v6, v1
                    br L1(v15, v8, v9, v7, v22, v21)
                }
                unreachable
            }
            end(v5)
        }",
        |lane| lane as u32 % 7,
        |n| {
            let mut p = [0, 10, 20];
            for _ in 0..n {
                p = [p[1], p[2], p[0]];
            }
            (p[0] * 10 + p[1]) * 10 + p[2]
        },
    );
}

/// Breaks from two levels at once, and lanes that end in the middle.
#[test]
fn nested_loops_and_ends() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 1
            v2: i32 = const 0
            v3: i32 = const 4
            v4: i32 = const 1000
            block L0 -> (v5: i32) {
                loop L1 (v6: i32, v7: i32) = (v2, v2) {
                    block L2 -> (v8: i32) {
                        loop L3 (v9: i32, v10: i32) = (v2, v7) {
                            v11: i32 = imul v6, v3
                            v12: i32 = iadd v11, v9
                            v13: i1 = ieq v12, v0
                            if v13, L4 {
                                v14: i32 = and v0, v1
                                v15: i1 = ieq v14, v1
                                if v15, L5 { end(v4) } else { br L5 }
                                br L0(v10)
                            } else { br L4 }
                            v16: i32 = iadd v10, v12
                            v17: i32 = iadd v9, v1
                            v18: i1 = ult v17, v3
                            if v18, L6 { br L3(v17, v16) } else { br L2(v16) }
                            unreachable
                        }
                        unreachable
                    }
                    v19: i32 = iadd v6, v1
                    br L1(v19, v8)
                }
                unreachable
            }
            end(v5)
        }",
        |lane| lane as u32 % 23,
        |x| {
            if x % 2 == 1 {
                return 1000;
            }
            (0..x).sum()
        },
    );
}

#[test]
fn calls_return_early_and_end() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 3
            v2: i32, v3: i64 = call[f1] v0, v1
            v4: i32 = iadd v2, v0
            v5: i32, v6: i64 = call[f1] v4, v1
            v7: i32, v8: i32 = unpack64 v6
            v9: i32 = iadd v5, v8
            end(v9)
        }
        func f1 (v0: i32, v1: i32) -> (i32, i64) {
            v2: i1 = ult v0, v1
            if v2, L0 {
                v3: i64 = pack64 v0, v1
                return(v1, v3)
            } else { br L0 }
            v4: i32 = const 40
            v5: i1 = ult v4, v0
            if v5, L1 {
                end(v4)
            } else { br L1 }
            v6: i32 = call[f2] v0
            v7: i64 = pack64 v0, v6
            return(v0, v7)
        }
        func f2 (v0: i32) -> (i32) {
            v1: i32 = imul v0, v0
            return(v1)
        }",
        |lane| lane as u32 % 50,
        |x| {
            let f1 = |a: u32| match a {
                a if a < 3 => Ok((3, 3)),
                a if a > 40 => Err(40u32),
                a => Ok((a, a * a)),
            };
            let run = || {
                let (v2, _) = f1(x)?;
                let (v5, high) = f1(v2 + x)?;
                Ok(v5 + high)
            };
            run().unwrap_or_else(|e: u32| e)
        },
    );
}

/// Values that die in one branch must not be overwritten while lanes of the other still need
/// theirs.
#[test]
fn rows_are_not_shared_across_branches() {
    check(
        "func f0 {
            v0: i32 = input[0]
            v1: i32 = const 1
            v2: i32 = and v0, v1
            v3: i1 = ieq v2, v1
            v4: i32 = imul v0, v0
            v5: i32 = iadd v0, v4
            if v3, L0 -> (v6: i32) {
                v7: i32 = iadd v4, v1
                v8: i32 = iadd v7, v1
                v9: i32 = iadd v8, v1
                br L0(v9)
            } else {
                v10: i32 = isub v5, v1
                br L0(v10)
            }
            end(v6)
        }",
        |lane| lane as u32,
        |x| {
            if x % 2 == 1 {
                x * x + 3
            } else {
                (x + x * x).wrapping_sub(1)
            }
        },
    );
}
