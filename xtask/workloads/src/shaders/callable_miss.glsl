layout(location = 0) rayPayloadInEXT Surface surface;
layout(shaderRecordEXT, std430) buffer Record { vec4 tint; };

void main() {
    surface.normal = sky(gl_WorldRayDirectionEXT) * tint.rgb;
}
