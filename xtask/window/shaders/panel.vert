#version 460

layout(location = 0) in vec2 place; // in points, from the upper left corner
layout(location = 1) in vec2 uv;
layout(location = 2) in vec4 color; // sRGB-encoded, alpha multiplied

layout(push_constant) uniform Panel { vec2 size; }; // of the window, in points

layout(location = 0) out vec2 uv_here;
layout(location = 1) out vec4 color_here;

void main() {
    gl_Position = vec4(place / size * 2.0 - 1.0, 0.0, 1.0);
    uv_here = uv;
    color_here = color;
}
