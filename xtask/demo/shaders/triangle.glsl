// A triangle of the scene.
struct Triangle {
    Vertex a, b, c;
    Material material;
};

Triangle triangle_of(Geometry geometry, uint primitive) {
    uint first = geometry.first_index + 3u * primitive;
    return Triangle(
        vertices[geometry.first_vertex + indices[first]],
        vertices[geometry.first_vertex + indices[first + 1u]],
        vertices[geometry.first_vertex + indices[first + 2u]],
        materials[geometry.material]);
}

// Where the ray meets the triangle, computed here (Möller and Trumbore 1997) rather than taken from the driver, so that what follows from
// it is the same on all of them.
struct Meeting {
    vec3 weights;
    vec3 position;
    float t;
    vec3 edge_1, edge_2; // in the world
};

// A corner's place in the world.
vec3 placed_by(mat4x3 to_world, vec3 position) {
    precise vec3 result = combine(to_world[0], to_world[1], to_world[2], position) + to_world[3];
    return result;
}

// `otherwise`: barycentrics and distance of a triangle that is seen from its edge, which has no answer of its own.
Meeting meet(Triangle triangle, mat4x3 to_world, vec3 origin, vec3 direction, vec3 otherwise) {
    vec3 edge_1 = combine(to_world[0], to_world[1], to_world[2], triangle.b.position - triangle.a.position);
    vec3 edge_2 = combine(to_world[0], to_world[1], to_world[2], triangle.c.position - triangle.a.position);
    vec3 corner = placed_by(to_world, triangle.a.position);
    precise vec3 from_corner = origin - corner;
    vec3 p = cross3(direction, edge_2);
    vec3 q = cross3(from_corner, edge_1);
    precise float inverse = 1.0 / dot3(edge_1, p);
    precise float u = dot3(from_corner, p) * inverse;
    precise float v = dot3(direction, q) * inverse;
    precise float t = dot3(edge_2, q) * inverse;
    if (!(abs(u) < 2.0 && abs(v) < 2.0)) {
        u = otherwise.x;
        v = otherwise.y;
        t = otherwise.z;
    }
    u = clamp(u, 0.0, 1.0);
    v = clamp(v, 0.0, 1.0 - u);
    precise vec3 part_1 = edge_1 * u;
    precise vec3 part_2 = edge_2 * v;
    precise vec3 position = corner + (part_1 + part_2);
    precise float w = (1.0 - u) - v;
    return Meeting(vec3(w, u, v), position, t, edge_1, edge_2);
}

vec2 mixed_uv(Triangle triangle, vec3 weights) {
    vec3 u = vec3(triangle.a.u, triangle.b.u, triangle.c.u);
    vec3 v = vec3(triangle.a.v, triangle.b.v, triangle.c.v);
    return vec2(dot3(u, weights), dot3(v, weights));
}
