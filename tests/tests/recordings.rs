//! GFXReconstruct, where it is installed: the replay of a captured program shows the same pictures.

use std::ffi::CStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use ash::{ext, khr, vk};
use tuff_tests::*;

const LAYER: &CStr = c"VK_LAYER_LUNARG_gfxreconstruct";
const REPLAYER: &str = "gfxrecon-replay";
/// Says that this process is the captured program.
const CAPTURED: &str = "TUFF_TESTS_RECORDED";

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const FRAMES: u32 = 3;

/// Color of rays that miss.
const BACKGROUND: [u8; 4] = [10, 20, 30, 255];

/// Color of the triangle in a frame.
fn color(frame: u32) -> [u8; 4] {
    [200, 40 * frame as u8, 7, 255]
}

/// Offset of the triangle along x in a frame.
fn offset(frame: u32) -> u32 {
    16 * frame
}

/// The picture of a frame: the triangle (4, 4), (36, 4), (4, 28), moved along x. No pixel's center
/// lies on an edge.
fn expected(frame: u32) -> Vec<[u8; 4]> {
    let is_inside = |x: u32, y: u32| {
        let (u, v) = (
            x as f32 + 0.5 - 4.0 - offset(frame) as f32,
            y as f32 + 0.5 - 4.0,
        );
        u > 0.0 && v > 0.0 && u / 32.0 + v / 24.0 < 1.0
    };
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    let pixels = pixels.map(|(x, y)| match is_inside(x, y) {
        true => color(frame),
        false => BACKGROUND,
    });
    pixels.collect()
}

/// Traces and presents the frames. Addresses stand in instances, in a buffer and in the binding
/// table, so that the pictures depend on all of them.
fn run_program() {
    let Some(gpu) = Gpu::presenting() else { return };
    let bottom = gpu.bottom(&[Geometry::opaque(&[
        [4.0, 4.0, 1.0],
        [36.0, 4.0, 1.0],
        [4.0, 28.0, 1.0],
    ])]);
    let window = HeadlessWindow::new(&gpu);
    for frame in 0..FRAMES {
        let picture = trace(&gpu, bottom, frame);
        let pixels: Vec<[u8; 4]> = gpu.download(&picture, 0, 4).read();
        assert_eq!(pixels, expected(frame));
        window.show(&picture);
    }
}

/// Traces a frame with objects of its own.
fn trace(gpu: &Gpu, bottom: Structure, frame: u32) -> Picture {
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, rgba8) uniform writeonly image2D picture;
    layout(buffer_reference, std430) readonly buffer Color { uvec4 color; };
    layout(set = 0, binding = 2, std430) buffer B { Color background; };
    layout(location = 0) rayPayloadEXT uvec4 color;
    void main() {
        color = background.color;
        vec3 origin = vec3(vec2(gl_LaunchIDEXT) + 0.5, 0.0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 10.0, 0);
        imageStore(picture, ivec2(gl_LaunchIDEXT), vec4(color) / 255.0);
    }";
    let miss = "layout(location = 0) rayPayloadInEXT uvec4 color; void main() {}";
    let hit = r"
    layout(location = 0) rayPayloadInEXT uvec4 color;
    layout(buffer_reference, std430) readonly buffer Color { uvec4 color; };
    layout(shaderRecordEXT, std430) buffer Record { Color record; };
    void main() { color = record.color; }";
    let words = |color: [u8; 4]| gpu.buffer_with(&color.map(u32::from));
    let world = gpu.top(&[Instance {
        transform: translated([offset(frame) as f32, 0.0, 0.0]),
        ..Instance::of(bottom)
    }]);
    let shape = Shape::flat(vk::Format::R8G8B8A8_UNORM, WIDTH, HEIGHT);
    let picture = gpu.picture(shape, vk::ImageUsageFlags::STORAGE);
    let case = Case::new(raygen)
        .miss(miss)
        .hit(hit)
        .bind(world)
        .bind(Bound::StorageImage(picture.view))
        .bind(gpu.buffer_with(&[words(BACKGROUND).address]));
    let mut table = case.table();
    table.hit[0].data = words(color(frame)).address.to_ne_bytes().to_vec();
    gpu.trace(&gpu.rays(&case), &table, [WIDTH, HEIGHT, 1]);
    picture
}

