//! Rays of one group that walk together: what decisions they wait for, and how they go on.

use smallvec::SmallVec;
use traversal::{Event, PACKET, Progress};

use super::batch::{Batch, Worker};
use super::rays::{alike, record_indices};
use super::subgroup::{Role, lanes_of};
use super::walks::need;
use crate::wave::Stopped;

impl Batch<'_> {
    /// Goes on with rays that walk together.
    pub(super) fn go_on_together(&mut self, index: u32) -> Result<(), Stopped> {
        let Worker {
            walker,
            rays,
            ray_groups,
            subgroups,
            packets,
            packet,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[index];
        let Some(place) = group.packet.take() else {
            return Ok(());
        };
        std::mem::swap(packet, &mut packets[place]);
        packets.remove(place);
        packet.end(group.over);
        // Of all that started, for what they have in common.
        group.load(group.operands(subgroups), self.dispatch, rays);
        // SAFETY: as for their start.
        let progress = unsafe { walker.resume_packet(rays, &mut group.hits, packet) };
        self.act_on_packet(index, progress)
    }

    /// Does what rays ask for that walk together.
    pub(super) fn act_on_packet(&mut self, index: u32, progress: Progress) -> Result<(), Stopped> {
        match progress {
            Progress::Candidates => self.ask_about_candidates(index),
            Progress::Split(split) => self.split(index, split),
            Progress::Singly | Progress::Done => self.end_walks(index),
        }
    }

    /// Calls the shaders that decide on the candidates of rays that walk together. Where a group has none, triangles count.
    fn ask_about_candidates(&mut self, index: u32) -> Result<(), Stopped> {
        let worker = &mut *self.worker;
        let place = worker.packets.take();
        std::mem::swap(&mut worker.packet, &mut worker.packets[place]);
        let lanes = worker.packets[place].candidates().found;
        let group = &mut worker.ray_groups[index];
        group.packet = Some(place);
        let worker = &*self.worker;
        let (group, subgroups) = (&worker.ray_groups[index], &worker.subgroups);
        let candidates = worker.packets[place].candidates();
        let operands = group.operands(subgroups);
        let role = match candidates.is_built_in(lanes.trailing_zeros() as usize) {
            true => Role::AnyHit,
            false => Role::Intersection,
        };
        let records = record_indices(candidates, operands);
        if let Some(traced) = self.dispatch.checks {
            let need = need(role);
            for lane in lanes_of(lanes) {
                self.check_hit_record(traced, need, records[lane], &candidates.hit(lane));
            }
        }
        let (mut rest, mut undecided) = (lanes, 0);
        let mut callees: SmallVec<[_; 4]> = SmallVec::new();
        while rest != 0 {
            let record = records[rest.trailing_zeros() as usize];
            let alike = alike(&records, rest);
            rest &= !alike;
            if let Some((program, record)) = self.find_decider(record, role) {
                undecided |= alike;
                callees.push(((program, role, record), alike));
            } else if role == Role::AnyHit {
                self.accept(index, alike);
            }
        }
        self.worker.ray_groups[index].undecided = undecided;
        if undecided == 0 {
            self.going_on.push(index);
        }
        for (callee, lanes) in callees {
            self.call(callee, index, lanes)?;
        }
        Ok(())
    }

    /// Rays that walked together go on one by one, the others are at their ends.
    #[cold]
    fn split(&mut self, index: u32, split: u16) -> Result<(), Stopped> {
        let mut events: SmallVec<[(usize, Event); PACKET]> = SmallVec::new();
        for lane in lanes_of(split) {
            let Worker {
                walks,
                rays,
                ray_groups,
                packet,
                ..
            } = &mut *self.worker;
            let place = walks.take();
            let group = &mut ray_groups[index];
            group.walks[lane] = place;
            // SAFETY: as for their start.
            unsafe { packet.split(lane, rays, &group.hits, &mut walks[place]) };
            events.push((lane, Event::OutOfFuel));
        }
        self.settle(index, &events)
    }

    /// An any-hit shader, or the want of one, accepts the triangles of rays that walk together.
    pub(super) fn accept(&mut self, index: u32, lanes: u16) {
        let Worker {
            ray_groups,
            packets,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[index];
        if let Some(place) = group.packet {
            packets[place].accept(lanes, &mut group.hits);
        }
    }

    /// Shaders have decided on the candidates of rays; after the last ones of a group it goes on.
    pub(super) fn decided(&mut self, index: u32, lanes: u16) {
        let group = &mut self.worker.ray_groups[index];
        group.undecided &= !lanes;
        if group.undecided == 0 {
            self.going_on.push(index);
        }
    }
}
