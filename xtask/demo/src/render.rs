//! The path tracer's host side: uploads a scene, builds its acceleration structures, and adds
//! samples to the picture band by band.

use std::time::Instant;

use anyhow::{Context as _, Result};
use ash::vk;
use bytemuck::{Pod, Zeroable};
use vk::{BufferUsageFlags as Usage, DescriptorType, ShaderStageFlags as Stage};

use crate::scene::{Camera, Scene};
use crate::structures::build_structures;
use crate::vulkan::{
    AccelerationStructure, Buffer, Context, HitGroup, Image, Pipeline, PipelineCache,
    PipelineInput, upload_images,
};

macro_rules! shader {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv"))
    };
}

const SHADERS: [(Stage, &[u8]); 9] = [
    (Stage::RAYGEN_KHR, shader!("path.rgen")),
    (Stage::MISS_KHR, shader!("sky.rmiss")),
    (Stage::MISS_KHR, shader!("shadow.rmiss")),
    (Stage::CLOSEST_HIT_KHR, shader!("surface.rchit")),
    (Stage::ANY_HIT_KHR, shader!("leaf.rahit")),
    (Stage::CLOSEST_HIT_KHR, shader!("procedural.rchit")),
    (Stage::INTERSECTION_KHR, shader!("sphere.rint")),
    (Stage::ANY_HIT_KHR, shader!("sphere.rahit")),
    (Stage::INTERSECTION_KHR, shader!("sponge.rint")),
];
const MISS: [u32; 2] = [1, 2];
/// An instance's offset into the binding table picks one of these.
const HIT: [HitGroup; 3] = [
    HitGroup::new(3, Some(4), None),
    HitGroup::new(5, Some(7), Some(6)),
    HitGroup::new(5, None, Some(8)),
];

/// `Frame` in scene.glsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Frame {
    camera_position: [f32; 4],
    camera_right: [f32; 4],
    camera_up: [f32; 4],
    camera_forward: [f32; 4],
    sun_direction: [f32; 4],
    sun_irradiance: [f32; 4],
    haze: [f32; 4],
    epsilon: f32,
    terrain_textures: [u32; 3],
    cloud_texture: u32,
    time: f32,
    unused: [u32; 2],
}

/// `Procedural` in scene.glsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ProceduralRecord {
    centre: [f32; 3],
    radius: f32,
    material: u32,
    unused: [u32; 3],
}

/// The parameters of the picture.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub width: u32,
    pub height: u32,
    /// The first of the rows that are rendered.
    pub first_row: u32,
    /// How many rows are rendered.
    pub rows: u32,
    /// The first of the columns whose paths are traced: those before it are drawn.
    pub first_column: u32,
    /// Samples per pixel.
    pub spp: u32,
    /// Surfaces that a path is followed to, 1 at least.
    pub bounces: u32,
    /// Of an animation with [`FRAMES_PER_SECOND`].
    pub frame: u16,
}

/// The bounces of a picture that is not told otherwise.
pub const BOUNCES: u32 = 8;

/// Frames of a second of the animation.
const FRAMES_PER_SECOND: f32 = 24.0;

/// A picture's sums, and its cost.
pub struct Rendering {
    /// Row-major sums of linear radiance, of the rows that were asked for; the fourth component
    /// counts samples.
    pub radiance: Vec<[f32; 4]>,
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// When the first pixels were there.
    pub first_pixel: Instant,
    /// From the first submission to the last one's end.
    pub seconds: f64,
}

/// A scene on the device.
pub struct DeviceScene<'a> {
    pub context: &'a Context,
    pub set_layout: vk::DescriptorSetLayout,
    /// Those of bindings 3 to 7.
    buffers: [Buffer<'a>; 5],
    images: Vec<Image<'a>>,
    /// The last is the top level.
    structures: Vec<AccelerationStructure<'a>>,
}

/// A picture of a scene, to which samples are added.
pub struct Renderer<'a> {
    pub context: &'a Context,
    pipeline: &'a Pipeline<'a>,
    pub settings: Settings,
    /// Sums of linear radiance, row by row; the fourth component counts samples.
    pub radiance: Buffer<'a>,
    ray_counts: Buffer<'a>,
    frame: Buffer<'a>,
    descriptor_pool: vk::DescriptorPool,
    pub set: vk::DescriptorSet,
}

/// The storage buffers' bindings are 1 to 7: sums, counts, then the scene.
const STORAGE_BINDINGS: std::ops::RangeInclusive<u32> = 1..=7;
const FRAME_BINDING: u32 = 8;
const TEXTURES_BINDING: u32 = 9;

