hitAttributeEXT vec3 normal;

// The sphere in the unit box about the origin.
void main() {
    vec3 o = gl_ObjectRayOriginEXT;
    vec3 d = gl_ObjectRayDirectionEXT;
    vec3 middle = corners[gl_PrimitiveID];
    o -= middle;
    float a = dot(d, d);
    float b = dot(o, d);
    float c = dot(o, o) - 1.0;
    float root = b * b - a * c;
    if (root < 0.0) {
        return;
    }
    root = sqrt(root);
    float near = (-b - root) / a;
    normal = o + d * near;
    if (!reportIntersectionEXT(near, 0)) {
        float far = (-b + root) / a;
        normal = o + d * far;
        reportIntersectionEXT(far, 1);
    }
}
