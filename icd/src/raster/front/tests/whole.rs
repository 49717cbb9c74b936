//! Triangles of a batch become what single triangles become, bit for bit; vertices are found again
//! by their indices.

use std::collections::HashMap;

use lanes::Tier;

use super::{Random, facts, state};
use crate::raster::front::facts::{Bias, BiasUnit, Facts};
use crate::raster::front::screen::ScreenVertex;
use crate::raster::front::set_up::{Primitive, SetUp};
use crate::raster::front::vertices::Unique;
use crate::raster::front::whole::Batch;
use crate::raster::primitive::Chunk;

/// Vertices near each other, far from the screen, or on a line.
fn vertices(random: &mut Random) -> [ScreenVertex; 3] {
    let spread = [40, 300, 3000, 1 << 16, 1 << 24, 1 << 29][random.usize(..6)];
    let middle = [random.i32(0..16384), random.i32(0..16384)];
    let is_flat = random.u8(..8) == 0;
    let is_affine = random.bool();
    std::array::from_fn(|_| {
        let off = random.i32(-spread..=spread);
        let other = match is_flat {
            true => off,
            false => random.i32(-spread..=spread),
        };
        ScreenVertex {
            x: (middle[0] + off).clamp(-1 << 29, 1 << 29),
            y: (middle[1] + other).clamp(-1 << 29, 1 << 29),
            code: 0,
            depth: [random.f64(), 0.0, -0.0, 0.5][random.usize(..4)],
            inverse_w: match is_affine {
                true => 1.0,
                false => random.f64() * 4.0 + 1e-3,
            },
        }
    })
}

fn drawn(facts: &Facts, draw: impl FnOnce(&mut SetUp<'_>)) -> String {
    let mut chunk = Chunk::default();
    draw(&mut SetUp {
        facts,
        chunk: &mut chunk,
        stippled: 0.0,
        clipped: 0,
    });
    // Numbers are printed so that different ones look different, and the sign of zero shows.
    format!("{:?} {:?}", chunk.records, chunk.shapes)
}

#[test]
fn batches_are_set_up_as_single_triangles_are() {
    let mut state = state();
    let mut random = Random::with_seed(7);
    for round in 0..600 {
        state.rasterization.depth_clamp = round % 5 == 0;
        let mut facts = facts(&state, if round % 3 == 0 { 4 } else { 1 });
        facts.cull_positive = round % 4 == 1;
        facts.cull_negative = round % 4 == 2;
        facts.positive_is_front = random.bool();
        facts.bias = (round % 7 == 0).then_some(Bias {
            constant: 2.0,
            slope: 1.5,
            clamp: [0.0, 0.25][round % 2],
            unit: [BiasUnit::FloatOf, BiasUnit::Constant(0.001)][round / 7 % 2],
        });
        let count = random.usize(1..70);
        let triangles: Vec<[ScreenVertex; 3]> = (0..count).map(|_| vertices(&mut random)).collect();
        let primitive = |number: u32| Primitive {
            primitive_id: number,
            provoking: (number % 3) as u8,
            vertices: [3 * number, 3 * number + 1, 3 * number + 2],
            ..Primitive::default()
        };
        let expected = drawn(&facts, |set_up| {
            for (number, triangle) in (0..).zip(&triangles) {
                set_up.whole_triangle(&primitive(number), triangle.each_ref());
            }
        });
        let on_screen = triangles.as_flattened();
        for &tier in Tier::available() {
            let mut batch = Batch::new(tier);
            let given = drawn(&facts, |set_up| {
                for (number, triangle) in (0..).zip(&triangles) {
                    let vertices = [3 * number, 3 * number + 1, 3 * number + 2];
                    if batch.add(number, vertices, triangle.each_ref()) {
                        set_up.whole_triangles(&mut batch, on_screen, &primitive, false);
                    }
                    // Another primitive comes between.
                    if number % 23 == 22 {
                        set_up.whole_triangles(&mut batch, on_screen, &primitive, true);
                    }
                }
                set_up.whole_triangles(&mut batch, on_screen, &primitive, true);
            });
            assert_eq!(given, expected, "{tier:?}, round {round}");
        }
    }
}

#[test]
fn vertices_have_one_place_each() {
    let mut random = Random::with_seed(11);
    let mut unique = Unique::default();
    for round in 0..9000 {
        unique.clear();
        let mut places = HashMap::new();
        // Few, many, and such as lie on each other in the table.
        let count = if round % 100 == 0 { 4000 } else { 20 };
        let step = [1, 8192, 3, u32::MAX / 5][round % 4];
        for _ in 0..count {
            let index = random.u32(..count).wrapping_mul(step);
            let new = places.len() as u32;
            let expected = *places.entry(index).or_insert(new);
            assert_eq!(
                unique.place(index, new),
                expected,
                "index {index}, round {round}"
            );
        }
    }
}
