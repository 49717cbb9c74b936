//! Device memory. Each device reserves a window of address space; a device address is the host
//! address. Pages are committed when first touched, and ranges that were freed stay mapped to zero
//! pages, so that a stale reference reads zeros until they are used again.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use ash::vk;
use parking_lot::Mutex;

use super::address_space::{AddressSpace, GRANULE, Placement};
use super::live_memory::LiveMemory;
use super::ranges::Taken;
use crate::VkResult;
use crate::capabilities::limits::max_allocations;
use crate::os::address_space::{commit, discard, is_mapped, replace_by_zeros};
use crate::os::handle::{Handle, Sharing};
use crate::os::section::{Refused, Section};

/// Bytes in use by all devices of the process, which share the machine.
static USED_BYTES: AtomicU64 = AtomicU64::new(0);

/// Bytes of the heap in use in this process.
pub fn used_bytes() -> u64 {
    USED_BYTES.load(Ordering::Relaxed)
}

/// Allocations of this process with mappings of their own.
static MAPPED: AtomicU32 = AtomicU32::new(0);

/// One unit of a bounded count, released when dropped.
struct AllocationSlot<'a>(Option<&'a AtomicU32>);

impl<'a> AllocationSlot<'a> {
    fn take(count: &'a AtomicU32) -> VkResult<Self> {
        count
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |count| {
                (count < max_allocations()).then_some(count + 1)
            })
            .map(|_| Self(Some(count)))
            .map_err(|_| vk::Result::ERROR_TOO_MANY_OBJECTS)
    }

    /// Forgets the guard; the caller must release it.
    fn keep(mut self) {
        self.0 = None;
    }
}

