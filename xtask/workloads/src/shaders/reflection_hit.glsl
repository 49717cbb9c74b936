struct Reflected {
    vec3 colour;
    uint depth;
    float rays;
};
layout(location = 0) rayPayloadInEXT Reflected reflected;

void main() {
    uint first = gl_InstanceCustomIndexEXT + 3u * gl_PrimitiveID;
    vec3 a = corners[indices[first]];
    vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
    normal = normalize(vec3(normal * gl_WorldToObjectEXT));
    normal = dot(normal, gl_WorldRayDirectionEXT) > 0.0 ? -normal : normal;
    vec3 own = paint(gl_InstanceID) * (0.3 + 0.7 * max(0.0, normal.y));
    if (reflected.depth >= 6u) {
        reflected.colour = own;
        return;
    }
    vec3 at = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT + normal * 1e-2;
    reflected.depth += 1u;
    reflected.rays += 1.0;
    traceRayEXT(scene, gl_RayFlagsOpaqueEXT, 0xff, 0, 0, 0, at, 1e-3, reflect(gl_WorldRayDirectionEXT, normal), 1e6, 0);
    reflected.colour = 0.5 * own + 0.5 * reflected.colour;
}
