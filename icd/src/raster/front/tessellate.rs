//! The tessellator: from the levels of a patch to vertices of its domain and the primitives between
//! them (Vulkan, chapter "Tessellation").
//!
//! All arithmetic is in whole numbers. A place on an edge counts in parts of [`ONE`], and the two
//! halves of an edge mirror each other: where u is a place, 1 − u is one, exactly. So neighbours
//! that share an edge, in either direction, have the same vertices on it if they have the same
//! level there: the places follow from the level and the spacing alone.

#![forbid(unsafe_code)]

use smallvec::SmallVec;
use spirv_jit::program::{Domain, Spacing};

use crate::capabilities::limits::MAX_TESSELLATION_LEVEL;

/// The greatest level.
const MAX_LEVEL: u32 = MAX_TESSELLATION_LEVEL;

/// The length of an edge.
const ONE: u32 = 1 << 22;

/// Parts of a level of 1 in [`Edge::level`]: levels of 1 and more are multiples of 2⁻²³.
const LEVEL_ONE: u32 = 1 << 23;

/// The subdivision of an edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Edge {
    segments: u32,
    /// The clamped level in parts of [`LEVEL_ONE`].
    level: u32,
}

/// Places on an edge from 0 to [`ONE`].
type Places = SmallVec<[u32; MAX_LEVEL as usize + 1]>;

impl Edge {
    /// Clamps and rounds a level. Those that are not numbers are the least.
    fn new(spacing: Spacing, level: f32) -> Self {
        let (least, most) = match spacing {
            Spacing::Equal => (1, MAX_LEVEL),
            Spacing::FractionalEven => (2, MAX_LEVEL),
            Spacing::FractionalOdd => (1, MAX_LEVEL - 1),
        };
        let level = level.max(least as f32).min(most as f32);
        let up = level.ceil() as u32;
        match spacing {
            Spacing::Equal => Self {
                segments: up,
                level: up * LEVEL_ONE,
            },
            Spacing::FractionalEven | Spacing::FractionalOdd => Self {
                segments: up + ((up ^ least) & 1),
                // A multiplication by a power of two is exact.
                level: (level * LEVEL_ONE as f32) as u32,
            },
        }
    }

    /// An inner edge, which has vertices between its ends. In the place of a level of 1 stands
    /// "1 + ε"; with odd segments, its first and last ones have no length.
    fn inner(self, spacing: Spacing) -> Self {
        match (self.segments, spacing) {
            (1, Spacing::FractionalOdd) => Self {
                segments: 3,
                level: LEVEL_ONE,
            },
            (1, _) => Self::new(spacing, 2.0),
            _ => self,
        }
    }

    /// Places of the vertices, those of Direct3D: Vulkan leaves the choice, and programs see the
    /// same vertices as on other devices. The places of a level f with n segments lie between those
    /// of equal segments, n − 2 and n of them, as f lies between these numbers. So n − 2 segments
    /// have one length. The other two are shorter: in each half one, which starts at vertex
    /// [`split`].
    fn places(self) -> Places {
        let n = i64::from(self.segments);
        // Of the difference of 2 between the levels with n − 2 and with n segments.
        let (all, part) = (
            2 * i64::from(LEVEL_ONE),
            i64::from(self.level) - (n - 2) * i64::from(LEVEL_ONE),
        );
        let split = i64::from(split(self.segments));
        let place = |k: i64| {
            let fewer = k - i64::from(k > split);
            let (parts, whole) = match part == all {
                true => (k, n),
                false => (
                    fewer * (all - part) * n + k * part * (n - 2),
                    all * n * (n - 2),
                ),
            };
            // Rounded to the nearest. No vertex but those of 1 + ε shares the place of an end.
            let place = (2 * parts * i64::from(ONE) + whole) / (2 * whole);
            if parts == 0 { 0 } else { place.max(1) as u32 }
        };
        (0..=n)
            .map(|k| match k {
                0 => 0,
                _ if 2 * k <= n => place(k),
                _ if k == n => ONE,
                _ => ONE - place(n - k),
            })
            .collect()
    }
}

