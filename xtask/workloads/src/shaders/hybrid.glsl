layout(set = 0, binding = 6, rgba16f) uniform image2D light;

// Adds what the sun and the sky give to what lies in the image already.
void main() {
    vec3 way = direction();
    ivec2 at = ivec2(gl_LaunchIDEXT.xy);
    vec3 colour = imageLoad(light, at).rgb;
    shoot(eye, way);
    if (surface.t < 0.0) {
        colour += 2.0 * sky(way);
    } else {
        vec3 normal = surface.normal;
        vec3 albedo = paint(surface.material);
        vec3 sun = normalize(vec3(0.4, 1.0, 0.3));
        bool lit = !blocked(eye + way * surface.t + normal * 1e-2, sun, 1e6);
        colour += albedo * (0.3 + (lit ? 3.0 * max(0.0, dot(normal, sun)) : 0.0));
    }
    imageStore(light, at, vec4(colour, 1.0));
}
