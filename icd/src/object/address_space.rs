//! A device's address space, in two parts: one for ordinary memory, one for memory whose addresses
//! can be captured and replayed.
//!
//! A replay of a capture also allocates ordinary memory, such as a swapchain's images. In the same
//! part, that memory could take addresses that the replay requests later (the note to
//! `VkBufferOpaqueCaptureAddressCreateInfo` asks drivers to keep them apart).

use std::ops::Range;

use super::ranges::{Ranges, Taken};
use crate::os::address_space::{release, reserve, reserve_at};

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
/// Size of a part, halved until the system grants it.
const LARGEST_PART: u64 = 1 << 40;
const SMALLEST_PART: u64 = 1 << 30;

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
    ordinary: Ranges,
    /// The part for replayable memory, reserved with the first such memory.
    replayable: Option<Ranges>,
    /// All mappings, by address and size.
    mapped: Vec<(u64, u64)>,
}

impl AddressSpace {
    /// Reserves the part for ordinary memory; `None` if the system grants no address space.
    pub fn reserve() -> Option<Self> {
        let (base, size_bytes) = reserve_part(slots())?;
        Some(Self {
            ordinary: Ranges::new(base, size_bytes),
            replayable: None,
            mapped: vec![(base, size_bytes)],
        })
    }

    /// Allocates a range of zero pages; `None` if there is no room or a requested address is taken.
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
        // The capturing device had its address space elsewhere.
        let size_bytes = addresses.end - addresses.start;
        let address = reserve_at(addresses.start, size_bytes)?;
        self.mapped.push((address, size_bytes));
        Some(Taken {
            address,
            was_used: false,
        })
    }

    /// The part for replayable memory. The first call reserves it, around `captured` if possible.
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
                // Without a part, captured addresses are mapped one by one.
                None => Ranges::default(),
            }
        })
    }

    /// Frees a range.
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
            // SAFETY: the mappings belong to this object, and the device that used them no longer
            // exists.
            unsafe { release(address, size_bytes) };
        }
    }
}

fn slots() -> impl Iterator<Item = u64> + Clone {
    (0..PREFERRED_SLOTS).map(|slot| PREFERRED_BASE + slot * SLOT_BYTES)
}

/// Reserves a part of an address space, at the first free address of `places` or elsewhere. Returns
/// its address and size.
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
