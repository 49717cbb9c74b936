//! Why a device was lost, and where: the report behind `VK_KHR_device_fault` and
//! `VK_EXT_device_fault`.

#![forbid(unsafe_code)]

use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use spirv_jit::Program;
use spirv_jit::origin::CodeLocation;
use spirv_jit::reach::Stray;

use super::observer::Observer;
use crate::capabilities::limits::MAX_DEVICE_FAULT_COUNT;

/// Why a command was given up: the device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    TimedOut,
    /// Invocations in flight would need more memory than there is for them.
    OutOfMemory,
    /// An invocation executed `OpAbortKHR`.
    Aborted,
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TimedOut => "a command ran for longer than TUFF_TIMEOUT allows",
            Self::OutOfMemory => "a command's invocations need more memory than there is for them",
            Self::Aborted => "a shader aborted",
        })
    }
}

/// The cause of a device loss.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// A command was given up.
    Stopped(Stopped),
    /// Memory could not be bound to a sparse resource.
    SparseBinding(String),
    /// A bug of the driver.
    Internal(String),
    /// The process is a child of the one that made the device.
    Forked,
}

impl Cause {
    /// `VkDeviceFaultVendorInfoEXT::vendorFaultCode`, as docs/features.md lists them.
    pub fn code(&self) -> u64 {
        match self {
            Self::Stopped(Stopped::TimedOut) => 1,
            Self::Stopped(Stopped::OutOfMemory) => 2,
            Self::SparseBinding(_) => 3,
            Self::Internal(_) => 4,
            Self::Forked => 5,
            // 6 to 8 are of addresses.
            Self::Stopped(Stopped::Aborted) => 9,
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stopped(why) => why.fmt(f),
            Self::SparseBinding(why) => f.write_str(why),
            Self::Internal(why) => write!(f, "the driver panicked: {why}"),
            Self::Forked => f.write_str("a fork takes no threads along: this is a child process"),
        }
    }
}

/// Where a command was given up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoppedAt {
    pub place: CodeLocation,
    /// Shader calls that wait for this one, where they could matter.
    pub depth: u32,
}

/// An invalid address that a shader used: its reads gave zeros, and its writes had no effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WildAddress {
    /// The program's number, and the access in it.
    instruction: (u64, usize),
    pub address: u64,
    pub writes: bool,
    pub place: CodeLocation,
}

/// Wild addresses that are kept, the latest ones. The last report is that of the loss.
const KEPT_ADDRESSES: usize = MAX_DEVICE_FAULT_COUNT as usize - 1;

/// Wild accesses of shaders so far, one for each instruction.
#[derive(Debug, Default)]
pub struct WildAddresses(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    addresses: Vec<WildAddress>,
    dropped: u64,
}

impl WildAddresses {
    /// Adds the kept addresses to a report, the latest last.
    pub fn tell(&self, fault: &mut Fault) {
        let kept = self.0.lock();
        fault.wild.clone_from(&kept.addresses);
        fault.dropped = kept.dropped;
    }
}

impl Observer for WildAddresses {
    /// Adds what programs did. Misaligned pointers and those of other programs are left out.
    fn strays(&self, strays: &[Stray], programs: &[&Program]) {
        let mut kept = self.0.lock();
        for stray in strays.iter().filter(|stray| stray.alignment == 0) {
            let mut programs = programs.iter();
            let program = programs.find(|program| program.number() == stray.program);
            if let Some((place, writes)) = program.and_then(|it| it.place_of_access(stray.site)) {
                let instruction = (stray.program, stray.site);
                let wild = WildAddress {
                    instruction,
                    address: stray.address,
                    writes,
                    place,
                };
                let addresses = &mut kept.addresses;
                addresses.retain(|other| other.instruction != instruction);
                let is_full = addresses.len() == KEPT_ADDRESSES;
                if is_full {
                    addresses.remove(0);
                }
                addresses.push(wild);
                kept.dropped += u64::from(is_full);
            }
        }
    }
}

/// How a device was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    pub cause: Cause,
    pub at: Option<StoppedAt>,
    /// Addresses that shaders followed before, the latest last.
    pub wild: Vec<WildAddress>,
    /// Earlier addresses, which are not kept.
    pub dropped: u64,
}

impl Fault {
    /// Reports of `vkGetDeviceFaultReportsKHR`: the wild addresses, then the loss.
    pub fn report_count(&self) -> u32 {
        self.wild.len() as u32 + 1
    }

    /// One that is not of a shader.
    pub fn new(cause: Cause) -> Self {
        Self {
            cause,
            at: None,
            wild: Vec::new(),
            dropped: 0,
        }
    }
}

/// How many of its reports a device has returned: `vkGetDeviceFaultReportsKHR` returns each once,
/// to one of the threads that ask. A child process has separate reports, independent of those that
/// its parent has returned.
#[derive(Debug, Default)]
pub struct Returned(AtomicU64);

impl Returned {
    /// The number of reports that a process has returned.
    pub fn count(&self, process: u32) -> u32 {
        Self::of(self.0.load(Ordering::Relaxed), process)
    }

    /// Takes the next reports of `available` ones, at most `room`.
    pub fn take(&self, process: u32, available: u32, room: u32) -> Range<u32> {
        let mut old = self.0.load(Ordering::Relaxed);
        loop {
            let first = Self::of(old, process).min(available);
            let end = first + room.min(available - first);
            let new = u64::from(process) << 32 | u64::from(end);
            match (self.0).compare_exchange_weak(old, new, Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return first..end,
                Err(other) => old = other,
            }
        }
    }

    fn of(both: u64, process: u32) -> u32 {
        match (both >> 32) as u32 == process {
            true => both as u32,
            false => 0,
        }
    }
}

impl From<Stopped> for Fault {
    fn from(why: Stopped) -> Self {
        Self::new(Cause::Stopped(why))
    }
}

impl fmt::Display for StoppedAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.place.fmt(f)?;
        match self.depth {
            0 => Ok(()),
            depth => write!(f, ", {depth} shader calls deep"),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.cause.fmt(f)?;
        match &self.at {
            Some(at) => write!(f, ": {at}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_report_is_returned_once_to_each_process() {
        let returned = Returned::default();
        assert_eq!(returned.take(7, 5, 2), 0..2);
        assert_eq!(returned.take(7, 5, 0), 2..2);
        assert_eq!(returned.count(7), 2);
        // A child.
        assert_eq!(returned.count(8), 0);
        assert_eq!(returned.take(8, 1, 4), 0..1);
        assert_eq!(returned.take(8, 1, 4), 1..1);
    }

    #[test]
    fn threads_share_the_reports() {
        let returned = Returned::default();
        let all = std::thread::scope(|scope| {
            let take = || {
                let mut mine = Vec::new();
                while let Some(next) = returned.take(1, 1000, 1).next() {
                    mine.push(next);
                }
                mine
            };
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(take)).collect();
            let taken = threads.into_iter().map(|thread| thread.join().unwrap());
            let mut all: Vec<u32> = taken.flatten().collect();
            all.sort_unstable();
            all
        });
        assert!(all.into_iter().eq(0..1000));
    }
}
