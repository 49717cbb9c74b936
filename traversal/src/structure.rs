//! A structure as its users see it: what it holds, what an instance is, whether it is sound.

mod contents;
mod head;
mod hits;
mod kind;
mod micromaps;
mod validate;

use crate::error::StructureError;
use crate::layout::{
    ALIGNMENT, BLOCK_UNIT, BLOCK_UNITS, Block, BoxEntry, Form, GROUP, GeometryEntry, HEADER_BYTES,
    Header, InstanceRecord, InstanceWords, LEAF_TRIANGLES, Motion, MotionEntry,
    MotionInstanceRecord, Node, NodeAt, SweptEntry, TriangleGroup, child, geometry_word,
    instance_state, leaf_bytes,
};
use crate::live::Live;
use crate::motion::{Transforms, invert, transform_at};
pub use contents::{BoxLevel, Content, InstanceContent, PrimitiveShape, StructureFacts};
use head::{check_header, check_parts};
pub use kind::Kind;
pub use validate::validate;

/// A structure at an address, to be read.
///
/// It is made from one copy of the header, which was checked: all parts lie inside the size that it
/// stated, and that inside memory that is there. The header in memory is not read again. The
/// contents of parts may be invalid, and may change at any time: each word of a node, count or
/// reference is read once, checked against this copy, and then used. Coordinates are only ever
/// coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Structure {
    base: *const u8,
    kind: Kind,
    form: Form,
    node_count: u32,
    leaf_count: u32,
    geometry_count: u32,
    /// Bits of [`features`](crate::layout::features).
    features: u32,
    origin_error: f32,
    depth: u32,
    nodes: *const Node,
    leaves: *const u8,
    references: *const u64,
    geometries: *const GeometryEntry,
    size_bytes: u64,
    micromap_bytes: u64,
}

// SAFETY: a view of memory that stays there while it is in use (the contract of `at`).
unsafe impl Send for Structure {}
// SAFETY: a view of memory that stays there while it is in use (the contract of `at`).
unsafe impl Sync for Structure {}

impl Structure {
    /// The structure at `address`; `None` if that is 0, not aligned or not live, or no structure of
    /// ours lies there that ends in live memory.
    ///
    /// # Safety
    /// `live` is there as long as the value or a [`Walk`](crate::Walk) on it is in use. In
    /// [`EVERYWHERE`](crate::EVERYWHERE), an address other than 0 must be that of a structure.
    #[inline(always)]
    pub unsafe fn at(address: u64, live: &Live) -> Option<Structure> {
        // SAFETY: the caller guarantees that `live` is there as long as the value or a
        // [`Walk`](crate::Walk) on it is in use.
        unsafe { Structure::inside(address, live.bytes_from(address)) }.map(|found| found.0)
    }

    /// The structure at `address`, of which so many bytes are there, and its header.
    ///
    /// # Safety
    /// The bytes are there as long as the structure is in use.
    #[inline(always)]
    pub(crate) unsafe fn inside(address: u64, bytes: u64) -> Option<(Structure, Header)> {
        if bytes < HEADER_BYTES || !address.is_multiple_of(ALIGNMENT) {
            return None;
        }
        // The address of memory of the caller's, which was exposed to get here as an integer.
        let base = std::ptr::with_exposed_provenance::<u8>(address as usize);
        // SAFETY: aligned, and readable by the caller's promise; a header is plain numbers.
        let header = unsafe { base.cast::<Header>().read_volatile() };
        let structure = Structure::of_header(base, &header).ok()?;
        (header.size_bytes <= bytes).then_some((structure, header))
    }

    /// A structure whose header is a copy of what lies at `base`.
    #[inline(always)]
    fn of_header(base: *const u8, header: &Header) -> Result<Structure, StructureError> {
        let (kind, form) = check_header(header)?;
        Ok(Structure {
            base,
            kind,
            form,
            node_count: header.node_count,
            leaf_count: header.leaf_count,
            geometry_count: header.geometry_count,
            features: header.features,
            origin_error: header.origin_error,
            depth: header.depth,
            nodes: base.wrapping_add(header.nodes_offset as usize).cast(),
            leaves: base.wrapping_add(header.leaves_offset as usize),
            references: base.wrapping_add(header.references_offset as usize).cast(),
            geometries: base.wrapping_add(header.geometries_offset as usize).cast(),
            size_bytes: header.size_bytes,
            micromap_bytes: header.micromap_bytes,
        })
    }

