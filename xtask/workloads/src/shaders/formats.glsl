// Samples, fetches and stores of one format: an invocation a pixel, TURNS accesses each. Before
// this stand the defines: an ACCESS (FETCH, SAMPLE, LEVELS, GATHER, SHADOW or STORE), a SHAPE (0:
// 2D, 1: 3D, 2: cube, 3: array), the resource's type, and the four components' type.
#extension GL_EXT_texture_shadow_lod : require
layout(local_size_x = 8, local_size_y = 8) in;
layout(binding = 0) buffer Result { vec4 result[]; };
#if ACCESS == STORE
layout(binding = 1) uniform writeonly RESOURCE target;
#else
layout(binding = 1) uniform RESOURCE source;
#endif

const int SIDE = 256;

void main() {
    const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    vec4 sum = vec4(0.0);
    // Neighbours are 13/16 texels apart, and no place is a border of texels.
    vec2 place = (vec2(pixel) * 0.8125 + 0.28) / float(SIDE);
#if SHAPE == 2
    vec3 direction = vec3(place * 2.0 - 0.8, 1.0);
#endif
    for (int turn = 0; turn < TURNS; turn++) {
#if ACCESS == STORE
    #if INTEGERS
        COMPONENTS value = COMPONENTS(pixel.x & 63, pixel.y & 31, turn, 1);
    #else
        COMPONENTS value = COMPONENTS(place, float(turn) / 32.0, 1.0);
    #endif
        imageStore(target, ivec2(pixel.x, pixel.y + SIDE / 2 * (turn & 1)), value);
#elif ACCESS == FETCH
    #if SHAPE == 0
        sum += vec4(texelFetch(source, pixel + ivec2(3, 5) * turn & SIDE - 1, 0));
    #elif SHAPE == 1
        sum += vec4(texelFetch(source, ivec3(pixel + 3 * turn, 5 * turn) & 63, 0));
    #else
        sum += vec4(texelFetch(source, ivec3(pixel + 3 * turn & 127, turn & 3), 0));
    #endif
#else
    #if SHAPE == 0
        vec2 at = place + vec2(float(turn) / 64.0);
    #elif SHAPE == 1
        vec3 at = vec3(place * 4.0, (float(turn) + 0.28) / 64.0);
    #elif SHAPE == 2
        direction = vec3(direction.yz, -direction.x);
        vec3 at = direction;
    #else
        vec3 at = vec3(place * 2.0 + float(turn) / 64.0, float(turn & 3));
    #endif
    #if ACCESS == LEVELS
        float level = place.x * 2.0 + float(turn) * 0.1;
    #else
        float level = 0.0;
    #endif
    #if ACCESS == GATHER
        sum += vec4(textureGather(source, at));
    #elif ACCESS == SHADOW && SHAPE == 0
        sum.x += textureLod(source, vec3(at, 0.3 + place.y), level);
    #elif ACCESS == SHADOW
        sum.x += textureLod(source, vec4(at, 0.3 + place.y), level);
    #else
        sum += vec4(textureLod(source, at, level));
    #endif
#endif
    }
    result[pixel.y * SIDE + pixel.x] = sum / float(TURNS);
}
