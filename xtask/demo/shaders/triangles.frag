#version 460
#define RASTER
#include "scene.glsl"
#include "triangle.glsl"
#include "random.glsl"
#include "leaf.glsl"
#include "ray.glsl"
#include "raster.glsl"

layout(constant_id = 0) const bool HAS_HOLES = false;

layout(location = 0) flat in uint instance;
layout(location = 1) flat in uint primitive;
layout(location = 0) out uvec4 seen;

// Who is seen, for shade.frag. Holes are where the ray through the pixel's centre finds them.
void main() {
    if (HAS_HOLES) {
        Triangle triangle = triangle_of(geometries[model], primitive);
        vec3 direction = towards(gl_FragCoord.xy);
        Meeting meeting = meet(triangle, transform_of(instance), camera_position.xyz, direction, vec3(0.0));
        if (triangle.material.kind != GLASS && has_hole(triangle, primitive, meeting.weights, direction)) {
            discard;
        }
    }
    seen = uvec4(instance + 1u, model, primitive, floatBitsToUint(gl_FragCoord.z));
}
