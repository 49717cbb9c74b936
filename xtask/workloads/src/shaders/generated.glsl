// As shaders come out of other compilers: scalars where there could be vectors, arrays of an invocation's own, small functions with
// arrays behind pointers, nothing moved out of loops.
layout(set = 0, binding = 2, scalar) readonly buffer Numbers { float numbers[]; };

vec3 corner(uint i) {
    return vec3(numbers[3u * i], numbers[3u * i + 1u], numbers[3u * i + 2u]);
}

void order(inout float list[6], int i, int j) {
    float low = min(list[i], list[j]);
    list[j] = max(list[i], list[j]);
    list[i] = low;
}

// Medians of heights, again and again.
void main() {
    uint count = uint(numbers.length()) / 3u;
    uint seed = hash(number());
    vec3 sum = vec3(0.0);
    for (uint turn = 0u; turn < 8u; turn++) {
        float list[6];
        for (int i = 0; i < 6; i++) {
            vec3 at = corner(hash(seed + uint(i)) % count);
            list[i] = dot(at, up) + 0.01 * at.x;
        }
        for (int last = 5; last > 0; last--) {
            for (int i = 0; i < last; i++) {
                order(list, i, i + 1);
            }
        }
        float scale = sqrt(dot(eye, eye)) / (1.0 + exp(-abs(right.x)));
        sum += scale * vec3(list[1], list[2], list[4]);
        seed = hash(seed);
    }
    sum = abs(sum);
    put(sum / (10.0 + sum), 1.0);
}
