//! The plan follows from the IR alone.

use super::{Plan, plan};
use crate::ir::text::parse_module;
use crate::ir::verify;

fn plan_of(text: &str) -> Plan {
    let module = parse_module(text).unwrap();
    verify(&module).unwrap();
    plan(&module).unwrap().plan
}

/// Operations that the interpreter performs in pairs compute the values that live across the yield
/// and the back-edge.
const PAIRS: &str = "module compute
    inputs local_invocation_index.0, subgroup_id.0
    func f0 {
        v0: i32 = input[0]
        v1: i32 = input[1]
        v2: i32 = iadd v0, v1
        v3: i32 = imul v2, v1
        v4: i32 = const 5
        loop L0 (v5: i32) = (v3) {
            v6: i32 = xor v5, v0
            v7: i32 = and v6, v3
            barrier
            v8: i32 = shl v7, v4
            v9: i32 = iadd v8, v5
            br L0(v9)
        }
        unreachable
    }";

/// The rows and ids that a native tier will resume by: each back-edge and yield with exactly what
/// is used after it.
#[test]
fn save_points_hold_what_is_used_later() {
    let plan = plan_of(PAIRS);
    let values = |list| -> Vec<u32> {
        let saved = plan.kept.values.of(list);
        saved.map(|saved| saved.value.0).collect()
    };
    let saved = |point: usize| values(plan.points[point].live.saved);
    // The entry; the barrier; the back-edge.
    assert_eq!(plan.points.len(), 3);
    assert!(saved(0).is_empty());
    assert_eq!(saved(1), [3, 5, 7]);
    assert_eq!(saved(2), [3, 5]);
    let inputs = values(plan.points[1].live.inputs);
    assert_eq!(inputs, [0], "an input stands in the state anyway");
    assert_eq!(plan.live_rows, 3);
}

/// A tier's live ranges may differ between save points only.
#[test]
fn a_tier_that_keeps_other_values_disagrees() {
    let module = parse_module(PAIRS).unwrap();
    let planned = plan(&module).unwrap();
    let mut liveness = planned.function(0).liveness.clone();
    assert!(planned.agrees(0, &liveness));
    // The product before the barrier, as if it were computed only behind it.
    let (_, end) = liveness.ranges[6].unwrap();
    liveness.ranges[6] = Some((liveness.ranges[7].unwrap().0, end));
    assert!(planned.agrees(0, &liveness));
    let (start, _) = liveness.ranges[7].unwrap();
    liveness.ranges[7] = Some((start, start));
    assert!(!planned.agrees(0, &liveness));
}

/// A uniform block is read once for a dispatch where every invocation reads it: not where some may
/// have left, unless they read the same block before. Loads behind branches are of descriptor
/// `behind`.
#[test]
fn uniform_blocks_are_read_once_where_all_invocations_read_them() {
    let uniform = |stage: &str, access: &str, behind: u32| -> Vec<u32> {
        let module = parse_module(&format!(
            "module {stage}
    inputs local_invocation_index.0
    func f0 {{
        v0: i32 = input[0]
        v1: i32 = const 4
        v2: i1 = ult v0, v1
        v3: descriptor = descriptor[set 0, first 0, count 1] v1
        v13: descriptor = descriptor[set 0, first 1, count 1] v1
        v14: descriptor = descriptor[set 0, first 0, count 1] v1
        v4: i32 = load.buffer{access} v3, v1
        v5: i32 = load.buffer{access} v3, v0
        if v2, L0 {{
            v6: i32 = load.buffer{access} v{behind}, v1
            br L0
        }} else {{
            br L0
        }}
        v7: i32 = load.buffer{access} v3, v1
        block L1 {{
            v8: i32 = load.buffer{access} v3, v1
            if v2, L2 {{
                br L1
            }} else {{
                br L2
            }}
            v9: i32 = load.buffer{access} v{behind}, v1
            br L1
        }}
        v10: i32 = load.buffer{access} v3, v1
        v11: i32 = iadd v10, v4
        if v2, L3 {{
            end
        }} else {{
            br L3
        }}
        v12: i32 = load.buffer{access} v{behind}, v1
        end
    }}"
        ))
        .unwrap();
        verify(&module).unwrap();
        let uniform = &plan(&module).unwrap().function(0).uniform.clone();
        (4..13).filter(|&v| uniform[v as usize]).collect()
    };
    assert_eq!(uniform("compute", ".constant", 13), [4, 7, 8, 10, 11]);
    let all = [4, 6, 7, 8, 9, 10, 11, 12];
    assert_eq!(uniform("compute", ".constant", 3), all);
    assert_eq!(uniform("compute", ".constant", 14), all, "the same by name");
    assert!(uniform("compute", "", 3).is_empty(), "a storage buffer");
}

/// The size of an image is asked for once for a dispatch where every invocation asks: behind a
/// branch the image may be none.
#[test]
fn sizes_are_asked_for_once_where_all_invocations_ask() {
    let query = "image.query_size[2d, i32, implicit, format 0]";
    let module = parse_module(&format!(
        "module compute
    inputs local_invocation_index.0
    func f0 {{
        v0: i32 = input[0]
        v1: i32 = const 4
        v2: i1 = ult v0, v1
        v3: descriptor = descriptor[set 0, first 0, count 8] v1
        v4: descriptor = descriptor[set 0, first 0, count 8] v0
        v5: i32, v6: i32 = {query} v3
        v7: i32, v8: i32 = {query} v4
        if v2, L0 {{
            v9: i32, v10: i32 = {query} v3
            br L0
        }} else {{
            br L0
        }}
        v11: i32 = imul v5, v6
        end
    }}"
    ))
    .unwrap();
    verify(&module).unwrap();
    let uniform = &plan(&module).unwrap().function(0).uniform.clone();
    let found: Vec<u32> = (5..12).filter(|&v| uniform[v as usize]).collect();
    assert_eq!(found, [5, 6, 11]);
}
