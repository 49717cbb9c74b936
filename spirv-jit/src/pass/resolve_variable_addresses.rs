//! Turns private accesses with the address of a variable plus a constant into accesses to a fixed
//! row. Inlining of pointer parameters leaves such accesses.

use smallvec::smallvec;

use super::edit::{Edit, edit_body};
use crate::ir::{Function, Inst, Node, Op, Space, Type, Value, VariableId};

/// Rewrites loads and stores of known rows inside a variable; others stay as they are.
pub fn resolve_variable_addresses(function: &mut Function) {
    let mut resolver = Resolver {
        known: vec![AddressFact::Nothing; function.value_types.len()],
        types: &function.value_types,
        rows: function.variables.iter().map(|v| v.rows).collect(),
    };
    edit_body(&mut function.body, &mut resolver);
}

/// Facts about an i32.
#[derive(Clone, Copy)]
enum AddressFact {
    Nothing,
    Constant(u32),
    /// The address of this row of a variable.
    VariableRow(VariableId, u32),
}

struct Resolver<'a> {
    known: Vec<AddressFact>,
    types: &'a [Type],
    rows: Vec<u32>,
}

impl Edit for Resolver<'_> {
    fn inst(&mut self, inst: &mut Inst, before: &mut Vec<Node>) -> bool {
        self.learn(inst);
        let resolved = self.resolve(inst);
        let stays = resolved.is_none();
        before.extend(resolved.into_iter().flatten().map(Node::Inst));
        stays
    }
}

impl Resolver<'_> {
    fn known(&self, value: Value) -> AddressFact {
        self.known[value.index()]
    }

    fn learn(&mut self, inst: &Inst) {
        let known = match inst.op {
            Op::Const(bits) => AddressFact::Constant(bits as u32),
            Op::VarAddress(variable) => AddressFact::VariableRow(variable, 0),
            Op::IAdd => match (self.known(inst.args[0]), self.known(inst.args[1])) {
                (AddressFact::VariableRow(variable, row), AddressFact::Constant(more))
                | (AddressFact::Constant(more), AddressFact::VariableRow(variable, row)) => {
                    AddressFact::VariableRow(variable, row.wrapping_add(more))
                }
                _ => return,
            },
            _ => return,
        };
        self.known[inst.results[0].index()] = known;
    }

    /// The accesses to fixed rows that replace an access to private memory.
    fn resolve(&self, inst: &Inst) -> Option<Vec<Inst>> {
        let (access, scalars) = match inst.op {
            Op::Load(access) => (access, &inst.results[..]),
            Op::Store(access) if access.space == Space::Private => (access, &inst.args[1..]),
            _ => return None,
        };
        if access.space != Space::Private {
            return None;
        }
        let AddressFact::VariableRow(variable, first) = self.known(inst.args[0]) else {
            return None;
        };
        let stride = self.types[scalars[0].index()].rows();
        let rows = scalars.len() as u64 * stride as u64;
        if first as u64 + rows > self.rows[variable.index()] as u64 {
            return None;
        }
        let is_load = matches!(inst.op, Op::Load(_));
        let resolved = scalars.iter().enumerate().map(|(index, &scalar)| {
            let row = first + index as u32 * stride;
            let source = inst.source;
            if is_load {
                Inst {
                    op: Op::VarLoad(variable, row),
                    args: smallvec![],
                    results: smallvec![scalar],
                    source,
                }
            } else {
                Inst {
                    op: Op::VarStore(variable, row),
                    args: smallvec![scalar],
                    results: smallvec![],
                    source,
                }
            }
        });
        Some(resolved.collect())
    }
}
