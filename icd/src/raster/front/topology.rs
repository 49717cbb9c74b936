//! Which vertices make up each primitive of a segment: a run of vertices without a restart (spec,
//! "Primitive Topologies").

#![forbid(unsafe_code)]

use std::ops::Range;

use ash::vk::PrimitiveTopology as Topology;

/// A primitive of the stream that set-up takes, made by vertex assembly or by a geometry shader; or
/// the input of a geometry shader.
#[derive(Clone, Copy, Debug)]
pub struct Assembled {
    /// Places of its vertices in the run.
    pub vertices: [u32; 3],
    pub primitive_id: u32,
    /// Index of the values that all vertices of its instance share.
    pub common: u32,
    pub provoking: u8,
    /// The vertex stream that a geometry shader emitted it to.
    pub stream: u8,
}

impl Assembled {
    /// The vertex that provides flat varyings.
    #[inline(always)]
    pub fn provoking_vertex(&self) -> u32 {
        self.vertices[usize::from(self.provoking)]
    }
}

/// The kind of a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Point,
    Line,
    Triangle,
}

impl Kind {
    /// Vertices of a primitive.
    pub fn corners(self) -> usize {
        match self {
            Kind::Point => 1,
            Kind::Line => 2,
            Kind::Triangle => 3,
        }
    }
}

/// The kind of a topology's primitives; none for topologies of unsupported stages.
pub fn kind(topology: Topology) -> Option<Kind> {
    match topology {
        Topology::POINT_LIST => Some(Kind::Point),
        Topology::LINE_LIST
        | Topology::LINE_STRIP
        | Topology::LINE_LIST_WITH_ADJACENCY
        | Topology::LINE_STRIP_WITH_ADJACENCY => Some(Kind::Line),
        Topology::TRIANGLE_LIST
        | Topology::TRIANGLE_STRIP
        | Topology::TRIANGLE_FAN
        | Topology::TRIANGLE_LIST_WITH_ADJACENCY
        | Topology::TRIANGLE_STRIP_WITH_ADJACENCY => Some(Kind::Triangle),
        _ => None,
    }
}

/// Lines that continue one another, so that a stipple pattern runs on from each to the next.
pub fn is_line_strip(topology: Topology) -> bool {
    matches!(
        topology,
        Topology::LINE_STRIP | Topology::LINE_STRIP_WITH_ADJACENCY
    )
}

/// Complete primitives of a segment of that many vertices.
pub fn count(topology: Topology, vertices: u32) -> u32 {
    match topology {
        Topology::POINT_LIST => vertices,
        Topology::LINE_LIST => vertices / 2,
        Topology::LINE_STRIP => vertices.saturating_sub(1),
        Topology::LINE_LIST_WITH_ADJACENCY => vertices / 4,
        Topology::LINE_STRIP_WITH_ADJACENCY => vertices.saturating_sub(3),
        Topology::TRIANGLE_LIST => vertices / 3,
        Topology::TRIANGLE_STRIP | Topology::TRIANGLE_FAN => vertices.saturating_sub(2),
        Topology::TRIANGLE_LIST_WITH_ADJACENCY => vertices / 6,
        Topology::TRIANGLE_STRIP_WITH_ADJACENCY => vertices.saturating_sub(4) / 2,
        _ => 0,
    }
}

