//! `VK_KHR_pipeline_binary` and `VK_KHR_pipeline_executable_properties`.

use std::ffi::{CStr, c_void};

use tuff_tests::heaps::{Heaps, WITH_HEAPS, chained};
use tuff_tests::*;
use vk::Handle;
use vk::PipelineCreateFlags as Flags;

/// `VK_PIPELINE_CREATE_2_CAPTURE_DATA_BIT_KHR`.
const CAPTURE_DATA: vk::PipelineCreateFlags2KHR = vk::PipelineCreateFlags2KHR::from_raw(1 << 31);

const SQUARES: &str = r"
layout(local_size_x = 16) in;
layout(set = 0, binding = 0, std430) buffer R { uint results[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    results[i] = i * i + 3u;
}";

/// `VkPipelineBinaryKeyKHR`.
#[repr(C)]
#[derive(Clone, Copy)]
struct PipelineBinaryKeyKHR {
    s_type: vk::StructureType,
    p_next: *mut c_void,
    key_size: u32,
    key: [u8; 32],
}

impl Default for PipelineBinaryKeyKHR {
    fn default() -> Self {
        Self {
            s_type: vk::StructureType::from_raw(1_000_483_003),
            p_next: std::ptr::null_mut(),
            key_size: 0,
            key: [0; 32],
        }
    }
}

/// `VkPipelineBinaryDataKHR`.
#[repr(C)]
struct PipelineBinaryDataKHR {
    data_size: usize,
    p_data: *const c_void,
}

/// `VkPipelineBinaryKeysAndDataKHR`.
#[repr(C)]
struct PipelineBinaryKeysAndDataKHR {
    binary_count: u32,
    p_pipeline_binary_keys: *const PipelineBinaryKeyKHR,
    p_pipeline_binary_data: *const PipelineBinaryDataKHR,
}

/// `VkPipelineBinaryCreateInfoKHR`.
#[repr(C)]
struct PipelineBinaryCreateInfoKHR {
    s_type: vk::StructureType,
    p_next: *const c_void,
    p_keys_and_data_info: *const PipelineBinaryKeysAndDataKHR,
    pipeline: vk::Pipeline,
    p_pipeline_create_info: *const c_void,
}

/// `VkPipelineBinaryInfoKHR` and, with a pointer to write to, `VkPipelineBinaryHandlesInfoKHR`.
#[repr(C)]
struct PipelineBinariesKHR {
    s_type: vk::StructureType,
    p_next: *const c_void,
    binary_count: u32,
    p_pipeline_binaries: *mut u64,
}

/// A structure of a type, a chain and a handle: `VkPipelineBinaryDataInfoKHR`,
/// `VkReleaseCapturedPipelineDataInfoKHR` and, with the chain as what counts,
/// `VkPipelineCreateInfoKHR`.
#[repr(C)]
struct OneHandle {
    s_type: vk::StructureType,
    p_next: *const c_void,
    handle: u64,
}

type CreateBinaries = unsafe extern "system" fn(
    vk::Device,
    *const PipelineBinaryCreateInfoKHR,
    *const c_void,
    *mut PipelineBinariesKHR,
) -> vk::Result;
type DestroyBinary = unsafe extern "system" fn(vk::Device, u64, *const c_void);
type BinaryData = unsafe extern "system" fn(
    vk::Device,
    *const OneHandle,
    *mut PipelineBinaryKeyKHR,
    *mut usize,
    *mut c_void,
) -> vk::Result;
type PipelineKey = unsafe extern "system" fn(
    vk::Device,
    *const OneHandle,
    *mut PipelineBinaryKeyKHR,
) -> vk::Result;
type Release = unsafe extern "system" fn(vk::Device, *const OneHandle, *const c_void) -> vk::Result;

fn of_type(ty: i32, handle: u64) -> OneHandle {
    OneHandle {
        s_type: vk::StructureType::from_raw(1_000_483_000 + ty),
        p_next: std::ptr::null(),
        handle,
    }
}

fn binaries_info(ty: i32, binaries: &mut [u64]) -> PipelineBinariesKHR {
    PipelineBinariesKHR {
        s_type: vk::StructureType::from_raw(1_000_483_000 + ty),
        p_next: std::ptr::null(),
        binary_count: binaries.len() as u32,
        p_pipeline_binaries: binaries.as_mut_ptr(),
    }
}

/// The commands of the extension.
struct Binaries<'a> {
    gpu: &'a Gpu,
    create: CreateBinaries,
    destroy: DestroyBinary,
    data: BinaryData,
    key: PipelineKey,
    release: Release,
}

