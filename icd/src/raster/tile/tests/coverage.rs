//! Coverage against sums in 128 bits, sample by sample.

use lanes::Tier;

use super::support::{Random, edges};
use crate::raster::Chunk;
use crate::raster::primitive::{Bounds, Coverage, Edge, Shape};
use crate::raster::tile::coverage::{
    Block, Covered, SmallBlock, convex, in_tile, listed, small_shape,
};
use crate::raster::tile::lanes::{LANE_X, LANE_Y};
use crate::raster::tile::samples::{Location, fixed_point, masks_of, standard};
use crate::raster::tile::upright::cover_upright;

/// Samples of the pixels of a tile.
type Samples = Vec<[bool; 8]>;

fn expected(edges: &[Edge], tile: &Bounds, clip: &Bounds, locations: &[Location]) -> Samples {
    let mut all = vec![[false; 8]; 64 * 64];
    for (index, covered) in all.iter_mut().enumerate() {
        let (x, y) = (tile.left + index as i32 % 64, tile.top + index as i32 / 64);
        if x < clip.left || x >= clip.right || y < clip.top || y >= clip.bottom {
            continue;
        }
        for (sample, &location) in locations.iter().enumerate() {
            let [sx, sy] = fixed_point(location).map(i128::from);
            let (px, py) = (i128::from(x) * 256 + sx, i128::from(y) * 256 + sy);
            covered[sample] = edges.iter().all(|edge| {
                i128::from(edge.a) * px + i128::from(edge.b) * py + i128::from(edge.c) >= 0
            });
        }
    }
    all
}

fn found(blocks: &[Block], samples: u32) -> Samples {
    let mut all = vec![[false; 8]; 64 * 64];
    for block in blocks {
        for sample in 0..8 {
            for lane in 0..16 {
                let x = i32::from(block.x) + LANE_X[lane];
                let y = i32::from(block.y) + LANE_Y[lane];
                if block.masks[sample] >> lane & 1 != 0 {
                    assert!((sample as u32) < samples, "a sample that is not there");
                    let place = &mut all[(y * 64 + x) as usize][sample];
                    assert!(!*place, "covered twice");
                    *place = true;
                }
            }
        }
    }
    all
}

fn tile(x: i32, y: i32) -> Bounds {
    Bounds {
        left: x * 64,
        top: y * 64,
        right: x * 64 + 64,
        bottom: y * 64 + 64,
    }
}

fn check(edges: &[Edge], tile: &Bounds, clip: &Bounds) {
    // At the ends of their range, and two at one place.
    let custom: [Location; 4] = [[0, 15], [15, 0], [3, 3], [3, 3]];
    let all = [1, 2, 4, 8].map(standard);
    for locations in all.into_iter().chain([&custom[..]]) {
        let samples = locations.len() as u32;
        let wanted = expected(edges, tile, clip, locations);
        for &tier in Tier::available() {
            let mut covered = Covered::default();
            convex(tier, edges, tile, clip, locations, &mut covered);
            covered.split(samples);
            let same = found(&covered.blocks, samples) == wanted;
            assert!(same, "{edges:?} in {clip:?}, {locations:?}, {tier:?}");
        }
    }
}

#[test]
fn triangles_of_all_sizes_cover_what_their_edges_say() {
    let mut random = Random::with_seed(0x1234_5678_9abc_def1);
    for round in 0..300 {
        // From less than a pixel to far beyond the greatest viewport.
        let size = 1i64 << (7 + round % 22);
        let tile = tile(random.i64(0..8) as i32, random.i64(0..8) as i32);
        let middle = [tile.left, tile.top].map(|it| i64::from(it + 32) * 256);
        let corners = [(); 3].map(|()| middle.map(|it| (it + random.i64(-size..size + 1)) as i32));
        let edges = edges(corners);
        check(&edges[..3], &tile, &tile);
        let mut side = |least: i32| {
            let ends = [(); 2].map(|()| least + random.i64(0..65) as i32);
            (ends[0].min(ends[1]), ends[0].max(ends[1]))
        };
        let ((left, right), (top, bottom)) = (side(tile.left), side(tile.top));
        if left < right && top < bottom {
            let clip = Bounds {
                left,
                top,
                right,
                bottom,
            };
            check(&edges[..3], &tile, &clip);
        }
    }
}

#[test]
fn uprights_cover_what_their_edges_say() {
    let mut random = Random::with_seed(0x5eed_0f90);
    let tile = tile(1, 2);
    let mut are_small = 0;
    for _ in 0..2000 {
        // Often on the centres or corners of pixels.
        let whole = [1, 128, 256][random.usize(0..3)];
        let mut side = |first: i32| {
            let least = first * 256 + random.i32(-20 * 256..64 * 256) / whole * whole;
            let most = [6000, 40_000][random.usize(0..2)];
            (least, least + random.i32(whole..most) / whole * whole)
        };
        let ((left, right), (top, bottom)) = (side(tile.left), side(tile.top));
        let clip = tile.intersection(Bounds {
            left: left >> 8,
            top: top >> 8,
            right: (right >> 8) + 1,
            bottom: (bottom >> 8) + 1 - random.i32(0..3),
        });
        if clip.left >= clip.right || clip.top >= clip.bottom {
            continue;
        }
        let shape = Shape {
            record: 0,
            coverage: Coverage::Upright {
                least: [left, top],
                greatest: [right, bottom],
            },
            bounds: clip,
        };
        let (edges, count) = shape.edges(&Chunk::default());
        let wanted = expected(&edges[..count], &tile, &clip, standard(1));
        let pixels = Bounds::of_centers([left, top], [right, bottom]).intersection(clip);
        let mut covered = Covered::default();
        cover_upright(&in_tile(&pixels, &tile), &mut covered);
        covered.split(1);
        assert!(found(&covered.blocks, 1) == wanted, "{shape:?}");
        let Some(blocks) = small_shape(Tier::Portable, &shape.coverage, &tile, &clip) else {
            continue;
        };
        are_small += 1;
        let block = |it: &_| {
            let &SmallBlock { x, y, lanes } = it;
            assert_ne!(lanes, 0);
            let masks = masks_of(lanes.into());
            Block { x, y, masks }
        };
        let blocks: Vec<Block> = blocks.covered().iter().map(block).collect();
        assert!(found(&blocks, 1) == wanted, "{shape:?}");
    }
    assert!(are_small > 300, "{are_small}");
}

