//! Which samples of a tile a shape covers, as 4×4 blocks: exact integers at every size.
//!
//! An edge at a sample of pixel (x, y) of the tile is `a (256 x + sx) + b (256 y + sy) + c`, with
//! `c` moved to the tile's corner. It is not negative if and only if `a x + b y + floor((a sx + b
//! sy + c) / 256)` is not: the pixels' part is a multiple of 256. That takes 32 bits inside a tile
//! for edges of up to 2¹⁶ pixels, and 64 bits for longer ones. From tile to blocks of 16×16, of
//! 4×4, to pixels, sixteen at a time.

use std::ops::{Add, BitOr, Mul};

use lanes::vector::Vector;
use smallvec::SmallVec;

use super::lanes::{COLUMNS, IN_BLOCK, LANE_X, LANE_Y, ROWS, Row, negative};
use super::samples::{CENTER, Location, MAX_SAMPLES, fixed_point, masks_of};
use crate::raster::primitive::{Bounds, Coverage, Edge, triangle_edges};

/// A 4×4 block of pixels with covered samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Block {
    /// Its first pixel, from the tile's.
    pub x: u8,
    pub y: u8,
    /// By sample: lanes whose sample is covered.
    pub masks: [u16; MAX_SAMPLES],
}

/// A square of pixels all of whose samples are covered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Square {
    /// Its first pixel, from the tile's.
    pub x: u8,
    pub y: u8,
    /// Pixels of a side: 16, or those of a tile.
    pub size: u8,
}

/// The blocks of a small shape, with one sample a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct SmallBlocks {
    blocks: [SmallBlock; SMALL as usize],
    count: usize,
}

/// As [`Block`], with one sample a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct SmallBlock {
    pub x: u8,
    pub y: u8,
    pub lanes: u16,
}

impl SmallBlocks {
    /// Those with covered samples.
    pub fn covered(&self) -> &[SmallBlock] {
        &self.blocks[..self.count]
    }

    pub fn covered_mut(&mut self) -> &mut [SmallBlock] {
        &mut self.blocks[..self.count]
    }
}

/// A list of blocks with one sample a pixel.
trait ListOfBlocks {
    fn add(&mut self, x: i32, y: i32, lanes: u16);
}

impl ListOfBlocks for Vec<Block> {
    #[inline(always)]
    fn add(&mut self, x: i32, y: i32, lanes: u16) {
        self.push(Block::new(x, y, lanes.into()));
    }
}

impl ListOfBlocks for SmallBlocks {
    #[inline(always)]
    fn add(&mut self, x: i32, y: i32, lanes: u16) {
        if let Some(block) = self.blocks.get_mut(self.count) {
            let (x, y) = (x as u8, y as u8);
            *block = SmallBlock { x, y, lanes };
            self.count += 1;
        }
    }
}

/// Coverage of a tile by a shape, without overlaps.
#[derive(Default)]
pub struct Covered {
    pub squares: Vec<Square>,
    pub blocks: Vec<Block>,
}

impl Block {
    /// With the masks of its samples, the first in the lowest bits.
    #[inline(always)]
    pub fn new(x: i32, y: i32, masks: u128) -> Self {
        Self {
            x: x as u8,
            y: y as u8,
            masks: masks_of(masks),
        }
    }

    /// Its first pixel, in a tile that starts at a corner.
    #[inline(always)]
    pub fn place(&self, corner: [i32; 2]) -> [i32; 2] {
        [corner[0] + i32::from(self.x), corner[1] + i32::from(self.y)]
    }
}

impl Square {
    /// Its first pixel, in a tile that starts at a corner.
    #[inline(always)]
    pub fn place(&self, corner: [i32; 2]) -> [i32; 2] {
        [corner[0] + i32::from(self.x), corner[1] + i32::from(self.y)]
    }
}

impl Covered {
    /// Nothing.
    pub fn clear(&mut self) {
        self.squares.clear();
        self.blocks.clear();
    }

