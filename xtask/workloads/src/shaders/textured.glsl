layout(set = 0, binding = 6, rgba8) uniform writeonly image2D image;

void main() {
    vec3 way = direction();
    shoot(eye, way);
    imageStore(image, ivec2(gl_LaunchIDEXT.xy), vec4(surface.t < 0.0 ? sky(way) : surface.normal, 1.0));
}
