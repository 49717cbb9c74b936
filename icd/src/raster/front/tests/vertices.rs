//! Vertices are found again by their indices, and copied from the lanes that shaded them.

use std::collections::HashMap;

use lanes::Row;

use super::Random;
use crate::raster::front::transpose::copy_vertices;
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

#[test]
fn vertices_are_copied_from_their_lanes() {
    let rows: Vec<Row> = (0..11)
        .map(|word| std::array::from_fn(|lane| 100 * word + lane as u32))
        .collect();
    for words in 0..=rows.len() {
        for lanes in 0..=16 {
            // In another order than that of the lanes.
            let starts: Vec<usize> = (0..lanes).map(|lane| lane * 5 % 16 * words).collect();
            let mut copied = vec![u32::MAX; 16 * words];
            copy_vertices(words, |word| &rows[word], &starts, &mut copied);
            let mut wanted = vec![u32::MAX; 16 * words];
            for (lane, start) in starts.into_iter().enumerate() {
                for word in 0..words {
                    wanted[start + word] = rows[word][lane];
                }
            }
            assert_eq!(copied, wanted, "{words} words of {lanes} lanes");
        }
    }
}