impl<'a> Binaries<'a> {
    fn of(gpu: &'a Gpu) -> Self {
        let device = gpu.device.handle();
        let find = |name: &CStr| {
            // SAFETY: the device has the extension.
            let found =
                unsafe { (gpu.instance.fp_v1_0().get_device_proc_addr)(device, name.as_ptr()) };
            found.expect("a command of VK_KHR_pipeline_binary")
        };
        // SAFETY: these are the types of the commands.
        unsafe {
            Self {
                gpu,
                create: std::mem::transmute::<_, CreateBinaries>(find(
                    c"vkCreatePipelineBinariesKHR",
                )),
                destroy: std::mem::transmute::<_, DestroyBinary>(find(
                    c"vkDestroyPipelineBinaryKHR",
                )),
                data: std::mem::transmute::<_, BinaryData>(find(c"vkGetPipelineBinaryDataKHR")),
                key: std::mem::transmute::<_, PipelineKey>(find(c"vkGetPipelineKeyKHR")),
                release: std::mem::transmute::<_, Release>(find(
                    c"vkReleaseCapturedPipelineDataKHR",
                )),
            }
        }
    }

    /// The binaries of a pipeline or, without one, of data.
    fn create(
        &self,
        pipeline: vk::Pipeline,
        stored: &[(PipelineBinaryKeyKHR, Vec<u8>)],
    ) -> Result<Vec<u64>, vk::Result> {
        let keys: Vec<_> = stored.iter().map(|it| it.0).collect();
        let data = stored.iter().map(|(_, data)| PipelineBinaryDataKHR {
            data_size: data.len(),
            p_data: data.as_ptr().cast(),
        });
        let data: Vec<_> = data.collect();
        let keys_and_data = PipelineBinaryKeysAndDataKHR {
            binary_count: stored.len() as u32,
            p_pipeline_binary_keys: keys.as_ptr(),
            p_pipeline_binary_data: data.as_ptr(),
        };
        let info = PipelineBinaryCreateInfoKHR {
            s_type: vk::StructureType::from_raw(1_000_483_001),
            p_next: std::ptr::null(),
            p_keys_and_data_info: match pipeline.is_null() {
                true => &raw const keys_and_data,
                false => std::ptr::null(),
            },
            pipeline,
            p_pipeline_create_info: std::ptr::null(),
        };
        let device = self.gpu.device.handle();
        let mut handles = binaries_info(9, &mut []);
        handles.p_pipeline_binaries = std::ptr::null_mut();
        // SAFETY: the structures outlive the calls.
        unsafe {
            (self.create)(device, &info, std::ptr::null(), &mut handles).result()?;
            let mut all = vec![0; handles.binary_count as usize];
            handles.p_pipeline_binaries = all.as_mut_ptr();
            (self.create)(device, &info, std::ptr::null(), &mut handles).result()?;
            Ok(all)
        }
    }

