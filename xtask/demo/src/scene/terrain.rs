//! The lie of the land: a lake among hills, mountains far off, a lawn in front.

use glam::Vec3;
use rayon::prelude::*;

use super::Vertex;
use super::mesh::Part;
use super::noise::{fractal, ridged, smoothstep};

/// Half the side of the terrain, in metres.
pub const EXTENT: f32 = 420.0;
/// Quads along a side.
const QUADS: u32 = 500;
/// Centre of the lake.
pub const LAKE: (f32, f32) = (3.0, -27.0);

/// How far outside the lake's shore a place is: 0 in its centre, 1 on the shore.
pub fn from_lake(x: f32, z: f32) -> f32 {
    let wobble = 1.0 + 0.16 * fractal(x * 0.045, z * 0.045, 3, 0, 91);
    let (dx, dz) = ((x - LAKE.0) / 36.0, (z - LAKE.1) / 21.0);
    (dx * dx + dz * dz).sqrt() * wobble
}

/// The ground's height above the water, in metres.
pub fn height(x: f32, z: f32) -> f32 {
    let r = from_lake(x, z);
    let bed = -3.2 * (1.0 - smoothstep(0.45, 1.04, r));
    let shore = 0.9 * smoothstep(0.97, 1.25, r);
    let lawn = smoothstep(26.0, 12.0, (x * x * 0.55 + (z - 5.0) * (z - 5.0)).sqrt());
    let rolling = 0.55 * fractal(x * 0.06 + 3.0, z * 0.06, 4, 0, 17) * (1.0 - 0.8 * lawn);
    let outside = smoothstep(1.1, 3.4, r);
    let hills = outside
        * (1.0 - lawn)
        * (5.5 + 9.0 * fractal(x * 0.017 + 9.0, z * 0.017 + 4.0, 5, 0, 5)).max(0.4);
    let far = smoothstep(95.0, 330.0, (x * x + (z + 20.0) * (z + 20.0)).sqrt());
    let behind = smoothstep(-20.0, -130.0, z);
    let peaks = far * behind * (6.0 + 105.0 * ridged(x * 0.0062 + 2.3, z * 0.0062 + 7.7, 6, 33));
    bed + shore + hills + peaks + rolling * smoothstep(0.9, 1.3, r)
}

/// The ground's normal, from differences over a step that fits the grid there.
pub fn normal(x: f32, z: f32, step: f32) -> Vec3 {
    let dx = height(x + step, z) - height(x - step, z);
    let dz = height(x, z + step) - height(x, z - step);
    Vec3::new(-dx, 2.0 * step, -dz).normalize()
}

/// Grid lines are dense near the lawn and wide far away.
fn grid_line(s: f32) -> f32 {
    let t = 2.0 * s - 1.0;
    EXTENT * t * (0.085 + 0.915 * t * t)
}

pub fn terrain() -> Part {
    let lines: Vec<f32> = (0..=QUADS)
        .map(|i| grid_line(i as f32 / QUADS as f32))
        .collect();
    let stride = lines.len();
    let heights: Vec<f32> = (0..stride * stride)
        .into_par_iter()
        .map(|i| height(lines[i % stride], lines[i / stride] - 8.0))
        .collect();
    let row = |j: usize| {
        let (lines, heights) = (&lines, &heights);
        (0..stride).map(move |i| {
            let (x, z) = (lines[i], lines[j] - 8.0);
            // The slopes between the neighbours on the grid.
            let (left, right) = (i.saturating_sub(1), (i + 1).min(stride - 1));
            let (back, front) = (j.saturating_sub(1), (j + 1).min(stride - 1));
            let across = heights[j * stride + right] - heights[j * stride + left];
            let along = heights[front * stride + i] - heights[back * stride + i];
            let slope_x = across / (lines[right] - lines[left]);
            let slope_z = along / (lines[front] - lines[back]);
            Vertex {
                position: Vec3::new(x, heights[j * stride + i], z),
                u: x * 0.33,
                normal: Vec3::new(-slope_x, 1.0, -slope_z).normalize(),
                v: z * 0.33,
            }
        })
    };
    let vertices = (0..stride).into_par_iter().flat_map_iter(row).collect();
    let mut part = Part {
        vertices,
        indices: Vec::new(),
    };
    let stride = QUADS + 1;
    for j in 0..QUADS {
        for i in 0..QUADS {
            let a = j * stride + i;
            part.quad(a, a + stride, a + stride + 1, a + 1);
        }
    }
    part
}

/// The water: a plane at height 0 that ends under the ground.
pub fn water() -> Part {
    let mut part = Part::default();
    let corner = |x: f32, z: f32| Vec3::new(LAKE.0 + x, 0.0, LAKE.1 + z);
    let corners = [(-60.0, 40.0), (60.0, 40.0), (60.0, -45.0), (-60.0, -45.0)]
        .map(|(x, z)| part.vertex(corner(x, z), Vec3::Y, (x, z)));
    part.quad(corners[0], corners[1], corners[2], corners[3]);
    part
}
