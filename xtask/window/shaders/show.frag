#version 460

// The picture so far: left of the split as it was drawn, right of it the mean of what was traced;
// where either has not come to yet, a small picture that is there at once.

layout(set = 0, binding = 0, std430) readonly buffer Traced { vec4 traced[]; };
layout(set = 0, binding = 1, std430) readonly buffer SmallTraced { vec4 small_traced[]; };
layout(set = 0, binding = 2) uniform sampler2D drawn;
layout(set = 0, binding = 3) uniform sampler2D small_drawn;

layout(push_constant) uniform Show {
    uvec2 size;
    uvec2 small_size;
    uint split;       // the first column that is traced
    uint drawn_rows;  // rows that are drawn,
    uint traced_rows; // and those with a sample
    float exposure;
};

layout(location = 0) out vec4 color;

vec3 mean(vec4 sums) {
    return sums.rgb / max(sums.a, 1.0);
}

vec3 small_at(ivec2 at, bool is_drawn) {
    at = clamp(at, ivec2(0), ivec2(small_size) - 1);
    return is_drawn ? texelFetch(small_drawn, at, 0).rgb : mean(small_traced[at.y * small_size.x + at.x]);
}

// Between the four nearest pixels.
vec3 smoothed(vec2 place, bool is_drawn) {
    vec2 at = place / vec2(size) * vec2(small_size) - 0.5;
    ivec2 corner = ivec2(floor(at));
    vec2 weight = at - vec2(corner);
    vec3 above = mix(small_at(corner, is_drawn), small_at(corner + ivec2(1, 0), is_drawn), weight.x);
    vec3 below = mix(small_at(corner + ivec2(0, 1), is_drawn), small_at(corner + ivec2(1, 1), is_drawn), weight.x);
    return mix(above, below, weight.y);
}

// As picture.rs in the demo has it.
vec3 tone_mapped(vec3 light) {
    float middle = (light.r + light.g + light.b) / 3.0;
    vec3 x = max(light * 0.92 + middle * 0.08, 0.0) * 0.75;
    return clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
}

// IEC 61966-2-1.
vec3 encoded(vec3 linear) {
    vec3 curved = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    return mix(curved, linear * 12.92, lessThanEqual(linear, vec3(0.0031308)));
}

void main() {
    uvec2 at = uvec2(gl_FragCoord.xy);
    bool is_drawn = at.x < split;
    vec3 light;
    if (at.y >= (is_drawn ? drawn_rows : traced_rows)) {
        light = smoothed(gl_FragCoord.xy, is_drawn);
    } else if (is_drawn) {
        light = texelFetch(drawn, ivec2(at), 0).rgb;
    } else {
        light = mean(traced[at.y * size.x + at.x]);
    }
    color = vec4(encoded(tone_mapped(light * exposure)), 1.0);
}
