//! The interface between the front end and the tiles.
//!
//! Positions on the screen are fixed point with 8 fractional bits (`subPixelPrecisionBits`): 256
//! units a pixel, pixel centres at 128. A *shape* is coverage; a *record* is the data for a
//! primitive's fragments. Clipping changes coverage only: the shapes of a clipped primitive share
//! one record, whose planes come from the original vertices.

use std::ops::Range;

use ash::vk;

use super::{CHUNK_PRIMITIVES, TILE};

/// Where `a * x + b * y + c >= 0`, in fixed-point units. The rule of top and left edges is part of
/// `c`: exactly one of two triangles that share an edge holds a sample on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edge {
    pub a: i32,
    pub b: i32,
    pub c: i64,
}

/// Pixels `left..right`, `top..bottom`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bounds {
    pub left: i32,
    pub top: i32,
    pub right: i32,
    pub bottom: i32,
}

impl Bounds {
    /// The pixels of a rectangle, whatever its values are.
    pub fn of(rect: &vk::Rect2D) -> Bounds {
        let end = |first: i32, size: u32| first.saturating_add_unsigned(size);
        Bounds {
            left: rect.offset.x.max(0),
            top: rect.offset.y.max(0),
            right: end(rect.offset.x, rect.extent.width),
            bottom: end(rect.offset.y, rect.extent.height),
        }
    }

    /// The pixels whose centres lie in an upright rectangle in fixed point: those on its left or
    /// upper side, too.
    #[inline(always)]
    pub fn of_centers(least: [i32; 2], greatest: [i32; 2]) -> Bounds {
        let first = |side: i32| (side + 127) >> 8;
        Bounds {
            left: first(least[0]),
            top: first(least[1]),
            right: first(greatest[0]),
            bottom: first(greatest[1]),
        }
    }

    /// The pixels of both.
    pub fn intersection(self, other: Bounds) -> Bounds {
        Bounds {
            left: self.left.max(other.left),
            top: self.top.max(other.top),
            right: self.right.min(other.right),
            bottom: self.bottom.min(other.bottom),
        }
    }
}

/// Which samples a primitive covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// The samples inside a triangle of these corners, in fixed point, whichever way round they go.
    Triangle([[i32; 2]; 3]),
    /// The samples inside of an upright rectangle, in fixed point: points.
    Upright { least: [i32; 2], greatest: [i32; 2] },
    /// The samples inside four edges of [`Chunk::edges`], by their index: lines.
    Rectangle(u32),
    /// All samples of the pixels `first..first + count` of [`Chunk::pixels`], each of them once, in
    /// the order of columns (`is_x`) or of rows: Bresenham lines.
    Pixels { first: u32, count: u32, is_x: bool },
}

/// A part of the screen that a primitive covers. Tiles read shapes and records in another order
/// than they were written in: both are small.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Index in [`Chunk::records`].
    pub record: u32,
    pub coverage: Coverage,
    /// Nothing is covered outside; within the scissor and the render area.
    pub bounds: Bounds,
}

impl Shape {
    /// The edges that its samples are inside of, and how many there are.
    #[inline(always)]
    pub fn edges(&self, chunk: &Chunk) -> ([Edge; 4], usize) {
        match self.coverage {
            Coverage::Triangle(corners) => (triangle_edges(corners), 3),
            Coverage::Upright {
                least: [left, top],
                greatest: [right, bottom],
            } => {
                let edges = [
                    edge(1, 0, -i64::from(left)),
                    edge(0, 1, -i64::from(top)),
                    edge(-1, 0, i64::from(right)),
                    edge(0, -1, i64::from(bottom)),
                ];
                (edges, 4)
            }
            Coverage::Rectangle(index) => match chunk.edges.get(index as usize) {
                Some(edges) => (*edges, 4),
                None => ([Edge::default(); 4], 0),
            },
            Coverage::Pixels { .. } => ([Edge::default(); 4], 0),
        }
    }
}

/// An edge with that direction into its inside; samples on it are inside of one of two neighbours.
#[inline(always)]
pub fn edge(a: i32, b: i32, c: i64) -> Edge {
    let owns = a > 0 || (a == 0 && b > 0);
    Edge {
        a,
        b,
        c: c - i64::from(!owns),
    }
}

/// Twice the area; positive if the corners go round clockwise (y is down).
#[inline(always)]
pub fn area(corners: [[i32; 2]; 3]) -> i64 {
    let [a, b, c] = corners;
    let difference = |p: i32, q: i32| i64::from(p) - i64::from(q);
    difference(b[0], a[0]) * difference(c[1], a[1])
        - difference(c[0], a[0]) * difference(b[1], a[1])
}

