//! One redraw: a piece of the picture, the panel over it, and both presented.

use std::time::{Duration, Instant};

use anyhow::Result;
use ash::vk;
use demo::vulkan::{Context, change_layout, viewport};
use egui::ViewportId;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use super::App;
use super::open::Open;
use crate::panel::{Choices, News, lay_out};
use crate::progress::{Progress, Sight};
use crate::swapchain::{Outcome, SwapchainImage};

/// A stutter moves the camera no farther than this.
const LONGEST_STEP: Duration = Duration::from_millis(200);

impl App<'_> {
    /// The time, and the seconds by which the camera moves on.
    fn step(&mut self) -> (Instant, f32) {
        let now = Instant::now();
        let step = (now - self.last_frame).min(LONGEST_STEP);
        self.last_frame = now;
        (now, step.as_secs_f32())
    }

    /// Computes a part of the picture and shows the picture so far.
    pub(super) fn redraw(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let (now, step) = self.step();
        if self.is_hidden || self.open.as_ref().is_none_or(is_unseen) || !self.fit()? {
            return Ok(());
        }
        let extent = self.studio.scene.extent;
        self.flight.move_on(&mut self.camera, extent, step);
        let (order, bounces) = (self.order, self.choices.bounces);
        let Some(open) = &mut self.open else {
            return Ok(());
        };
        let (Some(progress), Some((_, show, overlay)), Some(swapchain)) =
            (&mut open.progress, &mut open.drawers, &mut open.swapchain)
        else {
            return Ok(());
        };
        let split = self.choices.first_traced(swapchain.extent.width);
        let sight = Sight {
            camera: self.camera,
            bounces,
            split,
        };
        if progress.sight != sight {
            progress.start(sight)?;
        }
        progress.advance(order.spp)?;

        let news = News {
            device: self.studio.context.name.clone(),
            samples: progress.samples,
            rays_per_second: progress.rays_per_second,
        };
        let (output, panel) = run_panel(&mut open.egui, &open.window, &mut self.choices, &news);
        let scale = output.pixels_per_point;
        let meshes = open.egui.egui_ctx().tessellate(output.shapes, scale);
        let size = (swapchain.extent.width, swapchain.extent.height);
        overlay.prepare(&output.textures_delta, &meshes, size, scale)?;

        let exposure = self.studio.scene.exposure * self.choices.stops.exp2();
        open.window.pre_present_notify();
        let outcome = swapchain.present(self.commands, self.finished, |commands, shown| {
            record(self.studio.context, commands, &shown, size, || {
                show.record(commands, progress, exposure);
                overlay.record(commands);
            });
        })?;
        match outcome {
            Outcome::Presented => self.presented += 1,
            Outcome::Misfit { presented } => {
                self.presented += u64::from(presented);
                open.misfits = true;
            }
            Outcome::Late => {}
            Outcome::SurfaceLost => return self.lose_surface(),
        }
        let was_presented = outcome.was_presented();
        if was_presented {
            self.last_presented = Instant::now();
            self.was_lost = false;
        }
        let is_done = progress.is_done(order.spp);
        if is_done && was_presented && !self.has_told {
            print_done(progress, split, (panel.min * scale, panel.size() * scale));
        }
        self.has_told = is_done && (self.has_told || was_presented);
        if order.frames.is_some_and(|frames| self.presented >= frames) {
            events.exit();
            return Ok(());
        }
        let delay = (output.viewport_output.get(&ViewportId::ROOT))
            .map_or(Duration::MAX, |viewport| viewport.repaint_delay);
        let more = !is_done || self.flight.is_moving() || open.misfits || !was_presented;
        let is_next = more || order.frames.is_some() || delay.is_zero();
        if is_next {
            open.window.request_redraw();
        }
        let then = (!is_next).then(|| now.checked_add(delay)).flatten();
        self.sleep(events, then);
        Ok(())
    }
}

/// Runs the panel. Returns its output and its rectangle, in points.
fn run_panel(
    egui: &mut egui_winit::State,
    window: &Window,
    choices: &mut Choices,
    news: &News,
) -> (egui::FullOutput, egui::Rect) {
    let input = egui.take_egui_input(window);
    let mut panel = egui::Rect::NOTHING;
    let mut output = (egui.egui_ctx().clone()).run(input, |context| {
        panel = lay_out(context, choices, news);
    });
    egui.handle_platform_output(window, std::mem::take(&mut output.platform_output));
    (output, panel)
}

/// Whether nothing is drawn in a window now. An event comes when it is seen again.
fn is_unseen(open: &Open<'_>) -> bool {
    open.window.is_minimized() == Some(true)
}

/// Records a picture over all of an image that is presented.
fn record(
    context: &Context,
    commands: vk::CommandBuffer,
    shown: &SwapchainImage,
    size: (u32, u32),
    draw: impl FnOnce(),
) {
    let area = vk::Rect2D::from(vk::Extent2D {
        width: size.0,
        height: size.1,
    });
    let image = (shown.image, vk::ImageAspectFlags::COLOR);
    let attached = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
    // The barrier is for all memory that was written: for what was traced and drawn, too.
    change_layout(
        context,
        commands,
        image,
        vk::ImageLayout::UNDEFINED,
        attached,
    );
    let colors = [vk::RenderingAttachmentInfo::default()
        .image_view(shown.view)
        .image_layout(attached)
        .load_op(vk::AttachmentLoadOp::DONT_CARE)
        .store_op(vk::AttachmentStoreOp::STORE)];
    let rendering = vk::RenderingInfo::default()
        .render_area(area)
        .layer_count(1)
        .color_attachments(&colors);
    let device = &context.device;
    // SAFETY: the command buffer is recording, and what it uses outlives its execution.
    unsafe {
        device.cmd_begin_rendering(commands, &rendering);
        device.cmd_set_viewport(commands, 0, &[viewport(size)]);
        device.cmd_set_scissor(commands, 0, &[area]);
        draw();
        device.cmd_end_rendering(commands);
    }
    let presented = vk::ImageLayout::PRESENT_SRC_KHR;
    change_layout(context, commands, image, attached, presented);
}

/// Prints the figures of a complete picture, with the panel's place in pixels.
fn print_done(progress: &Progress, split: u32, (corner, size): (egui::Pos2, egui::Vec2)) {
    println!(
        "window: {}x{}, {} samples, {:.1} Mrays/s, traced from column {split}; \
         panel at {},{}, {}x{}",
        progress.size.0,
        progress.size.1,
        progress.samples,
        progress.rays_per_second / 1e6,
        corner.x.floor(),
        corner.y.floor(),
        size.x.ceil(),
        size.y.ceil(),
    );
}
