//! Rays of many groups that are walked together, node by node.

use smallvec::SmallVec;
use traversal::{Caller, Event, Hit, PACKET, RayRows, Walk};

use super::Dispatch;
use super::batch::{Batch, FUEL, Worker};
use super::rays::RayGroup;
use super::slab::Slab;
use super::subgroup::{LaneRef, Subgroup};
use crate::wave::Stopped;

/// Groups of rays that hear of their rays.
struct Groups<'a, 'd> {
    groups: &'a mut Slab<RayGroup>,
    subgroups: &'a Slab<Subgroup>,
    walks: &'a mut Slab<Walk>,
    dispatch: &'a Dispatch<'d>,
    stopped: Vec<(LaneRef, Event)>,
}

impl Caller for Groups<'_, '_> {
    fn hit(&mut self, group: u32, lane: usize, hit: &Hit) {
        self.groups[group].hits.set(lane, hit);
    }

    fn rays(&mut self, group: u32, rays: &mut RayRows) {
        let group = &self.groups[group];
        group.load(group.operands(self.subgroups), self.dispatch, rays);
    }

    fn suspend(&mut self, group: u32, lane: usize, walk: &mut Walk, event: Event) {
        let place = self.walks.take();
        std::mem::swap(&mut self.walks[place], walk);
        self.groups[group].walks[lane] = place;
        self.stopped.push((LaneRef::new(group, lane), event));
    }
}

impl Batch<'_> {
    /// Walks the rays of the stream.
    pub(super) fn trace_streams(&mut self) -> Result<(), Stopped> {
        if self.streamed.is_empty() {
            return Ok(());
        }
        let mut streamed = std::mem::take(&mut self.streamed);
        let Worker {
            walker,
            walks,
            ray_groups,
            subgroups,
            ..
        } = &mut *self.worker;
        let mut groups = Groups {
            groups: ray_groups,
            subgroups,
            walks,
            dispatch: self.dispatch,
            stopped: std::mem::take(&mut self.stopped),
        };
        let fuel = &mut (FUEL * streamed.len() as u64);
        // SAFETY: as for walks that are started one by one.
        unsafe { walker.trace_streams(fuel, &mut groups) };
        let mut stopped = groups.stopped;
        for &(index, _) in &streamed {
            let of_group = stopped.iter().filter(|(ray, _)| ray.index() == index);
            let events: SmallVec<[_; PACKET]> =
                of_group.map(|&(ray, event)| (ray.lane(), event)).collect();
            self.settle(index, &events)?;
        }
        stopped.clear();
        self.stopped = stopped;
        streamed.clear();
        self.streamed = streamed;
        Ok(())
    }
}
