struct Reflected {
    vec3 colour;
    uint depth;
    float rays;
};
layout(location = 0) rayPayloadInEXT Reflected reflected;

void main() {
    reflected.colour = sky(gl_WorldRayDirectionEXT);
}
