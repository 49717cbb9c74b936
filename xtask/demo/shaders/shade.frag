#version 460
#define RASTER
#include "scene.glsl"
#include "triangle.glsl"
#include "surface.glsl"
#include "procedural.glsl"
#include "sphere.glsl"
#include "sponge.glsl"
#include "random.glsl"
#include "leaf.glsl"
#include "sky.glsl"
#include "ray.glsl"
#include "raster.glsl"
#include "meeting.glsl"

layout(set = 1, binding = 2) uniform usampler2D seen;
layout(location = 0) out vec4 color;

// Whether the sun shines on a point: 1 or 0.
float sunlight(vec3 origin, vec3 direction) {
    rayQueryEXT query;
    rayQueryInitializeEXT(query, world, gl_RayFlagsTerminateOnFirstHitEXT, MASK_BLOCKS_LIGHT, origin, 0.0, direction, 1e30);
    while (rayQueryProceedEXT(query)) {
        mat4x3 to_world = rayQueryGetIntersectionObjectToWorldEXT(query, false);
        uint custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, false);
        uint primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, false);
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            Geometry geometry = geometries[custom_index + rayQueryGetIntersectionGeometryIndexEXT(query, false)];
            Triangle triangle = triangle_of(geometry, primitive);
            vec3 otherwise = vec3(rayQueryGetIntersectionBarycentricsEXT(query, false), rayQueryGetIntersectionTEXT(query, false));
            Meeting meeting = meet(triangle, to_world, origin, direction, otherwise);
            if (triangle.material.kind != GLASS && !has_hole(triangle, primitive, meeting.weights, direction)) {
                rayQueryConfirmIntersectionEXT(query);
            }
            continue;
        }
        Procedural self = procedurals[custom_index + primitive];
        if (rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(query, false) == SPONGE) {
            vec3 outward;
            float t = sponge_meeting(self, to_world, origin, direction, 0.0, outward);
            if (t >= 0.0) {
                rayQueryGenerateIntersectionEXT(query, t);
            }
            continue;
        }
        Chord c = chord(self, to_world, origin, direction);
        for (int side = 0; side < 2; side++) {
            float t = end_of(c, side);
            if (c.half_chord >= 0.0 && t > 0.0 && !lets_light_through(self, to_world, outward_at(c, t), direction)) {
                rayQueryGenerateIntersectionEXT(query, t);
                break;
            }
        }
    }
    return rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionNoneEXT ? 1.0 : 0.0;
}

// What a mirror shows where rays are followed no further: the sky, and the ground below it.
vec3 mirrored_sky(vec3 direction) {
    return sky_towards(vec3(direction.x, abs(direction.y), direction.z), 0.2) * (direction.y < 0.0 ? 0.3 : 1.0);
}

vec3 lit(Surface surface, vec3 direction) {
    float cosine = clamp(-dot3(surface.normal, direction), 0.0, 1.0);
    vec3 mirror = mirrored_sky(mirrored(direction, surface.normal));
    vec3 up = mix(haze.xyz * 0.25, vec3(0.42, 0.56, 0.82), 0.5 + 0.5 * surface.normal.y);
    if (surface.ior > 0.0) {
        // What is behind is taken for something grey in the light of the sky, a little way off.
        float reflected = fresnel(cosine, surface.leaving ? surface.ior : 1.0 / surface.ior);
        return mix(surface.albedo * exp(-2.0 * surface.absorption) * up * 0.6, mirror, reflected);
    }
    precise float towards_sun = dot3(surface.normal, sun_direction.xyz);
    bool same_side = dot3(surface.face, sun_direction.xyz) > 0.0;
    float share = same_side ? 1.0 - surface.translucency : surface.translucency;
    float facing = share * (same_side ? max(towards_sun, 0.0) : abs(towards_sun)) * (1.0 - surface.metallic);
    vec3 light = up * 0.55;
    if (facing > 0.0) {
        vec3 origin = leave(surface.position, same_side ? surface.face : -surface.face, surface.t);
        light += sun_irradiance.xyz * (facing * sunlight(origin, sun_direction.xyz) / PI);
    }
    return surface.emission + surface.albedo * mix(light, mirror, surface.metallic);
}

void main() {
    uvec4 what = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    vec3 origin = camera_position.xyz;
    vec3 direction = towards(gl_FragCoord.xy);
    if (what.x == 0u) {
        color = vec4(sky_towards(direction, camera_position.w) + disc_towards(direction), 1.0);
        return;
    }
    uint instance = what.x - 1u;
    mat4x3 to_world = transform_of(instance);
    Surface surface;
    surface.cone_width = 0.0;
    surface.cone_spread = camera_position.w;
    if (instances[instance].hit_group == 0u) {
        Triangle triangle = triangle_of(geometries[what.y], what.z);
        precise float depth = uintBitsToFloat(what.w) * dot3(direction, camera_forward.xyz);
        shade(surface, triangle, meet(triangle, to_world, origin, direction, vec3(0.0, 0.0, NEAR / depth)), to_world, direction);
    } else {
        vec3 outward;
        float t = procedural_meeting(what.y, instance, origin, direction, outward);
        shade_procedural(surface, procedurals[what.y], to_world, origin, direction, t, outward);
    }
    float through = exp(-haze.w * surface.t);
    color = vec4(mix(haze.xyz, lit(surface, direction), through), 1.0);
}
