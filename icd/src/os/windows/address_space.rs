//! Address space: reserved ranges of pages, and their mappings.
//!
//! A reservation is a sequence of pieces: placeholders, memory, and views of sections. A
//! placeholder takes no memory, and an access to it faults. An exception handler then replaces it
//! with zeroed memory and resumes the access, so that every reserved page reads as zeros.
//!
//! The system cannot replace a piece in one step. The table of pieces stays locked during all
//! steps, and the handler takes the same lock, so that a concurrent fault waits for the new pages.
//! Only system calls fail on pages without memory.

use std::collections::BTreeMap;
use std::sync::{Arc, Once};

use parking_lot::Mutex;
use windows_sys::Win32::Foundation::EXCEPTION_ACCESS_VIOLATION;
use windows_sys::Win32::System::Diagnostics::Debug::{
    AddVectoredExceptionHandler, EXCEPTION_POINTERS,
};
use windows_sys::Win32::System::Memory::{
    MEM_COMMIT, MEMORY_BASIC_INFORMATION, PAGE_GUARD, PAGE_NOACCESS, VirtualQuery,
};

use super::handle::Handle;
use super::library::keep_loaded;
use super::placeholder::{self, Functions};

/// Sections are mapped at multiples of this ("allocation granularity").
const GRANULE: u64 = 64 << 10;

/// The system's page size, which is the alignment of mapped sections.
pub fn page_bytes() -> u64 {
    GRANULE
}

/// The number of mappings that the process is expected to have: only memory limits it here, so it
/// is the usual limit of Linux.
pub fn max_mappings() -> u32 {
    1 << 16
}

/// The content of a piece.
#[derive(Clone, Debug)]
enum Content {
    Placeholder,
    Memory,
    /// A view of a section from an offset on.
    View(Arc<Handle>, u64),
}

#[derive(Clone, Debug)]
struct Piece {
    size_bytes: u64,
    content: Content,
}

/// The pieces of all reservations of the process, by address.
struct Pieces(BTreeMap<u64, Piece>);

static PIECES: Mutex<Pieces> = Mutex::new(Pieces(BTreeMap::new()));

impl Pieces {
    /// The piece that contains an address.
    fn at(&self, address: u64) -> Option<(u64, &Piece)> {
        let (&start, piece) = self.0.range(..=address).next_back()?;
        (address - start < piece.size_bytes).then_some((start, piece))
    }

    fn put(&mut self, address: u64, size_bytes: u64, content: Content) {
        let piece = Piece {
            size_bytes,
            content,
        };
        self.0.insert(address, piece);
    }

    /// Replaces a range with placeholders; false if the system refuses.
    ///
    /// # Safety
    /// The range is a part of a reservation, and no reference to it is alive.
    unsafe fn clear(&mut self, functions: Functions, start: u64, end: u64) -> bool {
        let mut at = start;
        while at < end {
            let Some((first, piece)) = self.at(at) else {
                return false;
            };
            let piece = piece.clone();
            let last = first + piece.size_bytes;
            let stop = last.min(end);
            // SAFETY: the caller guarantees that the range is a part of a reservation, and no
            // reference to it is alive; parts outside of the range keep what they have.
            let is_clear = unsafe {
                match &piece.content {
                    Content::Placeholder if (first, last) == (at, stop) => true,
                    Content::Placeholder | Content::Memory => placeholder::separate(at, stop - at),
                    Content::View(..) => functions.unmap(first),
                }
            };
            if !is_clear {
                return false;
            }
            let around = [(first, at), (stop, last)].map(|(from, to)| (from, to.max(from) - from));
            if let Content::View(section, offset) = &piece.content {
                self.put(first, piece.size_bytes, Content::Placeholder);
                for (from, size_bytes) in around.into_iter().filter(|(_, bytes)| *bytes != 0) {
                    let offset = offset + (from - first);
                    // SAFETY: the view is mapped again, in parts.
                    if !unsafe { self.view(functions, from, size_bytes, section, offset) } {
                        return false;
                    }
                }
                // The other parts have split the placeholder.
                self.put(at, stop - at, Content::Placeholder);
            } else {
                for (from, size_bytes) in around.into_iter().filter(|(_, bytes)| *bytes != 0) {
                    self.put(from, size_bytes, piece.content.clone());
                }
                self.put(at, stop - at, Content::Placeholder);
            }
            at = stop;
        }
        true
    }

