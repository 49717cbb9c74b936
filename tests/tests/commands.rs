//! Commands, queues and everything that waits.

use tuff_tests::*;

/// A word, and what doubles it and adds a pushed number.
struct Doubling {
    gpu: Gpu,
    buffer: Buffer,
    set: Set,
    kernel: Kernel,
}

impl Doubling {
    fn new(word: u32) -> Doubling {
        let gpu = Gpu::new();
        let buffer = gpu.buffer_with(&[word]);
        let set = gpu.set_of(&[buffer.into()]);
        let kernel = double_shader(&gpu, &set);
        Doubling {
            gpu,
            buffer,
            set,
            kernel,
        }
    }

    fn record(&self, commands: vk::CommandBuffer, add: u32) {
        (self.gpu).record_dispatch(commands, self.kernel, &[self.set], &[add], [1, 1, 1]);
    }

    /// Commands for one step, and a barrier.
    fn step(&self, add: u32) -> vk::CommandBuffer {
        self.gpu.record(|commands| {
            self.record(commands, add);
            self.gpu.barrier(commands);
        })
    }

    fn word(&self) -> u32 {
        self.buffer.read()[0]
    }
}

fn double_shader(gpu: &Gpu, set: &Set) -> Kernel {
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer B { uint b; };
    layout(push_constant) uniform Push { uint add; };
    void main() { b = b * 2u + add; }";
    gpu.kernel(source, &[set.layout])
}

#[test]
fn copies_fills_and_updates() {
    let gpu = Gpu::new();
    let from = gpu.buffer_with(&(0..256).collect::<Vec<u32>>());
    let to = gpu.buffer(1024);
    let data: Vec<u8> = (0..64).map(|i| 200 + i as u8 % 40).collect();
    gpu.run(|commands| {
        let copy = |from: u64, to: u64, size: u64| vk::BufferCopy {
            src_offset: from,
            dst_offset: to,
            size,
        };
        let copies = [copy(4, 0, 8), copy(41, 513, 3), copy(400, 100, 200)];
        // SAFETY: the ranges lie inside the buffers and do not overlap.
        unsafe {
            gpu.device
                .cmd_fill_buffer(commands, to.handle, 0, vk::WHOLE_SIZE, 0xaabb_ccdd);
            gpu.barrier(commands);
            gpu.device
                .cmd_copy_buffer(commands, from.handle, to.handle, &copies);
            gpu.device.cmd_fill_buffer(commands, to.handle, 20, 12, 7);
            gpu.device
                .cmd_update_buffer(commands, to.handle, 700, &data);
        }
    });
    let source: Vec<u8> = from.read();
    let mut expected = [0xdd, 0xcc, 0xbb, 0xaa].repeat(256);
    expected[0..8].copy_from_slice(&source[4..12]);
    expected[513..516].copy_from_slice(&source[41..44]);
    expected[100..300].copy_from_slice(&source[400..600]);
    expected[20..32].copy_from_slice(&[7, 0, 0, 0].repeat(3));
    expected[700..764].copy_from_slice(&data);
    assert_eq!(to.read::<u8>(), expected);
}

#[test]
fn command_buffers_run_again_and_in_order() {
    let it = Doubling::new(1);
    let gpu = &it.gpu;
    let step = |add: u32| {
        gpu.record(|commands| {
            gpu.barrier(commands);
            it.record(commands, add);
            gpu.barrier(commands);
        })
    };
    let (one, two) = (step(1), step(5));
    let (first, second) = ([one, two], [two]);
    let submits = [
        vk::SubmitInfo::default().command_buffers(&first),
        vk::SubmitInfo::default().command_buffers(&second),
    ];
    // SAFETY: the buffers are of this device; `two` is submitted twice in one batch, which needs
    // simultaneous use, so it is submitted apart.
    unsafe {
        gpu.device
            .queue_submit(gpu.queue, &submits[..1], vk::Fence::null())
            .expect("a submission");
        gpu.device.queue_wait_idle(gpu.queue).expect("idleness");
        gpu.device
            .queue_submit(gpu.queue, &submits[1..], vk::Fence::null())
            .expect("a submission");
        gpu.device.device_wait_idle().expect("idleness");
    }
    assert_eq!(it.word(), ((2 + 1) * 2 + 5) * 2 + 5);
}

