#version 460
#extension GL_EXT_ray_tracing : require

layout(location = 0) rayPayloadInEXT uvec4 seen;

void main() {
    seen = uvec4(0u);
}