impl Drop for AllocationSlot<'_> {
    fn drop(&mut self) {
        if let Some(count) = self.0 {
            count.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

/// A device's address space and its used ranges.
pub struct AddressWindow {
    /// The budget of all allocations together.
    budget_bytes: u64,
    /// Bytes in use, counted with those of other windows.
    used_bytes: &'static AtomicU64,
    /// The number of allocations.
    allocations: AtomicU32,
    space: Mutex<AddressSpace>,
    /// Taken ranges and imported host memory.
    pub live: Arc<LiveMemory>,
}

impl AddressWindow {
    /// Reserves a window. `budget_bytes` is the heap's size.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if the system gives no address space.
    pub fn reserve(budget_bytes: u64) -> VkResult<Arc<Self>> {
        Self::reserve_counted(budget_bytes, &USED_BYTES)
    }

    /// As [`Self::reserve`], with the budget shared by the windows that count in `used_bytes`.
    fn reserve_counted(budget_bytes: u64, used_bytes: &'static AtomicU64) -> VkResult<Arc<Self>> {
        let space = AddressSpace::reserve().ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        Ok(Arc::new(Self {
            budget_bytes,
            used_bytes,
            allocations: AtomicU32::new(0),
            space: Mutex::new(space),
            live: Arc::default(),
        }))
    }

    /// Takes a range of zero pages. A section brings its own memory.
    fn take(&self, size_bytes: u64, placement: Placement, has_section: bool) -> VkResult<u64> {
        self.used_bytes
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |used| {
                used.checked_add(size_bytes)
                    .filter(|&sum| sum <= self.budget_bytes)
            })
            .map_err(|_| vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
        let taken = self.take_range(size_bytes, placement).inspect_err(|_| {
            self.used_bytes.fetch_sub(size_bytes, Ordering::Relaxed);
        });
        let address = taken?;
        if !has_section && !commit(address, size_bytes) {
            self.give_back(address, size_bytes);
            return Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        }
        Ok(address)
    }

    /// Takes a range that does not count as memory.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_DEVICE_MEMORY`, `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS`.
    pub fn take_range(&self, size_bytes: u64, placement: Placement) -> VkResult<u64> {
        let taken = self.space.lock().take(size_bytes, placement);
        let Taken { address, was_used } = taken.ok_or(match placement {
            Placement::At(_) => vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS,
            _ => vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
        })?;
        if was_used {
            // Writes after free are discarded. SAFETY: the range is inside the window, and no other
            // allocation has it. Zero pages have replaced its former mappings.
            unsafe { discard(address, size_bytes) };
        }
        self.live.add(address, size_bytes);
        Ok(address)
    }

    /// Frees a range. Its pages read as zeros from now on.
    fn give_back(&self, address: u64, size_bytes: u64) {
        self.give_back_range(address, size_bytes);
        self.used_bytes.fetch_sub(size_bytes, Ordering::Relaxed);
    }

    /// Frees a range of [`Self::take_range`].
    pub fn give_back_range(&self, address: u64, size_bytes: u64) {
        self.live.remove(address, size_bytes);
        // SAFETY: the range is inside the window, and its owner no longer exists.
        unsafe { replace_by_zeros(address, size_bytes) };
        self.space.lock().give_back(address, size_bytes);
    }
}

/// An allocation.
pub struct DeviceMemory {
    pub address: u64,
    /// The requested size.
    pub size_bytes: u64,
    backing: Backing,
}

enum Backing {
    /// A range of the window. Memory for sparse binding, export or import is a section mapped
    /// there.
    Window {
        window: Arc<AddressWindow>,
        mapped_bytes: u64,
        section: Option<Section>,
    },
    /// The application's own memory (`VkImportMemoryHostPointerInfoEXT`).
    Host { window: Arc<AddressWindow> },
}

/// The source of an allocation's bytes.
pub enum Source {
    Fresh,
    /// New memory to which sparse resources can be bound.
    Shared,
    /// New memory that can be exported.
    Exportable(Sharing),
    /// A section that another allocation exported.
    Exported(Handle),
    HostPointer(*mut u8),
}

impl DeviceMemory {
    /// The address of a resource of this size at an offset.
    ///
    /// # Errors
    /// `VK_ERROR_UNKNOWN` if the resource would reach past the end of the memory.
    pub fn place(&self, offset_bytes: u64, size_bytes: u64) -> VkResult<u64> {
        let end = offset_bytes.checked_add(size_bytes);
        if end.is_none_or(|end| end > self.size_bytes) {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        Ok(self.address + offset_bytes)
    }

    /// Allocates.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_DEVICE_MEMORY` past the heap's budget; `VK_ERROR_INVALID_EXTERNAL_HANDLE`
    /// for a section that is too short, can shrink or cannot be mapped, for a name that is taken,
    /// and for a host pointer to unmapped memory; `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if a
    /// requested address is taken; `VK_ERROR_TOO_MANY_OBJECTS` past [`max_allocations`].
    pub fn allocate(
        window: &Arc<AddressWindow>,
        size_bytes: u64,
        source: Source,
        placement: Placement,
    ) -> VkResult<Self> {
        let section = match source {
            Source::HostPointer(pointer) => {
                if !is_mapped(pointer as u64, size_bytes) {
                    return Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE);
                }
                AllocationSlot::take(&window.allocations)?.keep();
                window.live.add(pointer as u64, size_bytes);
                return Ok(Self {
                    address: pointer as u64,
                    size_bytes,
                    backing: Backing::Host {
                        window: Arc::clone(window),
                    },
                });
            }
            Source::Fresh => None,
            Source::Shared => Some(Section::private()),
            Source::Exportable(sharing) => {
                let section = Section::exportable(size_bytes, &sharing);
                Some(section.map_err(|refused| match refused {
                    Refused::Handles => vk::Result::ERROR_TOO_MANY_OBJECTS,
                    Refused::Memory => vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
                    Refused::Name => vk::Result::ERROR_INVALID_EXTERNAL_HANDLE,
                })?)
            }
            Source::Exported(handle) => {
                let section = Section::import(handle, size_bytes);
                Some(section.ok_or(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE)?)
            }
        };
        let mapped_bytes = size_bytes
            .max(1)
            .checked_next_multiple_of(GRANULE)
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
        let place = AllocationSlot::take(&window.allocations)?;
        let mapping = (section.as_ref()).map(|_| AllocationSlot::take(&MAPPED));
        let mapping = mapping.transpose()?;
        let address = window.take(mapped_bytes, placement, section.is_some())?;
        place.keep();
        if let Some(mapping) = mapping {
            mapping.keep();
        }
        let memory = Self {
            address,
            size_bytes,
            backing: Backing::Window {
                window: Arc::clone(window),
                mapped_bytes,
                section,
            },
        };
        memory.map_section()?;
        Ok(memory)
    }

    /// The section that is mapped at the range.
    fn section(&self) -> Option<&Section> {
        match &self.backing {
            Backing::Window { section, .. } => section.as_ref(),
            Backing::Host { .. } => None,
        }
    }

    fn map_section(&self) -> VkResult {
        let Some(section) = self.section() else {
            return Ok(());
        };
        // SAFETY: the range has just been taken from the window, so nothing else uses it.
        let is_mapped = unsafe { section.map(self.address, self.shared_bytes()) };
        match section.handle() {
            _ if is_mapped => Ok(()),
            Some(_) => Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE),
            None => Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY),
        }
    }

    /// The size to which sparse resources can be bound.
    pub fn shared_bytes(&self) -> u64 {
        match &self.backing {
            Backing::Window {
                section: Some(section),
                mapped_bytes,
                ..
            } => match section.handle() {
                // Another process may have created the section, which may be shorter than the
                // request.
                Some(_) => self.size_bytes,
                None => *mapped_bytes,
            },
            _ => 0,
        }
    }

    /// Maps a part of the memory at another address and replaces the pages there; false if the
    /// system refuses.
    ///
    /// # Safety
    /// The part is within [`Self::shared_bytes`]. The destination is a part of a reservation, and
    /// no reference to it is alive.
    pub unsafe fn alias(&self, offset_bytes: u64, size_bytes: u64, address: u64) -> bool {
        // SAFETY: the caller passes a part of a reservation without references to it, and the
        // section is mapped at the memory's range.
        let alias = |section: &Section| unsafe {
            section.alias(self.address, offset_bytes, size_bytes, address)
        };
        self.section().is_some_and(alias)
    }

    /// Creates a new handle of exportable memory.
    ///
    /// # Errors
    /// `VK_ERROR_INVALID_EXTERNAL_HANDLE` for other memory; `VK_ERROR_TOO_MANY_OBJECTS` if the
    /// process cannot have more handles.
    pub fn export(&self) -> VkResult<Handle> {
        let section = self.section().filter(|section| section.handle().is_some());
        let section = section.ok_or(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE)?;
        section.export().ok_or(vk::Result::ERROR_TOO_MANY_OBJECTS)
    }
}

