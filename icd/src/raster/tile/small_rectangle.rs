//! Small upright rectangles of two triangles, with one sample a pixel: the squares of particles and
//! of glyphs. The sides of the rectangle and the edge that the triangles share give the coverage of
//! both at once, to the same pixels as their own edges.

#![forbid(unsafe_code)]

use lanes::Tier;

use super::coverage::{NARROW, SMALL, in_tile, inside, is_small, narrow_side};
use super::lanes::IN_BLOCK;
use crate::raster::primitive::{Bounds, Edge, corners_in, edge};

/// A block of pixels of a rectangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RectangleBlock {
    /// Its first pixel, from the tile's.
    pub x: u8,
    pub y: u8,
    /// The lanes that the rectangle covers, and those of them that its first triangle does.
    pub lanes: u16,
    pub first: u16,
}

/// The blocks of a small rectangle.
#[derive(Debug, Default)]
pub struct RectangleBlocks {
    blocks: [RectangleBlock; SMALL as usize],
    count: usize,
}

impl RectangleBlocks {
    /// Those with covered pixels.
    pub fn covered(&self) -> &[RectangleBlock] {
        &self.blocks[..self.count]
    }
}

/// The corners of a triangle among those of a box, a bit each.
#[inline(always)]
fn corners_of(triangle: &[[i32; 2]; 3], least: [i32; 2], greatest: [i32; 2]) -> Option<u32> {
    let [a, b, c] = corners_in(triangle, least, greatest)?;
    Some(1 << a | 1 << b | 1 << c)
}

/// Two triangles that make up an upright rectangle.
#[derive(Clone, Copy, Debug)]
struct SmallRectangle {
    /// Pixels inside of it are the first triangle's, the others the second's.
    diagonal: Edge,
    least: [i32; 2],
    greatest: [i32; 2],
}

impl SmallRectangle {
    /// Of two triangles with an area, in fixed point.
    #[inline(always)]
    fn of(first: &[[i32; 2]; 3], second: &[[i32; 2]; 3]) -> Option<Self> {
        let [a, b, c] = first;
        let least = [a[0].min(b[0]).min(c[0]), a[1].min(b[1]).min(c[1])];
        let greatest = [a[0].max(b[0]).max(c[0]), a[1].max(b[1]).max(c[1])];
        let of_first = corners_of(first, least, greatest)?;
        let of_second = corners_of(second, least, greatest)?;
        // Three each, and each lacks the corner between the level and the upright side of the
        // other.
        let missing = (!of_first & 0xf).trailing_zeros();
        if of_first.count_ones() != 3 || of_second != 0xf & !(1 << (missing ^ 3)) {
            return None;
        }
        let (width, height) = (greatest[0] - least[0], greatest[1] - least[1]);
        if u64::from(width.unsigned_abs()) + u64::from(height.unsigned_abs()) > NARROW {
            return None;
        }
        // From the shared corner with the first triangle's upright side to the other one.
        let (is_right, is_low) = (missing & 1 == 0, missing & 2 != 0);
        let x = if is_right { greatest[0] } else { least[0] };
        let y = if is_low { greatest[1] } else { least[1] };
        let a = if is_right { height } else { -height };
        let b = if is_low { -width } else { width };
        let at = i64::from(a) * i64::from(x) + i64::from(b) * i64::from(y);
        Some(Self {
            diagonal: edge(a, b, -at),
            least,
            greatest,
        })
    }
}

lanes::vectors! {
    fn scan<V>(
        v,
        diagonal: &Edge,
        corner: [i64; 2],
        covered: &Bounds,
        found: &mut RectangleBlocks,
    ) {
        let steps = [v.load_i(&IN_BLOCK[0]), v.load_i(&IN_BLOCK[1])];
        let side = narrow_side(v, diagonal, corner, steps);
        for y in (covered.top & !3..covered.bottom).step_by(4) {
            for x in (covered.left & !3..covered.right).step_by(4) {
                let first = v.splat_i(diagonal.a * x + diagonal.b * y);
                let outside = v.ne_i(v.sign_i(v.add_i(side, first)), v.splat_i(0));
                let lanes = inside(covered, x, y);
                if let Some(block) = found.blocks.get_mut(found.count) {
                    *block = RectangleBlock {
                        x: x as u8,
                        y: y as u8,
                        lanes,
                        first: lanes & !outside,
                    };
                    found.count += 1;
                }
            }
        }
    }
}

/// The coverage of two triangles in a tile, inside a clip that lies in the tile and holds pixels;
/// none if they are no rectangle, or a large one.
#[inline(always)]
pub fn cover_rectangle(
    tier: Tier,
    [first, second]: [&[[i32; 2]; 3]; 2],
    tile: &Bounds,
    clip: &Bounds,
) -> Option<RectangleBlocks> {
    if !is_small(&in_tile(clip, tile)) {
        return None;
    }
    let rectangle = SmallRectangle::of(first, second)?;
    let pixels = Bounds::of_centers(rectangle.least, rectangle.greatest);
    let covered = in_tile(&pixels.intersection(*clip), tile);
    let mut found = RectangleBlocks::default();
    if covered.left < covered.right && covered.top < covered.bottom {
        let corner = [tile.left.into(), tile.top.into()];
        scan(tier, &rectangle.diagonal, corner, &covered, &mut found);
    }
    Some(found)
}
