layout(local_size_x = 16, local_size_y = 4) in;
layout(set = 0, binding = 0, rgba16f) uniform readonly image2D light;
layout(set = 0, binding = 1, rgba8) uniform writeonly image2D image;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(at, imageSize(light)))) {
        vec3 x = imageLoad(light, at).rgb;
        vec3 mapped = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
        imageStore(image, at, vec4(pow(clamp(mapped, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0));
    }
}
