//! Tables of image views, samplers and replayable structures, for descriptors that lie in memory
//! which applications and shaders write: those name a slot by a [`Key`], or by a key that follows
//! from what it names ([`Key::named`]). A key that was never given out, or whose object is gone,
//! finds nothing.

use std::cell::UnsafeCell;
use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError, RwLock};

use images::{ImageDescriptor, SamplerDescriptor};

/// Names a slot: twice its number, so that bit 0 is clear, and in the upper half a check of 31
/// bits, which is never zero and changes with each use of the slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Key(pub u64);

/// The bit of a number that no slot has: the key is a name.
const NAME: u32 = 1 << 30;

impl Key {
    /// The name of contents with this hash: the same on every device.
    pub fn named(hash: u64) -> Self {
        let check = (hash >> 32) as u32 & (u32::MAX >> 1);
        Self::new(NAME | (hash as u32 & (NAME - 1)), check.max(1))
    }

    fn is_name(self) -> bool {
        self.number() & NAME != 0
    }

    fn new(number: u32, check: u32) -> Self {
        Self(u64::from(number) << 1 | u64::from(check) << 32)
    }

    fn number(self) -> u32 {
        (self.0 as u32) >> 1
    }

    fn check(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// Whether it can be asked for again ([`Table::store_replayable`], [`Table::store_named`]).
    pub fn is_replayable(self) -> bool {
        self.is_name() || !self.number().is_multiple_of(2)
    }
}

/// Why contents cannot be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    OutOfMemory,
    /// Something else has the key that was asked for.
    Taken,
}

const SLOTS_BITS: u32 = 5;
const CHUNKS_BITS: u32 = 11;
const GROUPS: u32 = 1 << 9;
/// Slots that a table can have.
const NUMBERS: u32 = GROUPS << (SLOTS_BITS + CHUNKS_BITS);

/// Slots wait for so many other frees before they are reused: a reader that still holds one,
/// against the rules, reads the old contents.
const QUARANTINE: usize = 64;

struct Slot<T> {
    /// The key's; 0 while the slot is free.
    check: AtomicU32,
    contents: UnsafeCell<T>,
}

type Chunk<T> = OnceLock<Box<[Slot<T>]>>;

/// Slots at addresses that stay as long as the table. Slots that can be asked for again by their
/// keys have odd numbers, others even ones.
pub struct Table<T> {
    groups: Box<[OnceLock<Box<[Chunk<T>]>>]>,
    state: Mutex<KeyAllocator>,
    /// The keys of slots by name.
    named: RwLock<HashMap<Key, Key>>,
    /// The contents of free slots.
    null: T,
    /// Makes a slot's contents harmless to those that read it meanwhile.
    nullify: fn(&mut T),
}

#[derive(Default)]
struct KeyAllocator {
    numbers: [Numbers; 2],
    check: u32,
}

/// Which numbers are free: from `next` on, in steps of two, and those of objects that are gone,
/// oldest first. Some of either may be in use: they were asked for.
#[derive(Default)]
struct Numbers {
    next: u32,
    free: VecDeque<u32>,
}

fn allocate<U>(count: u32, item: impl Fn() -> U) -> Result<Box<[U]>, StoreError> {
    let mut items = Vec::new();
    let room = items.try_reserve_exact(count as usize);
    room.map_err(|_| StoreError::OutOfMemory)?;
    items.extend((0..count).map(|_| item()));
    Ok(items.into_boxed_slice())
}

fn filled<U>(
    place: &OnceLock<Box<[U]>>,
    count: u32,
    item: impl Fn() -> U,
) -> Result<&[U], StoreError> {
    if place.get().is_none() {
        // The first thread wins: all compute the same value.
        let _ = place.set(allocate(count, item)?);
    }
    place.get().map(|it| &**it).ok_or(StoreError::OutOfMemory)
}

