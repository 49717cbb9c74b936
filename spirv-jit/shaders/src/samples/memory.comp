layout(local_size_x_id = 0, local_size_y = 2) in;
struct Inner { vec3 a; float b[3]; mat2 m; };
struct Outer { Inner inner[2]; bool flag; uint64_t wide; float16_t h; };
layout(set = 0, binding = 0, std430) buffer B { int head; Inner items[]; } b[4];
layout(set = 0, binding = 1, std140) uniform U { mat3 m; Inner one; vec4 list[5]; } u;
layout(push_constant) uniform P { uint which; vec2 scale; uvec2 address; } push;
layout(buffer_reference) buffer Node;
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Node { Node next; vec3 value; uint8_t bytes[6]; };
shared Inner tile[8];
shared uint counter;
shared bool flags[4];
int state = 3;
vec4 table[4] = vec4[](vec4(1), vec4(2), vec4(3), vec4(4));

int touch(int by) { state += by; return state; }
float sum(float values[3]) { float s = 0; for (int i = 0; i < 3; i++) s += values[i]; return s; }
Inner make(float x) { Inner r; r.a = vec3(x); r.b = float[3](x, x + 1, x + 2); r.m = mat2(x); return r; }

void main() {
    uint id = gl_LocalInvocationIndex;
    Outer o;
    o.inner[0] = b[push.which & 3].items[id];
    o.inner[1] = make(float(id));
    o.flag = id > 3;
    o.wide = uint64_t(id);
    o.h = float16_t(id);
    o.inner[id & 1].b[id % 3] += sum(o.inner[1 - (id & 1)].b);
    tile[id & 7] = o.inner[id & 1];
    flags[id & 3] = o.flag;
    atomicAdd(counter, 1u);
    memoryBarrierShared();
    barrier();
    Node node = Node(push.address);
    float total = 0;
    for (int i = 0; i < 5 && uint64_t(node) != 0; i++) {
        total += node.value.y + float(node.bytes[i]);
        node.value.x = total;
        node.bytes[5 - i] = uint8_t(i);
        node = node.next;
    }
    vec4 picked = table[id & 3];
    picked[id & 3] = u.list[id % 5].z + u.m[id % 3].y + u.one.b[2] + push.scale.y;
    table[(id + 1) & 3] = picked;
    Inner copy = tile[(id + 1) & 7];
    b[1].items[id] = copy;
    b[2].items[id].m[id & 1] = picked.xy;
    b[3].head = b[0].items.length() + touch(2) + touch(int(counter)) + (flags[0] ? 1 : 0) + int(total) + int(table[3].x);
    int old = atomicCompSwap(b[0].head, 3, 4) + atomicMin(b[0].head, 3) + atomicExchange(b[0].head, 9);
    b[0].head = old + int(o.wide) + int(o.h);
}
