#version 460
#include "scene.glsl"
#include "triangle.glsl"
#include "surface.glsl"

layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec2 barycentrics;

void main() {
    Geometry geometry = geometries[gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT];
    Triangle triangle = triangle_of(geometry, gl_PrimitiveID);
    Meeting meeting = meet(triangle, gl_ObjectToWorldEXT, gl_WorldRayOriginEXT, gl_WorldRayDirectionEXT, vec3(barycentrics, gl_HitTEXT));
    shade(surface, triangle, meeting, gl_ObjectToWorldEXT, gl_WorldRayDirectionEXT);
}
