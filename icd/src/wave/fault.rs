//! Why a device was lost, and where: what `VK_EXT_device_fault` tells.

#![forbid(unsafe_code)]

use std::fmt;
use std::sync::Arc;

use parking_lot::Mutex;
use spirv_jit::Program;
use spirv_jit::origin::Place;
use spirv_jit::reach::Stray;

/// Why a command was given up: the device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    TimedOut,
    /// Invocations in flight would need more memory than there is for them.
    OutOfMemory,
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TimedOut => "a command ran for longer than TUFF_TIMEOUT allows",
            Self::OutOfMemory => "a command's invocations need more memory than there is for them",
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
    pub place: Place,
    /// Shader calls that wait for this one, where they could matter.
    pub depth: u32,
}

/// An address that a shader followed to nowhere: it read zeros there, or wrote nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WildAddress {
    pub address: u64,
    pub writes: bool,
    pub place: Place,
}

/// Wild addresses that are kept, the latest ones.
const KEPT_ADDRESSES: usize = 64;

/// Wild accesses of shaders so far, one for each instruction.
#[derive(Debug, Default)]
pub struct WildAddresses(Mutex<Vec<WildAddress>>);

impl WildAddresses {
    /// Adds what programs did. Misaligned pointers and those of other programs are left out.
    pub fn add<'a>(
        &self,
        strays: &[Stray],
        programs: impl Iterator<Item = &'a Arc<Program>> + Clone,
    ) {
        let mut kept = self.0.lock();
        for stray in strays.iter().filter(|stray| stray.alignment == 0) {
            let mut programs = programs.clone();
            let program = programs.find(|program| program.number() == stray.program);
            if let Some((place, writes)) = program.and_then(|it| it.place_of_access(stray.site)) {
                let wild = WildAddress {
                    address: stray.address,
                    writes,
                    place,
                };
                kept.retain(|other| (other.writes, &other.place) != (writes, &wild.place));
                if kept.len() == KEPT_ADDRESSES {
                    kept.remove(0);
                }
                kept.push(wild);
            }
        }
    }

    /// All that are kept, the latest last.
    pub fn all(&self) -> Vec<WildAddress> {
        self.0.lock().clone()
    }
}

/// How a device was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    pub cause: Cause,
    pub at: Option<StoppedAt>,
    /// Addresses that shaders followed before, the latest last.
    pub wild: Vec<WildAddress>,
}

impl Fault {
    /// One that is not of a shader.
    pub fn new(cause: Cause) -> Self {
        Self {
            cause,
            at: None,
            wild: Vec::new(),
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