/// The layout of the one descriptor set.
pub fn set_layout(context: &Context, textures: u32) -> Result<vk::DescriptorSetLayout> {
    let mut all = Stage::RAYGEN_KHR
        | Stage::MISS_KHR
        | Stage::CLOSEST_HIT_KHR
        | Stage::ANY_HIT_KHR
        | Stage::INTERSECTION_KHR;
    if context.draws {
        all |= Stage::VERTEX | Stage::FRAGMENT;
    }
    let binding = |binding: u32, kind: DescriptorType, count: u32| {
        vk::DescriptorSetLayoutBinding::default()
            .binding(binding)
            .descriptor_type(kind)
            .descriptor_count(count)
            .stage_flags(all)
    };
    let mut bindings = vec![binding(0, DescriptorType::ACCELERATION_STRUCTURE_KHR, 1)];
    bindings.extend(STORAGE_BINDINGS.map(|b| binding(b, DescriptorType::STORAGE_BUFFER, 1)));
    bindings.push(binding(FRAME_BINDING, DescriptorType::UNIFORM_BUFFER, 1));
    bindings.push(binding(
        TEXTURES_BINDING,
        DescriptorType::COMBINED_IMAGE_SAMPLER,
        textures,
    ));
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: `info` outlives the call.
    Ok(unsafe { context.device.create_descriptor_set_layout(&info, None) }?)
}

/// The pipeline, which differs between scenes only in the number of textures.
pub fn pipeline<'a>(
    context: &'a Context,
    set_layout: vk::DescriptorSetLayout,
    cache: &PipelineCache,
) -> Result<Pipeline<'a>> {
    let input = PipelineInput {
        shaders: &SHADERS,
        miss: &MISS,
        hit: &HIT,
        set_layout,
        push_bytes: size_of::<Launch>() as u32,
    };
    Pipeline::new(context, &input, cache)
}

/// The pipeline that writes the object at each pixel's centre; its groups are those of
/// [`pipeline`], except the shaders that color.
#[cfg(test)]
pub fn seen_pipeline<'a>(
    context: &'a Context,
    set_layout: vk::DescriptorSetLayout,
) -> Result<Pipeline<'a>> {
    let mut shaders = SHADERS;
    shaders[0].1 = shader!("seen.rgen");
    shaders[1].1 = shader!("seen.rmiss");
    for closest_hit in [3, 5] {
        shaders[closest_hit].1 = shader!("seen.rchit");
    }
    let input = PipelineInput {
        shaders: &shaders,
        miss: &MISS,
        hit: &HIT,
        set_layout,
        push_bytes: size_of::<Launch>() as u32,
    };
    Pipeline::new(context, &input, &PipelineCache::new(context, &[])?)
}

/// `Launch` in path.rgen.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Launch {
    sample_index: u32,
    first_row: u32,
    first_column: u32,
    bounces: u32,
}

impl<'a> DeviceScene<'a> {
    /// Uploads a scene and builds its acceleration structures; `set_layout` is that of
    /// [`set_layout`] for its textures.
    pub fn new(
        context: &'a Context,
        set_layout: vk::DescriptorSetLayout,
        scene: &Scene,
    ) -> Result<DeviceScene<'a>> {
        let images = upload_images(context, &scene.textures).context("textures")?;
        let input = Usage::STORAGE_BUFFER | Usage::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
        let vertices = Buffer::with(context, &scene.vertices, input)?;
        let indices = Buffer::with(context, &scene.indices, input)?;
        let structures = build_structures(context, scene, &vertices, &indices)
            .context("building acceleration structures")?;
        let geometries: Vec<[u32; 4]> = scene
            .geometries
            .iter()
            .map(|geometry| {
                [
                    geometry.first_index,
                    geometry.first_vertex,
                    geometry.material,
                    0,
                ]
            })
            .collect();
        let procedurals: Vec<ProceduralRecord> = scene
            .procedurals
            .iter()
            .map(|procedural| ProceduralRecord {
                centre: procedural.centre.into(),
                radius: procedural.radius,
                material: procedural.material,
                unused: [0; 3],
            })
            .collect();
        let buffers = [
            vertices,
            indices,
            Buffer::with(context, &geometries, Usage::STORAGE_BUFFER)?,
            Buffer::with(context, &scene.materials, Usage::STORAGE_BUFFER)?,
            Buffer::with(context, &procedurals, Usage::STORAGE_BUFFER)?,
        ];
        Ok(DeviceScene {
            context,
            set_layout,
            buffers,
            images,
            structures,
        })
    }
}

