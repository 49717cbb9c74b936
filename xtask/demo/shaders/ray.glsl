// Rays from the eye, and what becomes of them at surfaces.

// Light found by chance through a mirror is cut off here, or a few pixels would sparkle for ever.
const float MAX_INDIRECT = 12.0;

// The direction of the ray through a place of the picture, in pixels from its upper left corner.
vec3 towards(vec2 pixel) {
    precise vec2 pixels = 2.0 / vec2(camera_right.w, camera_up.w);
    precise vec2 place = pixel * pixels - 1.0;
    return unit(combine(camera_forward.xyz, camera_right.xyz, camera_up.xyz, vec3(1.0, place.x, -place.y)));
}

// The reflectance of a smooth dielectric; `eta` is the ratio of the indices, incident over other.
float fresnel(float cosine, float eta) {
    precise float sine2 = eta * eta * (1.0 - cosine * cosine);
    if (sine2 >= 1.0) {
        return 1.0;
    }
    precise float other = sqrt(1.0 - sine2);
    precise float s = (eta * cosine - other) * (1.0 / (eta * cosine + other));
    precise float p = (cosine - eta * other) * (1.0 / (cosine + eta * other));
    precise float result = 0.5 * (s * s + p * p);
    return result;
}

// The origin of a ray that leaves a surface on the side of `face`.
vec3 leave(vec3 position, vec3 face, float t) {
    vec3 size = abs(position);
    precise float step = epsilon + 4e-6 * max(max(size.x, size.y), max(size.z, t));
    precise vec3 away = face * step;
    precise vec3 result = position + away;
    return result;
}

// The sun's disc in the sky. Its rim is soft, as if it shone through a little haze.
vec3 disc_towards(vec3 direction) {
    float off = (1.0 - dot(direction, sun_direction.xyz)) / (1.0 - sun_direction.w);
    vec3 disc = min(sun_irradiance.xyz / sun_irradiance.w, vec3(4.0 * MAX_INDIRECT));
    return disc * smoothstep(1.6, 0.4, off);
}
