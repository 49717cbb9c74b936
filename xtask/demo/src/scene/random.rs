//! Random numbers from integers only, so that every machine makes the same scene.

/// Scrambles 32 bits: every input bit reaches every output bit.
pub fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A stream of numbers from a seed.
pub struct Random {
    state: u32,
}

impl Random {
    pub fn new(seed: u32) -> Random {
        Random {
            state: hash(seed ^ 0x9e37_79b9),
        }
    }

    pub fn bits(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9e37_79b9);
        hash(self.state)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// In [low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }
}
