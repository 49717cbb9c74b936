layout(location = 0) rayPayloadInEXT Surface surface;
layout(location = 0) callableDataEXT vec3 colour;
layout(shaderRecordEXT, std430) buffer Record { vec4 tint; uint pattern; };

void main() {
    colour = gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT;
    executeCallableEXT(pattern, 0);
    surface.normal = colour * tint.rgb;
}
