//! Removes vertex outputs that are always zero. A missing output reads as zero, distances of zero
//! clip nothing, and layer and viewport default to zero. Compilers declare all of `gl_PerVertex`,
//! even if a shader does not write it.

use crate::ir::interface::OutputRow;
use crate::ir::stage::Stage;
use crate::ir::{Module, Node, Op, Terminator, Value};

/// Operands of an emission before its words.
const BEFORE_WORDS: usize = 2;

/// Removes the words that are constant zero at every end and emission of an invocation.
pub fn trim_outputs(module: &mut Module) {
    let emits = module.stage == Stage::Geometry;
    let ends_with_vertex = matches!(module.stage, Stage::Vertex | Stage::TessellationEvaluation);
    if !ends_with_vertex && !emits {
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
        let mut keep = |words: &[Value]| {
            for (kept, word) in kept.iter_mut().zip(words) {
                *kept |= !zero[word.index()];
            }
        };
        if emits {
            function.body.visit_insts(&mut |inst| {
                if inst.op == Op::Emit {
                    keep(&inst.args[BEFORE_WORDS..]);
                }
            });
            continue;
        }
        function.body.visit_bodies(&mut |body| {
            if let Terminator::End(args) = &body.end {
                keep(args);
            }
        });
    }
    let is_kept = |place: usize| kept.get(place) == Some(&true);
    for function in &mut module.functions {
        function.body.visit_bodies_mut(&mut |body| {
            for node in &mut body.nodes {
                if let Node::Inst(inst) = node
                    && inst.op == Op::Emit
                {
                    let mut place = 0..;
                    (inst.args).retain(|_| {
                        let place = place.next().unwrap_or(0);
                        place < BEFORE_WORDS || is_kept(place - BEFORE_WORDS)
                    });
                }
            }
            if let Terminator::End(args) = &mut body.end
                && !emits
            {
                let mut place = 0..;
                args.retain(|_| place.next().is_some_and(is_kept));
            }
        });
    }
    let mut place = 0..;
    module.outputs.retain(|_| place.next().is_some_and(is_kept));
    if !emits {
        module.output_rows = module.outputs.len() as u32;
    }
}
