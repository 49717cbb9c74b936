//! What happens when: the window's events, and a picture for each redraw.

use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail};
use ash::vk;
use demo::scene::Camera;
use demo::vulkan::{change_layout, viewport};
use egui::ViewportId;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use crate::flight::{Flight, turn};
use crate::overlay::Overlay;
use crate::panel::{Choices, News, lay_out};
use crate::progress::{Progress, Sight, Studio};
use crate::show::Show;
use crate::surface::Surface;
use crate::swapchain::{Outcome, Swapchain};

/// A stutter moves the camera no farther than this.
const LONGEST_STEP: Duration = Duration::from_millis(200);

/// A window whose frames are counted shows one at least in this time.
const PATIENCE: Duration = Duration::from_secs(60);

/// What was asked for on the command line.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    pub size: (u32, u32),
    pub spp: u32,
    /// After so many presented pictures it ends.
    pub frames: Option<u64>,
}

/// The program once its window is there.
struct Open<'a> {
    egui: egui_winit::State,
    progress: Option<Progress<'a>>,
    /// For the swapchain's format.
    drawers: Option<(vk::Format, Show<'a>, Overlay<'a>)>,
    swapchain: Option<Swapchain<'a>>,
    /// Whether the swapchain is to be replaced.
    misfits: bool,
    surface: Option<Surface<'a>>,
    /// Outlives the surface: it is dropped last.
    window: Window,
}

pub struct App<'a> {
    studio: Studio<'a>,
    order: Order,
    open: Option<Open<'a>>,
    commands: vk::CommandBuffer,
    finished: vk::Fence,
    camera: Camera,
    choices: Choices,
    flight: Flight,
    /// Where the pointer is, and whether it drags the picture.
    pointer: (f64, f64),
    drags: bool,
    is_hidden: bool,
    last_frame: Instant,
    presented: u64,
    last_presented: Instant,
    /// Whether the surface was lost, and nothing presented since.
    was_lost: bool,
    has_told: bool,
    /// What ended it too early.
    pub failure: Option<anyhow::Error>,
}

impl<'a> App<'a> {
    pub fn new(studio: Studio<'a>, order: Order) -> Result<App<'a>> {
        let context = studio.context;
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(context.pool)
            .command_buffer_count(1);
        // SAFETY: the pool is of this device.
        let (commands, finished) = unsafe {
            let commands = context.device.allocate_command_buffers(&info)?[0];
            let fence = vk::FenceCreateInfo::default();
            (commands, context.device.create_fence(&fence, None)?)
        };
        Ok(App {
            camera: studio.scene.camera,
            studio,
            order,
            open: None,
            commands,
            finished,
            choices: Choices {
                stops: 0.0,
                bounces: demo::render::BOUNCES,
                split: 0.5,
            },
            flight: Flight::default(),
            pointer: (0.0, 0.0),
            drags: false,
            is_hidden: false,
            last_frame: Instant::now(),
            presented: 0,
            last_presented: Instant::now(),
            was_lost: false,
            has_told: false,
            failure: None,
        })
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let (width, height) = self.order.size;
        let attributes = Window::default_attributes()
            .with_title("Tuff")
            .with_inner_size(PhysicalSize::new(width, height));
        let window = events.create_window(attributes).context("the window")?;
        let most = {
            let context = self.studio.context;
            // SAFETY: the device is of this instance.
            let properties =
                unsafe { (context.instance).get_physical_device_properties(context.physical) };
            properties.limits.max_image_dimension2_d as usize
        };
        let egui = egui_winit::State::new(
            egui::Context::default(),
            ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            Some(most),
        );
        self.open = Some(Open {
            egui,
            progress: None,
            drawers: None,
            swapchain: None,
            misfits: true,
            surface: None,
            window,
        });
        Ok(())
    }

    /// Makes what is not there yet or no longer fits; tells whether there is something to draw on.
    fn fit(&mut self) -> Result<bool> {
        let Some(open) = &mut self.open else {
            return Ok(false);
        };
        let context = self.studio.context;
        if open.surface.is_none() {
            open.surface = Some(Surface::new(context, &open.window)?);
        }
        let surface = open.surface.as_ref().context("there is a surface")?;
        if open.misfits || open.swapchain.is_none() {
            let size = open.window.inner_size().into();
            // SAFETY: the device is ours.
            unsafe { context.device.device_wait_idle() }?;
            match Swapchain::new(context, surface, size, open.swapchain.as_ref())? {
                Ok(Some(swapchain)) => open.swapchain = Some(swapchain),
                Ok(None) => return Ok(false),
                Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                    self.lose_surface()?;
                    return Ok(false);
                }
                Err(error) => return Err(error).context("the swapchain"),
            }
            open.misfits = false;
        }
        let Some(swapchain) = &open.swapchain else {
            return Ok(false);
        };
        let format = swapchain.format;
        let mut is_new = false;
        if (open.drawers.as_ref()).is_none_or(|(of, ..)| *of != format) {
            // The texture is asked for anew, whole.
            open.egui
                .egui_ctx()
                .set_fonts(egui::FontDefinitions::default());
            let drawers = (Show::new(context, format)?, Overlay::new(context, format)?);
            open.drawers = Some((format, drawers.0, drawers.1));
            is_new = true;
        }
        let size = (swapchain.extent.width, swapchain.extent.height);
        if (open.progress.as_ref()).is_none_or(|progress| progress.size != size) {
            let sight = Sight {
                camera: self.camera,
                bounces: self.choices.bounces,
                split: self.choices.first_traced(size.0),
            };
            open.progress = None;
            open.progress = Some(Progress::new(&self.studio, size, sight)?);
            self.has_told = false;
            is_new = true;
        }
        if is_new && let (Some((_, show, _)), Some(progress)) = (&open.drawers, &open.progress) {
            show.turn_to(progress);
        }
        Ok(true)
    }