/// The vertex, counted from an end of an edge of so many segments, that is the first one of the
/// segment which an edge of two segments fewer lacks in this half (Direct3D 11 reference
/// tessellator, `ComputeTessFactorContext`).
fn split(segments: u32) -> u32 {
    let half = (segments.saturating_sub(2)) / 2;
    match half.checked_ilog2() {
        Some(log) => 2 * (half & !(1 << log)) + 1,
        None => 0,
    }
}

/// How a patch is subdivided: patches of one draw with equal ones have equal vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Subdivision {
    domain: Domain,
    /// The spacing of inner edges.
    spacing: Spacing,
    outer: [Edge; 4],
    inner: [Edge; 2],
}

/// A vertex on the way around a patch, and its place on the side of the patch.
type SideVertex = (u16, u32);

/// The vertices and primitives of a patch.
#[derive(Debug, Default)]
pub struct Tessellation {
    /// `TessCoord`.
    pub coordinates: Vec<[f32; 3]>,
    /// Vertices of the primitives, [`Self::corners`] each.
    pub vertices: Vec<u16>,
    /// Vertices of a primitive.
    pub corners: usize,
}

impl Tessellation {
    fn vertex(&mut self, coordinate: [f32; 3]) -> u16 {
        self.coordinates.push(coordinate);
        (self.coordinates.len() - 1) as u16
    }

    /// Fills the strip between two polylines that run side by side, the outer one to the right of
    /// the inner one.
    fn strip(&mut self, outer: &[SideVertex], inner: &[SideVertex]) {
        let (mut o, mut i) = (0, 0);
        while o + 1 < outer.len() || i + 1 < inner.len() {
            let is_outer = match (outer.get(o + 1), inner.get(i + 1)) {
                (Some(next), Some(other)) => next.1 + outer[o].1 <= other.1 + inner[i].1,
                (next, _) => next.is_some(),
            };
            let (from, to) = (outer[o].0, inner[i].0);
            let third = match is_outer {
                true => {
                    o += 1;
                    outer[o].0
                }
                false => {
                    i += 1;
                    inner[i].0
                }
            };
            self.vertices.extend([from, third, to]);
        }
    }
}

/// A place on an edge as a coordinate.
fn coordinate(place: u32) -> f32 {
    place as f32 / ONE as f32
}

impl Subdivision {
    /// Of a patch with these levels; `None` if the patch is discarded.
    pub fn new(domain: Domain, spacing: Spacing, outer: [f32; 4], inner: [f32; 2]) -> Option<Self> {
        let (sides, inside) = match domain {
            Domain::Triangles => (3, 1),
            Domain::Quads => (4, 2),
            Domain::Isolines => (2, 0),
        };
        // NaN discards the patch, too.
        if !outer[..sides].iter().all(|&level| level > 0.0) {
            return None;
        }
        let mut all = Self {
            domain,
            spacing,
            outer: [Edge::default(); 4],
            inner: [Edge::default(); 2],
        };
        for (edge, level) in all.outer.iter_mut().zip(outer).take(sides) {
            *edge = Edge::new(spacing, level);
        }
        for (edge, level) in all.inner.iter_mut().zip(inner).take(inside) {
            *edge = Edge::new(spacing, level);
        }
        if domain == Domain::Isolines {
            // Lines have equal distances, whatever the spacing.
            all.outer[0] = Edge::new(Spacing::Equal, outer[0]);
        }
        Some(all)
    }