    fn stored(&self, binary: u64) -> (PipelineBinaryKeyKHR, Vec<u8>) {
        let (info, device) = (of_type(6, binary), self.gpu.device.handle());
        let mut key = PipelineBinaryKeyKHR::default();
        let mut size = 0;
        // SAFETY: the data has room for as much as is asked for.
        unsafe {
            let sized = (self.data)(device, &info, &mut key, &mut size, std::ptr::null_mut());
            assert_eq!(sized, vk::Result::SUCCESS);
            let mut data = vec![0xA5u8; size];
            let mut room = size - 1;
            let short = (self.data)(device, &info, &mut key, &mut room, data.as_mut_ptr().cast());
            // `VK_ERROR_NOT_ENOUGH_SPACE_KHR`, and nothing is written.
            assert_eq!(short, vk::Result::from_raw(-1_000_483_000));
            assert_eq!(room, size);
            assert!(data.iter().all(|&byte| byte == 0xA5));
            let all = (self.data)(device, &info, &mut key, &mut room, data.as_mut_ptr().cast());
            assert_eq!(all, vk::Result::SUCCESS);
            assert!((1..=32).contains(&key.key_size));
            (key, data)
        }
    }

    /// A kernel from binaries, without a module.
    fn kernel(
        &self,
        layout: vk::PipelineLayout,
        binaries: &mut [u64],
    ) -> Result<Kernel, vk::Result> {
        let binary_info = binaries_info(2, binaries);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .name(c"main");
        let mut info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout);
        info.p_next = (&raw const binary_info).cast();
        // SAFETY: the structures outlive the call.
        let made = unsafe {
            (self.gpu.device).create_compute_pipelines(vk::PipelineCache::null(), &[info], None)
        };
        let pipeline = made.map_err(|(_, error)| error)?[0];
        self.gpu.keep_pipeline(pipeline);
        Ok(Kernel { pipeline, layout })
    }

    fn pipeline_key(&self, create_info: *const c_void) -> Vec<u8> {
        let mut key = PipelineBinaryKeyKHR::default();
        let info = OneHandle {
            p_next: create_info,
            ..of_type(7, 0)
        };
        let info = match create_info.is_null() {
            true => std::ptr::null(),
            false => &raw const info,
        };
        // SAFETY: the structures outlive the call.
        let result = unsafe { (self.key)(self.gpu.device.handle(), info, &mut key) };
        assert_eq!(result, vk::Result::SUCCESS);
        key.key[..key.key_size as usize].to_vec()
    }
}

#[test]
fn a_pipeline_is_made_of_its_stored_binary() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 294));
    let Some(gpu) = gpu.with("VK_KHR_pipeline_binary", |gpu| {
        gpu.optional.pipeline_binary.pipeline_binaries != 0
    }) else {
        return;
    };
    let api = Binaries::of(&gpu);
    let results = gpu.buffer(64 * 4);
    let set = gpu.set_of(&[results.into()]);
    let layout = gpu.layout(&[set.layout]);
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .module(gpu.module(&glsl(Stage::Compute, SQUARES)))
        .name(c"main");
    let capture = vk::PipelineCreateFlags2CreateInfoKHR::default().flags(CAPTURE_DATA);
    let mut info = vk::ComputePipelineCreateInfo::default()
        .stage(stage)
        .layout(layout);
    info.p_next = (&raw const capture).cast();
    // SAFETY: the structures outlive the call.
    let made =
        unsafe { (gpu.device).create_compute_pipelines(vk::PipelineCache::null(), &[info], None) };
    let original = made.expect("vkCreateComputePipelines")[0];
    gpu.keep_pipeline(original);

    let binaries = api.create(original, &[]).expect("binaries of a pipeline");
    assert!(!binaries.is_empty());
    let stored: Vec<_> = binaries.iter().map(|&it| api.stored(it)).collect();
    // The pipeline's captures go; the binaries stay.
    let released = of_type(5, original.as_raw());
    // SAFETY: the pipeline captured data, and did not release it yet.
    let result = unsafe { (api.release)(gpu.device.handle(), &released, std::ptr::null()) };
    assert_eq!(result, vk::Result::SUCCESS);
    let mut again = api
        .create(vk::Pipeline::null(), &stored)
        .expect("binaries of data");
    for (&binary, (key, data)) in again.iter().zip(&stored) {
        let (other_key, other_data) = api.stored(binary);
        assert_eq!(&other_data, data);
        let bytes = |key: &PipelineBinaryKeyKHR| key.key[..key.key_size as usize].to_vec();
        assert_eq!(bytes(&other_key), bytes(key));
    }
    let kernel = api
        .kernel(layout, &mut again)
        .expect("a pipeline of binaries");
    gpu.dispatch::<u32>(kernel, &[set], &[], [4, 1, 1]);
    let expected: Vec<u32> = (0..64).map(|i| i * i + 3).collect();
    assert_eq!(results.read::<u32>()[..64], expected[..]);

    if gpu.is_tuff() {
        // Tuff refuses damaged data. The specification leaves it undefined.
        let (key, mut data) = api.stored(again[0]);
        let last = data.len() - 1;
        data[last] ^= 1;
        let refused = api.create(vk::Pipeline::null(), &[(key, data)]);
        assert_eq!(refused.err(), Some(vk::Result::ERROR_INITIALIZATION_FAILED));
    }
    for binary in binaries.into_iter().chain(again) {
        // SAFETY: nothing uses the binaries any more.
        unsafe { (api.destroy)(gpu.device.handle(), binary, std::ptr::null()) };
    }
}

