// Where a ray first meets a procedural primitive; negative if it does not.
float procedural_meeting(uint number, uint instance, vec3 origin, vec3 direction, out vec3 outward) {
    Procedural self = procedurals[number];
    mat4x3 to_world = transform_of(instance);
    if (instances[instance].hit_group == SPONGE) {
        return sponge_meeting(self, to_world, origin, direction, 0.0, outward);
    }
    Chord c = chord(self, to_world, origin, direction);
    float t = end_of(c, 0);
    if (t <= 0.0) {
        t = end_of(c, 1);
    }
    outward = outward_at(c, t);
    return c.half_chord < 0.0 || t <= 0.0 ? -1.0 : t;
}
