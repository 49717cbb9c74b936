//! Images, samplers and pointers through descriptors cannot be made from other values: a value of
//! such a type comes from a value or variable of exactly that type.
//!
//! A module that breaks this rule is refused. The IR keeps such modules harmless in any case: see
//! [`crate::ir`].

use rspirv::spirv::{Op, StorageClass};

use super::Lowerer;
use super::types::{TypeKind, UNTYPED};
use crate::Error;
use crate::parse::{Id, Instruction};

impl Lowerer<'_> {
    fn is_opaque(&self, ty: Id) -> Result<bool, Error> {
        Ok(ty != 0 && self.types.info(ty)?.is_opaque)
    }

    /// Checks the source of a result of an opaque type.
    pub(super) fn check_opaque_result(&self, instruction: &Instruction) -> Result<(), Error> {
        let ty = instruction.result_type;
        if instruction.result == 0 || !self.is_opaque(ty)? {
            return Ok(());
        }
        let operands = self.module.operands(instruction);
        let same = match instruction.opcode {
            // The target of an untyped pointer is checked where it is used.
            Op::Load => {
                let pointer = self.types.pointer(self.type_of(operands[0])?)?;
                pointer.1 == ty || pointer == (StorageClass::UniformConstant, UNTYPED)
            }
            Op::CopyObject | Op::ExpectKHR => self.type_of(operands[0])? == ty,
            Op::Select => self.type_of(operands[1])? == ty && self.type_of(operands[2])? == ty,
            Op::Phi => self.are_all(operands.iter().step_by(2), ty)?,
            Op::CompositeConstruct => {
                let mut same = true;
                for (index, &part) in operands.iter().enumerate() {
                    let element = self.types.element(ty, Some(index as u32))?;
                    same &= self.type_of(part)? == element;
                }
                same
            }
            Op::CompositeExtract => {
                let whole = self.type_of(operands[0])?;
                self.types.path(whole, &operands[1..])?.1 == ty
            }
            Op::CompositeInsert => {
                let (part, whole) = (self.type_of(operands[0])?, self.type_of(operands[1])?);
                whole == ty && self.types.path(ty, &operands[2..])?.1 == part
            }
            Op::SampledImage => {
                let image = self.type_of(operands[0])?;
                let sampler = self.type_of(operands[1])?;
                self.is_sampled_image_of(ty, image)?
                    && matches!(self.types.kind(sampler)?, TypeKind::Sampler)
            }
            Op::Image => {
                let sampled = self.type_of(operands[0])?;
                self.is_sampled_image_of(sampled, ty)?
            }
            // Pointers are checked at each step, arguments and results at calls and returns.
            Op::AccessChain
            | Op::InBoundsAccessChain
            | Op::PtrAccessChain
            | Op::InBoundsPtrAccessChain => {
                let base = self.types.pointer(self.type_of(operands[0])?)?.0;
                base == self.types.pointer(ty)?.0
            }
            Op::UntypedAccessChainKHR
            | Op::UntypedInBoundsAccessChainKHR
            | Op::UntypedPtrAccessChainKHR
            | Op::UntypedInBoundsPtrAccessChainKHR => {
                let base = self.types.pointer(self.type_of(operands[1])?)?.0;
                base == self.types.pointer(ty)?.0
            }
            // The heap's descriptors are checked where they are used.
            Op::BufferPointerEXT => true,
            Op::Undef | Op::FunctionCall => true,
            _ => false,
        };
        self.require_same(same)
    }

    /// Whether a type is that of an image with a sampler. Image types that differ only in `Depth`
    /// are equal here, because glslang combines a `texture2D`, which is no depth image, with a
    /// `samplerShadow` to a depth image.
    fn is_sampled_image_of(&self, ty: Id, image: Id) -> Result<bool, Error> {
        let TypeKind::SampledImage { image: combined } = *self.types.kind(ty)? else {
            return Ok(false);
        };
        let (combined, image) = (self.types.kind(combined)?, self.types.kind(image)?);
        Ok(matches!(image, TypeKind::Image(_)) && combined == image)
    }

    /// Checks an id that is stored, returned or passed as an object of a type.
    pub(super) fn check_opaque(&self, id: Id, ty: Id) -> Result<(), Error> {
        if !self.is_opaque(ty)? {
            return Ok(());
        }
        self.require_same(self.type_of(id)? == ty)
    }

    /// Refuses to make an opaque type out of another one.
    pub(super) fn refuse_opaque(&self, ty: Id) -> Result<(), Error> {
        self.require_same(!self.is_opaque(ty)?)
    }

    /// Checks the type of a variable's contents: such values stay in memory of the invocation.
    pub(super) fn check_variable(&self, class: StorageClass, pointee: Id) -> Result<(), Error> {
        let may_be_long = matches!(
            class,
            StorageClass::Function
                | StorageClass::Private
                | StorageClass::UniformConstant
                | StorageClass::Uniform
                | StorageClass::Workgroup
                | StorageClass::StorageBuffer
                | StorageClass::PhysicalStorageBuffer
                | StorageClass::PushConstant
                | StorageClass::ShaderRecordBufferKHR
        );
        if !may_be_long && self.types.is_long(pointee) {
            let message = format!("a {class:?} variable cannot hold vectors of so many components");
            return Err(self.b.invalid(message));
        }
        let may_hold = matches!(
            class,
            StorageClass::UniformConstant | StorageClass::Function | StorageClass::Private
        );
        if may_hold || !self.is_opaque(pointee)? {
            return Ok(());
        }
        let message = format!("a {class:?} variable cannot hold images, samplers or such pointers");
        Err(self.b.invalid(message))
    }

    fn are_all<'i>(&self, ids: impl Iterator<Item = &'i Id>, ty: Id) -> Result<bool, Error> {
        for &id in ids {
            if self.type_of(id)? != ty {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn require_same(&self, same: bool) -> Result<(), Error> {
        if same {
            return Ok(());
        }
        let message = "an image, a sampler or a pointer to a resource is made of something else";
        Err(self.b.invalid(message))
    }
}
