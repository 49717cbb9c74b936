layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 5, scalar) uniform Size { uvec2 size; };

// Distance, and the normal's object-space direction turned into the world; t is negative where nothing is hit.
Surface shoot(vec3 origin, vec3 way) {
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, gl_RayFlagsOpaqueEXT, 0xff, origin, 1e-3, way, 1e6);
    while (rayQueryProceedEXT(query)) {
    }
    Surface surface = Surface(vec3(0.0), -1.0, 0u);
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT) {
        uint first = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true)
            + 3u * rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
        vec3 a = corners[indices[first]];
        vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
        normal = normalize(vec3(normal * rayQueryGetIntersectionWorldToObjectEXT(query, true)));
        surface.normal = dot(normal, way) > 0.0 ? -normal : normal;
        surface.t = rayQueryGetIntersectionTEXT(query, true);
        surface.material = rayQueryGetIntersectionInstanceIdEXT(query, true);
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
    float rays = 0.0;
    for (uint bounce = 0u; bounce < 8u; bounce++) {
        Surface surface = shoot(at, way);
        rays += 1.0;
        if (surface.t < 0.0) {
            colour = weight * sky(way);
            break;
        }
        weight *= paint(surface.material);
        at += way * surface.t + surface.normal * 1e-2;
        way = scattered(surface.normal, seed);
    }
    pixels[number] = vec4(colour, rays);
}
