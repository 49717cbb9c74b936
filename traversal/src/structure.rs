//! A structure as its users see it: what it holds, what an instance is, whether it is sound.

mod micromaps;

use crate::layout::{
    ALIGNMENT, BoxEntry, GROUP, GeometryEntry, Header, InstanceRecord, MAGIC, MAX_DEPTH, Motion,
    MotionEntry, MotionInstanceRecord, Node, Parts, SweptEntry, TriangleGroup, VERSION, WIDTH,
    child, geometry_word, instance_state, leaf_bytes, micromap_part_bytes,
};
use crate::motion::{Transforms, invert, transform_at, triangle_at};
use crate::ray::Hit;

/// What a structure holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// A bottom level of triangles.
    Triangles = 1,
    /// A bottom level of boxes.
    Aabbs = 2,
    /// A top level.
    Instances = 3,
    /// A bottom level of spheres or of linear swept spheres.
    Swept = 4,
    /// A bottom level of triangles that move.
    Motion = 5,
    /// A top level whose instances may move.
    MotionInstances = 6,
}

impl Kind {
    /// A top level.
    #[inline(always)]
    pub fn is_top(self) -> bool {
        matches!(self, Kind::Instances | Kind::MotionInstances)
    }

    fn of(word: u32) -> Option<Kind> {
        match word {
            1 => Some(Kind::Triangles),
            2 => Some(Kind::Aabbs),
            3 => Some(Kind::Instances),
            4 => Some(Kind::Swept),
            5 => Some(Kind::Motion),
            6 => Some(Kind::MotionInstances),
            _ => None,
        }
    }
}

/// Why bytes are not a structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StructureError {
    /// Shorter than what the header says, or than a header.
    Truncated,
    /// Not a structure of ours, or of another version.
    NotAStructure,
    /// A count, an offset or an index points outside, or backwards.
    Corrupt,
    /// The caller's destination is too small or not aligned to 256 bytes.
    Destination,
}

impl std::fmt::Display for StructureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            StructureError::Truncated => "the structure is cut short",
            StructureError::NotAStructure => "not an acceleration structure of this version",
            StructureError::Corrupt => "the structure is corrupt",
            StructureError::Destination => "the destination is too small or misaligned",
        })
    }
}

impl std::error::Error for StructureError {}

/// What a header says of where things are.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Key([u64; 10]);

const _: () = assert!(std::mem::offset_of!(Header, leaves_offset) == 72);

impl Key {
    pub const NONE: Key = Key([0; 10]);
}

impl PartialEq for Key {
    #[inline(always)]
    fn eq(&self, other: &Key) -> bool {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64; five vectors each.
        unsafe {
            use std::arch::x86_64::*;
            let equal = |i: usize| {
                let load = |key: &Key| _mm_loadu_si128(key.0.as_ptr().add(2 * i).cast());
                _mm_cmpeq_epi8(load(self), load(other))
            };
            let most = _mm_and_si128(_mm_and_si128(equal(0), equal(1)), equal(2));
            let rest = _mm_and_si128(equal(3), equal(4));
            _mm_movemask_epi8(_mm_and_si128(most, rest)) == 0xFFFF
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            self.0 == other.0
        }
    }
}

/// A structure at an address, to be read.
///
/// Its header has been checked: the parts lie inside the size that it states. Indices inside the parts are checked where they are followed.
#[derive(Clone, Copy, Debug)]
pub struct Structure {
    base: *const u8,
    kind: Kind,
    node_count: u32,
    leaf_count: u32,
    nodes: *const Node,
    leaves: *const u8,
}

// SAFETY: a view of memory that nobody writes while it is in use (the contract of `at`).
unsafe impl Send for Structure {}
// SAFETY: as above.
unsafe impl Sync for Structure {}

