//! Tables by id. Ids are dense below the module's bound, so a look-up is one load.

use crate::parse::Id;

/// Items by id.
pub(super) struct IdTable<T> {
    /// Index in `items` by id, plus one.
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
    /// The last item of an id.
    pub fn get(&self, id: Id) -> Option<&T> {
        self.get_since(id, 0)
    }

    /// The last item of an id, if it was added at this table length or later.
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

    /// The number of added items.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Removes the items that were added since the table had this length, and restores the ids that
    /// they replaced.
    pub fn truncate(&mut self, length: usize) {
        for (id, _) in self.items.drain(length..) {
            self.places[id as usize] = 0;
        }
    }
}
