struct Reflected {
    vec3 colour;
    uint depth;
    float rays;
};
layout(location = 0) rayPayloadEXT Reflected reflected;

void main() {
    vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy) * 2.0 - 1.0;
    vec3 way = normalize(ahead + at.x * right - at.y * up);
    reflected = Reflected(vec3(0.0), 1u, 1.0);
    traceRayEXT(scene, gl_RayFlagsOpaqueEXT, 0xff, 0, 0, 0, eye, 1e-3, way, 1e6, 0);
    pixels[gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x] = vec4(reflected.colour, reflected.rays);
}
