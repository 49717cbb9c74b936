#version 460
#define RASTER
#include "scene.glsl"
#include "ray.glsl"
#include "sphere.glsl"
#include "sponge.glsl"
#include "raster.glsl"
#include "meeting.glsl"

layout(location = 0) flat in uint instance;
layout(location = 0) out uvec4 seen;

void main() {
    vec3 direction = towards(gl_FragCoord.xy);
    vec3 outward;
    float t = procedural_meeting(model, instance, camera_position.xyz, direction, outward);
    if (t < 0.0) {
        discard;
    }
    precise float depth = NEAR / (t * dot3(direction, camera_forward.xyz));
    gl_FragDepth = depth;
    seen = uvec4(instance + 1u, model, 0u, floatBitsToUint(depth));
}
