//! `VK_KHR_pipeline_executable_properties`: each program of a pipeline is an executable.

use std::ffi::c_char;

use ash::vk;
use spirv_jit::ir::{Module, Node, text};
use spirv_jit::program::Stage;
use spirv_jit::{Program, SUBGROUP_SIZE};

use crate::VkResult;
use crate::ffi::array;
use crate::ffi::enumerate::{enumerate_bytes, enumerate_with};
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::object::Pipeline;

fn stage_flag(stage: Stage) -> vk::ShaderStageFlags {
    match stage {
        Stage::Compute => vk::ShaderStageFlags::COMPUTE,
        Stage::RayGeneration => vk::ShaderStageFlags::RAYGEN_KHR,
        Stage::Intersection => vk::ShaderStageFlags::INTERSECTION_KHR,
        Stage::AnyHit => vk::ShaderStageFlags::ANY_HIT_KHR,
        Stage::ClosestHit => vk::ShaderStageFlags::CLOSEST_HIT_KHR,
        Stage::Miss => vk::ShaderStageFlags::MISS_KHR,
        Stage::Callable => vk::ShaderStageFlags::CALLABLE_KHR,
        Stage::Vertex => vk::ShaderStageFlags::VERTEX,
        Stage::TessellationControl => vk::ShaderStageFlags::TESSELLATION_CONTROL,
        Stage::TessellationEvaluation => vk::ShaderStageFlags::TESSELLATION_EVALUATION,
        Stage::Geometry => vk::ShaderStageFlags::GEOMETRY,
        Stage::Task => vk::ShaderStageFlags::TASK_EXT,
        Stage::Mesh => vk::ShaderStageFlags::MESH_EXT,
        Stage::Fragment => vk::ShaderStageFlags::FRAGMENT,
    }
}

/// The value of a statistic.
enum Value {
    Is(bool),
    Count(u64),
}

type Statistic = (&'static str, &'static str, Value);

fn module_statistics(module: &Module) -> [Statistic; 2] {
    let mut operations = 0;
    for function in &module.functions {
        (function.body).visit(&mut |node| operations += u64::from(matches!(node, Node::Inst(_))));
    }
    [
        (
            "Operations",
            "Operations of the optimised IR",
            Value::Count(operations),
        ),
        (
            "Functions",
            "Functions that were not inlined",
            Value::Count(module.functions.len() as u64),
        ),
    ]
}

/// The statistics of a program, and of its module if that was captured.
fn statistics(program: &Program, module: Option<&Module>) -> Vec<Statistic> {
    let count = |value: usize| Value::Count(value as u64);
    let mut all: Vec<Statistic> = Vec::new();
    all.extend(module.into_iter().flat_map(module_statistics));
    let rows = program.layout().rows;
    let lane_bytes = program.stack_size_bytes() as usize;
    let frame_bytes = program.frame_bytes(1);
    let shared_bytes = program.shared_size_bytes() as usize;
    let subgroups = program.max_wave_subgroups();
    let native = program.native_counts();
    all.extend([
        (
            "Frame",
            "Bytes of a subgroup's values while it runs",
            count(frame_bytes),
        ),
        (
            "State Rows",
            "Rows of a subgroup's state while it is suspended",
            count(rows),
        ),
        (
            "Lane State",
            "Bytes of one invocation's state while it is suspended",
            count(lane_bytes),
        ),
        (
            "Workgroup Memory",
            "Bytes of a workgroup's memory",
            count(shared_bytes),
        ),
        (
            "Wave",
            "Subgroups that run side by side at most",
            count(subgroups),
        ),
        (
            "Native Code",
            "Whether stretches of arithmetic are native code",
            Value::Is(program.has_native_code()),
        ),
        (
            "Native Stretches",
            "Stretches and loops that are native code",
            count(native.stretches),
        ),
        (
            "Native Operations",
            "Operations that native code performs",
            count(native.operations),
        ),
        (
            "Native Code Size",
            "Bytes of native code and its constants",
            count(native.size_bytes),
        ),
        (
            "Vector Registers",
            "Vector registers that one stretch uses at most",
            count(native.vector_registers),
        ),
    ]);
    all
}

fn write_statistic(out: &mut vk::PipelineExecutableStatisticKHR<'_>, statistic: Statistic) {
    let (name, description, value) = statistic;
    array::write_text(&mut out.name, name);
    array::write_text(&mut out.description, description);
    // All bytes of the union are defined.
    out.value = vk::PipelineExecutableStatisticValueKHR { u64: 0 };
    match value {
        Value::Is(it) => {
            out.format = vk::PipelineExecutableStatisticFormatKHR::BOOL32;
            out.value.b32 = it.into();
        }
        Value::Count(it) => {
            out.format = vk::PipelineExecutableStatisticFormatKHR::UINT64;
            out.value.u64 = it;
        }
    }
}

