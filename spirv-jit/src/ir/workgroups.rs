//! Analyses of compute shaders. If invocations cannot observe the other invocations of their
//! subgroup, several small workgroups may fill a subgroup. If workgroups may wait for each other,
//! each runs by itself. The last analysis finds shaders whose lanes read other lanes.

#![forbid(unsafe_code)]

use images::{ImageOpKind, LodMode};

use super::module::{InputRow, Module, Node};
use super::op::{AtomicOp, Space};
use super::stage::{Builtin, Stage};
use super::{Body, Function, Inst, Op, Step};

/// Whether invocations of different workgroups may share a subgroup: they read no other lane, use
/// no state of a workgroup, and never wait for each other. Lanes of a subgroup run loops together,
/// so a lane that waits for another one would wait forever, while a subgroup that waits for another
/// one would not.
pub fn may_share_subgroups(module: &Module) -> bool {
    let sees_subgroups = |input: &InputRow| {
        matches!(
            input,
            InputRow::Builtin(Builtin::SubgroupId | Builtin::NumSubgroups, _)
        )
    };
    module.stage == Stage::Compute
        && !module.quads
        && module.shared_size_bytes == 0
        && !module.inputs.iter().any(sees_subgroups)
        && (module.functions.iter().enumerate()).all(|(index, function)| {
            // Others than the entry may be called from loops.
            !has(&function.body, sees_others) && !may_wait(&function.body, index != 0)
        })
}

fn has(body: &Body, is_such: fn(&Inst) -> bool) -> bool {
    let mut any = false;
    body.visit_insts(&mut |inst| any |= is_such(inst));
    any
}

fn sees_others(inst: &Inst) -> bool {
    matches!(
        inst.op,
        Op::LaneIndex
            | Op::Subgroup(_)
            | Op::MatrixProduct(_)
            | Op::DerivativeX
            | Op::DerivativeY
            | Op::Barrier
            | Op::BarrierArrive
            | Op::BarrierWait
    )
}

/// Whether lanes read other lanes: through derivatives, also implicit ones of samples, or subgroup
/// operations.
pub fn looks_at_lanes(module: &Module) -> bool {
    let looks = |inst: &Inst| sees_others(inst) || takes_derivatives(inst);
    (module.functions.iter()).any(|function| has(&function.body, looks))
}

fn takes_derivatives(inst: &Inst) -> bool {
    let Op::Image(op) = inst.op else {
        return false;
    };
    let is_sampled = matches!(
        op.kind,
        ImageOpKind::Sample | ImageOpKind::Gather(_) | ImageOpKind::QueryLod
    );
    is_sampled && matches!(op.lod, LodMode::Implicit | LodMode::Bias)
}

/// Whether a loop, or a body that may be in one, reads state that others change meanwhile.
fn may_wait(body: &Body, in_loop: bool) -> bool {
    let mut loops = usize::from(in_loop);
    body.steps().any(|step| {
        match step {
            Step::Inst(inst) => return loops > 0 && sees_changes(inst),
            Step::Open(Node::Loop { .. }) => loops += 1,
            Step::Close(Node::Loop { .. }) => loops -= 1,
            _ => {}
        }
        false
    })
}

/// Whether a wait in the shader can observe others' writes here.
fn sees_changes(inst: &Inst) -> bool {
    match inst.op {
        Op::Load(access) => access.volatile,
        Op::Image(op) => matches!(op.kind, ImageOpKind::Read | ImageOpKind::Atomic(_)),
        Op::Atomic(op, _) => op != AtomicOp::Store,
        Op::MemoryBarrier => true,
        _ => false,
    }
}

/// Whether a workgroup may wait in a loop for another one. A loop can observe another workgroup
/// through atomics with used results, volatile loads, loads from written images, or any load if
/// there are memory barriers that belong to no workgroup barrier.
pub fn may_wait_for_workgroups(module: &Module) -> bool {
    let writes_images = (module.functions.iter()).any(|function| has(&function.body, writes_image));
    (module.functions.iter().enumerate()).any(|(index, function)| {
        // Others than the entry may be called from loops.
        waits_in_loop(function, index != 0, writes_images)
    })
}

fn writes_image(inst: &Inst) -> bool {
    matches!(inst.op, Op::Image(op) if !op.is_read())
}

fn waits_in_loop(function: &Function, in_loop: bool, writes_images: bool) -> bool {
    let mut used = vec![false; function.value_types.len()];
    function
        .body
        .visit_operands(&mut |value| used[value.index()] = true);
    let mut rest = vec![(&function.body, in_loop)];
    while let Some((body, in_loop)) = rest.pop() {
        // Only memory barriers precede a barrier of the workgroup.
        let mut leads_to_barrier = false;
        for node in body.nodes.iter().rev() {
            match node {
                Node::Inst(inst) => {
                    let is_used = inst.results.iter().any(|result| used[result.index()]);
                    let sees = match inst.op {
                        Op::Load(access) => access.volatile && is_between(access.space),
                        Op::Atomic(op, access) => {
                            is_used && op != AtomicOp::Store && is_between(access.space)
                        }
                        Op::Image(op) => match op.kind {
                            ImageOpKind::Read => is_used && writes_images,
                            ImageOpKind::Atomic(op) => is_used && op != AtomicOp::Store,
                            _ => false,
                        },
                        Op::MemoryBarrier => !leads_to_barrier,
                        _ => false,
                    };
                    leads_to_barrier &= inst.op == Op::MemoryBarrier;
                    leads_to_barrier |= is_barrier(inst.op);
                    if in_loop && sees {
                        return true;
                    }
                }
                node => {
                    leads_to_barrier = false;
                    let in_loop = in_loop || matches!(node, Node::Loop { .. });
                    rest.extend(node.bodies().map(|body| (body, in_loop)));
                }
            }
        }
    }
    false
}