    /// Turns squares into blocks.
    pub fn split(&mut self, samples: u32) {
        for square in self.squares.drain(..) {
            let [x, y] = square.place([0, 0]);
            let size = i32::from(square.size);
            for y in (y..y + size).step_by(4) {
                for x in (x..x + size).step_by(4) {
                    self.blocks.push(whole(x, y, samples));
                }
            }
        }
    }
}

/// Steps of edges inside a tile that 32 bits hold: 63 of `|a| + |b|` and a constant of
/// [`EdgeInteger::LIMIT`].
pub const NARROW: u64 = 1 << 24;

/// An integer for edges.
trait EdgeInteger: Copy + Ord + Add<Output = Self> + Mul<Output = Self> + BitOr<Output = Self> {
    /// Constants beyond it are the same to a tile.
    const LIMIT: i64;

    fn from_wide(wide: i64) -> Self;
    /// Lanes that are negative.
    fn negative(row: &[Self; 16]) -> u16;
}

impl EdgeInteger for i32 {
    const LIMIT: i64 = (1 << 30) - 1;

    #[inline(always)]
    fn from_wide(wide: i64) -> Self {
        wide as i32
    }

    #[inline(always)]
    fn negative(row: &[Self; 16]) -> u16 {
        negative(row)
    }
}

impl EdgeInteger for i64 {
    const LIMIT: i64 = 1 << 60;

    #[inline(always)]
    fn from_wide(wide: i64) -> Self {
        wide
    }

    #[inline(always)]
    fn negative(row: &[Self; 16]) -> u16 {
        let mut high = [0; 16];
        for lane in 0..16 {
            high[lane] = (row[lane] >> 32) as i32;
        }
        negative(&high)
    }
}

/// An edge's value at the tile's corner.
#[inline(always)]
fn at_corner(edge: &Edge, corner: [i64; 2]) -> i64 {
    let (a, b) = (i64::from(edge.a), i64::from(edge.b));
    edge.c
        .wrapping_add(a.wrapping_mul(corner[0] * 256))
        .wrapping_add(b.wrapping_mul(corner[1] * 256))
}

/// Its constant for a sample, as far as a tile tells it.
#[inline(always)]
fn at_sample<W: EdgeInteger>(edge: &Edge, at_corner: i64, location: Location) -> i64 {
    let [x, y] = fixed_point(location).map(i64::from);
    let inside = i64::from(edge.a) * x + i64::from(edge.b) * y;
    (at_corner.wrapping_add(inside) >> 8).clamp(-W::LIMIT, W::LIMIT)
}

/// An edge in a tile.
#[derive(Clone, Copy)]
struct TileEdge<W> {
    a: W,
    b: W,
    /// By sample.
    constants: [W; MAX_SAMPLES],
    least: W,
    greatest: W,
    /// `a x + b y` of a block's lanes; of the upper left pixels of sixteen blocks, row by row.
    pixels: [W; 16],
    blocks: [W; 16],
}

impl<W: EdgeInteger> TileEdge<W> {
    #[inline(always)]
    fn new(edge: &Edge, corner: [i64; 2], locations: &[Location]) -> Self {
        let (a, b) = (i64::from(edge.a), i64::from(edge.b));
        let at_corner = at_corner(edge, corner);
        let mut constants = [W::from_wide(0); MAX_SAMPLES];
        let (mut least, mut greatest) = (i64::MAX, i64::MIN);
        for (constant, &location) in constants.iter_mut().zip(locations) {
            let limited = at_sample::<W>(edge, at_corner, location);
            *constant = W::from_wide(limited);
            (least, greatest) = (least.min(limited), greatest.max(limited));
        }
        let (a, b) = (W::from_wide(a), W::from_wide(b));
        let (mut pixels, mut blocks) = ([a; 16], [a; 16]);
        for lane in 0..16 {
            let [x, y] = [LANE_X[lane], LANE_Y[lane]].map(|it| W::from_wide(it.into()));
            pixels[lane] = a * x + b * y;
            let [x, y] = [lane % 4, lane / 4].map(|it| W::from_wide(it as i64));
            blocks[lane] = a * x + b * y;
        }
        Self {
            a,
            b,
            constants,
            least: W::from_wide(least),
            greatest: W::from_wide(greatest),
            pixels,
            blocks,
        }
    }

