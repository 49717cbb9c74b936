//! The list of capabilities that are refused (`docs/capabilities.md`) is what the front end
//! refuses.

use std::collections::BTreeSet;

use rspirv::spirv::Capability;
use shaders::request;
use spirv_jit::CompileRequest;
use spirv_jit::parse::NewerCapability;
use spirv_jit::program::Stage;

const PAGE: &str = include_str!("../../docs/capabilities.md");

/// Capabilities in the SPIR-V registry that Vulkan lacks.
fn is_outside_vulkan(name: &str) -> bool {
    const OTHERS: [&str; 34] = [
        "Addresses",
        "ArithmeticFenceEXT",
        "AtomicStorage",
        "AtomicStorageOps",
        "BindlessTextureNV",
        "BitInstructions",
        "CooperativeMatrixLayoutsARM",
        "DeviceEnqueue",
        "DisplacementMicromapNV",
        "Float16Buffer",
        "Float16ImageAMD",
        "GenericPointer",
        "GroupUniformArithmeticKHR",
        "Groups",
        "ImageBasic",
        "ImageMipmap",
        "ImageReadWrite",
        "ImageRect",
        "Kernel",
        "Linkage",
        "LiteralSampler",
        "NamedBarrier",
        "OptNoneEXT",
        "PipeStorage",
        "Pipes",
        "RayQueryProvisionalKHR",
        "RayTracingDisplacementMicromapNV",
        "RayTracingProvisionalKHR",
        "SampledRect",
        "ShaderStereoViewNV",
        "SubgroupDispatch",
        "TensorFloat32RoundingINTEL",
        "UniformDecoration",
        "Vector16",
    ];
    let of_fpgas = name.ends_with("ALTERA") || name.ends_with("INTEL");
    OTHERS.contains(&name) || (of_fpgas && name != "IntegerFunctions2INTEL")
}

/// Whether a module that declares a capability is refused for that.
fn is_refused(capability: Capability) -> bool {
    const DECLARE: u32 = 2 << 16 | 17;
    let words = [
        0x0723_0203,
        0x0001_0600,
        0,
        10,
        0,
        DECLARE,
        Capability::Shader as u32,
        DECLARE,
        capability as u32,
        // OpMemoryModel Logical GLSL450.
        3 << 16 | 14,
        0,
        1,
    ];
    let error = spirv_jit::compile(&request(Stage::Compute, &words))
        .err()
        .expect("no entry point");
    error
        .to_string()
        .contains(&format!("capability {capability:?} is not supported"))
}

/// A module of one empty entry point, whose execution model is that of the stage.
fn empty_module(stage: Stage, capability: Capability) -> Vec<u32> {
    module_with(stage, capability as u32)
}

/// The same, with the capability of a number.
fn module_with(stage: Stage, capability: u32) -> Vec<u32> {
    const NAME: [u32; 2] = [u32::from_le_bytes(*b"main"), 0];
    let (model, mode) = match stage {
        // OriginUpperLeft.
        Stage::Fragment => (4, vec![3 << 16 | 16, 1, 7]),
        _ => (0, vec![]),
    };
    let mut words = vec![0x0723_0203, 0x0001_0300, 0, 10, 0];
    for capability in [Capability::Shader as u32, capability] {
        words.extend([2 << 16 | 17, capability]);
    }
    words.extend([3 << 16 | 14, 0, 1]);
    words.extend([5 << 16 | 15, model, 1, NAME[0], NAME[1]]);
    words.extend(mode);
    // %2 = void, %3 = void(), %1 is the function, %4 its block.
    words.extend([2 << 16 | 19, 2, 3 << 16 | 33, 3, 2]);
    words.extend([
        5 << 16 | 54,
        2,
        1,
        0,
        3,
        2 << 16 | 248,
        4,
        1 << 16 | 253,
        1 << 16 | 56,
    ]);
    words
}

/// Whether a module of a stage may declare a capability whose feature is off.
fn takes(stage: Stage, capability: Capability) -> bool {
    let words = empty_module(stage, capability);
    let request = CompileRequest {
        capabilities: &[Capability::Shader],
        ..request(stage, &words)
    };
    match spirv_jit::compile(&request) {
        Ok(_) => true,
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains("is not enabled"), "{message}");
            false
        }
    }
}

/// The capabilities that the bindings lack need their feature, too.
#[test]
fn newer_capabilities_are_refused_where_they_are_off() {
    for &capability in NewerCapability::ALL {
        let words = module_with(Stage::Vertex, capability as u32);
        let given = request(Stage::Vertex, &words);
        assert!(spirv_jit::compile(&given).is_ok());
        let mut others = NewerCapability::ALL.to_vec();
        others.retain(|&it| it != capability);
        let request = CompileRequest {
            newer_capabilities: &others,
            ..given
        };
        let error = spirv_jit::compile(&request).err().expect("refused");
        let message = format!("capability {capability:?} is not enabled");
        assert!(error.to_string().contains(&message), "{error}");
    }
}

/// The inputs `PrimitiveId`, `Layer` and `ViewportIndex` of fragment shaders come with `Geometry`,
/// which the other stages do not need.
#[test]
fn fragment_shaders_may_declare_geometry_for_their_inputs() {
    assert!(takes(Stage::Fragment, Capability::Geometry));
    assert!(!takes(Stage::Vertex, Capability::Geometry));
    assert!(!takes(Stage::Fragment, Capability::MultiView));
}

#[test]
fn the_page_lists_what_is_refused() {
    let all = request(Stage::Compute, &[]).capabilities;
    let refused: BTreeSet<String> = all
        .iter()
        .filter(|&&capability| is_refused(capability))
        .map(|capability| format!("{capability:?}"))
        .filter(|name| !is_outside_vulkan(name))
        .collect();
    let known: BTreeSet<String> = all
        .iter()
        .map(|capability| format!("{capability:?}"))
        .collect();
    // Every word in backticks that names a capability.
    let listed: BTreeSet<String> = PAGE
        .split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .filter(|name| known.contains(name))
        .collect();
    let missing: Vec<_> = refused.difference(&listed).collect();
    let wrong: Vec<_> = listed.difference(&refused).collect();
    assert!(
        missing.is_empty() && wrong.is_empty(),
        "not on the page: {missing:?}; on it, but not refused: {wrong:?}"
    );
}
