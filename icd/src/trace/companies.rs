//! Rays of one group that walk together: what decisions they wait for, and how they go on.

use traversal::{Event, Progress};

use super::batch::{Batch, Worker};
use super::rays::record_indices;
use super::subgroup::{LaneRef, Role, lanes_of};
use super::walks::need;
use crate::wave::Stopped;

/// Rays with a candidate, from which on a subgroup is made of those of one group.
const FULL_ENOUGH: u32 = 6;

impl Batch<'_> {
    /// Goes on with rays that walk together.
    pub(super) fn go_on(&mut self, index: u32) -> Result<(), Stopped> {
        let Worker {
            walker,
            rays,
            ray_groups,
            subgroups,
            companies,
            company,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[index];
        let Some(place) = group.company.take() else {
            return Ok(());
        };
        std::mem::swap(company, &mut companies[place]);
        companies.remove(place);
        company.end(group.over);
        // Of all that set out, for what they have in common.
        group.load(group.operands(subgroups), self.dispatch, rays);
        let lanes = group.in_flight;
        // SAFETY: as for their start.
        let progress = unsafe { walker.go_on(rays, &mut group.hits, company) };
        self.heed_company(index, lanes, progress)
    }

    /// Does what rays ask for that walk together.
    pub(super) fn heed_company(
        &mut self,
        index: u32,
        lanes: u16,
        progress: Progress,
    ) -> Result<(), Stopped> {
        match progress {
            Progress::Candidates => self.ask_about_candidates(index),
            Progress::Parted(parted) => self.part(index, lanes, parted),
            Progress::Apart | Progress::Done => {
                self.end_walks(index, lanes);
                Ok(())
            }
        }
    }

    /// Calls the shaders that decide on the candidates of rays that walk together. Where a group has none, triangles count.
    fn ask_about_candidates(&mut self, index: u32) -> Result<(), Stopped> {
        let worker = &mut *self.worker;
        let place = worker.companies.take();
        std::mem::swap(&mut worker.company, &mut worker.companies[place]);
        let lanes = worker.companies[place].candidates().found;
        let group = &mut worker.ray_groups[index];
        (group.company, group.undecided) = (Some(place), lanes);
        let worker = &*self.worker;
        let (group, subgroups) = (&worker.ray_groups[index], &worker.subgroups);
        let candidates = worker.companies[place].candidates();
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
        let mut rest = lanes;
        while rest != 0 {
            let record = records[rest.trailing_zeros() as usize];
            let mut alike = 0;
            for (lane, &other) in records.iter().enumerate() {
                alike |= u16::from(other == record) << lane;
            }
            alike &= rest;
            rest &= !alike;
            match self.find_decider(record, role) {
                Some((program, record)) if alike.count_ones() >= FULL_ENOUGH => {
                    self.form_in_place((program, role, record), index, alike)?;
                }
                Some((program, record)) => {
                    for lane in lanes_of(alike) {
                        let ray = LaneRef::new(index, lane);
                        self.calls.push(program, role, record, ray);
                    }
                }
                None => {
                    for lane in lanes_of(alike) {
                        if role == Role::AnyHit {
                            self.accept(LaneRef::new(index, lane));
                        }
                        self.decided(LaneRef::new(index, lane));
                    }
                }
            }
        }
        Ok(())
    }

    /// Rays that walked together go on one by one, the others are at their ends.
    #[cold]
    fn part(&mut self, index: u32, lanes: u16, parted: u16) -> Result<(), Stopped> {
        let mut done = lanes;
        for lane in lanes_of(parted) {
            let Worker {
                walks,
                rays,
                ray_groups,
                company,
                ..
            } = &mut *self.worker;
            let place = walks.take();
            let group = &mut ray_groups[index];
            group.walks[lane] = place;
            // SAFETY: as for their start.
            unsafe { company.part(lane, rays, &group.hits, &mut walks[place]) };
            if !self.is_over(LaneRef::new(index, lane), Event::OutOfFuel)? {
                done &= !(1 << lane);
            }
        }
        self.end_walks(index, done);
        Ok(())
    }

    /// An any-hit shader, or the want of one, accepts a ray's triangle.
    pub(super) fn accept(&mut self, ray: LaneRef) {
        let Worker {
            ray_groups,
            companies,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[ray.index()];
        if let Some(place) = group.company {
            companies[place].accept(ray.lane(), &mut group.hits);
        }
    }

    /// A shader has decided on the candidate of a ray that walks with others; after the last one they go on.
    pub(super) fn decided(&mut self, ray: LaneRef) {
        let group = &mut self.worker.ray_groups[ray.index()];
        group.undecided &= !(1 << ray.lane());
        if group.undecided == 0 {
            self.going_on.push(ray.index());
        }
    }
}
