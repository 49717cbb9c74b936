//! The workload `path` in f64, written a second time: what its picture is without rounding to f32.
//!
//! The scene is the one that drivers get, number by number, and so are the shaders' constants and
//! random numbers.

use std::path::PathBuf;

use anyhow::{Context, Result};
use glam::{DVec3, dvec3};
use rayon::prelude::*;

use crate::scene::{self, Mesh};
use crate::world::{Scale, camera, rows};

#[derive(clap::Args)]
pub struct Options {
    #[command(flatten)]
    scale: Scale,
    /// Write the picture here, as raw 32-bit floats, four a pixel
    #[arg(long, value_name = "FILE")]
    picture: PathBuf,
}

/// Draws and writes the picture.
pub fn reference(options: &Options) -> Result<()> {
    let scale = options.scale;
    let tree = Tree::new(triangles(&scale));
    let view = camera(&scale).map(wide);
    let pixels: Vec<[f32; 4]> = (0..scale.width * scale.height)
        .into_par_iter()
        .map(|number| {
            let at = [number % scale.width, number / scale.width];
            let size = [scale.width, scale.height];
            let place = |i: usize| (f64::from(at[i]) + 0.5) / f64::from(size[i]) * 2.0 - 1.0;
            let [eye, right, up, ahead] = view;
            let way = (ahead + place(0) * right - place(1) * up).normalize();
            path(&tree, eye, way, hash(number))
        })
        .collect();
    let bytes: &[u8] = bytemuck::cast_slice(&pixels);
    std::fs::write(&options.picture, bytes)
        .with_context(|| format!("writing {}", options.picture.display()))
}

fn wide(v: [f32; 3]) -> DVec3 {
    dvec3(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]))
}

/// A constant of the shaders, which is rounded there.
fn constant(value: f32) -> f64 {
    f64::from(value)
}

/// `path.glsl`.
fn path(tree: &Tree, eye: DVec3, way: DVec3, mut seed: u32) -> [f32; 4] {
    let (mut at, mut way) = (eye, way);
    let (mut weight, mut colour) = (DVec3::ONE, DVec3::ZERO);
    let mut rays = 0.0;
    for _ in 0..8 {
        rays += 1.0;
        let Some((t, triangle)) = tree.closest(at, way) else {
            colour = weight * sky(way);
            break;
        };
        let [a, b, c] = triangle.corners;
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(way) > 0.0 {
            -normal
        } else {
            normal
        };
        weight *= paint(triangle.material);
        at += way * t + normal * constant(1e-2);
        way = scattered(normal, &mut seed);
    }
    let [r, g, b] = colour.to_array();
    [r as f32, g as f32, b as f32, rays]
}

fn hash(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

fn random(seed: &mut u32) -> f64 {
    *seed = seed.wrapping_add(0x9e37_79b9);
    f64::from(hash(*seed) >> 8) / 16_777_216.0
}

fn sky(way: DVec3) -> DVec3 {
    let (low, high) = (wide([0.9, 0.8, 0.7]), wide([0.3, 0.5, 0.9]));
    low.lerp(high, 0.5 + 0.5 * way.y)
}

fn paint(material: u32) -> DVec3 {
    let bits = hash(material.wrapping_add(7));
    let channel = |shift: u32| f64::from(bits >> shift & 255);
    constant(0.3) + 0.5 * dvec3(channel(0), channel(8), channel(16)) / 255.0
}

fn scattered(normal: DVec3, seed: &mut u32) -> DVec3 {
    let z = 1.0 - 2.0 * random(seed);
    let turn = constant(std::f32::consts::TAU) * random(seed);
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sine, cosine) = libm::sincos(turn);
    let direction = dvec3(r * cosine, r * sine, z);
    (normal + direction * constant(0.999)).normalize()
}

/// A triangle in the world.
#[derive(Clone, Copy)]
struct Triangle {
    corners: [DVec3; 3],
    material: u32,
}