/// The corners of a box that a triangle's are: bit 1 of a corner's number is that of the greater x,
/// bit 2 that of the greater y. None if a corner of the triangle is elsewhere.
#[inline(always)]
pub fn corners_in(
    triangle: &[[i32; 2]; 3],
    least: [i32; 2],
    greatest: [i32; 2],
) -> Option<[u32; 3]> {
    let mut corners = [0; 3];
    for (corner, &[x, y]) in corners.iter_mut().zip(triangle) {
        let is_corner = (x == least[0] || x == greatest[0]) && (y == least[1] || y == greatest[1]);
        if !is_corner {
            return None;
        }
        *corner = u32::from(x == greatest[0]) + 2 * u32::from(y == greatest[1]);
    }
    Some(corners)
}

/// The edge from one corner of a triangle to the next; `sign` is that of its area.
#[inline(always)]
fn side(from: [i32; 2], to: [i32; 2], sign: i32) -> Edge {
    let a = (from[1] - to[1]) * sign;
    let b = (to[0] - from[0]) * sign;
    let c = i64::from(a) * i64::from(from[0]) + i64::from(b) * i64::from(from[1]);
    edge(a, b, -c)
}

/// The edges of a triangle, the first three; its area is not 0.
#[inline(always)]
pub fn triangle_edges(corners: [[i32; 2]; 3]) -> [Edge; 4] {
    let sign = if area(corners) > 0 { 1 } else { -1 };
    let [p, q, r] = corners;
    // Written out: a closure would be called.
    [
        side(p, q, sign),
        side(q, r, sign),
        side(r, p, sign),
        Edge::default(),
    ]
}

/// `at + dx * (x - x0) + dy * (y - y0)`, for pixel coordinates from the record's `origin` on;
/// computed without fused multiply-adds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneEquation {
    pub at: f32,
    pub dx: f32,
    pub dy: f32,
}

/// The data from which a primitive's fragments are computed.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    /// `PrimitiveId`.
    pub primitive_id: u32,
    /// The layer that is drawn to: `Layer`, or the view's number in a pass with views.
    pub layer: u16,
    pub view_index: u8,
    pub viewport: u8,
    /// Counter-clockwise or clockwise as the state says: `FrontFacing`, and the side of the stencil
    /// test.
    pub front: bool,
    /// All w are 1: perspective-correct coordinates are the linear ones, whose sum is 1.
    pub is_affine: bool,
    /// The vertex that provides flat varyings.
    pub provoking: u8,
    /// Index of each vertex's first word in [`Chunk::outputs`]. A line has its second vertex twice,
    /// a point one vertex three times.
    pub vertices: [u32; 3],
    /// Index of the first word in [`Chunk::outputs`] that a mesh program gave to the primitive.
    pub words: u32,
    /// The pixel that planes start at: its centre has coordinates 0, 0.
    pub origin: [i16; 2],
    /// Depth after viewport and bias, before clamping to the viewport's range and to the format's.
    pub depth: PlaneEquation,
    /// For vertex i: λᵢ / wᵢ, λ the linear barycentric coordinate on the screen.
    /// Perspective-correct coordinates are these divided by their sum, which is 1 / w
    /// (`FragCoord.w`).
    pub perspective: [PlaneEquation; 3],
    /// Index in [`Chunk::linear`], unless it is affine.
    pub linear: u32,
    /// Index in [`Chunk::extras`], of a point or a smooth line.
    pub extra: u32,
}

/// The data of points and smooth lines.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extra {
    /// `PointCoord` of a point. Of a smooth line: the distances of a pixel's centre from its
    /// middle, across and along it, in pixels.
    pub point_coord: [PlaneEquation; 2],
    /// Half the width and half the length of a smooth line, in pixels; zeros of a point.
    pub half: [f32; 2],
}

/// Captured primitives of one stream of a draw, in a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Captured {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    pub stream: u8,
    /// Vertices of a primitive.
    pub corners: u8,
    /// Of [`Chunk::captured_vertices`].
    pub vertices: Range<usize>,
}

