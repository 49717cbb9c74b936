//! The order in which workers take tiles: those first that took longest the last time.
//!
//! A tile belongs to one worker, so a round ends when the last tile does. The order changes no
//! result.

use std::cmp::Reverse;

use parking_lot::Mutex;

use crate::raster::primitive::Grid;

/// Grids of tiles whose times are kept: those of the passes of a frame, such as a shadow map's and
/// the window's.
const GRIDS: usize = 4;

/// The times of tiles, kept from one round to the next.
#[derive(Default)]
pub struct Costs {
    /// The newest last.
    grids: Mutex<Vec<(Grid, Vec<u32>)>>,
}

impl Costs {
    /// Sorts tiles of a grid by their last times, the longest first. Times below the same power of
    /// two count as equal, so that neighbours mostly follow each other.
    pub fn sort(&self, grid: &Grid, tiles: &mut [usize]) {
        let grids = self.grids.lock();
        if let Some((_, times)) = grids.iter().find(|(other, _)| other == grid) {
            let bits = |tile: usize| {
                times
                    .get(tile)
                    .map_or(0, |time| u32::BITS - time.leading_zeros())
            };
            tiles.sort_by_key(|&tile| Reverse(bits(tile)));
        }
    }

    /// Keeps the times of tiles of a grid: pairs of a tile's index and nanoseconds.
    pub fn keep(&self, grid: &Grid, measured: &[(usize, u32)]) {
        let mut grids = self.grids.lock();
        let index = match grids.iter().position(|(other, _)| other == grid) {
            Some(index) => index,
            None => {
                if grids.len() == GRIDS {
                    grids.remove(0);
                }
                grids.push((*grid, vec![0; grid.len()]));
                grids.len() - 1
            }
        };
        let times = &mut grids[index].1;
        for &(tile, nanoseconds) in measured {
            if let Some(time) = times.get_mut(tile) {
                *time = nanoseconds;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ash::vk;

    use super::*;

    fn grid(width: u32) -> Grid {
        Grid::of(&vk::Rect2D {
            offset: vk::Offset2D::default(),
            extent: vk::Extent2D { width, height: 64 },
        })
    }

    #[test]
    fn the_longest_tiles_come_first() {
        let costs = Costs::default();
        let (first, second) = (grid(256), grid(320));
        let mut tiles = [0, 1, 3];
        costs.sort(&first, &mut tiles);
        assert_eq!(tiles, [0, 1, 3]);
        costs.keep(&first, &[(0, 10), (1, 40), (3, 20)]);
        costs.keep(&second, &[(0, 5), (4, 50)]);
        costs.sort(&first, &mut tiles);
        assert_eq!(tiles, [1, 3, 0]);
        let mut tiles = [0, 2, 4];
        costs.sort(&second, &mut tiles);
        assert_eq!(tiles, [4, 0, 2]);
        // The oldest grid is forgotten.
        for width in [64, 128, 192] {
            costs.keep(&grid(width), &[(0, 1)]);
        }
        let mut tiles = [0, 1, 3];
        costs.sort(&first, &mut tiles);
        assert_eq!(tiles, [0, 1, 3]);
    }
}
