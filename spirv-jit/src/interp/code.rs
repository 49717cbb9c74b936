//! The tables that instructions refer to.

use images::ImageOp;

use super::operand::Operand;
use crate::ir::op::{AtomicOp, MatrixProduct, SubgroupOp, VectorProduct};
use crate::ir::{Space, Type};
use crate::plan::Live;
use crate::printf::Message;
use crate::state::SiteId;

/// A memory access: its address operands come first at `operands`, then the scalars.
#[derive(Clone, Copy)]
pub(super) struct AccessPlan {
    pub space: Space,
    pub ty: Type,
    /// As [`Access`](crate::ir::op::Access) has it.
    pub alignment: u8,
    /// From one scalar to the next, in bytes; none where they are consecutive.
    pub stride: Operand,
    /// First of the operands: address, then results (load) or values (store).
    pub operands: u32,
    pub scalars: u32,
}

/// An atomic: address operands, value operands, result.
#[derive(Clone, Copy)]
pub(super) struct AtomicPlan {
    pub op: AtomicOp,
    pub space: Space,
    pub operands: u32,
}

/// A subgroup operation.
#[derive(Clone, Copy)]
pub(super) struct SubgroupPlan {
    pub op: SubgroupOp,
    /// Helper invocations take part like all others.
    pub with_helpers: bool,
}

/// A product of matrices: the rows of the factors, of the third matrix, and of the results.
#[derive(Clone, Copy)]
pub(super) struct ProductPlan {
    pub product: MatrixProduct,
    /// First of the operands.
    pub operands: u32,
}

/// A product of a matrix in memory and a vector: its operands are the address, the stride, the
/// vector, the added sums if there are any, and the results.
#[derive(Clone, Copy)]
pub(super) struct VectorPlan {
    pub product: VectorProduct,
    pub space: Space,
    /// First of the operands.
    pub operands: u32,
    pub rows: u32,
    pub columns: u32,
}

/// An image operation: descriptor operands, then the rest with their types, then results.
pub(super) struct ImagePlan {
    pub op: ImageOp,
    pub image: Operand,
    pub sampler: Operand,
    /// A sample at the derivatives of its coordinates, which it finds by itself: the coordinates
    /// stand in their place, too.
    pub derives: bool,
    /// With whether they are of 64 bits.
    pub operands: Vec<(Operand, bool)>,
    pub results: Vec<(Operand, bool)>,
    /// A bit per result that is used.
    pub wanted: u8,
}

/// The origin of descriptors.
#[derive(Clone, Copy)]
pub(super) enum DescriptorSource {
    /// Of an index, in a binding of the program's.
    Binding(u32),
    /// Of a reference.
    Reference,
}

/// A vector row of descriptors that is made again instead of being saved.
#[derive(Clone, Copy)]
pub(super) struct Remade {
    pub to: Operand,
    pub source: DescriptorSource,
    /// A row that is saved.
    pub from: Operand,
}

/// A vector row that a state holds: what the plan says of the value, with its operand beside it,
/// since states are saved and restored often.
#[derive(Clone, Copy)]
pub(super) struct Saved {
    pub operand: Operand,
    /// Row of the state.
    pub row: u32,
    /// 64 bits: two rows of the state.
    pub wide: bool,
}

/// The code at which a wave resumes after a save point, with the plan's data about the point.
pub(super) struct ResumeTarget {
    pub pc: u32,
    pub function: u32,
    pub masks: u32,
    pub site: Option<SiteId>,
    /// Operands of the site that are uniform in a dispatch, a bit each.
    pub uniform_operands: u16,
    pub live: Live,
}

/// An access through a physical pointer.
pub(super) struct PhysicalAccess {
    /// Behind its instruction.
    pub pc: u32,
    /// Word offset of the SPIR-V instruction.
    pub source: u32,
    pub writes: bool,
}

/// A loop of native code.
pub(super) struct LoopPlan {
    /// Mask of its label, and of the one that lanes leave it to.
    pub label: u32,
    pub left_to: u32,
    /// Subgroups that take it together, and where the code of the others' is: so many bytes behind
    /// the code of those.
    pub together: usize,
    pub single: usize,
    /// Parameters that are the same in all subgroups that take it together, and which of those have
    /// 64 bits.
    pub shared: Vec<(Operand, bool)>,
    /// Memory that it loads from or, where that is said, stores to: descriptors that are uniform.
    pub regions: Vec<(Operand, bool)>,
    /// Code accesses memory of a subgroup's own.
    pub takes_own: bool,
}

/// Where a wave goes on after a call.
pub(super) struct Return {
    pub pc: u32,
    pub live: Live,
}

/// A message of a shader.
pub(crate) struct PrintPlan {
    pub message: Message,
    /// Word offset of the SPIR-V instruction.
    pub source: u32,
    /// Messages of fragments come after those of their vertices; other stages share launches.
    pub rank: u32,
    /// Words of the invocation's key, the first operands.
    pub key_words: usize,
    /// First of the operands.
    pub(super) operands: usize,
    pub(super) count: usize,
}