#[test]
fn keys_tell_pipelines_apart() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 294));
    let Some(gpu) = gpu.with("VK_KHR_pipeline_binary", |gpu| {
        gpu.optional.pipeline_binary.pipeline_binaries != 0
    }) else {
        return;
    };
    let api = Binaries::of(&gpu);
    let results = gpu.buffer(64);
    let layout = gpu.layout(&[gpu.set_of(&[results.into()]).layout]);
    let key = |source: &str| {
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(gpu.module(&glsl(Stage::Compute, source)))
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout);
        api.pipeline_key((&raw const info).cast())
    };
    let global = api.pipeline_key(std::ptr::null());
    assert!(!global.is_empty());
    assert_eq!(global, api.pipeline_key(std::ptr::null()));
    assert_eq!(key(SQUARES), key(SQUARES));
    assert_ne!(key(SQUARES), key(&SQUARES.replace("3u", "4u")));
}

#[test]
fn executables_show_their_statistics_and_ir() {
    let Some(gpu) = Gpu::new().with("VK_KHR_pipeline_executable_properties", |gpu| {
        gpu.optional.executables.pipeline_executable_info != 0
    }) else {
        return;
    };
    let api = ash::khr::pipeline_executable_properties::Device::new(&gpu.instance, &gpu.device);
    let results = gpu.buffer(64);
    let layout = gpu.set_of(&[results.into()]).layout;
    let flags = Flags::CAPTURE_STATISTICS_KHR | Flags::CAPTURE_INTERNAL_REPRESENTATIONS_KHR;
    let pipeline = gpu.kernel_with(SQUARES, &[layout], flags).pipeline;
    let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
    // SAFETY: the pipeline is alive, and was created with the flags.
    let executables = unsafe { api.get_pipeline_executable_properties(&info) };
    let executables = executables.expect("executables");
    let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline);
    for (index, executable) in (0..).zip(&executables) {
        let name = executable.name_as_c_str().expect("a terminated name");
        assert!(!name.is_empty());
        assert_ne!(executable.subgroup_size, 0);
        let info = info.executable_index(index);
        // SAFETY: the pipeline is alive, and was created with the flags.
        let statistics = unsafe { api.get_pipeline_executable_statistics(&info) };
        for statistic in statistics.expect("statistics") {
            assert!(!statistic.name_as_c_str().expect("a name").is_empty());
        }
        for text in texts(&gpu, &api, &info) {
            assert_eq!(text.last(), Some(&0));
        }
    }
    if gpu.is_tuff() {
        let [executable] = &executables[..] else {
            panic!("one program, one executable");
        };
        assert_eq!(executable.stages, vk::ShaderStageFlags::COMPUTE);
        // SAFETY: the pipeline is alive, and was created with the flags.
        let statistics = unsafe { api.get_pipeline_executable_statistics(&info) };
        let statistics = statistics.expect("statistics");
        let operations = (statistics.iter())
            .find(|it| it.name_as_c_str() == Ok(c"Operations"))
            .expect("operations are counted");
        // A product, a sum and a store at least.
        // SAFETY: counts are unsigned.
        assert!(unsafe { operations.value.u64 } >= 3);
        let count = |name: &std::ffi::CStr| {
            let found = (statistics.iter()).find(|it| it.name_as_c_str() == Ok(name));
            // SAFETY: as above; truth values are followed by zeros.
            unsafe { found.expect("it is counted").value.u64 }
        };
        let texts = texts(&gpu, &api, &info);
        let text = String::from_utf8(texts[0].clone()).expect("UTF-8");
        assert!(
            text.starts_with("module compute") && text.contains("imul"),
            "{text}"
        );
        // The product and the sum are one stretch on processors with AVX2.
        let is_native = count(c"Native Code") != 0;
        assert_eq!(texts.len(), 1 + usize::from(is_native));
        assert_eq!(count(c"Native Stretches") != 0, is_native);
        assert_eq!(count(c"Native Code Size") != 0, is_native);
        if is_native {
            let text = String::from_utf8(texts[1].clone()).expect("UTF-8");
            let stretches = text.lines().filter(|line| line.starts_with("stretch of "));
            assert_eq!(stretches.count() as u64, count(c"Native Stretches"));
            assert!(
                text.contains("vpmulld") && text.contains(": ret\n"),
                "{text}"
            );
            assert!(count(c"Native Operations") >= 2);
            assert!((1..=32).contains(&count(c"Vector Registers")));
        }
    }
}

