//! Entering a structure: the ray in its space.

use super::facts::InstanceFacts;
use super::level_ray::LevelRay;
use crate::layout::{Header, child, instance_state};
use crate::live::{Live, Range};
use crate::ray::{Ray, ray_flags};
use crate::structure::{Kind, Structure};

/// The structure that the previous walk entered, while it cannot have changed.
#[derive(Clone, Copy)]
pub(crate) struct Entered {
    top_level: u64,
    flags: u32,
    cull_mask: u32,
    /// The only instance of the top level; its bottom level was entered, and admits the ray.
    only: Option<u32>,
}

impl Entered {
    pub const NOTHING: Entered = Entered {
        top_level: 0,
        flags: 0,
        cull_mask: 0,
        only: None,
    };

    /// Remembers what a walk has entered.
    #[inline(always)]
    pub fn set(&mut self, top_level: u64, ray: &Ray, only: Option<u32>) {
        *self = Entered {
            top_level,
            flags: ray.flags,
            cull_mask: ray.cull_mask,
            only,
        };
    }

    /// The only instance, if that is what a ray enters again.
    #[inline(always)]
    pub fn again(&self, top_level: u64, ray: &Ray) -> Option<u32> {
        let same = self.top_level == top_level
            && self.flags == ray.flags
            && self.cull_mask == ray.cull_mask;
        if same { self.only } else { None }
    }
}

/// A structure and the ray in its space.
#[derive(Clone)]
pub(crate) struct Level {
    pub structure: Structure,
    pub ray: LevelRay,
    /// Where the structure is, and the copy of its header that was checked.
    address: u64,
    header: Header,
    /// Where structures may be, and the range of the last one.
    live: Live,
    range: Range,
}

impl Level {
    /// A level with nothing in it, to be entered.
    pub const EMPTY: Level = Level {
        structure: Structure::EMPTY,
        ray: LevelRay::EMPTY,
        address: 0,
        header: Header::NONE,
        live: Live::EVERYWHERE,
        range: Range::NONE,
    };

    /// Where structures may be.
    pub fn live(&self) -> &Live {
        &self.live
    }

    /// Sets where structures may be. What was found elsewhere is forgotten.
    pub fn set_live(&mut self, live: &Live) {
        if !self.live.is(live) {
            self.live = live.clone();
            (self.address, self.range) = (0, Range::NONE);
        }
    }

    /// Looks at the structure at an address, mostly that of the ray before; false if there is none.
    ///
    /// # Safety
    /// The contract of [`Structure::at`].
    #[inline(always)]
    unsafe fn find(&mut self, address: u64) -> bool {
        // It may be another one by now.
        if address == self.address && address != 0 && self.structure.is_still(&self.header) {
            return true;
        }
        self.address = 0;
        let mut bytes = self.range.bytes_from(address);
        if bytes == 0 {
            self.range = self.live.range_of(address);
            bytes = self.range.bytes_from(address);
        }
        // SAFETY: the caller keeps the contract of `Structure::at`.
        let Some((structure, header)) = (unsafe { Structure::inside(address, bytes) }) else {
            return false;
        };
        self.structure = structure;
        self.address = address;
        self.header = header;
        true
    }

    /// Enters a top level; false if there is nothing to walk.
    ///
    /// # Safety
    /// The contract of [`Structure::at`], here and below.
    #[inline(always)]
    pub unsafe fn enter_top(&mut self, address: u64) -> bool {
        // SAFETY: the caller guarantees that the contract of `Structure::at` holds.
        unsafe { self.find(address) && self.structure.kind().is_top() }
    }

    /// Sets up the ray for the nodes of a top level that was entered.
    #[inline(always)]
    pub fn set_up_top(&mut self, ray: &Ray) {
        let reach = ray.origin.iter().fold(0f32, |most, c| most.max(c.abs()));
        let uncertainty = self.structure.origin_error() * reach;
        self.ray
            .set_for_boxes(ray.origin, ray.direction, ray.t_min, uncertainty);
    }

