//! Scalar types, kinds of traces, and products of matrices: what the IR, its definitions in `eval`
//! and hit objects speak of.

#![forbid(unsafe_code)]

use std::fmt;

use images::TexelType;

/// A scalar type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Type {
    I1,
    I8,
    I16,
    I32,
    I64,
    F16,
    F32,
    F64,
    /// Where an entry of a descriptor set is: see the [module's prose](super).
    Descriptor,
}

impl Type {
    /// All types, in the order of their declaration. Stored modules refer to types by this order.
    pub const ALL: [Type; 9] = [
        Type::I1,
        Type::I8,
        Type::I16,
        Type::I32,
        Type::I64,
        Type::F16,
        Type::F32,
        Type::F64,
        Type::Descriptor,
    ];

    /// The types of numbers and booleans.
    pub const NUMBERS: &[Type] = Type::ALL.split_at(8).0;

    /// Width in bits.
    pub const fn bits(self) -> u32 {
        match self {
            Type::I1 => 1,
            Type::I8 => 8,
            Type::I16 | Type::F16 => 16,
            Type::I32 | Type::F32 => 32,
            Type::I64 | Type::F64 | Type::Descriptor => 64,
        }
    }

    /// Size in buffer memory, in bytes; booleans have none and count as 4.
    pub const fn size_bytes(self) -> u32 {
        match self {
            Type::I1 => 4,
            other => other.bits() / 8,
        }
    }

    /// Rows of private memory: two for 64-bit types, one for the rest.
    pub const fn rows(self) -> u32 {
        if self.bits() == 64 { 2 } else { 1 }
    }

    pub const fn is_float(self) -> bool {
        matches!(self, Type::F16 | Type::F32 | Type::F64)
    }

    /// The integer type of the same width.
    pub const fn as_integer(self) -> Type {
        match self {
            Type::F16 => Type::I16,
            Type::F32 => Type::I32,
            Type::F64 => Type::I64,
            other => other,
        }
    }

    /// The type as that of an image's texels, if images have such.
    pub const fn as_texel(self) -> Option<TexelType> {
        match self {
            Type::F32 => Some(TexelType::F32),
            Type::I32 => Some(TexelType::I32),
            Type::I64 => Some(TexelType::I64),
            _ => None,
        }
    }
}

impl From<TexelType> for Type {
    fn from(texel: TexelType) -> Self {
        match texel {
            TexelType::F32 => Type::F32,
            TexelType::I32 => Type::I32,
            TexelType::I64 => Type::I64,
        }
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Type::I1 => "i1",
            Type::I8 => "i8",
            Type::I16 => "i16",
            Type::I32 => "i32",
            Type::I64 => "i64",
            Type::F16 => "f16",
            Type::F32 => "f32",
            Type::F64 => "f64",
            Type::Descriptor => "descriptor",
        })
    }
}

/// The kind of a matrix's components.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Component {
    F16,
    /// The high half of an f32, as an i16.
    BFloat16,
    F32,
    S8,
    U8,
    S32,
    U32,
    /// A float of 8 bits, 3 of them fraction, without infinities, as an i8: matrices in memory have
    /// such, values do not.
    E4M3,
    /// A float of 8 bits, 2 of them fraction: the high half of a 16-bit float, as an i8.
    E5M2,
}

impl Component {
    /// All kinds.
    pub const ALL: [Component; 9] = [
        Component::F16,
        Component::BFloat16,
        Component::F32,
        Component::S8,
        Component::U8,
        Component::S32,
        Component::U32,
        Component::E4M3,
        Component::E5M2,
    ];

    /// The type of values that hold such components.
    pub const fn ty(self) -> Type {
        match self {
            Component::F16 => Type::F16,
            Component::BFloat16 => Type::I16,
            Component::F32 => Type::F32,
            Component::S8 | Component::U8 | Component::E4M3 | Component::E5M2 => Type::I8,
            Component::S32 | Component::U32 => Type::I32,
        }
    }

    /// A float, not an integer.
    pub const fn is_float(self) -> bool {
        self.is_float8() || matches!(self, Component::F16 | Component::BFloat16 | Component::F32)
    }

    /// A float of 8 bits.
    pub const fn is_float8(self) -> bool {
        matches!(self, Component::E4M3 | Component::E5M2)
    }
}