/// The text forms of an executable, which are cut to fit and terminated where there is less room.
fn texts(
    gpu: &Gpu,
    api: &ash::khr::pipeline_executable_properties::Device,
    info: &vk::PipelineExecutableInfoKHR<'_>,
) -> Vec<Vec<u8>> {
    let query = api
        .fp()
        .get_pipeline_executable_internal_representations_khr;
    let device = gpu.device.handle();
    let mut count = 0;
    // SAFETY: the structures outlive the calls, and the data has room for as much as is asked for.
    unsafe {
        let result = query(device, info, &mut count, std::ptr::null_mut());
        assert_eq!(result, vk::Result::SUCCESS);
        let empty = vk::PipelineExecutableInternalRepresentationKHR::default();
        let mut all = vec![empty; count as usize];
        let result = query(device, info, &mut count, all.as_mut_ptr());
        assert_eq!(result, vk::Result::SUCCESS);
        let mut data: Vec<Vec<u8>> = all.iter().map(|it| vec![1; it.data_size]).collect();
        for (one, data) in all.iter_mut().zip(&mut data) {
            one.p_data = data.as_mut_ptr().cast();
            one.data_size = data.len() - 1;
        }
        let result = query(device, info, &mut count, all.as_mut_ptr());
        assert!(all.is_empty() || result == vk::Result::INCOMPLETE);
        for (one, data) in all.iter_mut().zip(&data) {
            assert_eq!(
                one.is_text == vk::FALSE || data[one.data_size - 1] == 0,
                true
            );
            one.data_size = data.len();
        }
        let result = query(device, info, &mut count, all.as_mut_ptr());
        assert_eq!(result, vk::Result::SUCCESS);
        let texts = all
            .iter()
            .zip(data)
            .filter(|(one, _)| one.is_text != vk::FALSE);
        texts.map(|(_, data)| data).collect()
    }
}

