// The macro `INPUTS` stands before this.
layout(set = 0, binding = 5, scalar) readonly buffer Weights { float16_t weights[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Biases { float16_t biases[]; };

vec3 network(vec3 spot) {
    float16_t x[64], y[64];
    INPUTS
    for (int layer = 0; layer < 3; layer++) {
        for (int row = 0; row < 64; row++) {
            int line = layer * 64 + row;
            float16_t sum = biases[line];
            for (int k = 0; k < 64; k++) {
                sum += weights[line * 64 + k] * x[k];
            }
            y[row] = layer < 2 ? max(sum, float16_t(0)) : sum;
        }
        x = y;
    }
    return vec3(x[0], x[1], x[2]);
}