impl<'a> Renderer<'a> {
    pub fn new(
        world: &DeviceScene<'a>,
        pipeline: &'a Pipeline<'a>,
        scene: &Scene,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Renderer<'a>> {
        let context = world.context;
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        let radiance = Buffer::new(context, pixels * 16, Usage::STORAGE_BUFFER)?;
        let ray_counts = Buffer::new(context, pixels * 4, Usage::STORAGE_BUFFER)?;
        let frame = Buffer::with(
            context,
            &[frame(scene, camera, settings)],
            Usage::UNIFORM_BUFFER,
        )?;
        let mut bound: Vec<vk::Buffer> = vec![radiance.handle, ray_counts.handle];
        bound.extend(world.buffers.iter().map(|buffer| buffer.handle));
        bound.push(frame.handle);
        let top = world
            .structures
            .last()
            .expect("there is a top level")
            .handle;
        let (descriptor_pool, set) =
            describe(context, world.set_layout, top, &bound, &world.images)?;
        Ok(Renderer {
            context,
            pipeline,
            settings,
            radiance,
            ray_counts,
            frame,
            descriptor_pool,
            set,
        })
    }

    /// Sets the camera of all later samples; nothing that uses the renderer may be in flight.
    pub fn look(&mut self, scene: &Scene, camera: &Camera) -> Result<()> {
        let frame = frame(scene, camera, self.settings);
        self.frame.write(0, bytemuck::bytes_of(&frame))
    }

    /// Traces every sample; `progress` hears how many pixel samples have been added.
    pub fn render(&self, mut progress: impl FnMut(u64)) -> Result<Rendering> {
        let Settings {
            width,
            first_row: top,
            rows: height,
            spp,
            ..
        } = self.settings;
        let columns = u64::from(width - self.settings.first_column);
        let mut steps = Vec::new();
        for sample in 0..spp {
            // The first pixels come early; later bands are large enough to fill many threads.
            let bands = if sample == 0 { 16 } else { 4 };
            let rows = height.div_ceil(bands).max(1);
            for first_row in (0..height).step_by(rows as usize) {
                steps.push((sample, top + first_row, rows.min(height - first_row)));
            }
        }
        let device = &self.context.device;
        let started = Instant::now();
        let mut first_pixel = None;
        let flight = Flight::new(self.context)?;
        for (number, step) in steps.iter().enumerate() {
            let ticket = number as u64 + 1;
            // Two submissions are under way at any time, so that the device never waits for us.
            if ticket > IN_FLIGHT {
                flight.wait(ticket - IN_FLIGHT)?;
                first_pixel.get_or_insert_with(Instant::now);
                let (_, _, rows) = steps[(ticket - IN_FLIGHT) as usize - 1];
                progress(u64::from(rows) * columns);
            }
            let commands = flight.commands[number % IN_FLIGHT as usize];
            self.record(commands, *step)?;
            flight.submit(commands, ticket)?;
        }
        let total = steps.len() as u64;
        for ticket in total.saturating_sub(IN_FLIGHT) + 1..=total {
            flight.wait(ticket)?;
            first_pixel.get_or_insert_with(Instant::now);
            progress(u64::from(steps[ticket as usize - 1].2) * columns);
        }
        let seconds = started.elapsed().as_secs_f64();
        // SAFETY: the device is ours.
        unsafe { device.device_wait_idle() }?;
        // The buffers are of whole pictures, so that a pixel's place in them is the same in each
        // tile.
        let rows_before = width as usize * top as usize;
        let pixels = rows_before + width as usize * height as usize;
        Ok(Rendering {
            radiance: self.radiance.read(pixels)?.split_off(rows_before),
            rays: self.rays()?,
            first_pixel: first_pixel.context("nothing was rendered")?,
            seconds,
        })
    }

    /// Rays of all kinds that were traced for the rows and columns that are rendered; nothing may
    /// be in flight.
    pub fn rays(&self) -> Result<u64> {
        let settings = &self.settings;
        let width = settings.width as usize;
        let rows = settings.first_row as usize..(settings.first_row + settings.rows) as usize;
        let counts = self.ray_counts.read::<u32>(rows.end * width)?;
        let of_rows = (counts[rows.start * width..].chunks_exact(width))
            .flat_map(|row| &row[settings.first_column as usize..]);
        Ok(of_rows.copied().map(u64::from).sum())
    }

    fn record(&self, commands: vk::CommandBuffer, step: (u32, u32, u32)) -> Result<()> {
        let device = &self.context.device;
        let begin = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is not in flight.
        unsafe {
            device.begin_command_buffer(commands, &begin)?;
            self.record_sample(commands, step);
            device.end_command_buffer(commands)?;
        }
        Ok(())
    }