#[test]
fn secondary_command_buffers() {
    let it = Doubling::new(3);
    let gpu = &it.gpu;
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .level(vk::CommandBufferLevel::SECONDARY)
        .command_buffer_count(2);
    // SAFETY: the command buffers are of this device and outlive their execution.
    unsafe {
        let secondary = gpu
            .device
            .allocate_command_buffers(&info)
            .expect("command buffers");
        for (i, commands) in secondary.iter().enumerate() {
            let inheritance = vk::CommandBufferInheritanceInfo::default();
            let begin = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::SIMULTANEOUS_USE)
                .inheritance_info(&inheritance);
            gpu.device
                .begin_command_buffer(*commands, &begin)
                .expect("a beginning");
            it.record(*commands, 10 * i as u32 + 1);
            gpu.barrier(*commands);
            gpu.device.end_command_buffer(*commands).expect("an end");
        }
        gpu.run(|commands| {
            gpu.device.cmd_execute_commands(commands, &secondary);
            gpu.device.cmd_execute_commands(commands, &secondary[..1]);
        });
    }
    assert_eq!(it.word(), ((3 * 2 + 1) * 2 + 11) * 2 + 1);
}

#[test]
fn timeline_semaphores_order_submissions_and_the_host() {
    let it = Doubling::new(1);
    let gpu = &it.gpu;
    let mut kind = vk::SemaphoreTypeCreateInfo::default()
        .semaphore_type(vk::SemaphoreType::TIMELINE)
        .initial_value(10);
    let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
    // SAFETY: the semaphore outlives its uses.
    unsafe {
        let semaphore = gpu
            .device
            .create_semaphore(&info, None)
            .expect("a semaphore");
        let semaphores = [semaphore];
        let stage = [vk::PipelineStageFlags::ALL_COMMANDS];
        for (wait, signal, add) in [(11, 12, 1), (12, 15, 2)] {
            let (waits, signals, buffers) = ([wait], [signal], [it.step(add)]);
            let mut values = vk::TimelineSemaphoreSubmitInfo::default()
                .wait_semaphore_values(&waits)
                .signal_semaphore_values(&signals);
            let submit = vk::SubmitInfo::default()
                .wait_semaphores(&semaphores)
                .wait_dst_stage_mask(&stage)
                .signal_semaphores(&semaphores)
                .command_buffers(&buffers)
                .push_next(&mut values);
            gpu.device
                .queue_submit(gpu.queue, &[submit], vk::Fence::null())
                .expect("a submission");
        }
        let wait = |value: u64, patience: u64| {
            let values = [value];
            let info = vk::SemaphoreWaitInfo::default()
                .semaphores(&semaphores)
                .values(&values);
            gpu.device.wait_semaphores(&info, patience)
        };
        assert_eq!(wait(12, 20_000_000), Err(vk::Result::TIMEOUT));
        assert_eq!(gpu.device.get_semaphore_counter_value(semaphore), Ok(10));
        assert_eq!(it.word(), 1);
        let signal = vk::SemaphoreSignalInfo::default()
            .semaphore(semaphore)
            .value(11);
        gpu.device.signal_semaphore(&signal).expect("a signal");
        assert_eq!(wait(15, PATIENCE_NS), Ok(()));
        assert_eq!(wait(3, 0), Ok(()));
        assert_eq!(gpu.device.get_semaphore_counter_value(semaphore), Ok(15));
        assert_eq!(it.word(), (2 + 1) * 2 + 2);
        gpu.device.device_wait_idle().expect("idleness");
        gpu.device.destroy_semaphore(semaphore, None);
    }
}