/// A headless surface with a swapchain.
struct HeadlessWindow<'a> {
    gpu: &'a Gpu,
    surfaces: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    swapchains: khr::swapchain::Device,
    swapchain: vk::SwapchainKHR,
}

impl<'a> HeadlessWindow<'a> {
    fn new(gpu: &'a Gpu) -> HeadlessWindow<'a> {
        let surfaces = khr::surface::Instance::new(&gpu.entry, &gpu.instance);
        let swapchains = khr::swapchain::Device::new(&gpu.instance, &gpu.device);
        // SAFETY: the structures outlive the calls; the extensions are enabled.
        unsafe {
            let headless = ext::headless_surface::Instance::new(&gpu.entry, &gpu.instance);
            let info = vk::HeadlessSurfaceCreateInfoEXT::default();
            let surface = headless.create_headless_surface(&info, None);
            let surface = surface.expect("vkCreateHeadlessSurfaceEXT");
            let formats = surfaces.get_physical_device_surface_formats(gpu.physical, surface);
            let formats = formats.expect("formats");
            let is_plain = |it: &&vk::SurfaceFormatKHR| {
                [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM].contains(&it.format)
            };
            let format = formats.iter().find(is_plain).expect("a format of bytes");
            let info = vk::SwapchainCreateInfoKHR::default()
                .surface(surface)
                .min_image_count(3)
                .image_format(format.format)
                .image_color_space(format.color_space)
                .image_extent(vk::Extent2D {
                    width: WIDTH,
                    height: HEIGHT,
                })
                .image_array_layers(1)
                .image_usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::TRANSFER_SRC)
                .pre_transform(vk::SurfaceTransformFlagsKHR::IDENTITY)
                .composite_alpha(vk::CompositeAlphaFlagsKHR::OPAQUE)
                .present_mode(vk::PresentModeKHR::FIFO);
            let swapchain = swapchains.create_swapchain(&info, None);
            HeadlessWindow {
                gpu,
                surfaces,
                surface,
                swapchains,
                swapchain: swapchain.expect("vkCreateSwapchainKHR"),
            }
        }
    }

    /// Presents a picture, converted to the swapchain's format.
    fn show(&self, picture: &Picture) {
        let gpu = self.gpu;
        let range = all_of(picture.shape);
        let layers = vk::ImageSubresourceLayers::default()
            .aspect_mask(range.aspect_mask)
            .layer_count(1);
        let corners = [
            vk::Offset3D::default(),
            vk::Offset3D {
                x: WIDTH as i32,
                y: HEIGHT as i32,
                z: 1,
            },
        ];
        let blit = vk::ImageBlit::default()
            .src_subresource(layers)
            .src_offsets(corners)
            .dst_subresource(layers)
            .dst_offsets(corners);
        let general = vk::ImageLayout::GENERAL;
        let presented = vk::ImageLayout::PRESENT_SRC_KHR;
        // SAFETY: the objects are of this device; each frame is complete before the next one.
        unsafe {
            let fence = gpu
                .device
                .create_fence(&vk::FenceCreateInfo::default(), None);
            let fence = fence.expect("vkCreateFence");
            let acquired = self.swapchains.acquire_next_image(
                self.swapchain,
                PATIENCE_NS,
                vk::Semaphore::null(),
                fence,
            );
            let (index, _) = acquired.expect("vkAcquireNextImageKHR");
            let waited = gpu.device.wait_for_fences(&[fence], true, PATIENCE_NS);
            waited.expect("the image is free");
            gpu.device.destroy_fence(fence, None);
            let images = self.swapchains.get_swapchain_images(self.swapchain);
            let image = images.expect("images")[index as usize];
            gpu.to_general(image, range);
            gpu.run(|commands| {
                gpu.device.cmd_blit_image(
                    commands,
                    picture.handle,
                    general,
                    image,
                    general,
                    &[blit],
                    vk::Filter::NEAREST,
                );
                let barrier = vk::ImageMemoryBarrier::default()
                    .old_layout(general)
                    .new_layout(presented)
                    .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .image(image)
                    .subresource_range(range);
                let (from, to) = (
                    vk::PipelineStageFlags::TRANSFER,
                    vk::PipelineStageFlags::BOTTOM_OF_PIPE,
                );
                let none = vk::DependencyFlags::empty();
                (gpu.device).cmd_pipeline_barrier(commands, from, to, none, &[], &[], &[barrier]);
            });
            let (swapchains, indices) = ([self.swapchain], [index]);
            let info = vk::PresentInfoKHR::default()
                .swapchains(&swapchains)
                .image_indices(&indices);
            let shown = self.swapchains.queue_present(gpu.queue, &info);
            shown.expect("vkQueuePresentKHR");
        }
    }
}

