#version 460
#include "scene.glsl"

layout(location = 0) rayPayloadInEXT uvec4 seen;

void main() {
    seen = uvec4(gl_InstanceID + 1, gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT, gl_PrimitiveID, floatBitsToUint(gl_HitTEXT));
}
