//! The list of capabilities that are refused (`docs/capabilities.md`) is what the front end refuses.

use std::collections::BTreeSet;

use rspirv::spirv::Capability;
use shaders::request;
use spirv_jit::program::Stage;

const PAGE: &str = include_str!("../../docs/capabilities.md");

/// Capabilities in the SPIR-V registry that Vulkan lacks.
fn is_outside_vulkan(name: &str) -> bool {
    const OTHERS: [&str; 32] = [
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
