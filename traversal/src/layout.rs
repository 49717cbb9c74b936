//! The bytes of a blob.
//!
//! ```text
//! Header              256 bytes
//! GeometryEntry       16 bytes for each geometry
//! reference table     8 bytes for each instance (top level only): the address of its bottom level
//! Node                256 bytes each; node 0 is the root, a child's index is above its parent's
//! leaves              TriangleGroup (192 bytes) or Block (units of 16), BoxEntry (8), SweptEntry (64), MotionEntry (80), InstanceRecord (128)
//!                     or MotionInstanceRecord (320) each
//! micromaps           where a geometry has one: 8 bytes for each geometry (a MicromapReference), 4
//!                     bytes for each primitive of all geometries, then micromaps of its own
//! ```
//!
//! Each part starts at a multiple of 256 bytes. Only the boxes of a top level depend on the
//! contents of its bottom levels, so a move to another process rewrites only the reference table.

mod block;
mod bounds;
mod margin;
mod node;

use std::mem::size_of;

#[cfg(target_arch = "x86_64")]
pub(crate) use block::BLOCK_VERTICES;
pub(crate) use block::{BLOCK_UNIT, BLOCK_UNITS, Block};
pub(crate) use bounds::Bounds;
#[cfg(target_arch = "x86_64")]
pub(crate) use margin::MARGIN_RISE;
pub(crate) use margin::{Extent, Margin};
use margin::{larger, smaller};
pub(crate) use node::NodeAt;

/// First word of every blob.
pub(crate) const MAGIC: u64 = u64::from_le_bytes(*b"TuffASv\0");
/// Version of the layout; counts up with every change of it.
pub(crate) const VERSION: u32 = 4;
/// Alignment of a blob and of each of its parts, in bytes.
pub(crate) const ALIGNMENT: u64 = 256;

/// Levels of nodes in one structure, at most.
pub(crate) const MAX_DEPTH: u32 = 32;
/// Children of a node.
pub(crate) const WIDTH: usize = 8;
/// Triangles of a leaf, at most: two groups.
pub(crate) const LEAF_TRIANGLES: usize = 8;
/// Triangles of a group.
pub(crate) const GROUP: usize = 4;

/// The head of a blob; it takes [`HEADER_BYTES`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Header {
    pub magic: u64,
    pub version: u32,
    /// A [`crate::Kind`].
    pub kind: u16,
    /// A [`Form`].
    pub form: u16,
    /// The [`crate::BuildFlags`] of the build.
    pub flags: u32,
    pub geometry_count: u32,
    /// Primitives of all geometries, active or not.
    pub primitive_count: u64,
    /// Bytes in use.
    pub size_bytes: u64,
    pub node_count: u32,
    /// Leaves; of blocks, units.
    pub leaf_count: u32,
    pub geometries_offset: u64,
    pub references_offset: u64,
    pub nodes_offset: u64,
    pub leaves_offset: u64,
    /// Bytes of the last part, the micromaps; 0 without.
    pub micromap_bytes: u64,
    /// Bounds of everything active; min above max when there is nothing.
    pub bounds: Bounds,
    /// Top level: a ray's origin, times this, bounds how far in world space the rounding of
    /// instance transforms can move the ray.
    pub origin_error: f32,
    /// Bits of [`features`].
    pub features: u32,
    /// Levels of nodes.
    pub depth: u32,
    /// The expected cost of a ray through the bounds at build time, for updatable structures; else
    /// 0.
    pub cost: f32,
}

impl Header {
    /// Of nothing.
    pub const NONE: Header = Header {
        magic: 0,
        version: 0,
        kind: 0,
        form: 0,
        flags: 0,
        geometry_count: 0,
        primitive_count: 0,
        size_bytes: 0,
        node_count: 0,
        leaf_count: 0,
        geometries_offset: 0,
        references_offset: 0,
        nodes_offset: 0,
        leaves_offset: 0,
        micromap_bytes: 0,
        bounds: Bounds::EMPTY,
        origin_error: 0.0,
        features: 0,
        depth: 0,
        cost: 0.0,
    };
}

/// Bytes of the first part: the header, and zeros.
pub(crate) const HEADER_BYTES: u64 = 256;

