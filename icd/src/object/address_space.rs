//! A device's address space, in two parts: one for ordinary memory, one for memory whose addresses
//! can be captured and replayed.
//!
//! A replay of a capture also allocates memory of its own, such as a swapchain's images. In one
//! part with captured memory, that memory could take addresses that are asked for later (the note
//! to `VkBufferOpaqueCaptureAddressCreateInfo` asks drivers to keep them apart).

use std::ops::Range;

use super::ranges::{Ranges, Taken};
use crate::os::address_space::{release, reserve, reserve_at};

/// Allocations are multiples of this, and start at multiples of it (at least a page;
/// `VkMemoryRequirements::alignment` is smaller).
pub const GRANULE: u64 = 64 << 10;

/// Where the first device's address space is tried, so that captured addresses can be given again.
const PREFERRED_BASE: u64 = 0x1000_0000_0000;
/// Fixed places that are tried before any place will do.
const PREFERRED_SLOTS: u64 = 16;
/// Addresses from one fixed place to the next: both parts of a device.
const SLOT_BYTES: u64 = 2 * LARGEST_PART;
/// Size of a part; halved while the system refuses.
const LARGEST_PART: u64 = 1 << 40;
const SMALLEST_PART: u64 = 1 << 30;

/// Where memory shall lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// With ordinary memory.
    Ordinary,
    /// Where another process can have the same address for it.
    Replayable,
    /// At an address that was captured.
    At(u64),
}

impl Placement {
    /// That of an object: replayable if it has a flag of capture and replay, and at the address
    /// that was captured, if there is one.
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
    ordinary: Ranges,
    /// Reserved with the first memory that is captured or replayed.
    replayable: Option<Ranges>,
    /// All mappings, by address and size.
    mapped: Vec<(u64, u64)>,
}

impl AddressSpace {
    /// Reserves the part for ordinary memory; `None` if the system gives no address space.
    pub fn reserve() -> Option<Self> {
        let (base, size_bytes) = reserve_part(slots())?;
        Some(Self {
            ordinary: Ranges::new(base, size_bytes),
            replayable: None,
            mapped: vec![(base, size_bytes)],
        })
    }

    /// Takes a range of zero pages; `None` if there is none, or if an address that is asked for is
    /// taken.
    pub fn take(&mut self, size_bytes: u64, placement: Placement) -> Option<Taken> {
        match placement {
            Placement::Ordinary => self.ordinary.take(size_bytes),
            Placement::Replayable => self.replayable(None).take(size_bytes),
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
        if self.ordinary.overlaps(addresses) {
            return self.ordinary.take_at(addresses);
        }
        let replayable = self.replayable(Some(addresses.start));
        if let Some(taken) = replayable.take_at(addresses) {
            return Some(taken);
        }
        if replayable.overlaps(addresses) {
            return None;
        }
        // The device that captured it had its address space elsewhere.
        let size_bytes = addresses.end - addresses.start;
        let address = reserve_at(addresses.start, size_bytes)?;
        self.mapped.push((address, size_bytes));
        Some(Taken {
            address,
            was_used: false,
        })
    }

    /// The part for replayable memory. The first call reserves it, where `captured` lies if it can
    /// be there.
    fn replayable(&mut self, captured: Option<u64>) -> &mut Ranges {
        self.replayable.get_or_insert_with(|| {
            let captured = captured.and_then(|address| {
                let slot = address.checked_sub(PREFERRED_BASE)? / SLOT_BYTES;
                (slot < PREFERRED_SLOTS).then_some(PREFERRED_BASE + slot * SLOT_BYTES)
            });
            let places = captured.into_iter().chain(slots());
            match reserve_part(places.map(|slot| slot + LARGEST_PART)) {
                Some((base, size_bytes)) => {
                    self.mapped.push((base, size_bytes));
                    Ranges::new(base, size_bytes)
                }
                // Captured addresses can still be mapped one by one.
                None => Ranges::default(),
            }
        })
    }

    /// Gives back a range that was taken.
    pub fn give_back(&mut self, address: u64, size_bytes: u64) {
        if self.ordinary.overlaps(&(address..address + size_bytes)) {
            self.ordinary.give_back(address, size_bytes);
        } else {
            self.replayable(None).give_back(address, size_bytes);
        }
    }
}

impl Drop for AddressSpace {
    fn drop(&mut self) {
        for &(address, size_bytes) in &self.mapped {
            // SAFETY: these are this object's own mappings, and the device that used them is gone.
            unsafe { release(address, size_bytes) };
        }
    }
}

fn slots() -> impl Iterator<Item = u64> + Clone {
    (0..PREFERRED_SLOTS).map(|slot| PREFERRED_BASE + slot * SLOT_BYTES)
}

/// Reserves a part of an address space, at the first of `places` that is free, or elsewhere: its
/// address and its size.
fn reserve_part(places: impl Iterator<Item = u64> + Clone) -> Option<(u64, u64)> {
    let mut size_bytes = LARGEST_PART;
    while size_bytes >= SMALLEST_PART {
        let place = places
            .clone()
            .find_map(|place| reserve_at(place, size_bytes))
            .or_else(|| reserve(size_bytes, GRANULE));
        if let Some(base) = place {
            return Some((base, size_bytes));
        }
        size_bytes /= 2;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

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
