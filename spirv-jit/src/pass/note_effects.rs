//! What an optimised fragment shader does to the world: the rasterizer tests early where it may, and masks what it must.

use crate::ir::{Body, Module, Node, Op, Space};

/// Notes whether invocations may become helpers, and whether they write memory.
pub fn note_effects(module: &mut Module) {
    let Some(mut facts) = module.fragment else {
        return;
    };
    for function in &module.functions {
        visit(&function.body, &mut |op| match op {
            Op::Demote => facts.discards = true,
            Op::Store(access) => facts.writes_memory |= access.space != Space::Private,
            Op::Atomic(..) => facts.writes_memory = true,
            Op::Image(image) => facts.writes_memory |= !image.is_read(),
            _ => {}
        });
    }
    module.fragment = Some(facts);
}

fn visit(body: &Body, see: &mut dyn FnMut(&Op)) {
    for node in &body.nodes {
        match node {
            Node::Inst(inst) => see(&inst.op),
            Node::Block { body, .. } | Node::Loop { body, .. } => visit(body, see),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                visit(then_body, see);
                visit(else_body, see);
            }
        }
    }
}
