//! Facts of loops by which it is decided whether and how they become native code.

use foldhash::HashSet;

use crate::ir::{Body, Label, Node, Op, Space, Step, Terminator, Value};

/// Whether there are operations that need to know a subgroup's lanes, or that other lanes may see:
/// across lanes, on private memory, or stores.
pub(super) fn needs_both_halves(body: &Body) -> bool {
    body.steps().any(|step| match step {
        Step::Inst(inst) => match inst.op {
            Op::Load(access) => access.space == Space::Private,
            Op::Store(_) => true,
            Op::Subgroup(_) | Op::VarLoad(..) | Op::VarStore(..) => true,
            _ => false,
        },
        _ => false,
    })
}

/// Whether a body stores to memory that other lanes may see.
pub(super) fn stores_words(body: &Body) -> bool {
    body.steps().any(|step| match step {
        Step::Inst(inst) => {
            matches!(inst.op, Op::Store(access) if access.space != Space::Private)
        }
        _ => false,
    })
}

/// The values that a body's operations and branches take.
pub(super) fn used(body: &Body) -> HashSet<Value> {
    let mut used = HashSet::default();
    for step in body.steps() {
        match step {
            Step::Inst(inst) => used.extend(&inst.args),
            Step::Open(Node::If { condition, .. }) => {
                used.insert(*condition);
            }
            Step::End(body) => {
                if let Terminator::Br(_, args) = &body.end {
                    used.extend(args);
                }
            }
            _ => {}
        }
    }
    used
}

/// How many loads of a loop are from places that other loads of the loop decide.
pub(super) fn indirect_loads(node: &Node) -> usize {
    let Node::Loop { body, .. } = node else {
        return 0;
    };
    let mut loaded: HashSet<Value> = HashSet::default();
    loop {
        let before = loaded.len();
        let mut loads = 0;
        let mut results: Vec<(Label, &[Value])> = node
            .label()
            .map(|label| (label, node.definitions()))
            .into_iter()
            .collect();
        for step in body.steps() {
            match step {
                Step::Inst(inst) => {
                    let depends = inst.args.iter().any(|arg| loaded.contains(arg));
                    let is_load =
                        matches!(inst.op, Op::Load(access) if access.space != Space::Private);
                    loads += (is_load && depends) as usize;
                    if is_load || depends {
                        loaded.extend(&inst.results);
                    }
                }
                Step::Open(node) => {
                    results.extend(node.label().map(|label| (label, node.definitions())));
                }
                Step::End(Body {
                    end: Terminator::Br(label, args),
                    ..
                }) => {
                    let target = results.iter().find(|(other, _)| other == label);
                    let pairs = target.into_iter().flat_map(|(_, to)| to.iter().zip(args));
                    let from_loads = pairs.filter(|(_, from)| loaded.contains(from));
                    let to: Vec<Value> = from_loads.map(|(&to, _)| to).collect();
                    loaded.extend(to);
                }
                _ => {}
            }
        }
        if loaded.len() == before {
            return loads;
        }
    }
}
