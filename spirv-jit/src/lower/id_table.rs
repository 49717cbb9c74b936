//! Tables by id: ids are dense below the module's bound, so a place is one load away.

use crate::parse::Id;

/// Things by id.
pub(super) struct IdTable<T> {
    /// Place in `items` by id, plus one.
    places: Vec<u32>,
    items: Vec<(Id, T)>,
}

impl<T> Default for IdTable<T> {
    fn default() -> Self {
        Self {
            places: Vec::new(),
            items: Vec::new(),
        }
    }
}

impl<T> IdTable<T> {
    /// The last thing that was put there.
    pub fn get(&self, id: Id) -> Option<&T> {
        self.get_since(id, 0)
    }

    /// The same, if it was put there when the table had that length or a greater one.
    pub fn get_since(&self, id: Id, length: usize) -> Option<&T> {
        let place = (*self.places.get(id as usize)? as usize).checked_sub(1)?;
        (place >= length).then(|| &self.items[place].1)
    }

    pub fn insert(&mut self, id: Id, item: T) {
        if self.places.len() <= id as usize {
            self.places.resize(id as usize + 1, 0);
        }
        self.items.push((id, item));
        self.places[id as usize] = self.items.len() as u32;
    }

    /// How many things were put in.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Removes the entries that were added since the table had that length, and the ids that were
    /// replaced meanwhile.
    pub fn truncate(&mut self, length: usize) {
        for (id, _) in self.items.drain(length..) {
            self.places[id as usize] = 0;
        }
    }
}