    /// Bytes of the first part, which every structure has.
    pub const HEADER_BYTES: u64 = HEADER_BYTES;

    /// No structure: without nodes and leaves.
    pub(crate) const EMPTY: Structure = Structure {
        base: std::ptr::null(),
        kind: Kind::Instances,
        form: Form::Groups,
        node_count: 0,
        leaf_count: 0,
        geometry_count: 0,
        features: 0,
        origin_error: 0.0,
        depth: 0,
        nodes: std::ptr::null(),
        leaves: std::ptr::null(),
        references: std::ptr::null(),
        geometries: std::ptr::null(),
        size_bytes: 0,
        micromap_bytes: 0,
    };

    /// Whether the header in memory still says what its copy says; not of [`Self::EMPTY`].
    #[inline(always)]
    pub(crate) fn is_still(&self, header: &Header) -> bool {
        // SAFETY: a header was found here.
        unsafe { head::is_still(self.base, header) }
    }

    /// The structure that `blob` starts with, with the copy of its header that it is made from.
    ///
    /// # Errors
    /// The error in the header.
    pub(crate) fn of(blob: &[u8]) -> Result<(Structure, Header), StructureError> {
        if blob.len() < HEADER_BYTES as usize {
            return Err(StructureError::Truncated);
        }
        let base = blob.as_ptr();
        base.expose_provenance();
        if !(base as usize).is_multiple_of(ALIGNMENT as usize) {
            return Err(StructureError::NotAStructure);
        }
        // SAFETY: long enough and aligned.
        let header = unsafe { base.cast::<Header>().read_volatile() };
        let structure = Structure::of_header(base, &header)?;
        if header.size_bytes > blob.len() as u64 {
            return Err(StructureError::Truncated);
        }
        check_parts(structure.kind, structure.form, &header)?;
        Ok((structure, header))
    }

    /// The kind of the structure.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Bytes of the blob that are in use: its size after compaction.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
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

    /// The 24 bits that the application gave an instance (`InstanceCustomIndexKHR`), and its offset
    /// into the hit records.
    pub fn instance_indices(&self, instance_index: u32) -> (u32, u32) {
        self.instance_words(instance_index).map_or((0, 0), |words| {
            (
                words.custom_index_and_mask & 0xFF_FFFF,
                words.sbt_offset_and_flags & 0xFF_FFFF,
            )
        })
    }

    /// Number of geometries.
    pub(crate) fn geometry_count(&self) -> u32 {
        self.geometry_count
    }

    /// Bits of [`features`](crate::layout::features).
    #[inline(always)]
    pub(crate) fn features(&self) -> u32 {
        self.features
    }

    /// See [`Header::origin_error`].
    #[inline(always)]
    pub(crate) fn origin_error(&self) -> f32 {
        self.origin_error
    }

    /// Bytes of the part for micromaps, those of its own included; 0 without.
    #[inline(always)]
    pub(crate) fn micromap_bytes(&self) -> u64 {
        self.micromap_bytes
    }

    #[inline(always)]
    pub(crate) fn node_count(&self) -> u32 {
        self.node_count
    }

