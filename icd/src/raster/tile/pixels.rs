//! Where pixels are among those that a capture counts.

#![forbid(unsafe_code)]

use super::lanes::{LANE_X, LANE_Y};
use super::places::Places;
use crate::wave::launch_counts::{Cells, Counter, LaunchCounts};

/// The cells of some lanes, whose pixels are `1 << logs` apart.
pub fn cells_of(counts: &LaunchCounts, places: &Places, logs: [u8; 2], lanes: u16) -> Cells {
    std::array::from_fn(|lane| {
        let quad = lane / 4;
        let x = places.x[quad] + ((LANE_X[lane] & 1) << logs[0]);
        let y = places.y[quad] + ((LANE_Y[lane] & 1) << logs[1]);
        let pixel = [x as u32, y as u32, places.layer[quad]];
        let is_there = lanes >> lane & 1 != 0;
        is_there.then(|| counts.kept.cell(pixel)).flatten()
    })
}

/// Adds 1 for each of some lanes.
pub fn count_lanes(counts: &LaunchCounts, counter: Counter, places: &Places, lanes: u16) {
    for cell in cells_of(counts, places, [0; 2], lanes)
        .into_iter()
        .flatten()
    {
        counts.add(counter, cell, 1);
    }
}
