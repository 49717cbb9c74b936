//! The images that a window shows in turn.

use anyhow::{Context as _, Result};
use ash::prelude::VkResult;
use ash::{khr, vk};
use demo::vulkan::Context;

use crate::surface::Surface;

/// How long to wait for an image: a window that is hidden may give none for a while.
const PATIENCE_NS: u64 = 1_000_000_000;

/// A swapchain that shows each picture for one refresh of the screen at least.
pub struct Swapchain<'a> {
    context: &'a Context,
    functions: khr::swapchain::Device,
    handle: vk::SwapchainKHR,
    pub format: vk::Format,
    pub extent: vk::Extent2D,
    images: Vec<SwapchainImage>,
    acquired: vk::Semaphore,
}

/// An image of it.
#[derive(Clone, Copy)]
pub struct SwapchainImage {
    pub image: vk::Image,
    pub view: vk::ImageView,
    drawn: vk::Semaphore,
}

/// The outcome of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Presented,
    /// It was, but the swapchain no longer fits the window; or it was not, for that reason.
    Misfit {
        presented: bool,
    },
    /// No image was free in time.
    Late,
    SurfaceLost,
}

impl Outcome {
    /// The window shows the picture.
    pub fn was_presented(self) -> bool {
        matches!(self, Self::Presented | Self::Misfit { presented: true })
    }
}

/// Opaque composition, or another kind that the surface has.
fn alpha_of(capabilities: &vk::SurfaceCapabilitiesKHR) -> vk::CompositeAlphaFlagsKHR {
    let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
    let offered = capabilities.supported_composite_alpha;
    match offered.contains(opaque) {
        true => opaque,
        false => vk::CompositeAlphaFlagsKHR::from_raw(1 << offered.as_raw().trailing_zeros()),
    }
}

/// The extent of images for a window of this size.
fn extent_of(
    capabilities: &vk::SurfaceCapabilitiesKHR,
    (width, height): (u32, u32),
) -> vk::Extent2D {
    match capabilities.current_extent {
        // The swapchain decides, as on Wayland.
        vk::Extent2D {
            width: u32::MAX,
            height: u32::MAX,
        } => {
            let (min, max) = (capabilities.min_image_extent, capabilities.max_image_extent);
            vk::Extent2D {
                width: width.clamp(min.width, max.width),
                height: height.clamp(min.height, max.height),
            }
        }
        extent => extent,
    }
}