    /// `a x + b y`.
    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> W {
        self.a * W::from_wide(x.into()) + self.b * W::from_wide(y.into())
    }
}

/// Bits of 4×4 cells, row by row: columns and rows `from..to`, each 0 to 4.
#[inline(always)]
fn cells(columns: [i32; 2], rows: [i32; 2]) -> u16 {
    let range = |[from, to]: [i32; 2], step: i32| {
        let bits = |end: i32| (1u32 << (end.clamp(0, 4) * step)) - 1;
        bits(to) & !bits(from)
    };
    ((range(columns, 1) * 0x1111) & range(rows, 4)) as u16
}

/// Of sixteen squares of `size` pixels from (x, y) on: those that are touched, and those whose
/// samples are all covered.
#[inline(always)]
fn cells_of<W: EdgeInteger>(
    sides: &[TileEdge<W>],
    clip: &Bounds,
    x: i32,
    y: i32,
    size: i32,
) -> (u16, u16) {
    let zero = W::from_wide(0);
    let (step, last) = (W::from_wide(size.into()), W::from_wide((size - 1).into()));
    let (mut out, mut partly) = ([zero; 16], [zero; 16]);
    for side in sides {
        let first = side.at(x, y);
        let (along_a, along_b) = (side.a * last, side.b * last);
        let most = first + side.greatest + along_a.max(zero) + along_b.max(zero);
        let least = first + side.least + along_a.min(zero) + along_b.min(zero);
        for lane in 0..16 {
            let here = side.blocks[lane] * step;
            out[lane] = out[lane] | (here + most);
            partly[lane] = partly[lane] | (here + least);
        }
    }
    let (touched, inside) = cells_in(clip, x, y, size);
    let touched = touched & !W::negative(&out);
    (touched, touched & inside & !W::negative(&partly))
}

/// Of sixteen squares of `size` pixels from (x, y) on: those that a clip touches, and those inside.
#[inline(always)]
pub fn cells_in(clip: &Bounds, x: i32, y: i32, size: i32) -> (u16, u16) {
    let down = |end: i32, from: i32| (end - from).div_euclid(size);
    let up = |end: i32, from: i32| (end - from + size - 1).div_euclid(size);
    let touched = cells(
        [down(clip.left, x), up(clip.right, x)],
        [down(clip.top, y), up(clip.bottom, y)],
    );
    let inside = cells(
        [up(clip.left, x), down(clip.right, x)],
        [up(clip.top, y), down(clip.bottom, y)],
    );
    (touched, inside)
}

/// Lanes of the block at (x, y) that lie in the clip.
#[inline(always)]
pub fn inside(clip: &Bounds, x: i32, y: i32) -> u16 {
    let end = |at: i32, from: i32| (at - from).clamp(0, 4) as usize;
    COLUMNS[end(clip.left, x)][end(clip.right, x)] & ROWS[end(clip.top, y)][end(clip.bottom, y)]
}

/// Lanes of the block at (x, y) whose sample lies inside of all sides.
#[inline(always)]
fn inside_of<W: EdgeInteger>(sides: &[TileEdge<W>], x: i32, y: i32, sample: usize) -> u16 {
    let mut out = [W::from_wide(0); 16];
    for side in sides {
        let first = side.at(x, y) + side.constants[sample];
        for lane in 0..16 {
            out[lane] = out[lane] | (side.pixels[lane] + first);
        }
    }
    !W::negative(&out)
}

/// The covered samples of one block.
#[inline(always)]
fn pixels<W: EdgeInteger>(
    sides: &[TileEdge<W>],
    clip: &Bounds,
    x: i32,
    y: i32,
    samples: u32,
    blocks: &mut Vec<Block>,
) {
    let inside = inside(clip, x, y);
    let mut masks = 0;
    for sample in 0..samples as usize {
        let mask = inside & inside_of(sides, x, y, sample);
        masks |= u128::from(mask) << (16 * sample);
    }
    if masks != 0 {
        blocks.push(Block::new(x, y, masks));
    }
}

/// A block that is covered as a whole.
#[inline(always)]
pub fn whole(x: i32, y: i32, samples: u32) -> Block {
    Block::new(x, y, u128::MAX >> (128 - 16 * samples.clamp(1, 8)))
}

