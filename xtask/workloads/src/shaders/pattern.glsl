layout(location = 0) callableDataInEXT vec3 colour;

// One of many: KIND is its number. A place becomes a colour.
void main() {
    vec3 at = fract(colour * 0.25);
    if (KIND == 0) {
        colour = vec3(step(0.5, at.x) == step(0.5, at.z) ? 0.9 : 0.2);
    } else if (KIND == 1) {
        colour = vec3(abs(at.y - 0.5) * 2.0, 0.5, 0.3);
    } else {
        colour = at * at * (3.0 - 2.0 * at);
    }
}
