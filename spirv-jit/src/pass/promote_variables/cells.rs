//! Which rows of variables become values, and of which type.

use foldhash::HashMap;

use crate::ir::{Body, Function, Node, Op, Type, VariableId};

/// An access to a variable at a fixed row, in tree order.
#[derive(Clone, Copy)]
struct RowAccess {
    variable: VariableId,
    row: u32,
    ty: Type,
}

/// What becomes of one access.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Promotion {
    /// Stays an access to memory.
    Keep,
    /// Is the cell, of the same width.
    Cell(u32),
    /// A 64-bit access of this 32-bit cell (the low word) and the next.
    Pair(u32),
}

/// The rows that become values.
pub struct Cells {
    /// Type of each cell.
    pub types: Vec<Type>,
    /// Per access in tree order.
    pub promotions: Vec<Promotion>,
}

/// What is accessed at one row.
#[derive(Clone, Copy, Default)]
struct RowUse {
    /// Types of up to 32 bits, as a set of `1 << Type`.
    narrow: u8,
    /// 64-bit types whose low word is here.
    low: u8,
    /// Some 64-bit type's high word is here.
    high: bool,
}

/// Finds the cells of a function: rows of variables without an address, whose accesses agree in width or are 64-bit ones over words.
pub fn find_cells(function: &Function) -> Cells {
    let mut accesses = Vec::new();
    let mut pinned = vec![false; function.variables.len()];
    collect_accesses(function, &function.body, &mut accesses, &mut pinned);
    let mut uses: HashMap<(u32, u32), RowUse> = HashMap::default();
    for access in accesses.iter().filter(|a| !pinned[a.variable.index()]) {
        let at = (access.variable.0, access.row);
        let set = 1 << access.ty as u8;
        if access.ty.rows() == 2 {
            uses.entry(at).or_default().low |= set;
            uses.entry((at.0, at.1 + 1)).or_default().high = true;
        } else {
            uses.entry(at).or_default().narrow |= set;
        }
    }
    let mut rows: Vec<((u32, u32), RowUse)> = uses.into_iter().collect();
    rows.sort_unstable_by_key(|&(at, _)| at);

    let mut types = Vec::new();
    let mut placed: HashMap<(u32, u32), Promotion> = HashMap::default();
    let mut rest = &rows[..];
    while !rest.is_empty() {
        // Rows that 64-bit accesses tie together are decided together.
        let length = rest.iter().take_while(|(_, row)| row.low != 0).count() + 1;
        let (group, others) = rest.split_at(length);
        rest = others;
        place_group(group, &mut types, &mut placed);
    }
    let promotions = accesses
        .iter()
        .map(|access| {
            let place = placed.get(&(access.variable.0, access.row));
            match place.copied().unwrap_or(Promotion::Keep) {
                Promotion::Cell(cell) if types[cell as usize].bits() < access.ty.bits() => {
                    Promotion::Pair(cell)
                }
                place => place,
            }
        })
        .collect();
    Cells { types, promotions }
}

fn collect_accesses(
    function: &Function,
    body: &Body,
    accesses: &mut Vec<RowAccess>,
    pinned: &mut [bool],
) {
    for node in &body.nodes {
        match node {
            Node::Inst(inst) => match inst.op {
                Op::VarAddress(variable) => pinned[variable.index()] = true,
                Op::VarLoad(variable, row) => accesses.push(RowAccess {
                    variable,
                    row,
                    ty: function.ty(inst.results[0]),
                }),
                Op::VarStore(variable, row) => accesses.push(RowAccess {
                    variable,
                    row,
                    ty: function.ty(inst.args[0]),
                }),
                _ => {}
            },
            Node::Block { body, .. } | Node::Loop { body, .. } => {
                collect_accesses(function, body, accesses, pinned);
            }
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                collect_accesses(function, then_body, accesses, pinned);
                collect_accesses(function, else_body, accesses, pinned);
            }
        }
    }
}

/// Makes cells of a run of rows if their accesses can be told in values.
fn place_group(
    group: &[((u32, u32), RowUse)],
    types: &mut Vec<Type>,
    placed: &mut HashMap<(u32, u32), Promotion>,
) {
    const WORDS: u8 = 1 << Type::I32 as u8 | 1 << Type::F32 as u8;
    let first = group[0].1;
    if let [(at, row)] = group {
        if let Some(ty) = one_type(row.narrow) {
            placed.insert(*at, Promotion::Cell(types.len() as u32));
            types.push(ty);
        }
    } else if group.len() == 2 && first.narrow | group[1].1.narrow == 0 && !first.high {
        placed.insert(group[0].0, Promotion::Cell(types.len() as u32));
        types.push(one_type(first.low).expect("64-bit types have one width"));
    } else if group.iter().all(|(_, row)| row.narrow & !WORDS == 0) {
        for (at, _) in group {
            placed.insert(*at, Promotion::Cell(types.len() as u32));
            types.push(Type::I32);
        }
    }
}

/// The type for a cell that is accessed with all types of a set: the only one, or the integer of their common width.
fn one_type(set: u8) -> Option<Type> {
    let mut types = [
        Type::I1,
        Type::I8,
        Type::I16,
        Type::I32,
        Type::I64,
        Type::F16,
        Type::F32,
        Type::F64,
    ]
    .into_iter()
    .filter(|&ty| set & 1 << ty as u8 != 0);
    let first = types.next()?;
    types.try_fold(first, |common, ty| {
        (common.bits() == ty.bits()).then_some(common.as_integer())
    })
}
