layout(location = 0) rayPayloadInEXT Surface surface;

void main() {
    surface.normal = vec3(0.0, 0.0, 0.2);
}
