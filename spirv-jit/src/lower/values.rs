//! The meaning of a SPIR-V id during lowering: scalars, or a pointer whose location is known at
//! compile time.

use std::rc::Rc;

use smallvec::SmallVec;

use crate::descriptor_heap::Table;
use crate::ir::op::DescriptorBinding;
use crate::ir::{Value, VariableId};
use crate::parse::Id;

/// An id's value.
#[derive(Clone, Debug)]
pub(super) enum Val {
    /// The scalars of a value in the order of [`super::types::Types::leaves`].
    Scalars(Scalars),
    Pointer(Pointer),
    /// A value too large to take apart, in memory that is written once (see [`super::large`]).
    Kept(Pointer),
}

/// The scalars of a value: a few in place, many shared.
#[derive(Clone, Debug)]
pub(super) enum Scalars {
    Few([Value; Self::FEW], u8),
    Many(Rc<[Value]>),
}

impl Scalars {
    const FEW: usize = 4;
}

impl std::ops::Deref for Scalars {
    type Target = [Value];

    fn deref(&self) -> &[Value] {
        match self {
            Self::Few(values, count) => &values[..usize::from(*count)],
            Self::Many(values) => values,
        }
    }
}

impl From<&[Value]> for Scalars {
    fn from(values: &[Value]) -> Self {
        if values.len() > Self::FEW {
            return Self::Many(values.into());
        }
        let mut few = [Value(0); Self::FEW];
        few[..values.len()].copy_from_slice(values);
        Self::Few(few, values.len() as u8)
    }
}

impl FromIterator<Value> for Scalars {
    fn from_iter<I: IntoIterator<Item = Value>>(values: I) -> Self {
        Self::from(&values.into_iter().collect::<SmallVec<[Value; 4]>>()[..])
    }
}

/// The strides of a matrix's or vector's scalars in memory; 0 means tightly packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Shape {
    pub matrix_stride: u32,
    pub row_major: bool,
    /// Distance between the components of a vector that is a column of a row-major matrix.
    pub component_stride: u32,
}

/// A logical or physical pointer.
#[derive(Clone, Debug)]
pub(super) struct Pointer {
    pub pointee: Id,
    pub place: MemoryLocation,
    pub shape: Shape,
    pub volatile: bool,
    /// The pointee is in a uniform block; see
    /// [`Access::constant`](crate::ir::op::Access::constant).
    pub constant: bool,
    /// log₂ of the alignment, if it is checked.
    pub alignment: u8,
    /// The pointee is in a storage buffer of a shader with 64-bit indexing.
    pub is_wide: bool,
}

#[derive(Clone, Debug)]
pub(super) enum MemoryLocation {
    /// A fixed row of per-lane memory of this function.
    Local { local: usize, row: u32 },
    /// Per-lane memory at a computed row.
    Private { row: Value, constant: u32 },
    /// Workgroup memory.
    Shared {
        offset: Option<Value>,
        constant: u32,
    },
    /// The range of a buffer descriptor.
    Buffer {
        reference: Value,
        offset: Option<Value>,
        constant: u32,
    },
    /// The range of a storage buffer in a shader with 64-bit indexing, whose offsets are i64.
    Buffer64 {
        reference: Value,
        offset: Option<Value>,
        constant: u64,
    },
    /// A device address.
    Global { address: Value, constant: u64 },
    /// A descriptor, or an array of them: `index * 1 + constant` counts in the binding, or in the
    /// mapping.
    Handle {
        binding: Handles,
        index: Option<Value>,
        constant: u32,
    },
    /// A descriptor by its reference.
    Descriptor(Value),
    /// Bytes of a descriptor heap.
    Heap {
        table: Table,
        offset: Option<Value>,
        constant: u32,
    },
    /// An input, from a row of its value: a fixed part and a computed part.
    Input {
        variable: Id,
        row: u32,
        index: Option<Value>,
    },
    /// A texel of an image (`OpImageTexelPointer`): image id's type, reference, coordinates,
    /// sample.
    Texel {
        image_type: Id,
        image: Value,
        coordinate: SmallVec<[Value; 4]>,
        sample: Value,
    },
}

