//! Images: descriptors, texel formats, addressing, filtering; for shaders, transfers and drawing.
//!
//! Texels are exchanged as four 32-bit words: f32 bits for float and normalised formats, integers
//! (sign- or zero-extended) for integer formats; 64-bit integer texels as (low, high) in the first
//! two words.

mod access;
mod address;
mod axes;
mod block;
mod chunk;
pub mod compressed;
mod cube;
mod decode;
mod derivatives;
pub mod execute;
pub mod fast;
pub mod format;
pub mod halve;
mod loads;
pub mod lod;
pub mod operands;
pub mod plain;
pub mod residency;
mod rows;
mod sample;
mod srgb;
mod stores;
#[cfg(test)]
mod tests;
pub mod texels;
pub mod wave;
pub mod ycbcr;

pub use format::Format;

/// Mip levels an image can have (`maxImageDimension` 16384).
pub const MAX_LEVELS: usize = 15;

/// Image dimensionality (SPIR-V `Dim`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Dim {
    D1,
    D2,
    D3,
    Cube,
    /// Texel buffer.
    Buffer,
}

/// A level of an image view.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Level {
    /// First texel of the level in the view's first layer.
    pub offset_bytes: u64,
    /// Between rows, and between slices of a 3D level.
    pub row_stride_bytes: u64,
    pub slice_stride_bytes: u64,
    pub width: u32,
    pub height: u32,
    pub depth: u32,
}

impl Level {
    const ZERO: Level = Level {
        offset_bytes: 0,
        row_stride_bytes: 0,
        slice_stride_bytes: 0,
        width: 0,
        height: 0,
        depth: 0,
    };
}

/// The resolved data of an image view for accesses. Levels and layers count from the view's first.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageDescriptor {
    pub data: *mut u8,
    /// Bytes from `data` that may be accessed.
    pub size_bytes: u64,
    pub format: Format,
    pub dim: Dim,
    pub arrayed: bool,
    pub samples: u8,
    pub level_count: u8,
    /// Layers of the view, faces of cubes counted.
    pub layer_count: u32,
    pub layer_stride_bytes: u64,
    /// Between samples of one texel's plane (multisampled images store samples as separate planes
    /// of a layer).
    pub sample_stride_bytes: u64,
    /// `VkComponentMapping`: for r, g, b, a: 0–3 = that component, 4 = zero, 5 = one.
    pub swizzle: [u8; 4],
    /// `VkImageViewMinLodCreateInfoEXT`, counted from the first of `levels`, or 0.
    pub min_lod: f32,
    /// With a conversion of several planes: the planes, of which there is one level.
    pub levels: [Level; MAX_LEVELS],
    /// The conversion of samples. The format is that of the first plane, and of accesses other than
    /// samples.
    pub conversion: Option<ycbcr::Conversion>,
}

impl ImageDescriptor {
    /// A view of nothing: reads give zeros, writes are dropped.
    pub const NULL: ImageDescriptor = ImageDescriptor {
        data: std::ptr::null_mut(),
        size_bytes: 0,
        format: Format::UNDEFINED,
        dim: Dim::D2,
        arrayed: false,
        samples: 1,
        level_count: 0,
        layer_count: 0,
        layer_stride_bytes: 0,
        sample_stride_bytes: 0,
        swizzle: [0, 1, 2, 3],
        min_lod: 0.0,
        levels: [Level::ZERO; MAX_LEVELS],
        conversion: None,
    };

    /// Whether integer coordinates lead to a level: those below the view's least level of detail,
    /// rounded down, are outside of the view (spec, "Integer Texel Coordinate Operations").
    #[inline(always)]
    pub(crate) fn has_level(&self, level: usize) -> bool {
        (self.min_lod as usize..usize::from(self.level_count)).contains(&level)
    }

    /// A texel buffer.
    pub fn texel_buffer(data: *mut u8, size_bytes: u64, format: Format) -> Self {
        let texel_size_bytes = format.size_bytes().max(1) as u64;
        let mut levels = [Level::default(); MAX_LEVELS];
        levels[0] = Level {
            offset_bytes: 0,
            row_stride_bytes: size_bytes,
            slice_stride_bytes: size_bytes,
            width: u32::try_from(size_bytes / texel_size_bytes).unwrap_or(u32::MAX),
            height: 1,
            depth: 1,
        };
        Self {
            data,
            size_bytes,
            format,
            dim: Dim::Buffer,
            arrayed: false,
            samples: 1,
            level_count: 1,
            layer_count: 1,
            layer_stride_bytes: size_bytes,
            sample_stride_bytes: size_bytes,
            swizzle: [0, 1, 2, 3],
            min_lod: 0.0,
            levels,
            conversion: None,
        }
    }
}

