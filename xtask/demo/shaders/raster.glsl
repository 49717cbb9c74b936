// What the rasterizing shaders share. `Instance` is in src/raster.rs, too.

struct Instance {
    vec4 rows[3];
    uint hit_group; // 0 for triangles
    uint unused0, unused1, unused2;
};

const uint SPHERE = 1u;
const uint SPONGE = 2u;

layout(set = 1, binding = 0, std430) readonly buffer Instances { Instance instances[]; };
layout(set = 1, binding = 1, std430) readonly buffer Drawn { uint drawn[]; }; // instances in the order of the draws

layout(push_constant) uniform Draw {
    uint model; // a geometry's index, or a procedural's
};

// Depth is this over the distance along the view's axis: what is nearer is greater, and nothing is too far.
const float NEAR = 0.0009765625;

mat4x3 transform_of(uint instance) {
    vec4 x = instances[instance].rows[0];
    vec4 y = instances[instance].rows[1];
    vec4 z = instances[instance].rows[2];
    return mat4x3(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z, x.w, y.w, z.w);
}

vec4 projected(vec3 position) {
    precise vec3 d = position - camera_position.xyz;
    precise float x = dot3(d, camera_right.xyz) * (1.0 / dot3(camera_right.xyz, camera_right.xyz));
    precise float y = dot3(d, camera_up.xyz) * (-1.0 / dot3(camera_up.xyz, camera_up.xyz));
    return vec4(x, y, NEAR, dot3(d, camera_forward.xyz));
}
