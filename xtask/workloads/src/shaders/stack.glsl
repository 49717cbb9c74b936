layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 5, scalar) uniform Size { uvec2 size; };

const int DEEPEST = 8;

// Distance, and the normal in the world; t is negative where nothing is hit.
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
        surface.normal = normalize(vec3(normal * rayQueryGetIntersectionWorldToObjectEXT(query, true)));
        surface.t = rayQueryGetIntersectionTEXT(query, true);
        surface.material = rayQueryGetIntersectionInstanceIdEXT(query, true);
    }
    return surface;
}

// Glass splits rays in two; those that wait lie on a stack of the invocation's own.
void main() {
    if (any(greaterThanEqual(gl_GlobalInvocationID.xy, size))) {
        return;
    }
    uint number = gl_GlobalInvocationID.y * size.x + gl_GlobalInvocationID.x;
    vec2 spot = (vec2(gl_GlobalInvocationID.xy) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec3 origins[DEEPEST];
    vec3 ways[DEEPEST];
    vec3 weights[DEEPEST];
    origins[0] = eye;
    ways[0] = normalize(ahead + spot.x * right - spot.y * up);
    weights[0] = vec3(1.0);
    int count = 1;
    vec3 colour = vec3(0.0);
    float rays = 0.0;
    while (count > 0 && rays < 12.0) {
        count--;
        vec3 at = origins[count];
        vec3 way = ways[count];
        vec3 weight = weights[count];
        Surface surface = shoot(at, way);
        rays += 1.0;
        if (surface.t < 0.0) {
            colour += weight * sky(way);
            continue;
        }
        bool inside = dot(surface.normal, way) > 0.0;
        vec3 normal = inside ? -surface.normal : surface.normal;
        vec3 there = at + way * surface.t;
        vec3 paint_here = paint(surface.material);
        bool is_glass = surface.material % 3u == 1u;
        colour += weight * paint_here * (is_glass ? 0.05 : 0.4) * (0.3 + 0.7 * abs(normal.y));
        if (is_glass && count + 1 < DEEPEST) {
            vec3 bent = refract(way, normal, inside ? 1.4 : 1.0 / 1.4);
            if (bent != vec3(0.0)) {
                origins[count] = there - normal * 1e-2;
                ways[count] = bent;
                weights[count] = weight * 0.7;
                count++;
            }
        }
        float mirror = is_glass ? 0.25 : 0.15;
        if (count < DEEPEST && dot(weight, vec3(1.0)) > 0.1) {
            origins[count] = there + normal * 1e-2;
            ways[count] = reflect(way, normal);
            weights[count] = weight * paint_here * mirror;
            count++;
        }
    }
    pixels[number] = vec4(colour, rays);
}
