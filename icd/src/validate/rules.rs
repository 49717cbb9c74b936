//! The table of rules: valid usage that only execution can check, with its VUIDs.
#![forbid(unsafe_code)]

/// The checked command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Caller {
    TraceRays,
    TraceRaysIndirect,
    TraceRaysIndirect2,
    TraceRaysNv,
    /// Any other command, whose rules have one name only.
    Other,
}

impl Caller {
    /// The commands that trace.
    pub const TRACES: [Caller; 4] = [
        Caller::TraceRays,
        Caller::TraceRaysIndirect,
        Caller::TraceRaysIndirect2,
        Caller::TraceRaysNv,
    ];
}

/// The prefix of a rule's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Of {
    /// The command that traces.
    Command,
    /// The source of the tables: the command, or the structure in memory.
    Tables,
    /// The source of the launch size: the command, or a structure in memory.
    Extent,
    /// The command that reads its parameters from memory.
    Indirect,
    /// `vkCmdTraceRaysNV`, which alone has the rule.
    Nv,
    /// No prefix: the name is complete.
    Whole,
}

const NV: &str = "VUID-vkCmdTraceRaysNV-";

impl Of {
    /// `None` if the rule does not apply to the command.
    fn prefix(self, caller: Caller) -> Option<&'static str> {
        let command = match caller {
            Caller::TraceRays => "VUID-vkCmdTraceRaysKHR-",
            Caller::TraceRaysIndirect => "VUID-vkCmdTraceRaysIndirectKHR-",
            Caller::TraceRaysIndirect2 => "VUID-vkCmdTraceRaysIndirect2KHR-",
            Caller::TraceRaysNv if self == Of::Whole => "",
            Caller::TraceRaysNv if self == Of::Nv => NV,
            Caller::TraceRaysNv => return None,
            Caller::Other if self == Of::Whole => "",
            Caller::Other => return None,
        };
        Some(match (self, caller) {
            (Of::Whole, _) => "",
            (Of::Tables | Of::Extent, Caller::TraceRaysIndirect2) => {
                "VUID-VkTraceRaysIndirectCommand2KHR-"
            }
            (Of::Extent, Caller::TraceRaysIndirect) => "VUID-VkTraceRaysIndirectCommandKHR-",
            (Of::Indirect, Caller::TraceRays) => return None,
            (Of::Nv, caller) if caller != Caller::TraceRaysNv => return None,
            _ => command,
        })
    }
}

macro_rules! rules {
    ($($of:ident $rule:ident $name:literal $text:literal;)*) => {
        /// A checked rule.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Rule {
            $($rule,)*
        }

        impl Rule {
            /// All of them.
            pub const ALL: &[Rule] = &[$(Rule::$rule,)*];

            fn of(self) -> Of {
                match self {
                    $(Rule::$rule => Of::$of,)*
                }
            }

            fn name(self) -> &'static str {
                match self {
                    $(Rule::$rule => $name,)*
                }
            }

            /// The requirement of the rule.
            pub fn text(self) -> &'static str {
                match self {
                    $(Rule::$rule => $text,)*
                }
            }
        }
    };
}