/// How the leaves of a structure of triangles are written; all others have the first form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub(crate) enum Form {
    /// [`TriangleGroup`]s.
    Groups = 0,
    /// [`Block`]s, counted in units of 16 bytes. After the start of the last one there is room for
    /// the largest.
    Blocks = 1,
}

impl Form {
    pub fn of(word: u16) -> Option<Form> {
        match word {
            0 => Some(Form::Groups),
            1 => Some(Form::Blocks),
            _ => None,
        }
    }
}

/// The contents of a bottom level, which spare the walk some checks.
pub(crate) mod features {
    /// A geometry that is opaque.
    pub const OPAQUE: u32 = 1;
    /// A geometry that is not.
    pub const NOT_OPAQUE: u32 = 2;
}

/// The stored data of a geometry.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct GeometryEntry {
    /// Primitives of the geometries before it.
    pub first_primitive: u64,
    pub primitive_count: u32,
    /// The [`crate::GeometryFlags`].
    pub flags: u32,
}

/// Eight boxes and what they bound. An unused child's box is empty: min +∞, max −∞.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(256))]
pub(crate) struct Node {
    /// Rows min x, max x, min y, max y, min z, max z; one column a child.
    pub bounds: [[f32; WIDTH]; 6],
    /// A [`child`] word each.
    pub children: [u32; WIDTH],
    pub reserved: [u32; WIDTH],
}

/// Words of [`Node::children`].
pub(crate) mod child {
    /// No child.
    pub const NONE: u32 = u32::MAX;
    /// The child is a leaf.
    pub const LEAF: u32 = 1 << 31;
    /// The leaf is two triangle groups, not one; a block says itself how many triangles it has.
    pub const TWO_GROUPS: u32 = 1 << 30;
    /// Index of the leaf; of a block, of its first unit.
    pub const INDEX: u32 = TWO_GROUPS - 1;
}

/// Four triangles, one a lane.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct TriangleGroup {
    /// `[vertex][axis][lane]`.
    pub vertices: [[[f32; GROUP]; 3]; 3],
    pub primitives: [u32; GROUP],
    /// [`geometry_word`]s.
    pub geometries: [u32; GROUP],
    /// Bit i: lane i holds a triangle.
    pub lanes: u32,
    /// For the largest of the triangles.
    pub margin: Margin,
    pub reserved: u32,
}

impl TriangleGroup {
    /// A group that holds nothing.
    pub const EMPTY: TriangleGroup = TriangleGroup {
        vertices: [[[0.0; GROUP]; 3]; 3],
        primitives: [u32::MAX; GROUP],
        geometries: [0; GROUP],
        lanes: 0,
        margin: Margin::NONE,
        reserved: 0,
    };

    /// The three vertices of a lane. By a loop, as closures are calls where an instruction set is
    /// enabled.
    #[inline(always)]
    pub fn triangle(&self, lane: usize) -> [[f32; 3]; 3] {
        let mut triangle = [[0.0; 3]; 3];
        for (vertex, position) in self.vertices.iter().zip(&mut triangle) {
            for (axis, coordinate) in vertex.iter().zip(position) {
                *coordinate = axis[lane];
            }
        }
        triangle
    }

    /// Sets the vertices of a lane.
    pub fn set_triangle(&mut self, lane: usize, triangle: &[[f32; 3]; 3]) {
        for (vertex, position) in self.vertices.iter_mut().zip(triangle) {
            for (axis, coordinate) in vertex.iter_mut().zip(position) {
                axis[lane] = *coordinate;
            }
        }
    }

    /// The box around all triangles. NaN counts as 0, and an infinity as the largest finite number.
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for axis in 0..3 {
            let [least, most] = self.extremes(axis, |coordinate| {
                let number = if coordinate.is_nan() { 0.0 } else { coordinate };
                smaller(larger(number, f32::MIN), f32::MAX)
            });
            for lane in self.filled() {
                bounds.min[axis] = smaller(least[lane], bounds.min[axis]);
                bounds.max[axis] = larger(most[lane], bounds.max[axis]);
            }
        }
        bounds
    }

    /// Lanes that hold a triangle.
    fn filled(&self) -> impl Iterator<Item = usize> {
        let lanes = self.lanes;
        (0..GROUP).filter(move |lane| lanes >> lane & 1 != 0)
    }

    /// The least and the greatest coordinate of each lane's triangle along an axis.
    #[inline(always)]
    fn extremes(&self, axis: usize, clean: impl Fn(f32) -> f32) -> [[f32; GROUP]; 2] {
        let mut extremes = [[0.0; GROUP]; 2];
        for lane in 0..GROUP {
            let [a, b, c] = [0, 1, 2].map(|vertex: usize| clean(self.vertices[vertex][axis][lane]));
            extremes[0][lane] = smaller(smaller(a, b), c);
            extremes[1][lane] = larger(larger(a, b), c);
        }
        extremes
    }
}

