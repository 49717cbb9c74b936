//! The coverage of upright rectangles with one sample a pixel, which follows from their sides:
//! large points, and triangles that are rectangles.

#![forbid(unsafe_code)]

use super::coverage::{Block, Covered, Square, cells_in, inside, next_cell, whole};
use crate::raster::TILE;
use crate::raster::primitive::Bounds;

/// Appends the squares and blocks of pixels, counted from the tile's corner.
pub fn cover_upright(pixels: &Bounds, covered: &mut Covered) {
    let Covered { squares, blocks } = covered;
    let square = |x: i32, y: i32, size: u32| Square {
        x: x as u8,
        y: y as u8,
        size: size as u8,
    };
    let (mut touched, full) = cells_in(pixels, 0, 0, 16);
    if full == u16::MAX {
        return squares.push(square(0, 0, TILE));
    }
    while let Some((x, y, bit)) = next_cell(&mut touched, 16) {
        if full & bit != 0 {
            squares.push(square(x, y, 16));
            continue;
        }
        let (mut touched, full) = cells_in(pixels, x, y, 4);
        while let Some((dx, dy, bit)) = next_cell(&mut touched, 4) {
            let (x, y) = (x + dx, y + dy);
            match (full & bit != 0, inside(pixels, x, y)) {
                (true, _) => blocks.push(whole(x, y, 1)),
                (false, 0) => {}
                (false, lanes) => blocks.push(Block::new(x, y, lanes.into())),
            }
        }
    }
}
