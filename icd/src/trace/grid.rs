//! A dispatch's grid, cut into tiles of neighbouring invocations (one subgroup each) and batches of tiles.
//!
//! Which invocations share a subgroup, and which subgroups a batch, follows from the dispatch and the pipeline alone, never from the
//! machine: results cannot depend on it.
#![forbid(unsafe_code)]

use spirv_jit::SUBGROUP_SIZE;

/// Bytes of subgroup states that a batch aims at: what a worker keeps in its second-level cache.
const BATCH_BYTES: usize = 512 * 1024;
/// The least and the most subgroups that these come to.
const BATCH_SUBGROUPS: [usize; 2] = [32, 256];
/// Batches that even a small grid is cut into, so that many threads have work ...
const MIN_BATCHES: u64 = 28;
/// ... unless each had fewer subgroups than this.
const MIN_BATCH_SUBGROUPS: u64 = 16;

/// The invocations of `vkCmdTraceRays*`: `width * height * depth` of them, tiled.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Width, height, depth in invocations.
    pub extent: [u32; 3],
    /// Width and height of a tile in invocations; their product is the subgroup size.
    tile: [u32; 2],
    /// Width and height of a batch in tiles.
    batch: [u32; 2],
    /// Batches in x, y, z.
    batches: [u32; 3],
    /// For a launch index's row and column.
    width: Divisor,
    height: Divisor,
}

/// One tile: the linear launch index of each lane and which lanes are inside the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    pub launch: [u32; SUBGROUP_SIZE],
    pub mask: u16,
}

/// A number to divide by, many times: by multiplication (Lemire, Kaser, Kurz 2019).
#[derive(Clone, Copy, Debug)]
struct Divisor {
    /// 2⁶⁴ over the divisor, rounded up; 0 for 1.
    reciprocal: u64,
}

impl Divisor {
    /// Zero, which nothing is divided by, counts as one.
    fn new(divisor: u32) -> Self {
        Self {
            reciprocal: match divisor {
                0 | 1 => 0,
                _ => u64::MAX / u64::from(divisor) + 1,
            },
        }
    }

    fn divide(self, number: u32) -> u32 {
        match self.reciprocal {
            0 => number,
            reciprocal => ((u128::from(number) * u128::from(reciprocal)) >> 64) as u32,
        }
    }
}

impl Grid {
    /// Cuts a grid for a ray generation shader whose subgroup states take `state_bytes` each. One that `reorders` invocations gets batches
    /// as large as they can be: no others are reordered together.
    pub fn new(extent: [u32; 3], state_bytes: usize, reorders: bool) -> Self {
        let tile = match extent[1] {
            0 | 1 => [16, 1],
            2 | 3 => [8, 2],
            _ => [4, 4],
        };
        let [least, most] = BATCH_SUBGROUPS;
        let subgroups = (BATCH_BYTES / state_bytes.max(1))
            .clamp(least, most)
            .next_power_of_two();
        let subgroups = match reorders {
            true => subgroups,
            false => subgroups.min(share_of(extent, tile)),
        };
        let batch = if extent[1] <= 1 {
            [subgroups as u32, 1]
        } else {
            let log = subgroups.trailing_zeros();
            [1 << log.div_ceil(2), 1 << (log / 2)]
        };
        let batches = [
            extent[0].div_ceil(tile[0] * batch[0]),
            extent[1].div_ceil(tile[1] * batch[1]),
            extent[2],
        ];
        Self {
            extent,
            tile,
            batch,
            batches,
            width: Divisor::new(extent[0]),
            height: Divisor::new(extent[1]),
        }
    }

    /// Batches in the grid.
    pub fn batch_count(&self) -> usize {
        self.batches.iter().map(|&n| n as usize).product()
    }

