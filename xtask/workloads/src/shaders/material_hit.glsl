layout(location = 0) rayPayloadInEXT Surface surface;

// One of many: KIND is its number, and decides what it computes.
void main() {
    uint first = gl_InstanceCustomIndexEXT + 3u * gl_PrimitiveID;
    vec3 a = corners[indices[first]];
    vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
    normal = normalize(vec3(normal * gl_WorldToObjectEXT));
    normal = dot(normal, gl_WorldRayDirectionEXT) > 0.0 ? -normal : normal;
    vec3 at = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
    float wave = 0.0;
    for (int i = 1; i <= 4 + KIND % 5; i++) {
        wave += sin(at.x * float(i) * (1.0 + 0.1 * float(KIND))) * cos(at.z * float(i)) / float(i);
    }
    surface.normal = normalize(normal + 0.05 * wave * vec3(1.0, 0.0, 1.0));
    surface.t = gl_HitTEXT;
    surface.material = KIND;
}
