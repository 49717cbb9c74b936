//! Rays that wait to be traced together.

use lanes::LaneMask;

use super::lists::Stream;
use crate::ray::Ray;
use crate::walk::PACKET;

/// Rays of a stream, at most.
pub(crate) const STREAM_RAYS: usize = 4096;

/// Rays that wait to be traced together, and memory to do so.
pub(crate) struct Streams {
    /// Values that all rays share.
    pub(super) address: u64,
    pub(super) ray: Ray,
    /// The only instance: the rays are in its space. Else they are in that of the top level.
    pub(super) only: Option<u32>,
    pub(super) outer: Stream,
    /// Of hits in a top level of several instances.
    pub(super) instances: Vec<u32>,
    /// The rays in an instance of several.
    pub(super) inner: Stream,
    /// Groups and lanes of those that are to be traced by themselves.
    pub(super) singles: Vec<(u32, LaneMask)>,
    /// Rays through this top level are not added to streams for some time: too many had to be
    /// traced by themselves.
    pub(super) unsuited: u64,
    pub(super) pause: u32,
}

impl Streams {
    pub fn new() -> Streams {
        Streams {
            address: 0,
            ray: Ray::NONE,
            only: None,
            outer: Stream::default(),
            instances: Vec::new(),
            inner: Stream::default(),
            singles: Vec::new(),
            unsuited: 0,
            pause: 0,
        }
    }

    /// Forgets all rays.
    pub fn clear(&mut self) {
        self.outer.clear();
        self.instances.clear();
    }

    /// Whether rays that have these things in common can join.
    pub(super) fn admits(&mut self, address: u64, ray: &Ray) -> bool {
        if address == self.unsuited && self.pause > 0 {
            self.pause -= 1;
            return false;
        }
        let ours = (self.address, self.ray.flags, self.ray.cull_mask);
        let has_room = self.outer.rays.len() + PACKET <= STREAM_RAYS;
        self.outer.rays.is_empty() || has_room && ours == (address, ray.flags, ray.cull_mask)
    }
}