    /// The tiles of a batch that have lanes inside the grid, row by row.
    pub fn tiles(&self, batch: usize) -> impl Iterator<Item = Tile> + '_ {
        let [nx, ny, _] = self.batches.map(|n| n as usize);
        let (bx, by, z) = (batch % nx, batch / nx % ny, batch / (nx * ny));
        let first = [bx as u32 * self.batch[0], by as u32 * self.batch[1]];
        let [columns, rows] = [0, 1].map(|axis| {
            let tiles = self.extent[axis].div_ceil(self.tile[axis]);
            first[axis]..tiles.min(first[axis] + self.batch[axis])
        });
        rows.flat_map(move |y| columns.clone().map(move |x| self.tile(x, y, z as u32)))
    }

    fn tile(&self, tile_x: u32, tile_y: u32, z: u32) -> Tile {
        let mut tile = Tile {
            launch: [0; SUBGROUP_SIZE],
            mask: 0,
        };
        let [width, height, _] = self.extent;
        for lane in 0..SUBGROUP_SIZE as u32 {
            let (dx, dy) = self.lane_offset(lane);
            let (x, y) = (tile_x * self.tile[0] + dx, tile_y * self.tile[1] + dy);
            if x < width && y < height {
                tile.mask |= 1 << lane;
                tile.launch[lane as usize] = (z * height + y) * width + x;
            }
        }
        tile
    }

    /// Position of a lane in its tile. Two-dimensional tiles are in quad order: lanes 4q..4q+4 are a 2 × 2 block.
    fn lane_offset(&self, lane: u32) -> (u32, u32) {
        if self.tile[1] == 1 {
            return (lane, 0);
        }
        let (quad, in_quad) = (lane / 4, lane % 4);
        let quads_x = self.tile[0] / 2;
        (
            quad % quads_x * 2 + in_quad % 2,
            quad / quads_x * 2 + in_quad / 2,
        )
    }

    /// `LaunchIdKHR` of a linear launch index.
    pub fn launch_id(&self, launch: u32) -> [u32; 3] {
        let [width, height, _] = self.extent;
        let row = self.width.divide(launch);
        let layer = self.height.divide(row);
        [launch - row * width, row - layer * height, layer]
    }

    /// Where a linear launch index stands among those of its batch: tile by tile, lane by lane, as ray generation shaders begin.
    pub fn place(&self, launch: u32) -> u32 {
        let [x, y, _] = self.launch_id(launch);
        let [width, height] = self.tile;
        let (tile_x, tile_y) = (x / width, y / height);
        let [columns, rows] = self.batch;
        let tile = tile_y % rows * columns + tile_x % columns;
        tile * SUBGROUP_SIZE as u32 + self.lane(x % width, y % height)
    }

    /// The lane of a position in a tile: see [`Self::lane_offset`].
    fn lane(&self, dx: u32, dy: u32) -> u32 {
        if self.tile[1] == 1 {
            return dx;
        }
        let quad = dy / 2 * (self.tile[0] / 2) + dx / 2;
        4 * quad + dy % 2 * 2 + dx % 2
    }

    /// A component of `LaunchIdKHR` for each lane.
    pub fn launch_id_row(
        &self,
        launch: &[u32; SUBGROUP_SIZE],
        component: u8,
    ) -> [u32; SUBGROUP_SIZE] {
        launch.map(|launch| self.launch_id(launch)[component as usize])
    }
}

/// Subgroups of each batch if there are [`MIN_BATCHES`]; a power of two.
fn share_of(extent: [u32; 3], tile: [u32; 2]) -> usize {
    let tiles = [extent[0].div_ceil(tile[0]), extent[1].div_ceil(tile[1])];
    let tiles = tiles.into_iter().chain([extent[2]]).map(u64::from);
    let tiles = tiles.fold(1, u64::saturating_mul);
    1 << (tiles / MIN_BATCHES).max(MIN_BATCH_SUBGROUPS).ilog2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn division_by_multiplication_is_exact() {
        let numbers = [
            0,
            1,
            2,
            3,
            6,
            7,
            640,
            641,
            1 << 16,
            0x7FFF_FFFF,
            u32::MAX - 1,
            u32::MAX,
        ];
        for divisor in numbers.into_iter().skip(1) {
            for number in numbers {
                for number in [number, number.wrapping_sub(1), number / divisor * divisor] {
                    assert_eq!(Divisor::new(divisor).divide(number), number / divisor);
                }
            }
        }
    }

    #[test]
    fn small_grids_are_cut_for_many_threads_unless_they_reorder() {
        let batches = |extent, reorders| Grid::new(extent, 64, reorders).batch_count();
        assert_eq!(batches([320, 180, 1], false), 5 * 6);
        assert_eq!(batches([320, 180, 1], true), 5 * 3);
        assert_eq!(batches([40, 22, 1], false), 3 * 2);
        assert_eq!(batches([1920, 1080, 1], false), 30 * 17);
        assert_eq!(batches([256, 1, 1], false), 1);
    }

    #[test]
    fn every_invocation_is_launched_once() {
        for extent in [
            [1, 1, 1],
            [17, 1, 1],
            [1, 17, 1],
            [5, 3, 2],
            [64, 64, 1],
            [33, 2, 3],
            [130, 71, 2],
        ] {
            for state_bytes in [64, 4096, 1 << 20] {
                let grid = Grid::new(extent, state_bytes, state_bytes == 64);
                let count = extent.iter().product::<u32>() as usize;
                let mut seen = vec![0u32; count];
                for batch in 0..grid.batch_count() {
                    let mut last = None;
                    for tile in grid.tiles(batch) {
                        for lane in (0..SUBGROUP_SIZE).filter(|lane| tile.mask >> lane & 1 != 0) {
                            let launch = tile.launch[lane];
                            let place = grid.place(launch);
                            assert!(last < Some(place) && place % 16 == lane as u32);
                            last = Some(place);
                            let [x, y, z] = grid.launch_id(launch);
                            assert!(x < extent[0] && y < extent[1] && z < extent[2]);
                            seen[launch as usize] += 1;
                        }
                    }
                }
                assert!(seen.iter().all(|&n| n == 1), "{extent:?}");
            }
        }
    }
}
