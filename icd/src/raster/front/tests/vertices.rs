//! Vertices are found again by their indices.

use std::collections::HashMap;

use super::Random;
use crate::raster::front::vertices::Unique;

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
