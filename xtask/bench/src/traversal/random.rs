//! Random numbers from integers only, so that every machine makes the same scenes and rays.

use super::vector::{Vector, dot, scale};

/// Scrambles 32 bits.
pub fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

/// A stream of numbers from a seed.
pub struct Random(u32);

impl Random {
    pub fn new(seed: u32) -> Random {
        Random(hash(seed ^ 0x9E37_79B9))
    }

    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9);
        hash(self.0)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 24) as f32
    }

    /// In [low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// In a cube of edge 2 around the origin.
    pub fn vector(&mut self) -> Vector {
        [(); 3].map(|()| self.between(-1.0, 1.0))
    }

    /// Of length 1, any direction alike.
    pub fn direction(&mut self) -> Vector {
        loop {
            let v = self.vector();
            let square = dot(v, v);
            if (1e-4..1.0).contains(&square) {
                return scale(v, 1.0 / square.sqrt());
            }
        }
    }
}
