//! Outputs of vertex shaders that are always zero say nothing: what reads one that is not there
//! gets zero, distances of zero clip nothing, and layer and viewport are zero by themselves.
//! Compilers declare all of `gl_PerVertex`, whether a shader writes it or not.

use crate::ir::interface::OutputRow;
use crate::ir::stage::Stage;
use crate::ir::{Module, Op, Terminator};

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
        function.body.visit_insts(&mut |inst| {
            if inst.op == Op::Const(0) {
                zero[inst.results[0].index()] = true;
            }
        });
        function.body.visit_bodies(&mut |body| {
            if let Terminator::End(args) = &body.end {
                for (kept, arg) in kept.iter_mut().zip(args) {
                    *kept |= !zero[arg.index()];
                }
            }
        });
    }
    for function in &mut module.functions {
        function.body.visit_bodies_mut(&mut |body| {
            if let Terminator::End(args) = &mut body.end {
                let mut keep = kept.iter();
                args.retain(|_| keep.next() == Some(&true));
            }
        });
    }
    let mut keep = kept.iter();
    module.outputs.retain(|_| keep.next() == Some(&true));
    module.output_rows = module.outputs.len() as u32;
}
