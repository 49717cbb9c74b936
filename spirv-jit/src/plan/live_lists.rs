//! Lists of the live values at many positions. Neighboring lists have most entries in common. Each
//! list is a tree over numbered slots, and lists share equal subtrees. So the memory of all lists
//! is proportional to the changes between them, not to positions times values.
#![forbid(unsafe_code)]

use std::ops::Range;

/// Slots of a leaf, and children of a branch.
const WIDTH: usize = 16;

/// Levels of a tree whose slots are numbered by 32 bits.
const LEVELS: usize = 8;

/// The id of a list in [`Lists`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct List(u32);

impl List {
    pub const EMPTY: List = List(0);
}

/// A subtree.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    /// Entries, by number.
    Leaf { first: u32, end: u32 },
    /// Ids of the children, in the array of all branches.
    Branch { first: u32, end: u32 },
}

/// All lists.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lists<T> {
    entries: Vec<T>,
    children: Vec<u32>,
    /// The first is empty.
    parts: Vec<Part>,
}

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self {
            entries: Vec::new(),
            children: Vec::new(),
            parts: vec![Part::Leaf { first: 0, end: 0 }],
        }
    }
}

impl<T> Lists<T> {
    /// Every entry of every list, once for each subtree that has it.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }

    /// The ranges of a list's entries, in the order of their slots.
    #[inline]
    pub fn ranges(&self, list: List) -> Ranges<'_, T> {
        Ranges {
            lists: self,
            part: Some(list.0),
            open: [(0, 0); LEVELS],
            depth: 0,
        }
    }

    /// The entries of a list.
    pub fn of(&self, list: List) -> impl Iterator<Item = &T> {
        let ranges = self.ranges(list);
        ranges.flat_map(|range| &self.entries[range])
    }

    fn add(&mut self, part: Part) -> u32 {
        self.parts.push(part);
        self.parts.len() as u32 - 1
    }
}

/// See [`Lists::ranges`].
pub(crate) struct Ranges<'l, T> {
    lists: &'l Lists<T>,
    /// The current subtree.
    part: Option<u32>,
    /// Pending children of open branches.
    open: [(u32, u32); LEVELS],
    depth: usize,
}

impl<T> Iterator for Ranges<'_, T> {
    type Item = Range<usize>;

    #[inline]
    fn next(&mut self) -> Option<Range<usize>> {
        loop {
            let part = match self.part.take() {
                Some(part) => part,
                None => loop {
                    let (next, end) = self.open.get_mut(self.depth.checked_sub(1)?)?;
                    if next < end {
                        *next += 1;
                        break self.lists.children[*next as usize - 1];
                    }
                    self.depth -= 1;
                },
            };
            match self.lists.parts[part as usize] {
                Part::Leaf { first, end } => return Some(first as usize..end as usize),
                Part::Branch { first, end } => {
                    self.open[self.depth] = (first, end);
                    self.depth += 1;
                }
            }
        }
    }
}

/// A subtree that is not stored yet.
const CHANGED: u32 = u32::MAX;

/// A list under construction, which changes from position to position.
pub(super) struct Changing<T> {
    slots: Vec<Option<T>>,
    /// By level, leaves first: the id of each subtree, or [`CHANGED`]. The last level is the root.
    parts: Vec<Vec<u32>>,
    /// By level: the subtrees that are [`CHANGED`].
    changed: Vec<Vec<usize>>,
}

impl<T> Default for Changing<T> {
    fn default() -> Self {
        Self {
            slots: Vec::new(),
            parts: Vec::new(),
            changed: Vec::new(),
        }
    }
}

