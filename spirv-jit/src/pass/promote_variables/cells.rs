//! The cells: rows of variables that become values, with their types.

use crate::ir::{Function, Op, Type, VariableId};
use crate::pass::row_index::RowIndex;

/// An access to a variable at a fixed row, in tree order.
#[derive(Clone, Copy)]
struct RowAccess {
    variable: VariableId,
    row: u32,
    ty: Type,
    /// The variable has an address.
    is_pinned: bool,
}

/// The outcome of one access.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Promotion {
    /// The access stays in memory.
    Keep,
    /// The access is that of a cell of the same width.
    Cell(u32),
    /// A 64-bit access of this 32-bit cell (the low word) and the next.
    Pair(u32),
}

/// The rows that become values.
#[derive(Default)]
pub struct Cells {
    /// Type of each cell.
    pub types: Vec<Type>,
    /// Per access in tree order.
    pub promotions: Vec<Promotion>,
}

/// The accesses at one row.
#[derive(Clone, Copy, Default)]
struct RowUse {
    /// Types of up to 32 bits, as a set of `1 << Type`.
    narrow: u8,
    /// 64-bit types whose low word is here.
    low: u8,
    /// Some 64-bit type's high word is here.
    high: bool,
}

impl RowUse {
    fn is_unused(self) -> bool {
        self.narrow == 0 && self.low == 0 && !self.high
    }
}

/// Finds the cells of a function: rows of variables without an address, whose accesses agree in
/// width or are 64-bit ones over words.
pub fn find_cells(function: &Function) -> Cells {
    let mut accesses = Vec::new();
    let mut pinned = vec![false; function.variables.len()];
    collect_accesses(function, &mut accesses, &mut pinned);
    accesses.iter_mut().for_each(|access| {
        access.is_pinned = pinned[access.variable.index()];
    });
    let Some(rows) = RowIndex::new(function, |variable| !pinned[variable]) else {
        return Cells::default();
    };
    let mut uses = vec![RowUse::default(); rows.count];
    for access in accesses.iter().filter(|access| !access.is_pinned) {
        let at = rows.place(access.variable, access.row);
        let set = 1 << access.ty as u8;
        if access.ty.rows() == 2 {
            uses[at].low |= set;
            uses[at + 1].high = true;
        } else {
            uses[at].narrow |= set;
        }
    }

    let mut types = Vec::new();
    let mut placed = vec![Promotion::Keep; rows.count];
    let mut at = 0;
    while at < rows.count {
        if uses[at].is_unused() {
            at += 1;
            continue;
        }
        // Rows that 64-bit accesses connect are decided together.
        let length = uses[at..].iter().take_while(|row| row.low != 0).count() + 1;
        let group = at..at + length;
        place_group(&uses[group.clone()], &mut types, &mut placed[group]);
        at += length;
    }
    let promotions = accesses
        .iter()
        .map(|access| {
            if access.is_pinned {
                return Promotion::Keep;
            }
            match placed[rows.place(access.variable, access.row)] {
                Promotion::Cell(cell) if types[cell as usize].bits() < access.ty.bits() => {
                    Promotion::Pair(cell)
                }
                place => place,
            }
        })
        .collect();
    Cells { types, promotions }
}

fn collect_accesses(function: &Function, accesses: &mut Vec<RowAccess>, pinned: &mut [bool]) {
    function.body.visit_insts(&mut |inst| {
        let (variable, row, value) = match inst.op {
            Op::VarAddress(variable) => return pinned[variable.index()] = true,
            Op::VarLoad(variable, row) => (variable, row, inst.results[0]),
            Op::VarStore(variable, row) => (variable, row, inst.args[0]),
            _ => return,
        };
        accesses.push(RowAccess {
            variable,
            row,
            ty: function.ty(value),
            is_pinned: false,
        });
    });
}

/// Creates cells for a run of rows, if values can express all their accesses.
fn place_group(group: &[RowUse], types: &mut Vec<Type>, placed: &mut [Promotion]) {
    const WORDS: u8 = 1 << Type::I32 as u8 | 1 << Type::F32 as u8;
    let first = group[0];
    if let [row] = group {
        if let Some(ty) = one_type(row.narrow) {
            placed[0] = Promotion::Cell(types.len() as u32);
            types.push(ty);
        }
    } else if group.len() == 2 && first.narrow | group[1].narrow == 0 && !first.high {
        placed[0] = Promotion::Cell(types.len() as u32);
        types.push(one_type(first.low).expect("64-bit types have one width"));
    } else if group.iter().all(|row| row.narrow & !WORDS == 0) {
        for place in placed {
            *place = Promotion::Cell(types.len() as u32);
            types.push(Type::I32);
        }
    }
}

/// The type of a row with a set of access types: the only one, or the integer of their common
/// width.
pub fn one_type(set: u8) -> Option<Type> {
    let numbers = Type::NUMBERS.iter().copied();
    let mut types = numbers.filter(|&ty| set & 1 << ty as u8 != 0);
    let first = types.next()?;
    types.try_fold(first, |common, ty| {
        (common.bits() == ty.bits()).then_some(common.as_integer())
    })
}
