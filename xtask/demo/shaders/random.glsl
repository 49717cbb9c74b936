// Low-discrepancy samples: the first two Sobol' dimensions, Owen-scrambled by hashing and padded
// with a fresh scramble for every decision (Laine and Karras 2011; Burley 2020).

uint hash(uint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

// An Owen scramble of a number whose most significant digit is bit 0.
uint scramble_reversed(uint x, uint seed) {
    x += seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return x;
}

uint scramble(uint x, uint seed) {
    return bitfieldReverse(scramble_reversed(bitfieldReverse(x), seed));
}

struct Sampler {
    uint pixel_seed;
    uint index;
    uint decision;
};

// The next point of the pixel's sequence, in [0, 1)².
vec2 next_2d(inout Sampler s) {
    uint seed = hash(s.pixel_seed ^ (s.decision * 0x9e3779b9u));
    s.decision += 1u;
    uint index = scramble(s.index, seed);
    // Dimension 0 is the radical inverse; dimension 1 is Pascal's matrix over GF(2) applied to it.
    uint x = bitfieldReverse(index);
    uint y = x;
    y ^= (y & 0x55555555u) << 1;
    y ^= (y & 0x33333333u) << 2;
    y ^= (y & 0x0f0f0f0fu) << 4;
    y ^= (y & 0x00ff00ffu) << 8;
    y ^= (y & 0x0000ffffu) << 16;
    x = scramble(x, hash(seed ^ 0x68bc21ebu));
    y = scramble(y, hash(seed ^ 0x02e5be93u));
    return vec2(float(x >> 8), float(y >> 8)) * (1.0 / 16777216.0);
}
