layout(local_size_x = 16) in;
layout(set = 0, binding = 0) buffer B { vec4 f[]; } b;
layout(set = 0, binding = 1) buffer I { ivec4 i[]; } bi;
layout(set = 0, binding = 2) buffer D { dvec4 d[]; } bd;
layout(set = 0, binding = 3, row_major) buffer M { mat4 m; mat3x2 n[3]; layout(column_major) mat3 c; } bm;
layout(constant_id = 3) const int COUNT = 3;
layout(constant_id = 4) const bool FLAG = true;
const int TWICE = COUNT * 2 + (FLAG ? 1 : 0);

void main() {
    uint id = gl_GlobalInvocationID.x;
    vec4 x = b.f[id], y = b.f[id + 1];
    x += sin(x) + cos(x) + tan(x) + asin(x) + acos(x) + atan(x) + atan(x, y) + sinh(x) + cosh(x) + tanh(x)
       + asinh(x) + acosh(x) + atanh(x) + pow(x, y) + exp(x) + log(x) + exp2(x) + log2(x) + sqrt(x) + inversesqrt(x)
       + abs(x) + sign(x) + floor(x) + trunc(x) + round(x) + roundEven(x) + ceil(x) + fract(x) + mod(x, y)
       + min(x, y) + max(x, y) + clamp(x, vec4(0), vec4(1)) + mix(x, y, 0.3) + step(x, y) + smoothstep(x, y, x)
       + radians(x) + degrees(x) + fma(x, y, x);
    vec4 whole; ivec4 exponent;
    x += modf(y, whole) + whole + frexp(y, exponent) + ldexp(y, exponent);
    x.x += length(x) + distance(x, y) + dot(x, y) + determinant(bm.m) + determinant(bm.c) + determinant(mat2(x));
    x += normalize(x) + faceforward(x, y, x) + reflect(x, y) + refract(x, y, 0.7);
    x.xyz += cross(x.xyz, y.xyz);
    x += bm.m * y + y * bm.m + (bm.m * transpose(bm.m))[1] + inverse(bm.m)[2] + outerProduct(x, y)[id & 3];
    x.xyz += inverse(bm.c) * x.xyz + bm.n[id % 3][1].xyx + (bm.n[2] * x.xyz).xyy;
    bm.m[id & 3][2] = x.x;
    bm.n[1] = mat3x2(x.xy, y.xy, x.zw);
    bm.c[2].y = 3.0;
    x += mix(x, y, greaterThan(x, y)) + vec4(any(lessThan(x, y)), all(equal(x, y)), any(isnan(x)), any(isinf(y)));
    x.x += unpackSnorm4x8(packSnorm4x8(x)).x + unpackUnorm4x8(packUnorm4x8(x)).y + unpackHalf2x16(packHalf2x16(x.xy)).x
         + unpackSnorm2x16(packSnorm2x16(x.xy)).x + unpackUnorm2x16(packUnorm2x16(x.xy)).y;
    b.f[id] = x;

    ivec4 i = bi.i[id], j = ivec4(x);
    uvec4 u = uvec4(i), v = floatBitsToUint(x);
    uvec4 carry, low; ivec4 slow, shigh;
    u += uaddCarry(u, v, carry) + carry; u += usubBorrow(u, v, carry) + carry;
    umulExtended(u, v, carry, low); u += carry ^ low;
    imulExtended(i, j, shigh, slow); i += shigh ^ slow;
    i += bitCount(i) + findLSB(i) + findMSB(i) + findMSB(u) + bitfieldReverse(i) + bitfieldExtract(i, 3, 5)
       + bitfieldInsert(i, j, 1, 4) + abs(i) + sign(j) + min(i, j) + max(i, j) + clamp(i, ivec4(-3), ivec4(3))
       + (i << 3) + (i >> j) + ivec4(u >> v) + i / j + i % j + ivec4(u / v) + ivec4(u % v) + (i & j | ~i ^ j);
    int64_t wide = int64_t(i.x) * 3l; uint64_t uwide = uint64_t(u.x) << 33;
    int16_t h = int16_t(i.y); uint8_t byte = uint8_t(u.z); float16_t half_ = float16_t(x.y); f16vec3 hv = f16vec3(x.xyz);
    hv = normalize(hv) * half_ + sqrt(hv); h += int16_t(byte) * h; byte = byte / uint8_t(3);
    wide += int64_t(uwide) + int64_t(h) + int64_t(byte) + int64_t(half_) + pack64(unpack32(wide));
    i.x += int(wide) + int(hv.x) + TWICE + int(pack32(unpack16(i.y))) + int(unpack8(i.y).z);
    bi.i[id] = i;

    dvec4 d = bd.d[id];
    d += sqrt(d) + abs(d) + floor(d) + fma(d, d, d) + dvec4(x) + dvec4(i) + packDouble2x32(unpackDouble2x32(d.x));
    d.x += determinant(dmat3(d.xyz, d.yzw, d.zwx)) + length(d);
    bd.d[id] = d;
    bi.i[id + 1] = ivec4(d);
}