    /// Enters the bottom level of an instance of `top`; false if the ray has no business there.
    ///
    /// # Safety
    /// As for [`Self::enter_top`].
    #[inline(always)]
    pub unsafe fn enter_bottom(
        &mut self,
        facts: &mut InstanceFacts,
        top: &Level,
        index: u32,
        ray: &Ray,
        time: f32,
    ) -> bool {
        // SAFETY: the caller guarantees that the contract of `Structure::at` holds.
        let is_admitted = unsafe { self.admit(facts, top, index, ray) };
        is_admitted && self.place(top, index, ray, time)
    }

    /// Finds the bottom level of an instance of `top`, and reads the instance's record; false if
    /// the ray skips the instance.
    ///
    /// # Safety
    /// As for [`Self::enter_bottom`].
    #[inline(always)]
    pub unsafe fn admit(
        &mut self,
        facts: &mut InstanceFacts,
        top: &Level,
        index: u32,
        ray: &Ray,
    ) -> bool {
        let Some(words) = top.structure.instance_words(index) else {
            return false;
        };
        if words.state & instance_state::ACTIVE == 0
            || words.custom_index_and_mask >> 24 & ray.cull_mask & 0xFF == 0
        {
            return false;
        }
        // SAFETY: the caller guarantees that the contract of `Structure::at` holds.
        if !unsafe { self.find(top.structure.reference(index)) } {
            return false;
        }
        let structure = self.structure;
        let skip = match structure.kind() {
            Kind::Triangles | Kind::Swept | Kind::Motion => ray_flags::SKIP_TRIANGLES,
            Kind::Aabbs => ray_flags::SKIP_AABBS,
            Kind::Instances | Kind::MotionInstances => return false,
        };
        *facts = InstanceFacts::new(index, &words, ray);
        ray.flags & skip == 0 && facts.admits(&structure)
    }

    /// Moves the ray to the space of an instance of `top` that was entered.
    #[inline(always)]
    pub fn place(&mut self, top: &Level, index: u32, ray: &Ray, time: f32) -> bool {
        let Some(record) = top.structure.instance(index) else {
            return false;
        };
        if record.words.state & instance_state::IDENTITY != 0 {
            self.ray.set(ray.origin, ray.direction, ray.t_min, 0.0);
            return true;
        }
        let moved;
        let (mut to_world, mut to_object) = (&record.object_to_world, &record.world_to_object);
        if record.words.state & instance_state::MOVING != 0 {
            match top.structure.transforms(index, time) {
                Some(found) => moved = found,
                None => return false,
            }
            (to_world, to_object) = (&moved.0, &moved.1);
        }
        // From the instance's position, so that a far one costs no more than its distance from the
        // ray.
        let from = [
            ray.origin[0] - to_world[3],
            ray.origin[1] - to_world[7],
            ray.origin[2] - to_world[11],
        ];
        let (origin, direction) = (turn(to_object, &from), turn(to_object, &ray.direction));
        self.ray.set(origin, direction, ray.t_min, 0.0);
        true
    }
}

/// A vector times the 3 × 3 part of a row-major 3 × 4 matrix.
#[inline(always)]
pub(crate) fn turn(m: &[f32; 12], v: &[f32; 3]) -> [f32; 3] {
    [
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[4] * v[0] + m[5] * v[1] + m[6] * v[2],
        m[8] * v[0] + m[9] * v[1] + m[10] * v[2],
    ]
}

/// The instance of a top level that has but one.
#[inline(always)]
pub(crate) fn only_instance(top: &Level) -> Option<u32> {
    let [first, second, ..] = top.structure.node(0)?.children();
    let one = second == child::NONE && first & child::LEAF != 0;
    (one && first != child::NONE && top.structure.node_count() == 1).then_some(first & child::INDEX)
}
