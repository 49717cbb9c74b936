//! Outputs of vertex shaders that are always zero say nothing: what reads one that is not there gets zero, distances of zero clip nothing,
//! and layer and viewport are zero by themselves. Compilers declare all of `gl_PerVertex`, whether a shader writes it or not.

use crate::ir::interface::OutputRow;
use crate::ir::stage::Stage;
use crate::ir::{Body, Module, Node, Op, Terminator};

/// Removes the words that are constants of zero wherever the invocation ends.
pub fn trim_outputs(module: &mut Module) {
    if module.stage != Stage::Vertex {
        return;
    }
    let mut kept: Vec<bool> = (module.outputs.iter())
        .map(|row| matches!(row, OutputRow::Position(_)))
        .collect();
    for function in &module.functions {
        let mut zero = vec![false; function.value_types.len()];
        find_zeros(&function.body, &mut zero);
        find_ends(&function.body, &mut |args| {
            for (kept, arg) in kept.iter_mut().zip(args) {
                *kept |= !zero[arg.index()];
            }
        });
    }
    for function in &mut module.functions {
        trim_ends(&mut function.body, &kept);
    }
    let mut keep = kept.iter();
    module.outputs.retain(|_| keep.next() == Some(&true));
    module.output_rows = module.outputs.len() as u32;
}

fn find_zeros(body: &Body, zero: &mut [bool]) {
    for node in &body.nodes {
        match node {
            Node::Inst(inst) if inst.op == Op::Const(0) => zero[inst.results[0].index()] = true,
            Node::Inst(_) => {}
            Node::Block { body, .. } | Node::Loop { body, .. } => find_zeros(body, zero),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                find_zeros(then_body, zero);
                find_zeros(else_body, zero);
            }
        }
    }
}

fn find_ends(body: &Body, visit: &mut dyn FnMut(&[crate::ir::Value])) {
    for node in &body.nodes {
        match node {
            Node::Inst(_) => {}
            Node::Block { body, .. } | Node::Loop { body, .. } => find_ends(body, visit),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                find_ends(then_body, visit);
                find_ends(else_body, visit);
            }
        }
    }
    if let Terminator::End(args) = &body.end {
        visit(args);
    }
}

fn trim_ends(body: &mut Body, kept: &[bool]) {
    for node in &mut body.nodes {
        match node {
            Node::Inst(_) => {}
            Node::Block { body, .. } | Node::Loop { body, .. } => trim_ends(body, kept),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                trim_ends(then_body, kept);
                trim_ends(else_body, kept);
            }
        }
    }
    if let Terminator::End(args) = &mut body.end {
        let mut keep = kept.iter();
        args.retain(|_| keep.next() == Some(&true));
    }
}
