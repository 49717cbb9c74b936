#version 460
#include "scene.glsl"

layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec3 outward;

vec3 unit(vec3 v) {
    return v / sqrt(dot(v, v));
}

void main() {
    Material material = materials[procedurals[gl_InstanceCustomIndexEXT + gl_PrimitiveID].material];
    vec3 normal = unit(outward * mat3(gl_WorldToObjectEXT));
    bool from_inside = dot(normal, gl_WorldRayDirectionEXT) > 0.0;
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