    /// Adds a sample to each pixel of some rows: the sample's number, the first row, how many.
    ///
    /// Sample 0 replaces what was there.
    pub fn record_sample(
        &self,
        commands: vk::CommandBuffer,
        (sample_index, first_row, rows): (u32, u32, u32),
    ) {
        let device = &self.context.device;
        let first_column = self.settings.first_column;
        let push = Launch {
            sample_index,
            first_row,
            first_column,
            bounces: self.settings.bounces,
        };
        let sums = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE)
            .dst_access_mask(vk::AccessFlags::SHADER_READ | vk::AccessFlags::SHADER_WRITE);
        let to_host = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ);
        let trace = vk::PipelineStageFlags::RAY_TRACING_SHADER_KHR;
        let none = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is recording, and what is bound outlives its execution.
        unsafe {
            device.cmd_pipeline_barrier(commands, trace, trace, none, &[sums], &[], &[]);
            let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
            device.cmd_bind_pipeline(commands, point, self.pipeline.handle);
            let layout = self.pipeline.layout;
            device.cmd_bind_descriptor_sets(commands, point, layout, 0, &[self.set], &[]);
            let bytes = bytemuck::bytes_of(&push);
            device.cmd_push_constants(commands, layout, Stage::RAYGEN_KHR, 0, bytes);
            self.context.ray_tracing.cmd_trace_rays(
                commands,
                &self.pipeline.raygen,
                &self.pipeline.miss,
                &self.pipeline.hit,
                &vk::StridedDeviceAddressRegionKHR::default(),
                self.settings.width - first_column,
                rows,
                1,
            );
            let host = vk::PipelineStageFlags::HOST;
            device.cmd_pipeline_barrier(commands, trace, host, none, &[to_host], &[], &[]);
        }
    }
}

impl Drop for Renderer<'_> {
    fn drop(&mut self) {
        // SAFETY: nothing is in flight once the device is idle.
        unsafe {
            let _ = self.context.device.device_wait_idle();
            self.context
                .device
                .destroy_descriptor_pool(self.descriptor_pool, None);
        }
    }
}

const IN_FLIGHT: u64 = 2;

/// Command buffers that take turns, and the semaphore that counts the finished ones.
struct Flight<'a> {
    context: &'a Context,
    commands: Vec<vk::CommandBuffer>,
    finished: vk::Semaphore,
}

impl<'a> Flight<'a> {
    fn new(context: &'a Context) -> Result<Flight<'a>> {
        let mut kind =
            vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let semaphore = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        let buffers = vk::CommandBufferAllocateInfo::default()
            .command_pool(context.pool)
            .command_buffer_count(IN_FLIGHT as u32);
        // SAFETY: the structures outlive the calls, and the pool is of this device.
        unsafe {
            let finished = context.device.create_semaphore(&semaphore, None)?;
            let commands = context.device.allocate_command_buffers(&buffers)?;
            Ok(Flight {
                context,
                commands,
                finished,
            })
        }
    }

    fn submit(&self, commands: vk::CommandBuffer, ticket: u64) -> Result<()> {
        let tickets = [ticket];
        let mut values =
            vk::TimelineSemaphoreSubmitInfo::default().signal_semaphore_values(&tickets);
        let (buffers, signals) = ([commands], [self.finished]);
        let submit = vk::SubmitInfo::default()
            .command_buffers(&buffers)
            .signal_semaphores(&signals)
            .push_next(&mut values);
        // SAFETY: the command buffer is recorded, and what it uses outlives its execution.
        unsafe {
            self.context
                .device
                .queue_submit(self.context.queue, &[submit], vk::Fence::null())
        }?;
        Ok(())
    }

    fn wait(&self, ticket: u64) -> Result<()> {
        let (semaphores, values) = ([self.finished], [ticket]);
        let info = vk::SemaphoreWaitInfo::default()
            .semaphores(&semaphores)
            .values(&values);
        let patience = crate::vulkan::PATIENCE_NS;
        // SAFETY: the semaphore is of this device.
        unsafe { self.context.device.wait_semaphores(&info, patience) }
            .context("waiting for the device")
    }
}

impl Drop for Flight<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: once the device is idle nothing refers to these.
        unsafe {
            let _ = device.device_wait_idle();
            device.free_command_buffers(self.context.pool, &self.commands);
            device.destroy_semaphore(self.finished, None);
        }
    }
}

