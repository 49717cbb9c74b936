//! SPIR-V types: the parts of each, and the scalars of its values.

mod measure;

use std::rc::Rc;

use rspirv::spirv::{self, Op, StorageClass};

use super::id_table::IdTable;
use crate::Error;
use crate::hit_object::word;
use crate::ir::Type;
use crate::ir::op::MatrixProduct;
use crate::parse::{Annotations, Id, Instruction, ParsedModule, opcode_name};

/// Rows of private memory that one invocation may have.
pub(super) const MAX_ROWS: u64 = 1 << 18;

/// The error for a module that needs more.
pub(super) fn too_many_rows() -> Error {
    super::budget(&format!(
        "the shader's variables and large values take more than {MAX_ROWS} words of an invocation"
    ))
}

/// Words of a location of a stage's interface.
pub(super) const LOCATION_WORDS: u32 = 4;

/// The pointee of pointers that have none (`OpTypeUntypedPointerKHR`): no type has this id.
pub(super) const UNTYPED: Id = 0;

/// Components of a vector (`maxVectorComponents`), with the capability `LongVectorEXT`.
pub const MAX_COMPONENTS: u32 = 1024;

/// Components of a vector without it.
pub(super) const FEW_COMPONENTS: u32 = 4;

/// Largest number of scalars of a value that is taken apart. Larger values are in memory (see
/// [`super::large`]).
pub(super) const MAX_LEAVES: u64 = 1 << 14;

/// `OpTypeImage`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ImageType {
    pub sampled_type: Id,
    pub dim: spirv::Dim,
    pub arrayed: bool,
    pub multisampled: bool,
    /// 1: used with a sampler, 2: storage.
    pub sampled: u32,
    pub format: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum TypeKind {
    Void,
    Scalar {
        ty: Type,
        signed: bool,
        /// A float of the encoding `BFloat16KHR`: values hold its bits.
        is_bfloat16: bool,
    },
    /// A matrix of a subgroup, of 16 rows and columns: a value is a row, with a column in each
    /// lane.
    CooperativeMatrix {
        component: Id,
    },
    Vector {
        component: Id,
        count: u32,
    },
    Matrix {
        column: Id,
        count: u32,
    },
    Array {
        element: Id,
        count: u32,
    },
    RuntimeArray {
        element: Id,
    },
    Struct {
        members: Rc<[Id]>,
    },
    Pointer {
        class: StorageClass,
        pointee: Id,
    },
    Image(ImageType),
    Sampler,
    SampledImage {
        image: Id,
    },
    AccelerationStructure,
    /// `OpTypeBufferEXT`: a buffer's descriptor in a heap.
    Buffer,
    RayQuery,
    /// See [`crate::hit_object`].
    HitObject,
    Function {
        result: Id,
        params: Rc<[Id]>,
    },
}

/// A type and the facts that follow from it.
#[derive(Clone, Debug)]
pub(super) struct TypeInfo {
    pub kind: TypeKind,
    /// Scalars in a value, saturated; runtime arrays have none.
    pub leaf_count: u64,
    /// Rows of private memory, saturated.
    pub rows: u64,
    /// Images, samplers and pointers through descriptors: their values are references, which no
    /// other value may become.
    pub is_opaque: bool,
    /// Components of the longest vector in a value.
    pub components: u32,
    /// Locations of a stage's interface that a value takes, saturated.
    pub locations: u32,
    /// Size and alignment in memory without decorations, each scalar aligned to its size; `None`
    /// for types without a memory form.
    pub natural: Option<(u64, u64)>,
    /// The same without `ArrayStride`, for workgroup memory that the compiler lays out.
    pub packed: Option<(u64, u64)>,
}

/// All types of a module.
#[derive(Default)]
pub(super) struct Types {
    infos: IdTable<TypeInfo>,
    /// Rows of a ray query's object.
    pub query_rows: u64,
    /// Offsets in storage buffers have 64 bits (`Shader64BitIndexingEXT`).
    pub has_wide_offsets: bool,
    /// Smallest and largest number of components of vectors.
    pub components: [u32; 2],
    longest_vector: u32,
    leaves: std::cell::RefCell<IdTable<Rc<[Type]>>>,
}

