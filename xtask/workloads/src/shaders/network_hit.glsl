// Before this stand `float16_t` arrays `weights` and `biases`, and `vec3 network(vec3)`.
layout(location = 0) rayPayloadInEXT Surface surface;
layout(set = 0, binding = 7, scalar) writeonly buffer Spots { vec4 spots[]; };

void main() {
    vec3 at = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
    vec3 spot = at * vec3(0.05, 0.5, 0.05) + vec3(2.6, 2.0, 2.6);
    // The reference begins with this.
    spots[gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x] = vec4(spot, 1.0);
    surface.normal = network(spot);
    surface.t = gl_HitTEXT;
}