/// Takes the first set bit of a mask: its place, 4 to a row, times `size`, and itself. For loops
/// where a closure would not be compiled for the tier.
#[inline(always)]
pub fn next_cell(mask: &mut u16, size: i32) -> Option<(i32, i32, u16)> {
    if *mask == 0 {
        return None;
    }
    let cell = mask.trailing_zeros() as i32;
    *mask &= *mask - 1;
    Some((cell % 4 * size, cell / 4 * size, 1 << cell))
}

#[inline(always)]
fn scan_words<W: EdgeInteger>(
    edges: &[Edge],
    corner: [i64; 2],
    clip: &Bounds,
    locations: &[Location],
    covered: &mut Covered,
) {
    let samples = locations.len() as u32;
    let Covered { squares, blocks } = covered;
    let mut sides = SmallVec::<[TileEdge<W>; 4]>::new();
    for edge in edges {
        sides.push(TileEdge::new(edge, corner, locations));
    }
    let sides = &sides[..];
    let (touched, full) = cells_of(sides, clip, 0, 0, 16);
    let square = |x: i32, y: i32, size: u8| Square {
        x: x as u8,
        y: y as u8,
        size,
    };
    if full == u16::MAX {
        return squares.push(square(0, 0, crate::raster::TILE as u8));
    }
    let mut left = touched;
    while let Some((x, y, bit)) = next_cell(&mut left, 16) {
        if full & bit != 0 {
            squares.push(square(x, y, 16));
            continue;
        }
        let (touched, full) = cells_of(sides, clip, x, y, 4);
        let mut left = touched;
        while let Some((dx, dy, bit)) = next_cell(&mut left, 4) {
            match full & bit != 0 {
                true => blocks.push(whole(x + dx, y + dy, samples)),
                false => pixels(sides, clip, x + dx, y + dy, samples, blocks),
            }
        }
    }
}

/// Blocks that a clip touches up to which they are looked at one by one.
pub const SMALL: i32 = 16;

/// An edge's values at the only samples of a block's pixels, in the tile's first block.
#[inline(always)]
pub fn narrow_side<V: Vector>(
    v: V,
    edge: &Edge,
    corner: [i64; 2],
    [columns, rows]: [V::I; 2],
) -> V::I {
    let constant = at_sample::<i32>(edge, at_corner(edge, corner), CENTER);
    let across = v.mul_i(v.splat_i(edge.a), columns);
    let pixels = v.add_i(across, v.mul_i(v.splat_i(edge.b), rows));
    v.add_i(pixels, v.splat_i(constant as i32))
}

/// The blocks of a small clip, with one sample a pixel.
#[inline(always)]
fn scan_centers<V: Vector, const N: usize>(
    v: V,
    edges: [&Edge; N],
    corner: [i64; 2],
    clip: &Bounds,
    blocks: &mut impl ListOfBlocks,
) {
    let steps = [v.load_i(&IN_BLOCK[0]), v.load_i(&IN_BLOCK[1])];
    let mut sides = [v.splat_i(0); N];
    for i in 0..N {
        sides[i] = narrow_side(v, edges[i], corner, steps);
    }
    for y in (clip.top & !3..clip.bottom).step_by(4) {
        for x in (clip.left & !3..clip.right).step_by(4) {
            let mut out = v.splat_i(0);
            for i in 0..N {
                let first = v.splat_i(edges[i].a * x + edges[i].b * y);
                out = v.or_i(out, v.add_i(sides[i], first));
            }
            let outside = v.ne_i(v.sign_i(out), v.splat_i(0));
            if outside != u16::MAX {
                let mask = inside(clip, x, y) & !outside;
                if mask != 0 {
                    blocks.add(x, y, mask);
                }
            }
        }
    }
}

lanes::vectors! {
    /// The blocks of a small clip that a triangle touches, with one sample a pixel.
    fn scan_triangle<V>(v, edges: [&Edge; 3], corner: [i64; 2], clip: &Bounds, blocks: &mut SmallBlocks) {
        scan_centers(v, edges, corner, clip, blocks);
    }
}

