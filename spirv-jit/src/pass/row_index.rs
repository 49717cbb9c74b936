//! Rows of a function's variables as places in one table.

use crate::ir::{Function, VariableId};

/// Where the rows of each variable begin.
pub struct RowIndex {
    first: Vec<usize>,
    /// Length of the table.
    pub count: usize,
}

/// Rows beyond which there is no table: copies of functions with huge variables.
const MAX_ROWS: usize = 1 << 24;

impl RowIndex {
    /// Places for the variables that `holds` names, by index: their rows, and one more that is
    /// none.
    pub fn new(function: &Function, holds: impl Fn(usize) -> bool) -> Option<Self> {
        let mut index = Self {
            first: Vec::with_capacity(function.variables.len()),
            count: 0,
        };
        for (number, variable) in function.variables.iter().enumerate() {
            index.first.push(index.count);
            if holds(number) {
                index.count += variable.rows as usize + 1;
            }
        }
        (index.count <= MAX_ROWS).then_some(index)
    }

    /// The place of a row of a variable that was named.
    pub fn place(&self, variable: VariableId, row: u32) -> usize {
        self.first[variable.index()] + row as usize
    }
}
