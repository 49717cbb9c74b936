void main() {
    vec3 way = direction();
    shoot(eye, way);
    bool hits = surface.t >= 0.0;
    put(hits ? surface.normal : sky(way), hits ? 1.0 : 0.0);
}
