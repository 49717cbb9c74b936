layout(set = 0, binding = 6, rgba8) uniform writeonly image2D image;

// As a first program does it: one ray a pixel, and what comes back goes to an image.
void main() {
    vec3 way = direction();
    surface.normal = vec3(0.0);
    shoot(eye, way);
    imageStore(image, ivec2(gl_LaunchIDEXT.xy), vec4(surface.normal, 0.0));
}
