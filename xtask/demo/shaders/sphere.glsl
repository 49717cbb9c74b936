// Where a line meets a sphere, centred and sized by its record: at `middle` minus and plus `half_chord`, negative where it passes by. The
// discriminant is formed from the perpendicular to the ray, which keeps its digits when the sphere is far away (Haines et al. 2019).
struct Chord {
    vec3 from_centre; // the origin, in object space
    vec3 direction;   // likewise
    float middle;
    float half_chord;
    float scale;
};

Chord chord(Procedural self, mat4x3 to_world, vec3 origin, vec3 direction) {
    precise vec3 from_origin = origin - to_world[3];
    vec3 object_origin = undone(to_world, from_origin);
    vec3 d = undone(to_world, direction);
    precise vec3 f = object_origin - self.centre;
    precise float inverse = 1.0 / dot3(d, d);
    precise float middle = -dot3(f, d) * inverse;
    precise vec3 along = d * middle;
    precise vec3 nearest = f + along;
    precise float discriminant = self.radius * self.radius - dot3(nearest, nearest);
    precise float half_chord = discriminant < 0.0 ? -1.0 : sqrt(discriminant * inverse);
    precise float scale = 1.0 / self.radius;
    return Chord(f, d, middle, half_chord, scale);
}

float end_of(Chord c, int side) {
    precise float t = side == 0 ? c.middle - c.half_chord : c.middle + c.half_chord;
    return t;
}

vec3 outward_at(Chord c, float t) {
    precise vec3 there = c.direction * t;
    precise vec3 radial = c.from_centre + there;
    precise vec3 result = radial * c.scale;
    return result;
}

// Light on its way to a shaded point passes the middle of a glass ball and is lost at its rim,
// which is roughly where the ball's caustic and its shadow would fall.
bool lets_light_through(Procedural self, mat4x3 to_world, vec3 outward, vec3 direction) {
    return materials[self.material].kind == GLASS && abs(dot3(normal_by(to_world, outward), direction)) > 0.55;
}
