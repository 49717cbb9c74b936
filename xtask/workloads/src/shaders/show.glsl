layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 0, rgba8) uniform readonly image2D image;
layout(set = 0, binding = 1, scalar) buffer Out { vec4 pixels[]; };

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(image);
    if (all(lessThan(at, size))) {
        pixels[at.y * size.x + at.x] = vec4(imageLoad(image, at).rgb, 1.0);
    }
}