lanes::vectors! {
    /// The blocks of a small clip, one by one.
    fn scan_small<V>(v, edges: &[Edge], corner: [i64; 2], clip: &Bounds, locations: &[Location], blocks: &mut Vec<Block>) {
        let (columns, rows) = (v.load_i(&IN_BLOCK[0]), v.load_i(&IN_BLOCK[1]));
        // The commonest, whose edges stay in registers.
        match (locations.len(), edges) {
            (1, [first, second, third]) => {
                return scan_centers(v, [first, second, third], corner, clip, blocks);
            }
            (1, [first, second, third, fourth]) => {
                return scan_centers(v, [first, second, third, fourth], corner, clip, blocks);
            }
            _ => {}
        }
        let mut pixels = [v.splat_i(0); 4];
        let mut constants = [[0; MAX_SAMPLES]; 4];
        for (index, edge) in edges.iter().enumerate() {
            let across = v.mul_i(v.splat_i(edge.a), columns);
            pixels[index] = v.add_i(across, v.mul_i(v.splat_i(edge.b), rows));
            let at_corner = at_corner(edge, corner);
            for (constant, &location) in constants[index].iter_mut().zip(locations) {
                *constant = at_sample::<i32>(edge, at_corner, location) as i32;
            }
        }
        for y in (clip.top & !3..clip.bottom).step_by(4) {
            for x in (clip.left & !3..clip.right).step_by(4) {
                let inside = inside(clip, x, y);
                let mut masks = 0;
                for sample in 0..locations.len() {
                    let mut out = v.splat_i(0);
                    for (index, edge) in edges.iter().enumerate() {
                        let first = edge.a * x + edge.b * y + constants[index][sample];
                        out = v.or_i(out, v.add_i(pixels[index], v.splat_i(first)));
                    }
                    let outside = v.ne_i(v.sign_i(out), v.splat_i(0));
                    masks |= u128::from(inside & !outside) << (16 * sample);
                }
                if masks != 0 {
                    blocks.push(Block::new(x, y, masks));
                }
            }
        }
    }
}

/// Columns and rows of sixteen cells, row by row.
static CELLS: [Row; 2] = [
    [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3],
    [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3],
];

/// An edge in a tile with one sample a pixel.
#[derive(Clone, Copy)]
struct CenterSide<V: Vector> {
    a: i32,
    b: i32,
    constant: i32,
    /// `a x + b y + constant` of the pixels of the tile's first block.
    pixels: V::I,
    /// `a x + b y` of the upper left corners of sixteen cells of one pixel.
    cells: V::I,
}

/// [`cells_of`] with one sample a pixel, for squares of `1 << log` pixels.
#[inline(always)]
fn center_cells<V: Vector, const N: usize>(
    v: V,
    sides: &[CenterSide<V>; N],
    clip: &Bounds,
    x: i32,
    y: i32,
    log: u32,
) -> (u16, u16) {
    let size = 1 << log;
    let last = size - 1;
    let none = v.splat_i(0);
    let (mut out, mut partly) = (none, none);
    for i in 0..N {
        let side = &sides[i];
        let first = side.a * x + side.b * y + side.constant;
        let (along_a, along_b) = (side.a * last, side.b * last);
        let here = v.left_i(side.cells, log);
        let most = first + along_a.max(0) + along_b.max(0);
        let least = first + along_a.min(0) + along_b.min(0);
        out = v.or_i(out, v.add_i(here, v.splat_i(most)));
        partly = v.or_i(partly, v.add_i(here, v.splat_i(least)));
    }
    let (touched, inside) = cells_in(clip, x, y, size);
    let touched = touched & !v.ne_i(v.sign_i(out), none);
    (touched, touched & inside & !v.ne_i(v.sign_i(partly), none))
}

