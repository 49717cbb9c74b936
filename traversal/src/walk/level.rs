//! Entering a structure: the ray in its space, and what the instance says about candidates.

use super::space::Space;
use crate::layout::{InstanceRecord, features, geometry_word, instance_flags, instance_state};
use crate::micromap::Opacity;
use crate::ray::{
    HIT_KIND_BACK_FACING_TRIANGLE, HIT_KIND_FRONT_FACING_TRIANGLE, Hit, Ray, ray_flags,
};
use crate::structure::{Kind, Structure};

/// A structure and the ray in its space.
#[derive(Clone, Copy)]
pub(crate) struct Level {
    pub structure: Structure,
    pub space: Space,
    /// The space is that of the level above, as it is there.
    pub shares_space: bool,
}

impl Level {
    /// A level with nothing in it, to be entered.
    pub const NOWHERE: Level = Level {
        structure: Structure::NOWHERE,
        space: Space::NOWHERE,
        shares_space: false,
    };

    /// Enters a top level; false if there is nothing to walk.
    ///
    /// # Safety
    /// `address` is 0 or a structure that stays as it is meanwhile.
    #[inline(always)]
    pub unsafe fn enter_top(&mut self, address: u64) -> bool {
        // SAFETY: the caller's promise.
        let Some(structure) = (unsafe { Structure::at(address) }) else {
            return false;
        };
        self.structure = structure;
        structure.kind() == Kind::Instances
    }

    /// Sets up the ray for the nodes of a top level that was entered.
    #[inline(always)]
    pub fn set_up_top(&mut self, ray: &Ray) {
        let reach = ray.origin.iter().fold(0f32, |most, c| most.max(c.abs()));
        let uncertainty = self.structure.header().origin_error * reach;
        self.space
            .set(ray.origin, ray.direction, ray.t_min, uncertainty);
    }

    /// Enters the bottom level of an instance of `top`; false if the ray has no business there.
    /// `top_is_set_up`: the ray is ready in the space of `top`.
    ///
    /// # Safety
    /// The references of `top` are 0 or structures that stay as they are meanwhile.
    #[inline(always)]
    pub unsafe fn enter_bottom(
        &mut self,
        facts: &mut InstanceFacts,
        top: &Level,
        top_is_set_up: bool,
        index: u32,
        ray: &Ray,
    ) -> bool {
        let Some(record) = top.structure.instance(index) else {
            return false;
        };
        if record.state & instance_state::ACTIVE == 0
            || record.custom_index_and_mask >> 24 & ray.cull_mask & 0xFF == 0
        {
            return false;
        }
        // SAFETY: the caller's promise.
        let Some(structure) = (unsafe { Structure::at(top.structure.reference(index)) }) else {
            return false;
        };
        let skip = match structure.kind() {
            Kind::Triangles => ray_flags::SKIP_TRIANGLES,
            Kind::Aabbs => ray_flags::SKIP_AABBS,
            Kind::Instances => return false,
        };
        *facts = InstanceFacts::new(index, record, ray);
        if ray.flags & skip != 0 || !facts.admits(&structure) {
            return false;
        }
        facts.look_into(&structure);
        self.structure = structure;
        if record.state & instance_state::IDENTITY != 0 {
            self.shares_space = top_is_set_up && top.structure.header().origin_error == 0.0;
            if !self.shares_space {
                self.space.set(ray.origin, ray.direction, ray.t_min, 0.0);
            }
            return true;
        }
        self.shares_space = false;
        let (to_world, to_object) = (&record.object_to_world, &record.world_to_object);
        // From the instance's position, so that a far one costs no more than its distance from the
        // ray.
        let from = [
            ray.origin[0] - to_world[3],
            ray.origin[1] - to_world[7],
            ray.origin[2] - to_world[11],
        ];
        let (origin, direction) = (turn(to_object, &from), turn(to_object, &ray.direction));
        self.space.set(origin, direction, ray.t_min, 0.0);
        true
    }
}

/// A vector times the 3 × 3 part of a row-major 3 × 4 matrix.
#[inline(always)]
fn turn(m: &[f32; 12], v: &[f32; 3]) -> [f32; 3] {
    [
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[4] * v[0] + m[5] * v[1] + m[6] * v[2],
        m[8] * v[0] + m[9] * v[1] + m[10] * v[2],
    ]
}

/// What an instance's record and the ray's flags say about candidates.
#[derive(Clone, Copy, Default)]
pub(crate) struct InstanceFacts {
    pub index: u32,
    custom_index: u32,
    sbt_offset: u32,
    /// `Some`: every geometry is, or is not, opaque.
    opaque: Option<bool>,
    flip_facing: bool,
    cull_front: bool,
    cull_back: bool,
    cull_opaque: bool,
    cull_no_opaque: bool,
    ignore_micromaps: bool,
    two_states: bool,
    /// Every triangle that is hit counts: all are opaque, none by a micromap, and none is culled
    /// for its facing.
    pub takes_all: bool,
}

