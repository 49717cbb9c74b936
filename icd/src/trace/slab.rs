//! Things in flight, by index: an index stays valid until its thing is removed, and is used again
//! then.
#![forbid(unsafe_code)]

use std::ops::{Index, IndexMut};

/// A list with holes. Removed entries keep their memory for the next one that takes the place.
pub struct Slab<T> {
    entries: Vec<T>,
    free: Vec<u32>,
}

impl<T> Default for Slab<T> {
    fn default() -> Self {
        Self {
            entries: Vec::new(),
            free: Vec::new(),
        }
    }
}

impl<T: Default> Slab<T> {
    /// Takes a place; what was left in it is still there, for its memory to be used again.
    #[inline]
    pub fn take(&mut self) -> u32 {
        match self.free.pop() {
            Some(place) => place,
            None => self.add(),
        }
    }

    /// Adds a place.
    #[cold]
    fn add(&mut self) -> u32 {
        // A panic loses the device; without it, the process would be aborted.
        self.entries
            .try_reserve(1)
            .expect("memory for what is in flight");
        self.entries.push(T::default());
        self.entries.len() as u32 - 1
    }

    /// Gives a place back.
    #[inline]
    pub fn remove(&mut self, index: u32) {
        self.free.push(index);
    }

    /// Whether no place is taken.
    pub fn is_empty(&self) -> bool {
        self.free.len() == self.entries.len()
    }

    /// Gives all places back, keeping their memory.
    pub fn clear(&mut self) {
        self.free.clear();
        self.free.extend((0..self.entries.len() as u32).rev());
    }
}

impl<T> Index<u32> for Slab<T> {
    type Output = T;

    fn index(&self, index: u32) -> &T {
        &self.entries[index as usize]
    }
}

impl<T> IndexMut<u32> for Slab<T> {
    fn index_mut(&mut self, index: u32) -> &mut T {
        &mut self.entries[index as usize]
    }
}