/// A product of matrices `a` and `b`, plus a matrix `c`. Each has 16 rows, a value each, and 16
/// columns, one in each lane. All lanes of the subgroup take part, active or not.
///
/// Floats: the sum of an element begins with `c` and goes on with the products, those of the first
/// column of `a` first. Each product and each sum is rounded to f32, the last sum to the type of
/// the results. Integers: the exact sum, wrapped or saturated to 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MatrixProduct {
    pub a: Component,
    pub b: Component,
    /// Of `c` and of the results.
    pub sum: Component,
    /// Integers saturate.
    pub saturates: bool,
}

impl MatrixProduct {
    /// Rows and columns of each matrix.
    pub const SIZE: usize = crate::SUBGROUP_SIZE;

    /// Whether there is such a product.
    pub const fn is_valid(&self) -> bool {
        if self.a.is_float8() || self.b.is_float8() || self.sum.is_float8() {
            return false;
        }
        match self.sum {
            Component::S8 | Component::U8 => false,
            Component::S32 | Component::U32 => {
                !self.a.is_float()
                    && !self.b.is_float()
                    && self.a.ty().bits() == 8
                    && self.b.ty().bits() == 8
            }
            _ => self.a.is_float() && self.b.is_float() && !self.saturates,
        }
    }
}

/// A product of a matrix in memory and a vector, plus a vector if it `adds`. Each invocation has
/// its own vectors, whose components are a value each, and its own place of the matrix.
///
/// Floats: a sum begins with the added component, else with 0, and goes on with the products, those
/// of the first column first. Each product and each sum is rounded to f32, the last sum to the type
/// of the results. Integers: the exact sum, wrapped to 32 bits.
///
/// The matrix lies in lines, its rows or columns, whose elements follow each other. Elements
/// outside of the memory are zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VectorProduct {
    pub matrix: Component,
    pub vector: Component,
    /// Of the added vector and of the results.
    pub sum: Component,
    /// Lines are columns.
    pub by_columns: bool,
    pub adds: bool,
}

impl VectorProduct {
    /// Rows and columns that a matrix has at most
    /// (`VkPhysicalDeviceCooperativeVectorPropertiesNV::maxCooperativeVectorComponents`).
    pub const MAX_COMPONENTS: usize = 256;

    /// Whether there is such a product.
    pub const fn is_valid(&self) -> bool {
        use Component::{E4M3, E5M2, F16, F32, S8, S32, U8, U32};
        match self.matrix {
            F16 | F32 | E4M3 | E5M2 => {
                matches!(self.vector, F16 | F32) && matches!(self.sum, F16 | F32)
            }
            S8 | U8 => matches!(self.vector, S8 | U8) && matches!(self.sum, S32 | U32),
            _ => false,
        }
    }

    /// Whether each product of two components is an f32.
    pub const fn is_exact(&self) -> bool {
        !matches!(self.matrix, Component::F32) && !matches!(self.vector, Component::F32)
    }
}

/// Bytes from a line of a matrix to the next in the layouts that are the implementation's: rows of
/// whole sixteens of elements (`VK_COOPERATIVE_VECTOR_MATRIX_LAYOUT_INFERENCING_OPTIMAL_NV` and
/// `…_TRAINING_OPTIMAL_NV`, which are the same).
pub const fn optimal_stride_bytes(columns: u64, element_bytes: u64) -> u64 {
    (columns.div_ceil(16) * 16).saturating_mul(element_bytes)
}

/// How a ray is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Trace {
    /// The hit becomes words of a hit object, and no shader runs for it.
    pub to_hit_object: bool,
    /// The ray has a time.
    pub motion: bool,
}

impl Trace {
    /// All ways.
    pub const ALL: [Trace; 4] = [
        Trace::new(false, false),
        Trace::new(false, true),
        Trace::new(true, false),
        Trace::new(true, true),
    ];

    pub const fn new(to_hit_object: bool, motion: bool) -> Self {
        Self {
            to_hit_object,
            motion,
        }
    }

    /// Words of the ray, in front of the payload's.
    pub const fn words(self) -> usize {
        15 + self.motion as usize
    }

    /// Name of the operation in the text form.
    pub const fn text(self) -> &'static str {
        match (self.to_hit_object, self.motion) {
            (false, false) => "trace_ray",
            (false, true) => "trace_ray_motion",
            (true, false) => "hit_object_trace_ray",
            (true, true) => "hit_object_trace_ray_motion",
        }
    }
}
