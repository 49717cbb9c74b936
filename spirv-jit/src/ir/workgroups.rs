//! Compute shaders whose invocations cannot observe their subgroup partners. Their subgroups may be
//! filled with several small workgroups.

#![forbid(unsafe_code)]

use super::module::{InputRow, Module, Node};
use super::op::AtomicOp;
use super::stage::{Builtin, Stage};
use super::{Body, Inst, Op};
use crate::image::ImageOpKind;

/// Whether invocations of different workgroups may share a subgroup: they look at no other lane,
/// share nothing that a workgroup has one of, and never wait for each other. Lanes of a subgroup go
/// through loops together, so that one that waits for another there would wait for ever, where a
/// subgroup that waits for another does not.
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
        Op::LaneIndex | Op::Subgroup(_) | Op::DerivativeX | Op::DerivativeY | Op::Barrier
    )
}

/// Whether a loop, or a body that may be in one, looks at what others change meanwhile.
fn may_wait(body: &Body, in_loop: bool) -> bool {
    if in_loop {
        return has(body, sees_changes);
    }
    body.nodes.iter().any(|node| {
        let is_loop = matches!(node, Node::Loop { .. });
        node.bodies().any(|body| may_wait(body, is_loop))
    })
}

/// Whether others' writes are seen here, if the shader waits for one.
fn sees_changes(inst: &Inst) -> bool {
    match inst.op {
        Op::Load(access) => access.volatile,
        Op::Image(op) => matches!(op.kind, ImageOpKind::Read | ImageOpKind::Atomic(_)),
        Op::Atomic(op, _) => op != AtomicOp::Store,
        Op::MemoryBarrier => true,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::may_share_subgroups;
    use crate::ir::text::parse_module;
    use crate::ir::verify;

    fn may(head: &str, before: &str, in_loop: &str) -> bool {
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
                return
            }}"
        );
        let text = match text.contains("call[") {
            true => text,
            false => text.split("func f1").next().unwrap().to_owned(),
        };
        let module = parse_module(&text).unwrap();
        verify(&module).unwrap();
        may_share_subgroups(&module)
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