/// Squares and blocks with one sample a pixel.
#[inline(always)]
fn scan_squares<V: Vector, const N: usize>(
    v: V,
    edges: [&Edge; N],
    corner: [i64; 2],
    clip: &Bounds,
    covered: &mut Covered,
) {
    let steps = [v.load_i(&IN_BLOCK[0]), v.load_i(&IN_BLOCK[1])];
    let grid = [v.load_i(&CELLS[0]), v.load_i(&CELLS[1])];
    let none = v.splat_i(0);
    let empty = CenterSide {
        a: 0,
        b: 0,
        constant: 0,
        pixels: none,
        cells: none,
    };
    let mut sides: [CenterSide<V>; N] = [empty; N];
    for i in 0..N {
        let (a, b) = (edges[i].a, edges[i].b);
        let (across, down) = (v.splat_i(a), v.splat_i(b));
        let pixels = v.add_i(v.mul_i(across, steps[0]), v.mul_i(down, steps[1]));
        let constant = at_sample::<i32>(edges[i], at_corner(edges[i], corner), CENTER) as i32;
        sides[i] = CenterSide {
            a,
            b,
            constant,
            pixels: v.add_i(pixels, v.splat_i(constant)),
            cells: v.add_i(v.mul_i(across, grid[0]), v.mul_i(down, grid[1])),
        };
    }
    let Covered { squares, blocks } = covered;
    let (touched, full) = center_cells(v, &sides, clip, 0, 0, 4);
    let square = |x: i32, y: i32, size: u8| Square {
        x: x as u8,
        y: y as u8,
        size,
    };
    if full == u16::MAX {
        return squares.push(square(0, 0, crate::raster::TILE as u8));
    }
    let mut left = touched;
    while let Some((x, y, bit)) = next_cell(&mut left, 16) {
        if full & bit != 0 {
            squares.push(square(x, y, 16));
            continue;
        }
        let (touched, full) = center_cells(v, &sides, clip, x, y, 2);
        let mut left = touched;
        while let Some((dx, dy, bit)) = next_cell(&mut left, 4) {
            let (x, y) = (x + dx, y + dy);
            if full & bit != 0 {
                blocks.push(whole(x, y, 1));
                continue;
            }
            let mut out = none;
            for i in 0..N {
                let first = v.splat_i(sides[i].a * x + sides[i].b * y);
                out = v.or_i(out, v.add_i(sides[i].pixels, first));
            }
            let mask = inside(clip, x, y) & !v.ne_i(v.sign_i(out), none);
            if mask != 0 {
                blocks.push(Block::new(x, y, mask.into()));
            }
        }
    }
}

lanes::vectors! {
    fn scan_narrow<V>(v, edges: &[Edge], corner: [i64; 2], clip: &Bounds, locations: &[Location], covered: &mut Covered) {
        // The commonest, whose edges stay in registers.
        match (locations.len(), edges) {
            (1, [first, second, third]) => {
                scan_squares(v, [first, second, third], corner, clip, covered);
            }
            _ => scan_words::<i32>(edges, corner, clip, locations, covered),
        }
    }
}

lanes::vectors! {
    fn scan_wide<V>(_v, edges: &[Edge], corner: [i64; 2], clip: &Bounds, locations: &[Location], covered: &mut Covered) {
        scan_words::<i64>(edges, corner, clip, locations, covered);
    }
}

/// A clip that lies in a tile, from the tile's corner.
#[inline(always)]
pub fn in_tile(clip: &Bounds, tile: &Bounds) -> Bounds {
    Bounds {
        left: clip.left - tile.left,
        top: clip.top - tile.top,
        right: clip.right - tile.left,
        bottom: clip.bottom - tile.top,
    }
}

/// Whether 32 bits hold what edges are inside a tile.
#[inline(always)]
fn are_narrow(edges: &[Edge]) -> bool {
    let steps = |edge: &Edge| u64::from(edge.a.unsigned_abs()) + u64::from(edge.b.unsigned_abs());
    edges.iter().all(|edge| steps(edge) <= NARROW)
}

/// Whether a clip touches few blocks.
#[inline(always)]
pub fn is_small(clip: &Bounds) -> bool {
    let blocks = |from: i32, to: i32| (to - (from & !3) + 3) / 4;
    blocks(clip.left, clip.right) * blocks(clip.top, clip.bottom) <= SMALL
}