impl Drop for HeadlessWindow<'_> {
    fn drop(&mut self) {
        // SAFETY: the queue is idle, and nothing uses the objects any more.
        unsafe {
            let _ = self.gpu.device.device_wait_idle();
            self.swapchains.destroy_swapchain(self.swapchain, None);
            self.surfaces.destroy_surface(self.surface, None);
        }
    }
}

/// Whether the layer and the program are there.
fn is_installed() -> bool {
    // SAFETY: the loader's initialisers only set up its own state; a plain query.
    let layers = unsafe {
        let entry = ash::Entry::load().expect("there is a Vulkan loader");
        entry.enumerate_instance_layer_properties()
    };
    let layers = layers.unwrap_or_default();
    let has_layer = (layers.iter()).any(|layer| layer.layer_name_as_c_str() == Ok(LAYER));
    let version = Command::new(REPLAYER).arg("--version").output();
    has_layer && version.is_ok_and(|output| output.status.success())
}

/// The pixels of an uncompressed BMP file, from the top row, alpha left out.
fn bmp_pixels(path: &Path) -> Vec<[u8; 3]> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    let (start, width, height) = (word(10) as usize, word(18) as usize, word(22) as i32);
    let pixel_bytes = usize::from(bytes[28]) / 8;
    let row_bytes = (width * pixel_bytes).next_multiple_of(4);
    let mut rows: Vec<&[u8]> = bytes[start..].chunks_exact(row_bytes).collect();
    assert_eq!(rows.len(), height.unsigned_abs() as usize);
    if height > 0 {
        rows.reverse();
    }
    let pixels = rows
        .iter()
        .flat_map(|row| row[..width * pixel_bytes].chunks_exact(pixel_bytes));
    pixels.map(|blue| [blue[2], blue[1], blue[0]]).collect()
}

/// A folder of this process, removed at the end.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_replay_shows_the_captured_pictures() {
    const TEST: &str = "a_replay_shows_the_captured_pictures";
    if std::env::var_os(CAPTURED).is_some() {
        return run_program();
    }
    if !has_program("GFXReconstruct", is_installed()) || Gpu::presenting().is_none() {
        return;
    }
    let name = format!("tuff-recordings-{}", std::process::id());
    let folder = Folder(std::env::temp_dir().join(name));
    std::fs::create_dir_all(&folder.0).expect("a folder can be made");
    let file = folder.0.join("capture.gfxr");
    alone(
        TEST,
        &[
            (CAPTURED, "1"),
            ("VK_INSTANCE_LAYERS", LAYER.to_str().expect("ASCII")),
            ("GFXRECON_CAPTURE_FILE", file.to_str().expect("UTF-8")),
            ("GFXRECON_CAPTURE_FILE_TIMESTAMP", "false"),
        ],
    );
    // The copies for screenshots are ordinary memory, allocated before captured addresses of the
    // frames that follow.
    let output = Command::new(REPLAYER)
        .args([
            "--screenshot-all",
            "--screenshot-prefix",
            "frame",
            "--screenshot-dir",
        ])
        .args([&folder.0, &file])
        .output()
        .expect("the program starts");
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(
        output.status.success() && !said.contains("FATAL"),
        "{}: {said}",
        output.status
    );
    for frame in 0..FRAMES {
        let path = folder.0.join(format!("frame_frame_{}.bmp", frame + 1));
        let expected = expected(frame);
        let expected: Vec<[u8; 3]> = (expected.iter()).map(|it| [it[0], it[1], it[2]]).collect();
        assert!(bmp_pixels(&path) == expected, "frame {frame}: {said}");
    }
}
