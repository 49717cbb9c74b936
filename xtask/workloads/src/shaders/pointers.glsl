layout(buffer_reference, std430) readonly buffer Place;
layout(buffer_reference, std430) readonly buffer Place { Place next; float value; uint number; };
layout(set = 0, binding = 5, std430) readonly buffer Start { Place places[]; };

// Follows a list, and now and then begins anew.
void main() {
    Place place = places[number() & 4095u];
    float sum = 0.0;
    for (int hop = 0; hop < 64; hop++) {
        sum = 0.9 * sum + place.value;
        uint turn = place.number & 3u;
        place = place.next;
        if (turn == 0u)
            place = places[place.number & 4095u];
    }
    put(vec3(sum, 0.5 * sum, 0.25 * sum) * 0.1, 1.0);
}
