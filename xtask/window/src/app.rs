//! The program from the window's opening to its end.

mod events;
mod open;
mod redraw;

use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use ash::vk;
use demo::scene::Camera;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::window::WindowId;

use crate::flight::Flight;
use crate::panel::Choices;
use crate::progress::Studio;
use open::Open;

/// A window whose frames are counted shows one at least in this time.
const PATIENCE: Duration = Duration::from_secs(60);

/// The options of the command line.
#[derive(Clone, Copy, Debug)]
pub struct WindowOptions {
    pub size: (u32, u32),
    pub spp: u32,
    /// After so many presented pictures it ends.
    pub frames: Option<u64>,
}

pub struct App<'a> {
    studio: Studio<'a>,
    order: WindowOptions,
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
    /// The error that ended it early.
    pub failure: Option<anyhow::Error>,
}

impl<'a> App<'a> {
    pub fn new(studio: Studio<'a>, order: WindowOptions) -> Result<App<'a>> {
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

    /// Waits for events up to `then` at most, and no longer than a window whose frames are counted
    /// may show nothing.
    fn sleep(&self, events: &ActiveEventLoop, then: Option<Instant>) {
        let deadline = (self.order.frames).map(|_| self.last_presented + PATIENCE);
        let soonest = then.into_iter().chain(deadline).min();
        events.set_control_flow(soonest.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn note(&mut self, events: &ActiveEventLoop, done: Result<()>) {
        if let Err(error) = done {
            self.failure.get_or_insert(error);
            events.exit();
        }
    }

    /// The outcome of the program.
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
