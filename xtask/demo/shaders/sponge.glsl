// Menger's sponge, marched by its distance bound: a cube from which square bars are taken along
// the three axes, again and again at a third of the size.
const int LEVELS = 4;
const int MAX_STEPS = 96;
// Walls lie at multiples of the smallest cell: 3^LEVELS of them along the cube's side of 2.
const float CELLS_PER_UNIT = 40.5;

float cube(vec3 p) {
    vec3 q = abs(p) - 1.0;
    return max(max(q.x, q.y), q.z);
}

float sponge(vec3 p) {
    float d = cube(p);
    float scale = 1.0;
    float thirds = 1.0;
    for (int i = 0; i < LEVELS; i++) {
        precise vec3 scaled = p * scale;
        precise vec3 a = scaled - 2.0 * floor(scaled * 0.5) - 1.0;
        scale *= 3.0;
        thirds *= 0.333333343;
        precise vec3 r = abs(1.0 - 3.0 * abs(a));
        float x = max(r.x, r.y);
        float y = max(r.y, r.z);
        float z = max(r.z, r.x);
        precise float bars = (min(x, min(y, z)) - 1.0) * thirds;
        d = max(d, bars);
    }
    return d;
}

// The distance, not less than `t_min`, at which a ray meets the sponge; negative if it does not.
float sponge_meeting(Procedural self, mat4x3 to_world, vec3 ray_origin, vec3 ray_direction, float t_min, out vec3 outward) {
    precise vec3 from_origin = ray_origin - to_world[3];
    vec3 object_origin = undone(to_world, from_origin);
    vec3 object_direction = undone(to_world, ray_direction);
    precise float shrink = 1.0 / self.radius;
    precise vec3 origin = (object_origin - self.centre) * shrink;
    precise vec3 along = object_direction * shrink;
    precise float speed = sqrt(dot3(along, along));
    precise float slowness = 1.0 / speed;
    precise vec3 d = along * slowness;

    // Where the ray is inside the unit cube.
    precise vec3 inverse = 1.0 / d;
    precise vec3 t0 = (-1.0 - origin) * inverse;
    precise vec3 t1 = (1.0 - origin) * inverse;
    vec3 lo = min(t0, t1);
    vec3 hi = max(t0, t1);
    precise float t = max(max(max(lo.x, lo.y), lo.z), t_min * speed);
    float end = min(min(hi.x, hi.y), hi.z);

    for (int i = 0; i < MAX_STEPS && t <= end; i++) {
        precise vec3 way = d * t;
        precise vec3 p = origin + way;
        precise float distance = sponge(p);
        if (distance < 0.0004) {
            // Every wall is square to an axis: the one along which the bound changes most, by
            // central differences. The hit is where the ray meets the wall's plane, and so does
            // not depend on how the march came there.
            vec2 e = vec2(0.0008, 0.0);
            vec3 n = vec3(
                sponge(p + e.xyy) - sponge(p - e.xyy),
                sponge(p + e.yxy) - sponge(p - e.yxy),
                sponge(p + e.yyx) - sponge(p - e.yyx));
            vec3 a = abs(n);
            int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
            if (n[axis] * d[axis] < 0.0) {
                outward = vec3(0.0);
                outward[axis] = n[axis] > 0.0 ? 1.0 : -1.0;
                precise float plane = floor((p[axis] + 1.0) * CELLS_PER_UNIT + 0.5) * (1.0 / CELLS_PER_UNIT) - 1.0;
                precise float meeting = ((plane - origin[axis]) * inverse[axis]) * slowness;
                return meeting;
            }
            // A ray that starts on a wall leaves it.
            distance = 0.002;
        }
        t += distance;
    }
    return -1.0;
}
