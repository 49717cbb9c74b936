//! Small rectangles of two triangles: their blocks, against the coverage of each triangle.

use lanes::Tier;

use super::rectangle;
use super::support::{Random, edges};
use crate::raster::primitive::Bounds;
use crate::raster::tile::coverage::{Covered, convex};
use crate::raster::tile::lanes::{LANE_X, LANE_Y};
use crate::raster::tile::samples::standard;
use crate::raster::tile::small_rectangle::cover_rectangle;

const TILE: Bounds = Bounds {
    left: 64,
    top: 128,
    right: 128,
    bottom: 192,
};

/// By pixel of the tile: whether the first triangle covers it, and whether the second one does.
type Pixels = Vec<[bool; 2]>;

fn set(pixels: &mut Pixels, [x, y]: [u8; 2], lanes: u16, triangle: usize) {
    for lane in (0..16).filter(|lane| lanes >> lane & 1 != 0) {
        let (x, y) = (i32::from(x) + LANE_X[lane], i32::from(y) + LANE_Y[lane]);
        let pixel = &mut pixels[(y * 64 + x) as usize][triangle];
        assert!(!*pixel, "covered twice");
        *pixel = true;
    }
}

fn of_each(corners: [[[i32; 2]; 3]; 2], clip: &Bounds) -> Pixels {
    let mut pixels = vec![[false; 2]; 64 * 64];
    for (triangle, corners) in corners.into_iter().enumerate() {
        let mut covered = Covered::default();
        let (tier, edges) = (Tier::Portable, edges(corners));
        convex(tier, &edges[..3], &TILE, clip, standard(1), &mut covered);
        covered.split(1);
        for block in &covered.blocks {
            set(&mut pixels, [block.x, block.y], block.masks[0], triangle);
        }
    }
    pixels
}

#[test]
fn both_triangles_cover_what_each_covers() {
    let mut random = Random::with_seed(0x1357_9bdf_0246_8ace);
    for _ in 0..3000 {
        let mut place = |first: i32| {
            let least = (first + random.i32(-8..60)) * 256 + random.i32(0..256);
            let reach = [300, 2000, 3500, 40_000][random.usize(0..4)];
            let size = random.i32(1..reach);
            // Often on the centres or corners of pixels.
            let whole = [1, 128, 256][random.usize(0..3)];
            let (least, size) = (least / whole * whole, size / whole * whole);
            (least, least + size.max(whole))
        };
        let ((left, right), (top, bottom)) = (place(64), place(128));
        let mut corners = rectangle::halves([left, top], [right, bottom], random.bool());
        if random.bool() {
            corners.swap(0, 1);
        }
        for triangle in &mut corners {
            triangle.rotate_left(random.usize(0..3));
            if random.bool() {
                triangle.swap(0, 1);
            }
        }
        let mut clip = TILE.intersection(Bounds {
            left: left.div_euclid(256),
            top: top.div_euclid(256),
            right: right.div_euclid(256) + 1,
            bottom: bottom.div_euclid(256) + 1,
        });
        if random.bool() {
            clip.right -= random.i32(0..3);
            clip.top += random.i32(0..3);
        }
        if clip.left >= clip.right || clip.top >= clip.bottom {
            continue;
        }
        let wanted = of_each(corners, &clip);
        for &tier in Tier::available() {
            let blocks = cover_rectangle(tier, [&corners[0], &corners[1]], &TILE, &clip);
            let columns = (clip.right + 3) / 4 - clip.left / 4;
            let rows = (clip.bottom + 3) / 4 - clip.top / 4;
            let Some(blocks) = blocks else {
                assert!(columns * rows > 16, "{corners:?} {clip:?}");
                continue;
            };
            let mut found = vec![[false; 2]; 64 * 64];
            for block in blocks.covered() {
                let place = [block.x, block.y];
                assert_ne!(block.lanes, 0);
                set(&mut found, place, block.first, 0);
                set(&mut found, place, block.lanes & !block.first, 1);
            }
            assert!(found == wanted, "{corners:?} {clip:?} {tier:?}");
        }
    }
}

#[test]
fn other_pairs_are_no_rectangles() {
    let clip = Bounds {
        left: 64,
        top: 128,
        right: 76,
        bottom: 140,
    };
    let (least, greatest) = ([64 * 256, 128 * 256], [70 * 256, 136 * 256]);
    let pair = rectangle::halves(least, greatest, true);
    let are_rectangles = |[first, second]: [[[i32; 2]; 3]; 2]| {
        cover_rectangle(Tier::Portable, [&first, &second], &TILE, &clip).is_some()
    };
    assert!(are_rectangles(pair));
    assert!(!are_rectangles([pair[0], pair[0]]));
    let other = rectangle::halves(least, greatest, false);
    for triangle in other {
        assert!(!are_rectangles([pair[0], triangle]));
    }
    for triangle in 0..2 {
        for corner in 0..3 {
            for axis in 0..2 {
                for step in [-1, 1] {
                    let mut moved = pair;
                    moved[triangle][corner][axis] += step;
                    assert!(!are_rectangles(moved), "{moved:?}");
                }
            }
        }
    }
}
