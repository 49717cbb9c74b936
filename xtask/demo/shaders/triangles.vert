#version 460
#define RASTER
#include "scene.glsl"
#include "triangle.glsl"
#include "raster.glsl"

layout(location = 0) flat out uint instance;
layout(location = 1) flat out uint primitive;

void main() {
    Geometry geometry = geometries[model];
    uint index = indices[geometry.first_index + gl_VertexIndex];
    instance = drawn[gl_InstanceIndex];
    primitive = gl_VertexIndex / 3u;
    gl_Position = projected(placed_by(transform_of(instance), vertices[geometry.first_vertex + index].position));
}