/// `VkFilter`, `VkSamplerMipmapMode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Filter {
    Nearest,
    Linear,
}

/// `VkSamplerAddressMode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum AddressMode {
    Repeat,
    MirroredRepeat,
    ClampToEdge,
    ClampToBorder,
    MirrorClampToEdge,
}

/// `VkCompareOp`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum CompareOp {
    Never,
    Less,
    Equal,
    LessOrEqual,
    Greater,
    NotEqual,
    GreaterOrEqual,
    Always,
}

/// `VkSamplerReductionMode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Reduction {
    WeightedAverage,
    Min,
    Max,
}

/// A sampler, resolved.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplerDescriptor {
    pub mag_filter: Filter,
    pub min_filter: Filter,
    pub mipmap_mode: Filter,
    pub address_mode: [AddressMode; 3],
    pub mip_lod_bias: f32,
    pub min_lod: f32,
    pub max_lod: f32,
    pub max_anisotropy: f32,
    pub compare: Option<CompareOp>,
    pub reduction: Reduction,
    /// As texel words: f32 bits or integers.
    pub border_color: [u32; 4],
    pub unnormalized_coordinates: bool,
    /// Faces of cubes end at their edges, as 2D images do
    /// (`VK_SAMPLER_CREATE_NON_SEAMLESS_CUBE_MAP_BIT_EXT`).
    pub non_seamless: bool,
}

impl SamplerDescriptor {
    /// The sampler of an all-zero `VkSamplerCreateInfo`.
    pub const DEFAULT: SamplerDescriptor = SamplerDescriptor {
        mag_filter: Filter::Nearest,
        min_filter: Filter::Nearest,
        mipmap_mode: Filter::Nearest,
        address_mode: [AddressMode::Repeat; 3],
        mip_lod_bias: 0.0,
        min_lod: 0.0,
        max_lod: 0.0,
        max_anisotropy: 1.0,
        compare: None,
        reduction: Reduction::WeightedAverage,
        border_color: [0; 4],
        unnormalized_coordinates: false,
        non_seamless: false,
    };
}

/// How the level of detail is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LodMode {
    /// Implicit: derivatives where the stage has them, else level 0 of the view.
    Implicit,
    /// Operand `bias: f32` on the implicit one.
    Bias,
    /// Operand `lod: f32` (sampling) or `lod: i32` (fetch).
    Lod,
    /// Operands d/dx and d/dy of the coordinates, `Dim` components each.
    Grad,
}

/// Types of texel words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TexelType {
    F32,
    I32,
    /// Integers of two words, low word first.
    I64,
}

/// Read-modify-write operations, of texels and of other memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AtomicOp {
    Load,
    Store,
    Exchange,
    CompareExchange,
    IAdd,
    ISub,
    SMin,
    SMax,
    UMin,
    UMax,
    And,
    Or,
    Xor,
    FAdd,
    FMin,
    FMax,
    /// The same for f32, with a denormal result flushed to zero.
    FAddFlushed,
    FMinFlushed,
    FMaxFlushed,
}

impl AtomicOp {
    /// The operation that flushes denormal results of this one.
    pub fn flushed(self) -> AtomicOp {
        match self {
            AtomicOp::FAdd => AtomicOp::FAddFlushed,
            AtomicOp::FMin => AtomicOp::FMinFlushed,
            AtomicOp::FMax => AtomicOp::FMaxFlushed,
            other => other,
        }
    }

    /// Of an operation that flushes, the one that does not.
    pub fn unflushed(self) -> Option<AtomicOp> {
        let plain = [AtomicOp::FAdd, AtomicOp::FMin, AtomicOp::FMax];
        plain.into_iter().find(|plain| plain.flushed() == self)
    }
}

