//! From clip coordinates to the screen: viewports, and positions in fixed point.

#![forbid(unsafe_code)]

use ash::vk;

use crate::raster::primitive::Bounds;

/// Fixed-point units of a pixel (`subPixelPrecisionBits` is 8).
pub const PIXEL: i32 = 256;

/// Pixels from the origin within which positions are snapped; what reaches further is clipped.
/// Edges of primitives inside have coefficients in 31 bits.
pub const GUARD: f64 = (1 << 21) as f64;

/// Rounds to the nearest integer, ties to even. The value is less than 2³¹ in magnitude.
#[inline(always)]
pub fn round(value: f64) -> i32 {
    // Where one unit in the last place is 1, the addition rounds; the low bits of the sum are the
    // integer.
    const ROUNDER: f64 = 6_755_399_441_055_744.0;
    (value + ROUNDER).to_bits() as i32
}

/// A position in clip coordinates.
pub type Clip = [f64; 4];

/// A viewport: how clip coordinates become pixels and depths.
#[derive(Clone, Copy, Debug)]
pub struct Screen {
    /// Pixels of a unit of normalised device coordinates, and where 0 is: x, y.
    pub scale: [f64; 2],
    pub offset: [f64; 2],
    pub depth_scale: f64,
    pub depth_offset: f64,
    /// The pixels whose centres are inside.
    pub inside: Bounds,
    /// The viewport's sides lie between pixels: no sample of a pixel inside is outside.
    pub whole_pixels: bool,
}

impl Screen {
    /// Of a viewport; with `negative_one_to_one`, depths go from −w to w.
    pub fn new(viewport: &vk::Viewport, negative_one_to_one: bool) -> Self {
        let [x, y, width, height, near, far] = [
            viewport.x,
            viewport.y,
            viewport.width,
            viewport.height,
            viewport.min_depth,
            viewport.max_depth,
        ]
        .map(f64::from);
        let sides = |at: f64, size: f64| (at.min(at + size), at.max(at + size));
        let ((left, right), (top, bottom)) = (sides(x, width), sides(y, height));
        // A centre on the first side is inside, one on the other is not, as with edges of
        // primitives.
        let pixel = |side: f64| (side - 0.5).ceil() as i32;
        let half = if negative_one_to_one { 0.5 } else { 1.0 };
        Self {
            scale: [width / 2.0, height / 2.0],
            offset: [x + width / 2.0, y + height / 2.0],
            depth_scale: (far - near) * half,
            depth_offset: if negative_one_to_one {
                (far + near) / 2.0
            } else {
                near
            },
            inside: Bounds {
                left: pixel(left),
                top: pixel(top),
                right: pixel(right),
                bottom: pixel(bottom),
            },
            whole_pixels: [left, right, top, bottom]
                .iter()
                .all(|side| side.trunc() == *side),
        }
    }

    /// A position in pixels, times w.
    #[inline(always)]
    pub fn homogeneous(&self, position: &Clip) -> [f64; 2] {
        [
            position[0] * self.scale[0] + position[3] * self.offset[0],
            position[1] * self.scale[1] + position[3] * self.offset[1],
        ]
    }
}

/// Classification of a vertex: a bit for each plane of the view volume that it is outside of, and
/// others.
pub mod code {
    pub const LEFT: u32 = 1;
    pub const RIGHT: u32 = 1 << 1;
    pub const TOP: u32 = 1 << 2;
    pub const BOTTOM: u32 = 1 << 3;
    pub const NEAR: u32 = 1 << 4;
    pub const FAR: u32 = 1 << 5;
    /// The vertex has no place on the screen: w is not positive, or it is too far away.
    pub const NOWHERE: u32 = 1 << 6;
    /// A coordinate is no number or infinite: what has such a vertex is dropped.
    pub const NOT_FINITE: u32 = 1 << 7;
    /// The first of eight: a clip distance is negative.
    pub const CLIP: u32 = 8;
    /// The first of eight: a cull distance is negative.
    pub const CULL: u32 = 16;
    /// Outside of the view volume's sides.
    pub const SIDES: u32 = LEFT | RIGHT | TOP | BOTTOM;
    /// A primitive with all vertices outside one of these is dropped.
    pub const REJECT: u32 = SIDES | NEAR | FAR | 0xFF << CLIP | 0xFF << CULL;
    /// A primitive with a vertex outside one of these is clipped.
    pub const CLIPPED: u32 = NEAR | FAR | NOWHERE | 0xFF << CLIP;
    /// A line with a vertex outside one of these may end elsewhere, or be dropped.
    pub const CUT: u32 = CLIPPED | SIDES | NOT_FINITE;
}

/// A vertex on the screen.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScreenVertex {
    /// Fixed point.
    pub x: i32,
    pub y: i32,
    /// See [`code`].
    pub code: u32,
    /// Depth after the viewport.
    pub depth: f64,
    pub inverse_w: f64,
}

/// How vertices are held against the view volume.
#[derive(Clone, Copy, Debug)]
pub struct Volume {
    pub depth_clip: bool,
    pub negative_one_to_one: bool,
}

impl Volume {
    /// Bits of the planes of the volume that a position is outside of.
    #[inline(always)]
    pub fn outside(&self, position: &Clip) -> u32 {
        let [x, y, z, w] = *position;
        let bit = |outside: bool, bit: u32| if outside { bit } else { 0 };
        let mut code = bit(x < -w, code::LEFT)
            | bit(x > w, code::RIGHT)
            | bit(y < -w, code::TOP)
            | bit(y > w, code::BOTTOM);
        if self.depth_clip {
            let near = if self.negative_one_to_one { -w } else { 0.0 };
            code |= bit(z < near, code::NEAR) | bit(z > w, code::FAR);
        }
        code
    }
}

/// Puts a vertex on the screen, with the bits of its position. Without branches, for vertices side
/// by side.
#[inline(always)]
pub fn project(screen: &Screen, volume: &Volume, position: &Clip) -> ScreenVertex {
    let [x, y, z, w] = *position;
    // The sum of four that were f32 is.
    let is_finite = (x + y + z + w).is_finite();
    let inverse_w = 1.0 / w;
    let screen_x = x * inverse_w * screen.scale[0] + screen.offset[0];
    let screen_y = y * inverse_w * screen.scale[1] + screen.offset[1];
    let depth = z * inverse_w * screen.depth_scale + screen.depth_offset;
    let is_near = (screen_x.abs() <= GUARD) & (screen_y.abs() <= GUARD);
    let somewhere = is_finite & (w > 0.0) & is_near;
    let outside = if is_finite {
        volume.outside(position)
    } else {
        code::NOT_FINITE
    };
    let (x, y) = (
        round(screen_x * f64::from(PIXEL)),
        round(screen_y * f64::from(PIXEL)),
    );
    ScreenVertex {
        x: if somewhere { x } else { 0 },
        y: if somewhere { y } else { 0 },
        code: outside | if somewhere { 0 } else { code::NOWHERE },
        depth: if somewhere { depth } else { 0.0 },
        inverse_w: if somewhere { inverse_w } else { 0.0 },
    }
}

/// The first pixel whose samples may be at a fixed-point coordinate or after it, and the one after
/// the last whose samples may be at or before another: with one sample a pixel, those are at
/// centres.
#[inline(always)]
pub fn pixels(least: i32, greatest: i32, centers_only: bool) -> (i32, i32) {
    const HALF: i32 = PIXEL / 2;
    if centers_only {
        ((least + (HALF - 1)) >> 8, ((greatest - HALF) >> 8) + 1)
    } else {
        (least >> 8, (greatest >> 8) + 1)
    }
}