impl<'a> Swapchain<'a> {
    /// Images of the window's size, in place of `old`; nothing while the window has no area.
    ///
    /// # Errors
    /// The outer ones are the end, the inner one may be a lost surface.
    pub fn new(
        context: &'a Context,
        surface: &Surface,
        (width, height): (u32, u32),
        old: Option<&Swapchain>,
    ) -> Result<VkResult<Option<Swapchain<'a>>>> {
        let (physical, device) = (context.physical, &context.device);
        // SAFETY: the handles are of this instance.
        let asked = unsafe {
            let of = &surface.functions;
            (of.get_physical_device_surface_capabilities(physical, surface.handle)).and_then(
                |capabilities| {
                    let formats =
                        of.get_physical_device_surface_formats(physical, surface.handle)?;
                    Ok((capabilities, formats))
                },
            )
        };
        let (capabilities, formats) = match asked {
            Ok(asked) => asked,
            Err(error) => return Ok(Err(error)),
        };
        let extent = extent_of(&capabilities, (width, height));
        if width == 0 || height == 0 || extent.width == 0 || extent.height == 0 {
            return Ok(Ok(None));
        }
        let wanted = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let format = (formats.iter())
            .find(|offered| {
                wanted.contains(&offered.format)
                    && offered.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
            })
            .context("the window has no format of eight bits for encoded colors")?;
        let most = match capabilities.max_image_count {
            0 => u32::MAX,
            most => most,
        };
        let alpha = alpha_of(&capabilities);
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.handle)
            .min_image_count((capabilities.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true)
            .old_swapchain(old.map_or(vk::SwapchainKHR::null(), |old| old.handle));
        let functions = khr::swapchain::Device::new(&context.instance, device);
        let semaphore = vk::SemaphoreCreateInfo::default();
        // SAFETY: the surface and the old swapchain are alive; the images are the swapchain's as
        // long as it lives.
        unsafe {
            let handle = match functions.create_swapchain(&info, None) {
                Ok(handle) => handle,
                Err(error) => return Ok(Err(error)),
            };
            let mut swapchain = Swapchain {
                context,
                handle,
                format: format.format,
                extent,
                images: Vec::new(),
                acquired: device.create_semaphore(&semaphore, None)?,
                functions,
            };
            swapchain.add_images()?;
            Ok(Ok(Some(swapchain)))
        }
    }

    /// Adds the swapchain's images, each with a view and a semaphore.
    fn add_images(&mut self) -> Result<()> {
        let semaphore = vk::SemaphoreCreateInfo::default();
        // SAFETY: the swapchain is alive, and so are its images.
        unsafe {
            for image in self.functions.get_swapchain_images(self.handle)? {
                let range = vk::ImageSubresourceRange::default()
                    .aspect_mask(vk::ImageAspectFlags::COLOR)
                    .level_count(1)
                    .layer_count(1);
                let view = vk::ImageViewCreateInfo::default()
                    .image(image)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .format(self.format)
                    .subresource_range(range);
                self.images.push(SwapchainImage {
                    image,
                    view: self.context.device.create_image_view(&view, None)?,
                    drawn: self.context.device.create_semaphore(&semaphore, None)?,
                });
            }
        }
        Ok(())
    }

    /// Draws a picture by what `record` records, waits for that, and presents it.
    ///
    /// `record` begins with an image of undefined layout, and leaves it in the one for presenting.
    pub fn present(
        &mut self,
        commands: vk::CommandBuffer,
        finished: vk::Fence,
        record: impl FnOnce(vk::CommandBuffer, SwapchainImage),
    ) -> Result<Outcome> {
        let device = &self.context.device;
        // SAFETY: the semaphore was waited for by the last picture's submission, whose fence was
        // waited for; the command buffer is not in flight; what it uses outlives the wait.
        unsafe {
            let none = vk::Fence::null();
            let acquired =
                self.functions
                    .acquire_next_image(self.handle, PATIENCE_NS, self.acquired, none);
            let (index, misfit) = match acquired {
                Ok(acquired) => acquired,
                Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(Outcome::Late),
                Err(error) => return outcome_of(error).context("acquiring an image"),
            };
            let shown = self.images[index as usize];
            let begin = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(commands, &begin)?;
            record(commands, shown);
            device.end_command_buffer(commands)?;
            let (waits, signals) = ([self.acquired], [shown.drawn]);
            let (buffers, stages) = (
                [commands],
                [vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT],
            );
            let submit = vk::SubmitInfo::default()
                .wait_semaphores(&waits)
                .wait_dst_stage_mask(&stages)
                .command_buffers(&buffers)
                .signal_semaphores(&signals);
            device.queue_submit(self.context.queue, &[submit], finished)?;
            let waited = device.wait_for_fences(&[finished], true, demo::vulkan::PATIENCE_NS);
            waited.context("waiting for the device")?;
            device.reset_fences(&[finished])?;
            let (swapchains, indices) = ([self.handle], [index]);
            let info = vk::PresentInfoKHR::default()
                .wait_semaphores(&signals)
                .swapchains(&swapchains)
                .image_indices(&indices);
            match self.functions.queue_present(self.context.queue, &info) {
                Ok(later_misfit) if misfit || later_misfit => {
                    Ok(Outcome::Misfit { presented: true })
                }
                Ok(_) => Ok(Outcome::Presented),
                Err(error) => outcome_of(error).context("presenting an image"),
            }
        }
    }
}

fn outcome_of(error: vk::Result) -> Result<Outcome> {
    match error {
        vk::Result::ERROR_OUT_OF_DATE_KHR => Ok(Outcome::Misfit { presented: false }),
        vk::Result::ERROR_SURFACE_LOST_KHR => Ok(Outcome::SurfaceLost),
        error => Err(error.into()),
    }
}

impl Drop for Swapchain<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: nothing is in flight once the device is idle; the images go with the swapchain.
        unsafe {
            let _ = device.device_wait_idle();
            for shown in &self.images {
                device.destroy_image_view(shown.view, None);
            }
            self.functions.destroy_swapchain(self.handle, None);
            for shown in &self.images {
                device.destroy_semaphore(shown.drawn, None);
            }
            device.destroy_semaphore(self.acquired, None);
        }
    }
}
