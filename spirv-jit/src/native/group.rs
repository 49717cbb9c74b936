//! Brings operations with native code together, so that stretches are long: what is loaded one
//! scalar at a time and used at once would end a stretch with each load.

use foldhash::HashMap;

use super::{Encoding, IrOperand, Stretch, ValueRow};
use crate::ir::{Body, Inst, Module, Node, Op, Type, Value};

/// Instructions that change places among themselves: more would keep more values alive at once.
const WINDOW: usize = 32;

/// Reorders the instructions between branches and suspensions. Those without native code stay in
/// their order.
pub(crate) fn group(module: &mut Module, encoding: Encoding) {
    for function in &mut module.functions {
        let mut constants = HashMap::default();
        function.body.visit_insts(&mut |inst| {
            if let Op::Const(bits) = inst.op {
                constants.insert(inst.results[0], bits);
            }
        });
        let scheduler = Scheduler {
            types: &function.value_types,
            constants,
            encoding,
        };
        function
            .body
            .visit_bodies_mut(&mut |body| scheduler.group_body(body));
    }
}

/// Reorders instructions by these facts about a function's values.
struct Scheduler<'f> {
    types: &'f [Type],
    constants: HashMap<Value, u64>,
    encoding: Encoding,
}

impl Scheduler<'_> {
    fn group_body(&self, body: &mut Body) {
        let nodes = std::mem::take(&mut body.nodes);
        body.nodes.reserve(nodes.len());
        let mut window: Vec<Inst> = Vec::with_capacity(WINDOW);
        for node in nodes {
            match node {
                Node::Inst(inst) if !inst.op.is_yield() && !matches!(inst.op, Op::Call(_)) => {
                    window.push(inst);
                    if window.len() == WINDOW {
                        self.schedule(&mut window, &mut body.nodes);
                    }
                }
                node => {
                    self.schedule(&mut window, &mut body.nodes);
                    body.nodes.push(node);
                }
            }
        }
        self.schedule(&mut window, &mut body.nodes);
    }

    /// Moves a window's instructions to `nodes`: in turn all with native code whose operands are
    /// there, and all others up to the first whose operands are not.
    fn schedule(&self, window: &mut Vec<Inst>, nodes: &mut Vec<Node>) {
        let mut scratch = Stretch::new(self.encoding);
        let mut kinds: Vec<bool> = window
            .iter()
            .map(|inst| self.is_native(&mut scratch, inst))
            .collect();
        if !kinds.contains(&false) || !kinds.contains(&true) {
            nodes.extend(window.drain(..).map(Node::Inst));
            return;
        }
        // Values of the window that are still to come.
        let mut to_come: HashMap<Value, ()> = HashMap::default();
        for inst in window.iter() {
            to_come.extend(inst.results.iter().map(|&value| (value, ())));
        }
        let mut turn = true;
        while !window.is_empty() {
            let mut stays = Vec::with_capacity(window.len());
            let mut stay_kinds = Vec::with_capacity(window.len());
            let mut is_blocked = false;
            for (inst, native) in window.drain(..).zip(kinds) {
                let is_ready = inst.args.iter().all(|arg| !to_come.contains_key(arg));
                if native == turn && is_ready && !is_blocked {
                    for result in &inst.results {
                        to_come.remove(result);
                    }
                    nodes.push(Node::Inst(inst));
                } else {
                    // Others keep their order.
                    is_blocked |= !turn && !native;
                    stays.push(inst);
                    stay_kinds.push(native);
                }
            }
            (*window, kinds) = (stays, stay_kinds);
            turn = !turn;
        }
    }

    fn is_native(&self, scratch: &mut Stretch, inst: &Inst) -> bool {
        if matches!(inst.op, Op::Const(_)) {
            return true;
        }
        if !inst.op.is_pure() {
            return false;
        }
        let places = |values: &[Value]| -> Vec<IrOperand> {
            let place = |&value: &Value| IrOperand {
                value,
                ty: self.types[value.index()],
                row: ValueRow::Forwarded,
                constant: self.constants.get(&value).copied(),
            };
            values.iter().map(place).collect()
        };
        let mark = scratch.mark();
        let is_native = scratch.perform(&inst.op, &places(&inst.args), &places(&inst.results));
        scratch.take_back(mark);
        is_native
    }
}
