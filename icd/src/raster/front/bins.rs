//! Bins: which shapes touch each tile.

#![forbid(unsafe_code)]

use crate::raster::TILE;
use crate::raster::primitive::{Bins, Bounds, Chunk, Edge, Grid, Shape};

use super::screen::PIXEL;
use crate::wave::Stopped;

/// Shapes of up to that many tiles are listed in all tiles of their bounds; larger ones where their
/// edges pass.
const SMALL: u32 = 2;

/// Calls with each tile that a shape may touch.
#[inline(always)]
fn each_tile(grid: &Grid, chunk: &Chunk, shape: &Shape, mut visit: impl FnMut(usize)) {
    let Bounds {
        left,
        top,
        right,
        bottom,
    } = shape.bounds;
    let first = |pixel: i32, grid: u32| pixel as u32 / TILE - grid;
    let (left, right) = (first(left, grid.left), first(right - 1, grid.left));
    let (top, bottom) = (first(top, grid.top), first(bottom - 1, grid.top));
    if left == right && top == bottom {
        return visit((top * grid.columns + left) as usize);
    }
    let (edges, count) = match right - left + bottom - top >= SMALL {
        true => shape.edges(chunk),
        false => ([Edge::default(); 4], 0),
    };
    let edges = &edges[..count];
    for row in top..=bottom {
        for column in left..=right {
            let x = i64::from((grid.left + column) * TILE) * i64::from(PIXEL);
            let y = i64::from((grid.top + row) * TILE) * i64::from(PIXEL);
            let size = i64::from(TILE) * i64::from(PIXEL);
            // Where an edge's function is greatest in the tile, it is outside.
            let is_out = |edge: &Edge| {
                let x = if edge.a > 0 { x + size } else { x };
                let y = if edge.b > 0 { y + size } else { y };
                i64::from(edge.a) * x + i64::from(edge.b) * y + edge.c < 0
            };
            if !edges.iter().any(is_out) {
                visit((row * grid.columns + column) as usize);
            }
        }
    }
}

/// Fills the bins of a chunk. All shapes have bounds that are not empty, in the grid.
///
/// # Errors
/// When there is no memory for them.
pub fn fill(grid: &Grid, chunk: &mut Chunk) -> Result<(), Stopped> {
    let mut bins = std::mem::take(&mut chunk.bins);
    let filled = fill_bins(&mut bins, grid, chunk);
    chunk.bins = bins;
    filled
}

fn fill_bins(bins: &mut Bins, grid: &Grid, chunk: &Chunk) -> Result<(), Stopped> {
    let shapes = &chunk.shapes;
    bins.starts.clear();
    bins.shapes.clear();
    if shapes.is_empty() {
        return Ok(());
    }
    let room =
        |list: &mut Vec<u32>, size: usize| list.try_reserve(size).map_err(|_| Stopped::OutOfMemory);
    room(&mut bins.starts, grid.len() + 2)?;
    // One more in front: counting, then summing, then filling move each start by one place.
    bins.starts.resize(grid.len() + 2, 0);
    let counts = &mut bins.starts[2..];
    for shape in shapes {
        each_tile(grid, chunk, shape, |tile| counts[tile] += 1);
    }
    let mut total = 0;
    for count in counts.iter_mut() {
        total += *count;
        *count = total;
    }
    room(&mut bins.shapes, total as usize)?;
    bins.shapes.resize(total as usize, 0);
    let next = &mut bins.starts[1..];
    for (index, shape) in shapes.iter().enumerate() {
        each_tile(grid, chunk, shape, |tile| {
            bins.shapes[next[tile] as usize] = index as u32;
            next[tile] += 1;
        });
    }
    bins.starts.pop();
    Ok(())
}