    /// Merges the placeholders from `start` to `end`; false if the system refuses.
    fn coalesce(&mut self, start: u64, end: u64) -> bool {
        let first = self.0.get(&start);
        if first.is_some_and(|piece| piece.size_bytes == end - start) {
            return true;
        }
        // SAFETY: the process's own placeholders, as the table says.
        if !unsafe { placeholder::coalesce(start, end - start) } {
            return false;
        }
        let merged: Vec<u64> = self.0.range(start..end).map(|(&start, _)| start).collect();
        merged.iter().for_each(|start| drop(self.0.remove(start)));
        self.put(start, end - start, Content::Placeholder);
        true
    }

    /// The start and end of a range of placeholders with the placeholders on both sides.
    /// Placeholders of other reservations must not be merged.
    fn with_neighbours(&self, start: u64, end: u64, whole: (u64, u64)) -> (u64, u64) {
        let is_free = |piece: &Piece| matches!(piece.content, Content::Placeholder);
        let before = (start > whole.0).then(|| self.at(start - 1)).flatten();
        let behind = (end < whole.1).then(|| self.at(end)).flatten();
        (
            before
                .filter(|(_, piece)| is_free(piece))
                .map_or(start, |(first, _)| first),
            behind
                .filter(|(_, piece)| is_free(piece))
                .map_or(end, |(first, piece)| first + piece.size_bytes),
        )
    }

    /// Splits a part from a placeholder; false if the system refuses.
    fn separate(&mut self, start: u64, end: u64) -> bool {
        let Some((first, piece)) = self.at(start) else {
            return false;
        };
        let last = first + piece.size_bytes;
        if (first, last) == (start, end) {
            return true;
        }
        // SAFETY: the process's own placeholder, as the table says.
        if !unsafe { placeholder::separate(start, end - start) } {
            return false;
        }
        for (from, to) in [(first, start), (start, end), (end, last)] {
            if from < to {
                self.put(from, to - from, Content::Placeholder);
            }
        }
        true
    }

    /// Replaces a part of a placeholder with zeroed memory; false if there is too little.
    fn commit(&mut self, functions: Functions, start: u64, end: u64) -> bool {
        // SAFETY: the process's own placeholder, as the table says.
        let is_there = self.separate(start, end) && unsafe { functions.commit(start, end - start) };
        if is_there {
            self.put(start, end - start, Content::Memory);
        }
        is_there
    }

    /// Replaces a part of a placeholder with a view; false if the system refuses.
    ///
    /// # Safety
    /// The section is large enough.
    unsafe fn view(
        &mut self,
        functions: Functions,
        start: u64,
        size_bytes: u64,
        section: &Arc<Handle>,
        offset: u64,
    ) -> bool {
        // SAFETY: the process's own placeholder, as the table says; the caller guarantees that the
        // section is large enough.
        let is_there = self.separate(start, start + size_bytes)
            && unsafe { functions.map(start, size_bytes, section.raw(), offset) };
        if is_there {
            self.put(
                start,
                size_bytes,
                Content::View(Arc::clone(section), offset),
            );
        }
        is_there
    }
}

/// Reservations by address, and their sizes.
static RESERVATIONS: Mutex<BTreeMap<u64, u64>> = Mutex::new(BTreeMap::new());

/// The start and end of the reservation that contains an address.
fn reservation(address: u64) -> Option<(u64, u64)> {
    let reservations = RESERVATIONS.lock();
    let (&start, &size_bytes) = reservations.range(..=address).next_back()?;
    (address - start < size_bytes).then_some((start, start + size_bytes))
}

