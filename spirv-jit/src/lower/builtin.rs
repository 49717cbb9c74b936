//! Built-in inputs, word by word.

use rspirv::spirv::BuiltIn;

use super::Lowerer;
use crate::Error;
use crate::environment::uniform;
use crate::ir::stage::{Builtin, Stage};
use crate::ir::{self, InputRow, Type, Value};

/// The source of a built-in.
enum BuiltinSource {
    /// The invocation's input record.
    Record(Builtin),
    /// The dispatch: first word.
    Uniform(u32),
    SubgroupSize,
    LaneIndex,
    /// A mask of the lanes with this relation to the current one.
    LaneMask(BuiltIn),
}

fn source(built_in: BuiltIn) -> Option<BuiltinSource> {
    Some(match built_in {
        BuiltIn::LaunchIdKHR => BuiltinSource::Record(Builtin::LaunchId),
        BuiltIn::LaunchSizeKHR => BuiltinSource::Uniform(uniform::LAUNCH_SIZE),
        BuiltIn::NumWorkgroups => BuiltinSource::Uniform(uniform::NUM_WORKGROUPS),
        BuiltIn::DeviceIndex => BuiltinSource::Uniform(uniform::DEVICE_INDEX),
        BuiltIn::WorkgroupId => BuiltinSource::Record(Builtin::WorkgroupId),
        BuiltIn::LocalInvocationId => BuiltinSource::Record(Builtin::LocalInvocationId),
        BuiltIn::LocalInvocationIndex => BuiltinSource::Record(Builtin::LocalInvocationIndex),
        BuiltIn::GlobalInvocationId => BuiltinSource::Record(Builtin::GlobalInvocationId),
        BuiltIn::SubgroupId => BuiltinSource::Record(Builtin::SubgroupId),
        BuiltIn::NumSubgroups => BuiltinSource::Record(Builtin::NumSubgroups),
        BuiltIn::PrimitiveId => BuiltinSource::Record(Builtin::PrimitiveId),
        BuiltIn::InstanceId => BuiltinSource::Record(Builtin::InstanceId),
        BuiltIn::InstanceCustomIndexKHR => BuiltinSource::Record(Builtin::InstanceCustomIndex),
        BuiltIn::RayGeometryIndexKHR => BuiltinSource::Record(Builtin::GeometryIndex),
        BuiltIn::WorldRayOriginKHR => BuiltinSource::Record(Builtin::WorldRayOrigin),
        BuiltIn::WorldRayDirectionKHR => BuiltinSource::Record(Builtin::WorldRayDirection),
        BuiltIn::ObjectRayOriginKHR => BuiltinSource::Record(Builtin::ObjectRayOrigin),
        BuiltIn::ObjectRayDirectionKHR => BuiltinSource::Record(Builtin::ObjectRayDirection),
        BuiltIn::RayTminKHR => BuiltinSource::Record(Builtin::RayTmin),
        BuiltIn::RayTmaxKHR | BuiltIn::HitTNV => BuiltinSource::Record(Builtin::RayTmax),
        BuiltIn::IncomingRayFlagsKHR => BuiltinSource::Record(Builtin::IncomingRayFlags),
        BuiltIn::CullMaskKHR => BuiltinSource::Record(Builtin::CullMask),
        BuiltIn::HitKindKHR => BuiltinSource::Record(Builtin::HitKind),
        BuiltIn::ObjectToWorldKHR => BuiltinSource::Record(Builtin::ObjectToWorld),
        BuiltIn::WorldToObjectKHR => BuiltinSource::Record(Builtin::WorldToObject),
        BuiltIn::HitTriangleVertexPositionsKHR => {
            BuiltinSource::Record(Builtin::HitTriangleVertexPositions)
        }
        BuiltIn::CurrentRayTimeNV => BuiltinSource::Record(Builtin::CurrentRayTime),
        BuiltIn::HitIsSphereNV => BuiltinSource::Record(Builtin::HitIsSphere),
        BuiltIn::HitIsLSSNV => BuiltinSource::Record(Builtin::HitIsLss),
        BuiltIn::HitSpherePositionNV => BuiltinSource::Record(Builtin::HitSpherePosition),
        BuiltIn::HitSphereRadiusNV => BuiltinSource::Record(Builtin::HitSphereRadius),
        BuiltIn::HitLSSPositionsNV => BuiltinSource::Record(Builtin::HitLssPositions),
        BuiltIn::HitLSSRadiiNV => BuiltinSource::Record(Builtin::HitLssRadii),
        BuiltIn::VertexIndex => BuiltinSource::Record(Builtin::VertexIndex),
        BuiltIn::InstanceIndex => BuiltinSource::Record(Builtin::InstanceIndex),
        BuiltIn::BaseVertex => BuiltinSource::Record(Builtin::BaseVertex),
        BuiltIn::BaseInstance => BuiltinSource::Record(Builtin::BaseInstance),
        BuiltIn::DrawIndex => BuiltinSource::Record(Builtin::DrawIndex),
        BuiltIn::ViewIndex => BuiltinSource::Record(Builtin::ViewIndex),
        BuiltIn::InvocationId => BuiltinSource::Record(Builtin::InvocationId),
        BuiltIn::PatchVertices => BuiltinSource::Record(Builtin::PatchVertices),
        BuiltIn::TessCoord => BuiltinSource::Record(Builtin::TessCoord),
        BuiltIn::FragCoord => BuiltinSource::Record(Builtin::FragCoord),
        BuiltIn::FrontFacing => BuiltinSource::Record(Builtin::FrontFacing),
        BuiltIn::PointCoord => BuiltinSource::Record(Builtin::PointCoord),
        BuiltIn::SampleId => BuiltinSource::Record(Builtin::SampleId),
        BuiltIn::SamplePosition => BuiltinSource::Record(Builtin::SamplePosition),
        BuiltIn::SampleMask => BuiltinSource::Record(Builtin::SampleMask),
        BuiltIn::Layer => BuiltinSource::Record(Builtin::Layer),
        BuiltIn::ViewportIndex => BuiltinSource::Record(Builtin::ViewportIndex),
        BuiltIn::ShadingRateKHR => BuiltinSource::Record(Builtin::ShadingRate),
        BuiltIn::SubgroupSize => BuiltinSource::SubgroupSize,
        BuiltIn::SubgroupLocalInvocationId => BuiltinSource::LaneIndex,
        BuiltIn::SubgroupEqMask
        | BuiltIn::SubgroupGeMask
        | BuiltIn::SubgroupGtMask
        | BuiltIn::SubgroupLeMask
        | BuiltIn::SubgroupLtMask => BuiltinSource::LaneMask(built_in),
        _ => return None,
    })
}

