// One of many layers: KIND and SALT are put in for each.
vec3 layer_KIND(vec3 at, vec3 normal, uint seed) {
    vec3 sum = vec3(KIND.25, 0.5, SALT.125);
    float weight = 0.5;
    uint steps = 2u + (seed & 3u);
    for (uint i = 0u; i < steps; i++) {
        vec3 cell = floor(at * (1.5 + 0.01 * KIND.0));
        vec3 inside = fract(at + cell * 0.37);
        float bump = sin(inside.x * 6.1 + float(i)) * cos(inside.y * 4.7) + inside.z * inside.z;
        uint bits = hash(uint(int(cell.x)) * 31u ^ uint(int(cell.y)) * 17u ^ uint(int(cell.z)) ^ KINDu);
        if ((bits & 3u) == 0u) {
            sum += weight * mix(paint(bits), sky(normal), clamp(bump, 0.0, 1.0));
            at = at.yzx * 1.9 + normal * bump;
        } else if (bump > 0.4) {
            sum = max(sum, vec3(bump, weight, random(seed)));
            at += scattered(normal, seed) * 0.25;
        } else {
            sum.xy *= vec2(0.75, 1.25) - weight * inside.yx;
        }
        weight *= 0.55;
    }
    vec3 corner = corners[indices[(seed >> 3) % 6u]];
    return sum / (1.0 + dot(sum - corner * 0.001, sum));
}
