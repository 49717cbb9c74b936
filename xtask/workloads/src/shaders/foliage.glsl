void main() {
    vec3 way = direction();
    traceRayEXT(scene, 0, 0xff, 0, 0, 0, eye, 1e-3, way, 1e6, 0);
    if (surface.t < 0.0) {
        put(sky(way), 1.0);
        return;
    }
    vec3 at = eye + way * surface.t + surface.normal * 1e-2;
    vec3 colour = paint(surface.material) * (0.3 + 0.7 * abs(surface.normal.y));
    surface.t = 1.0;
    traceRayEXT(scene, gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT,
        0xff, 0, 0, 0, at, 1e-3, normalize(vec3(0.4, 1.0, 0.3)), 1e6, 0);
    put(surface.t < 0.0 ? colour : 0.4 * colour, 2.0);
}