/// The location of a variable's descriptors.
#[derive(Clone, Copy, Debug)]
pub(super) enum Handles {
    Bound(DescriptorBinding),
    /// An index in the request's mappings.
    Mapped(usize),
}

/// Per-lane memory: one IR variable, or several where a structure is split.
#[derive(Clone, Debug)]
pub(super) struct Local {
    /// First row and variable of each part, ascending.
    pub parts: Vec<(u32, VariableId)>,
}

impl Local {
    /// The variable that holds a row, and the row in it.
    pub fn find(&self, row: u32) -> (VariableId, u32) {
        let after = self.parts.partition_point(|part| part.0 <= row);
        let (first, variable) = self.parts[after.max(1) - 1];
        (variable, row - first)
    }
}

impl Pointer {
    pub fn new(pointee: Id, place: MemoryLocation) -> Self {
        Self {
            pointee,
            place,
            shape: Shape::default(),
            volatile: false,
            constant: false,
            alignment: 0,
            is_wide: false,
        }
    }

    /// The same location with another type.
    pub fn retyped(self, pointee: Id) -> Self {
        if self.pointee == pointee {
            return self;
        }
        Self {
            pointee,
            shape: Shape::default(),
            ..self
        }
    }

    /// The computed parts of the location, which must be kept if the pointer outlives its body.
    pub fn values(&self) -> SmallVec<[Value; 8]> {
        match &self.place {
            MemoryLocation::Local { .. } => SmallVec::new(),
            MemoryLocation::Input { index, .. } => index.iter().copied().collect(),
            MemoryLocation::Private { row, .. } => SmallVec::from_slice(&[*row]),
            MemoryLocation::Shared { offset, .. } | MemoryLocation::Heap { offset, .. } => {
                offset.iter().copied().collect()
            }
            MemoryLocation::Buffer {
                reference, offset, ..
            }
            | MemoryLocation::Buffer64 {
                reference, offset, ..
            } => [*reference].into_iter().chain(*offset).collect(),
            MemoryLocation::Global { address, .. } => SmallVec::from_slice(&[*address]),
            MemoryLocation::Handle { index, .. } => index.iter().copied().collect(),
            MemoryLocation::Descriptor(reference) => SmallVec::from_slice(&[*reference]),
            MemoryLocation::Texel {
                image,
                coordinate,
                sample,
                ..
            } => {
                let ends = [*image, *sample];
                ends.into_iter().chain(coordinate.iter().copied()).collect()
            }
        }
    }

    /// The pointer with other computed parts, in the order of [`Self::values`].
    pub fn with_values(&self, values: &[Value]) -> Self {
        let mut out = self.clone();
        let mut next = values.iter().copied();
        let mut take = |slot: &mut Value| {
            if let Some(value) = next.next() {
                *slot = value;
            }
        };
        match &mut out.place {
            MemoryLocation::Local { .. } => {}
            MemoryLocation::Input { index, .. } => index.iter_mut().for_each(take),
            MemoryLocation::Private { row, .. } => take(row),
            MemoryLocation::Shared { offset, .. } | MemoryLocation::Heap { offset, .. } => {
                offset.iter_mut().for_each(take);
            }
            MemoryLocation::Buffer {
                reference, offset, ..
            }
            | MemoryLocation::Buffer64 {
                reference, offset, ..
            } => {
                take(reference);
                offset.iter_mut().for_each(take);
            }
            MemoryLocation::Global { address, .. } => take(address),
            MemoryLocation::Handle { index, .. } => index.iter_mut().for_each(take),
            MemoryLocation::Descriptor(reference) => take(reference),
            MemoryLocation::Texel {
                image,
                coordinate,
                sample,
                ..
            } => {
                take(image);
                take(sample);
                coordinate.iter_mut().for_each(take);
            }
        }
        out
    }
}

/// A value of scalars that an instruction has computed.
pub(super) type Values = SmallVec<[Value; 4]>;