impl Types {
    /// The type with an id.
    pub fn info(&self, id: Id) -> Result<&TypeInfo, Error> {
        self.infos
            .get(id)
            .ok_or_else(|| Error::invalid(0, format!("id {id} is not a type")))
    }

    /// Components of the longest vector of the module.
    pub fn longest_vector(&self) -> u32 {
        self.longest_vector
    }

    /// Whether a value contains vectors of more than four components.
    pub fn is_long(&self, id: Id) -> bool {
        (self.infos.get(id)).is_some_and(|info| info.components > FEW_COMPONENTS)
    }

    /// The value form of a logical pointer: in a phi, a selection, or a call that is not inlined.
    pub fn pointer_leaves(&self, class: StorageClass) -> &'static [Type] {
        match class {
            StorageClass::PhysicalStorageBuffer | StorageClass::ShaderRecordBufferKHR => {
                &[Type::I64]
            }
            StorageClass::Uniform | StorageClass::StorageBuffer | StorageClass::PushConstant => {
                match self.has_wide_offsets {
                    true => &[Type::I64, Type::I64],
                    false => &[Type::I64, Type::I32],
                }
            }
            StorageClass::UniformConstant => &[Type::I64],
            _ => &[Type::I32],
        }
    }

    /// The scalars of a value of a type; empty for unknown types.
    pub fn leaf_count(&self, id: Id) -> u64 {
        self.infos.get(id).map_or(0, |info| info.leaf_count)
    }

    pub fn kind(&self, id: Id) -> Result<&TypeKind, Error> {
        Ok(&self.info(id)?.kind)
    }

    /// The scalar type with an id.
    pub fn scalar(&self, id: Id) -> Result<Type, Error> {
        match self.kind(id)? {
            TypeKind::Scalar { ty, .. } => Ok(*ty),
            _ => Err(Error::invalid(0, format!("type {id} is not a scalar"))),
        }
    }

    /// The type of the scalars of a scalar, vector or matrix.
    pub fn component(&self, id: Id) -> Result<Type, Error> {
        match *self.kind(id)? {
            TypeKind::Vector { component, .. } | TypeKind::CooperativeMatrix { component } => {
                self.scalar(component)
            }
            TypeKind::Matrix { column, .. } => self.component(column),
            _ => self.scalar(id),
        }
    }

    /// Whether the scalars of a scalar or vector are signed integers.
    pub fn is_signed(&self, id: Id) -> bool {
        match self.kind(id) {
            Ok(TypeKind::Scalar { signed, .. }) => *signed,
            Ok(
                &TypeKind::Vector { component, .. } | &TypeKind::CooperativeMatrix { component },
            ) => self.is_signed(component),
            _ => false,
        }
    }

    /// Whether the scalars of a scalar, vector or cooperative matrix are of the encoding
    /// `BFloat16KHR`.
    pub fn is_bfloat16(&self, id: Id) -> bool {
        match self.kind(id) {
            Ok(TypeKind::Scalar { is_bfloat16, .. }) => *is_bfloat16,
            Ok(
                &TypeKind::Vector { component, .. } | &TypeKind::CooperativeMatrix { component },
            ) => self.is_bfloat16(component),
            _ => false,
        }
    }

    /// Storage class and pointee ([`UNTYPED`] if it has none) of a pointer type.
    pub fn pointer(&self, id: Id) -> Result<(StorageClass, Id), Error> {
        match *self.kind(id)? {
            TypeKind::Pointer { class, pointee } => Ok((class, pointee)),
            _ => Err(Error::invalid(0, format!("type {id} is not a pointer"))),
        }
    }

    /// The element type that an index selects from a composite; structures need the member.
    pub fn element(&self, id: Id, member: Option<u32>) -> Result<Id, Error> {
        match self.kind(id)? {
            TypeKind::Vector { component, .. } | TypeKind::CooperativeMatrix { component } => {
                Ok(*component)
            }
            TypeKind::Matrix { column, .. } => Ok(*column),
            TypeKind::Array { element, .. } | TypeKind::RuntimeArray { element } => Ok(*element),
            TypeKind::Struct { members } => member
                .and_then(|member| members.get(member as usize).copied())
                .ok_or_else(|| Error::invalid(0, "structure member index out of range")),
            _ => Err(Error::invalid(0, format!("type {id} is not a composite"))),
        }
    }

    /// Elements of a composite: components, columns, array elements or members.
    pub fn element_count(&self, id: Id) -> Result<u32, Error> {
        match self.kind(id)? {
            TypeKind::Vector { count, .. }
            | TypeKind::Matrix { count, .. }
            | TypeKind::Array { count, .. } => Ok(*count),
            TypeKind::Struct { members } => Ok(members.len() as u32),
            TypeKind::CooperativeMatrix { .. } => Ok(MatrixProduct::SIZE as u32),
            _ => Err(Error::invalid(0, format!("type {id} has no elements"))),
        }
    }

    /// Scalars before an element of a composite.
    pub fn leaf_offset(&self, id: Id, index: u32) -> Result<u64, Error> {
        self.offset_by(id, index, |info| info.leaf_count)
    }

    /// Follows literal indices into a composite: scalars before the part, and its type.
    pub fn path(&self, mut id: Id, indices: &[u32]) -> Result<(usize, Id), Error> {
        let mut first = 0u64;
        for &index in indices {
            if index >= self.element_count(id)? {
                return Err(Error::invalid(0, "composite index out of range"));
            }
            first += self.leaf_offset(id, index)?;
            id = self.element(id, Some(index))?;
        }
        Ok((first as usize, id))
    }

    /// Rows of private memory before an element of a composite.
    pub fn row_offset(&self, id: Id, index: u32) -> Result<u64, Error> {
        self.offset_by(id, index, |info| info.rows)
    }

    fn offset_by(&self, id: Id, index: u32, size: fn(&TypeInfo) -> u64) -> Result<u64, Error> {
        match self.kind(id)? {
            TypeKind::Struct { members } => members
                .iter()
                .take(index as usize)
                .try_fold(0u64, |sum, &member| {
                    Ok(sum.saturating_add(size(self.info(member)?)))
                }),
            _ => {
                let element = self.element(id, None)?;
                Ok(size(self.info(element)?).saturating_mul(index as u64))
            }
        }
    }

    /// The scalars of a value of this type, in order. Images and samplers are references to
    /// descriptors, logical pointers what [`Self::pointer_leaves`] says.
    pub fn leaves(&self, id: Id) -> Result<Rc<[Type]>, Error> {
        if let Some(found) = self.leaves.borrow().get(id) {
            return Ok(found.clone());
        }
        let info = self.info(id)?;
        if info.leaf_count > MAX_LEAVES {
            return Err(super::budget(&format!(
                "a value of more than {MAX_LEAVES} scalars cannot be taken apart here"
            )));
        }
        let out: Rc<[Type]> = self.find_leaves(id)?.into();
        self.leaves.borrow_mut().insert(id, out.clone());
        Ok(out)
    }

    /// The scalars of a type up to the size of a frame.
    pub fn leaves_of_any(&self, id: Id) -> Result<Rc<[Type]>, Error> {
        let info = self.info(id)?;
        if info.leaf_count <= MAX_LEAVES {
            return self.leaves(id);
        }
        if info.rows > MAX_ROWS {
            return Err(too_many_rows());
        }
        Ok(self.find_leaves(id)?.into())
    }

    fn find_leaves(&self, id: Id) -> Result<Vec<Type>, Error> {
        /// The remaining work, last first.
        enum Work {
            Type(Id),
            /// The contents from an index on, with remaining repetitions.
            Repeat(usize, u32),
        }
        let mut out = Vec::new();
        let mut work = vec![Work::Type(id)];
        while let Some(next) = work.pop() {
            let id = match next {
                Work::Type(id) => id,
                Work::Repeat(from, times) => {
                    let length = out.len() - from;
                    out.reserve(length * times as usize);
                    (0..times).for_each(|_| out.extend_from_within(from..from + length));
                    continue;
                }
            };
            let info = self.info(id)?;
            match &info.kind {
                TypeKind::RuntimeArray { .. } | TypeKind::Function { .. } => {
                    return Err(Error::invalid(0, "a value cannot have this type"));
                }
                _ if info.leaf_count == 0 => {}
                TypeKind::Void => {}
                TypeKind::Scalar { ty, .. } => out.push(*ty),
                TypeKind::CooperativeMatrix { component } => {
                    out.extend([self.scalar(*component)?; MatrixProduct::SIZE]);
                }
                TypeKind::Vector {
                    component: element,
                    count,
                }
                | TypeKind::Matrix {
                    column: element,
                    count,
                }
                | TypeKind::Array { element, count } => {
                    work.push(Work::Repeat(out.len(), count.saturating_sub(1)));
                    work.push(Work::Type(*element));
                }
                TypeKind::Struct { members } => {
                    work.extend(members.iter().rev().map(|&member| Work::Type(member)));
                }
                TypeKind::Pointer { class, .. } => {
                    out.extend_from_slice(self.pointer_leaves(*class))
                }
                TypeKind::Image(_)
                | TypeKind::Sampler
                | TypeKind::AccelerationStructure
                | TypeKind::Buffer => out.push(Type::I64),
                TypeKind::SampledImage { .. } => out.extend([Type::I64, Type::I64]),
                TypeKind::HitObject => out.extend((0..word::COUNT).map(word::ty)),
                TypeKind::RayQuery => out.extend((0..self.query_rows).map(|_| Type::I32)),
            }
        }
        Ok(out)
    }

    /// Adds the type that an instruction declares. `sizes` are its constant operands: the length of
    /// an array or a vector, or scope, rows, columns and use of a cooperative matrix.
    pub fn declare(
        &mut self,
        module: &ParsedModule,
        instruction: &Instruction,
        sizes: &[u32],
    ) -> Result<(), Error> {
        let at = instruction.offset;
        let kind = declared_kind(module.operands(instruction), instruction, sizes)?;
        let info = self.measure(at, instruction.result, kind, &module.annotations)?;
        self.longest_vector = self.longest_vector.max(info.components);
        self.infos.insert(instruction.result, info);
        Ok(())
    }

    /// Announces a pointer type whose pointee comes later (`OpTypeForwardPointer`).
    pub fn declare_forward(&mut self, id: Id, class: u32, at: u32) -> Result<(), Error> {
        let kind = TypeKind::Pointer {
            class: storage_class(at, class)?,
            pointee: UNTYPED,
        };
        let info = self.measure(at, id, kind, &Annotations::default())?;
        self.infos.insert(id, info);
        Ok(())
    }
}

