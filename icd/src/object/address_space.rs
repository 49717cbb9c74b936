//! A device's address space, in two parts: one for ordinary memory, one for memory whose addresses
//! can be captured and replayed.
//!
//! A replay of a capture also allocates ordinary memory, such as a swapchain's images. In the same
//! part, that memory could take addresses that the replay requests later (the note to
//! `VkBufferOpaqueCaptureAddressCreateInfo` asks drivers to keep them apart).

use std::ops::Range;

use super::ranges::{Ranges, Taken};
use crate::os::address_space::{CHEAP_BYTES, release, reserve, reserve_at};

/// Allocations are multiples of this, and start at multiples of it (at least a page;
/// `VkMemoryRequirements::alignment` is smaller).
pub const GRANULE: u64 = 64 << 10;

/// The preferred address of the first device's address space, so that captured addresses are
/// available again.
const PREFERRED_BASE: u64 = 0x1000_0000_0000;
/// Number of fixed addresses to try before any address is accepted.
const PREFERRED_SLOTS: u64 = 16;
/// Distance between fixed addresses: both parts of a device.
const SLOT_BYTES: u64 = 2 * LARGEST_PART;
const LARGEST_PART: u64 = 1 << 40;
/// Size of a part's first window, halved until the system grants it.
const FIRST_WINDOW: u64 = if CHEAP_BYTES < LARGEST_PART {
    CHEAP_BYTES
} else {
    LARGEST_PART
};
const SMALLEST_WINDOW: u64 = 1 << 30;

/// The requested location of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// In the part for ordinary memory.
    Ordinary,
    /// At an address that another process can request again.
    Replayable,
    /// At a captured address.
    At(u64),
}

impl Placement {
    /// The placement of an object: replayable if it has a flag of capture and replay, and at the
    /// captured address if there is one.
    pub fn new(is_replayable: bool, captured: Option<u64>) -> Self {
        match captured {
            Some(address) if address != 0 => Self::At(address),
            _ if is_replayable => Self::Replayable,
            _ => Self::Ordinary,
        }
    }
}

/// The address space of a device.
pub struct AddressSpace {
    ordinary: AddressPart,
    /// The part for replayable memory, reserved with the first such memory.
    replayable: Option<AddressPart>,
    /// All mappings, by address and size.
    mapped: Vec<(u64, u64)>,
}

/// A part of an address space. It starts with one window, and gets another one when it is full, up
/// to [`LARGEST_PART`] in all. Where large reservations are cheap the first window has that size.
#[derive(Default)]
struct AddressPart {
    /// The latest is the last.
    windows: Vec<Ranges>,
    /// The start of the first window.
    base: u64,
    /// The end of the latest window.
    end: u64,
    size_bytes: u64,
}

impl AddressPart {
    /// Reserves the first window, at the first free address of `places` or elsewhere; `None` if the
    /// system grants no address space. `size_bytes` is halved until the system grants it.
    fn reserve(
        mut size_bytes: u64,
        places: impl Iterator<Item = u64> + Clone,
        mapped: &mut Vec<(u64, u64)>,
    ) -> Option<Self> {
        while size_bytes >= SMALLEST_WINDOW {
            let place = places
                .clone()
                .find_map(|place| reserve_at(place, size_bytes))
                .or_else(|| reserve(size_bytes, GRANULE));
            if let Some(base) = place {
                let mut part = Self {
                    base,
                    ..Self::default()
                };
                part.add(base, size_bytes, mapped);
                return Some(part);
            }
            size_bytes /= 2;
        }
        None
    }

    fn add(&mut self, address: u64, size_bytes: u64, mapped: &mut Vec<(u64, u64)>) {
        mapped.push((address, size_bytes));
        self.windows.push(Ranges::new(address, size_bytes));
        self.end = address + size_bytes;
        self.size_bytes += size_bytes;
    }

