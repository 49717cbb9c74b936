//! The sources of phis.
#![forbid(unsafe_code)]

use std::collections::hash_map::Entry;

use foldhash::HashMap;

use crate::parse::Id;

/// The number of pairs up to which a linear search is cheaper than a table.
const FEW: usize = 8;

/// Values of phis by predecessor. A phi with many pairs has a table, since a search for each edge
/// would take quadratic time.
#[derive(Default)]
pub(super) struct PhiSources {
    /// By instruction: predecessors and values, sorted by predecessor.
    tables: HashMap<u32, Vec<(Id, Id)>>,
}

impl PhiSources {
    /// The (first) value of a phi for a predecessor. `pairs`: its operands.
    pub fn find(&mut self, phi: u32, pairs: &[u32], predecessor: Id) -> Option<Id> {
        let mut each = pairs.chunks_exact(2).map(|pair| (pair[1], pair[0]));
        if pairs.len() <= 2 * FEW {
            return each.find(|pair| pair.0 == predecessor).map(|pair| pair.1);
        }
        let table = match self.tables.entry(phi) {
            Entry::Occupied(table) => table.into_mut(),
            Entry::Vacant(room) => {
                let mut table: Vec<_> = each.collect();
                table.sort_by_key(|pair| pair.0);
                room.insert(table)
            }
        };
        let first = table.partition_point(|pair| pair.0 < predecessor);
        let pair = table.get(first).filter(|pair| pair.0 == predecessor);
        pair.map(|pair| pair.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_value_of_a_predecessor_counts() {
        for count in [1, FEW, FEW + 1, 300] {
            let mut sources = PhiSources::default();
            // Each predecessor twice, in an order that is not theirs.
            let pairs = (0..2 * count as u32).map(|i| [i, (7 * i + 3) % count as u32]);
            let pairs: Vec<u32> = pairs.flatten().collect();
            for predecessor in 0..count as u32 + 2 {
                let pair = pairs.chunks(2).find(|pair| pair[1] == predecessor);
                let found = sources.find(5, &pairs, predecessor);
                assert_eq!(found, pair.map(|pair| pair[0]));
            }
        }
    }
}