impl Structure {
    /// The structure at `address`; `None` if the address is 0, not aligned, or no structure of
    /// ours lies there.
    ///
    /// # Safety
    /// An `address` other than 0 must be readable as far as the blob's header says, and must not
    /// be written while the value or a [`Walk`](crate::Walk) on it is in use.
    #[inline(always)]
    pub unsafe fn at(address: u64) -> Option<Structure> {
        if address == 0 || !address.is_multiple_of(align_of::<Header>() as u64) {
            return None;
        }
        // The address of memory of the caller's, which was exposed to get here as an integer.
        let base = std::ptr::with_exposed_provenance::<u8>(address as usize);
        // SAFETY: aligned, and readable by the caller's promise.
        let header = unsafe { &*base.cast::<Header>() };
        let kind = check_header(header).ok()?;
        Some(Structure {
            base,
            kind,
            node_count: header.node_count,
            leaf_count: header.leaf_count,
            nodes: base.wrapping_add(header.nodes_offset as usize).cast(),
            leaves: base.wrapping_add(header.leaves_offset as usize),
        })
    }

    /// Bytes of the head that every structure has.
    pub const HEADER_BYTES: u64 = size_of::<Header>() as u64;

    /// No structure: without nodes and leaves.
    pub(crate) const NOWHERE: Structure = Structure {
        base: std::ptr::null(),
        kind: Kind::Instances,
        node_count: 0,
        leaf_count: 0,
        nodes: std::ptr::null(),
        leaves: std::ptr::null(),
    };

    /// The words of the header that [`Self::at`] looks at; not of [`Self::NOWHERE`].
    #[inline(always)]
    pub(crate) fn key(&self) -> &Key {
        // SAFETY: `at` found a header here, which begins with these.
        unsafe { &*self.base.cast() }
    }

    /// The structure that `blob` starts with.
    ///
    /// # Errors
    /// What is wrong with the header.
    pub(crate) fn of(blob: &[u8]) -> Result<Structure, StructureError> {
        if blob.len() < size_of::<Header>() {
            return Err(StructureError::Truncated);
        }
        if !blob.as_ptr().cast::<Header>().is_aligned() {
            return Err(StructureError::NotAStructure);
        }
        // SAFETY: long enough and aligned.
        let header = unsafe { &*blob.as_ptr().cast::<Header>() };
        let kind = check_header(header)?;
        if header.size_bytes > blob.len() as u64 {
            return Err(StructureError::Truncated);
        }
        check_parts(kind, header)?;
        // SAFETY: the parts were found to lie inside `size_bytes`, and those inside `blob`.
        unsafe { Structure::at(blob.as_ptr().expose_provenance() as u64) }
            .ok_or(StructureError::NotAStructure)
    }

    /// What it holds.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Bytes of the blob that are in use: its size after compaction.
    pub fn size_bytes(&self) -> u64 {
        self.header().size_bytes
    }

    /// Number of entries in the table of bottom-level references: the instances, including
    /// inactive ones; 0 for a bottom level.
    pub fn reference_count(&self) -> u64 {
        match self.kind {
            kind if kind.is_top() => self.leaf_count.into(),
            _ => 0,
        }
    }

    /// Row-major 3 × 4 matrix of an instance at time 0: `ObjectToWorldKHR`, transposed.
    pub fn object_to_world(&self, instance_index: u32) -> [f32; 12] {
        self.object_to_world_at(instance_index, 0.0)
    }

    /// Row-major 3 × 4 inverse of [`Self::object_to_world`].
    pub fn world_to_object(&self, instance_index: u32) -> [f32; 12] {
        self.world_to_object_at(instance_index, 0.0)
    }

    /// As [`Self::object_to_world`], at a time in [0, 1].
    pub fn object_to_world_at(&self, instance_index: u32, time: f32) -> [f32; 12] {
        self.transforms(instance_index, time)
            .map_or([0.0; 12], |both| both.0)
    }

    /// As [`Self::world_to_object`], at a time in [0, 1].
    pub fn world_to_object_at(&self, instance_index: u32, time: f32) -> [f32; 12] {
        self.transforms(instance_index, time)
            .map_or([0.0; 12], |both| both.1)
    }

    /// The 24 bits that the application gave an instance (`InstanceCustomIndexKHR`), and its offset into the hit records.
    pub fn instance_indices(&self, instance_index: u32) -> (u32, u32) {
        self.instance(instance_index).map_or((0, 0), |record| {
            (
                record.custom_index_and_mask & 0xFF_FFFF,
                record.sbt_offset_and_flags & 0xFF_FFFF,
            )
        })
    }