#[test]
fn rectangles_cover_what_their_edges_say() {
    let mut random = Random::with_seed(0x0b0e_11e5);
    for round in 0..200 {
        let tile = tile(2, 3);
        let mut place =
            || [tile.left, tile.top].map(|it| it * 256 + random.i64(0..64 * 256) as i32);
        let (from, to) = (place(), place());
        let [a, b] = [to[0] - from[0], to[1] - from[1]];
        let reach = [1, 200, 3000][round % 3] * 256;
        let at = |[a, b]: [i32; 2], [x, y]: [i32; 2], more: i64| Edge {
            a,
            b,
            c: more - i64::from(a) * i64::from(x) - i64::from(b) * i64::from(y),
        };
        let edges = [
            at([-b, a], from, reach),
            at([b, -a], from, reach),
            at([a, b], from, 0),
            at([-a, -b], to, 0),
        ];
        check(&edges, &tile, &tile);
        let clip = |low: i32, high: i32| (low.min(high) >> 8, (low.max(high) >> 8) + 1);
        let ((left, right), (top, bottom)) = (clip(from[0], to[0]), clip(from[1], to[1]));
        let clip = Bounds {
            left,
            top,
            right,
            bottom,
        };
        check(&edges, &tile, &clip);
    }
}

#[test]
fn edges_as_long_as_there_are_cover_what_they_say() {
    let mut random = Random::with_seed(0x0dd_ba11_0dd_ba11);
    let tile = tile(511, 511);
    for _ in 0..200 {
        let edge = |random: &mut Random| {
            let (a, b) = (
                random.i64(i64::from(i32::MIN)..i64::from(i32::MAX)),
                random.i64(i64::from(i32::MIN)..i64::from(i32::MAX)),
            );
            let (x, y) = (
                i64::from(tile.left) * 256 + random.i64(0..1 << 14),
                i64::from(tile.top) * 256 + random.i64(0..1 << 14),
            );
            Edge {
                a: a as i32,
                b: b as i32,
                c: -(a * x + b * y),
            }
        };
        let edges = [(); 4].map(|()| edge(&mut random));
        for count in 1..=4 {
            check(&edges[..count], &tile, &tile);
        }
    }
}

#[test]
fn triangles_that_share_edges_cover_each_sample_once() {
    let mut random = Random::with_seed(77);
    let tile = tile(0, 0);
    for _ in 0..50 {
        // A fan around a point inside, closed: corners on the tile's border and beyond.
        let middle = [
            random.i64(4000..12000) as i32,
            random.i64(4000..12000) as i32,
        ];
        let around = [
            [-300, -300],
            [random.i64(0..16000) as i32, -700],
            [17000, -300],
            [18000, random.i64(0..16000) as i32],
            [17000, 17000],
            [-300, 17000],
        ];
        for samples in [1, 4, 8] {
            let mut covered = vec![[0; 8]; 64 * 64];
            for index in 0..around.len() {
                let corners = [middle, around[index], around[(index + 1) % around.len()]];
                let mut shape = Covered::default();
                let edges = edges(corners);
                convex(
                    Tier::best(),
                    &edges[..3],
                    &tile,
                    &tile,
                    standard(samples),
                    &mut shape,
                );
                shape.split(samples);
                for (count, found) in covered.iter_mut().zip(found(&shape.blocks, samples)) {
                    for sample in 0..8 {
                        count[sample] += u32::from(found[sample]);
                    }
                }
            }
            let counted = |counts: &[u32; 8]| counts[..samples as usize].iter().all(|&it| it == 1);
            assert!(covered.iter().all(counted));
        }
    }
}

#[test]
fn listed_pixels_are_covered_with_all_samples() {
    let tile = tile(1, 1);
    let clip = Bounds { left: 66, ..tile };
    let list: Vec<[i16; 2]> = (60..140).map(|at| [at, 64 + (at - 60) / 3]).collect();
    let mut blocks = Vec::new();
    listed(&list, true, &tile, &clip, 4, &mut blocks);
    let found = found(&blocks, 4);
    for (index, samples) in found.iter().enumerate() {
        let place = [64 + index as i16 % 64, 64 + index as i16 / 64];
        let is_listed = list.contains(&place) && place[0] >= 66;
        assert_eq!(samples[..4], [is_listed; 4], "{place:?}");
    }
}
