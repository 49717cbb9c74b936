//! The rays of queries that wait for their shaders.
#![forbid(unsafe_code)]

use lanes::LaneMask;
use traversal::GroupWalk;

use crate::wave::Stopped;

/// Groups of rays that a worker may keep, at most.
const MOST: usize = 1 << 16;

/// The rays that wait in one subgroup's queries, by the first row of the query's object. It is the
/// subgroup that has them: an object, which a shader may overwrite, says nothing of where they are.
#[derive(Default)]
pub struct Owned(Vec<(u32, Box<GroupWalk>)>);

/// Keeps the memory of groups of rays.
#[derive(Default)]
pub(super) struct Waiting {
    /// The rays that start.
    pub starting: Box<GroupWalk>,
    spare: Vec<Box<GroupWalk>>,
    /// Groups that are kept.
    count: usize,
}

impl Owned {
    /// Starts over; what was listed has been forgotten.
    #[inline]
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// The rays of an object's query that wait.
    pub(super) fn find(&mut self, object: u32) -> Option<&mut GroupWalk> {
        let found = self.0.iter_mut().find(|(of, _)| *of == object);
        found.map(|(_, group_walk)| &mut **group_walk)
    }
}

impl Waiting {
    /// Keeps the rays that started, those of an object's query, as far as they wait.
    ///
    /// # Errors
    /// There are too many.
    pub fn keep(&mut self, object: u32, owned: &mut Owned) -> Result<(), Stopped> {
        let waiting = self.starting.candidates().found;
        if waiting.is_empty() {
            return Ok(());
        }
        if let Some(others) = owned.find(object) {
            for lane in waiting {
                self.starting.move_ray(lane, others, lane);
            }
            return Ok(());
        }
        let room = self.room()?;
        owned
            .0
            .push((object, std::mem::replace(&mut self.starting, room)));
        Ok(())
    }

    /// Memory for one more group.
    fn room(&mut self) -> Result<Box<GroupWalk>, Stopped> {
        if self.count == MOST {
            return Err(Stopped::OutOfMemory);
        }
        self.count += 1;
        let mut room = self.spare.pop().unwrap_or_default();
        // Rays that waited when their subgroup was released have no owner: their structures may be
        // gone.
        room.forget(LaneMask::ALL);
        Ok(room)
    }

    /// Forgets rays of an object's query.
    pub fn forget(&mut self, object: u32, lanes: LaneMask, owned: &mut Owned) {
        if let Some(place) = owned.0.iter().position(|(of, _)| *of == object) {
            let group_walk = &mut owned.0[place].1;
            group_walk.forget(lanes);
            if group_walk.candidates().found.is_empty() {
                let (_, group_walk) = owned.0.swap_remove(place);
                self.spare.push(group_walk);
                self.count -= 1;
            }
        }
    }

    /// A lane of one subgroup becomes a lane of another. What is left of the first may only be
    /// moved or released.
    ///
    /// # Errors
    /// There are too many.
    pub fn move_lane(
        &mut self,
        (from, lane): (&mut Owned, usize),
        (to, to_lane): (&mut Owned, usize),
    ) -> Result<(), Stopped> {
        for (object, group_walk) in &mut from.0 {
            if !group_walk.candidates().found.contains(lane) {
                continue;
            }
            if to.find(*object).is_none() {
                to.0.push((*object, self.room()?));
            }
            if let Some(others) = to.find(*object) {
                group_walk.move_ray(lane, others, to_lane);
            }
        }
        Ok(())
    }

    /// Forgets the rays of a subgroup.
    #[inline]
    pub fn release(&mut self, owned: &mut Owned) {
        if owned.0.is_empty() {
            return;
        }
        self.count -= owned.0.len();
        self.spare
            .extend(owned.0.drain(..).map(|(_, group_walk)| group_walk));
    }

    /// Forgets all rays; the subgroups' are cleared before they are used again.
    pub fn clear(&mut self) {
        self.count = 0;
    }
}