    /// The object-space positions of a hit triangle's vertices, in order, after the geometry's
    /// transform. `self` is the top level; zeros for what is no triangle.
    pub fn triangle_vertices(&self, hit: &Hit) -> [[f32; 3]; 3] {
        self.triangle_vertices_at(hit, 0.0)
    }

    /// As [`Self::triangle_vertices`], at a time in [0, 1].
    pub fn triangle_vertices_at(&self, hit: &Hit, time: f32) -> [[f32; 3]; 3] {
        // SAFETY: bottom levels of a structure in use are alive, by the contract of `at`.
        let Some(bottom) = (unsafe { Structure::at(self.reference(hit.instance_index)) }) else {
            return [[0.0; 3]; 3];
        };
        let slot = bottom.slot_of(hit);
        if let Some(entry) = bottom.motion_entry(slot) {
            return triangle_at(&entry.triangles, time);
        }
        bottom
            .group(slot / 4)
            .map_or([[0.0; 3]; 3], |group| group.triangle((slot % 4) as usize))
    }

    /// Where a hit's primitive lies in this bottom level. A hit that no walk found does not know; then it is looked for.
    fn slot_of(&self, hit: &Hit) -> u32 {
        if hit.slot != Hit::UNKNOWN_SLOT {
            return hit.slot;
        }
        let is_it = |primitive: u32, geometry: u32| {
            primitive == hit.primitive_index
                && geometry & geometry_word::INDEX == hit.geometry_index
        };
        let found = (0..self.leaf_count).find_map(|index| match self.kind {
            Kind::Triangles => {
                let group = self.group(index)?;
                (0..4u32)
                    .find(|&lane| {
                        let k = lane as usize;
                        group.lanes >> lane & 1 != 0
                            && is_it(group.primitives[k], group.geometries[k])
                    })
                    .map(|lane| 4 * index + lane)
            }
            Kind::Swept => {
                let entry = self.swept_entry(index)?;
                is_it(entry.primitive, entry.geometry).then_some(index)
            }
            Kind::Motion => {
                let entry = self.motion_entry(index)?;
                is_it(entry.primitive, entry.geometry).then_some(index)
            }
            _ => None,
        });
        found.unwrap_or(Hit::UNKNOWN_SLOT)
    }

    /// The object-space ends of a hit sphere or linear swept sphere, and their radii. `self` is the top level; zeros for what is none.
    pub fn swept_ends(&self, hit: &Hit) -> ([[f32; 3]; 2], [f32; 2]) {
        // SAFETY: bottom levels of a structure in use are alive, by the contract of `at`.
        let bottom = unsafe { Structure::at(self.reference(hit.instance_index)) };
        bottom
            .and_then(|bottom| bottom.swept_entry(bottom.slot_of(hit)).copied())
            .map_or_else(Default::default, |entry| (entry.positions, entry.radii))
    }

    #[inline(always)]
    pub(crate) fn header(&self) -> &Header {
        // SAFETY: `at` found a header here.
        unsafe { &*self.base.cast::<Header>() }
    }

    #[inline(always)]
    pub(crate) fn node_count(&self) -> u32 {
        self.node_count
    }

    /// The first of [`Self::node_count`] nodes.
    #[inline(always)]
    pub(crate) fn nodes(&self) -> *const Node {
        self.nodes
    }

    /// Where a child lies, if its word is sound.
    #[inline(always)]
    pub(crate) fn child_address(&self, word: u32) -> *const u8 {
        if word & child::LEAF == 0 {
            self.nodes.wrapping_add(word as usize).cast()
        } else {
            let offset = (word & child::INDEX) as usize * size_of::<TriangleGroup>();
            self.leaves.wrapping_add(offset)
        }
    }

    #[inline(always)]
    pub(crate) fn node(&self, index: u32) -> Option<&Node> {
        // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
        (index < self.node_count).then(|| unsafe { &*self.nodes.add(index as usize) })
    }

