layout(location = 0) rayPayloadEXT Surface surface;

vec3 direction() {
    vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy) * 2.0 - 1.0;
    return normalize(ahead + at.x * right - at.y * up);
}

uint number() {
    return gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
}

void shoot(vec3 origin, vec3 way) {
    traceRayEXT(scene, gl_RayFlagsOpaqueEXT, 0xff, 0, 0, 0, origin, 1e-3, way, 1e6, 0);
}

// Whether something is in the way.
bool blocked(vec3 origin, vec3 way, float far) {
    surface.t = 1.0;
    traceRayEXT(scene, gl_RayFlagsOpaqueEXT | gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT,
        0xff, 0, 0, 0, origin, 1e-3, way, far, 0);
    return surface.t > 0.0;
}

// The fourth component counts the rays.
void put(vec3 colour, float rays) {
    pixels[number()] = vec4(colour, rays);
}
