//! Packet data in a walker: entries to visit, and the rays' set-up.
#![forbid(unsafe_code)]

use lanes::LaneMask;

use super::rays::Rays;
use crate::walk::entry::{Entry, STACK};
use crate::walk::suspended::Ahead;

/// Children still to be visited, and by which rays.
pub(crate) struct Stack {
    pub(super) entries: [Entry; STACK],
    pub(super) lanes: [LaneMask; STACK],
    pub(super) length: usize,
}

impl Stack {
    pub const EMPTY: Stack = Stack {
        entries: [Entry::ROOT; STACK],
        lanes: [LaneMask::NONE; STACK],
        length: 0,
    };

    /// Nothing but the root.
    #[inline]
    pub(super) fn start(&mut self, lanes: LaneMask) {
        self.start_at(Entry::ROOT, lanes);
    }

    /// Nothing but an entry.
    #[inline]
    pub(super) fn start_at(&mut self, entry: Entry, lanes: LaneMask) {
        self.entries[0] = entry;
        self.lanes[0] = lanes;
        self.length = 1;
    }

    /// Copies what is pending for rays.
    pub(super) fn save(&self, rays: LaneMask, to: &mut Ahead) {
        to.clear();
        to.entries.extend_from_slice(&self.entries[..self.length]);
        let lanes = &self.lanes[..self.length];
        to.lanes.extend(lanes.iter().map(|&lanes| lanes & rays));
    }

    /// Takes over what is pending.
    pub(super) fn restore(&mut self, from: &Ahead) {
        let length = from.entries.len().min(from.lanes.len()).min(STACK);
        self.entries[..length].copy_from_slice(&from.entries[..length]);
        self.lanes[..length].copy_from_slice(&from.lanes[..length]);
        self.length = length;
    }
}

/// Walker data that packets need beyond that of walks.
pub(crate) struct PacketSpace {
    pub(super) top: Stack,
    pub(super) bottom: Stack,
    /// In a top level of several instances.
    pub(super) ways: Rays,
    /// In the instance that is being visited.
    pub(super) rays: Rays,
}

impl PacketSpace {
    pub const EMPTY: PacketSpace = PacketSpace {
        top: Stack::EMPTY,
        bottom: Stack::EMPTY,
        ways: Rays::EMPTY,
        rays: Rays::EMPTY,
    };
}
