layout(set = 0, binding = 0) buffer B { vec4 f[]; } b;
layout(set = 1, binding = 0) uniform sampler2D s2;
layout(set = 1, binding = 1) uniform sampler2DArrayShadow shadow;
layout(set = 1, binding = 2) uniform samplerCubeArray cubes[3];
layout(set = 1, binding = 3) uniform texture3D t3;
layout(set = 1, binding = 4) uniform sampler smp[];
layout(set = 1, binding = 5) uniform isampler1D s1;
layout(set = 1, binding = 6) uniform usamplerBuffer tb;
layout(set = 1, binding = 7) uniform texture2DMS ms;
layout(set = 1, binding = 8) uniform sampler2DShadow shadow2;
layout(set = 2, binding = 0, rgba16f) uniform image2D store;
layout(set = 2, binding = 1, r32ui) uniform uimage2DArray counters[2];
layout(set = 2, binding = 2) uniform writeonly image3D store3;
layout(set = 2, binding = 3, r32i) uniform iimageBuffer ib;
layout(set = 2, binding = 4, rgba8) uniform imageCubeArray ica;
layout(set = 2, binding = 5) uniform image2D formatless;

void main() {
    uint id = gl_GlobalInvocationID.x;
    vec4 x = b.f[id];
    ivec2 p = ivec2(id, id >> 4);
    x += texture(s2, x.xy) + textureLod(s2, x.xy, 2.0) + textureGrad(s2, x.xy, x.zw, x.yx) + textureProj(s2, x.xyz)
       + textureOffset(s2, x.xy, ivec2(1, -1)) + texelFetch(s2, p, 1) + textureGather(s2, x.xy, 2)
       + textureGatherOffset(s2, x.xy, p) + textureGatherOffsets(s2, x.xy, ivec2[4](ivec2(0), ivec2(1), ivec2(2), ivec2(3)))
       + textureLodOffset(s2, x.xy, 0.0, ivec2(2));
    x.x += texture(shadow, x) + textureProjLod(shadow2, x, 0.0) + textureGather(shadow2, x.xy, 0.5).x;
    x += texture(cubes[nonuniformEXT(id % 3)], x) + textureLod(sampler3D(t3, smp[nonuniformEXT(id)]), x.xyz, 0.0);
    x += vec4(texelFetch(s1, p.x, 0)) + vec4(texelFetch(tb, p.x)) + texelFetch(ms, p, 3);
    x += imageLoad(store, p) + vec4(imageLoad(counters[1], ivec3(p, 2))) + vec4(imageLoad(ib, 3)) + imageLoad(ica, ivec3(p, 13));
    imageStore(store, p, x);
    imageStore(store3, ivec3(p, 0), x);
    imageStore(ica, ivec3(p, 7), x);
    imageStore(formatless, p, imageLoad(formatless, p + 1));
    x.x += float(imageAtomicAdd(counters[id & 1], ivec3(p, 0), 3u) + imageAtomicCompSwap(counters[0], ivec3(p, 0), 3u, 4u));
    x.y += float(imageAtomicMax(ib, 3, -4));
    ivec2 size = textureSize(s2, 1) + imageSize(store) + textureSize(t3, 0).xy + textureSize(cubes[0], 0).xy + imageSize(ica).xy;
    x.zw += vec2(size) + vec2(textureQueryLevels(s2), textureSamples(ms)) + vec2(textureSize(tb));
    b.f[id] = x;
}
