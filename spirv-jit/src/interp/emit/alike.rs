//! Values of a loop that are the same in all lanes that come to them.

use foldhash::{HashMap, HashSet};

use crate::SUBGROUP_SIZE;
use crate::ir::op::SubgroupOp;
use crate::ir::{Inst, Node, Op, Space, Step, Terminator, Value};

/// The lanes among which values are to be the same.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Extent {
    /// Those of a subgroup.
    Subgroup,
    /// Those of all subgroups that take a loop together, which enter it with the same parameters.
    Together {
        /// Loads of the same offset are the same: the loop stores nothing.
        loads: bool,
    },
}

/// Values that a loop defines and that are the same in all lanes of an extent that come to them.
/// `is_uniform` tells values from outside that are the same in all lanes.
///
/// Lanes that take a turn have all taken the turns before. So a parameter is one of these values if
/// the loop is entered with such a value, and all ways back hand one and the same such value on.
pub(super) fn alike(
    node: &Node,
    extent: Extent,
    is_uniform: impl Fn(Value) -> bool,
) -> HashSet<Value> {
    let Node::Loop { params, init, .. } = node else {
        return HashSet::default();
    };
    let entered = params.iter().zip(init);
    let mut held: HashSet<Value> = entered
        .filter(|&(_, &value)| is_uniform(value))
        .map(|(&param, _)| param)
        .collect();
    // Fewer in each round.
    loop {
        let (found, lost) = turn(node, extent, &held, &is_uniform);
        if lost.is_empty() {
            return found;
        }
        held.retain(|param| !lost.contains(param));
    }
}

/// The values that are alike in a turn if some parameters are, and those of the parameters that are
/// not alike in the next turn.
fn turn(
    node: &Node,
    extent: Extent,
    held: &HashSet<Value>,
    is_uniform: impl Fn(Value) -> bool,
) -> (HashSet<Value>, HashSet<Value>) {
    let (mut found, mut lost) = (held.clone(), HashSet::default());
    let Node::Loop {
        label,
        params,
        body,
        ..
    } = node
    else {
        return (found, lost);
    };
    let mut handed_on: HashMap<Value, Value> = HashMap::default();
    for step in body.steps() {
        match step {
            Step::Inst(inst) => {
                if gives_alike(inst, extent, |arg| found.contains(&arg) || is_uniform(arg)) {
                    found.extend(&inst.results);
                }
            }
            Step::End(body) => {
                let Terminator::Br(to, args) = &body.end else {
                    continue;
                };
                if to != label {
                    continue;
                }
                for (&param, &arg) in params.iter().zip(args) {
                    let first = *handed_on.entry(param).or_insert(arg);
                    let is_alike = first == arg && (found.contains(&arg) || is_uniform(arg));
                    if held.contains(&param) && !is_alike {
                        lost.insert(param);
                    }
                }
            }
            _ => {}
        }
    }
    (found, lost)
}

/// Whether an operation gives all lanes the same. `is_alike` tells operands that are the same.
fn gives_alike(inst: &Inst, extent: Extent, is_alike: impl Fn(Value) -> bool) -> bool {
    use SubgroupOp::*;
    let are_alike = || inst.args.iter().all(|&arg| is_alike(arg));
    match inst.op {
        Op::Load(access) => {
            let is_same = match (access.space, extent) {
                (Space::Buffer, Extent::Together { loads }) => loads,
                // Subgroups may be of several workgroups.
                (space, Extent::Subgroup) => matches!(space, Space::Buffer | Space::Shared),
                _ => false,
            };
            is_same && !access.volatile && are_alike()
        }
        Op::Subgroup(_) if extent != Extent::Subgroup => false,
        Op::Subgroup(All | Any | AllEqual | Ballot | BroadcastFirst) => true,
        Op::Subgroup(Reduce { cluster, .. }) => usize::from(cluster) == SUBGROUP_SIZE,
        Op::Subgroup(Shuffle) => is_alike(inst.args[1]),
        _ => inst.op.is_pure() && are_alike(),
    }
}
