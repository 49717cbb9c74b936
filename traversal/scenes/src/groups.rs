//! Rays in groups of sixteen, which walk however the walker likes.

use crate::Bytes;
use traversal::*;

/// Groups of rays, the results, and the function that decides on their candidates.
pub struct Groups<D> {
    pub rows: Vec<RayRows>,
    /// The rays of each group.
    pub starts: Vec<Start>,
    pub group_walks: Vec<GroupWalk>,
    /// By group and lane: candidates at which the ray waited.
    pub met: Vec<[Vec<Hit>; PACKET]>,
    /// Decides on the candidates of a group; what it says nothing about is ignored.
    decide: D,
    waiting: Vec<u32>,
    /// How often fuel may run out.
    pub refills: usize,
    /// How often candidates may be decided on.
    pub rounds: usize,
}

/// There were no more refills.
pub struct OutOfFuel;

/// There is nothing to decide on.
pub fn undecided(_: &RayRows, _: &mut GroupWalk) {
    panic!("something is asked about");
}

impl<D: FnMut(&RayRows, &mut GroupWalk)> Groups<D> {
    /// Rays through one structure.
    pub fn new(top: &Bytes, rays: &[Ray], decide: D) -> Groups<D> {
        let groups = rays.chunks(PACKET).map(|rays| {
            let mut rows = RayRows::NONE;
            for (lane, ray) in rays.iter().enumerate() {
                rows.set(lane, top.address(), ray, 0.0);
            }
            (rows, LaneMask::full(rays.len()))
        });
        Groups::of_rows(groups.collect(), decide)
    }

    /// Rows of rays, and their lanes.
    pub fn of_rows(groups: Vec<(RayRows, LaneMask)>, decide: D) -> Groups<D> {
        let (rows, lanes): (Vec<_>, Vec<_>) = groups.into_iter().unzip();
        let start = |lanes| Start {
            lanes,
            are_alike: false,
            shows_first_hit: false,
            shows_order: false,
        };
        Groups {
            group_walks: rows.iter().map(|_| GroupWalk::default()).collect(),
            met: rows.iter().map(|_| Default::default()).collect(),
            rows,
            starts: lanes.into_iter().map(start).collect(),
            decide,
            waiting: Vec::new(),
            refills: usize::MAX,
            rounds: usize::MAX,
        }
    }

    /// The same, with other demands on all.
    pub fn with(mut self, demand: impl Fn(&mut Start)) -> Groups<D> {
        self.starts.iter_mut().for_each(demand);
        self
    }

    /// Traces the rays, so many groups at once: to their ends, or as far as refills and rounds
    /// last.
    ///
    /// # Safety
    /// The structures are alive.
    pub unsafe fn trace(&mut self, walker: &mut Walker, at_once: usize) {
        let all: Vec<u32> = (0..self.rows.len() as u32).collect();
        for groups in all.chunks(at_once) {
            // SAFETY: the caller guarantees that the structures are alive.
            let mut traced = unsafe { walker.trace(groups, &[], self) };
            for _ in 0..self.rounds {
                if traced.is_err() || self.waiting.is_empty() {
                    break;
                }
                let decided = std::mem::take(&mut self.waiting);
                // SAFETY: the caller guarantees that the structures are alive.
                traced = unsafe { walker.resume(&decided, self) };
            }
            self.waiting.clear();
            if traced.is_err() {
                walker.clear();
                return;
            }
        }
    }

    /// The hits of the first rays.
    pub fn found(&self, count: usize) -> Vec<Option<Hit>> {
        (0..count)
            .map(|i| self.group_walks[i / PACKET].hits.get(i % PACKET))
            .collect()
    }
}

impl<D: FnMut(&RayRows, &mut GroupWalk)> GroupWalks for Groups<D> {
    type Stop = OutOfFuel;

    fn rays(&self, group: u32, rays: &mut RayRows) -> Start {
        rays.clone_from(&self.rows[group as usize]);
        self.starts[group as usize]
    }

    fn group_walk(&mut self, group: u32) -> &mut GroupWalk {
        &mut self.group_walks[group as usize]
    }

    fn settled(&mut self, group: u32) -> Result<(), OutOfFuel> {
        let group_walk = &mut self.group_walks[group as usize];
        if !group_walk.candidates().found.is_empty() {
            for lane in group_walk.candidates().found {
                self.met[group as usize][lane].push(group_walk.candidates().hit(lane));
            }
            (self.decide)(&self.rows[group as usize], group_walk);
            self.waiting.push(group);
        }
        Ok(())
    }

    fn out_of_fuel(&mut self, _: u32) -> Result<(), OutOfFuel> {
        self.refills = self.refills.checked_sub(1).ok_or(OutOfFuel)?;
        Ok(())
    }
}
