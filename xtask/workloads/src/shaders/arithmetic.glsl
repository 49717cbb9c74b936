float lattice(ivec3 at) {
    return float(hash(uint(at.x) * 73856093u ^ uint(at.y) * 19349663u ^ uint(at.z) * 83492791u) >> 8) / 16777216.0;
}

float noise(vec3 at) {
    vec3 whole = floor(at);
    vec3 f = at - whole;
    ivec3 cell = ivec3(whole);
    f = f * f * (3.0 - 2.0 * f);
    vec4 low = vec4(lattice(cell), lattice(cell + ivec3(1, 0, 0)), lattice(cell + ivec3(0, 1, 0)), lattice(cell + ivec3(1, 1, 0)));
    cell.z += 1;
    vec4 high = vec4(lattice(cell), lattice(cell + ivec3(1, 0, 0)), lattice(cell + ivec3(0, 1, 0)), lattice(cell + ivec3(1, 1, 0)));
    vec4 z = mix(low, high, f.z);
    vec2 y = mix(z.xy, z.zw, f.y);
    return mix(y.x, y.y, f.x);
}

void main() {
    vec3 at = direction() * 4.0;
    float sum = 0.0;
    float weight = 0.5;
    for (int octave = 0; octave < 16; octave++) {
        sum += weight * noise(at);
        at = at.yzx * 2.02 + vec3(sin(sum), cos(sum), 0.5);
        weight *= 0.6;
    }
    put(vec3(sum, sqrt(abs(sum)), exp2(-sum)), 1.0);
}
