layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec2 weights;

void main() {
    surface.normal = vec3(1.0 - weights.x - weights.y, weights);
}