/// The type that an instruction declares. See [`Types::declare`] for `sizes`.
fn declared_kind(
    operands: &[u32],
    instruction: &Instruction,
    sizes: &[u32],
) -> Result<TypeKind, Error> {
    let operand = |index: usize| operands.get(index).copied().unwrap_or(0);
    let at = instruction.offset;
    Ok(match instruction.opcode {
        Op::TypeVoid => TypeKind::Void,
        Op::TypeBool => scalar(Type::I1, false),
        Op::TypeInt => scalar(int_type(at, operand(0))?, operand(1) != 0),
        Op::TypeFloat if operands == BFLOAT16 => TypeKind::Scalar {
            ty: Type::I16,
            signed: true,
            is_bfloat16: true,
        },
        Op::TypeFloat => scalar(float_type(at, operands)?, true),
        Op::TypeCooperativeMatrixKHR => {
            cooperative_matrix(at, sizes)?;
            TypeKind::CooperativeMatrix {
                component: operand(0),
            }
        }
        Op::TypeVector => TypeKind::Vector {
            component: operand(0),
            count: operand(1),
        },
        Op::TypeVectorIdEXT => TypeKind::Vector {
            component: operand(0),
            count: sizes.first().copied().unwrap_or(0),
        },
        Op::TypeMatrix => TypeKind::Matrix {
            column: operand(0),
            count: operand(1),
        },
        Op::TypeArray => TypeKind::Array {
            element: operand(0),
            count: sizes.first().copied().unwrap_or(0),
        },
        Op::TypeRuntimeArray => TypeKind::RuntimeArray {
            element: operand(0),
        },
        Op::TypeStruct => TypeKind::Struct {
            members: operands.into(),
        },
        Op::TypePointer => TypeKind::Pointer {
            class: storage_class(at, operand(0))?,
            pointee: operand(1),
        },
        Op::TypeUntypedPointerKHR => untyped_pointer(at, operand(0))?,
        Op::TypeImage => TypeKind::Image(ImageType {
            sampled_type: operand(0),
            dim: spirv::Dim::from_u32(operand(1))
                .ok_or_else(|| Error::invalid(at, "unknown image dimension"))?,
            arrayed: operand(3) != 0,
            multisampled: operand(4) != 0,
            sampled: operand(5),
            format: operand(6),
        }),
        Op::TypeSampler => TypeKind::Sampler,
        Op::TypeSampledImage => TypeKind::SampledImage { image: operand(0) },
        Op::TypeAccelerationStructureKHR => TypeKind::AccelerationStructure,
        Op::TypeBufferEXT => TypeKind::Buffer,
        Op::TypeRayQueryKHR => TypeKind::RayQuery,
        Op::TypeHitObjectNV | Op::TypeHitObjectEXT => TypeKind::HitObject,
        Op::TypeFunction => TypeKind::Function {
            result: operand(0),
            params: operands[1..].into(),
        },
        other => {
            return Err(Error::unsupported(
                at,
                format!("Op{} is not supported", opcode_name(other)),
            ));
        }
    })
}

