//! The window with its surface, swapchain, picture and drawers.

use anyhow::{Context as _, Result, bail};
use ash::vk;
use egui::ViewportId;
use winit::dpi::PhysicalSize;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use super::App;
use crate::overlay::Overlay;
use crate::progress::{Progress, Sight};
use crate::show::Show;
use crate::surface::Surface;
use crate::swapchain::Swapchain;

/// The program once its window is there.
pub(super) struct Open<'a> {
    pub(super) egui: egui_winit::State,
    pub(super) progress: Option<Progress<'a>>,
    /// For the swapchain's format.
    pub(super) drawers: Option<(vk::Format, Show<'a>, Overlay<'a>)>,
    pub(super) swapchain: Option<Swapchain<'a>>,
    /// Whether the swapchain is to be replaced.
    pub(super) misfits: bool,
    pub(super) surface: Option<Surface<'a>>,
    /// Outlives the surface: it is dropped last.
    pub(super) window: Window,
}

impl App<'_> {
    pub(super) fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
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

    /// Creates the missing or misfit parts; returns whether there is something to draw on.
    pub(super) fn fit(&mut self) -> Result<bool> {
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

    /// Recreates a lost surface. A second loss without a picture in between ends the window.
    pub(super) fn lose_surface(&mut self) -> Result<()> {
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
}
