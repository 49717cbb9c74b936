//! Image instructions: one description of the request, one list of operands.

use images::{Dim, Format, ImageOp, ImageOpKind, LodMode, TexelType};
use rspirv::spirv::{self, ImageOperands, Op};
use smallvec::SmallVec;

use super::Lowerer;
use super::types::{ImageType, TypeKind};
use super::values::{MemoryLocation, Pointer, Val};
use crate::Error;
use crate::ir::op::AtomicOp;
use crate::ir::stage::{Builtin, Stage};
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::{Id, Instruction};

/// Operands after the image operands' mask, by kind.
#[derive(Default)]
struct Extras {
    bias: Option<Id>,
    lod: Option<Id>,
    grad: Option<(Id, Id)>,
    offset: Option<Id>,
    offsets: Option<Id>,
    sample: Option<Id>,
    min_lod: Option<Id>,
    sign_extend: Option<bool>,
    volatile: bool,
}

impl Extras {
    /// Reads the mask and its operands, which follow in the order of the mask's bits.
    fn parse(words: &[u32]) -> Option<Self> {
        let mut extras = Self::default();
        let Some((&bits, ids)) = words.split_first() else {
            return Some(extras);
        };
        let mut ids = ids.iter().copied();
        let mask = ImageOperands::from_bits(bits)?;
        for bit in mask.iter() {
            match bit {
                ImageOperands::BIAS => extras.bias = Some(ids.next()?),
                ImageOperands::LOD => extras.lod = Some(ids.next()?),
                ImageOperands::GRAD => extras.grad = Some((ids.next()?, ids.next()?)),
                ImageOperands::CONST_OFFSET | ImageOperands::OFFSET => {
                    extras.offset = Some(ids.next()?);
                }
                ImageOperands::CONST_OFFSETS | ImageOperands::OFFSETS => {
                    extras.offsets = Some(ids.next()?);
                }
                ImageOperands::SAMPLE => extras.sample = Some(ids.next()?),
                ImageOperands::MIN_LOD => extras.min_lod = Some(ids.next()?),
                ImageOperands::MAKE_TEXEL_AVAILABLE | ImageOperands::MAKE_TEXEL_VISIBLE => {
                    ids.next()?;
                }
                ImageOperands::SIGN_EXTEND => extras.sign_extend = Some(true),
                ImageOperands::ZERO_EXTEND => extras.sign_extend = Some(false),
                ImageOperands::VOLATILE_TEXEL => extras.volatile = true,
                _ => {}
            }
        }
        Some(extras)
    }
}

/// A sampling instruction's variant.
struct Sampling {
    projective: bool,
    compares: bool,
    /// The level of detail is implicit, from derivatives if there are any.
    implicit: bool,
}

/// An instruction without its sparse variant, and whether it also returns a residency code.
fn plain(opcode: Op) -> (Op, bool) {
    let plain = match opcode {
        Op::ImageSparseSampleImplicitLod => Op::ImageSampleImplicitLod,
        Op::ImageSparseSampleExplicitLod => Op::ImageSampleExplicitLod,
        Op::ImageSparseSampleDrefImplicitLod => Op::ImageSampleDrefImplicitLod,
        Op::ImageSparseSampleDrefExplicitLod => Op::ImageSampleDrefExplicitLod,
        Op::ImageSparseFetch => Op::ImageFetch,
        Op::ImageSparseGather => Op::ImageGather,
        Op::ImageSparseDrefGather => Op::ImageDrefGather,
        Op::ImageSparseRead => Op::ImageRead,
        _ => return (opcode, false),
    };
    (plain, true)
}

fn sampling(opcode: Op) -> Option<Sampling> {
    let (projective, compares) = match opcode {
        Op::ImageSampleImplicitLod | Op::ImageSampleExplicitLod => (false, false),
        Op::ImageSampleDrefImplicitLod | Op::ImageSampleDrefExplicitLod => (false, true),
        Op::ImageSampleProjImplicitLod | Op::ImageSampleProjExplicitLod => (true, false),
        Op::ImageSampleProjDrefImplicitLod | Op::ImageSampleProjDrefExplicitLod => (true, true),
        _ => return None,
    };
    let implicit = matches!(
        opcode,
        Op::ImageSampleImplicitLod
            | Op::ImageSampleDrefImplicitLod
            | Op::ImageSampleProjImplicitLod
            | Op::ImageSampleProjDrefImplicitLod
    );
    Some(Sampling {
        projective,
        compares,
        implicit,
    })
}