fn untyped_pointer(at: u32, class: u32) -> Result<TypeKind, Error> {
    let class = storage_class(at, class)?;
    let is_of_heap = matches!(class, StorageClass::UniformConstant | StorageClass::Image);
    if !has_layout(class) && !is_of_heap {
        let message = format!("an untyped pointer to {class:?} is not supported");
        return Err(Error::unsupported(at, message));
    }
    Ok(TypeKind::Pointer {
        class,
        pointee: UNTYPED,
    })
}

/// Whether memory of a class has bytes, with a layout from decorations.
fn has_layout(class: StorageClass) -> bool {
    is_physical(class)
        || matches!(
            class,
            StorageClass::Uniform
                | StorageClass::StorageBuffer
                | StorageClass::PushConstant
                | StorageClass::Workgroup
        )
}

/// Whether pointers of a class may be stored in shared memory. Logical pointers may only be stored
/// in variables of the invocation.
pub(super) fn is_physical(class: StorageClass) -> bool {
    matches!(
        class,
        StorageClass::PhysicalStorageBuffer | StorageClass::ShaderRecordBufferKHR
    )
}

/// Whether pointers of a class go through a descriptor.
fn is_through_descriptor(class: StorageClass) -> bool {
    matches!(
        class,
        StorageClass::Uniform
            | StorageClass::StorageBuffer
            | StorageClass::PushConstant
            | StorageClass::UniformConstant
    )
}

