layout(location = 0) rayPayloadInEXT Surface surface;
struct Material { vec4 tint; uint texture_index; float scale; float gloss; uint unused; };
layout(set = 0, binding = 5) uniform sampler2D textures[TEXTURES];
layout(set = 0, binding = 7, std430) readonly buffer Materials { Material materials[]; };

void main() {
    Material material = materials[gl_InstanceID % materials.length()];
    vec3 at = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
    uint first = gl_InstanceCustomIndexEXT + 3u * gl_PrimitiveID;
    vec3 a = corners[indices[first]];
    vec3 normal = cross(corners[indices[first + 1u]] - a, corners[indices[first + 2u]] - a);
    normal = normalize(vec3(normal * gl_WorldToObjectEXT));
    float facing = abs(dot(normal, gl_WorldRayDirectionEXT));
    vec2 spot = at.xz * material.scale + at.y * 0.3;
    float lod = log2(max(1.0, gl_HitTEXT * 0.3));
    vec3 colour = textureLod(textures[nonuniformEXT(material.texture_index)], spot, lod).rgb;
    surface.normal = colour * material.tint.rgb * (0.3 + 0.7 * facing) + material.gloss * pow(facing, 8.0);
    surface.t = gl_HitTEXT;
}
