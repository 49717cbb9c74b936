//! A ray, its flags, and what it hit.

/// The bits of [`Ray::flags`]: SPIR-V's `Ray Flags`, verbatim.
pub mod ray_flags {
    /// Every geometry counts as opaque.
    pub const OPAQUE: u32 = 0x1;
    /// Every geometry counts as not opaque.
    pub const NO_OPAQUE: u32 = 0x2;
    /// The first accepted hit ends the walk.
    pub const TERMINATE_ON_FIRST_HIT: u32 = 0x4;
    /// No closest-hit shader runs; the walk itself ignores this bit.
    pub const SKIP_CLOSEST_HIT_SHADER: u32 = 0x8;
    /// Back-facing triangles are no candidates.
    pub const CULL_BACK_FACING_TRIANGLES: u32 = 0x10;
    /// Front-facing triangles are no candidates.
    pub const CULL_FRONT_FACING_TRIANGLES: u32 = 0x20;
    /// Opaque geometry is no candidate.
    pub const CULL_OPAQUE: u32 = 0x40;
    /// Geometry that is not opaque is no candidate.
    pub const CULL_NO_OPAQUE: u32 = 0x80;
    /// All that opacity decides about.
    pub const OPACITY: u32 = OPAQUE | NO_OPAQUE | CULL_OPAQUE | CULL_NO_OPAQUE;
    /// Triangles, spheres and linear swept spheres are no candidates.
    pub const SKIP_TRIANGLES: u32 = 0x100;
    /// Boxes are no candidates.
    pub const SKIP_AABBS: u32 = 0x200;
    /// Micromaps have two states: unknown ones become transparent or opaque.
    pub const FORCE_OPACITY_MICROMAP_2_STATE: u32 = 0x400;
    /// Micromaps are not looked at, as by instances that disable them. Not a flag of SPIR-V.
    pub const IGNORE_OPACITY_MICROMAPS: u32 = 1 << 31;
}

/// `hit_kind` of a triangle seen from its front.
pub const HIT_KIND_FRONT_FACING_TRIANGLE: u8 = 0xFE;
/// `hit_kind` of a triangle seen from its back.
pub const HIT_KIND_BACK_FACING_TRIANGLE: u8 = 0xFF;

/// `hit_kind` of a linear swept sphere. SPIR-V leaves the number to the driver, as for the next.
pub const HIT_KIND_LINEAR_SWEPT_SPHERE: u8 = 0xFC;
/// `hit_kind` of a sphere.
pub const HIT_KIND_SPHERE: u8 = 0xFD;

/// Whether a hit is one of the round primitives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Swept {
    #[default]
    No,
    Sphere,
    LinearSweptSphere,
}

/// A ray in world space and the rules for its walk.
///
/// The interval is open for triangles (`t_min < t < t_max`) and closed for boxes. The direction
/// may have any length; `t` counts in its units. A ray with a component that is not finite (`t_max`
/// may be infinite) hits nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: [f32; 3],
    /// Lower end of the interval, at least 0.
    pub t_min: f32,
    /// Where it goes; any length.
    pub direction: [f32; 3],
    /// Upper end of the interval; may be infinite.
    pub t_max: f32,
    /// Bits of [`ray_flags`].
    pub flags: u32,
    /// An instance takes part if its mask shares a bit with this; the low eight bits count.
    pub cull_mask: u32,
}

impl Ray {
    /// No ray: all zero.
    pub(crate) const NONE: Ray = Ray {
        origin: [0.0; 3],
        t_min: 0.0,
        direction: [0.0; 3],
        t_max: 0.0,
        flags: 0,
        cull_mask: 0,
    };
}

/// A point where a ray meets a primitive: a candidate, or the hit that is committed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray's direction. For a box that is a candidate: the ray's `t_min`.
    pub t: f32,
    /// Weights of a triangle's second and third vertex; of a linear swept sphere the position along
    /// its axis, 0 and 1 on its end caps; 0 for the others.
    pub barycentrics: [f32; 2],
    /// Position of the instance in the build's input: `InstanceId`.
    pub instance_index: u32,
    /// 24 bits the application gave the instance: `InstanceCustomIndexKHR`.
    pub instance_custom_index: u32,
    /// The instance's 24-bit offset into the hit group records.
    pub instance_sbt_offset: u32,
    /// Geometry within the bottom level: `RayGeometryIndexKHR`.
    pub geometry_index: u32,
    /// Primitive within the geometry: `PrimitiveId`.
    pub primitive_index: u32,
    /// Where the primitive lies in its bottom level's blob; for
    /// [`Structure::triangle_vertices`](crate::Structure::triangle_vertices).
    pub slot: u32,
    /// 0xFE and 0xFF for triangles (front, back), what the shader reported for boxes.
    pub hit_kind: u8,
    /// Opaque after the geometry's, the instance's and the ray's flags: no any-hit shader runs.
    pub opaque: bool,
    /// A triangle.
    pub triangle: bool,
    /// The swept primitive, if it is neither a triangle nor a box.
    pub swept: Swept,
}

impl Hit {
    /// The `slot` of a hit that no walk found.
    pub const UNKNOWN_SLOT: u32 = u32::MAX;

    /// The placeholder of a missing hit: all zero.
    pub const NONE: Hit = Hit {
        t: 0.0,
        barycentrics: [0.0; 2],
        instance_index: 0,
        instance_custom_index: 0,
        instance_sbt_offset: 0,
        geometry_index: 0,
        primitive_index: 0,
        slot: 0,
        hit_kind: 0,
        opaque: false,
        triangle: false,
        swept: Swept::No,
    };

    /// Whether this is to be preferred to another hit at the same distance. Among opaque primitives
    /// that traversal finds, the one with the least instance, geometry and primitive is, so that
    /// the order of the walk does not show.
    #[inline(always)]
    pub(crate) fn wins_tie(&self, other: &Hit) -> bool {
        let key = |hit: &Hit| (hit.instance_index, hit.geometry_index, hit.primitive_index);
        self.opaque && other.opaque && other.is_built_in() && key(self) < key(other)
    }

    /// Traversal found it, not an intersection shader.
    #[inline]
    pub fn is_built_in(&self) -> bool {
        self.triangle || self.swept != Swept::No
    }
}