fn round_up(bytes: u64) -> u64 {
    bytes.next_multiple_of(GRANULE)
}

/// The size up to which a reservation costs little time and memory. Wine keeps a byte for each
/// reserved page of 4 KB, and writes all of them at the reservation and at the release: 4 MB here,
/// 256 MB for a terabyte. On Windows any size is cheap.
pub const CHEAP_BYTES: u64 = 16 << 30;

/// Reserves address space aligned to `alignment_bytes`; `None` if the system has none left.
pub fn reserve(size_bytes: u64, alignment_bytes: u64) -> Option<u64> {
    reserve_by(size_bytes, |functions, size_bytes| {
        functions.reserve(0, size_bytes, alignment_bytes.max(GRANULE))
    })
}

/// Reserves the address space at `address`; `None` if a part of it is in use.
pub fn reserve_at(address: u64, size_bytes: u64) -> Option<u64> {
    reserve_by(size_bytes, |functions, size_bytes| {
        functions.reserve(address, size_bytes, 0)
    })
}

fn reserve_by(size_bytes: u64, reserve: impl FnOnce(Functions, u64) -> Option<u64>) -> Option<u64> {
    let functions = Functions::of_system()?;
    handle_faults();
    let size_bytes = size_bytes.checked_next_multiple_of(GRANULE)?;
    let address = reserve(functions, size_bytes)?;
    PIECES.lock().put(address, size_bytes, Content::Placeholder);
    RESERVATIONS.lock().insert(address, size_bytes);
    Some(address)
}

/// Releases a whole reservation with all its mappings.
///
/// # Safety
/// The caller owns the reservation, and nothing accesses it any more.
pub unsafe fn release(address: u64, size_bytes: u64) {
    let end = address + round_up(size_bytes);
    let Some(functions) = Functions::of_system() else {
        return;
    };
    let pieces = &mut *PIECES.lock();
    // SAFETY: the caller owns the reservation, and guarantees that nothing accesses it any more.
    let is_clear = unsafe { pieces.clear(functions, address, end) };
    if is_clear && pieces.coalesce(address, end) {
        // SAFETY: a single placeholder now.
        unsafe { placeholder::release(address) };
        pieces.0.remove(&address);
        RESERVATIONS.lock().remove(&address);
    }
}

/// Commits memory to a part of a reservation; false if there is too little.
#[must_use]
pub fn commit(address: u64, size_bytes: u64) -> bool {
    let Some(functions) = Functions::of_system() else {
        return false;
    };
    let end = address + round_up(size_bytes);
    let pieces = &mut *PIECES.lock();
    let mut at = address;
    while at < end {
        let Some((first, piece)) = pieces.at(at) else {
            return false;
        };
        let stop = (first + piece.size_bytes).min(end);
        let is_placeholder = matches!(piece.content, Content::Placeholder);
        if is_placeholder && !pieces.commit(functions, at, stop) {
            return false;
        }
        at = stop;
    }
    true
}

/// Discards the contents of a part of a reservation. It reads as zeros afterwards, and the system
/// gets its memory back.
///
/// # Safety
/// The part is the caller's, no section is mapped there, and no reference to it is alive.
pub unsafe fn discard(address: u64, size_bytes: u64) {
    // SAFETY: the caller guarantees that the part is the caller's, no section is mapped there, and
    // no reference to it is alive.
    unsafe { replace_by_zeros(address, size_bytes) };
}

/// Replaces the mappings in a part of a reservation with pages of zeros; false if the system
/// refuses.
///
/// # Safety
/// The part is the caller's, and no reference to it is alive.
pub unsafe fn replace_by_zeros(address: u64, size_bytes: u64) -> bool {
    let end = address + round_up(size_bytes);
    let (Some(functions), Some(whole)) = (Functions::of_system(), reservation(address)) else {
        return false;
    };
    let pieces = &mut *PIECES.lock();
    // SAFETY: the caller guarantees that the part is the caller's, and no reference to it is alive.
    if !unsafe { pieces.clear(functions, address, end) } {
        return false;
    }
    let (start, end) = pieces.with_neighbours(address, end, whole);
    pieces.coalesce(start, end)
}