impl<T: Copy> Table<T> {
    /// An empty table. `null` is what reads give zeros from; `nullify` makes contents so without
    /// moving what they point to.
    pub fn new(null: T, nullify: fn(&mut T)) -> Self {
        Self {
            groups: (0..GROUPS).map(|_| OnceLock::new()).collect(),
            state: Mutex::default(),
            named: RwLock::default(),
            null,
            nullify,
        }
    }

    fn state(&self) -> MutexGuard<'_, KeyAllocator> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn slot(&self, number: u32) -> Option<&Slot<T>> {
        let (chunk, slot) = (number >> SLOTS_BITS, number & ((1 << SLOTS_BITS) - 1));
        let group = self.groups.get((chunk >> CHUNKS_BITS) as usize)?.get()?;
        let chunk = &group[(chunk & ((1 << CHUNKS_BITS) - 1)) as usize];
        Some(&chunk.get()?[slot as usize])
    }

    fn slot_or_new(&self, number: u32) -> Result<&Slot<T>, StoreError> {
        let (chunk, slot) = (number >> SLOTS_BITS, number & ((1 << SLOTS_BITS) - 1));
        let group = self.groups.get((chunk >> CHUNKS_BITS) as usize);
        let group = group.ok_or(StoreError::OutOfMemory)?;
        let group = filled(group, 1 << CHUNKS_BITS, OnceLock::new)?;
        let chunk = &group[(chunk & ((1 << CHUNKS_BITS) - 1)) as usize];
        let chunk = filled(chunk, 1 << SLOTS_BITS, || Slot {
            check: AtomicU32::new(0),
            contents: UnsafeCell::new(self.null),
        })?;
        Ok(&chunk[slot as usize])
    }

    /// Stores contents.
    ///
    /// # Errors
    /// [`StoreError::OutOfMemory`].
    pub fn store(&self, contents: T) -> Result<Key, StoreError> {
        self.store_at(contents, false, None)
    }

    /// Stores contents under a key that can be asked for again: `wanted`, if it was given out
    /// before.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn store_replayable(&self, contents: T, wanted: Option<Key>) -> Result<Key, StoreError> {
        self.store_at(contents, true, wanted)
    }

    /// Stores contents under a name, and returns the key of the slot that has them.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn store_named(&self, contents: T, name: Key) -> Result<Key, StoreError> {
        let mut named = self.named.write().unwrap_or_else(PoisonError::into_inner);
        if named.contains_key(&name) || !name.is_name() {
            return Err(StoreError::Taken);
        }
        named.try_reserve(1).map_err(|_| StoreError::OutOfMemory)?;
        let slot = self.store(contents)?;
        named.insert(name, slot);
        Ok(slot)
    }

    /// The key of the slot that a name names.
    #[cold]
    fn slot_named(&self, name: Key) -> Option<Key> {
        let named = self.named.read().unwrap_or_else(PoisonError::into_inner);
        named.get(&name).copied()
    }

    fn store_at(&self, contents: T, odd: bool, wanted: Option<Key>) -> Result<Key, StoreError> {
        let state = &mut *self.state();
        let key = match wanted {
            Some(key) => {
                let in_use = self
                    .slot(key.number())
                    .is_some_and(|slot| slot.check.load(Ordering::Relaxed) != 0);
                if !key.is_replayable()
                    || key.number() >= NUMBERS
                    || !(1..1 << 31).contains(&key.check())
                    || key.0 & 1 != 0
                    || in_use
                {
                    return Err(StoreError::Taken);
                }
                key
            }
            None => {
                state.check = (state.check + 1) % (1 << 31);
                state.check = state.check.max(1);
                Key::new(self.free_number(&mut state.numbers, odd)?, state.check)
            }
        };
        let slot = self.slot_or_new(key.number())?;
        // SAFETY: the lock is held and no key finds the slot.
        unsafe { *slot.contents.get() = contents };
        slot.check.store(key.check(), Ordering::Release);
        Ok(key)
    }

    fn free_number(&self, numbers: &mut [Numbers; 2], odd: bool) -> Result<u32, StoreError> {
        let Numbers { next, free } = &mut numbers[odd as usize];
        free.try_reserve(1).map_err(|_| StoreError::OutOfMemory)?;
        loop {
            let number = if free.len() > QUARANTINE || *next >= NUMBERS / 2 {
                free.pop_front().ok_or(StoreError::OutOfMemory)?
            } else {
                *next += 1;
                2 * (*next - 1) + odd as u32
            };
            let in_use = self
                .slot(number)
                .is_some_and(|slot| slot.check.load(Ordering::Relaxed) != 0);
            if !in_use {
                return Ok(number);
            }
        }
    }

    /// Forgets a key: it finds nothing any more, and its contents are made null.
    pub fn remove(&self, key: Key) {
        let mut key = key;
        if key.is_name() {
            let mut named = self.named.write().unwrap_or_else(PoisonError::into_inner);
            let Some(slot) = named.remove(&key) else {
                return;
            };
            key = slot;
        }
        let state = &mut *self.state();
        let Some(slot) = self.slot(key.number()) else {
            return;
        };
        if slot.check.load(Ordering::Relaxed) != key.check() {
            return;
        }
        slot.check.store(0, Ordering::Release);
        // SAFETY: the lock is held and no key finds the slot.
        (self.nullify)(unsafe { &mut *slot.contents.get() });
        let Numbers { free, .. } = &mut state.numbers[(key.number() & 1) as usize];
        // Where there is no memory to note it, the number is not used again.
        if free.try_reserve(1).is_ok() {
            free.push_back(key.number());
        }
    }

    /// The slot that a key named when it was given out, whether or not the key still finds it; null
    /// for a number that was never used. It stays readable as long as the table.
    #[inline]
    pub fn slot_of(&self, key: Key) -> *const T {
        (self.slot(key.number())).map_or(std::ptr::null(), |slot| slot.contents.get().cast_const())
    }

    /// The contents that a key names, or null. They stay readable as long as the table.
    #[inline]
    pub fn get(&self, key: Key) -> *const T {
        let mut key = key;
        if key.is_name() {
            let Some(slot) = self.slot_named(key) else {
                return std::ptr::null();
            };
            key = slot;
        }
        match self.slot(key.number()) {
            Some(slot) if key.check() != 0 && slot.check.load(Ordering::Acquire) == key.check() => {
                slot.contents.get()
            }
            _ => std::ptr::null(),
        }
    }
}