#[test]
fn binary_semaphores_and_fences() {
    let it = Doubling::new(1);
    let gpu = &it.gpu;
    // SAFETY: the objects outlive their uses.
    unsafe {
        let semaphore = gpu
            .device
            .create_semaphore(&Default::default(), None)
            .expect("a semaphore");
        let fence = gpu
            .device
            .create_fence(&Default::default(), None)
            .expect("a fence");
        let signaled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        let ready = gpu.device.create_fence(&signaled, None).expect("a fence");
        assert_eq!(gpu.device.get_fence_status(fence), Ok(false));
        assert_eq!(gpu.device.get_fence_status(ready), Ok(true));
        let both = [fence, ready];
        assert_eq!(
            gpu.device.wait_for_fences(&both, true, 1_000_000),
            Err(vk::Result::TIMEOUT)
        );
        assert_eq!(gpu.device.wait_for_fences(&both, false, 1_000_000), Ok(()));
        let semaphores = [semaphore];
        let stage = [vk::PipelineStageFlags::COMPUTE_SHADER];
        let (one, two) = ([it.step(1)], [it.step(2)]);
        let signal = vk::SubmitInfo::default()
            .command_buffers(&one)
            .signal_semaphores(&semaphores);
        let wait = vk::SubmitInfo::default()
            .command_buffers(&two)
            .wait_semaphores(&semaphores)
            .wait_dst_stage_mask(&stage);
        gpu.device
            .queue_submit(gpu.queue, &[signal, wait], fence)
            .expect("a submission");
        gpu.device
            .wait_for_fences(&[fence], true, PATIENCE_NS)
            .expect("an end");
        assert_eq!(it.word(), 8);
        gpu.device.reset_fences(&[fence]).expect("a reset");
        assert_eq!(gpu.device.get_fence_status(fence), Ok(false));
        // A submission of nothing still signals.
        gpu.device
            .queue_submit(gpu.queue, &[], fence)
            .expect("a submission");
        gpu.device
            .wait_for_fences(&[fence], true, PATIENCE_NS)
            .expect("an end");
        gpu.device.device_wait_idle().expect("idleness");
        gpu.device.destroy_fence(fence, None);
        gpu.device.destroy_fence(ready, None);
        gpu.device.destroy_semaphore(semaphore, None);
    }
}

#[test]
fn the_second_form_of_submission_and_barriers() {
    let it = Doubling::new(1);
    let gpu = &it.gpu;
    let commands = gpu.record(|commands| {
        for add in 1..=3u32 {
            it.record(commands, add);
            let barrier = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
                .dst_stage_mask(
                    vk::PipelineStageFlags2::COMPUTE_SHADER | vk::PipelineStageFlags2::HOST,
                )
                .dst_access_mask(
                    vk::AccessFlags2::SHADER_STORAGE_READ
                        | vk::AccessFlags2::SHADER_STORAGE_WRITE
                        | vk::AccessFlags2::HOST_READ,
                )];
            let info = vk::DependencyInfo::default().memory_barriers(&barrier);
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_pipeline_barrier2(commands, &info) };
        }
    });
    let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
    let submit = vk::SubmitInfo2::default().command_buffer_infos(&buffers);
    // SAFETY: the fence and the commands outlive the wait.
    unsafe {
        let fence = gpu
            .device
            .create_fence(&Default::default(), None)
            .expect("a fence");
        gpu.device
            .queue_submit2(gpu.queue, &[submit], fence)
            .expect("a submission");
        gpu.device
            .wait_for_fences(&[fence], true, PATIENCE_NS)
            .expect("an end");
        gpu.device.destroy_fence(fence, None);
    }
    assert_eq!(it.word(), ((2 + 1) * 2 + 2) * 2 + 3);
}

#[test]
fn events_are_set_by_the_device_and_by_the_host() {
    let gpu = Gpu::new();
    let all = vk::PipelineStageFlags::ALL_COMMANDS;
    // SAFETY: the event outlives its uses.
    unsafe {
        let event = gpu
            .device
            .create_event(&Default::default(), None)
            .expect("an event");
        assert_eq!(gpu.device.get_event_status(event), Ok(false));
        gpu.run(|commands| {
            gpu.device.cmd_set_event(commands, event, all);
            gpu.device
                .cmd_wait_events(commands, &[event], all, all, &[], &[], &[]);
        });
        assert_eq!(gpu.device.get_event_status(event), Ok(true));
        gpu.run(|commands| gpu.device.cmd_reset_event(commands, event, all));
        assert_eq!(gpu.device.get_event_status(event), Ok(false));
        gpu.device.set_event(event).expect("a set event");
        assert_eq!(gpu.device.get_event_status(event), Ok(true));
        gpu.device.reset_event(event).expect("a reset event");
        assert_eq!(gpu.device.get_event_status(event), Ok(false));
        gpu.device.destroy_event(event, None);
    }
}