    /// Where a child lies, if its word is sound.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn child_address(&self, word: u32) -> *const u8 {
        if word & child::LEAF == 0 {
            self.nodes.wrapping_add(word as usize).cast()
        } else {
            let bytes = match self.form {
                Form::Groups => size_of::<TriangleGroup>(),
                Form::Blocks => BLOCK_UNIT,
            };
            let offset = (word & child::INDEX) as usize * bytes;
            self.leaves.wrapping_add(offset)
        }
    }

    #[inline(always)]
    pub(crate) fn node(&self, index: u32) -> Option<NodeAt<'_>> {
        // SAFETY: below the count.
        (index < self.node_count).then(|| unsafe { self.node_at(index) })
    }

    /// # Safety
    /// The index is below [`Self::node_count`].
    #[inline(always)]
    pub(crate) unsafe fn node_at(&self, index: u32) -> NodeAt<'_> {
        // SAFETY: inside the part; parts are aligned to 256 bytes.
        unsafe { NodeAt::new(self.nodes.add(index as usize)) }
    }

    #[inline(always)]
    pub(crate) fn group(&self, index: u32) -> Option<&TriangleGroup> {
        (self.kind == Kind::Triangles && self.form == Form::Groups && index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes.
            .then(|| unsafe { &*self.leaves.cast::<TriangleGroup>().add(index as usize) })
    }

    /// The block whose first unit has this index.
    #[inline(always)]
    pub(crate) fn block(&self, index: u32) -> Option<&Block> {
        let is_inside = self.leaf_count >= BLOCK_UNITS && index <= self.leaf_count - BLOCK_UNITS;
        (self.kind == Kind::Triangles && self.form == Form::Blocks && is_inside)
            // SAFETY: room for the largest block is inside the part; parts are aligned to 256
            // bytes, units to 16.
            .then(|| unsafe { &*self.leaves.add(index as usize * BLOCK_UNIT).cast::<Block>() })
    }

    /// The first of the groups of a structure of triangles, and how many there are; none of blocks.
    #[inline(always)]
    pub(crate) fn groups(&self) -> (*const TriangleGroup, u32) {
        match (self.kind, self.form) {
            (Kind::Triangles, Form::Groups) => (self.leaves.cast(), self.leaf_count),
            _ => (self.leaves.cast(), 0),
        }
    }

    /// The groups of a leaf of triangles, the same twice if there is one, and which of their lanes
    /// hold one. A block's are written to `room` by `expand`, as [`Block::expand`]. `None` for what
    /// a corrupt node takes for a leaf.
    #[inline(always)]
    pub(crate) fn leaf_groups<'a>(
        &'a self,
        word: u32,
        room: &'a mut Option<[TriangleGroup; 2]>,
        expand: impl FnOnce(&Block, [&mut TriangleGroup; 2]) -> u32,
    ) -> Option<([&'a TriangleGroup; 2], u32)> {
        let index = word & child::INDEX;
        if self.form == Form::Blocks {
            let block = self.block(index)?;
            let [first, last] = room.get_or_insert([TriangleGroup::EMPTY; 2]);
            let lanes = expand(block, [&mut *first, &mut *last]);
            return Some(([first, last], lanes));
        }
        let two = word & child::TWO_GROUPS != 0;
        let last = index + u32::from(two);
        let (groups, group_count) = self.groups();
        if last >= group_count {
            return None;
        }
        // SAFETY: below the count, so inside the part; parts are aligned.
        let [first, last] = unsafe { [&*groups.add(index as usize), &*groups.add(last as usize)] };
        let others = if two { last.lanes & 0xF } else { 0 };
        Some(([first, last], first.lanes & 0xF | others << GROUP))
    }

    /// How the leaves of triangles are written.
    #[inline(always)]
    pub(crate) fn form(&self) -> Form {
        self.form
    }

    /// The slot of the first triangle of a leaf; see [`Hit::slot`]. The index that a corrupt node
    /// has may wrap: there are no triangles.
    #[inline(always)]
    pub(crate) fn first_slot(&self, index: u32) -> u32 {
        match self.form {
            Form::Groups => index.wrapping_mul(GROUP as u32),
            Form::Blocks => index.wrapping_mul(LEAF_TRIANGLES as u32),
        }
    }

    /// Geometry and primitive of the triangle in a slot.
    #[inline(always)]
    pub(crate) fn identity(&self, slot: u32) -> (u32, u32) {
        let found = match self.form {
            Form::Groups => self.group(slot / GROUP as u32).map(|group| {
                let lane = slot as usize % GROUP;
                (group.geometries[lane], group.primitives[lane])
            }),
            Form::Blocks => self.block(slot / LEAF_TRIANGLES as u32).map(|block| {
                let lane = slot as usize % LEAF_TRIANGLES;
                (block.geometry(lane), block.primitive(lane))
            }),
        };
        found.map_or((0, 0), |(geometry, primitive)| {
            (geometry & geometry_word::INDEX, primitive)
        })
    }

    #[inline(always)]
    pub(crate) fn box_entry(&self, index: u32) -> Option<BoxEntry> {
        (self.kind == Kind::Aabbs).then(|| self.leaf(index))?
    }

    #[inline(always)]
    pub(crate) fn swept_entry(&self, index: u32) -> Option<SweptEntry> {
        (self.kind == Kind::Swept).then(|| self.leaf(index))?
    }

    /// A copy of a leaf of this type, which is that of the structure's leaves.
    #[inline(always)]
    fn leaf<T: Copy>(&self, index: u32) -> Option<T> {
        debug_assert_eq!(size_of::<T>() as u64, leaf_bytes(self.kind, self.form));
        (index < self.leaf_count)
            // SAFETY: below the count, so inside the part; parts are aligned to 256 bytes. All are
            // plain numbers.
            .then(|| unsafe { self.leaves.cast::<T>().add(index as usize).read_volatile() })
    }

    /// Where the record of an instance lies. Those that may move begin with what the others are.
    #[inline(always)]
    fn instance_at(&self, index: u32) -> Option<*const InstanceRecord> {
        (self.kind.is_top() && index < self.leaf_count).then(|| {
            let offset = index as usize * leaf_bytes(self.kind, Form::Groups) as usize;
            // SAFETY: below the count, so inside the part.
            unsafe { self.leaves.add(offset).cast() }
        })
    }

    /// A copy of the record of an instance.
    #[inline(always)]
    pub(crate) fn instance(&self, index: u32) -> Option<InstanceRecord> {
        // SAFETY: inside the part; parts are aligned to 256 bytes.
        (self.instance_at(index)).map(|record| unsafe { record.read() })
    }

    /// The data of an instance's record besides its transform.
    #[inline(always)]
    pub(crate) fn instance_words(&self, index: u32) -> Option<InstanceWords> {
        // SAFETY: inside the part; parts are aligned to 256 bytes.
        (self.instance_at(index))
            .map(|record| unsafe { (&raw const (*record).words).read_volatile() })
    }

    pub(crate) fn motion_entry(&self, index: u32) -> Option<MotionEntry> {
        (self.kind == Kind::Motion).then(|| self.leaf(index))?
    }

    /// How an instance moves.
    pub(crate) fn motion(&self, index: u32) -> Option<Motion> {
        (self.kind == Kind::MotionInstances)
            .then(|| self.leaf::<MotionInstanceRecord>(index))?
            .map(|record| record.motion)
    }

    /// Transform and inverse of an instance at a time in [0, 1]; `None` where it has no inverse
    /// then.
    pub(crate) fn transforms(&self, index: u32, time: f32) -> Option<Transforms> {
        let record = self.instance(index)?;
        if record.words.state & instance_state::MOVING == 0 {
            return Some((record.object_to_world, record.world_to_object));
        }
        let object_to_world = transform_at(&self.motion(index)?, time);
        let world_to_object = invert(&object_to_world)?.0;
        Some((object_to_world, world_to_object))
    }

    /// The address in an instance's entry of the reference table; 0 where there is none.
    #[inline(always)]
    pub(crate) fn reference(&self, index: u32) -> u64 {
        if !self.kind.is_top() || index >= self.leaf_count {
            return 0;
        }
        // SAFETY: below the count, so inside the table; parts are aligned.
        unsafe { self.references.add(index as usize).read_volatile() }
    }

    pub(crate) fn geometry(&self, index: u32) -> Option<GeometryEntry> {
        (index < self.geometry_count)
            // SAFETY: below the count, so inside the table; parts are aligned.
            .then(|| unsafe { self.geometries.add(index as usize).read_volatile() })
    }
}
