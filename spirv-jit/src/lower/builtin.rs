//! Built-in inputs, word by word.

use rspirv::spirv::BuiltIn;

use super::Lowerer;
use crate::Error;
use crate::environment::uniform;
use crate::ir::stage::{Builtin, Stage};
use crate::ir::{self, InputRow, Type, Value};

/// Where a built-in comes from.
enum Source {
    /// The invocation's input record.
    Record(Builtin),
    /// The dispatch: first word.
    Uniform(u32),
    SubgroupSize,
    LaneIndex,
    /// A mask of the lanes that compare so with this one.
    LaneMask(BuiltIn),
}

fn source(built_in: BuiltIn) -> Option<Source> {
    Some(match built_in {
        BuiltIn::LaunchIdKHR => Source::Record(Builtin::LaunchId),
        BuiltIn::LaunchSizeKHR => Source::Uniform(uniform::LAUNCH_SIZE),
        BuiltIn::NumWorkgroups => Source::Uniform(uniform::NUM_WORKGROUPS),
        BuiltIn::DeviceIndex => Source::Uniform(uniform::DEVICE_INDEX),
        BuiltIn::WorkgroupId => Source::Record(Builtin::WorkgroupId),
        BuiltIn::LocalInvocationId => Source::Record(Builtin::LocalInvocationId),
        BuiltIn::LocalInvocationIndex => Source::Record(Builtin::LocalInvocationIndex),
        BuiltIn::GlobalInvocationId => Source::Record(Builtin::GlobalInvocationId),
        BuiltIn::SubgroupId => Source::Record(Builtin::SubgroupId),
        BuiltIn::NumSubgroups => Source::Record(Builtin::NumSubgroups),
        BuiltIn::PrimitiveId => Source::Record(Builtin::PrimitiveId),
        BuiltIn::InstanceId => Source::Record(Builtin::InstanceId),
        BuiltIn::InstanceCustomIndexKHR => Source::Record(Builtin::InstanceCustomIndex),
        BuiltIn::RayGeometryIndexKHR => Source::Record(Builtin::GeometryIndex),
        BuiltIn::WorldRayOriginKHR => Source::Record(Builtin::WorldRayOrigin),
        BuiltIn::WorldRayDirectionKHR => Source::Record(Builtin::WorldRayDirection),
        BuiltIn::ObjectRayOriginKHR => Source::Record(Builtin::ObjectRayOrigin),
        BuiltIn::ObjectRayDirectionKHR => Source::Record(Builtin::ObjectRayDirection),
        BuiltIn::RayTminKHR => Source::Record(Builtin::RayTmin),
        BuiltIn::RayTmaxKHR | BuiltIn::HitTNV => Source::Record(Builtin::RayTmax),
        BuiltIn::IncomingRayFlagsKHR => Source::Record(Builtin::IncomingRayFlags),
        BuiltIn::CullMaskKHR => Source::Record(Builtin::CullMask),
        BuiltIn::HitKindKHR => Source::Record(Builtin::HitKind),
        BuiltIn::ObjectToWorldKHR => Source::Record(Builtin::ObjectToWorld),
        BuiltIn::WorldToObjectKHR => Source::Record(Builtin::WorldToObject),
        BuiltIn::HitTriangleVertexPositionsKHR => {
            Source::Record(Builtin::HitTriangleVertexPositions)
        }
        BuiltIn::CurrentRayTimeNV => Source::Record(Builtin::CurrentRayTime),
        BuiltIn::HitIsSphereNV => Source::Record(Builtin::HitIsSphere),
        BuiltIn::HitIsLSSNV => Source::Record(Builtin::HitIsLss),
        BuiltIn::HitSpherePositionNV => Source::Record(Builtin::HitSpherePosition),
        BuiltIn::HitSphereRadiusNV => Source::Record(Builtin::HitSphereRadius),
        BuiltIn::HitLSSPositionsNV => Source::Record(Builtin::HitLssPositions),
        BuiltIn::HitLSSRadiiNV => Source::Record(Builtin::HitLssRadii),
        BuiltIn::VertexIndex => Source::Record(Builtin::VertexIndex),
        BuiltIn::InstanceIndex => Source::Record(Builtin::InstanceIndex),
        BuiltIn::BaseVertex => Source::Record(Builtin::BaseVertex),
        BuiltIn::BaseInstance => Source::Record(Builtin::BaseInstance),
        BuiltIn::DrawIndex => Source::Record(Builtin::DrawIndex),
        BuiltIn::ViewIndex => Source::Record(Builtin::ViewIndex),
        BuiltIn::InvocationId => Source::Record(Builtin::InvocationId),
        BuiltIn::PatchVertices => Source::Record(Builtin::PatchVertices),
        BuiltIn::TessCoord => Source::Record(Builtin::TessCoord),
        BuiltIn::FragCoord => Source::Record(Builtin::FragCoord),
        BuiltIn::FrontFacing => Source::Record(Builtin::FrontFacing),
        BuiltIn::PointCoord => Source::Record(Builtin::PointCoord),
        BuiltIn::SampleId => Source::Record(Builtin::SampleId),
        BuiltIn::SamplePosition => Source::Record(Builtin::SamplePosition),
        BuiltIn::SampleMask => Source::Record(Builtin::SampleMask),
        BuiltIn::Layer => Source::Record(Builtin::Layer),
        BuiltIn::ViewportIndex => Source::Record(Builtin::ViewportIndex),
        BuiltIn::ShadingRateKHR => Source::Record(Builtin::ShadingRate),
        BuiltIn::SubgroupSize => Source::SubgroupSize,
        BuiltIn::SubgroupLocalInvocationId => Source::LaneIndex,
        BuiltIn::SubgroupEqMask
        | BuiltIn::SubgroupGeMask
        | BuiltIn::SubgroupGtMask
        | BuiltIn::SubgroupLeMask
        | BuiltIn::SubgroupLtMask => Source::LaneMask(built_in),
        _ => return None,
    })
}

