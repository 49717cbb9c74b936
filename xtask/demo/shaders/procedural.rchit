#version 460
#include "scene.glsl"

layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec3 outward;

void main() {
    Procedural self = procedurals[gl_InstanceCustomIndexEXT + gl_PrimitiveID];
    Material material = materials[self.material];
    vec3 normal = normal_by(gl_ObjectToWorldEXT, outward);
    bool from_inside = dot3(normal, gl_WorldRayDirectionEXT) > 0.0;
    precise vec3 way = gl_WorldRayDirectionEXT * gl_HitTEXT;
    precise vec3 position = gl_WorldRayOriginEXT + way;
    surface.position = position;
    if (from_inside) {
        normal = -normal;
    }
    surface.normal = normal;
    surface.t = gl_HitTEXT;
    surface.face = normal;
    surface.roughness = material.roughness;
    surface.albedo = material.base_color;
    surface.metallic = material.metallic;
    surface.emission = material.emission;
    surface.ior = material.kind == GLASS ? material.ior : 0.0;
    surface.absorption = material.absorption;
    surface.translucency = 0.0;
    surface.leaving = from_inside;
}