/// A box of a bottom level; its extent is the box of its child slot.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct BoxEntry {
    pub primitive: u32,
    /// A [`geometry_word`].
    pub geometry: u32,
}

/// A sphere or a linear swept sphere.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct SweptEntry {
    /// Both ends; of a sphere, twice its center.
    pub positions: [[f32; 3]; 2],
    pub radii: [f32; 2],
    pub primitive: u32,
    /// A [`geometry_word`].
    pub geometry: u32,
    /// Bits of [`swept_flags`].
    pub flags: u32,
    pub reserved: [u32; 5],
}

/// Flags of a [`SweptEntry`].
pub(crate) mod swept_flags {
    pub const SPHERE: u32 = 1;
    /// The first end is round.
    pub const FIRST_CAP: u32 = 2;
    /// The second end is round.
    pub const SECOND_CAP: u32 = 4;
}

/// A triangle that moves.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct MotionEntry {
    /// At time 0 and at time 1.
    pub triangles: [[[f32; 3]; 3]; 2],
    pub primitive: u32,
    /// A [`geometry_word`].
    pub geometry: u32,
}

/// How an instance moves.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct Motion {
    /// One of [`motion_type`].
    pub ty: u32,
    pub reserved: [u32; 3],
    /// At time 0 and at time 1: twelve numbers of a matrix, or sixteen of `VkSRTDataNV`.
    pub transforms: [[f32; 16]; 2],
}

/// `VkAccelerationStructureMotionInstanceTypeNV`.
pub(crate) mod motion_type {
    pub const STATIC: u32 = 0;
    pub const MATRIX: u32 = 1;
    pub const SRT: u32 = 2;
}

/// An instance that may move; the record is what it is at time 0.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct MotionInstanceRecord {
    pub record: InstanceRecord,
    pub motion: Motion,
    pub reserved: [u32; 12],
}

/// A geometry's index and flags in one word.
pub(crate) mod geometry_word {
    /// The geometry is opaque.
    pub const OPAQUE: u32 = 1 << 31;
    /// The geometry has a micromap, which says what is opaque.
    pub const MICROMAP: u32 = 1 << 30;
    /// The geometry's index.
    pub const INDEX: u32 = (1 << 24) - 1;
}

/// An instance. Its bottom level's address is in the reference table.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct InstanceRecord {
    /// Row-major 3 × 4, as given.
    pub object_to_world: [f32; 12],
    /// Row-major 3 × 4, inverted in f64 and rounded.
    pub world_to_object: [f32; 12],
    pub words: InstanceWords,
    pub reserved: [u32; 4],
}

/// The data of an instance besides its transform.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct InstanceWords {
    /// 24 bits, then the 8-bit mask.
    pub custom_index_and_mask: u32,
    /// 24 bits, then the 8-bit flags.
    pub sbt_offset_and_flags: u32,
    /// Bits of [`instance_state`].
    pub state: u32,
    pub reserved: u32,
}

/// Facts that a build found out about an instance.
pub(crate) mod instance_state {
    /// Without it the instance is never entered, whatever the reference.
    pub const ACTIVE: u32 = 1;
    /// The transform changes nothing.
    pub const IDENTITY: u32 = 2;
    /// The transform depends on the time.
    pub const MOVING: u32 = 4;
}

/// The flags of an instance; `VkGeometryInstanceFlagBitsKHR`.
pub(crate) mod instance_flags {
    pub const TRIANGLE_FACING_CULL_DISABLE: u32 = 0x1;
    pub const TRIANGLE_FLIP_FACING: u32 = 0x2;
    pub const FORCE_OPAQUE: u32 = 0x4;
    pub const FORCE_NO_OPAQUE: u32 = 0x8;
    pub const FORCE_OPACITY_MICROMAP_2_STATE: u32 = 0x10;
    pub const DISABLE_OPACITY_MICROMAPS: u32 = 0x20;
}

