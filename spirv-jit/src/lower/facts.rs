//! The fact that each instruction reads.

use rspirv::spirv::Op;

use crate::facts::Fact;

/// The fact that a getter of a ray query's intersection reads.
pub(super) fn of_query(opcode: Op) -> Option<Fact> {
    Some(match opcode {
        Op::RayQueryGetIntersectionTypeKHR => Fact::IntersectionType,
        Op::RayQueryGetIntersectionTKHR => Fact::T,
        Op::RayQueryGetIntersectionInstanceCustomIndexKHR => Fact::InstanceCustomIndex,
        Op::RayQueryGetIntersectionInstanceIdKHR => Fact::InstanceId,
        Op::RayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetKHR => {
            Fact::InstanceSbtOffset
        }
        Op::RayQueryGetIntersectionGeometryIndexKHR => Fact::GeometryIndex,
        Op::RayQueryGetIntersectionPrimitiveIndexKHR => Fact::PrimitiveIndex,
        Op::RayQueryGetIntersectionBarycentricsKHR => Fact::Barycentrics,
        Op::RayQueryGetIntersectionFrontFaceKHR => Fact::FrontFace,
        Op::RayQueryGetIntersectionCandidateAABBOpaqueKHR => Fact::AabbOpaque,
        Op::RayQueryGetIntersectionObjectRayDirectionKHR => Fact::ObjectRayDirection,
        Op::RayQueryGetIntersectionObjectRayOriginKHR => Fact::ObjectRayOrigin,
        Op::RayQueryGetIntersectionObjectToWorldKHR => Fact::ObjectToWorld,
        Op::RayQueryGetIntersectionWorldToObjectKHR => Fact::WorldToObject,
        Op::RayQueryGetIntersectionTriangleVertexPositionsKHR => Fact::TriangleVertexPositions,
        Op::RayQueryIsSphereHitNV => Fact::IsSphere,
        Op::RayQueryIsLSSHitNV => Fact::IsLss,
        Op::RayQueryGetIntersectionLSSHitValueNV => Fact::LssHitValue,
        Op::RayQueryGetIntersectionSpherePositionNV | Op::RayQueryGetIntersectionLSSPositionsNV => {
            Fact::SweptPositions
        }
        Op::RayQueryGetIntersectionSphereRadiusNV | Op::RayQueryGetIntersectionLSSRadiiNV => {
            Fact::SweptRadii
        }
        _ => return None,
    })
}

/// The fact that a getter of a hit object queries: its first words, as many as the result has.
pub(super) fn of_hit_object(opcode: Op) -> Option<Fact> {
    Some(match opcode {
        Op::HitObjectGetSpherePositionNV | Op::HitObjectGetLSSPositionsNV => Fact::SweptPositions,
        Op::HitObjectGetSphereRadiusNV | Op::HitObjectGetLSSRadiiNV => Fact::SweptRadii,
        Op::HitObjectGetInstanceCustomIndexNV | Op::HitObjectGetInstanceCustomIndexEXT => {
            Fact::InstanceCustomIndex
        }
        Op::HitObjectGetObjectToWorldNV | Op::HitObjectGetObjectToWorldEXT => Fact::ObjectToWorld,
        Op::HitObjectGetWorldToObjectNV | Op::HitObjectGetWorldToObjectEXT => Fact::WorldToObject,
        Op::HitObjectGetIntersectionTriangleVertexPositionsEXT => Fact::TriangleVertexPositions,
        Op::HitObjectGetShaderRecordBufferHandleNV
        | Op::HitObjectGetShaderRecordBufferHandleEXT => Fact::ShaderRecord,
        _ => return None,
    })
}