/// The objects that descriptors of a device can name.
pub struct Views {
    pub images: Table<ImageDescriptor>,
    pub samplers: Table<SamplerDescriptor>,
    /// Addresses of acceleration structures whose descriptors can be had again though the
    /// structures lie elsewhere.
    pub structures: Table<u64>,
    /// The keys of those, by address.
    structure_keys: Mutex<HashMap<u64, Key>>,
}

impl Views {
    /// Stores the address of a structure, under the key `wanted` if there is one.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn store_structure(&self, address: u64, wanted: Option<Key>) -> Result<Key, StoreError> {
        let mut keys = self.keys();
        keys.try_reserve(1).map_err(|_| StoreError::OutOfMemory)?;
        let key = self.structures.store_replayable(address, wanted)?;
        keys.insert(address, key);
        Ok(key)
    }

    /// Forgets a structure of [`Self::store_structure`].
    pub fn remove_structure(&self, address: u64, key: Key) {
        self.structures.remove(key);
        let mut keys = self.keys();
        if keys.get(&address) == Some(&key) {
            keys.remove(&address);
        }
    }

    /// The key of the replayable structure at an address, if there is one.
    pub fn structure_key(&self, address: u64) -> Option<Key> {
        self.keys().get(&address).copied()
    }

    fn keys(&self) -> MutexGuard<'_, HashMap<u64, Key>> {
        let keys = self.structure_keys.lock();
        keys.unwrap_or_else(PoisonError::into_inner)
    }
}

// SAFETY: contents are plain data, written under the lock while no key finds them; accesses to the
// memory that they name are synchronised by the Vulkan application.
unsafe impl Send for Views {}
// SAFETY: contents are written under the lock, and only while no key finds them.
unsafe impl Sync for Views {}

