layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 5, scalar) uniform Size { uvec2 size; };

// The distance to the sphere in box `number`, or a negative one.
float sphere(uint number, vec3 o, vec3 d, float least) {
    o -= corners[number];
    float a = dot(d, d);
    float b = dot(o, d);
    float root = b * b - a * (dot(o, o) - 1.0);
    if (root < 0.0) {
        return -1.0;
    }
    root = sqrt(root);
    float near = (-b - root) / a;
    return near > least ? near : (-b + root) / a;
}

const float LEAST = 1e-3;

// Distance and number of the nearest sphere; t is negative where there is none.
Surface shoot(vec3 origin, vec3 way, uint flags) {
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, flags, 0xff, origin, LEAST, way, 1e6);
    while (rayQueryProceedEXT(query)) {
        uint number = rayQueryGetIntersectionPrimitiveIndexEXT(query, false);
        float t = sphere(number, rayQueryGetIntersectionObjectRayOriginEXT(query, false),
            rayQueryGetIntersectionObjectRayDirectionEXT(query, false), LEAST);
        float nearest = 1e6;
        if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
            nearest = rayQueryGetIntersectionTEXT(query, true);
        }
        if (t > LEAST && t < nearest) {
            rayQueryGenerateIntersectionEXT(query, t);
        }
    }
    Surface surface = Surface(vec3(0.0), -1.0, 0u);
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionGeneratedEXT) {
        surface.material = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
        surface.t = rayQueryGetIntersectionTEXT(query, true);
        surface.normal = normalize(origin + way * surface.t - corners[surface.material]);
    }
    return surface;
}

void main() {
    if (any(greaterThanEqual(gl_GlobalInvocationID.xy, size))) {
        return;
    }
    uint number = gl_GlobalInvocationID.y * size.x + gl_GlobalInvocationID.x;
    vec2 spot = (vec2(gl_GlobalInvocationID.xy) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec3 at = eye;
    vec3 way = normalize(ahead + spot.x * right - spot.y * up);
    vec3 weight = vec3(1.0);
    vec3 colour = vec3(0.0);
    vec3 sun = normalize(vec3(0.4, 1.0, 0.3));
    float rays = 0.0;
    // Mirrors with a shadow each, three deep.
    for (uint bounce = 0u; bounce < 3u; bounce++) {
        Surface surface = shoot(at, way, gl_RayFlagsNoneEXT);
        rays += 1.0;
        if (surface.t < 0.0) {
            colour += weight * sky(way);
            break;
        }
        at += way * surface.t + surface.normal * 1e-2;
        float light = max(0.0, dot(surface.normal, sun));
        if (light > 0.0) {
            rays += 1.0;
            light = shoot(at, sun, gl_RayFlagsTerminateOnFirstHitEXT).t < 0.0 ? light : 0.0;
        }
        colour += weight * paint(surface.material) * (0.1 + 0.6 * light);
        weight *= 0.3;
        way = reflect(way, surface.normal);
    }
    pixels[number] = vec4(colour, rays);
}
