//! Curves of short lines, as plots and maps draw them: strips from a vertex buffer, each of one
//! colour.

use anyhow::{Result, ensure};
use tuff_tests::{Canvas, Gpu, Painting, Pass, RGBA, vk};

use super::triangles::{Corner, FRAGMENT, VERTEX, of_corners};
use super::{canvas, drawn, draws, size, turn};
use crate::workload::Prepared;
use crate::world::Scale;

/// Curves of a draw, and the lines of each.
const CURVES: u32 = 64;
const LINES: u32 = 256;

/// Draws of a turn.
const REPEATS: u32 = 16;

/// Corners of a curve, in pixels.
fn curve(number: u32, [width, height]: [u32; 2]) -> impl Iterator<Item = [f32; 2]> {
    let [width, height] = [width, height].map(|it| it as f32);
    let phase = number as f32 * 0.7;
    let middle = height * (0.1 + 0.8 * number as f32 / CURVES as f32);
    (0..=LINES).map(move |place| {
        let along = place as f32 / LINES as f32;
        let x = 2.0 + along * (width - 4.0);
        let wave = libm::sinf(along * 23.0 + phase) + 0.4 * libm::sinf(along * 71.0 - phase);
        [x, middle + wave * 0.06 * height]
    })
}

/// Strips of lines of a width; `None` where the driver has none so wide.
pub fn strips(gpu: &Gpu, scale: &Scale, width: f32) -> Option<Prepared> {
    if !draws(gpu) || width != 1.0 && gpu.features.wide_lines == vk::FALSE {
        return None;
    }
    let size = size(scale);
    let mut corners = Vec::new();
    for number in 0..CURVES {
        let color = [
            255,
            (number * 37 % 256) as u8,
            (number * 101 % 256) as u8,
            255,
        ];
        corners.extend(curve(number, size).map(|place| Corner { place, color }));
    }
    let buffer = gpu.buffer_with(&corners);
    let canvas = canvas(gpu, scale, RGBA);
    let mut painting = of_corners(Painting::new(gpu, VERTEX, FRAGMENT, RGBA));
    painting.topology = vk::PrimitiveTopology::LINE_STRIP;
    painting.rasterization.line_width = width;
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0; 4]],
        ..Pass::default()
    };
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &size.map(|it| it as f32));
        gpu.bind_vertices(commands, &buffer);
        for number in 0..CURVES * REPEATS {
            let first = number % CURVES * (LINES + 1);
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_draw(commands, LINES + 1, 1, first, 0) };
        }
    });
    let work = f64::from(CURVES * LINES * REPEATS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check(gpu, &canvas, width)
    }))
}

/// Drivers may differ by a pixel in what a line covers: what is farther from all lines is clear,
/// and along each line there is something to see.
fn check(gpu: &Gpu, canvas: &Canvas, width: f32) -> Result<()> {
    const CLEAR: [u8; 4] = [0; 4];
    let colors = gpu.colors(canvas);
    let [columns, rows] = [canvas.width, canvas.height].map(|it| it as i32);
    let around = |[x, y]: [f32; 2], reach: f32| {
        let range = |at: f32, end: i32| {
            let [low, high] = [at - reach, at + reach].map(|it| it.floor() as i32);
            low.max(0)..(high + 1).min(end)
        };
        let columns_of = range(x, columns);
        range(y, rows)
            .flat_map(move |y| columns_of.clone().map(move |x| (y * columns + x) as usize))
    };
    let mut near = vec![false; colors.len()];
    for number in 0..CURVES {
        let places: Vec<[f32; 2]> = curve(number, [canvas.width, canvas.height]).collect();
        for ends in places.windows(2) {
            let [across, down] = [0, 1].map(|i: usize| ends[1][i] - ends[0][i]);
            let steps = libm::hypotf(across, down).ceil() * 2.0;
            for step in 0..=steps as u32 {
                let share = step as f32 / steps;
                let at = [0, 1].map(|i: usize| ends[0][i] + share * (ends[1][i] - ends[0][i]));
                let is_drawn = around(at, 1.0).any(|pixel| colors[pixel] != CLEAR);
                ensure!(is_drawn, "nothing is drawn at {at:?}");
                around(at, width / 2.0 + 1.0).for_each(|pixel| near[pixel] = true);
            }
        }
    }
    let stray = (near.iter().zip(&colors)).position(|(near, color)| !near && *color != CLEAR);
    ensure!(
        stray.is_none(),
        "pixel {stray:?} is drawn, far from all lines"
    );
    Ok(())
}
