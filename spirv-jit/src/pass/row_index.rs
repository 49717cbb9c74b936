//! Indices of all rows of a function's variables in one table.

use crate::ir::{Function, VariableId};

/// The first index of each variable's rows.
pub struct RowIndex {
    first: Vec<usize>,
    /// Length of the table.
    pub count: usize,
}

/// Largest number of rows with a table, for functions with huge variables.
const MAX_ROWS: usize = 1 << 24;

impl RowIndex {
    /// Assigns indices to the variables for which `holds` is true: one for each row, and an extra
    /// one for no row.
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

    /// The index of a row of such a variable.
    pub fn place(&self, variable: VariableId, row: u32) -> usize {
        self.first[variable.index()] + row as usize
    }
}
