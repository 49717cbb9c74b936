//! Gradient noise in two dimensions, optionally periodic, and sums of its octaves.

use super::random::hash;

/// Gradient noise, roughly in −1..1, that repeats every `period` units in both directions
/// (0: never).
pub fn gradient(x: f32, y: f32, period: i32, seed: u32) -> f32 {
    let (x0, y0) = (floor(x), floor(y));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    let corner = |dx: i32, dy: i32| {
        let (mut i, mut j) = (x0 + dx, y0 + dy);
        if period > 0 {
            (i, j) = (i.rem_euclid(period), j.rem_euclid(period));
        }
        let bits = hash((i as u32).wrapping_mul(0x8da6_b343) ^ hash((j as u32) ^ seed));
        // Sixteen directions would show; a pair of signed 12-bit numbers does not.
        let gx = (bits & 0xfff) as f32 / 2048.0 - 1.0;
        let gy = ((bits >> 12) & 0xfff) as f32 / 2048.0 - 1.0;
        gx * (fx - dx as f32) + gy * (fy - dy as f32)
    };
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(fx), fade(fy));
    let bottom = corner(0, 0) + u * (corner(1, 0) - corner(0, 0));
    let top = corner(0, 1) + u * (corner(1, 1) - corner(0, 1));
    (bottom + v * (top - bottom)) * 1.4
}

/// As `f32::floor`, which is a call into libm where the processor's instruction may not be used.
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from(whole as f32 > x)
}

/// Octaves of noise, each twice as fine and half as strong; roughly in −1..1.
pub fn fractal(x: f32, y: f32, octaves: u32, period: i32, seed: u32) -> f32 {
    let mut sum = 0.0;
    let mut weight = 0.5;
    let mut scale = 1.0f32;
    for octave in 0..octaves {
        let period = period << octave;
        sum += weight * gradient(x * scale, y * scale, period, seed.wrapping_add(octave));
        weight *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// Ridged octaves, for mountains; in 0..1.
pub fn ridged(x: f32, y: f32, octaves: u32, seed: u32) -> f32 {
    let mut sum = 0.0;
    let mut weight = 0.5;
    let mut scale = 1.0f32;
    let mut carried = 1.0;
    for octave in 0..octaves {
        let n = 1.0 - gradient(x * scale, y * scale, 0, seed.wrapping_add(octave)).abs();
        let n = n * n * carried;
        sum += weight * n;
        carried = n.clamp(0.0, 1.0);
        weight *= 0.5;
        scale *= 2.07;
    }
    sum
}

pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