/// The coverage of a triangle or an upright rectangle in a tile, inside a clip that lies in the
/// tile, with one sample a pixel; none of other shapes, and if it is large.
#[inline(always)]
pub fn small_shape(
    tier: lanes::Tier,
    coverage: &Coverage,
    tile: &Bounds,
    clip: &Bounds,
) -> Option<SmallBlocks> {
    match *coverage {
        Coverage::Triangle(corners) => small_triangle(tier, corners, tile, clip),
        Coverage::Upright { least, greatest } => {
            let clip = in_tile(
                &Bounds::of_centers(least, greatest).intersection(*clip),
                tile,
            );
            is_small(&clip).then(|| small_upright(&clip))
        }
        _ => None,
    }
}

/// The blocks of a clip, which holds few.
fn small_upright(clip: &Bounds) -> SmallBlocks {
    let mut blocks = SmallBlocks::default();
    for y in (clip.top & !3..clip.bottom).step_by(4) {
        for x in (clip.left & !3..clip.right).step_by(4) {
            match inside(clip, x, y) {
                0 => {}
                lanes => blocks.add(x, y, lanes),
            }
        }
    }
    blocks
}

/// The coverage of a triangle.
#[inline(always)]
fn small_triangle(
    tier: lanes::Tier,
    corners: [[i32; 2]; 3],
    tile: &Bounds,
    clip: &Bounds,
) -> Option<SmallBlocks> {
    let clip = in_tile(clip, tile);
    if !is_small(&clip) {
        return None;
    }
    let edges = triangle_edges(corners);
    if !are_narrow(&edges[..3]) {
        return None;
    }
    let corner = [tile.left.into(), tile.top.into()];
    let mut blocks = SmallBlocks::default();
    let [first, second, third, _] = &edges;
    scan_triangle(tier, [first, second, third], corner, &clip, &mut blocks);
    Some(blocks)
}

/// Appends what a convex shape covers of a tile inside a clip, which lies in the tile.
pub fn convex(
    tier: lanes::Tier,
    edges: &[Edge],
    tile: &Bounds,
    clip: &Bounds,
    locations: &[Location],
    covered: &mut Covered,
) {
    let corner = [tile.left.into(), tile.top.into()];
    let clip = in_tile(clip, tile);
    let is_narrow = are_narrow(edges);
    if is_narrow && is_small(&clip) {
        scan_small(tier, edges, corner, &clip, locations, &mut covered.blocks);
    } else if is_narrow {
        scan_narrow(tier, edges, corner, &clip, locations, covered);
    } else {
        scan_wide(tier, edges, corner, &clip, locations, covered);
    }
}

/// Appends the blocks of a list of pixels, in the order of columns (`is_x`) or of rows: those
/// inside a clip, which lies in the tile, with all their samples.
pub fn listed(
    list: &[[i16; 2]],
    is_x: bool,
    tile: &Bounds,
    clip: &Bounds,
    samples: u32,
    blocks: &mut Vec<Block>,
) {
    let first = blocks.len();
    let (axis, from, to) = match is_x {
        true => (0, clip.left, clip.right),
        false => (1, clip.top, clip.bottom),
    };
    let place = |end: i32| list.partition_point(|pixel| i32::from(pixel[axis]) < end);
    for &[x, y] in &list[place(from)..place(to)] {
        let (x, y) = (i32::from(x), i32::from(y));
        if x < clip.left || x >= clip.right || y < clip.top || y >= clip.bottom {
            continue;
        }
        let (x, y) = (x - tile.left, y - tile.top);
        let place = ((x & !3) as u8, (y & !3) as u8);
        let (column, row) = ((x & 3) as usize, (y & 3) as usize);
        let lane = COLUMNS[column][column + 1] & ROWS[row][row + 1];
        // Lists go along lines: a block's pixels follow each other.
        let last = blocks[first..].last_mut();
        if let Some(block) = last.filter(|block| (block.x, block.y) == place) {
            for mask in &mut block.masks[..samples as usize] {
                *mask |= lane;
            }
        } else {
            let mut block = Block {
                x: place.0,
                y: place.1,
                masks: [0; MAX_SAMPLES],
            };
            block.masks[..samples as usize].fill(lane);
            blocks.push(block);
        }
    }
}