/// A representation of an executable: its name, a description, and the text.
type Representation = (&'static str, &'static str, String);

/// The representations of a program with a captured module: the IR, and native code if there is
/// any.
fn representations(program: &Program, module: &Module) -> Vec<Representation> {
    let ir = (
        "IR",
        "The compiler's IR after its passes",
        text::print_module(module),
    );
    let native = program.native_text().map(|text| {
        let description = "Instructions of the stretches and loops that are native code";
        ("Native Code", description, text)
    });
    std::iter::once(ir).chain(native).collect()
}

/// Writes a text, cut to the room there is and terminated.
///
/// # Errors
/// `VK_INCOMPLETE` if it was cut.
///
/// # Safety
/// The data is null or has room for as many bytes as the structure says.
unsafe fn write_representation(
    out: &mut vk::PipelineExecutableInternalRepresentationKHR<'_>,
    (name, description, text): Representation,
) -> VkResult {
    array::write_text(&mut out.name, name);
    array::write_text(&mut out.description, description);
    out.is_text = vk::TRUE;
    let (room, data) = (out.data_size, out.p_data.cast());
    let mut text = text.into_bytes();
    text.push(0);
    let all = text.len() <= room || out.p_data.is_null();
    if !all {
        text.truncate(room);
        text.last_mut().into_iter().for_each(|last| *last = 0);
    }
    // SAFETY: the caller guarantees that the data is null or has room for as many bytes as the
    // structure says.
    unsafe { enumerate_bytes(&mut out.data_size, data, |_| (text, all)) }
}

/// Writes the name of an executable, `"fragment main"`, and its source.
fn describe(program: &Program, name: &mut [c_char; 256], description: &mut [c_char; 256]) {
    let stage = format!("{:?}", program.stage());
    let place = program.place_of(&[]);
    let entry_point = place.entry_point.as_deref().unwrap_or("main");
    array::write_text(name, &format!("{stage} {entry_point}"));
    array::write_text(description, &place.to_string());
}

/// An executable of a pipeline, and its module if that was captured.
///
/// # Errors
/// `VK_ERROR_UNKNOWN` for an invalid index.
///
/// # Safety
/// The info is valid.
unsafe fn executable<'a>(
    info: &vk::PipelineExecutableInfoKHR<'_>,
) -> VkResult<(&'a Program, Option<Module>)> {
    // SAFETY: the caller guarantees that the info is valid.
    let pipeline = unsafe { from_handle::<'a, Pipeline>(info.pipeline) };
    let programs = pipeline.programs();
    let program = programs.get(info.executable_index as usize);
    let program: &Program = program.ok_or(vk::Result::ERROR_UNKNOWN)?;
    Ok((program, pipeline.captured.module(program)))
}

pub(crate) unsafe extern "system" fn vkGetPipelineExecutablePropertiesKHR(
    _device: vk::Device,
    info: *const vk::PipelineInfoKHR<'_>,
    count: *mut u32,
    out: *mut vk::PipelineExecutablePropertiesKHR<'_>,
) -> vk::Result {
    guard_result("vkGetPipelineExecutablePropertiesKHR", move || {
        let programs = from_handle::<Pipeline>((*info).pipeline).programs();
        enumerate_with(count, out, programs.into_iter(), |out, program| {
            out.stages = stage_flag(program.stage());
            out.subgroup_size = SUBGROUP_SIZE as u32;
            describe(program, &mut out.name, &mut out.description);
        })
    })
}

pub(crate) unsafe extern "system" fn vkGetPipelineExecutableStatisticsKHR(
    _device: vk::Device,
    info: *const vk::PipelineExecutableInfoKHR<'_>,
    count: *mut u32,
    out: *mut vk::PipelineExecutableStatisticKHR<'_>,
) -> vk::Result {
    guard_result("vkGetPipelineExecutableStatisticsKHR", move || {
        let (program, module) = executable(&*info)?;
        let all = statistics(program, module.as_ref());
        enumerate_with(count, out, all.into_iter(), write_statistic)
    })
}

/// The optimized IR and native code as text, if the module was captured.
pub(crate) unsafe extern "system" fn vkGetPipelineExecutableInternalRepresentationsKHR(
    _device: vk::Device,
    info: *const vk::PipelineExecutableInfoKHR<'_>,
    count: *mut u32,
    out: *mut vk::PipelineExecutableInternalRepresentationKHR<'_>,
) -> vk::Result {
    guard_result(
        "vkGetPipelineExecutableInternalRepresentationsKHR",
        move || {
            let (program, module) = executable(&*info)?;
            let all = module.map_or_else(Vec::new, |module| representations(program, &module));
            let mut written = Ok(());
            enumerate_with(count, out, all.into_iter(), |out, representation| {
                written = written.and(write_representation(out, representation));
            })?;
            written
        },
    )
}