rules! {
    // Tables, before anything runs.
    Tables RaygenUsage "pRayGenShaderBindingTable-03681" "the ray generation table lies in a buffer of shader binding table usage";
    Tables RaygenAlignment "pRayGenShaderBindingTable-03682" "the ray generation table is aligned to shaderGroupBaseAlignment";
    Tables MissUsage "pMissShaderBindingTable-03684" "the miss table lies in a buffer of shader binding table usage";
    Tables MissAlignment "pMissShaderBindingTable-03685" "the miss table is aligned to shaderGroupBaseAlignment";
    Tables MissStride "stride-03686" "the miss table's stride is a multiple of shaderGroupHandleAlignment";
    Tables MissStrideLimit "stride-04029" "the miss table's stride is at most maxShaderGroupStride";
    Tables HitUsage "pHitShaderBindingTable-03688" "the hit table lies in a buffer of shader binding table usage";
    Tables HitAlignment "pHitShaderBindingTable-03689" "the hit table is aligned to shaderGroupBaseAlignment";
    Tables HitStride "stride-03690" "the hit table's stride is a multiple of shaderGroupHandleAlignment";
    Tables HitStrideLimit "stride-04035" "the hit table's stride is at most maxShaderGroupStride";
    Tables CallableUsage "pCallableShaderBindingTable-03692" "the callable table lies in a buffer of shader binding table usage";
    Tables CallableAlignment "pCallableShaderBindingTable-03693" "the callable table is aligned to shaderGroupBaseAlignment";
    Tables CallableStride "stride-03694" "the callable table's stride is a multiple of shaderGroupHandleAlignment";
    Tables CallableStrideLimit "stride-04041" "the callable table's stride is at most maxShaderGroupStride";
    Nv RaygenMemory "raygenShaderBindingTableBuffer-04042" "the ray generation table's buffer has memory";
    Nv MissMemory "missShaderBindingTableBuffer-04043" "the miss table's buffer has memory";
    Nv HitMemory "hitShaderBindingTableBuffer-04044" "the hit table's buffer has memory";
    Nv CallableMemory "callableShaderBindingTableBuffer-04045" "the callable table's buffer has memory";
    Whole TableSize "VUID-VkStridedDeviceAddressRegionKHR-size-04631" "a whole table lies in one buffer";
    // The size of the launch.
    Extent Invocations "width-03641" "width × height × depth is at most maxRayDispatchInvocationCount";
    Whole MaskSize "VUID-vkCmdBindInvocationMaskHUAWEI-width-04981" "an invocation mask is of the launch's width and height";
    Whole MaskDepth "VUID-vkCmdBindInvocationMaskHUAWEI-depth-04983" "a launch with an invocation mask is of depth 1";
    // Parameters in memory.
    Indirect IndirectUsage "indirectDeviceAddress-03633" "the parameters lie in a buffer of indirect buffer usage";
    Indirect IndirectAlignment "indirectDeviceAddress-03634" "the parameters' address is a multiple of 4";
    Indirect IndirectSize "indirectDeviceAddress-03636" "all of the parameters lie in one buffer";
    // Records that are used.
    Command ForeignHandle "None-03429" "a shader group handle was queried from the bound pipeline";
    Tables NullMiss "flags-03511" "with NO_NULL_MISS_SHADERS, a miss record that is met is not zero";
    Tables NullAnyHit "flags-03512" "with NO_NULL_ANY_HIT_SHADERS, a hit record that is met for its any-hit shader is not zero";
    Tables NullClosestHit "flags-03513" "with NO_NULL_CLOSEST_HIT_SHADERS, a hit record that is met for its closest-hit shader is not zero";
    Tables NullIntersection "flags-03514" "with NO_NULL_INTERSECTION_SHADERS, a hit record that is met for its intersection shader is not zero";
    Tables GroupOfTriangles "pHitShaderBindingTable-04735" "a hit record that is met for a triangle is of a triangles hit group";
    Tables GroupOfBoxes "pHitShaderBindingTable-04736" "a hit record that is met for a box is of a procedural hit group";
    Whole RecordRange "TUFF-record-index" "the index of a used record is inside its table";
    Command Recursion "maxPipelineRayRecursionDepth-03679" "no shader is called at a recursion depth past maxPipelineRayRecursionDepth";
    Whole StackSize "VUID-vkCmdSetRayTracingPipelineStackSizeKHR-pipelineStackSize-03610" "the pipeline's stack has room for every chain of shader calls";
    Command DeadStructure "None-08114" "an acceleration structure that is traced into exists";
    // Operands of instructions.
    Whole TraceFinite "VUID-RuntimeSpirv-OpTraceRayKHR-06355" "a ray's origin and direction are finite";
    Whole TraceNotNegative "VUID-RuntimeSpirv-OpTraceRayKHR-06356" "a ray's tmin and tmax are not negative";
    Whole TraceOrder "VUID-RuntimeSpirv-OpTraceRayKHR-06357" "a ray's tmin is at most its tmax";
    Whole TraceNan "VUID-RuntimeSpirv-OpTraceRayKHR-06358" "a ray has no NaN";
    Whole TraceTop "VUID-RuntimeSpirv-OpTraceRayKHR-06359" "a ray is traced into a top level";
    Whole TraceSkips "VUID-RuntimeSpirv-OpTraceRayKHR-06552" "a ray's flags do not skip both triangles and boxes";
    Whole TraceSkipsTriangles "VUID-RuntimeSpirv-OpTraceRayKHR-06553" "a ray does not skip triangles in a pipeline that skips boxes";
    Whole TraceSkipsBoxes "VUID-RuntimeSpirv-OpTraceRayKHR-06554" "a ray does not skip boxes in a pipeline that skips triangles";
    Whole TraceCulls "VUID-RuntimeSpirv-OpTraceRayKHR-06892" "a ray's flags do at most one of skipping triangles, culling front faces and culling back faces";
    Whole TraceOpacity "VUID-RuntimeSpirv-OpTraceRayKHR-06893" "a ray's flags say at most one thing of opacity";
    Whole TraceMotion "VUID-RuntimeSpirv-OpTraceRayKHR-06360" "a structure with motion is traced by a pipeline that allows motion";
    Whole MotionFinite "VUID-RuntimeSpirv-OpTraceRayMotionNV-06361" "a ray's origin and direction are finite";
    Whole MotionNotNegative "VUID-RuntimeSpirv-OpTraceRayMotionNV-06362" "a ray's tmin and tmax are not negative";
    Whole MotionOrder "VUID-RuntimeSpirv-OpTraceRayMotionNV-06363" "a ray's tmin is at most its tmax";
    Whole MotionNan "VUID-RuntimeSpirv-OpTraceRayMotionNV-06364" "a ray has no NaN";
    Whole MotionTop "VUID-RuntimeSpirv-OpTraceRayMotionNV-06365" "a ray with a time is traced into a top level with motion";
    Whole MotionTime "VUID-RuntimeSpirv-OpTraceRayMotionNV-06366" "a ray's time is between 0 and 1";
    Whole MotionPipeline "VUID-RuntimeSpirv-OpTraceRayMotionNV-06367" "a ray with a time is traced by a pipeline that allows motion";
    Whole HitObjectFinite "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11878" "a ray's origin and direction are finite";
    Whole HitObjectNotNegative "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11879" "a ray's tmin and tmax are not negative";
    Whole HitObjectOrder "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11880" "a ray's tmin is at most its tmax";
    Whole HitObjectNan "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11881" "a ray has no NaN";
    Whole HitObjectTime "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11882" "a ray's time is between 0 and 1";
    Whole HitObjectSkips "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11883" "a ray's flags do not skip both triangles and boxes";
    Whole HitObjectCulls "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11884" "a ray's flags do at most one of skipping triangles, culling front faces and culling back faces";
    Whole HitObjectOpacity "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11885" "a ray's flags say at most one thing of opacity";
    Whole HitObjectSkipsTriangles "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11886" "a ray does not skip triangles in a pipeline that skips boxes";
    Whole HitObjectSkipsBoxes "VUID-RuntimeSpirv-OpHitObjectTraceRayEXT-11887" "a ray does not skip boxes in a pipeline that skips triangles";
    Whole HitObjectMotion "VUID-RuntimeSpirv-flags-11875" "a structure with motion is traced by a pipeline that allows motion";
    Whole QueryFinite "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06348" "a ray's origin and direction are finite";
    Whole QueryNotNegative "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06349" "a ray's tmin and tmax are not negative";
    Whole QueryOrder "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06350" "a ray's tmin is at most its tmax";
    Whole QueryNan "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06351" "a ray has no NaN";
    Whole QueryTop "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352" "a query's structure is a top level";
    Whole QuerySkips "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06889" "a ray's flags do not skip both triangles and boxes";
    Whole QueryCulls "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06890" "a ray's flags do at most one of skipping triangles, culling front faces and culling back faces";
    Whole QueryOpacity "VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06891" "a ray's flags say at most one thing of opacity";
    Whole QueryStructure "TUFF-query-structure" "a structure that a query names exists";
    Whole ZeroDirection "TUFF-zero-direction" "a ray's direction is not zero: such a ray hits nothing";
    Whole HitKind "VUID-RuntimeSpirv-OpReportIntersectionKHR-06998" "a hit kind that is reported is at most 127";
    Whole PhysicalPointer "VUID-RuntimeSpirv-PhysicalStorageBuffer64-11819" "a physical pointer leads into a buffer of shader device address usage";
    Whole PointerAlignment "VUID-RuntimeSpirv-PhysicalStorageBuffer64-06315" "a physical pointer is as aligned as the access through it says";
    // Builds.
    Whole RangeAlignment "VUID-vkCmdBuildAccelerationStructuresIndirectKHR-pIndirectDeviceAddresses-03648" "the address of a build's ranges is a multiple of 4";
    Whole RangeMemory "VUID-vkCmdBuildAccelerationStructuresIndirectKHR-pIndirectDeviceAddresses-03646" "a build's ranges lie in one buffer";
    Whole RangeUsage "VUID-vkCmdBuildAccelerationStructuresIndirectKHR-pIndirectDeviceAddresses-03647" "a build's ranges lie in a buffer of indirect buffer usage";
    Whole RangeCount "VUID-vkCmdBuildAccelerationStructuresIndirectKHR-ppMaxPrimitiveCounts-03653" "a build's primitive count in memory is at most the command's maximum";
    Whole MaxVertex "VUID-VkAccelerationStructureBuildRangeInfoKHR-maxVertex-10774" "a build's indices are at most maxVertex";
    Whole MicromapFormat "VUID-VkMicromapBuildInfoEXT-format-11657" "a micromap's triangles are of formats that exist";
    Whole MicromapLevel2 "VUID-VkMicromapBuildInfoEXT-subdivisionLevel-11659" "a triangle of two states is of level maxOpacity2StateSubdivisionLevel at most";
    Whole MicromapLevel4 "VUID-VkMicromapBuildInfoEXT-subdivisionLevel-11660" "a triangle of four states is of level maxOpacity4StateSubdivisionLevel at most";
    Whole MicromapUsage "TUFF-micromap-usage" "a micromap's triangles are those that its usage counts name";
    Whole MicromapIndex "TUFF-micromap-index" "a triangle's micromap index names a triangle of its micromap";
    Whole BuildInput "TUFF-build-input" "the inputs of a build are in live memory";
    Whole BuildReference "TUFF-build-reference" "an instance refers to a bottom level that exists";
    Whole TransformFinite "TUFF-build-transform" "a geometry's transform is finite";
    Whole BuildOutput "TUFF-build-output" "a build's scratch memory and destination lie in live memory";
}

