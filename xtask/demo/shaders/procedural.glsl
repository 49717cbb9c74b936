// What a ray finds where it meets a procedural primitive.
void shade_procedural(inout Surface surface, Procedural self, mat4x3 to_world, vec3 origin, vec3 direction, float t, vec3 outward) {
    Material material = materials[self.material];
    vec3 normal = normal_by(to_world, outward);
    bool from_inside = dot3(normal, direction) > 0.0;
    precise vec3 way = direction * t;
    precise vec3 position = origin + way;
    surface.position = position;
    if (from_inside) {
        normal = -normal;
    }
    surface.normal = normal;
    surface.t = t;
    surface.face = normal;
    surface.roughness = material.roughness;
    surface.albedo = material.base_color;
    surface.metallic = material.metallic;
    surface.emission = material.emission;
    surface.ior = material.kind == GLASS ? material.ior : 0.0;
    surface.absorption = material.absorption;
    surface.translucency = 0.0;
    surface.leaving = from_inside;
}
