// A clear sky that brightens towards the horizon and the sun, with a layer of clouds in it.
vec3 sky_towards(vec3 d, float cone_spread) {
    float up = max(d.y, 0.0);
    float sun = clamp(dot(d, sun_direction.xyz), 0.0, 1.0);
    float horizon = 1.0 - up;
    float h2 = horizon * horizon;
    float h4 = h2 * h2;
    vec3 sky = mix(vec3(0.10, 0.24, 0.62), vec3(0.33, 0.52, 0.86), h2);
    sky = mix(sky, haze.xyz, h4 * h4);
    float s2 = sun * sun;
    float s8 = s2 * s2 * s2 * s2;
    sky += vec3(0.9, 0.55, 0.25) * (0.22 * s8 * horizon + 0.5 * s8 * s8 * s8 * s8);

    if (cloud_texture != NONE && d.y > 0.015) {
        vec2 place = d.xz / (d.y + 0.12);
        float lod = 2.0 + 2.0 * horizon + (cone_spread > 0.05 ? 4.0 : -2.0);
        float density = textureLod(textures[nonuniformEXT(cloud_texture)], place * 0.16, lod).r;
        float cover = smoothstep(0.50, 0.86, density) * smoothstep(0.015, 0.16, d.y);
        vec3 bright = vec3(1.05, 0.98, 0.90) + vec3(0.8, 0.5, 0.25) * s8;
        vec3 cloud = mix(bright, vec3(0.55, 0.60, 0.72), smoothstep(0.62, 1.0, density));
        sky = mix(sky, cloud, cover * 0.92);
    }
    if (d.y < 0.0) {
        sky = mix(haze.xyz, vec3(0.20, 0.21, 0.20), clamp(-d.y * 6.0, 0.0, 1.0));
    }
    return sky;
}