/// The camera's position; the way from the picture's middle to its right and to its upper edge, and
/// to the middle itself.
pub fn view(camera: &Camera, (width, height): (u32, u32)) -> [glam::Vec3; 4] {
    let forward = camera.forward.normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let half = libm::tanf(camera.fov_y * 0.5);
    let (width, height) = (width as f32, height as f32);
    let right = right * (half * width / height);
    [camera.position, right, up * half, forward]
}

fn frame(scene: &Scene, camera: &Camera, settings: Settings) -> Frame {
    let size = (settings.width, settings.height);
    let [position, right, up, forward] = view(camera, size);
    let half = libm::tanf(camera.fov_y * 0.5);
    let (width, height) = (settings.width as f32, settings.height as f32);
    let sun = &scene.sun;
    let (haze, density) = scene.haze;
    let cosine = libm::cosf(sun.angular_radius);
    let size = scene.extent.max(camera.position.length());
    Frame {
        camera_position: position.extend(2.0 * half / height).into(),
        camera_right: right.extend(width).into(),
        camera_up: up.extend(height).into(),
        camera_forward: forward.extend(0.0).into(),
        sun_direction: sun.direction.extend(cosine).into(),
        sun_irradiance: sun
            .irradiance
            .extend(std::f32::consts::TAU * (1.0 - cosine))
            .into(),
        haze: haze.extend(density).into(),
        epsilon: size * 2e-6,
        terrain_textures: [scene.roles.grass, scene.roles.rock, scene.roles.sand],
        cloud_texture: scene.roles.clouds,
        time: 2.0 + f32::from(settings.frame) / FRAMES_PER_SECOND,
        unused: [0; 2],
    }
}

/// Writes the one descriptor set: `buffers` are those of bindings 1 to 8 in order.
fn describe(
    context: &Context,
    layout: vk::DescriptorSetLayout,
    world: vk::AccelerationStructureKHR,
    buffers: &[vk::Buffer],
    images: &[Image],
) -> Result<(vk::DescriptorPool, vk::DescriptorSet)> {
    let device = &context.device;
    let size = |ty: DescriptorType, count: usize| vk::DescriptorPoolSize {
        ty,
        descriptor_count: count as u32,
    };
    let sizes = [
        size(DescriptorType::ACCELERATION_STRUCTURE_KHR, 1),
        size(DescriptorType::STORAGE_BUFFER, STORAGE_BINDINGS.count()),
        size(DescriptorType::UNIFORM_BUFFER, 1),
        size(DescriptorType::COMBINED_IMAGE_SAMPLER, images.len()),
    ];
    let pool = vk::DescriptorPoolCreateInfo::default()
        .max_sets(1)
        .pool_sizes(&sizes);
    let layouts = [layout];
    // SAFETY: the structures outlive the calls.
    let (pool, set) = unsafe {
        let pool = device.create_descriptor_pool(&pool, None)?;
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(pool)
            .set_layouts(&layouts);
        (pool, device.allocate_descriptor_sets(&info)?[0])
    };
    let worlds = [world];
    let mut structure =
        vk::WriteDescriptorSetAccelerationStructureKHR::default().acceleration_structures(&worlds);
    let buffer_infos: Vec<vk::DescriptorBufferInfo> = buffers
        .iter()
        .map(|buffer| {
            vk::DescriptorBufferInfo::default()
                .buffer(*buffer)
                .range(vk::WHOLE_SIZE)
        })
        .collect();
    let image_infos: Vec<vk::DescriptorImageInfo> = images
        .iter()
        .map(|image| {
            vk::DescriptorImageInfo::default()
                .sampler(image.sampler)
                .image_view(image.view)
                .image_layout(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL)
        })
        .collect();
    let write = |binding: u32, kind: DescriptorType| {
        vk::WriteDescriptorSet::default()
            .dst_set(set)
            .dst_binding(binding)
            .descriptor_type(kind)
    };
    let mut writes = vec![
        write(0, DescriptorType::ACCELERATION_STRUCTURE_KHR)
            .descriptor_count(1)
            .push_next(&mut structure),
        write(TEXTURES_BINDING, DescriptorType::COMBINED_IMAGE_SAMPLER).image_info(&image_infos),
    ];
    for (i, info) in buffer_infos.iter().enumerate() {
        let binding = i as u32 + 1;
        let kind = match binding {
            FRAME_BINDING => DescriptorType::UNIFORM_BUFFER,
            _ => DescriptorType::STORAGE_BUFFER,
        };
        writes.push(write(binding, kind).buffer_info(std::slice::from_ref(info)));
    }
    // SAFETY: every handle is of this device, and the set is not in use.
    unsafe { device.update_descriptor_sets(&writes, &[]) };
    Ok((pool, set))
}
