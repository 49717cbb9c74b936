//! A dispatch's grid, cut into tiles of neighbouring invocations (one subgroup each) and batches of
//! tiles.
//!
//! Which invocations share a subgroup, and which subgroups a batch, follows from the dispatch and
//! the pipeline alone, never from the machine: results cannot depend on it.
#![forbid(unsafe_code)]

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::Row;

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
    /// Positions of lanes in a tile.
    offsets: Launches,
}

/// Where the launches of lanes are: their columns and rows. All of a batch are in one layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Launches {
    pub x: Row,
    pub y: Row,
}

impl Grid {
    /// Cuts a grid for a ray generation shader whose subgroup states take `state_bytes` each. One
    /// that `reorders` invocations gets batches as large as they can be: no others are reordered
    /// together.
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
            offsets: offsets(tile),
        }
    }

    /// Batches in the grid.
    pub fn batch_count(&self) -> usize {
        self.batches.iter().map(|&n| n as usize).product()
    }

    /// The column, row and layer of a batch among batches.
    fn place_of(&self, batch: usize) -> [u32; 3] {
        let [nx, ny, _] = self.batches.map(|n| n as usize);
        [batch % nx, batch / nx % ny, batch / (nx * ny)].map(|n| n as u32)
    }

    /// The layer of the launches of a batch.
    pub fn layer(&self, batch: usize) -> u32 {
        self.place_of(batch)[2]
    }

    /// The places of a batch's tiles that have lanes inside the grid, column and row, row by row.
    pub fn tiles(&self, batch: usize) -> impl Iterator<Item = [u32; 2]> + use<> {
        let at = self.place_of(batch);
        let [columns, rows] = [0, 1].map(|axis| {
            let first = at[axis] * self.batch[axis];
            let tiles = self.extent[axis].div_ceil(self.tile[axis]);
            first..tiles.min(first + self.batch[axis])
        });
        rows.flat_map(move |y| columns.clone().map(move |x| [x, y]))
    }

    /// Writes where the launches of a tile's lanes are; returns which are inside the grid.
    #[inline(always)]
    pub fn write_tile(&self, place: [u32; 2], launch: &mut Launches) -> LaneMask {
        let first = [0, 1].map(|axis| place[axis] * self.tile[axis]);
        for lane in 0..SUBGROUP_SIZE {
            launch.x[lane] = first[0] + self.offsets.x[lane];
            launch.y[lane] = first[1] + self.offsets.y[lane];
        }
        let [right, bottom] = [self.extent[0], self.extent[1]];
        match right - first[0] < self.tile[0] || bottom - first[1] < self.tile[1] {
            true => LaneMask::from_fn(|lane| (launch.x[lane] < right) & (launch.y[lane] < bottom)),
            false => LaneMask::ALL,
        }
    }

    /// Where a launch stands among those of its batch: tile by tile, lane by lane, as ray
    /// generation shaders begin.
    pub fn place(&self, x: u32, y: u32) -> u32 {
        let [width, height] = self.tile;
        let (tile_x, tile_y) = (x / width, y / height);
        let [columns, rows] = self.batch;
        let tile = tile_y % rows * columns + tile_x % columns;
        tile * SUBGROUP_SIZE as u32 + lane(self.tile, x % width, y % height)
    }
}

/// The lane of a position in a tile. Two-dimensional tiles are in quad order: lanes 4q..4q+4 are a
/// 2 × 2 block.
fn lane([width, height]: [u32; 2], dx: u32, dy: u32) -> u32 {
    if height == 1 {
        return dx;
    }
    let quad = dy / 2 * (width / 2) + dx / 2;
    4 * quad + dy % 2 * 2 + dx % 2
}

/// The positions of lanes in a tile.
fn offsets(tile: [u32; 2]) -> Launches {
    let mut offsets = Launches::default();
    for dy in 0..tile[1] {
        for dx in 0..tile[0] {
            let lane = lane(tile, dx, dy) as usize;
            (offsets.x[lane], offsets.y[lane]) = (dx, dy);
        }
    }
    offsets
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
                    for place in grid.tiles(batch) {
                        let mut launch = Launches::default();
                        for lane in grid.write_tile(place, &mut launch) {
                            let (x, y) = (launch.x[lane], launch.y[lane]);
                            let place = grid.place(x, y);
                            assert!(last < Some(place) && place % 16 == lane as u32);
                            last = Some(place);
                            let z = grid.layer(batch);
                            assert!(x < extent[0] && y < extent[1] && z < extent[2]);
                            seen[((z * extent[1] + y) * extent[0] + x) as usize] += 1;
                        }
                    }
                }
                assert!(seen.iter().all(|&n| n == 1), "{extent:?}");
            }
        }
    }
}
