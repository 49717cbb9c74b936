//! Scenes and rays that meet planes, corners and each other's distances exactly.

use crate::*;
use traversal::*;

/// Boxes that stand on whole numbers, so that planes of nodes meet the rays' origins.
pub fn steps() -> Mesh {
    let mut mesh = Mesh {
        vertices: Vec::new(),
        indices: Vec::new(),
        opaque: true,
    };
    for x in -6..6 {
        for z in -6..6 {
            let first = mesh.vertices.len() as u32;
            let height = ((x * 5 + z * 3) & 3) as f32 - 2.0;
            for (dx, dz) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                mesh.vertices
                    .push([(x + dx) as f32, height, (z + dz) as f32]);
            }
            mesh.indices.push([first, first + 1, first + 2]);
            mesh.indices.push([first, first + 2, first + 3]);
        }
    }
    mesh
}

/// Rays along axes and planes, with zeros of both signs, of all lengths, through corners, and some
/// that are not sound.
pub fn rays() -> Vec<Ray> {
    let mut random = Random(0x0123_4567_89AB_CDEF);
    let mut rays = Vec::new();
    let tiny = [
        0.0, -0.0, 1.0e-42, -1.0e-38, 1.0e-30, -1.0e-12, 1.0, -1.0, 0.5, -2.0,
    ];
    for i in 0..4800 {
        let mut pick = |of: &[f32]| of[(random.unit() * of.len() as f64) as usize % of.len()];
        let mut direction = [pick(&tiny), pick(&tiny), pick(&tiny)];
        let half = [-3.0, -1.5, -1.0, -0.0, 0.0, 0.5, 1.0, 2.0, 2.25, 8.0];
        let mut origin = [pick(&half), pick(&half), pick(&half)];
        if i % 3 == 0 {
            let length = pick(&[1.0e-20, 1.0e-3, 1.0, 1.0e15]);
            direction = narrow(random.direction()).map(|c| c * length);
        }
        if i % 97 == 0 {
            origin[i % 2] = [f32::NAN, f32::INFINITY, 3.0e38][i % 3];
        }
        let mut ray = ray(origin, direction);
        ray.t_max = [f32::INFINITY, 4.0, 0.5, -1.0][if i % 5 == 0 { i % 4 } else { 0 }];
        rays.push(ray);
    }
    rays
}

/// The plainest walker there is.
pub fn plain() -> Box<Walker> {
    let without = Specialisation::ALL.into_iter().map(|(_, one)| one);
    Walker::with(Options {
        tier: Tier::Portable,
        without: without.collect(),
        ..Options::default()
    })
    .unwrap()
}
