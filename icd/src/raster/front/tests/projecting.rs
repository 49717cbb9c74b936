//! Vertices on the screen: those of a subgroup, in vectors of each tier, are those of one alone,
//! and what has no place has none.

use lanes::Tier;
use spirv_jit::SUBGROUP_SIZE;

use super::{Random, state};
use crate::raster::front::project::project_lanes;
use crate::raster::front::screen::{GUARD, Screen, ScreenVertex, Volume, code, project};

/// Any bits, or numbers that make sense.
fn word(random: &mut Random) -> u32 {
    match random.u64(..8) {
        0 => random.u64(..) as u32,
        1 => 0,
        2 => f32::INFINITY.to_bits(),
        _ => ((random.f64() * 4.0 - 2.0) as f32).to_bits(),
    }
}

/// With the bits of floats.
fn parts(vertex: &ScreenVertex) -> (i32, i32, u32, u64, u64) {
    let ScreenVertex { x, y, code, .. } = *vertex;
    let (depth, inverse_w) = (vertex.depth.to_bits(), vertex.inverse_w.to_bits());
    (x, y, code, depth, inverse_w)
}

#[test]
fn subgroups_are_projected_as_single_vertices_are() {
    let state = state();
    let mut random = Random::with_seed(23);
    for round in 0..2000 {
        let screen = Screen::new(&state.viewports.viewports[0], round % 2 == 0);
        let volume = Volume {
            depth_clip: round % 3 != 0,
            negative_one_to_one: round % 2 == 0,
        };
        let rows: [[u32; SUBGROUP_SIZE]; 4] =
            std::array::from_fn(|_| std::array::from_fn(|_| word(&mut random)));
        for &tier in Tier::available() {
            let mut vertices = [ScreenVertex::default(); SUBGROUP_SIZE];
            project_lanes(tier, &screen, &volume, rows.each_ref(), &mut vertices);
            for (lane, vertex) in vertices.iter().enumerate() {
                let position = rows.map(|row| f64::from(f32::from_bits(row[lane])));
                let alone = project(&screen, &volume, &position);
                assert_eq!(parts(vertex), parts(&alone), "{tier:?}: {position:?}");
            }
        }
    }
}

/// By the definitions: finite, in front of the eye, not too far away.
#[test]
fn what_has_no_place_is_nowhere() {
    let state = state();
    let screen = Screen::new(&state.viewports.viewports[0], false);
    let volume = Volume {
        depth_clip: true,
        negative_one_to_one: false,
    };
    let mut random = Random::with_seed(29);
    for _ in 0..20_000 {
        let position: [f64; 4] =
            std::array::from_fn(|_| f64::from(f32::from_bits(word(&mut random))));
        let vertex = project(&screen, &volume, &position);
        let is_finite = position.iter().all(|it| it.is_finite());
        let [x, y] = [0, 1].map(|i| position[i] / position[3] * 32.0 + 32.0);
        let is_near = x.abs() < GUARD - 1.0 && y.abs() < GUARD - 1.0;
        assert_eq!(vertex.code & code::NOT_FINITE == 0, is_finite);
        if !is_finite || position[3] <= 0.0 {
            assert_ne!(vertex.code & code::NOWHERE, 0);
        } else if is_near {
            assert_eq!(vertex.code & code::NOWHERE, 0, "{position:?}");
            assert!(
                (f64::from(vertex.x) - x * 256.0).abs() <= 0.51,
                "{position:?}"
            );
        }
        if vertex.code & code::NOWHERE != 0 {
            assert_eq!((vertex.x, vertex.y), (0, 0));
        }
    }
}