impl Lowerer<'_> {
    /// A scalar of a built-in that other stages have, too, at a word.
    pub(super) fn built_in_scalar(
        &mut self,
        built_in: BuiltIn,
        word: u32,
        ty: Type,
    ) -> Result<Value, Error> {
        let built_in = match built_in {
            BuiltIn::ViewIndex if self.request.view_index_is_device_index => BuiltIn::DeviceIndex,
            other => other,
        };
        let is_drawn = matches!(self.request.stage, Stage::Task | Stage::Mesh);
        let source = match built_in {
            BuiltIn::NumWorkgroups if is_drawn => {
                Some(BuiltinSource::Record(Builtin::NumWorkgroups))
            }
            other => source(other),
        };
        let Some(source) = source else {
            let message = format!("built-in {built_in:?} is not supported");
            return Err(Error::unsupported(self.b.source, message));
        };
        self.builtin_word(&source, word, ty)
    }

    fn builtin_word(
        &mut self,
        source: &BuiltinSource,
        word: u32,
        ty: Type,
    ) -> Result<Value, Error> {
        if ty == Type::I1 {
            let word = self.builtin_word(source, word, Type::I32)?;
            return self.word_to_bool(word);
        }
        if !matches!(ty, Type::I32 | Type::F32) {
            return Err(self.b.invalid("a built-in has the wrong type"));
        }
        if let (BuiltinSource::Record(Builtin::RayTmax), Some(variable)) =
            (source, self.stage.ray_tmax)
        {
            return match ty {
                Type::F32 => self.b.emit(ir::Op::VarLoad(variable, 0), &[], ty),
                _ => Err(self.b.invalid("a built-in has the wrong type")),
            };
        }
        match *source {
            // All samples are in the first word.
            BuiltinSource::Record(Builtin::SampleMask) if word > 0 => Ok(self.b.constant(ty, 0)),
            BuiltinSource::Record(built_in) => {
                let last = u32::from(built_in.words()) - 1;
                self.input(InputRow::Builtin(built_in, word.min(last) as u8), ty)
            }
            _ => {
                let value = match *source {
                    BuiltinSource::Uniform(first) => {
                        let last = uniform::COUNT as u32 - 1;
                        let op = ir::Op::Uniform(first.saturating_add(word).min(last));
                        self.b.emit(op, &[], Type::I32)?
                    }
                    BuiltinSource::SubgroupSize => self.b.i32(crate::SUBGROUP_SIZE as u32),
                    BuiltinSource::LaneIndex => self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?,
                    // Lanes from 32 on do not exist.
                    BuiltinSource::LaneMask(_) if word > 0 => self.b.i32(0),
                    BuiltinSource::LaneMask(which) => self.lane_mask(which)?,
                    BuiltinSource::Record(_) => self.b.i32(0),
                };
                match ty {
                    Type::I32 => Ok(value),
                    _ => Err(self.b.invalid("a built-in has the wrong type")),
                }
            }
        }
    }

    fn lane_mask(&mut self, which: BuiltIn) -> Result<Value, Error> {
        let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
        let all = self.b.i32((1 << crate::SUBGROUP_SIZE) - 1);
        let one = self.b.i32(1);
        let equal = self.b.binary(ir::Op::Shl, one, lane)?;
        let below = self.b.binary(ir::Op::ISub, equal, one)?;
        match which {
            BuiltIn::SubgroupEqMask => Ok(equal),
            BuiltIn::SubgroupLtMask => Ok(below),
            BuiltIn::SubgroupLeMask => self.b.binary(ir::Op::Or, below, equal),
            BuiltIn::SubgroupGeMask => self.b.binary(ir::Op::Xor, all, below),
            _ => {
                let through = self.b.binary(ir::Op::Or, below, equal)?;
                self.b.binary(ir::Op::Xor, all, through)
            }
        }
    }

    /// The device address of the shader record.
    pub(super) fn shader_record_address(&mut self) -> Result<Value, Error> {
        let word = |index| InputRow::Builtin(Builtin::ShaderRecordAddress, index);
        let low = self.input(word(0), Type::I32)?;
        let high = self.input(word(1), Type::I32)?;
        self.b.pack64(low, high, Type::I64)
    }
}
