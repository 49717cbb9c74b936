//! Textures with their mip levels.

use rayon::prelude::*;

/// The extension of a texture beyond its edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    Repeat,
    Clamp,
    Mirror,
}

/// An RGBA picture of 8 bits a channel, with its whole mip chain.
#[derive(Clone, Debug)]
pub struct Texture {
    pub width: u32,
    pub height: u32,
    /// True when RGB is sRGB-encoded: colours are, data is not.
    pub srgb: bool,
    pub wrap: Wrap,
    /// Row-major texels of each level, from the finest to 1×1.
    pub levels: Vec<Vec<[u8; 4]>>,
}

impl Texture {
    /// Filters the mip levels of a picture. Averages are taken of linear colours, weighted by
    /// alpha, so that invisible texels do not bleed.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>, srgb: bool, wrap: Wrap) -> Texture {
        assert_eq!(texels.len(), (width * height) as usize);
        let mut levels = vec![texels];
        let (mut w, mut h) = (width as usize, height as usize);
        let decode = if srgb { srgb_table() } else { linear_table() };
        while w > 1 || h > 1 {
            let above = levels.last().expect("there is a finest level");
            let (half_w, half_h) = ((w / 2).max(1), (h / 2).max(1));
            let filtered = (0..half_h).into_par_iter().flat_map_iter(|y| {
                let decode = &decode;
                (0..half_w).map(move |x| {
                    let at = |dx: usize, dy: usize| {
                        above[(2 * y + dy).min(h - 1) * w + (2 * x + dx).min(w - 1)]
                    };
                    average([at(0, 0), at(1, 0), at(0, 1), at(1, 1)], decode)
                })
            });
            let level = filtered.collect();
            levels.push(level);
            (w, h) = (half_w, half_h);
        }
        Texture {
            width,
            height,
            srgb,
            wrap,
            levels,
        }
    }

    /// Paints a square colour texture that repeats; `paint` gets coordinates in 0..1 and returns
    /// linear RGB and alpha.
    pub fn painted(size: u32, paint: impl Fn(f32, f32) -> [f32; 4] + Sync) -> Texture {
        let decode = srgb_table();
        let encode = |x: f32| decode.partition_point(|d| *d < x.clamp(0.0, 1.0)).min(255) as u8;
        let texels = (0..size * size)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % size, i / size);
                let centre = |i: u32| (i as f32 + 0.5) / size as f32;
                let [r, g, b, a] = paint(centre(x), centre(y));
                [
                    encode(r),
                    encode(g),
                    encode(b),
                    (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8,
                ]
            })
            .collect();
        Texture::new(size, size, texels, true, Wrap::Repeat)
    }
}

fn average(texels: [[u8; 4]; 4], decode: &[f32; 256]) -> [u8; 4] {
    let alpha: u32 = texels.iter().map(|texel| u32::from(texel[3])).sum();
    let mut mean = [0, 0, 0, ((alpha + 2) / 4) as u8];
    for channel in 0..3 {
        let weight = |texel: &[u8; 4]| if alpha == 0 { 1.0 } else { f32::from(texel[3]) };
        let total: f32 = texels.iter().map(weight).sum();
        let sum: f32 = texels
            .iter()
            .map(|texel| decode[usize::from(texel[channel])] * weight(texel))
            .sum();
        // The nearest code: the table is monotonic.
        let value = sum / total;
        let above = decode.partition_point(|d| *d < value).min(255);
        let below = above.saturating_sub(1);
        let nearest = if value - decode[below] < decode[above] - value {
            below
        } else {
            above
        };
        mean[channel] = nearest as u8;
    }
    mean
}

/// The linear value of each sRGB code (IEC 61966-2-1).
pub fn srgb_table() -> [f32; 256] {
    std::array::from_fn(|code| {
        let c = code as f32 / 255.0;
        if c <= 0.04045 {
            c / 12.92
        } else {
            libm::powf((c + 0.055) / 1.055, 2.4)
        }
    })
}

fn linear_table() -> [f32; 256] {
    std::array::from_fn(|code| code as f32 / 255.0)
}