    /// A surface that is lost is made again once; what is lost twice without a picture in between
    /// is gone.
    fn lose_surface(&mut self) -> Result<()> {
        if self.was_lost {
            bail!("the window's surface is lost");
        }
        self.was_lost = true;
        if let Some(open) = &mut self.open {
            open.swapchain = None;
            open.surface = None;
            open.window.request_redraw();
        }
        Ok(())
    }

    /// Does a piece of the picture and shows what is there.
    fn redraw(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let now = Instant::now();
        let step = (now - self.last_frame).min(LONGEST_STEP).as_secs_f32();
        self.last_frame = now;
        let minimized = |open: &Open| open.window.is_minimized() == Some(true);
        if self.is_hidden || self.open.as_ref().is_none_or(minimized) || !self.fit()? {
            // An event comes when it is seen again.
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
            progress.start(sight);
        }
        progress.advance(order.spp)?;

        let news = News {
            device: self.studio.context.name.clone(),
            samples: progress.samples,
            rays_per_second: progress.rays_per_second,
        };
        let input = open.egui.take_egui_input(&open.window);
        let egui = open.egui.egui_ctx().clone();
        let mut panel = egui::Rect::NOTHING;
        let output = egui.run(input, |context| {
            panel = lay_out(context, &mut self.choices, &news);
        });
        open.egui
            .handle_platform_output(&open.window, output.platform_output);
        let scale = output.pixels_per_point;
        let meshes = egui.tessellate(output.shapes, scale);
        let size = (swapchain.extent.width, swapchain.extent.height);
        overlay.prepare(&output.textures_delta, &meshes, size, scale)?;

        let (context, area) = (self.studio.context, vk::Rect2D::from(swapchain.extent));
        let exposure = self.studio.scene.exposure * self.choices.stops.exp2();
        open.window.pre_present_notify();
        let outcome = swapchain.present(self.commands, self.finished, |commands, shown| {
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
                show.record(commands, progress, exposure);
                overlay.record(commands);
                device.cmd_end_rendering(commands);
            }
            let presented = vk::ImageLayout::PRESENT_SRC_KHR;
            change_layout(context, commands, image, attached, presented);
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
        let was_presented = !matches!(
            outcome,
            Outcome::Late | Outcome::Misfit { presented: false }
        );
        if was_presented {
            self.last_presented = Instant::now();
            self.was_lost = false;
        }
        let is_done = progress.is_done(order.spp);
        if is_done && was_presented && !self.has_told {
            let (corner, size) = (panel.min * scale, panel.size() * scale);
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
            self.has_told = true;
        }
        self.has_told &= is_done;
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

    /// Waits for events up to `then` at most, and no longer than a window whose frames are counted
    /// may show nothing.
    fn sleep(&self, events: &ActiveEventLoop, then: Option<Instant>) {
        let deadline = (self.order.frames).map(|_| self.last_presented + PATIENCE);
        let soonest = then.into_iter().chain(deadline).min();
        events.set_control_flow(soonest.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn handle(&mut self, events: &ActiveEventLoop, event: WindowEvent) -> Result<()> {
        let Some(open) = &mut self.open else {
            return Ok(());
        };
        if let WindowEvent::RedrawRequested = event {
            return self.redraw(events);
        }
        let response = open.egui.on_window_event(&open.window, &event);
        if response.repaint {
            open.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => events.exit(),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                open.misfits = true;
                open.window.request_redraw();
            }
            WindowEvent::Occluded(is_hidden) => {
                self.is_hidden = is_hidden;
                open.window.request_redraw();
            }
            WindowEvent::Focused(false) => {
                self.flight.let_go();
                self.drags = false;
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                self.flight.hastens = modifiers.state().shift_key();
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(key) = event.physical_key else {
                    return Ok(());
                };
                let is_pressed = event.state == ElementState::Pressed && !response.consumed;
                if key == KeyCode::Escape && is_pressed {
                    events.exit();
                } else if key == KeyCode::KeyR && is_pressed {
                    self.camera = self.studio.scene.camera;
                }
                self.flight.key(key, is_pressed);
                open.window.request_redraw();
            }
            WindowEvent::MouseInput {
                button: MouseButton::Left,
                state,
                ..
            } => {
                self.drags = state == ElementState::Pressed && !response.consumed;
            }
            WindowEvent::CursorMoved { position, .. } => {
                let (x, y) = self.pointer;
                self.pointer = (position.x, position.y);
                if self.drags {
                    let way = ((position.x - x) as f32, (position.y - y) as f32);
                    turn(&mut self.camera, way, open.window.inner_size().height);
                    open.window.request_redraw();
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn note(&mut self, events: &ActiveEventLoop, done: Result<()>) {
        if let Err(error) = done {
            self.failure.get_or_insert(error);
            events.exit();
        }
    }

    /// What became of it.
    ///
    /// # Errors
    /// It failed, or was closed before it had presented all that was asked for.
    pub fn finish(mut self) -> Result<()> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        match self.order.frames {
            Some(frames) if self.presented < frames => {
                bail!("{} of {frames} frames were presented", self.presented)
            }
            _ => Ok(()),
        }
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.open.is_none() {
            let done = self.open(events);
            self.note(events, done);
        }
        self.last_presented = Instant::now();
        self.sleep(events, None);
        if let Some(open) = &self.open {
            open.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let done = self.handle(events, event);
        self.note(events, done);
    }

    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        let is_stuck = self.open.is_some() && self.last_presented.elapsed() > PATIENCE;
        if self.order.frames.is_some() && is_stuck {
            let seconds = PATIENCE.as_secs();
            let stuck = anyhow!("the window has shown nothing for {seconds} seconds");
            return self.note(events, Err(stuck));
        }
        if let (StartCause::ResumeTimeReached { .. }, Some(open)) = (cause, &self.open) {
            open.window.request_redraw();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The surface may not outlive the connection to the display, which goes with the loop.
        self.open = None;
    }
}

impl Drop for App<'_> {
    fn drop(&mut self) {
        self.open = None;
        let context = self.studio.context;
        // SAFETY: nothing is in flight once the device is idle.
        unsafe {
            let _ = context.device.device_wait_idle();
            context.device.destroy_fence(self.finished, None);
            (context.device).free_command_buffers(context.pool, &[self.commands]);
        }
    }
}