impl Lowerer<'_> {
    /// A scalar of a built-in that is not the fragment stage's own, from a word on.
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
            BuiltIn::NumWorkgroups if is_drawn => Some(Source::Record(Builtin::NumWorkgroups)),
            other => source(other),
        };
        let Some(source) = source else {
            let message = format!("built-in {built_in:?} is not supported");
            return Err(Error::unsupported(self.b.source, message));
        };
        self.builtin_word(&source, word, ty)
    }

    fn builtin_word(&mut self, source: &Source, word: u32, ty: Type) -> Result<Value, Error> {
        if ty == Type::I1 {
            let word = self.builtin_word(source, word, Type::I32)?;
            return self.word_to_bool(word);
        }
        if !matches!(ty, Type::I32 | Type::F32) {
            return Err(self.b.invalid("a built-in has the wrong type"));
        }
        if let (Source::Record(Builtin::RayTmax), Some(variable)) = (source, self.ray_tmax) {
            return match ty {
                Type::F32 => self.b.emit(ir::Op::VarLoad(variable, 0), &[], ty),
                _ => Err(self.b.invalid("a built-in has the wrong type")),
            };
        }
        match *source {
            // There are no samples beyond the first word's.
            Source::Record(Builtin::SampleMask) if word > 0 => Ok(self.b.constant(ty, 0)),
            Source::Record(built_in) => {
                let last = u32::from(built_in.words()) - 1;
                self.input(InputRow::Builtin(built_in, word.min(last) as u8), ty)
            }
            _ => {
                let value = match *source {
                    Source::Uniform(first) => {
                        let last = uniform::COUNT as u32 - 1;
                        let op = ir::Op::Uniform(first.saturating_add(word).min(last));
                        self.b.emit(op, &[], Type::I32)?
                    }
                    Source::SubgroupSize => self.b.i32(crate::SUBGROUP_SIZE as u32),
                    Source::LaneIndex => self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?,
                    // Lanes from 32 on do not exist.
                    Source::LaneMask(_) if word > 0 => self.b.i32(0),
                    Source::LaneMask(which) => self.lane_mask(which)?,
                    Source::Record(_) => self.b.i32(0),
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