    /// Primitives that [`Self::tessellate`] makes.
    pub fn primitives(&self, point_mode: bool) -> u32 {
        let around: u32 = self.outer.iter().map(|edge| edge.segments).sum();
        if self.domain == Domain::Isolines {
            let [lines, edge, ..] = self.outer.map(|edge| edge.segments);
            return lines * (edge + u32::from(point_mode));
        }
        let [m, n] = self.inner.map(|edge| match edge.segments {
            0 => 0,
            _ => edge.inner(self.spacing).segments,
        });
        match (self.domain, self.is_whole(), point_mode) {
            (_, true, true) => around,
            (Domain::Quads, true, false) => 2,
            (_, true, false) => 1,
            (Domain::Quads, false, true) => around + (m - 1) * (n - 1),
            // Strips around it, and the grid inside.
            (Domain::Quads, ..) => around + 2 * (m + n - 4) + 2 * (m - 2) * (n - 2),
            (_, false, _) => {
                let rings = 1..=m / 2;
                let segments = rings.map(|ring| m - 2 * ring);
                match point_mode {
                    true => around + segments.map(|it| (3 * it).max(1)).sum::<u32>(),
                    // A ring is the inner side of a strip, and the outer side of the next one. The
                    // innermost one is a triangle, if it is no point.
                    false => around + segments.map(|it| 6 * it).sum::<u32>() - (m % 2) * 2,
                }
            }
        }
    }

    /// Whether no edge is divided.
    fn is_whole(&self) -> bool {
        self.outer
            .iter()
            .chain(&self.inner)
            .all(|edge| edge.segments <= 1)
    }

    /// Makes the vertices and primitives. Triangles are counterclockwise for u to the right and v
    /// upwards, or clockwise.
    pub fn tessellate(&self, point_mode: bool, clockwise: bool) -> Tessellation {
        let mut out = match self.domain {
            Domain::Triangles => self.triangle(),
            Domain::Quads => self.quad(),
            Domain::Isolines => self.isolines(),
        };
        if point_mode {
            out.corners = 1;
            out.vertices = (0..out.coordinates.len() as u16).collect();
        } else if clockwise && out.corners == 3 {
            let (triangles, _) = out.vertices.as_chunks_mut::<3>();
            triangles.iter_mut().for_each(|it| it.swap(1, 2));
        }
        out
    }

    fn isolines(&self) -> Tessellation {
        let mut out = Tessellation {
            corners: 2,
            ..Tessellation::default()
        };
        let (lines, segments) = (self.outer[0].places(), self.outer[1].places());
        for &v in &lines[..lines.len() - 1] {
            for (k, &u) in segments.iter().enumerate() {
                let vertex = out.vertex([coordinate(u), coordinate(v), 0.0]);
                if k > 0 {
                    out.vertices.extend([vertex - 1, vertex]);
                }
            }
        }
        out
    }

    /// The vertices of the way around a patch, side by side, and its sides, each to the first
    /// vertex of the next one. `at` gives the coordinate of a place on a side.
    fn around(
        out: &mut Tessellation,
        sides: &[Places],
        at: impl Fn(usize, u32) -> [f32; 3],
    ) -> SmallVec<[Vec<SideVertex>; 4]> {
        let first = out.coordinates.len() as u16;
        let mut around: SmallVec<[Vec<SideVertex>; 4]> = SmallVec::new();
        for (side, places) in sides.iter().enumerate() {
            let start = &places[..places.len() - 1];
            let vertex = |&place: &u32| (out.vertex(at(side, place)), place);
            around.push(start.iter().map(vertex).collect::<Vec<_>>());
        }
        for side in 0..sides.len() {
            let next = match side + 1 < sides.len() {
                true => around[side + 1][0].0,
                false => first,
            };
            let end = *sides[side].last().unwrap_or(&ONE);
            around[side].push((next, end));
        }
        around
    }

