// A wave field's slope: a few travelling sines, calm enough to mirror the shore.
vec2 ripple_slope(vec2 p) {
    precise vec2 slope = vec2(0.0);
    precise vec2 direction = vec2(0.8, 0.6);
    // In turns per metre.
    precise float frequency = 0.270563;
    precise float amplitude = 0.013;
    for (int i = 0; i < 5; i++) {
        precise float along = direction.x * p.x + direction.y * p.y;
        precise float turns = frequency * along + (0.2069014 * float(i) + time * 0.159154943);
        precise float height = amplitude * circle(turns - floor(turns)).x;
        precise vec2 part = direction * height;
        slope = slope + part;
        precise float x = direction.x * 0.28 - direction.y * 0.96;
        precise float y = direction.x * 0.96 + direction.y * 0.28;
        direction = vec2(x, y);
        frequency = frequency * 1.83;
        amplitude = amplitude * 0.72;
    }
    return slope;
}

vec3 sampled(uint index, vec2 uv, float lod_of_unit) {
    vec2 size = vec2(textureSize(textures[nonuniformEXT(index)], 0));
    float lod = lod_of_unit + 0.5 * log2(size.x * size.y);
    return textureLod(textures[nonuniformEXT(index)], uv, lod).rgb;
}

// What a ray finds where it meets a triangle. The ray's cone is in `surface`.
void shade(inout Surface surface, Triangle triangle, Meeting meeting, mat4x3 to_world, vec3 direction) {
    Vertex a = triangle.a;
    Vertex b = triangle.b;
    Vertex c = triangle.c;
    Material material = triangle.material;
    vec3 weights = meeting.weights;
    vec2 uv = mixed_uv(triangle, weights);

    vec3 edge_1 = meeting.edge_1;
    vec3 edge_2 = meeting.edge_2;
    vec3 crossed = cross3(edge_1, edge_2);
    float double_area = sqrt(dot3(crossed, crossed));
    vec3 face = unit(crossed);
    // Normals go to world space by the cofactors.
    vec3 normal = normal_by(to_world, combine(a.normal, b.normal, c.normal, weights));

    bool from_behind = dot3(face, direction) > 0.0;
    if (from_behind) {
        face = -face;
    }
    if (dot3(normal, face) < 0.0) {
        normal = -normal;
    }

    // Ray cones (Akenine-Möller et al. 2021): the level of detail for a texture of unit size.
    vec2 uv_1 = vec2(b.u - a.u, b.v - a.v);
    vec2 uv_2 = vec2(c.u - a.u, c.v - a.v);
    float uv_area = abs(uv_1.x * uv_2.y - uv_2.x * uv_1.y);
    precise float width = surface.cone_width + surface.cone_spread * meeting.t;
    precise float slant = max(abs(dot3(direction, face)), 0.05);
    float lod_of_unit = 0.5 * log2(max(uv_area / double_area, 1e-20)) + log2(max(width / slant, 1e-12));

    vec3 albedo = material.base_color;
    float roughness = material.roughness;
    float metallic = material.metallic;
    vec3 emission = material.emission;
    vec3 position = meeting.position;

    if (material.kind == TERRAIN) {
        vec3 grass = sampled(terrain_grass, uv, lod_of_unit);
        // A second, much larger scale hides the texture's repeats.
        vec3 broad = sampled(terrain_grass, uv * 0.083, lod_of_unit - 3.59);
        grass *= 0.45 + 1.9 * broad.g;
        vec3 rock = sampled(terrain_rock, uv * 0.5, lod_of_unit - 1.0);
        vec3 sand = sampled(terrain_sand, uv, lod_of_unit);
        float wobble = (broad.r - 0.15) * 2.0;
        float stony = smoothstep(0.74, 0.60, normal.y + wobble * 0.25);
        float sandy = smoothstep(0.55, 0.15, position.y + wobble * 0.3);
        albedo = mix(mix(grass, sand, sandy), rock, stony);
        roughness = 1.0;
    } else if (material.kind == WATER) {
        // Ripples fade where a pixel covers many of them.
        precise float calm = 1.0 / (1.0 + (6.0 * width) * (1.0 / slant));
        precise vec2 slope = ripple_slope(position.xz) * calm;
        normal = unit(vec3(-slope.x, face.y > 0.0 ? 1.0 : -1.0, -slope.y));
        if (dot3(normal, direction) > -0.01) {
            normal = face;
        }
    } else if (material.base_texture != NONE) {
        albedo *= sampled(material.base_texture, uv, lod_of_unit);
    }
    if (material.metal_rough_texture != NONE) {
        vec3 packed = sampled(material.metal_rough_texture, uv, lod_of_unit);
        roughness *= packed.g;
        metallic *= packed.b;
    }
    if (material.emission_texture != NONE) {
        emission *= sampled(material.emission_texture, uv, lod_of_unit);
    }
    float determinant = uv_1.x * uv_2.y - uv_2.x * uv_1.y;
    if (material.normal_texture != NONE && abs(determinant) > 1e-20) {
        vec3 bump = sampled(material.normal_texture, uv, lod_of_unit) * 2.0 - 1.0;
        bump.xy *= material.normal_scale;
        vec3 tangent = (edge_1 * uv_2.y - edge_2 * uv_1.y) / determinant;
        vec3 bitangent = (edge_2 * uv_1.x - edge_1 * uv_2.x) / determinant;
        tangent = unit(tangent - normal * dot(normal, tangent));
        // glTF's green channel points up, against the direction of v.
        vec3 across = cross(normal, tangent);
        bitangent = across * (dot(across, bitangent) < 0.0 ? 1.0 : -1.0);
        vec3 bent = unit(tangent * bump.x + bitangent * bump.y + normal * max(bump.z, 0.1));
        if (dot(bent, face) > 0.05) {
            normal = bent;
        }
    }
    // A shading normal seen from behind is bent until it is seen edge-on.
    precise float seen = -dot3(normal, direction);
    if (seen < 0.02) {
        precise vec3 bend = direction * (0.02 - seen);
        precise vec3 bent = normal - bend;
        normal = unit(bent);
    }

    surface.position = position;
    surface.normal = normal;
    surface.t = meeting.t;
    surface.face = face;
    surface.roughness = roughness;
    surface.albedo = albedo;
    surface.metallic = metallic;
    surface.emission = emission;
    surface.ior = material.kind == WATER || material.kind == GLASS ? material.ior : 0.0;
    surface.absorption = material.absorption;
    surface.translucency = material.translucency;
    surface.leaving = from_behind;
}
