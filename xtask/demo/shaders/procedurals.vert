#version 460
#define RASTER
#include "scene.glsl"
#include "triangle.glsl"
#include "raster.glsl"

layout(location = 0) flat out uint instance;

// The faces of a box, each as two triangles: bit 0 of a corner is x, bit 1 y, bit 2 z.
const uint CORNERS[36] = uint[36](
    0u, 2u, 1u, 1u, 2u, 3u, 4u, 5u, 6u, 6u, 5u, 7u, 0u, 1u, 4u, 4u, 1u, 5u,
    2u, 6u, 3u, 3u, 6u, 7u, 0u, 4u, 2u, 2u, 4u, 6u, 1u, 3u, 5u, 5u, 3u, 7u);

// The box around a procedural primitive, a little larger, so that snapping it to fractions of pixels loses nothing.
void main() {
    instance = drawn[gl_InstanceIndex];
    uint corner = CORNERS[gl_VertexIndex];
    vec3 side = vec3(corner & 1u, corner >> 1 & 1u, corner >> 2) * 2.0 - 1.0;
    Procedural self = procedurals[model];
    gl_Position = projected(placed_by(transform_of(instance), self.centre + side * (self.radius * 1.02)));
}