#[test]
fn timestamps_grow() {
    let gpu = Gpu::new();
    let info = vk::QueryPoolCreateInfo::default()
        .query_type(vk::QueryType::TIMESTAMP)
        .query_count(4);
    let buffer = gpu.buffer(8 * 4);
    // SAFETY: the pool outlives its uses.
    unsafe {
        let families = gpu
            .instance
            .get_physical_device_queue_family_properties(gpu.physical);
        let clock = families[gpu.family as usize].timestamp_valid_bits != 0;
        if !has("timestamps", clock) {
            return;
        }
        let pool = gpu.device.create_query_pool(&info, None).expect("a pool");
        gpu.device.reset_query_pool(pool, 0, 4);
        let wait = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        gpu.run(|commands| {
            gpu.device.cmd_reset_query_pool(commands, pool, 0, 4);
            for i in 0..3 {
                let stage = vk::PipelineStageFlags::ALL_COMMANDS;
                gpu.device.cmd_write_timestamp(commands, stage, pool, i);
            }
            let out = buffer.handle;
            gpu.device
                .cmd_copy_query_pool_results(commands, pool, 0, 3, out, 0, 8, wait);
        });
        let mut times = [0u64; 3];
        gpu.device
            .get_query_pool_results(pool, 0, &mut times, wait)
            .expect("results");
        assert!(
            times[0] != 0 && times[0] <= times[1] && times[1] <= times[2],
            "{times:?}"
        );
        assert_eq!(buffer.read::<u64>()[..3], times);
        let mut available = [[7u64; 2]; 4];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
        let partly = gpu
            .device
            .get_query_pool_results(pool, 0, &mut available, flags);
        assert_eq!(partly, Err(vk::Result::NOT_READY));
        assert_eq!(available.map(|[_, available]| available), [1, 1, 1, 0]);
        gpu.device.destroy_query_pool(pool, None);
    }
}

#[test]
fn pipeline_caches_are_saved_and_loaded() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer B { uint b; };
    void main() { b += 5u; }";
    let buffer = gpu.buffer(4);
    let set = gpu.set_of(&[buffer.into()]);
    let layout = gpu.layout(&[set.layout]);
    let module = gpu.module(&glsl(Stage::Compute, source));
    let build = |cache: vk::PipelineCache| {
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout);
        // SAFETY: the structures outlive the call, and the pipeline its use.
        unsafe {
            let made = gpu.device.create_compute_pipelines(cache, &[info], None);
            let pipeline = made.expect("a pipeline")[0];
            gpu.dispatch::<u32>(Kernel { pipeline, layout }, &[set], &[], [1, 1, 1]);
            gpu.device.destroy_pipeline(pipeline, None);
        }
    };
    // SAFETY: the caches outlive their uses.
    unsafe {
        let empty = gpu
            .device
            .create_pipeline_cache(&Default::default(), None)
            .expect("a cache");
        build(empty);
        let data = gpu.device.get_pipeline_cache_data(empty).expect("data");
        // The header of version one.
        let word = |i: usize| u32::from_le_bytes(data[4 * i..4 * i + 4].try_into().unwrap());
        let properties = gpu.instance.get_physical_device_properties(gpu.physical);
        let why = "the header of a cache's data is cut off before its UUID";
        unless_known(&gpu, "llvmpipe", why, || assert!(data.len() >= 32));
        assert!(word(0) == 32 && word(1) == 1, "{data:?}");
        assert_eq!(
            (word(2), word(3)),
            (properties.vendor_id, properties.device_id)
        );
        assert!(data.len() < 32 || data[16..32] == properties.pipeline_cache_uuid);
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
        let loaded = gpu
            .device
            .create_pipeline_cache(&info, None)
            .expect("a cache");
        build(loaded);
        gpu.device
            .merge_pipeline_caches(empty, &[loaded])
            .expect("a merger");
        build(empty);
        for cache in [empty, loaded] {
            gpu.device.destroy_pipeline_cache(cache, None);
        }
    }
    assert_eq!(buffer.read::<u32>(), [15]);
}