impl Drop for DeviceMemory {
    fn drop(&mut self) {
        let window = match &self.backing {
            Backing::Window {
                window,
                mapped_bytes,
                section,
            } => {
                window.give_back(self.address, *mapped_bytes);
                if section.is_some() {
                    MAPPED.fetch_sub(1, Ordering::Relaxed);
                }
                window
            }
            Backing::Host { window } => {
                window.live.remove(self.address, self.size_bytes);
                window
            }
        };
        window.allocations.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(address: u64, value: u64) {
        // SAFETY: tests write to memory that they have allocated.
        unsafe { *(address as *mut u64) = value };
    }

    fn read(address: u64) -> u64 {
        // SAFETY: windows stay readable.
        unsafe { *(address as *const u64) }
    }

    fn allocate(window: &Arc<AddressWindow>, size: u64) -> VkResult<DeviceMemory> {
        DeviceMemory::allocate(window, size, Source::Fresh, Placement::Ordinary)
    }

    #[test]
    fn freed_memory_reads_zero_and_the_budget_holds() {
        // A count of its own: other tests allocate at the same time.
        static USED: AtomicU64 = AtomicU64::new(0);
        let window = AddressWindow::reserve_counted(1 << 20, &USED).ok().unwrap();
        let memory = allocate(&window, 1 << 19).ok().unwrap();
        let address = memory.address;
        write(address, 7);
        assert!(allocate(&window, 1 << 20).is_err());
        assert!(allocate(&window, u64::MAX).is_err());
        drop(memory);
        assert_eq!(read(address), 0);
        assert_eq!(USED.load(Ordering::Relaxed), 0);
        assert!(allocate(&window, 1 << 20).is_ok());
    }

    #[test]
    fn freed_ranges_are_used_again_and_read_zeros() {
        let window = AddressWindow::reserve(1 << 40).ok().unwrap();
        let mut addresses = std::collections::HashSet::new();
        for _ in 0..100_000 {
            let memory = allocate(&window, 1).ok().unwrap();
            assert_eq!(read(memory.address), 0);
            write(memory.address, 7);
            let address = memory.address;
            addresses.insert(address);
            drop(memory);
            // Breaks the rules but is harmless: the range has no owner.
            write(address, 8);
        }
        assert!(addresses.len() < 20_000);
    }

    #[test]
    fn there_are_as_many_allocations_as_is_said() {
        let window = AddressWindow::reserve(1 << 40).ok().unwrap();
        let all: Vec<_> = (0..max_allocations())
            .map(|_| allocate(&window, 1).ok().unwrap())
            .collect();
        let more = allocate(&window, 1).err();
        assert_eq!(more, Some(vk::Result::ERROR_TOO_MANY_OBJECTS));
        drop(all);
        assert!(allocate(&window, 1).is_ok());
    }

    #[test]
    fn host_pointers_lead_somewhere() {
        let window = AddressWindow::reserve(1 << 30).ok().unwrap();
        let own = AddressWindow::reserve(1 << 30).ok().unwrap();
        let import = |pointer: u64, bytes| {
            DeviceMemory::allocate(
                &window,
                bytes,
                Source::HostPointer(pointer as *mut u8),
                Placement::Ordinary,
            )
        };
        // The first allocation is where the window starts.
        let base = allocate(&own, 1).ok().unwrap().address;
        assert!(import(base, 1 << 20).is_ok());
        for (pointer, bytes) in [
            (base, u64::MAX),
            (0, 4096),
            (1 << 46, 4096),
            (base, 1 << 46),
        ] {
            let refused = import(pointer, bytes).err();
            assert_eq!(refused, Some(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE));
        }
    }

    #[test]
    fn an_address_can_be_had_again() {
        let window = AddressWindow::reserve(1 << 30).ok().unwrap();
        let first = allocate(&window, 1).ok().unwrap();
        let again =
            |address| DeviceMemory::allocate(&window, 1, Source::Fresh, Placement::At(address));
        assert!(again(first.address).is_err());
        let address = first.address + 8 * GRANULE;
        drop(first);
        let second = again(address).ok().unwrap();
        assert_eq!(second.address, address);
        assert!(again(address).is_err());
    }

    #[test]
    fn an_address_of_another_window_can_be_had_again() {
        // Other tests' threads may take the addresses as soon as they are given back: then it is
        // tried again.
        for _ in 0..20 {
            let [first, second] = [0; 2].map(|_| AddressWindow::reserve(1 << 30).ok().unwrap());
            let address = allocate(&second, 1).ok().unwrap().address;
            let placement = Placement::At(address);
            let again = || DeviceMemory::allocate(&first, 1, Source::Fresh, placement);
            assert!(again().is_err());
            drop(second);
            let Ok(memory) = again() else { continue };
            assert_eq!(memory.address, address);
            assert!(again().is_err());
            drop(memory);
            let Ok(memory) = again() else { continue };
            assert_eq!(memory.address, address);
            return;
        }
        panic!("the addresses were never free");
    }

    #[test]
    fn exported_memory_is_shared() {
        let window = AddressWindow::reserve(1 << 30).ok().unwrap();
        let allocate =
            |size, source| DeviceMemory::allocate(&window, size, source, Placement::Ordinary);
        let a = allocate(4096, Source::Exportable(Sharing::default()))
            .ok()
            .unwrap();
        let handle = Source::Exported(a.export().ok().unwrap());
        let b = allocate(4096, handle).ok().unwrap();
        write(a.address, 99);
        assert_eq!(read(b.address), 99);
        let too_long = Source::Exported(a.export().ok().unwrap());
        assert!(allocate(1 << 20, too_long).is_err());
    }
}
