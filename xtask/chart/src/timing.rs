//! Times of contestants that take turns.

use std::time::Instant;

/// The least time of each contestant, in seconds, over so many rounds in which they take turns.
pub fn alternate(rounds: usize, contestants: &mut [Box<dyn FnMut() + '_>]) -> Vec<f64> {
    let mut best = vec![f64::INFINITY; contestants.len()];
    // The first round warms up.
    for round in 0..=rounds {
        for (contestant, best) in contestants.iter_mut().zip(&mut best) {
            let start = Instant::now();
            contestant();
            if round > 0 {
                *best = best.min(start.elapsed().as_secs_f64());
            }
        }
    }
    best
}