    #[inline(always)]
    pub(crate) fn group(&self, index: u32) -> Option<&TriangleGroup> {
        (self.kind == Kind::Triangles && index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            .then(|| unsafe { &*self.leaves.cast::<TriangleGroup>().add(index as usize) })
    }

    /// The first of the groups of a structure of triangles, and how many there are.
    #[inline(always)]
    pub(crate) fn groups(&self) -> (*const TriangleGroup, u32) {
        match self.kind {
            Kind::Triangles => (self.leaves.cast(), self.leaf_count),
            _ => (self.leaves.cast(), 0),
        }
    }

    /// Geometry and primitive of the triangle in a slot.
    #[inline(always)]
    pub(crate) fn identity(&self, slot: u32) -> (u32, u32) {
        let lane = slot as usize % GROUP;
        self.group(slot / GROUP as u32).map_or((0, 0), |group| {
            (
                group.geometries[lane] & geometry_word::INDEX,
                group.primitives[lane],
            )
        })
    }

    #[inline(always)]
    pub(crate) fn box_entry(&self, index: u32) -> Option<&BoxEntry> {
        (self.kind == Kind::Aabbs && index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            .then(|| unsafe { &*self.leaves.cast::<BoxEntry>().add(index as usize) })
    }

    #[inline(always)]
    pub(crate) fn swept_entry(&self, index: u32) -> Option<&SweptEntry> {
        (self.kind == Kind::Swept && index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            .then(|| unsafe { &*self.leaves.cast::<SweptEntry>().add(index as usize) })
    }

    #[inline(always)]
    pub(crate) fn instance(&self, index: u32) -> Option<&InstanceRecord> {
        (self.kind.is_top() && index < self.leaf_count).then(|| {
            let offset = index as usize * leaf_bytes(self.kind) as usize;
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes. Records of both kinds begin with this.
            unsafe { &*self.leaves.add(offset).cast::<InstanceRecord>() }
        })
    }

    pub(crate) fn motion_entry(&self, index: u32) -> Option<&MotionEntry> {
        (self.kind == Kind::Motion && index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            .then(|| unsafe { &*self.leaves.cast::<MotionEntry>().add(index as usize) })
    }

    /// How an instance moves.
    pub(crate) fn motion(&self, index: u32) -> Option<&Motion> {
        (self.kind == Kind::MotionInstances && index < self.leaf_count).then(|| {
            let records = self.leaves.cast::<MotionInstanceRecord>();
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            unsafe { &(*records.add(index as usize)).motion }
        })
    }

    /// Transform and inverse of an instance at a time in [0, 1]; `None` where it has no inverse then.
    pub(crate) fn transforms(&self, index: u32, time: f32) -> Option<Transforms> {
        let record = self.instance(index)?;
        if record.state & instance_state::MOVING == 0 {
            return Some((record.object_to_world, record.world_to_object));
        }
        let object_to_world = transform_at(self.motion(index)?, time);
        let world_to_object = invert(&object_to_world)?.0;
        Some((object_to_world, world_to_object))
    }

    /// The address in an instance's entry of the reference table; 0 where there is none.
    #[inline(always)]
    pub(crate) fn reference(&self, index: u32) -> u64 {
        if !self.kind.is_top() || index >= self.leaf_count {
            return 0;
        }
        let table = self
            .base
            .wrapping_add(self.header().references_offset as usize)
            .cast::<u64>();
        // SAFETY: below the count, so inside the table, which the header check placed.
        unsafe { table.add(index as usize).read() }
    }

    pub(crate) fn geometry(&self, index: u32) -> Option<&GeometryEntry> {
        let header = self.header();
        (index < header.geometry_count).then(|| {
            let table = self.base.wrapping_add(header.geometries_offset as usize);
            // SAFETY: below the count, so inside the table, which the header check placed.
            unsafe { &*table.cast::<GeometryEntry>().add(index as usize) }
        })
    }
}

/// Checks that a header is one of ours and that its nodes and leaves are inside its size: what
/// reading them relies on.
#[inline(always)]
fn check_header(header: &Header) -> Result<Kind, StructureError> {
    if header.magic != MAGIC || header.version != VERSION {
        return Err(StructureError::NotAStructure);
    }
    let kind = Kind::of(header.kind).ok_or(StructureError::NotAStructure)?;
    let inside = |offset: u64, count: u32, bytes: u64| {
        offset.is_multiple_of(ALIGNMENT)
            && (offset.checked_add(u64::from(count) * bytes))
                .is_some_and(|end| end <= header.size_bytes)
    };
    let references = match kind {
        kind if kind.is_top() => header.leaf_count,
        _ => 0,
    };
    if inside(
        header.nodes_offset,
        header.node_count,
        size_of::<Node>() as u64,
    ) && inside(header.leaves_offset, header.leaf_count, leaf_bytes(kind))
        && inside(header.references_offset, references, 8)
    {
        Ok(kind)
    } else {
        Err(StructureError::Corrupt)
    }
}

/// Checks that all parts lie exactly where their counts put them.
fn check_parts(kind: Kind, header: &Header) -> Result<(), StructureError> {
    let parts = Parts::new(
        kind,
        header.geometry_count.into(),
        header.node_count.into(),
        header.leaf_count.into(),
    );
    let stated = Parts {
        geometries_offset: header.geometries_offset,
        references_offset: header.references_offset,
        nodes_offset: header.nodes_offset,
        leaves_offset: header.leaves_offset,
        size_bytes: header.size_bytes.saturating_sub(header.micromap_bytes),
    };
    let micromaps = header.micromap_bytes == 0
        || matches!(kind, Kind::Triangles | Kind::Motion)
            && header.micromap_bytes
                >= micromap_part_bytes(header.geometry_count.into(), header.primitive_count);
    let good =
        parts == stated && micromaps && header.node_count > 0 && header.leaf_count <= child::INDEX;
    good.then_some(()).ok_or(StructureError::Corrupt)
}

/// Checks everything that a walk relies on, except that references of instances are alive: each
/// child is inside the blob, above its parent, in a tree no deeper than the walk's stack.
///
/// # Errors
/// What is wrong first.
pub fn validate(blob: &[u8]) -> Result<(), StructureError> {
    let structure = Structure::of(blob)?;
    let check = |good: bool| good.then_some(()).ok_or(StructureError::Corrupt);
    check(structure.header().depth <= MAX_DEPTH)?;
    // Depth first, each node at most once: a child's index is above its parent's, and the budget
    // stops a graph that shares children.
    let mut budget = u64::from(structure.node_count());
    let mut stack = [(0u32, 0u32); MAX_DEPTH as usize * WIDTH];
    let mut top = 1;
    while top > 0 {
        top -= 1;
        let (index, depth) = stack[top];
        check(budget > 0 && depth < MAX_DEPTH)?;
        budget -= 1;
        let node = structure.node(index).ok_or(StructureError::Corrupt)?;
        for &word in &node.children {
            if word == child::NONE {
                continue;
            } else if word & child::LEAF != 0 {
                check_leaf(&structure, word)?;
            } else {
                check(word > index && top < stack.len())?;
                stack[top] = (word, depth + 1);
                top += 1;
            }
        }
    }
    micromaps::check(&structure, blob)
}

fn check_leaf(structure: &Structure, word: u32) -> Result<(), StructureError> {
    let index = word & child::INDEX;
    let count = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
    let primitive = |primitive: u32, geometry: u32| {
        structure
            .geometry(geometry & geometry_word::INDEX)
            .is_some_and(|entry| primitive < entry.primitive_count)
    };
    let good = match structure.kind() {
        Kind::Triangles => (index..index + count).all(|index| {
            structure.group(index).is_some_and(|group| {
                group.lanes < 16
                    && (0..4)
                        .filter(|lane| group.lanes >> lane & 1 != 0)
                        .all(|lane| primitive(group.primitives[lane], group.geometries[lane]))
            })
        }),
        Kind::Aabbs => {
            count == 1
                && structure
                    .box_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Swept => {
            count == 1
                && structure
                    .swept_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Motion => {
            count == 1
                && structure
                    .motion_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Instances | Kind::MotionInstances => {
            count == 1 && structure.instance(index).is_some()
        }
    };
    good.then_some(()).ok_or(StructureError::Corrupt)
}
