layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, scalar) buffer Out { vec4 pixels[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Corners { vec3 corners[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Indices { uint indices[]; };
layout(set = 0, binding = 4, scalar) uniform Camera { vec3 eye; vec3 right; vec3 up; vec3 ahead; };

struct Surface {
    vec3 normal;
    float t;
    uint material;
};

uint hash(uint x) {
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

// In [0, 1).
float random(inout uint seed) {
    seed += 0x9e3779b9u;
    return float(hash(seed) >> 8) / 16777216.0;
}

vec3 sky(vec3 direction) {
    return mix(vec3(0.9, 0.8, 0.7), vec3(0.3, 0.5, 0.9), 0.5 + 0.5 * direction.y);
}

vec3 paint(uint material) {
    uint bits = hash(material + 7u);
    return 0.3 + 0.5 * vec3(bits & 255u, (bits >> 8) & 255u, (bits >> 16) & 255u) / 255.0;
}

// Cosine-weighted about the normal.
vec3 scattered(vec3 normal, inout uint seed) {
    float z = 1.0 - 2.0 * random(seed);
    float turn = 6.2831853 * random(seed);
    float r = sqrt(max(0.0, 1.0 - z * z));
    vec3 direction = normal + vec3(r * cos(turn), r * sin(turn), z) * 0.999;
    return normalize(direction);
}
