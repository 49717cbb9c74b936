//! The effects of the window's events: close, resize, look around and move.

use anyhow::Result;
use winit::event::{ElementState, MouseButton, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::{KeyCode, PhysicalKey};

use super::App;
use crate::flight::turn;

impl App<'_> {
    pub(super) fn handle(&mut self, events: &ActiveEventLoop, event: WindowEvent) -> Result<()> {
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
}
