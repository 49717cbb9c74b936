void main() {
    vec3 way = direction();
    shoot(eye, way);
    if (surface.t < 0.0) {
        put(sky(way), 1.0);
        return;
    }
    uint seed = hash(number());
    vec3 at = eye + way * surface.t + surface.normal * 1e-2;
    vec3 normal = surface.normal;
    float open = 0.0;
    for (uint i = 0u; i < 8u; i++) {
        open += blocked(at, scattered(normal, seed), 4.0) ? 0.0 : 0.125;
    }
    put(vec3(open), 9.0);
}