impl Default for Views {
    fn default() -> Self {
        Self {
            // The memory that a view was of stays where it is: it reads as zeros once it is freed.
            images: Table::new(ImageDescriptor::NULL, |image| image.level_count = 0),
            samplers: Table::new(SamplerDescriptor::DEFAULT, |_| ()),
            structures: Table::new(0, |address| *address = 0),
            structure_keys: Mutex::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table<u32> {
        Table::new(0, |it| *it = 0)
    }

    fn read(table: &Table<u32>, key: Key) -> Option<u32> {
        // SAFETY: null, or the table's.
        unsafe { table.get(key).as_ref() }.copied()
    }

    #[test]
    fn only_keys_that_were_given_out_find_something() {
        let table = table();
        let keys: Vec<Key> = (0..200).map(|k| table.store(k).unwrap()).collect();
        for (k, &key) in keys.iter().enumerate() {
            assert_eq!(read(&table, key), Some(k as u32));
            assert_eq!(key.0 & 1, 0);
            assert_eq!(read(&table, Key(key.0 ^ 1 << 40)), None);
            assert_eq!(read(&table, Key(key.0 & 0xffff_ffff)), None);
        }
        assert_eq!(read(&table, Key(0)), None);
        assert_eq!(read(&table, Key(u64::MAX)), None);
        table.remove(keys[7]);
        table.remove(keys[7]);
        assert_eq!(read(&table, keys[7]), None);
    }

    #[test]
    fn slots_are_used_again_under_other_keys() {
        let table = table();
        let mut numbers = std::collections::HashSet::new();
        for k in 0..10_000 {
            let key = table.store(k).unwrap();
            numbers.insert(key.number());
            table.remove(key);
            assert_eq!(read(&table, key), None);
        }
        assert!(numbers.len() <= QUARANTINE + 2);
    }

    #[test]
    fn a_key_can_be_had_again() {
        let table = table();
        let key = table.store_replayable(5, None).unwrap();
        assert_eq!(table.store_replayable(6, Some(key)), Err(StoreError::Taken));
        table.remove(key);
        assert_eq!(table.store_replayable(6, Some(key)), Ok(key));
        assert_eq!(read(&table, key), Some(6));
        let fresh = self::table();
        let others: Vec<Key> = (0..100).map(|k| fresh.store(k).unwrap()).collect();
        assert_eq!(fresh.store_replayable(7, Some(key)), Ok(key));
        assert!((0..100).all(|k| fresh.store_replayable(k, None).unwrap() != key));
        assert_eq!(read(&fresh, key), Some(7));
        assert_eq!(read(&fresh, others[3]), Some(3));
        let name = Key::named(1 << 40).0;
        for wild in [0, 2, u64::MAX, u64::MAX - 1, 1 << 32, name] {
            let wild = fresh.store_replayable(1, Some(Key(wild)));
            assert_eq!(wild, Err(StoreError::Taken));
        }
    }

    #[test]
    fn names_are_the_same_in_every_table() {
        let (table, fresh) = (table(), self::table());
        let names = [3, u64::MAX, 0x8123_4567_89ab_cdef].map(Key::named);
        for (k, &name) in (10..).zip(&names) {
            assert_eq!(name.0 & 1, 0);
            assert_eq!(read(&table, name), None);
            let slot = table.store_named(k, name).unwrap();
            assert_eq!(table.store_named(k, name), Err(StoreError::Taken));
            assert_eq!((read(&table, name), read(&table, slot)), (Some(k), Some(k)));
        }
        for (k, &name) in (20..).zip(names.iter().rev()) {
            fresh.store_named(k, name).unwrap();
        }
        assert_eq!(read(&fresh, names[0]), Some(22));
        table.remove(names[1]);
        assert_eq!(read(&table, names[1]), None);
        assert_eq!(read(&table, names[2]), Some(12));
        table.store_named(30, names[1]).unwrap();
        assert_eq!(read(&table, names[1]), Some(30));
        let other = table.store(1).unwrap();
        assert_eq!(table.store_named(1, other), Err(StoreError::Taken));
    }
}
