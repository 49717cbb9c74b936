//! Facts from an instance's record and the ray's flags about candidates.

use crate::layout::{InstanceWords, features, geometry_word, instance_flags};
use crate::micromap::Opacity;
use crate::ray::{
    HIT_KIND_BACK_FACING_TRIANGLE, HIT_KIND_FRONT_FACING_TRIANGLE, Hit, Ray, ray_flags,
};
use crate::structure::Structure;

/// The instance that a walk is in, as its candidates see it. Flags are looked at where they count:
/// most walks never do.
#[derive(Clone, Copy)]
pub(crate) struct InstanceFacts {
    pub index: u32,
    custom_index: u32,
    sbt_offset: u32,
    /// Bits of [`instance_flags`].
    flags: u32,
    /// Bits of [`ray_flags`].
    ray_flags: u32,
    /// `Some`: every geometry is, or is not, opaque.
    opaque: Option<bool>,
    /// Every triangle that is hit counts: all are opaque, none by a micromap, and none is culled
    /// for its facing.
    pub all_opaque: bool,
    /// No triangle is culled.
    pub is_plain: bool,
    /// Micromaps may say where triangles are opaque.
    pub has_micromaps: bool,
}

/// Whether flags make everything opaque, or not opaque: by the ray's two lowest bits (`OPAQUE`,
/// `NO_OPAQUE`), which come first, then the instance's `FORCE_OPAQUE` and `FORCE_NO_OPAQUE`.
const FORCED: [[Option<bool>; 4]; 4] = [
    [None, Some(true), Some(false), Some(true)],
    [Some(true); 4],
    [Some(false); 4],
    [Some(true); 4],
];

const _: () = assert!(instance_flags::FORCE_NO_OPAQUE == 2 * instance_flags::FORCE_OPAQUE);

impl InstanceFacts {
    /// In no instance.
    pub const NONE: InstanceFacts = InstanceFacts {
        index: 0,
        custom_index: 0,
        sbt_offset: 0,
        flags: 0,
        ray_flags: 0,
        opaque: None,
        all_opaque: false,
        is_plain: false,
        has_micromaps: false,
    };

    #[inline(always)]
    pub fn new(index: u32, words: &InstanceWords, ray: &Ray) -> InstanceFacts {
        let flags = words.sbt_offset_and_flags >> 24;
        let by_ray = ray.flags & (ray_flags::OPAQUE | ray_flags::NO_OPAQUE);
        let by_instance = (flags / instance_flags::FORCE_OPAQUE) & 3;
        InstanceFacts {
            index,
            custom_index: words.custom_index_and_mask & 0xFF_FFFF,
            sbt_offset: words.sbt_offset_and_flags & 0xFF_FFFF,
            flags,
            ray_flags: ray.flags,
            opaque: FORCED[by_ray as usize][by_instance as usize],
            all_opaque: false,
            is_plain: false,
            has_micromaps: false,
        }
    }

    /// Finds out whether a structure can have a candidate at all, and whether every triangle of it
    /// counts.
    #[inline(always)]
    pub fn admits(&mut self, structure: &Structure) -> bool {
        let has = structure.features();
        let (opaque, not_opaque) = match self.opaque {
            Some(opaque) => (opaque, !opaque),
            None => (has & features::OPAQUE != 0, has & features::NOT_OPAQUE != 0),
        };
        let culls = self.ray_flags
            & (ray_flags::CULL_BACK_FACING_TRIANGLES
                | ray_flags::CULL_FRONT_FACING_TRIANGLES
                | ray_flags::CULL_OPAQUE
                | ray_flags::CULL_NO_OPAQUE);
        self.has_micromaps = structure.micromap_bytes() != 0 && !self.ignores_micromaps();
        self.is_plain = culls == 0;
        if self.is_plain {
            self.all_opaque = !not_opaque && !self.has_micromaps;
            return opaque || not_opaque;
        }
        self.all_opaque = false;
        opaque && culls & ray_flags::CULL_OPAQUE == 0
            || not_opaque && culls & ray_flags::CULL_NO_OPAQUE == 0
    }

