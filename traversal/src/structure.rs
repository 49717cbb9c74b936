//! The blob: what lies where in an acceleration structure.

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

/// A structure at an address, to be read.
#[derive(Clone, Copy, Debug)]
pub struct Structure {
    address: u64,
}

impl Structure {
    /// The structure at `address`; `None` if the address is 0, not aligned, or no structure of
    /// ours lies there.
    ///
    /// # Safety
    /// An `address` other than 0 must be readable as far as the blob's header says, and must not
    /// be written while the value or a [`Walk`](crate::Walk) on it is in use.
    pub unsafe fn at(address: u64) -> Option<Structure> {
        unimplemented!("{address}")
    }

    /// What it holds.
    pub fn kind(&self) -> Kind {
        unimplemented!()
    }

    /// Bytes of the blob that are in use: its size after compaction.
    pub fn size_bytes(&self) -> u64 {
        self.address
    }

    /// Number of entries in the table of bottom-level references: the instances, including
    /// inactive ones; 0 for a bottom level.
    pub fn reference_count(&self) -> u64 {
        unimplemented!()
    }

    /// Row-major 3 × 4 matrix of an instance: `ObjectToWorldKHR`, transposed.
    pub fn object_to_world(&self, instance_index: u32) -> [f32; 12] {
        unimplemented!("{instance_index}")
    }

    /// Row-major 3 × 4 inverse of [`Self::object_to_world`].
    pub fn world_to_object(&self, instance_index: u32) -> [f32; 12] {
        unimplemented!("{instance_index}")
    }

    /// The object-space positions of a hit triangle's vertices, in order, after the geometry's
    /// transform. `self` is the top level; zeros for what is no triangle.
    pub fn triangle_vertices(&self, hit: &crate::Hit) -> [[f32; 3]; 3] {
        unimplemented!("{hit:?}")
    }
}

/// Checks everything that a walk relies on, except that references of instances are alive.
///
/// # Errors
/// What is wrong first.
pub fn validate(blob: &[u8]) -> Result<(), StructureError> {
    unimplemented!("{}", blob.len())
}
