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

// What a ray meets first; light passes glass.
struct Found {
    uint instance; // and one more; 0 for nothing
    uint model;    // a geometry's index, or a procedural's
    uint primitive;
    vec3 otherwise; // barycentrics and distance
};

Found met(vec3 origin, vec3 direction, bool is_light) {
    rayQueryEXT query;
    rayQueryInitializeEXT(query, world, is_light ? gl_RayFlagsTerminateOnFirstHitEXT : gl_RayFlagsNoneEXT,
        is_light ? MASK_BLOCKS_LIGHT : MASK_ALL, origin, 0.0, direction, 1e30);
    float nearest = 1e30;
    while (rayQueryProceedEXT(query)) {
        mat4x3 to_world = rayQueryGetIntersectionObjectToWorldEXT(query, false);
        uint custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, false);
        uint primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, false);
        if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
            nearest = rayQueryGetIntersectionTEXT(query, true);
        }
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            Geometry geometry = geometries[custom_index + rayQueryGetIntersectionGeometryIndexEXT(query, false)];
            Triangle triangle = triangle_of(geometry, primitive);
            vec3 otherwise = vec3(rayQueryGetIntersectionBarycentricsEXT(query, false), rayQueryGetIntersectionTEXT(query, false));
            Meeting meeting = meet(triangle, to_world, origin, direction, otherwise);
            bool is_glass = triangle.material.kind == GLASS;
            if (is_glass ? !is_light : !has_hole(triangle, primitive, meeting.weights, direction)) {
                rayQueryConfirmIntersectionEXT(query);
            }
            continue;
        }
        Procedural self = procedurals[custom_index + primitive];
        if (rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(query, false) == SPONGE) {
            vec3 outward;
            float t = sponge_meeting(self, to_world, origin, direction, 0.0, outward);
            if (t >= 0.0 && t <= nearest) {
                rayQueryGenerateIntersectionEXT(query, t);
            }
            continue;
        }
        Chord c = chord(self, to_world, origin, direction);
        for (int side = 0; side < 2; side++) {
            float t = end_of(c, side);
            if (c.half_chord >= 0.0 && t > 0.0 && t <= nearest
                && !(is_light && lets_light_through(self, to_world, outward_at(c, t), direction))) {
                rayQueryGenerateIntersectionEXT(query, t);
                break;
            }
        }
    }
    Found found = Found(0u, 0u, 0u, vec3(0.0));
    if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
        found.instance = uint(rayQueryGetIntersectionInstanceIdEXT(query, true)) + 1u;
        found.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
        found.model = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true)
            + rayQueryGetIntersectionGeometryIndexEXT(query, true);
        found.otherwise.z = rayQueryGetIntersectionTEXT(query, true);
        if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT) {
            found.otherwise.xy = rayQueryGetIntersectionBarycentricsEXT(query, true);
        }
    }
    return found;
}

// The light of the sky from above, and of the ground from below.
vec3 around(vec3 normal) {
    return mix(haze.xyz * 0.25, vec3(0.42, 0.56, 0.82), 0.5 + 0.5 * normal.y);
}

// What a rough surface sends back of the sun and of the sky.
vec3 diffuse(Surface surface) {
    precise float towards_sun = dot3(surface.normal, sun_direction.xyz);
    bool same_side = dot3(surface.face, sun_direction.xyz) > 0.0;
    float share = same_side ? 1.0 - surface.translucency : surface.translucency;
    float facing = share * (same_side ? max(towards_sun, 0.0) : abs(towards_sun));
    vec3 light = around(surface.normal) * 0.55;
    if (facing > 0.0) {
        vec3 origin = leave(surface.position, same_side ? surface.face : -surface.face, surface.t);
        if (met(origin, sun_direction.xyz, true).instance == 0u) {
            light += sun_irradiance.xyz * (facing / PI);
        }
    }
    return surface.albedo * light;
}

// Mirrors and glass are followed this far: of what a surface both reflects and lets through, only the brighter part.
const int MAX_MIRRORS = 5;

void main() {
    uvec4 seen_here = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    vec3 origin = camera_position.xyz;
    vec3 direction = towards(gl_FragCoord.xy);
    precise float depth = uintBitsToFloat(seen_here.w) * dot3(direction, camera_forward.xyz);
    Found found = Found(seen_here.x, seen_here.y, seen_here.z, vec3(0.0, 0.0, NEAR / depth));
    vec3 light = vec3(0.0);
    vec3 throughput = vec3(1.0);
    vec3 absorption = vec3(0.0);
    Surface surface;
    surface.cone_width = 0.0;
    surface.cone_spread = camera_position.w;
    for (int mirrors = 0; ; mirrors++) {
        if (found.instance == 0u) {
            vec3 sky = sky_towards(direction, surface.cone_spread) + disc_towards(direction);
            light += throughput * (mirrors == 0 ? sky : min(sky, vec3(MAX_INDIRECT)));
            break;
        }
        uint instance = found.instance - 1u;
        mat4x3 to_world = transform_of(instance);
        if (instances[instance].hit_group == 0u) {
            Triangle triangle = triangle_of(geometries[found.model], found.primitive);
            shade(surface, triangle, meet(triangle, to_world, origin, direction, found.otherwise), to_world, direction);
        } else {
            vec3 outward;
            float t = procedural_meeting(found.model, instance, origin, direction, outward);
            shade_procedural(surface, procedurals[found.model], to_world, origin, direction, t, outward);
        }
        if (absorption == vec3(0.0)) {
            float through = exp(-haze.w * surface.t);
            light += throughput * haze.xyz * (1.0 - through);
            throughput *= through;
        }
        throughput *= exp(-absorption * surface.t);
        light += throughput * surface.emission;
        if (surface.ior == 0.0) {
            light += throughput * (1.0 - surface.metallic) * diffuse(surface);
            throughput *= surface.metallic * surface.albedo;
        }
        if (mirrors == MAX_MIRRORS || max(throughput.x, max(throughput.y, throughput.z)) < 0.01) {
            light += throughput * around(direction);
            break;
        }
        bool reflects = true;
        if (surface.ior > 0.0) {
            float eta = surface.leaving ? surface.ior : 1.0 / surface.ior;
            float cosine = clamp(-dot3(surface.normal, direction), 0.0, 1.0);
            float reflected = fresnel(cosine, eta);
            reflects = reflected > 0.25;
            vec3 mirror = mirrored(direction, surface.normal);
            if (reflects) {
                light += throughput * (1.0 - reflected) * surface.albedo * exp(-2.0 * surface.absorption) * around(direction) * 0.6;
                throughput *= reflected;
            } else {
                light += throughput * reflected * min(sky_towards(mirror, 0.2), vec3(MAX_INDIRECT));
                throughput *= (1.0 - reflected) * surface.albedo;
                direction = unit(refract(direction, surface.normal, eta));
                absorption = surface.leaving ? vec3(0.0) : surface.absorption;
            }
        }
        if (reflects) {
            direction = mirrored(direction, surface.normal);
            if (dot3(direction, surface.face) <= 0.0) {
                direction = mirrored(direction, surface.face);
            }
        }
        surface.cone_width += surface.cone_spread * surface.t;
        origin = leave(surface.position, reflects ? surface.face : -surface.face, surface.t);
        found = met(origin, direction, false);
    }
    color = vec4(light, 1.0);
}
