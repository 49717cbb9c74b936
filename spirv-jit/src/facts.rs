//! Facts that shaders may query of a hit: the only table of them, for built-ins of hit shaders,
//! getters of ray queries and of hit objects. Three maps lead here:
//! [`Builtin::fact`](crate::ir::stage::Builtin::fact), and those of the instructions in
//! `lower/facts.rs`.
#![forbid(unsafe_code)]

use crate::types::Type;

macro_rules! facts {
    ($($(#[$doc:meta])* $variant:ident $text:literal $words:literal $ty:ident;)*) => {
        /// Something about a hit.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Fact {
            $($(#[$doc])* $variant,)*
        }

        impl Fact {
            /// All of them.
            pub const ALL: &[Fact] = &[$(Fact::$variant,)*];

            /// Name in the IR's text form.
            pub const fn text(self) -> &'static str {
                match self {
                    $(Fact::$variant => $text,)*
                }
            }

            /// The fact of that name.
            pub fn from_text(text: &str) -> Option<Fact> {
                match text {
                    $($text => Some(Fact::$variant),)*
                    _ => None,
                }
            }

            /// Words of the answer.
            pub const fn words(self) -> usize {
                match self {
                    $(Fact::$variant => $words,)*
                }
            }

            /// Type of each.
            pub const fn ty(self) -> Type {
                match self {
                    $(Fact::$variant => Type::$ty,)*
                }
            }
        }
    };
}

facts! {
    /// Ray queries. Candidate: 0 triangle, 1 box; committed: 0 none, 1 triangle, 2 generated.
    IntersectionType "intersection_type" 1 I32;
    /// The distance.
    T "t" 1 F32;
    /// The 24 bits that the application gave the instance.
    InstanceCustomIndex "instance_custom_index" 1 I32;
    /// The instance's index in the top level.
    InstanceId "instance_id" 1 I32;
    /// The instance's offset into the hit records.
    InstanceSbtOffset "instance_sbt_offset" 1 I32;
    /// The geometry's index in the bottom level.
    GeometryIndex "geometry_index" 1 I32;
    /// The primitive's index in the geometry.
    PrimitiveIndex "primitive_index" 1 I32;
    /// Of a triangle: the weights of the second and third vertex.
    Barycentrics "barycentrics" 2 F32;
    /// 1 for a triangle that faces the ray's origin.
    FrontFace "front_face" 1 I32;
    /// 1 for a box of opaque geometry.
    AabbOpaque "aabb_opaque" 1 I32;
    /// The ray in the instance's space.
    ObjectRayDirection "object_ray_direction" 3 F32;
    /// The ray in the instance's space.
    ObjectRayOrigin "object_ray_origin" 3 F32;
    /// Column-major 4 × 3.
    ObjectToWorld "object_to_world" 12 F32;
    /// Column-major 4 × 3.
    WorldToObject "world_to_object" 12 F32;
    /// Three positions.
    TriangleVertexPositions "triangle_vertex_positions" 9 F32;
    /// 0 or 1.
    IsSphere "is_sphere" 1 I32;
    /// 0 or 1: a linear swept sphere.
    IsLss "is_lss" 1 I32;
    /// Where along the axis.
    LssHitValue "lss_hit_value" 1 F32;
    /// Both ends; of a sphere the first is its middle.
    SweptPositions "swept_positions" 6 F32;
    /// At both ends.
    SweptRadii "swept_radii" 2 F32;
    /// The kind that the intersection shader reported, or the side of a triangle.
    HitKind "hit_kind" 1 I32;
    /// As a hit object has it: see [`word::HIT_KIND`](crate::hit_object::word::HIT_KIND).
    HitWord "hit_word" 1 I32;
    /// As a hit object has it: see [`word::SLOT`](crate::hit_object::word::SLOT).
    Slot "slot" 1 I32;
    /// Hit objects: the device address of the data in the shader record.
    ShaderRecord "shader_record" 2 I32;
}
