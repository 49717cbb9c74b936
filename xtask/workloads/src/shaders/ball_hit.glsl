layout(location = 0) rayPayloadInEXT Surface surface;
hitAttributeEXT vec3 normal;

void main() {
    vec3 n = normalize(normal);
    surface.normal = dot(n, gl_WorldRayDirectionEXT) > 0.0 ? -n : n;
    surface.t = gl_HitTEXT;
    surface.material = gl_PrimitiveID;
}