    /// Adds a window that has room for `size_bytes` and doubles the part; false if the part is as
    /// large as parts can be, or the system grants no more.
    fn grow(&mut self, size_bytes: u64, mapped: &mut Vec<(u64, u64)>) -> bool {
        if !(1..LARGEST_PART).contains(&self.size_bytes) || size_bytes > LARGEST_PART {
            return false;
        }
        let size_bytes = self.size_bytes.max(size_bytes.next_power_of_two());
        // Behind the latest window, but not where another part may start.
        let is_apart = self.end + size_bytes <= self.base + LARGEST_PART;
        let place = is_apart.then(|| reserve_at(self.end, size_bytes)).flatten();
        let place = place.or_else(|| reserve(size_bytes, GRANULE));
        if let Some(address) = place {
            self.add(address, size_bytes, mapped);
        }
        place.is_some()
    }

    /// Takes a range of the latest window that has room, or of a new one.
    fn take(&mut self, size_bytes: u64, mapped: &mut Vec<(u64, u64)>) -> Option<Taken> {
        let mut windows = self.windows.iter_mut().rev();
        let taken = windows.find_map(|window| window.take(size_bytes));
        taken.or_else(|| {
            self.grow(size_bytes, mapped)
                .then(|| self.windows.last_mut()?.take(size_bytes))
                .flatten()
        })
    }

    /// The window that overlaps a range.
    fn window(&mut self, addresses: &Range<u64>) -> Option<&mut Ranges> {
        let mut windows = self.windows.iter_mut();
        windows.find(|window| window.overlaps(addresses))
    }
}

impl AddressSpace {
    /// Reserves the part for ordinary memory; `None` if the system grants no address space.
    pub fn reserve() -> Option<Self> {
        let mut mapped = Vec::new();
        Some(Self {
            ordinary: AddressPart::reserve(FIRST_WINDOW, slots(), &mut mapped)?,
            replayable: None,
            mapped,
        })
    }

    /// Allocates a range of zero pages; `None` if there is no room or a requested address is taken.
    pub fn take(&mut self, size_bytes: u64, placement: Placement) -> Option<Taken> {
        match placement {
            Placement::Ordinary => self.ordinary.take(size_bytes, &mut self.mapped),
            Placement::Replayable => {
                let (part, mapped) = self.replayable(None);
                part.take(size_bytes, mapped)
            }
            Placement::At(address) => {
                let end = address.checked_add(size_bytes)?;
                self.take_at(&(address..end))
            }
        }
    }

    fn take_at(&mut self, addresses: &Range<u64>) -> Option<Taken> {
        if !addresses.start.is_multiple_of(GRANULE) {
            return None;
        }
        if let Some(window) = self.ordinary.window(addresses) {
            return window.take_at(addresses);
        }
        let (replayable, _) = self.replayable(Some(addresses.start));
        // A window also has freed ranges that were mapped one by one.
        let mut windows = replayable.windows.iter_mut();
        if let Some(taken) = windows.find_map(|window| window.take_at(addresses)) {
            return Some(taken);
        }
        if replayable.window(addresses).is_some() {
            return None;
        }
        // The capturing device had its address space elsewhere.
        let size_bytes = addresses.end - addresses.start;
        let address = reserve_at(addresses.start, size_bytes)?;
        self.mapped.push((address, size_bytes));
        Some(Taken {
            address,
            was_used: false,
        })
    }

    /// The part for replayable memory, and the list of mappings. The first call reserves the part,
    /// around `captured` if possible.
    fn replayable(&mut self, captured: Option<u64>) -> (&mut AddressPart, &mut Vec<(u64, u64)>) {
        let part = self.replayable.get_or_insert_with(|| {
            let captured = captured.and_then(|address| {
                let slot = address.checked_sub(PREFERRED_BASE)? / SLOT_BYTES;
                (slot < PREFERRED_SLOTS).then_some(PREFERRED_BASE + slot * SLOT_BYTES)
            });
            let places = captured.into_iter().chain(slots());
            let places = places.map(|slot| slot + LARGEST_PART);
            // Without a part, captured addresses are mapped one by one.
            AddressPart::reserve(FIRST_WINDOW, places, &mut self.mapped).unwrap_or_else(|| {
                AddressPart {
                    windows: vec![Ranges::default()],
                    ..AddressPart::default()
                }
            })
        });
        (part, &mut self.mapped)
    }

