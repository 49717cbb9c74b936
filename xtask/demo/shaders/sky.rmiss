#version 460
#include "scene.glsl"
#include "sky.glsl"

layout(location = 0) rayPayloadInEXT Surface surface;

void main() {
    surface.emission = sky_towards(gl_WorldRayDirectionEXT, surface.cone_spread);
    surface.t = -1.0;
}
