// What the shaders share: the buffers, and the record that a ray brings home.
// The Rust side of each structure is in src/scene/mod.rs and src/render.rs.
#ifdef RASTER
#extension GL_EXT_ray_query : require
#else
#extension GL_EXT_ray_tracing : require
#endif
#extension GL_EXT_nonuniform_qualifier : require
#extension GL_EXT_scalar_block_layout : enable
#include "exact.glsl"

const uint NONE = 0xffffffffu;
const float PI = 3.14159265358979;

// In place of a material's cutoff: alpha is how likely a hit is to be one.
const float BY_CHANCE = 2.0;

// Kinds of material.
const uint PLAIN = 0u;
const uint TERRAIN = 1u; // grass, rock and sand by slope and height
const uint WATER = 2u;   // rippled, refracting
const uint GLASS = 3u;

// Instance masks: shadow rays see only what blocks light.
const uint MASK_BLOCKS_LIGHT = 1u;
const uint MASK_ALL = 3u;

struct Vertex {
    vec3 position;
    float u;
    vec3 normal;
    float v;
};

struct Geometry {
    uint first_index;
    uint first_vertex;
    uint material;
    uint unused;
};

struct Material {
    vec3 base_color;
    float alpha_cutoff;
    vec3 emission;
    float roughness;
    vec3 absorption; // per metre, inside glass and water
    float metallic;
    uint kind;
    uint base_texture;
    uint metal_rough_texture;
    uint normal_texture;
    uint emission_texture;
    float ior;
    float translucency; // the share of diffuse light that goes through a leaf
    float normal_scale;
};

struct Procedural {
    vec3 centre;
    float radius;
    uint material;
    uint unused0, unused1, unused2;
};

layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer Radiance { vec4 radiance[]; };
layout(set = 0, binding = 2, std430) buffer RayCounts { uint ray_counts[]; };
layout(set = 0, binding = 3, std430) readonly buffer Vertices { Vertex vertices[]; };
layout(set = 0, binding = 4, std430) readonly buffer Indices { uint indices[]; };
layout(set = 0, binding = 5, std430) readonly buffer Geometries { Geometry geometries[]; };
layout(set = 0, binding = 6, std430) readonly buffer Materials { Material materials[]; };
layout(set = 0, binding = 7, std430) readonly buffer Procedurals { Procedural procedurals[]; };
layout(set = 0, binding = 8, std140) uniform Frame {
    vec4 camera_position; // w: how far a pixel's footprint grows per unit of distance
    vec4 camera_right;    // scaled so that ±1 is the picture's edge; w: width in pixels
    vec4 camera_up;       // likewise; w: height in pixels
    vec4 camera_forward;
    vec4 sun_direction;   // w: cosine of the sun's angular radius
    vec4 sun_irradiance;  // w: solid angle of the sun
    vec4 haze;            // colour; w: density per metre
    float epsilon;        // what counts as touching, in scene units
    uint terrain_grass, terrain_rock, terrain_sand;
    uint cloud_texture;
    float time;
};
layout(set = 0, binding = 9) uniform sampler2D textures[];

// What a radiance ray brings home.
struct Surface {
    vec3 position;
    vec3 normal;       // for shading, on the ray's side
    float t;           // distance; negative after a miss
    vec3 face;         // the surface's true normal, on the ray's side
    float roughness;
    vec3 albedo;
    float metallic;
    vec3 emission;     // after a miss: the sky's radiance
    float ior;         // 0 for what does not refract
    vec3 absorption;
    float translucency;
    float cone_width;  // in: the footprint at the ray's origin
    float cone_spread; // in: its growth per unit of distance
    bool leaving;      // the ray came from inside
};
