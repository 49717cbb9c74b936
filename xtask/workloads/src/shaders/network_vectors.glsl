// The constant `LAYER_BYTES` and the macro `INPUTS` stand before this.
layout(set = 0, binding = 5, scalar) readonly buffer Weights { float16_t weights[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Biases { float16_t biases[]; };

#define MULTIPLY(layer) \
    coopVecMatMulAddNV(y, x, gl_ComponentTypeFloat16NV, weights, layer * LAYER_BYTES, \
        gl_ComponentTypeFloat16NV, biases, layer * 128, gl_ComponentTypeFloat16NV, 64, 64, \
        gl_CooperativeVectorMatrixLayoutInferencingOptimalNV, false, 0)

vec3 network(vec3 spot) {
    coopvecNV<float16_t, 64> x, y;
    INPUTS
    MULTIPLY(0);
    x = max(y, coopvecNV<float16_t, 64>(float16_t(0)));
    MULTIPLY(1);
    x = max(y, coopvecNV<float16_t, 64>(float16_t(0)));
    MULTIPLY(2);
    return vec3(y[0], y[1], y[2]);
}
