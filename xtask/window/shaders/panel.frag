#version 460

layout(set = 0, binding = 0) uniform sampler2D glyphs;

layout(location = 0) in vec2 uv_here;
layout(location = 1) in vec4 color_here;
layout(location = 0) out vec4 color;

// egui blends encoded values, and so does the window: its format is not an sRGB one.
void main() {
    color = color_here * texture(glyphs, uv_here);
}
