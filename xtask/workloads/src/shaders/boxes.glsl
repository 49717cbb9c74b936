layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 5, scalar) uniform Size { uvec2 size; };

const float LEAST = 1e-3;

// Where a ray enters the box `number`, or leaves it if it starts inside; negative where it misses.
float slab(uint number, vec3 o, vec3 inverse) {
    vec3 a = (corners[2u * number] - o) * inverse;
    vec3 b = (corners[2u * number + 1u] - o) * inverse;
    vec3 low = min(a, b);
    vec3 high = max(a, b);
    float near = max(max(low.x, low.y), low.z);
    float far = min(min(high.x, high.y), high.z);
    if (near > far) {
        return -1.0;
    }
    return near > LEAST ? near : far;
}

// The nearest box; t is negative where there is none.
Surface shoot(vec3 origin, vec3 way, uint flags) {
    vec3 inverse = 1.0 / way;
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, flags, 0xff, origin, LEAST, way, 1e6);
    while (rayQueryProceedEXT(query)) {
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionAABBEXT) {
            float t = slab(rayQueryGetIntersectionPrimitiveIndexEXT(query, false), origin, inverse);
            float nearest = 1e6;
            if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
                nearest = rayQueryGetIntersectionTEXT(query, true);
            }
            if (t > LEAST && t < nearest) {
                rayQueryGenerateIntersectionEXT(query, t);
            }
        }
    }
    Surface surface = Surface(vec3(0.0), -1.0, 0u);
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionGeneratedEXT) {
        uint number = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
        surface.material = number;
        surface.t = rayQueryGetIntersectionTEXT(query, true);
        vec3 middle = 0.5 * (corners[2u * number] + corners[2u * number + 1u]);
        vec3 away = (origin + way * surface.t - middle) / (corners[2u * number + 1u] - middle);
        vec3 size = abs(away);
        float most = max(max(size.x, size.y), size.z);
        surface.normal = normalize(step(vec3(most), size) * sign(away));
    }
    return surface;
}

void main() {
    if (any(greaterThanEqual(gl_GlobalInvocationID.xy, size))) {
        return;
    }
    uint number = gl_GlobalInvocationID.y * size.x + gl_GlobalInvocationID.x;
    vec2 spot = (vec2(gl_GlobalInvocationID.xy) + 0.5) / vec2(size) * 2.0 - 1.0;
    uint seed = hash(number);
    vec3 at = eye;
    vec3 way = normalize(ahead + spot.x * right - spot.y * up);
    vec3 weight = vec3(1.0);
    vec3 colour = vec3(0.0);
    vec3 sun = normalize(vec3(0.4, 1.0, -0.3));
    float rays = 0.0;
    // What is seen and what that reflects, each with a shadow.
    for (uint bounce = 0u; bounce < 2u; bounce++) {
        Surface surface = shoot(at, way, gl_RayFlagsNoneEXT);
        rays += 1.0;
        if (surface.t < 0.0) {
            colour += weight * sky(way);
            break;
        }
        at += way * surface.t + surface.normal * 1e-2;
        weight *= paint(surface.material);
        float light = max(0.0, dot(surface.normal, sun));
        if (light > 0.0) {
            rays += 1.0;
            light = shoot(at, sun, gl_RayFlagsTerminateOnFirstHitEXT).t < 0.0 ? light : 0.0;
        }
        colour += weight * light;
        way = scattered(surface.normal, seed);
    }
    pixels[number] = vec4(colour, rays);
}
