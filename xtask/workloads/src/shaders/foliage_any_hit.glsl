hitAttributeEXT vec2 weights;

// A leaf's outline: what lies outside a disc about the triangle's middle is cut away.
void main() {
    vec2 from_middle = weights - vec2(0.3333333);
    if (dot(from_middle, from_middle) > 0.05) {
        ignoreIntersectionEXT;
    }
}