/// A kernel that uses heaps: of SPIR-V with mappings, captured, or of binaries without either.
fn kernel_with_heaps(
    it: &Heaps<'_>,
    source: Option<(&[u32], &[newer::DescriptorSetAndBindingMappingEXT])>,
    binaries: &mut [u64],
) -> vk::Pipeline {
    let binary_info = binaries_info(2, binaries);
    let capture = match source {
        Some(_) => CAPTURE_DATA,
        None => vk::PipelineCreateFlags2KHR::empty(),
    };
    let mut flags = vk::PipelineCreateFlags2CreateInfoKHR::default().flags(WITH_HEAPS | capture);
    flags.p_next = (&raw const binary_info).cast();
    let mappings = source.map(|(_, mappings)| chained(mappings));
    let mut stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .name(c"main");
    if let (Some((words, _)), Some(mappings)) = (source, &mappings) {
        stage = stage.module(it.gpu.module(words));
        stage.p_next = std::ptr::from_ref(mappings).cast();
    }
    let mut info = vk::ComputePipelineCreateInfo::default().stage(stage);
    info.p_next = (&raw const flags).cast();
    // SAFETY: the structures outlive the call.
    let made = unsafe {
        (it.gpu.device).create_compute_pipelines(vk::PipelineCache::null(), &[info], None)
    };
    let pipeline = made.expect("vkCreateComputePipelines")[0];
    it.gpu.keep_pipeline(pipeline);
    pipeline
}

/// With binaries, mappings are ignored: binaries describe the samplers that programs embed, also to
/// a device that knows others.
#[test]
fn binaries_have_the_samplers_that_programs_embed() {
    let linear = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
        .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
    let other = linear.max_lod(0.5);
    let words = glsl(
        Stage::Compute,
        "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0) buffer R { float r[]; };
        layout(set = 0, binding = 1) uniform sampler2D image;
        void main() { r[0] = textureLod(image, vec2(0.5), 0.0).x; }",
    );
    let mut stored: Option<Vec<(PipelineBinaryKeyKHR, Vec<u8>)>> = None;
    for _ in 0..2 {
        let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 340));
        let there = gpu.optional.pipeline_binary.pipeline_binaries != 0
            && gpu.optional.heaps.descriptor_heap != 0;
        if !has("VK_KHR_pipeline_binary and VK_EXT_descriptor_heap", there) {
            return;
        }
        let (api, it) = (Binaries::of(&gpu), Heaps::new(&gpu, 8));
        let shape = Shape::flat(vk::Format::R32_SFLOAT, 2, 1);
        let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
        let picture = gpu.picture(shape, usage);
        gpu.upload(&picture, 0, &[1.0f32, 3.0]);
        let results = gpu.buffer(16);
        it.put_buffer(1, vk::DescriptorType::STORAGE_BUFFER, &results);
        it.put_picture(2, vk::DescriptorType::SAMPLED_IMAGE, &picture);
        let compiled = |sampler| {
            let mappings = [it.constant(0, 1), it.embedding(1, 2, sampler)];
            kernel_with_heaps(&it, Some((&words, &mappings)), &mut [])
        };
        let (kernel, binaries) = match &stored {
            None => {
                let kernel = compiled(&linear);
                let binaries = api.create(kernel, &[]).expect("binaries of a pipeline");
                stored = Some(binaries.iter().map(|&it| api.stored(it)).collect());
                (kernel, binaries)
            }
            Some(stored) => {
                compiled(&other);
                let binaries = api.create(vk::Pipeline::null(), stored);
                let mut binaries = binaries.expect("binaries of data");
                (kernel_with_heaps(&it, None, &mut binaries), binaries)
            }
        };
        gpu.run(|commands| {
            it.bind(commands);
            it.dispatch(commands, kernel);
        });
        assert_eq!(results.read::<f32>()[0], 2.0);
        for binary in binaries {
            // SAFETY: nothing uses the binaries any more.
            unsafe { (api.destroy)(gpu.device.handle(), binary, std::ptr::null()) };
        }
    }
}
