//! The panel: the settings, and the progress so far.
#![forbid(unsafe_code)]

use egui::{Context, Frame, Rect, Shadow, Slider, Window};

/// The settings of the person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choices {
    /// Stops of exposure above the scene's own.
    pub stops: f32,
    pub bounces: u32,
    /// The part of the window, from the left, that is rasterized.
    pub split: f32,
}

impl Choices {
    /// The first column that is traced, of a window of so many.
    pub fn first_traced(&self, width: u32) -> u32 {
        (self.split * width as f32).round() as u32
    }
}

/// The values that the panel shows.
pub struct News {
    pub device: String,
    pub samples: u32,
    pub rays_per_second: f64,
}

/// Lays out the panel; returns its rectangle, in points.
pub fn lay_out(context: &Context, choices: &mut Choices, news: &News) -> Rect {
    let frame = Frame::window(&context.style()).shadow(Shadow::NONE);
    let panel = Window::new("Tuff")
        .frame(frame)
        .default_pos([8.0, 8.0])
        .resizable(false);
    let laid_out = panel.show(context, |ui| {
        ui.label(&news.device);
        ui.label(format!("samples: {}", news.samples));
        ui.label(format!("Mrays a second: {:.2}", news.rays_per_second / 1e6));
        let stops = Slider::new(&mut choices.stops, -6.0..=6.0);
        ui.add(stops.text("exposure"));
        let bounces = Slider::new(&mut choices.bounces, 1..=32);
        ui.add(bounces.text("bounces"));
        let split = Slider::new(&mut choices.split, 0.0..=1.0);
        ui.add(split.show_value(false).text("rasterized | traced"));
    });
    laid_out.map_or(Rect::NOTHING, |laid_out| laid_out.response.rect)
}