impl Lowerer<'_> {
    pub(super) fn lower_image(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match plain(instruction.opcode).0 {
            Op::SampledImage => {
                let image = self.leaves(operands[0])?;
                let sampler = self.leaves(operands[1])?;
                let pair: Option<(&Value, &Value)> = image.first().zip(sampler.last());
                let values = pair.map(|(&image, &sampler)| vec![image, sampler]);
                self.define_typed(instruction, values.unwrap_or_default())
            }
            Op::Image => {
                let pair = self.leaves(operands[0])?;
                self.define_typed(instruction, &pair[..pair.len().min(1)])
            }
            Op::ImageTexelPointer | Op::UntypedImageTexelPointerEXT => {
                self.lower_texel_pointer(instruction, operands)
            }
            Op::ImageFetch | Op::ImageRead => self.lower_texel_read(instruction, operands),
            Op::ImageWrite => self.lower_texel_write(operands),
            Op::ImageGather | Op::ImageDrefGather => self.lower_gather(instruction, operands),
            Op::ImageQuerySizeLod
            | Op::ImageQuerySize
            | Op::ImageQueryLod
            | Op::ImageQueryLevels
            | Op::ImageQuerySamples => self.lower_query(instruction, operands),
            Op::ImageSparseTexelsResident => {
                let code = self.scalar(operands[0])?;
                let zero = self.b.constant(self.b.ty(code), 0);
                let is_resident = self.b.compare(ir::Op::INe, code, zero)?;
                self.define_typed(instruction, [is_resident])
            }
            _ => self.lower_sample(instruction, operands),
        }
    }

    /// The image type behind an image, sampled image, or a pointer to one.
    fn image_type(&self, id: Id) -> Result<ImageType, Error> {
        let ty = self.type_of(id)?;
        self.image_type_of(ty)
    }

    fn image_type_of(&self, ty: Id) -> Result<ImageType, Error> {
        match *self.types.kind(ty)? {
            TypeKind::Image(image) => Ok(image),
            TypeKind::SampledImage { image } => self.image_type_of(image),
            TypeKind::Pointer { pointee, .. } => match *self.types.kind(pointee)? {
                TypeKind::Image(image) => Ok(image),
                _ => Err(self.b.invalid("an image is expected")),
            },
            _ => Err(self.b.invalid("an image is expected")),
        }
    }

    /// The description that all operations on an image share.
    fn image_op(&self, image: ImageType, kind: ImageOpKind) -> Result<ImageOp, Error> {
        let dim = match image.dim {
            spirv::Dim::Dim1D => Dim::D1,
            spirv::Dim::Dim2D | spirv::Dim::DimRect | spirv::Dim::DimSubpassData => Dim::D2,
            spirv::Dim::Dim3D => Dim::D3,
            spirv::Dim::DimCube => Dim::Cube,
            spirv::Dim::DimBuffer => Dim::Buffer,
            other => {
                let message = format!("images of {other:?} are not supported");
                return Err(Error::unsupported(self.b.source, message));
            }
        };
        let texel = match self.types.kind(image.sampled_type)? {
            TypeKind::Void => Some(TexelType::F32),
            _ => self.types.scalar(image.sampled_type)?.as_texel(),
        };
        let Some(texel) = texel else {
            return Err(self
                .b
                .invalid("texels are 32-bit floats or 32- or 64-bit integers"));
        };
        Ok(ImageOp {
            // An input attachment is read in the layer of the fragment.
            arrayed: image.arrayed || image.dim == spirv::Dim::DimSubpassData,
            multisampled: image.multisampled,
            texel,
            signed: self.types.is_signed(image.sampled_type),
            format: declared_format(image.format),
            ..ImageOp::plain(kind, dim)
        })
    }

    fn extras(&self, words: &[u32]) -> Result<Extras, Error> {
        Extras::parse(words).ok_or_else(|| self.b.invalid("image operands are missing"))
    }

    /// The descriptor of an image, or of a sampled image's image.
    fn image_descriptor(&mut self, id: Id) -> Result<Value, Error> {
        match self.leaves(id)?.first() {
            Some(&reference) => self.b.descriptor(reference),
            None => Err(self.b.invalid("an image is expected")),
        }
    }

    /// The descriptors of a sampled image's image and sampler.
    fn sampled_descriptors(&mut self, id: Id) -> Result<[Value; 2], Error> {
        match self.leaves(id)?[..] {
            [image, sampler] => Ok([self.b.descriptor(image)?, self.b.descriptor(sampler)?]),
            _ => Err(self.b.invalid("a sampled image is expected")),
        }
    }

    /// Coordinates as 32-bit floats, divided by their last component if projective.
    fn float_coordinates(
        &mut self,
        id: Id,
        count: usize,
        divisor: Option<Value>,
    ) -> Result<Vec<Value>, Error> {
        let given = self.leaves(id)?;
        if given.len() < count {
            return Err(self.b.invalid("coordinates lack components"));
        }
        let mut values = Vec::with_capacity(count);
        for &x in &given[..count] {
            let x = self.f32_of(x)?;
            values.push(match divisor {
                Some(divisor) => self.b.binary(ir::Op::FDiv, x, divisor)?,
                None => x,
            });
        }
        Ok(values)
    }

    fn f32_of(&mut self, x: Value) -> Result<Value, Error> {
        match self.b.ty(x) {
            Type::F32 => Ok(x),
            _ => self.b.emit(ir::Op::FConvert, &[x], Type::F32),
        }
    }

    fn integers(&mut self, id: Id, count: usize) -> Result<Vec<Value>, Error> {
        let given = self.leaves(id)?;
        if given.len() < count {
            return Err(self.b.invalid("coordinates lack components"));
        }
        let parts = given[..count].iter();
        parts.map(|&x| self.b.i32_of(x, true)).collect()
    }

    /// Appends the operands after the depth reference, and adds them to the description.
    fn push_extras(
        &mut self,
        op: &mut ImageOp,
        extras: &Extras,
        arguments: &mut Vec<Value>,
    ) -> Result<(), Error> {
        let fetches = matches!(
            op.kind,
            ImageOpKind::Fetch | ImageOpKind::Read | ImageOpKind::Write
        );
        if let Some(bias) = extras.bias {
            op.lod = LodMode::Bias;
            let bias = self.scalar(bias)?;
            arguments.push(self.f32_of(bias)?);
        } else if let Some(lod) = extras.lod {
            op.lod = LodMode::Lod;
            let lod = self.scalar(lod)?;
            let lod = if fetches {
                self.b.i32_of(lod, true)?
            } else {
                self.f32_of(lod)?
            };
            arguments.push(lod);
        } else if let Some((dx, dy)) = extras.grad {
            op.lod = LodMode::Grad;
            let count = op.spatial_count();
            arguments.extend(self.float_coordinates(dx, count, None)?);
            arguments.extend(self.float_coordinates(dy, count, None)?);
        }
        if let Some(min_lod) = extras.min_lod {
            op.has_min_lod = true;
            let min_lod = self.scalar(min_lod)?;
            arguments.push(self.f32_of(min_lod)?);
        }
        if let Some(offset) = extras.offset {
            op.has_offset = true;
            arguments.extend(self.integers(offset, op.spatial_count())?);
        }
        if let Some(offsets) = extras.offsets {
            op.has_offsets = true;
            arguments.extend(self.integers(offsets, 4 * op.spatial_count())?);
        }
        if op.multisampled && fetches {
            arguments.push(match extras.sample {
                Some(sample) => {
                    let sample = self.scalar(sample)?;
                    self.b.i32_of(sample, true)?
                }
                None => self.b.i32(0),
            });
        }
        if let Some(signed) = extras.sign_extend {
            op.signed = signed;
        }
        Ok(())
    }

    fn emit_image(
        &mut self,
        op: ImageOp,
        arguments: &[Value],
        results: usize,
    ) -> Result<Vec<Value>, Error> {
        let ty = match op.kind {
            ImageOpKind::QueryLod => Type::F32,
            ImageOpKind::QuerySize | ImageOpKind::QueryLevels | ImageOpKind::QuerySamples => {
                Type::I32
            }
            _ => op.texel.into(),
        };
        let mut types: SmallVec<[Type; 5]> = SmallVec::from_elem(ty, results);
        if op.residency {
            types.push(Type::I32);
        }
        let values = self
            .b
            .emit_unchecked(ir::Op::Image(op), arguments, &types)?;
        Ok(values.to_vec())
    }

    /// Emits an operation that reads texels, and defines the instruction's result: its components,
    /// after the residency code if there is one.
    fn define_texel(
        &mut self,
        instruction: &Instruction,
        op: ImageOp,
        arguments: &[Value],
    ) -> Result<(), Error> {
        let op = ImageOp {
            residency: plain(instruction.opcode).1,
            ..op
        };
        let results = match op.kind {
            ImageOpKind::Sample if op.depth_compare => 1,
            _ => 4,
        };
        let mut values = self.emit_image(op, arguments, results)?;
        if op.residency {
            values.rotate_right(1);
        }
        let count = self.types.leaves(instruction.result_type)?.len();
        values.truncate(count);
        self.define_typed(instruction, values)
    }

    fn lower_sample(&mut self, instruction: &Instruction, operands: &[u32]) -> Result<(), Error> {
        let Some(sampling) = sampling(plain(instruction.opcode).0) else {
            return Err(self.unsupported(instruction));
        };
        let image = self.image_type(operands[0])?;
        let mut op = self.image_op(image, ImageOpKind::Sample)?;
        op.depth_compare = sampling.compares;
        let mut arguments = self.sampled_descriptors(operands[0])?.to_vec();
        let divisor = if sampling.projective {
            let given = self.leaves(operands[1])?;
            let Some(&divisor) = given.get(op.spatial_count()) else {
                return Err(self.b.invalid("coordinates lack components"));
            };
            Some(self.f32_of(divisor)?)
        } else {
            None
        };
        let count = op.coordinate_count();
        arguments.extend(self.float_coordinates(operands[1], count, divisor)?);
        let mut rest = &operands[2..];
        if sampling.compares {
            let reference = self.scalar(rest[0])?;
            let reference = self.f32_of(reference)?;
            arguments.push(match divisor {
                Some(divisor) => self.b.binary(ir::Op::FDiv, reference, divisor)?,
                None => reference,
            });
            rest = &rest[1..];
        }
        let mut extras = self.extras(rest)?;
        if sampling.implicit && self.derivative_group().is_some() {
            op.lod = LodMode::Grad;
            let spatial = arguments[2..2 + op.spatial_count()].to_vec();
            arguments.extend(self.gradients(&spatial, extras.bias.take())?);
        }
        self.push_extras(&mut op, &extras, &mut arguments)?;
        self.define_texel(instruction, op, &arguments)
    }

    fn lower_gather(&mut self, instruction: &Instruction, operands: &[u32]) -> Result<(), Error> {
        let image = self.image_type(operands[0])?;
        let compares = plain(instruction.opcode).0 == Op::ImageDrefGather;
        let component = match compares {
            true => 0,
            false => self.constants.unsigned(&self.types, operands[2])?.min(3) as u8,
        };
        let mut op = self.image_op(image, ImageOpKind::Gather(component))?;
        op.depth_compare = compares;
        let mut arguments = self.sampled_descriptors(operands[0])?.to_vec();
        let count = op.coordinate_count();
        arguments.extend(self.float_coordinates(operands[1], count, None)?);
        if compares {
            let reference = self.scalar(operands[2])?;
            arguments.push(self.f32_of(reference)?);
        }
        let extras = self.extras(&operands[3..])?;
        self.push_extras(&mut op, &extras, &mut arguments)?;
        self.define_texel(instruction, op, &arguments)
    }

    fn lower_texel_read(
        &mut self,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<(), Error> {
        let image = self.image_type(operands[0])?;
        let kind = match plain(instruction.opcode).0 {
            Op::ImageFetch => ImageOpKind::Fetch,
            _ => ImageOpKind::Read,
        };
        let mut op = self.image_op(image, kind)?;
        let mut arguments = vec![self.image_descriptor(operands[0])?];
        match image.dim {
            spirv::Dim::DimSubpassData => {
                op.kind = ImageOpKind::Fetch;
                arguments.extend(self.attachment_coordinates(operands[1])?);
            }
            _ => arguments.extend(self.integers(operands[1], op.coordinate_count())?),
        }
        let extras = self.extras(&operands[2..])?;
        // The variable of an image value is unknown.
        op.volatile = op.kind == ImageOpKind::Read
            && (extras.volatile || self.module.annotations.has_volatile);
        self.push_extras(&mut op, &extras, &mut arguments)?;
        self.define_texel(instruction, op, &arguments)
    }

    /// The texel of an input attachment: the fragment's, moved by an offset, in the fragment's
    /// layer.
    fn attachment_coordinates(&mut self, offset: Id) -> Result<Vec<Value>, Error> {
        if self.request.stage != Stage::Fragment {
            return Err(self
                .b
                .invalid("only fragment shaders read input attachments"));
        }
        self.interface.reads_attachments = true;
        let offset = self.integers(offset, 2)?;
        let mut coordinates = Vec::with_capacity(3);
        for (axis, offset) in (0..2).zip(offset) {
            let place = self.input(InputRow::Builtin(Builtin::FragCoord, axis), Type::F32)?;
            let pixel = self.b.emit(ir::Op::FToS, &[place], Type::I32)?;
            coordinates.push(self.b.binary(ir::Op::IAdd, pixel, offset)?);
        }
        coordinates.push(self.input(InputRow::Builtin(Builtin::AttachmentLayer, 0), Type::I32)?);
        Ok(coordinates)
    }

    fn lower_texel_write(&mut self, operands: &[u32]) -> Result<(), Error> {
        let image = self.image_type(operands[0])?;
        let mut op = self.image_op(image, ImageOpKind::Write)?;
        let mut arguments = vec![self.image_descriptor(operands[0])?];
        arguments.extend(self.integers(operands[1], op.coordinate_count())?);
        let extras = self.extras(&operands[3..])?;
        self.push_extras(&mut op, &extras, &mut arguments)?;
        let texel = self.leaves(operands[2])?;
        let ty = Type::from(op.texel);
        let zero = self.b.constant(ty, 0);
        for index in 0..4 {
            let value = texel.get(index).copied().unwrap_or(zero);
            if self.b.ty(value) != ty {
                return Err(self.b.invalid("the texel does not have the image's type"));
            }
            arguments.push(value);
        }
        self.emit_image(op, &arguments, 0).map(drop)
    }

    fn lower_query(&mut self, instruction: &Instruction, operands: &[u32]) -> Result<(), Error> {
        let image = self.image_type(operands[0])?;
        let (kind, results) = match instruction.opcode {
            Op::ImageQueryLod => (ImageOpKind::QueryLod, 2),
            Op::ImageQueryLevels => (ImageOpKind::QueryLevels, 1),
            Op::ImageQuerySamples => (ImageOpKind::QuerySamples, 1),
            _ => (ImageOpKind::QuerySize, 0),
        };
        let mut op = self.image_op(image, kind)?;
        let mut arguments = Vec::new();
        let mut results = results;
        match kind {
            ImageOpKind::QueryLod => {
                arguments.extend(self.sampled_descriptors(operands[0])?);
                let count = op.coordinate_count();
                arguments.extend(self.float_coordinates(operands[1], count, None)?);
                if self.derivative_group().is_some() {
                    op.lod = LodMode::Grad;
                    let spatial = arguments[2..2 + op.spatial_count()].to_vec();
                    arguments.extend(self.gradients(&spatial, None)?);
                }
            }
            ImageOpKind::QuerySize => {
                arguments.push(self.image_descriptor(operands[0])?);
                results = match op.dim {
                    // A cube's size is that of its faces.
                    Dim::Cube => 2,
                    _ => op.spatial_count(),
                } + op.arrayed as usize;
                if instruction.opcode == Op::ImageQuerySizeLod {
                    op.lod = LodMode::Lod;
                    let lod = self.scalar(operands[1])?;
                    arguments.push(self.b.i32_of(lod, true)?);
                }
            }
            _ => arguments.push(self.image_descriptor(operands[0])?),
        }
        let mut values = self.emit_image(op, &arguments, results)?;
        let ty = self.types.component(instruction.result_type)?;
        for value in &mut values {
            if self.b.ty(*value) != ty && !ty.is_float() {
                *value = self.b.emit(ir::Op::UConvert, &[*value], ty)?;
            }
        }
        self.define_typed(instruction, values)
    }

    fn lower_texel_pointer(
        &mut self,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<(), Error> {
        let (_, pointee) = self.types.pointer(instruction.result_type)?;
        let (pointer, operands) = match instruction.opcode {
            // Its first operand is the image.
            Op::UntypedImageTexelPointerEXT => (
                self.pointer(operands[1])?.retyped(operands[0]),
                &operands[1..],
            ),
            _ => (self.pointer(operands[0])?, operands),
        };
        let image_type = pointer.pointee;
        let image = self.image_type_of(image_type)?;
        let op = self.image_op(image, ImageOpKind::Atomic(AtomicOp::Load))?;
        let coordinate = self.integers(operands[1], op.coordinate_count())?;
        let sample = self.scalar(operands[2])?;
        let place = MemoryLocation::Texel {
            image_type,
            image: self.reference(&pointer)?,
            coordinate: coordinate.into(),
            sample: self.b.i32_of(sample, true)?,
        };
        let pointer = Pointer::new(pointee, place);
        self.define(instruction.result, Val::Pointer(pointer))
    }

    /// A read-modify-write of a texel.
    pub(super) fn texel_atomic(
        &mut self,
        pointer: &Pointer,
        kind: AtomicOp,
        operands: &[Value],
    ) -> Result<Option<Value>, Error> {
        let MemoryLocation::Texel {
            image_type,
            image,
            coordinate,
            sample,
        } = &pointer.place
        else {
            return Err(self.b.invalid("a texel is expected"));
        };
        let image_type = self.image_type_of(*image_type)?;
        let mut op = self.image_op(image_type, ImageOpKind::Atomic(kind))?;
        let texel = self.types.scalar(pointer.pointee)?.as_texel();
        op.texel = texel.ok_or_else(|| self.b.invalid("this texel has no atomics"))?;
        let mut arguments = vec![self.b.descriptor(*image)?];
        arguments.extend_from_slice(coordinate);
        if op.multisampled {
            arguments.push(*sample);
        }
        arguments.extend_from_slice(operands);
        let results = (kind != AtomicOp::Store) as usize;
        Ok(self.emit_image(op, &arguments, results)?.first().copied())
    }
}

/// The `VkFormat` of a SPIR-V image format (Vulkan specification, appendix Vulkan Environment for
/// SPIR-V, table of compatibility).
fn declared_format(format: u32) -> Format {
    use spirv::ImageFormat as F;
    Format(match spirv::ImageFormat::from_u32(format) {
        Some(F::Rgba32f) => 109,
        Some(F::Rgba16f) => 97,
        Some(F::R32f) => 100,
        Some(F::Rgba8) => 37,
        Some(F::Rgba8Snorm) => 38,
        Some(F::Rg32f) => 103,
        Some(F::Rg16f) => 83,
        Some(F::R11fG11fB10f) => 122,
        Some(F::R16f) => 76,
        Some(F::Rgba16) => 91,
        Some(F::Rgb10A2) => 64,
        Some(F::Rg16) => 77,
        Some(F::Rg8) => 16,
        Some(F::R16) => 70,
        Some(F::R8) => 9,
        Some(F::Rgba16Snorm) => 92,
        Some(F::Rg16Snorm) => 78,
        Some(F::Rg8Snorm) => 17,
        Some(F::R16Snorm) => 71,
        Some(F::R8Snorm) => 10,
        Some(F::Rgba32i) => 108,
        Some(F::Rgba16i) => 96,
        Some(F::Rgba8i) => 42,
        Some(F::R32i) => 99,
        Some(F::Rg32i) => 102,
        Some(F::Rg16i) => 82,
        Some(F::Rg8i) => 21,
        Some(F::R16i) => 75,
        Some(F::R8i) => 14,
        Some(F::Rgba32ui) => 107,
        Some(F::Rgba16ui) => 95,
        Some(F::Rgba8ui) => 41,
        Some(F::R32ui) => 98,
        Some(F::Rgb10a2ui) => 68,
        Some(F::Rg32ui) => 101,
        Some(F::Rg16ui) => 81,
        Some(F::Rg8ui) => 20,
        Some(F::R16ui) => 74,
        Some(F::R8ui) => 13,
        Some(F::R64ui) => 110,
        Some(F::R64i) => 111,
        _ => 0,
    })
}
