layout(set = 0, binding = 5) uniform sampler2D image;

void main() {
    vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 32; i++) {
        float turn = float(i) * 0.7;
        sum += textureLod(image, at * (1.0 + 0.1 * float(i)) + 0.3 * vec2(cos(turn), sin(turn)), float(i) * 0.15).rgb;
    }
    put(sum / 32.0, 1.0);
}