    /// Frees a range.
    pub fn give_back(&mut self, address: u64, size_bytes: u64) {
        let addresses = address..address + size_bytes;
        if let Some(window) = self.ordinary.window(&addresses) {
            return window.give_back(address, size_bytes);
        }
        let (replayable, _) = self.replayable(None);
        if let Some(window) = replayable.window(&addresses) {
            return window.give_back(address, size_bytes);
        }
        // Mapped one by one.
        if let Some(window) = replayable.windows.first_mut() {
            window.give_back(address, size_bytes);
        }
    }
}

impl Drop for AddressSpace {
    fn drop(&mut self) {
        for &(address, size_bytes) in &self.mapped {
            // SAFETY: the mappings belong to this object, and the device that used them no longer
            // exists.
            unsafe { release(address, size_bytes) };
        }
    }
}

fn slots() -> impl Iterator<Item = u64> + Clone {
    (0..PREFERRED_SLOTS).map(|slot| PREFERRED_BASE + slot * SLOT_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_parts_grow_up_to_their_largest_size() {
        let mut mapped = Vec::new();
        let nowhere = std::iter::empty();
        let mut part = AddressPart::reserve(SMALLEST_WINDOW, nowhere, &mut mapped).unwrap();
        let mut taken = Vec::new();
        // The last one is larger than all windows before it.
        for size_bytes in [SMALLEST_WINDOW / 4; 24]
            .into_iter()
            .chain([SMALLEST_WINDOW * 16])
        {
            let address = part.take(size_bytes, &mut mapped).unwrap().address;
            taken.push((address, address + size_bytes));
            let window = part.window(&(address..address + size_bytes)).unwrap();
            assert!(window.overlaps(&(address + size_bytes - 1..address + size_bytes)));
        }
        taken.sort_unstable();
        assert!(taken.windows(2).all(|pair| pair[0].1 <= pair[1].0));
        assert_eq!(mapped.len(), 5);
        // A freed range stays in its window.
        let (first, end) = taken[0];
        part.window(&(first..end))
            .unwrap()
            .give_back(first, end - first);
        assert_eq!(
            part.window(&(first..end))
                .unwrap()
                .take_at(&(first..end))
                .unwrap()
                .address,
            first
        );
        // The part is smaller than a part can be, and larger afterwards.
        assert!(part.take(LARGEST_PART, &mut mapped).is_some());
        assert!(part.take(LARGEST_PART, &mut mapped).is_none());
        for (address, size_bytes) in mapped {
            // SAFETY: the test's own mappings, which nothing else uses.
            unsafe { release(address, size_bytes) };
        }
    }

    #[test]
    fn captured_addresses_stay_free_for_them() {
        let mut space = AddressSpace::reserve().unwrap();
        let take = |space: &mut AddressSpace, size_bytes, placement| {
            space.take(size_bytes, placement).map(|taken| taken.address)
        };
        let sizes = [GRANULE, 5 * GRANULE, GRANULE, 100 * GRANULE];
        let captured = sizes.map(|size_bytes| {
            let address = take(&mut space, size_bytes, Placement::Replayable).unwrap();
            (address, size_bytes)
        });
        for (address, size_bytes) in captured {
            space.give_back(address, size_bytes);
        }
        let overlaps = |address: u64, size_bytes: u64| {
            let is_common = |(start, length): (u64, u64)| {
                address < start + length && start < address + size_bytes
            };
            captured.into_iter().any(is_common)
        };
        // Ordinary memory, much of it, and freed in between.
        for size_bytes in sizes.into_iter().cycle().take(1000) {
            let ordinary = take(&mut space, size_bytes, Placement::Ordinary).unwrap();
            assert!(!overlaps(ordinary, size_bytes));
            if size_bytes > GRANULE {
                space.give_back(ordinary, size_bytes);
            }
        }
        for (address, size_bytes) in captured.into_iter().rev() {
            let placement = Placement::At(address);
            assert_eq!(take(&mut space, size_bytes, placement), Some(address));
            assert_eq!(take(&mut space, size_bytes, placement), None);
        }
    }
}
