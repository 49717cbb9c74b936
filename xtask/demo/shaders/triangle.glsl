// The triangle under a hit.
struct Triangle {
    Vertex a, b, c;
    Material material;
};

Triangle triangle_here() {
    Geometry geometry = geometries[gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT];
    uint first = geometry.first_index + 3u * gl_PrimitiveID;
    return Triangle(
        vertices[geometry.first_vertex + indices[first]],
        vertices[geometry.first_vertex + indices[first + 1u]],
        vertices[geometry.first_vertex + indices[first + 2u]],
        materials[geometry.material]);
}
