layout(location = 0) rayPayloadInEXT Surface surface;

void main() {
    uint first = gl_InstanceCustomIndexEXT + 3u * gl_PrimitiveID;
    vec3 a = corners[indices[first]];
    vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
    normal = normalize(vec3(normal * gl_WorldToObjectEXT));
    surface.normal = dot(normal, gl_WorldRayDirectionEXT) > 0.0 ? -normal : normal;
    surface.t = gl_HitTEXT;
    surface.material = gl_InstanceID;
}