/// Maps a section in place of the pages at an address; false if the system refuses.
///
/// # Safety
/// The range is a part of a reservation of the caller's, no reference to it is alive, and the
/// section is as large from the offset on.
pub(super) unsafe fn replace_by_view(
    address: u64,
    size_bytes: u64,
    section: &Arc<Handle>,
    offset: u64,
) -> bool {
    let size_bytes = round_up(size_bytes);
    let Some(functions) = Functions::of_system() else {
        return false;
    };
    let pieces = &mut *PIECES.lock();
    // SAFETY: the caller guarantees that the range is a part of a reservation of the caller's, no
    // reference to it is alive, and the section is as large from the offset on.
    unsafe {
        pieces.clear(functions, address, address + size_bytes)
            && pieces.coalesce(address, address + size_bytes)
            && pieces.view(functions, address, size_bytes, section, offset)
    }
}

/// Whether all pages of a range are mapped, by any library of the process. Accesses no memory, so
/// any address is allowed.
pub fn is_mapped(address: u64, size_bytes: u64) -> bool {
    let Some(end) = address.checked_add(size_bytes) else {
        return false;
    };
    let mut at = address;
    while at < end {
        if let Some((_, end)) = reservation(at) {
            at = end;
            continue;
        }
        // SAFETY: plain data, which the call fills. It looks at mappings, not at memory.
        let (found, pages) = unsafe {
            let mut pages: MEMORY_BASIC_INFORMATION = std::mem::zeroed();
            let size_bytes = size_of::<MEMORY_BASIC_INFORMATION>();
            let found = VirtualQuery(at as *const _, &raw mut pages, size_bytes);
            (found != 0, pages)
        };
        let is_closed = pages.Protect & (PAGE_NOACCESS | PAGE_GUARD) != 0;
        if !found || pages.State != MEM_COMMIT || is_closed {
            return false;
        }
        at = pages.BaseAddress as u64 + pages.RegionSize as u64;
    }
    address != 0
}

/// Registers [`on_exception`] as the first handler of the process's exceptions. The library stays
/// loaded, since `FreeLibrary` does not remove the handler.
fn handle_faults() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        keep_loaded();
        // SAFETY: a function that the system can call on any thread.
        unsafe { AddVectoredExceptionHandler(1, Some(on_exception)) };
    });
}

/// Replaces an accessed page of a reservation that has no memory with zeroed memory.
unsafe extern "system" fn on_exception(exception: *mut EXCEPTION_POINTERS) -> i32 {
    const GO_ON: i32 = -1;
    const SEARCH: i32 = 0;
    /// `ExceptionInformation[0]` of reads and writes; 8 is the execution of data.
    const WRITE: usize = 1;
    // SAFETY: the system passes valid structures.
    let record = unsafe { &*(*exception).ExceptionRecord };
    let [access, address, ..] = record.ExceptionInformation;
    if record.ExceptionCode != EXCEPTION_ACCESS_VIOLATION || access > WRITE {
        return SEARCH;
    }
    let Some(functions) = Functions::of_system() else {
        return SEARCH;
    };
    let granule = address as u64 & !(GRANULE - 1);
    let pieces = &mut *PIECES.lock();
    let is_there = match pieces.at(granule) {
        None => false,
        Some((_, piece)) => match piece.content {
            Content::Placeholder => pieces.commit(functions, granule, granule + GRANULE),
            // A replacement, which is complete by now, caused the fault.
            Content::Memory | Content::View(..) => true,
        },
    };
    if is_there { GO_ON } else { SEARCH }
}