impl Rule {
    /// The name of the rule for `vkCmdTraceRaysNV`, if it differs.
    fn name_in_nv(self) -> Option<&'static str> {
        Some(match self {
            Rule::RaygenAlignment => "raygenShaderBindingOffset-02456",
            Rule::MissAlignment => "missShaderBindingOffset-02458",
            Rule::MissStride => "missShaderBindingStride-02463",
            Rule::MissStrideLimit => "missShaderBindingStride-02466",
            Rule::HitAlignment => "hitShaderBindingOffset-02460",
            Rule::HitStride => "hitShaderBindingStride-02464",
            Rule::HitStrideLimit => "hitShaderBindingStride-02467",
            Rule::CallableAlignment => "callableShaderBindingOffset-02462",
            Rule::CallableStride => "callableShaderBindingStride-02465",
            Rule::CallableStrideLimit => "callableShaderBindingStride-02468",
            Rule::Recursion => "maxRecursionDepth-03625",
            Rule::ForeignHandle | Rule::DeadStructure => self.name(),
            _ => return None,
        })
    }

    /// The rule's VUID for a command; `None` if it does not apply to the command.
    pub fn vuid(self, caller: Caller) -> Option<String> {
        if let (Caller::TraceRaysNv, Some(name)) = (caller, self.name_in_nv()) {
            return Some(format!("{NV}{name}"));
        }
        let prefix = self.of().prefix(caller)?;
        Some(format!("{prefix}{}", self.name()))
    }

    /// The rule's names for all commands.
    pub fn vuids(self) -> Vec<String> {
        let callers = Caller::TRACES.into_iter().chain([Caller::Other]);
        let mut names: Vec<_> = callers.filter_map(|caller| self.vuid(caller)).collect();
        names.sort_unstable();
        names.dedup();
        names
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_command() {
        let name = |rule: Rule, caller| rule.vuid(caller);
        let of = |text: &str| Some(text.to_owned());
        assert_eq!(
            name(Rule::ForeignHandle, Caller::TraceRaysIndirect2),
            of("VUID-vkCmdTraceRaysIndirect2KHR-None-03429")
        );
        assert_eq!(
            name(Rule::HitStride, Caller::TraceRaysIndirect2),
            of("VUID-VkTraceRaysIndirectCommand2KHR-stride-03690")
        );
        assert_eq!(
            name(Rule::Invocations, Caller::TraceRaysIndirect),
            of("VUID-VkTraceRaysIndirectCommandKHR-width-03641")
        );
        assert_eq!(
            name(Rule::HitStride, Caller::TraceRaysNv),
            of("VUID-vkCmdTraceRaysNV-hitShaderBindingStride-02464")
        );
        assert_eq!(
            name(Rule::HitMemory, Caller::TraceRaysNv),
            of("VUID-vkCmdTraceRaysNV-hitShaderBindingTableBuffer-04044")
        );
        assert_eq!(name(Rule::HitMemory, Caller::TraceRays), None);
        assert_eq!(name(Rule::Invocations, Caller::TraceRaysNv), None);
        assert_eq!(name(Rule::IndirectSize, Caller::TraceRays), None);
        assert_eq!(name(Rule::IndirectSize, Caller::Other), None);
        assert_eq!(
            name(Rule::ZeroDirection, Caller::Other),
            of("TUFF-zero-direction")
        );
    }

    #[test]
    fn no_name_is_given_twice() {
        let mut names: Vec<_> = Rule::ALL.iter().flat_map(|rule| rule.vuids()).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}
