//! Bins list the shapes to draw, in order.

use ash::vk;

use super::super::bins::fill;
use super::super::facts::{DepthFormat, Facts};
use super::*;
use crate::raster::TILE;
use crate::raster::primitive::Grid;

#[test]
fn bins_have_the_shapes_of_their_samples() {
    let mut random = Random::with_seed(40);
    // Off the grid of tiles, and not a multiple of a tile.
    let area = vk::Rect2D {
        offset: vk::Offset2D { x: 70, y: 130 },
        extent: vk::Extent2D {
            width: 333,
            height: 201,
        },
    };
    let mut state = state();
    state.viewports.viewports[0].width = 512.0;
    state.viewports.viewports[0].height = 512.0;
    state.viewports.scissors[0] = area;
    let facts = Facts::new(&state, &area, 4, 1, DepthFormat::None);
    let mut chunk = Chunk::default();
    for round in 0..60 {
        let size = if round % 2 == 0 { 2.2 } else { 0.2 };
        let base = [0, 1].map(|_| random.f64() * 2.0 - 1.0);
        let positions: [Clip; 3] = std::array::from_fn(|_| {
            let mut near = |c: f64| c + (random.f64() - 0.5) * size;
            [near(base[0]), near(base[1]), 0.5, 1.0]
        });
        let one = triangle(&facts, positions);
        for mut shape in one.shapes {
            shape.record += chunk.records.len() as u32;
            chunk.shapes.push(shape);
        }
        chunk.records.extend(one.records);
    }
    let grid = Grid::of(&area);
    assert!(fill(&grid, &mut chunk).is_ok());
    let bins = &chunk.bins;
    assert_eq!(bins.starts.len(), grid.len() + 1);
    for tile in 0..grid.len() {
        let shapes = bins.shapes_of(tile);
        assert!(shapes.is_sorted_by(|a, b| a < b));
        let bounds = grid.bounds(tile);
        let listed = |index: usize| shapes.contains(&(index as u32));
        for (index, shape) in chunk.shapes.iter().enumerate() {
            let samples = (0..TILE as i64).step_by(3).flat_map(|y| {
                (0..TILE as i64).step_by(3).map(move |x| {
                    [
                        256 * (i64::from(bounds.left) + x) + 96,
                        256 * (i64::from(bounds.top) + y) + 32,
                    ]
                })
            });
            let is_seen = samples
                .into_iter()
                .any(|[x, y]| covers(&chunk, shape, x, y));
            assert!(!is_seen || listed(index), "tile {tile}, shape {index}");
        }
    }
}
