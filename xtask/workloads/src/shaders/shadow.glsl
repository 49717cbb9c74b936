void main() {
    vec3 way = direction();
    shoot(eye, way);
    if (surface.t < 0.0) {
        put(sky(way), 1.0);
        return;
    }
    vec3 at = eye + way * surface.t + surface.normal * 1e-2;
    vec3 normal = surface.normal;
    vec3 colour = vec3(0.1);
    for (uint light = 0u; light < 4u; light++) {
        vec3 to = normalize(vec3(cos(float(light) * 1.7), 0.4 + 0.2 * float(light), sin(float(light) * 1.7)));
        float facing = max(0.0, dot(normal, to));
        if (!blocked(at, to, 1e6)) {
            colour += 0.25 * facing;
        }
    }
    put(colour * paint(surface.material), 5.0);
}