impl InstanceFacts {
    #[inline(always)]
    fn new(index: u32, record: &InstanceRecord, ray: &Ray) -> InstanceFacts {
        let flags = record.sbt_offset_and_flags >> 24;
        let instance = |bit: u32| flags & bit != 0;
        let ray = |bit: u32| ray.flags & bit != 0;
        let opaque = if ray(ray_flags::OPAQUE) {
            Some(true)
        } else if ray(ray_flags::NO_OPAQUE) {
            Some(false)
        } else if instance(instance_flags::FORCE_OPAQUE) {
            Some(true)
        } else if instance(instance_flags::FORCE_NO_OPAQUE) {
            Some(false)
        } else {
            None
        };
        let culls = !instance(instance_flags::TRIANGLE_FACING_CULL_DISABLE);
        InstanceFacts {
            index,
            custom_index: record.custom_index_and_mask & 0xFF_FFFF,
            sbt_offset: record.sbt_offset_and_flags & 0xFF_FFFF,
            opaque,
            flip_facing: instance(instance_flags::TRIANGLE_FLIP_FACING),
            cull_front: culls && ray(ray_flags::CULL_FRONT_FACING_TRIANGLES),
            cull_back: culls && ray(ray_flags::CULL_BACK_FACING_TRIANGLES),
            cull_opaque: ray(ray_flags::CULL_OPAQUE),
            cull_no_opaque: ray(ray_flags::CULL_NO_OPAQUE),
            ignore_micromaps: instance(instance_flags::DISABLE_OPACITY_MICROMAPS),
            two_states: instance(instance_flags::FORCE_OPACITY_MICROMAP_2_STATE)
                || ray(ray_flags::FORCE_OPACITY_MICROMAP_2_STATE),
            takes_all: false,
        }
    }

    /// Finds out whether every triangle of a structure that is admitted counts.
    #[inline(always)]
    fn look_into(&mut self, structure: &Structure) {
        let header = structure.header();
        let all_opaque = self
            .opaque
            .unwrap_or(header.features & features::NOT_OPAQUE == 0);
        let micromaps = header.micromap_bytes != 0 && !self.ignore_micromaps;
        self.takes_all = all_opaque && !micromaps && !self.cull_front && !self.cull_back;
    }

    /// Whether a geometry is opaque to this ray; `None` if it is culled for that.
    #[inline(always)]
    pub fn opacity(&self, geometry: u32) -> Option<bool> {
        self.unless_culled(geometry & geometry_word::OPAQUE != 0)
    }

    /// Whether a micromap decides what is opaque of a geometry.
    #[inline(always)]
    pub fn heeds_micromap(&self, geometry: u32) -> bool {
        geometry & geometry_word::MICROMAP != 0 && !self.ignore_micromaps
    }

    /// Whether a point of this opacity is opaque to this ray; `None` if it is no candidate.
    pub fn micromap_opacity(&self, opacity: Opacity) -> Option<bool> {
        let opacity = if self.two_states {
            opacity.in_two_states()
        } else {
            opacity
        };
        match opacity {
            Opacity::Transparent => None,
            Opacity::Opaque => self.unless_culled(true),
            Opacity::UnknownTransparent | Opacity::UnknownOpaque => self.unless_culled(false),
        }
    }

    #[inline(always)]
    fn unless_culled(&self, opaque: bool) -> Option<bool> {
        let opaque = self.opaque.unwrap_or(opaque);
        let culled = if opaque {
            self.cull_opaque
        } else {
            self.cull_no_opaque
        };
        (!culled).then_some(opaque)
    }

    /// Whether a triangle whose winding has this front counts as seen from its front; `None` if
    /// it is culled for its facing.
    #[inline(always)]
    pub fn facing(&self, front: bool) -> Option<bool> {
        let front = front != self.flip_facing;
        let culled = if front {
            self.cull_front
        } else {
            self.cull_back
        };
        (!culled).then_some(front)
    }

    /// What a triangle whose winding has this front is called, culled or not.
    #[inline(always)]
    pub fn hit_kind(&self, front: bool) -> u8 {
        if front != self.flip_facing {
            HIT_KIND_FRONT_FACING_TRIANGLE
        } else {
            HIT_KIND_BACK_FACING_TRIANGLE
        }
    }

    /// A hit with what the instance knows of it.
    #[inline(always)]
    pub fn hit(&self) -> Hit {
        Hit {
            instance_index: self.index,
            instance_custom_index: self.custom_index,
            instance_sbt_offset: self.sbt_offset,
            ..Hit::default()
        }
    }

    /// Whether a structure with these features can have a candidate at all.
    #[inline(always)]
    fn admits(&self, structure: &Structure) -> bool {
        let has = structure.header().features;
        let (opaque, not_opaque) = match self.opaque {
            Some(opaque) => (opaque, !opaque),
            None => (has & features::OPAQUE != 0, has & features::NOT_OPAQUE != 0),
        };
        opaque && !self.cull_opaque || not_opaque && !self.cull_no_opaque
    }
}
