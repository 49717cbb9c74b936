// Whether a ray passes a triangle by a hole in its texture. The texel is fetched, not filtered, so that where a hole ends does not depend
// on how a driver rounds its filter weights.
bool has_hole(Triangle triangle, uint primitive, vec3 weights, vec3 direction) {
    uint base = triangle.material.base_texture;
    if (base == NONE) {
        return false;
    }
    vec2 uv = mixed_uv(triangle, weights);
    ivec2 size = textureSize(textures[nonuniformEXT(base)], 0);
    ivec2 texel = min(ivec2(fract(uv) * vec2(size)), size - 1);
    float alpha = texelFetch(textures[nonuniformEXT(base)], texel, 0).a;
    float cutoff = triangle.material.alpha_cutoff;
    if (cutoff >= BY_CHANCE) {
        uvec3 bits = floatBitsToUint(direction);
        uint seed = hash(bits.x ^ hash(bits.y ^ hash(bits.z ^ primitive)));
        cutoff = (float(seed >> 8) + 0.5) * (1.0 / 16777216.0);
    }
    return alpha < cutoff;
}