fn is_barrier(op: Op) -> bool {
    matches!(op, Op::Barrier | Op::BarrierArrive | Op::BarrierWait)
}

/// Whether several workgroups share this memory.
fn is_between(space: Space) -> bool {
    matches!(space, Space::Buffer | Space::Buffer64 | Space::Global)
}

#[cfg(test)]
mod tests {
    use super::{may_share_subgroups, may_wait_for_workgroups};
    use crate::ir::text::parse_module;
    use crate::ir::{Module, verify};

    /// A shader with a loop.
    fn module(head: &str, before: &str, in_loop: &str) -> Module {
        let text = format!(
            "module compute
            inputs global_invocation_id.0{head}
            func f0 {{
                v0: i32 = input[0]
                v1: i32 = const 0
                v2: descriptor = descriptor[set 0, first 0, count 1] v1
                v3: descriptor = descriptor[set 0, first 1, count 1] v1
                {before}
                loop L0 (v4: i32) = (v0) {{
                    {in_loop}
                    v5: i1 = ieq v4, v1
                    if v5, L1 {{
                        end
                    }} else {{
                        br L1
                    }}
                    br L0(v4)
                }}
                unreachable
            }}
            func f1 {{
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = atomic.iadd.buffer v1, v0, v0
                v3: i32 = iadd v2, v2
                store.buffer v1, v0, v3
                return
            }}"
        );
        let text = match text.contains("call[") {
            true => text,
            false => text.split("func f1").next().unwrap().to_owned(),
        };
        let module = parse_module(&text).unwrap();
        verify(&module).unwrap();
        module
    }

    fn may(head: &str, before: &str, in_loop: &str) -> bool {
        may_share_subgroups(&module(head, before, in_loop))
    }

    #[test]
    fn loops_that_see_other_workgroups_wait_for_them() {
        let head = "\nshared 64";
        let waits =
            |before: &str, in_loop: &str| may_wait_for_workgroups(&module(head, before, in_loop));
        let used = "v11: i32 = iadd v10, v0\nstore.buffer v2, v0, v11";
        let seen = [
            format!("v10: i32 = atomic.iadd.buffer v2, v0, v0\n{used}"),
            format!("v10: i32 = atomic.load.buffer v2, v0\n{used}"),
            "v10: i32 = load.buffer.volatile v2, v0".to_owned(),
            "memory_barrier".to_owned(),
            "memory_barrier\nv10: i32 = load.buffer v2, v0\nbarrier".to_owned(),
            "call[f1]".to_owned(),
        ];
        for text in &seen {
            assert!(waits("", text), "{text}");
            assert!(text == "call[f1]" || !waits(text, ""), "{text}");
        }
        let not_seen = [
            "".to_owned(),
            "v10: i32 = load.buffer v2, v0".to_owned(),
            "v10: i32 = atomic.iadd.buffer v2, v0, v0".to_owned(),
            "atomic.store.buffer v2, v0, v0".to_owned(),
            format!("v10: i32 = atomic.iadd.shared v0, v0\n{used}"),
            format!("v10: i32 = load.shared.volatile v0\n{used}"),
            "barrier".to_owned(),
            "memory_barrier\nmemory_barrier\nbarrier".to_owned(),
        ];
        for text in &not_seen {
            assert!(!waits("", text), "{text}");
        }
        let image = "v10: f32, v11: f32, v12: f32, v13: f32 = image.read[1d, f32, implicit, format 0] v3, v0
            v14: f32 = fadd v10, v11";
        let write = "v20: f32 = const 0\nimage.write[1d, f32, implicit, format 0] v3, v0, v20, v20, v20, v20";
        assert!(!waits("", image));
        assert!(waits(write, image));
    }

    #[test]
    fn only_what_cannot_tell_shares_subgroups() {
        let local = "\nlocal_size 3, 1, 1";
        assert!(may(local, "", ""));
        assert!(may(local, "", "v10: i32 = load.buffer v2, v0"));
        assert!(may(local, "v10: i32 = atomic.iadd.buffer v2, v0, v0", ""));
        let waits = [
            "v10: i32 = atomic.iadd.buffer v2, v0, v0",
            "v10: i32 = load.buffer.volatile v2, v0",
            "memory_barrier",
            "call[f1]",
            "v10: f32, v11: f32, v12: f32, v13: f32 = image.read[1d, f32, implicit, format 0] v3, v0",
        ];
        for text in waits {
            assert!(!may(local, "", text), "{text}");
        }
        let sees = [
            "v10: i32 = lane_index",
            "v10: i1 = subgroup.elect",
            "barrier",
            "v10: f32 = sto_f v0\nv11: f32 = derivative_x v10",
            "call[f1]",
        ];
        for text in sees {
            assert!(!may(local, text, ""), "{text}");
        }
        for head in [
            ", subgroup_id.0",
            ", num_subgroups.0",
            "\nshared 64",
            "\nlocal_size 4, 4, 1\nquads",
        ] {
            assert!(!may(head, "", ""), "{head}");
        }
    }
}