/// The vertices of a primitive, by their place in the segment, as the specification orders them. A
/// triangle whose provoking vertex is its last one ends with it, which is the order that
/// barycentric coordinates count in, too. A line has its second vertex twice, a point one vertex
/// three times.
#[inline]
pub fn vertices(topology: Topology, primitive: u32, last: bool) -> [u32; 3] {
    let i = primitive;
    let odd = i & 1;
    match topology {
        Topology::POINT_LIST => [i; 3],
        Topology::LINE_LIST => [2 * i, 2 * i + 1, 2 * i + 1],
        Topology::LINE_STRIP => [i, i + 1, i + 1],
        Topology::LINE_LIST_WITH_ADJACENCY => [4 * i + 1, 4 * i + 2, 4 * i + 2],
        Topology::LINE_STRIP_WITH_ADJACENCY => [i + 1, i + 2, i + 2],
        Topology::TRIANGLE_LIST => [3 * i, 3 * i + 1, 3 * i + 2],
        Topology::TRIANGLE_STRIP if last => [i + odd, i + 1 - odd, i + 2],
        Topology::TRIANGLE_STRIP => [i, i + 1 + odd, i + 2 - odd],
        Topology::TRIANGLE_FAN if last => [0, i + 1, i + 2],
        Topology::TRIANGLE_FAN => [i + 1, i + 2, 0],
        Topology::TRIANGLE_LIST_WITH_ADJACENCY => [6 * i, 6 * i + 2, 6 * i + 4],
        _ if last => [2 * i + 2 * odd, 2 * i + 2 - 2 * odd, 2 * i + 4],
        _ => [2 * i, 2 * i + 2 + 2 * odd, 2 * i + 4 - 2 * odd],
    }
}

/// Vertices of the largest primitive: a triangle with adjacency.
pub const MAX_CORNERS: usize = 6;

/// All vertices of a primitive, those that are only adjacent included, as geometry shaders count
/// them, and how many there are. `primitives` is the count of the segment.
pub fn corners(
    topology: Topology,
    primitive: u32,
    primitives: u32,
    last: bool,
) -> ([u32; MAX_CORNERS], usize) {
    let [a, b, c] = vertices(topology, primitive, last);
    let i = primitive;
    match topology {
        Topology::LINE_LIST_WITH_ADJACENCY | Topology::LINE_STRIP_WITH_ADJACENCY => {
            ([a - 1, a, b, b + 1, 0, 0], 4)
        }
        Topology::TRIANGLE_LIST_WITH_ADJACENCY => ([a, a + 1, b, b + 1, c, c + 1], 6),
        Topology::TRIANGLE_STRIP_WITH_ADJACENCY => {
            // Adjacent to the edges between vertices 2i and 2i + 2, 2i + 2 and 2i + 4, 2i and
            // 2i + 4 (spec, table "Triangles generated by triangle strips with adjacency").
            let before = if i == 0 { 1 } else { 2 * i - 2 };
            let after = if i + 1 == primitives {
                2 * i + 5
            } else {
                2 * i + 6
            };
            let side = 2 * i + 3;
            match (i & 1, last) {
                (0, _) => ([a, before, b, after, c, side], 6),
                (_, false) => ([a, side, b, after, c, before], 6),
                (_, true) => ([a, before, b, side, c, after], 6),
            }
        }
        _ => ([a, b, c, 0, 0, 0], kind(topology).map_or(0, Kind::corners)),
    }
}

/// The vertices of consecutive primitives, where those are consecutive and all in use.
pub fn run(topology: Topology, primitives: &Range<u32>) -> Option<Range<u32>> {
    let is_dense = matches!(
        topology,
        Topology::POINT_LIST
            | Topology::LINE_LIST
            | Topology::LINE_STRIP
            | Topology::TRIANGLE_LIST
            | Topology::TRIANGLE_STRIP
    );
    let last = primitives.end.checked_sub(1)?;
    let first = vertices(topology, primitives.start, false)[0];
    let end = vertices(topology, last, false).into_iter().max()? + 1;
    is_dense.then_some(first..end)
}

/// Which of a primitive's [`vertices`] is its provoking vertex.
#[inline]
pub fn provoking(topology: Topology, last: bool) -> u8 {
    match (kind(topology), last) {
        (_, false) | (Some(Kind::Point) | None, _) => 0,
        (Some(Kind::Line), true) => 1,
        (Some(Kind::Triangle), true) => 2,
    }
}