/// Primitives of one job in order, of one or several consecutive draws, or one clear.
#[derive(Default)]
pub struct Chunk {
    /// A clear instead of primitives: its index in the batch's work.
    pub clear: Option<u32>,
    /// In primitive order.
    pub shapes: Vec<Shape>,
    pub records: Vec<Record>,
    /// Edges of lines' rectangles.
    pub edges: Vec<[Edge; 4]>,
    /// λᵢ (`NoPerspective`) of records that are not affine.
    pub linear: Vec<[PlaneEquation; 3]>,
    pub extras: Vec<Extra>,
    /// Outputs of vertices, [`Program::output_rows`](spirv_jit::Program::output_rows) words a
    /// vertex, as `Program::outputs` lists them. Those of a mesh program's primitives follow.
    pub outputs: Vec<u32>,
    /// x, y.
    pub pixels: Vec<[i16; 2]>,
    pub bins: Bins,
    /// Primitives for transform feedback, by draw and stream, and the first word in `outputs` of
    /// each of their vertices.
    pub captured: Vec<Captured>,
    pub captured_vertices: Vec<u32>,
}

/// Of records without such data.
static NONE: Extra = Extra {
    point_coord: [PlaneEquation::ZERO; 2],
    half: [0.0; 2],
};

impl PlaneEquation {
    const ZERO: Self = Self {
        at: 0.0,
        dx: 0.0,
        dy: 0.0,
    };
}

impl Chunk {
    /// Empties all lists.
    pub fn clear(&mut self) {
        self.clear = None;
        self.shapes.clear();
        self.records.clear();
        self.edges.clear();
        self.linear.clear();
        self.extras.clear();
        self.outputs.clear();
        self.pixels.clear();
        self.captured.clear();
        self.captured_vertices.clear();
    }

    /// λᵢ of a record (`NoPerspective`).
    #[inline(always)]
    pub fn linear_of<'a>(&'a self, record: &'a Record) -> &'a [PlaneEquation; 3] {
        match record.is_affine {
            true => &record.perspective,
            false => (self.linear.get(record.linear as usize)).unwrap_or(&record.perspective),
        }
    }

    /// The values of points and smooth lines; zeros for others.
    #[inline(always)]
    pub fn extra_of(&self, record: &Record) -> &Extra {
        self.extras.get(record.extra as usize).unwrap_or(&NONE)
    }

    /// Bytes of its lists whose length does not follow from the number of primitives, and of all of
    /// them where a geometry shader made more than a job has or vertices are captured.
    pub fn list_bytes(&self) -> usize {
        let captures = !self.captured.is_empty();
        let made = match captures || self.records.len() > CHUNK_PRIMITIVES {
            true => {
                size_of_val(&*self.records)
                    + size_of_val(&*self.shapes)
                    + size_of_val(&*self.edges)
                    + size_of_val(&*self.linear)
                    + size_of_val(&*self.extras)
                    + size_of_val(&*self.outputs)
            }
            false => 0,
        };
        let captured = size_of_val(&*self.captured_vertices);
        captured + made + size_of_val(&*self.pixels) + size_of_val(&*self.bins.shapes)
    }
}

/// Which shapes touch each tile, in order: a list of (tile, shape) sorted by tile, then shape.
#[derive(Default)]
pub struct Bins {
    /// By tile: where its entries start in `shapes`; one more at the end. Empty if there is
    /// nothing.
    pub starts: Vec<u32>,
    /// Indices in [`Chunk::shapes`].
    pub shapes: Vec<u32>,
}

impl Bins {
    /// The shapes that touch a tile.
    pub fn shapes_of(&self, tile: usize) -> &[u32] {
        match self.starts.get(tile..tile + 2) {
            Some(&[start, end]) => &self.shapes[start as usize..end as usize],
            _ => &[],
        }
    }
}

/// The tiles that cover a render area, row by row from the tile that holds its first pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Of the first tile, in tiles.
    pub left: u32,
    pub top: u32,
    /// Tiles.
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    /// Of a render area.
    pub fn of(area: &ash::vk::Rect2D) -> Self {
        let (x, y) = (area.offset.x.max(0) as u32, area.offset.y.max(0) as u32);
        let end = |first: u32, size: u32| first.saturating_add(size).div_ceil(TILE);
        Self {
            left: x / TILE,
            top: y / TILE,
            columns: end(x, area.extent.width).saturating_sub(x / TILE),
            rows: end(y, area.extent.height).saturating_sub(y / TILE),
        }
    }

    /// Tiles.
    pub fn len(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Pixels of a tile.
    pub fn bounds(&self, tile: usize) -> Bounds {
        let column = self.left + tile as u32 % self.columns;
        let row = self.top + tile as u32 / self.columns;
        let (left, top) = ((column * TILE) as i32, (row * TILE) as i32);
        Bounds {
            left,
            top,
            right: left + TILE as i32,
            bottom: top + TILE as i32,
        }
    }
}