impl Node {
    /// A node without children.
    pub const EMPTY: Node = Node {
        bounds: [
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        children: [child::NONE; WIDTH],
        reserved: [0; WIDTH],
    };

    /// Sets a child's box.
    pub fn set_bounds(&mut self, lane: usize, bounds: Bounds) {
        for axis in 0..3 {
            self.bounds[2 * axis][lane] = bounds.min[axis];
            self.bounds[2 * axis + 1][lane] = bounds.max[axis];
        }
    }

    /// A child's box.
    pub fn child_bounds(&self, lane: usize) -> Bounds {
        Bounds {
            min: std::array::from_fn(|axis| self.bounds[2 * axis][lane]),
            max: std::array::from_fn(|axis| self.bounds[2 * axis + 1][lane]),
        }
    }

    /// The box around all children.
    pub fn all_bounds(&self) -> Bounds {
        (0..WIDTH).fold(Bounds::EMPTY, |sum, lane| {
            sum.union(self.child_bounds(lane))
        })
    }
}

/// Where the parts of a blob lie, from its counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Parts {
    pub geometries_offset: u64,
    pub references_offset: u64,
    pub nodes_offset: u64,
    pub leaves_offset: u64,
    pub size_bytes: u64,
}

impl Parts {
    /// Lays out the parts one after the other. Counts are below 2³², so nothing overflows.
    pub fn new(kind: crate::Kind, form: Form, geometries: u64, nodes: u64, leaves: u64) -> Parts {
        let align = |offset: u64| offset.next_multiple_of(ALIGNMENT);
        let references = if kind.is_top() { leaves * 8 } else { 0 };
        let geometries_offset = HEADER_BYTES;
        let references_offset =
            align(geometries_offset + geometries * size_of::<GeometryEntry>() as u64);
        let nodes_offset = align(references_offset + references);
        let leaves_offset = nodes_offset + nodes * size_of::<Node>() as u64;
        Parts {
            geometries_offset,
            references_offset,
            nodes_offset,
            leaves_offset,
            size_bytes: align(leaves_offset + leaves * leaf_bytes(kind, form)),
        }
    }
}

/// Bytes of the micromap part, without micromaps of its own.
pub(crate) fn micromap_part_bytes(geometries: u64, primitives: u64) -> u64 {
    // Counts in a blob may be anything.
    (8 * geometries)
        .saturating_add(primitives.saturating_mul(4))
        .checked_next_multiple_of(ALIGNMENT)
        .unwrap_or(u64::MAX)
}

/// Words for the geometries in the micromap part: 0, the address of a micromap, or where it lies in
/// the part (as it does after deserialization).
pub(crate) mod micromap_reference {
    /// The rest is an offset from the start of the part.
    pub const INSIDE: u64 = 1;
    /// The rest is an address that serialized data lists.
    pub const LISTED: u64 = 2;
}

/// Bytes of one leaf, or of one unit.
pub(crate) fn leaf_bytes(kind: crate::Kind, form: Form) -> u64 {
    match kind {
        crate::Kind::Triangles if form == Form::Blocks => BLOCK_UNIT as u64,
        crate::Kind::Triangles => size_of::<TriangleGroup>() as u64,
        crate::Kind::Aabbs => size_of::<BoxEntry>() as u64,
        crate::Kind::Swept => size_of::<SweptEntry>() as u64,
        crate::Kind::Motion => size_of::<MotionEntry>() as u64,
        crate::Kind::Instances => size_of::<InstanceRecord>() as u64,
        crate::Kind::MotionInstances => size_of::<MotionInstanceRecord>() as u64,
    }
}

const _: () = assert!(size_of::<Header>() == 128);
const _: () = assert!(size_of::<GeometryEntry>() == 16);
const _: () = assert!(size_of::<Node>() == 256);
const _: () = assert!(size_of::<TriangleGroup>() == 192);
const _: () = assert!(size_of::<BoxEntry>() == 8);
const _: () = assert!(size_of::<SweptEntry>() == 64);
const _: () = assert!(size_of::<MotionEntry>() == 80);
const _: () = assert!(size_of::<MotionInstanceRecord>() == 320);
const _: () = assert!(size_of::<InstanceRecord>() == 128);
