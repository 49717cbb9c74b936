layout(location = 0) rayPayloadInEXT Surface surface;

void main() {
    surface.t = -1.0;
}
