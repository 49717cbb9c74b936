#version 460
#include "scene.glsl"
#include "procedural.glsl"

layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec3 outward;

void main() {
    Procedural self = procedurals[gl_InstanceCustomIndexEXT + gl_PrimitiveID];
    shade_procedural(surface, self, gl_ObjectToWorldEXT, gl_WorldRayOriginEXT, gl_WorldRayDirectionEXT, gl_HitTEXT, outward);
}