/// The ground, and the balls where their transforms put them.
fn triangles(scale: &Scale) -> Vec<Triangle> {
    let (ground, ball) = (scene::hills(scale.triangles), scene::ball(4));
    let mut all = Vec::new();
    add(&mut all, &ground, 0, |corner| corner);
    for (number, placed) in scene::placements(scale.instances, 1).iter().enumerate() {
        let m = rows(&placed.transform).map(f64::from);
        let row = |i: usize| dvec3(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
        add(&mut all, &ball, number as u32 + 1, |corner| {
            let turned = dvec3(row(0).dot(corner), row(1).dot(corner), row(2).dot(corner));
            turned + dvec3(m[3], m[7], m[11])
        });
    }
    all
}

fn add(all: &mut Vec<Triangle>, mesh: &Mesh, material: u32, place: impl Fn(DVec3) -> DVec3) {
    let corner = |index: u32| place(wide(mesh.corners[index as usize]));
    let faces = mesh.indices.chunks_exact(3);
    all.extend(faces.map(|face| Triangle {
        corners: [corner(face[0]), corner(face[1]), corner(face[2])],
        material,
    }));
}

/// Triangles in a tree of halves by the median.
struct Tree {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

struct Node {
    low: DVec3,
    high: DVec3,
    first: usize,
    count: usize,
    /// The second child's number; the first one's is the next. 0: a leaf.
    second: usize,
}

impl Tree {
    fn new(mut triangles: Vec<Triangle>) -> Tree {
        let mut nodes = Vec::new();
        let count = triangles.len();
        split(&mut nodes, &mut triangles, 0, count);
        Tree { triangles, nodes }
    }

    /// The nearest triangle in `(0.001, 1000000)`, and its distance.
    fn closest(&self, origin: DVec3, way: DVec3) -> Option<(f64, &Triangle)> {
        let inverse = way.recip();
        let (mut best, mut far) = (None, 1e6);
        let mut pending = vec![0];
        while let Some(number) = pending.pop() {
            let node = &self.nodes[number];
            let (a, b) = (
                (node.low - origin) * inverse,
                (node.high - origin) * inverse,
            );
            // Boxes have room to spare for this arithmetic.
            if a.min(b).max_element() > a.max(b).min_element().min(far) {
                continue;
            }
            if node.second != 0 {
                pending.extend([number + 1, node.second]);
                continue;
            }
            for triangle in &self.triangles[node.first..node.first + node.count] {
                if let Some(t) = intersect(origin, way, &triangle.corners)
                    && t > constant(1e-3)
                    && t < far
                {
                    (best, far) = (Some(triangle), t);
                }
            }
        }
        best.map(|triangle| (far, triangle))
    }
}

fn split(nodes: &mut Vec<Node>, triangles: &mut [Triangle], first: usize, count: usize) {
    let corners = || triangles.iter().flat_map(|triangle| triangle.corners);
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    let number = nodes.len();
    nodes.push(Node {
        low: low - 1e-9,
        high: high + 1e-9,
        first,
        count,
        second: 0,
    });
    if count <= 4 {
        return;
    }
    let size = high - low;
    let axis = (0..3)
        .max_by(|&i, &j| size[i].total_cmp(&size[j]))
        .unwrap_or(0);
    let middle = |triangle: &Triangle| triangle.corners.iter().map(|c| c[axis]).sum::<f64>();
    let half = count / 2;
    triangles.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (below, above) = triangles.split_at_mut(half);
    split(nodes, below, first, half);
    nodes[number].second = nodes.len();
    split(nodes, above, first + half, count - half);
}

/// Möller and Trumbore (1997).
fn intersect(origin: DVec3, way: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<f64> {
    let (first, second) = (*b - *a, *c - *a);
    let p = way.cross(second);
    let inverse = 1.0 / first.dot(p);
    let s = origin - *a;
    let q = s.cross(first);
    let (u, v) = (s.dot(p) * inverse, way.dot(q) * inverse);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| second.dot(q) * inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_finds_what_a_search_of_all_finds() {
        let scale = Scale {
            width: 1,
            height: 1,
            triangles: 2_000,
            instances: 3,
            no_any_hit: false,
        };
        let tree = Tree::new(triangles(&scale));
        let eye = dvec3(-14.0, 7.0, -22.0);
        for number in 0..200u32 {
            let mut seed = number;
            let way = dvec3(random(&mut seed), -random(&mut seed), random(&mut seed)).normalize();
            let all = tree
                .triangles
                .iter()
                .filter_map(|it| intersect(eye, way, &it.corners));
            let nearest = all.filter(|&t| t > 1e-3 && t < 1e6).min_by(f64::total_cmp);
            assert_eq!(tree.closest(eye, way).map(|found| found.0), nearest);
        }
    }
}