    fn quad(&self) -> Tessellation {
        let mut out = Tessellation {
            corners: 3,
            ..Tessellation::default()
        };
        // Sides v = 0, u = 1, v = 1, u = 0, each from where the one before ends.
        let [left, bottom, right, top] = self.outer;
        let sides = [bottom, right, top, left].map(Edge::places);
        let around = Self::around(&mut out, &sides, |side, place| {
            let (there, back) = (coordinate(place), coordinate(ONE - place));
            match side {
                0 => [there, 0.0, 0.0],
                1 => [1.0, there, 0.0],
                2 => [back, 1.0, 0.0],
                _ => [0.0, back, 0.0],
            }
        });
        if self.is_whole() {
            // Vulkan leaves the diagonal open; it is that of Direct3D.
            out.vertices.extend([0, 1, 3, 1, 2, 3]);
            return out;
        }
        let [columns, rows] = self.inner.map(|edge| edge.inner(self.spacing).places());
        let (last_column, last_row) = (columns.len() - 2, rows.len() - 2);
        let first = out.coordinates.len();
        for &v in &rows[1..=last_row] {
            for &u in &columns[1..=last_column] {
                out.vertex([coordinate(u), coordinate(v), 0.0]);
            }
        }
        let inside =
            |column: usize, row: usize| (first + (row - 1) * last_column + column - 1) as u16;
        let along_columns = |row: usize| {
            let of = move |(column, &place): (usize, &u32)| (inside(column, row), place);
            columns
                .iter()
                .enumerate()
                .take(last_column + 1)
                .skip(1)
                .map(of)
        };
        let along_rows = |column: usize| {
            let of = move |(row, &place): (usize, &u32)| (inside(column, row), place);
            rows.iter().enumerate().take(last_row + 1).skip(1).map(of)
        };
        let back = |(vertex, place): SideVertex| (vertex, ONE - place);
        let inner: [Vec<SideVertex>; 4] = [
            along_columns(1).collect(),
            along_rows(last_column).collect(),
            along_columns(last_row).rev().map(back).collect(),
            along_rows(1).rev().map(back).collect(),
        ];
        for (outer, inner) in around.iter().zip(&inner) {
            out.strip(outer, inner);
        }
        for row in 1..last_row {
            for column in 1..last_column {
                let corner = |right, up| inside(column + right, row + up);
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                // The diagonal leads from the corner of the patch that is nearest.
                let (is_left, is_low) = (2 * column <= last_column, 2 * row <= last_row);
                out.vertices.extend(match is_left == is_low {
                    true => [a, b, c, a, c, d],
                    false => [a, b, d, b, c, d],
                });
            }
        }
        out
    }

    fn triangle(&self) -> Tessellation {
        let mut out = Tessellation {
            corners: 3,
            ..Tessellation::default()
        };
        // Sides v = 0 from w to u, w = 0 from u to v, and u = 0 from v to w; in thirds of a place.
        let turned = |side: usize, [from, to, third]: [u32; 3]| {
            let (u, v) = match side {
                0 => (to, third),
                1 => (from, to),
                _ => (third, from),
            };
            // The quotient is exact where the number is a multiple of three. The sum of all three
            // is 1 even where the first two are rounded.
            let [u, v] = [u, v].map(|it| (f64::from(it) / f64::from(3 * ONE)) as f32);
            [u, v, 1.0 - u - v]
        };
        let sides = [self.outer[1], self.outer[2], self.outer[0]].map(Edge::places);
        let mut outside = Self::around(&mut out, &sides, |side, place| {
            turned(side, [3 * (ONE - place), 3 * place, 0])
        });
        if self.is_whole() {
            out.vertices.extend([0, 1, 2]);
            return out;
        }
        let places = self.inner[0].inner(self.spacing).places();
        let n = places.len() - 1;
        for ring in 1..=n / 2 {
            // Vertex k of a side of this triangle lies where the perpendicular to the side through
            // place k meets it; its ends are where two of those meet.
            let start = places[ring];
            let on_side = &places[ring..=n - ring];
            let at = |side, place: u32| {
                let (to, third) = (3 * place - start, 2 * start);
                turned(side, [3 * ONE - to - third, to, third])
            };
            let inside = match on_side.len() {
                1 => {
                    let middle = out.vertex(at(0, start));
                    SmallVec::from_elem(vec![(middle, start)], 3)
                }
                _ => {
                    let sides = [0; 3].map(|_| Places::from_slice(on_side));
                    Self::around(&mut out, &sides, at)
                }
            };
            for (outer, inner) in outside.iter().zip(&inside) {
                out.strip(outer, inner);
            }
            outside = inside;
        }
        if n % 2 == 1 {
            let innermost = [&outside[0], &outside[1], &outside[2]].map(|side| side[0].0);
            out.vertices.extend(innermost);
        }
        out
    }
}