fn scalar(ty: Type, signed: bool) -> TypeKind {
    TypeKind::Scalar {
        ty,
        signed,
        is_bfloat16: false,
    }
}

/// Operands of `OpTypeFloat`: width, and the encoding `BFloat16KHR`.
const BFLOAT16: &[u32] = &[16, 0];

/// Refuses cooperative matrices that the device does not advertise.
fn cooperative_matrix(at: u32, sizes: &[u32]) -> Result<(), Error> {
    let [scope, rows, columns, _] = *sizes else {
        return Err(Error::invalid(at, "a cooperative matrix lacks its sizes"));
    };
    let size = MatrixProduct::SIZE as u32;
    if scope == spirv::Scope::Subgroup as u32 && [rows, columns] == [size; 2] {
        return Ok(());
    }
    let message = format!("only {size} by {size} cooperative matrices of a subgroup are supported");
    Err(Error::unsupported(at, message))
}

fn int_type(at: u32, bits: u32) -> Result<Type, Error> {
    match bits {
        8 => Ok(Type::I8),
        16 => Ok(Type::I16),
        32 => Ok(Type::I32),
        64 => Ok(Type::I64),
        _ => Err(Error::invalid(
            at,
            format!("no integer type has {bits} bits"),
        )),
    }
}

fn float_type(at: u32, operands: &[u32]) -> Result<Type, Error> {
    if operands.len() > 1 {
        return Err(Error::unsupported(
            at,
            "floating-point encodings are not supported",
        ));
    }
    match operands[0] {
        16 => Ok(Type::F16),
        32 => Ok(Type::F32),
        64 => Ok(Type::F64),
        bits => Err(Error::invalid(at, format!("no float type has {bits} bits"))),
    }
}

fn storage_class(at: u32, class: u32) -> Result<StorageClass, Error> {
    StorageClass::from_u32(class).ok_or_else(|| Error::invalid(at, "unknown storage class"))
}