#[test]
fn push_descriptors_and_update_templates() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer B { uint b; } buffers[2];
    void main() { buffers[0].b += 3u; buffers[1].b += 30u; }";
    let stored = [gpu.buffer_with(&[1u32]), gpu.buffer_with(&[2u32])];
    let bound = stored.map(Bound::Storage);
    let infos = stored.map(|buffer| {
        vk::DescriptorBufferInfo::default()
            .buffer(buffer.handle)
            .range(vk::WHOLE_SIZE)
    });
    let point = vk::PipelineBindPoint::COMPUTE;
    // SAFETY: the objects outlive their uses.
    unsafe {
        if let Some(push) = &gpu.push_descriptor {
            let flags = vk::DescriptorSetLayoutCreateFlags::PUSH_DESCRIPTOR_KHR;
            let layout = gpu.set_layout(&[(0, &bound)], flags);
            let kernel = gpu.kernel(source, &[layout]);
            gpu.run(|commands| {
                gpu.device
                    .cmd_bind_pipeline(commands, point, kernel.pipeline);
                let write = vk::WriteDescriptorSet::default()
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(&infos);
                push.cmd_push_descriptor_set(commands, point, kernel.layout, 0, &[write]);
                gpu.device.cmd_dispatch(commands, 1, 1, 1);
            });
            assert_eq!(stored.map(|buffer| buffer.read::<u32>()[0]), [4, 32]);
        }
        let set = gpu.set(&[(0, &bound)]);
        let entries = [vk::DescriptorUpdateTemplateEntry::default()
            .descriptor_count(2)
            .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
            .offset(8)
            .stride(size_of::<vk::DescriptorBufferInfo>())];
        let info = vk::DescriptorUpdateTemplateCreateInfo::default()
            .descriptor_update_entries(&entries)
            .template_type(vk::DescriptorUpdateTemplateType::DESCRIPTOR_SET)
            .descriptor_set_layout(set.layout);
        let template = gpu
            .device
            .create_descriptor_update_template(&info, None)
            .expect("a template");
        // The other way around.
        #[repr(C)]
        struct Data(u64, [vk::DescriptorBufferInfo; 2]);
        let data = Data(0, [infos[1], infos[0]]);
        let start = (&raw const data).cast();
        gpu.device
            .update_descriptor_set_with_template(set.handle, template, start);
        gpu.device
            .destroy_descriptor_update_template(template, None);
        let before = stored.map(|buffer| buffer.read::<u32>()[0]);
        let kernel = gpu.kernel(source, &[set.layout]);
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        let after = stored.map(|buffer| buffer.read::<u32>()[0]);
        assert_eq!(after, [before[0] + 30, before[1] + 3]);
    }
}

#[test]
fn descriptors_are_copied_and_pools_run_out() {
    let gpu = Gpu::new();
    let (one, two) = (gpu.buffer_with(&[10u32]), gpu.buffer_with(&[20u32]));
    let from = gpu.set(&[(0, &[Bound::Storage(one), Bound::Storage(two)])]);
    let to = gpu.set_of(&[one.into()]);
    let copy = vk::CopyDescriptorSet::default()
        .src_set(from.handle)
        .src_array_element(1)
        .dst_set(to.handle)
        .descriptor_count(1);
    // SAFETY: the sets are not in use.
    unsafe { gpu.device.update_descriptor_sets(&[], &[copy]) };
    let kernel = double_shader(&gpu, &to);
    gpu.dispatch(kernel, &[to], &[1u32], [1, 1, 1]);
    assert_eq!((one.read::<u32>()[0], two.read::<u32>()[0]), (10, 41));

    let sizes = [vk::DescriptorPoolSize {
        ty: vk::DescriptorType::STORAGE_BUFFER,
        descriptor_count: 2,
    }];
    let flags = vk::DescriptorPoolCreateFlags::FREE_DESCRIPTOR_SET;
    let info = vk::DescriptorPoolCreateInfo::default()
        .flags(flags)
        .max_sets(2)
        .pool_sizes(&sizes);
    // SAFETY: the pool outlives its sets.
    unsafe {
        let pool = gpu
            .device
            .create_descriptor_pool(&info, None)
            .expect("a pool");
        let layouts = [to.layout];
        let allocate = || {
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&layouts);
            gpu.device.allocate_descriptor_sets(&info)
        };
        let sets = [allocate().expect("a set")[0], allocate().expect("a set")[0]];
        // A pool may have room to spare; one that has not must say so.
        let third = allocate();
        assert!(
            third.is_ok() || third == Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY),
            "{third:?}"
        );
        gpu.device
            .free_descriptor_sets(pool, &sets[..1])
            .expect("a free set");
        allocate().expect("a set again");
        gpu.device
            .reset_descriptor_pool(pool, vk::DescriptorPoolResetFlags::empty())
            .expect("a reset");
        allocate().expect("a set after the reset");
        gpu.device.destroy_descriptor_pool(pool, None);
    }
}
