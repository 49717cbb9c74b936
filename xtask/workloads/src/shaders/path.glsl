void main() {
    uint seed = hash(number());
    vec3 at = eye;
    vec3 way = direction();
    vec3 weight = vec3(1.0);
    vec3 colour = vec3(0.0);
    float rays = 0.0;
    for (uint bounce = 0u; bounce < 8u; bounce++) {
        shoot(at, way);
        rays += 1.0;
        if (surface.t < 0.0) {
            colour = weight * sky(way);
            break;
        }
        weight *= paint(surface.material);
        at += way * surface.t + surface.normal * 1e-2;
        way = scattered(surface.normal, seed);
    }
    put(colour, rays);
}