/// The kind of an image operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImageOpKind {
    /// Filtered sampling: 4 results, 1 with a depth comparison.
    Sample,
    /// `OpImageFetch`: integer coordinates, 4 results.
    Fetch,
    /// `OpImageGather` of the component, or of the depth comparison: 4 results.
    Gather(u8),
    /// `OpImageRead`: storage image or texel buffer, 4 results.
    Read,
    /// `OpImageWrite`: the 4 texel operands come last; no result.
    Write,
    /// Read-modify-write on a texel (i32, i64 or f32): result is the old value.
    Atomic(AtomicOp),
    /// `OpImageQuerySize(Lod)`: as many i32 as the dimension has, plus layers; operand `lod: i32`
    /// if `LodMode::Lod`.
    QuerySize,
    /// 1 i32.
    QueryLevels,
    /// 1 i32.
    QuerySamples,
    /// `OpImageQueryLod`: 2 f32.
    QueryLod,
}

/// An image operation.
///
/// Operands, in order, those that apply: `image: i64` (descriptor address), `sampler: i64`
/// (descriptor address; sample, gather and query-lod only), coordinates
/// ([`ImageOp::coordinate_count`], f32 for sample/gather/query-lod, else i32; array layer last),
/// depth reference `f32`, lod operands by [`LodMode`], `min_lod: f32` if `has_min_lod`, offsets
/// (i32 per dimension) if `has_offset`, sample index `i32` if `multisampled` (fetch, read, write,
/// atomic), then texel operands (write: 4; atomic: value, comparator as for `Op::Atomic`). Results
/// and texels are f32 if `texel` is `F32`, else i32; with `I64` the results are (i64, i64 zero, …)
/// with the value in the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImageOp {
    pub kind: ImageOpKind,
    pub dim: Dim,
    pub arrayed: bool,
    pub multisampled: bool,
    /// Depth comparison (`Dref`).
    pub depth_compare: bool,
    /// Projective sampling is divided out by lowering.
    pub lod: LodMode,
    pub has_min_lod: bool,
    pub has_offset: bool,
    /// Gather with four offsets (`ConstOffsets`): 4 × dimension offsets instead of one.
    pub has_offsets: bool,
    pub texel: TexelType,
    /// Whether integer texels are signed (`SignExtend`, or by the sampled type).
    pub signed: bool,
    /// A read that is performed as written, not merged with another (`Volatile`, `VolatileTexel`).
    pub volatile: bool,
    /// The last result is a residency code (`OpImageSparse*`), an i32: 1 if all texels that were
    /// read have memory, else 0. For samples, gathers, fetches and reads.
    pub residency: bool,
    /// Format declared in the shader, or `Format::UNDEFINED` to use the view's.
    pub format: Format,
}

impl ImageOp {
    /// On floats, in the view's format, without any of the flags.
    pub const fn plain(kind: ImageOpKind, dim: Dim) -> ImageOp {
        ImageOp {
            kind,
            dim,
            arrayed: false,
            multisampled: false,
            depth_compare: false,
            lod: LodMode::Implicit,
            has_min_lod: false,
            has_offset: false,
            has_offsets: false,
            texel: TexelType::F32,
            signed: false,
            volatile: false,
            residency: false,
            format: Format::UNDEFINED,
        }
    }

    /// Components of the coordinates, array layer included: but a level-of-detail query takes no
    /// layer, and the third coordinate of a stored cube array is its layer already, 6 × cube +
    /// face.
    pub fn coordinate_count(&self) -> usize {
        let is_stored = matches!(
            self.kind,
            ImageOpKind::Fetch | ImageOpKind::Read | ImageOpKind::Write | ImageOpKind::Atomic(_)
        );
        let has_layer = self.arrayed
            && self.kind != ImageOpKind::QueryLod
            && !(is_stored && self.dim == Dim::Cube);
        self.spatial_count() + has_layer as usize
    }

    /// Components of the coordinates without the layer. A cube has 3, as a direction when sampled
    /// and as (x, y, face) when fetched or stored.
    pub fn spatial_count(&self) -> usize {
        match self.dim {
            Dim::D1 | Dim::Buffer => 1,
            Dim::D2 => 2,
            Dim::D3 | Dim::Cube => 3,
        }
    }

    /// No effect but its results.
    pub fn is_read(&self) -> bool {
        !matches!(self.kind, ImageOpKind::Write | ImageOpKind::Atomic(_))
    }
}
