void main() {
    vec3 way = direction();
    shoot(eye, way);
    put(surface.t < 0.0 ? sky(way) : paint(surface.material) * (0.2 + 0.8 * abs(dot(way, surface.normal))), 1.0);
}