    fn ignores_micromaps(&self) -> bool {
        self.flags & instance_flags::DISABLE_OPACITY_MICROMAPS != 0
            || self.ray_flags & ray_flags::IGNORE_OPACITY_MICROMAPS != 0
    }

    /// Whether a geometry is opaque to this ray; `None` if it is culled for that.
    #[inline(always)]
    pub fn opacity(&self, geometry: u32) -> Option<bool> {
        self.unless_culled(geometry & geometry_word::OPAQUE != 0)
    }

    /// Whether micromaps say of all points that they are opaque or transparent: then no shader is
    /// asked about triangles that have one.
    pub fn is_settled(&self) -> bool {
        let two_states = self.opaque == Some(true) || self.sees_two_states();
        self.is_plain && self.has_micromaps && two_states && self.opaque != Some(false)
    }

    /// Whether streams take rays through triangles: shaders are asked about few, if any.
    pub fn suits_streams(&self) -> bool {
        let by_micromap = self.is_plain && self.has_micromaps && self.opaque != Some(false);
        self.all_opaque || by_micromap
    }

    /// Whether a micromap decides what is opaque of a geometry.
    #[inline(always)]
    pub fn uses_micromap(&self, geometry: u32) -> bool {
        geometry & geometry_word::MICROMAP != 0 && !self.ignores_micromaps()
    }

    /// Whether a point of this opacity is opaque to this ray; `None` if it is no candidate.
    pub fn micromap_opacity(&self, opacity: Opacity) -> Option<bool> {
        match self.micromap_state(opacity) {
            Opacity::Transparent => None,
            Opacity::Opaque => self.unless_culled(true),
            Opacity::UnknownTransparent | Opacity::UnknownOpaque => self.unless_culled(false),
        }
    }

    /// Whether a point of this opacity is transparent to this ray.
    pub fn is_transparent(&self, opacity: Opacity) -> bool {
        self.micromap_state(opacity) == Opacity::Transparent
    }

    /// An opacity with as many states as this ray sees.
    fn micromap_state(&self, opacity: Opacity) -> Opacity {
        if self.sees_two_states() {
            opacity.in_two_states()
        } else {
            opacity
        }
    }

    fn sees_two_states(&self) -> bool {
        self.flags & instance_flags::FORCE_OPACITY_MICROMAP_2_STATE != 0
            || self.ray_flags & ray_flags::FORCE_OPACITY_MICROMAP_2_STATE != 0
    }

    #[inline(always)]
    fn unless_culled(&self, opaque: bool) -> Option<bool> {
        let opaque = self.opaque.unwrap_or(opaque);
        let culls = if opaque {
            ray_flags::CULL_OPAQUE
        } else {
            ray_flags::CULL_NO_OPAQUE
        };
        (self.ray_flags & culls == 0).then_some(opaque)
    }

    /// Whether a triangle whose winding has this front counts as seen from its front; `None` if
    /// it is culled for its facing.
    #[inline(always)]
    pub fn facing(&self, front: bool) -> Option<bool> {
        let front = front != self.flips_facing();
        let culls = if front {
            ray_flags::CULL_FRONT_FACING_TRIANGLES
        } else {
            ray_flags::CULL_BACK_FACING_TRIANGLES
        };
        let culled = self.ray_flags & culls != 0
            && self.flags & instance_flags::TRIANGLE_FACING_CULL_DISABLE == 0;
        (!culled).then_some(front)
    }

    #[inline(always)]
    fn flips_facing(&self) -> bool {
        self.flags & instance_flags::TRIANGLE_FLIP_FACING != 0
    }

    /// The hit kind of a triangle whose winding has this front, culled or not.
    #[inline(always)]
    pub fn hit_kind(&self, front: bool) -> u8 {
        if front != self.flips_facing() {
            HIT_KIND_FRONT_FACING_TRIANGLE
        } else {
            HIT_KIND_BACK_FACING_TRIANGLE
        }
    }

    /// A hit with the instance's facts.
    #[inline(always)]
    pub fn hit(&self) -> Hit {
        Hit {
            instance_index: self.index,
            instance_custom_index: self.custom_index,
            instance_sbt_offset: self.sbt_offset,
            ..Hit::default()
        }
    }
}
