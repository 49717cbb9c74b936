//! Any-hit shaders that leave the payload as it is do not carry it.

use crate::ir::{Body, InputRow, Module, Node, Op, Terminator, Value};
use crate::program::Stage;

/// Leaves the payload's words out of what an any-hit shader leaves behind, if every end of it gives back what came in.
pub fn drop_unchanged_payload(module: &mut Module) {
    if module.stage != Stage::AnyHit || module.output_rows < 2 {
        return;
    }
    let Some(entry) = module.functions.first_mut() else {
        return;
    };
    let mut words = vec![None; entry.value_types.len()];
    note_words(&entry.body, &module.inputs, &mut words);
    let mut unchanged = true;
    each_end(&mut entry.body, &mut |outputs| {
        let given_back = |(word, value): (usize, &Value)| words[value.index()] == Some(word as u32);
        unchanged &= outputs.iter().skip(1).enumerate().all(given_back);
    });
    if unchanged {
        each_end(&mut entry.body, &mut |outputs| outputs.truncate(1));
        module.output_rows = 1;
    }
}

/// By value, which word of the incoming payload it is.
fn note_words(body: &Body, inputs: &[InputRow], words: &mut [Option<u32>]) {
    for node in &body.nodes {
        match node {
            Node::Inst(inst) => {
                if let Op::Input(index) = inst.op
                    && let InputRow::Payload(word) = inputs[index as usize]
                    && let Some(result) = inst.results.first()
                {
                    words[result.index()] = Some(word);
                }
            }
            Node::Block { body, .. } | Node::Loop { body, .. } => note_words(body, inputs, words),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                note_words(then_body, inputs, words);
                note_words(else_body, inputs, words);
            }
        }
    }
}

fn each_end(body: &mut Body, visit: &mut impl FnMut(&mut Vec<Value>)) {
    for node in &mut body.nodes {
        match node {
            Node::Inst(_) => {}
            Node::Block { body, .. } | Node::Loop { body, .. } => each_end(body, visit),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                each_end(then_body, visit);
                each_end(else_body, visit);
            }
        }
    }
    if let Terminator::End(outputs) = &mut body.end {
        visit(outputs);
    }
}
