//! The landscape's textures, painted by code.

use super::noise::{fractal, gradient, smoothstep};
use super::random::hash;
use super::texture::{Texture, Wrap};

type Rgb = [f32; 3];

fn mix(a: Rgb, b: Rgb, t: f32) -> Rgb {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

fn opaque([r, g, b]: Rgb) -> [f32; 4] {
    [r, g, b, 1.0]
}

pub fn grass() -> Texture {
    Texture::painted(512, |x, y| {
        let broad = fractal(x * 6.0, y * 6.0, 4, 6, 1) * 0.5 + 0.5;
        let fine = fractal(x * 64.0, y * 64.0, 3, 64, 2) * 0.5 + 0.5;
        let green = mix([0.035, 0.085, 0.014], [0.13, 0.19, 0.035], broad);
        let dry = smoothstep(
            0.55,
            0.85,
            fractal(x * 11.0, y * 11.0, 3, 11, 3) * 0.5 + 0.5,
        );
        let colour = mix(green, [0.24, 0.2, 0.07], dry * 0.6);
        opaque(colour.map(|c| c * (0.55 + 0.9 * fine)))
    })
}

pub fn rock() -> Texture {
    Texture::painted(512, |x, y| {
        let warp = fractal(x * 5.0, y * 5.0, 3, 5, 11);
        let strata = fractal(x * 4.0, y * 16.0 + 2.0 * warp, 4, 0, 12) * 0.5 + 0.5;
        // Strata are not periodic in the warped direction; fade to plain noise at the seam.
        let seam = smoothstep(0.0, 0.12, y)
            * smoothstep(1.0, 0.88, y)
            * smoothstep(0.0, 0.12, x)
            * smoothstep(1.0, 0.88, x);
        let grain = fractal(x * 40.0, y * 40.0, 4, 40, 13) * 0.5 + 0.5;
        let tone = grain + (strata - grain) * 0.65 * seam;
        let crack = smoothstep(0.05, 0.0, fractal(x * 8.0, y * 8.0, 4, 8, 14).abs());
        let colour = mix([0.10, 0.092, 0.085], [0.34, 0.305, 0.27], tone);
        opaque(colour.map(|c| c * (1.0 - 0.5 * crack)))
    })
}

pub fn sand() -> Texture {
    Texture::painted(256, |x, y| {
        let grain = gradient(x * 128.0, y * 128.0, 128, 21) * 0.5 + 0.5;
        let patch = fractal(x * 8.0, y * 8.0, 4, 8, 22) * 0.5 + 0.5;
        let pebble = smoothstep(0.42, 0.55, gradient(x * 30.0, y * 30.0, 30, 23));
        let colour = mix([0.3, 0.24, 0.15], [0.46, 0.39, 0.27], patch);
        opaque(mix(
            colour.map(|c| c * (0.8 + 0.3 * grain)),
            [0.22, 0.21, 0.2],
            pebble * 0.7,
        ))
    })
}

pub fn bark() -> Texture {
    Texture::painted(256, |x, y| {
        let warp = fractal(x * 4.0, y * 4.0, 3, 4, 31);
        let ridge = gradient(x * 14.0 + 1.2 * warp, y * 3.0, 0, 32).abs();
        let seam = smoothstep(0.0, 0.1, x) * smoothstep(1.0, 0.9, x);
        let grain = fractal(x * 24.0, y * 24.0, 3, 24, 33) * 0.5 + 0.5;
        let tone = (0.35 + 0.65 * ridge * seam) * (0.6 + 0.7 * grain);
        opaque(mix([0.045, 0.032, 0.022], [0.25, 0.19, 0.14], tone))
    })
}

/// A leaf of a spray: where it grows from, which way, and how it looks.
struct Leaf {
    root: (f32, f32),
    /// Its direction, divided by its length.
    along: (f32, f32),
    tone: f32,
}

/// The leaves of one cell of the atlas, in the order in which they cover each other.
fn spray(cell: u32) -> Vec<Leaf> {
    let leaf = |leaf: u32| {
        let random = |n: u32| hash(cell * 1000 + leaf * 10 + n) as f32 / u32::MAX as f32;
        let turn = std::f32::consts::TAU * (leaf as f32 * 0.382 + 0.1 * random(1));
        let ring = ((leaf as f32 + 0.5) / 17.0).sqrt() * 0.62 * 0.95;
        let (sine, cosine) = libm::sincosf(turn);
        let length = 0.36 + 0.16 * random(3);
        let (leaf_sine, leaf_cosine) = libm::sincosf(turn + (random(2) - 0.5) * 1.6);
        Leaf {
            root: (ring * cosine, ring * sine),
            along: (leaf_cosine / length, leaf_sine / length),
            tone: 0.25 + 0.6 * random(4),
        }
    };
    (0..17).map(leaf).collect()
}

/// Four sprays of leaves, each on a quarter of the texture; alpha is 0 between the leaves.
pub fn leaves(autumn: bool) -> Texture {
    let (dark, light, between) = if autumn {
        ([0.30, 0.085, 0.012], [0.62, 0.30, 0.03], [0.35, 0.14, 0.02])
    } else {
        ([0.035, 0.10, 0.014], [0.17, 0.27, 0.03], [0.07, 0.14, 0.02])
    };
    let sprays: [Vec<Leaf>; 4] = std::array::from_fn(|cell| spray(cell as u32));
    let mut texture = Texture::painted(512, |x, y| {
        let cell = (x * 2.0) as usize + 2 * (y * 2.0) as usize;
        let (u, v) = ((x * 2.0).fract() * 2.0 - 1.0, (y * 2.0).fract() * 2.0 - 1.0);
        // The last leaf that covers the place is on top.
        for leaf in sprays[cell].iter().rev() {
            let (dx, dy) = (u - leaf.root.0, v - leaf.root.1);
            let along = dx * leaf.along.0 + dy * leaf.along.1;
            let across = (dy * leaf.along.0 - dx * leaf.along.1).abs();
            if !(0.0..=1.0).contains(&along) {
                continue;
            }
            let profile = 0.30 * along.sqrt() * (1.0 - along) * 2.6;
            if across < profile {
                let vein = smoothstep(0.025, 0.0, across);
                let ribs = libm::cosf(along * 38.0 - across * 30.0);
                let colour = mix(dark, light, leaf.tone + 0.08 * ribs);
                return opaque(mix(colour, [0.45, 0.5, 0.2], vein * 0.35));
            }
        }
        let [r, g, b] = between;
        [r, g, b, 0.0]
    });
    texture.wrap = Wrap::Clamp;
    texture
}

/// Four sprays of needles on twigs.
pub fn needles() -> Texture {
    let mut texture = Texture::painted(512, |x, y| {
        let cell = (x * 2.0) as u32 + 2 * (y * 2.0) as u32;
        let (u, v) = ((x * 2.0).fract() * 2.0 - 1.0, 1.0 - (y * 2.0).fract());
        let mut colour = None;
        if u.abs() < 0.03 && v < 0.96 {
            colour = Some([0.10, 0.065, 0.03]);
        }
        for needle in 0..46u32 {
            let random = |n: u32| hash(cell * 977 + needle * 13 + n) as f32 / u32::MAX as f32;
            let from = needle as f32 / 46.0 * 0.92;
            let side = if needle % 2 == 0 { 1.0 } else { -1.0 };
            let reach = (0.9 - 0.45 * from) * (0.75 + 0.25 * random(1));
            let rise = 0.30 + 0.16 * random(2);
            let along = u * side / reach;
            if (0.0..1.0).contains(&along) {
                let middle = from + rise * along * (1.0 - 0.25 * along);
                let half = 0.022 * (1.0 - along * along * 0.8);
                if (v - middle).abs() < half {
                    colour = Some(mix([0.016, 0.06, 0.022], [0.07, 0.15, 0.05], random(3)));
                }
            }
        }
        match colour {
            Some([r, g, b]) => [r, g, b, 1.0],
            None => [0.03, 0.08, 0.03, 0.0],
        }
    });
    texture.wrap = Wrap::Clamp;
    texture
}

/// A blade of grass from tip (top) to foot, each column another green.
pub fn blades() -> Texture {
    let mut texture = Texture::painted(64, |x, y| {
        let tone = hash((x * 64.0) as u32 + 71) as f32 / u32::MAX as f32;
        let tip = mix([0.16, 0.24, 0.04], [0.36, 0.34, 0.11], tone * tone);
        opaque(mix(tip, [0.035, 0.075, 0.012], y))
    });
    texture.wrap = Wrap::Clamp;
    texture
}

/// Stone slabs with joints.
pub fn slabs() -> Texture {
    Texture::painted(512, |x, y| {
        let row = (y * 4.0).floor();
        let shift = if (row as u32).is_multiple_of(2) {
            0.0
        } else {
            0.25
        };
        let (u, v) = (((x + shift) * 2.0).fract(), (y * 4.0).fract());
        let edge = (u.min(1.0 - u) * 2.0).min(v.min(1.0 - v));
        let joint = smoothstep(
            0.035,
            0.015,
            edge + 0.01 * gradient(x * 60.0, y * 60.0, 60, 41),
        );
        let slab =
            hash(((x + shift) * 2.0) as u32 % 2 + row as u32 * 7 + 5) as f32 / u32::MAX as f32;
        let grain = fractal(x * 24.0, y * 24.0, 5, 24, 42) * 0.5 + 0.5;
        let colour = mix(
            [0.33, 0.31, 0.28],
            [0.52, 0.48, 0.43],
            slab * 0.6 + grain * 0.4,
        );
        opaque(mix(
            colour.map(|c| c * (0.75 + 0.4 * grain)),
            [0.10, 0.10, 0.08],
            joint,
        ))
    })
}

/// The density of the clouds; a map, read linearly.
pub fn clouds() -> Texture {
    let mut texture = Texture::painted(512, |x, y| {
        let warp = fractal(x * 3.0, y * 3.0, 3, 3, 51);
        let large = fractal(x * 4.0 + 0.35 * warp, y * 4.0 + 0.35 * warp, 7, 4, 52);
        opaque([0.5 + 0.8 * large; 3])
    });
    texture.srgb = false;
    // Data that was encoded as a colour is to be read unchanged.
    let decode = super::texture::srgb_table();
    for level in &mut texture.levels {
        for texel in level {
            for channel in &mut texel[..3] {
                *channel = (decode[usize::from(*channel)] * 255.0 + 0.5) as u8;
            }
        }
    }
    texture
}