impl<T: Copy> Changing<T> {
    /// Sets or clears a slot.
    pub fn set(&mut self, slot: usize, entry: Option<T>) {
        if self.slots.len() <= slot {
            self.slots.resize(slot + 1, None);
        }
        self.slots[slot] = entry;
        let mut at = slot;
        for level in 0.. {
            at /= WIDTH;
            if level == self.parts.len() {
                self.parts.push(Vec::new());
                self.changed.push(Vec::new());
            }
            let (parts, changed) = (&mut self.parts[level], &mut self.changed[level]);
            while parts.len() <= at {
                changed.push(parts.len());
                parts.push(CHANGED);
            }
            if parts[at] != CHANGED {
                changed.push(at);
                parts[at] = CHANGED;
            }
            if parts.len() == 1 {
                break;
            }
        }
    }

    /// Stores the current list.
    pub fn list(&mut self, lists: &mut Lists<T>) -> List {
        for level in 0..self.parts.len() {
            let (below, here) = self.parts.split_at_mut(level);
            let here = &mut here[0];
            for at in self.changed[level].drain(..) {
                here[at] = match below.last() {
                    None => leaf(&self.slots, at, lists),
                    Some(below) => branch(below, at, lists),
                };
            }
        }
        let root = self.parts.last().and_then(|root| root.first());
        root.map_or(List::EMPTY, |&part| List(part))
    }
}

/// The children of a subtree, or the slots of a leaf.
fn of_part<T>(below: &[T], at: usize) -> &[T] {
    &below[at * WIDTH..below.len().min((at + 1) * WIDTH)]
}

fn leaf<T: Copy>(slots: &[Option<T>], at: usize, lists: &mut Lists<T>) -> u32 {
    let first = lists.entries.len() as u32;
    let filled = of_part(slots, at).iter().flatten();
    lists.entries.extend(filled.copied());
    let end = lists.entries.len() as u32;
    match first == end {
        true => List::EMPTY.0,
        false => lists.add(Part::Leaf { first, end }),
    }
}

fn branch<T>(below: &[u32], at: usize, lists: &mut Lists<T>) -> u32 {
    let first = lists.children.len() as u32;
    let filled = of_part(below, at).iter().copied();
    let filled = filled.filter(|&part| part != List::EMPTY.0);
    lists.children.extend(filled);
    let end = lists.children.len() as u32;
    match lists.children[first as usize..] {
        [] => List::EMPTY.0,
        // A branch with one child is that child.
        [only] => {
            lists.children.pop();
            only
        }
        _ => lists.add(Part::Branch { first, end }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_keep_what_was_in_the_slots() {
        let mut random = fastrand::Rng::with_seed(3);
        let (mut changing, mut lists) = (Changing::default(), Lists::default());
        let mut slots: Vec<Option<u32>> = Vec::new();
        let mut expected = vec![(changing.list(&mut lists), slots.clone())];
        for round in 0..600 {
            // More and more slots, then none.
            let bound = 1 + round * round / 40;
            for _ in 0..random.usize(0..4) {
                let slot = random.usize(0..bound);
                let entry = (round < 400 || random.u8(..) == 0).then(|| random.u32(..));
                slots.resize(slots.len().max(slot + 1), None);
                slots[slot] = entry;
                changing.set(slot, entry);
            }
            if round > 500 {
                for slot in 0..slots.len() {
                    if slots[slot].take().is_some() {
                        changing.set(slot, None);
                        break;
                    }
                }
            }
            expected.push((changing.list(&mut lists), slots.clone()));
        }
        for (list, slots) in expected {
            let filled: Vec<u32> = slots.into_iter().flatten().collect();
            assert!(lists.of(list).eq(&filled));
        }
    }

    #[test]
    fn memory_follows_the_changes() {
        let size = |count: u32| {
            let (mut changing, mut lists) = (Changing::default(), Lists::default());
            (0..count).for_each(|slot| changing.set(slot as usize, Some(slot)));
            for slot in 0..count {
                changing.set(slot as usize, Some(slot + 1));
                changing.list(&mut lists);
            }
            lists.entries.len() + lists.children.len() + lists.parts.len()
        };
        // Trees are deeper by one level.
        assert!(size(16_000) < 32 * size(1000));
    }
}
