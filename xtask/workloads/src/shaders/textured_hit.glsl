layout(location = 0) rayPayloadInEXT Surface surface;
layout(set = 0, binding = 5) uniform sampler2D albedo;

// Two layers of one texture, at the level of a cone of rays.
void main() {
    vec3 at = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
    uint first = gl_InstanceCustomIndexEXT + 3u * gl_PrimitiveID;
    vec3 a = corners[indices[first]];
    vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
    normal = normalize(vec3(normal * gl_WorldToObjectEXT));
    float facing = abs(dot(normal, gl_WorldRayDirectionEXT));
    float lod = log2(max(1e-3, gl_HitTEXT * 1.5 / max(0.1, facing)));
    vec3 colour = textureLod(albedo, at.xz * 0.13, lod).rgb;
    colour *= 0.5 + textureLod(albedo, at.zx * 0.41 + 0.5, lod + 1.6).gbr;
    surface.normal = colour * (0.3 + 0.7 * facing);
    surface.t = gl_HitTEXT;
}
