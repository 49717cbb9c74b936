// Arithmetic that comes out alike on every driver, to the last bit: sums in a written order, never contracted (`precise`), reciprocals
// in place of divisions (a driver may multiply by one or divide), and sine and cosine of our own. Where a path goes is computed by
// these alone: a ray that differs in its last bit may end at another leaf.

float dot3(vec3 a, vec3 b) {
    precise float sum = a.x * b.x + a.y * b.y;
    sum = sum + a.z * b.z;
    return sum;
}

vec3 cross3(vec3 a, vec3 b) {
    precise vec3 first = a.yzx * b.zxy;
    precise vec3 second = a.zxy * b.yzx;
    precise vec3 result = first - second;
    return result;
}

vec3 unit(vec3 v) {
    precise float scale = 1.0 / sqrt(dot3(v, v));
    precise vec3 result = v * scale;
    return result;
}

// a x + b y + c z: a matrix by its columns, times a vector.
vec3 combine(vec3 a, vec3 b, vec3 c, vec3 by) {
    precise vec3 first = a * by.x;
    precise vec3 second = b * by.y;
    precise vec3 third = c * by.z;
    precise vec3 result = (first + second) + third;
    return result;
}

// Where the columns of a matrix would send a normal: by its cofactors.
vec3 normal_by(mat4x3 m, vec3 n) {
    return unit(combine(cross3(m[1], m[2]), cross3(m[2], m[0]), cross3(m[0], m[1]), n));
}

// What the columns of a matrix send to `v`: Cramer's rule.
vec3 undone(mat4x3 m, vec3 v) {
    vec3 x = cross3(m[1], m[2]);
    precise float inverse = 1.0 / dot3(m[0], x);
    precise vec3 result = vec3(dot3(x, v), dot3(cross3(m[2], m[0]), v), dot3(cross3(m[0], m[1]), v)) * inverse;
    return result;
}

vec3 mirrored(vec3 d, vec3 n) {
    precise float twice = 2.0 * dot3(d, n);
    precise vec3 part = n * twice;
    precise vec3 result = d - part;
    return result;
}

// Cosine and sine of a whole turn's fraction, 0 to 1: quarter turns by their signs, what is left by Taylor's series.
vec2 circle(float turn) {
    precise float scaled = turn * 4.0;
    precise float quarter = floor(scaled + 0.5);
    precise float x = (scaled - quarter) * 1.57079637;
    precise float x2 = x * x;
    precise float s = x2 * -1.98412701e-4 + 8.33333377e-3;
    s = s * x2 + -1.66666672e-1;
    s = (s * x2) * x + x;
    precise float c = x2 * 2.48015876e-5 + -1.38888892e-3;
    c = c * x2 + 4.16666679e-2;
    c = c * x2 + -0.5;
    c = c * x2 + 1.0;
    uint which = uint(quarter) & 3u;
    vec2 result = (which & 1u) == 0u ? vec2(c, s) : vec2(-s, c);
    return which >= 2u ? -result : result;
}
