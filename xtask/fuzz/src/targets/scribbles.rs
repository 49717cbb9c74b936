//! Threads that write into structures while rays walk through them.

use std::sync::atomic::{AtomicBool, Ordering};

use fastrand::Rng;

use tuff_tests::Buffer;

use crate::case::{Case, wild};
use crate::world::World;

/// Dispatches while it goes on.
const ROUNDS: u32 = 12;

pub fn run(world: &World, case: &Case) {
    let over = AtomicBool::new(false);
    let levels = [0, 1].map(|level| Level {
        storage: world.levels[level].storage.expect("it is known"),
        good: &world.good[level],
    });
    let steps: Vec<Rng> = case.steps().collect();
    std::thread::scope(|scope| {
        let over = &over;
        let shared = &levels;
        scope.spawn(move || {
            let mut steps = steps;
            while !over.load(Ordering::Relaxed) && !steps.is_empty() {
                for rng in &mut steps {
                    let Level { storage, good } = &shared[rng.usize(0..2)];
                    let reach = [32, good.len()][rng.usize(0..2)];
                    let at = rng.usize(0..reach - 1);
                    let word = match rng.bool() {
                        true => wild(rng) as u32,
                        false => good[rng.usize(0..good.len())],
                    };
                    storage.write(4 * at, &[word]);
                    if rng.u32(0..4) == 0 {
                        storage.write(4 * at, &good[at..=at]);
                    }
                    if rng.u32(0..64) == 0 {
                        storage.write(0, good);
                    }
                }
            }
        });
        // Ends the writer however this ends.
        let _end = End(over);
        let mut rng = case.common();
        for _ in 0..ROUNDS {
            match rng.u32(0..3) {
                0 => world.trace(),
                1 => world.query(world.levels[1].address, 2),
                _ => world.query(world.levels[1].address, 0),
            }
        }
    });
    for level in levels {
        level.storage.write(0, level.good);
    }
}

/// A structure's memory, and its original contents.
struct Level<'a> {
    storage: Buffer,
    good: &'a [u32],
}

// SAFETY: a mapping that lives as long as the device; that all threads write into it is the point.
unsafe impl Sync for Level<'_> {}

struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
