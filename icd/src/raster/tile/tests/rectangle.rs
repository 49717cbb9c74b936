//! Rectangles of two triangles: their coverage, pixel by pixel.

use lanes::vector::{Portable, Vector};

use super::support::{Random, edges};
use crate::raster::primitive::{Bounds, Edge};
use crate::raster::tile::lanes::{LANE_X, LANE_Y};
use crate::raster::tile::places::Pattern;
use crate::raster::tile::rectangle::{EdgeTest, Rectangle};

/// The triangles of a rectangle, cut along one of its diagonals.
pub fn halves(least: [i32; 2], greatest: [i32; 2], falls: bool) -> [[[i32; 2]; 3]; 2] {
    let [left, top] = least;
    let [right, bottom] = greatest;
    match falls {
        true => [
            [[left, top], [right, top], [right, bottom]],
            [[left, top], [right, bottom], [left, bottom]],
        ],
        false => [
            [[left, top], [right, top], [left, bottom]],
            [[left, bottom], [right, top], [right, bottom]],
        ],
    }
}

fn covers(edges: &[Edge; 4], x: i32, y: i32) -> bool {
    let inside = |edge: &Edge| {
        let (x, y) = (i64::from(256 * x + 128), i64::from(256 * y + 128));
        i64::from(edge.a) * x + i64::from(edge.b) * y + edge.c >= 0
    };
    edges[..3].iter().all(inside)
}

#[test]
fn cells_are_the_pixels_of_both_triangles() {
    // SAFETY: it asks for nothing.
    let v = unsafe { Portable::new() };
    let mut random = Random::with_seed(0x5eed_0f0f_1234_9876);
    let tile = Bounds {
        left: 64,
        top: 128,
        right: 128,
        bottom: 192,
    };
    for _ in 0..2000 {
        let mut place = |first: i32| {
            let reach = [30, 90][random.i64(0..2) as usize] * 256;
            let least = first * 256 + random.i64(-40 * 256..64 * 256) as i32;
            // Often on pixels' centres or corners.
            let whole = [1, 128, 256][random.i64(0..3) as usize];
            let size = random.i64(1..reach) as i32;
            let (least, size) = (least / whole * whole, size / whole * whole);
            (least, least + size.max(whole))
        };
        let ((left, right), (top, bottom)) = (place(64), place(128));
        let mut corners = halves([left, top], [right, bottom], random.i64(0..2) == 0);
        if random.i64(0..2) == 0 {
            corners.swap(0, 1);
        }
        let mut limit = tile;
        if random.i64(0..2) == 0 {
            limit.right -= random.i64(0..64) as i32;
            limit.top += random.i64(0..64) as i32;
        }
        let [first, second] = corners.map(edges);
        let found = Rectangle::of(&first, &second, &limit).expect("they are a rectangle");
        let side = EdgeTest::new(v, &found.diagonal);
        let mut seen = [[None; 64]; 64];
        for (places, mask) in found.cells(&limit, 0) {
            let inside = side.inside(v, &places);
            for lane in (0..16).filter(|lane| mask >> lane & 1 != 0) {
                let (x, y) = match places.pattern {
                    Pattern::Row => (places.x[0] + lane, places.y[0]),
                    _ => (
                        places.x[0] + LANE_X[lane as usize],
                        places.y[0] + LANE_Y[lane as usize],
                    ),
                };
                let is_first = inside >> lane & 1 != 0;
                let pixel = &mut seen[(y - tile.top) as usize][(x - tile.left) as usize];
                assert_eq!(pixel.replace(is_first), None, "{corners:?} {x} {y}");
            }
        }
        let mut count = 0;
        for y in tile.top..tile.bottom {
            for x in tile.left..tile.right {
                let is_inside = x < limit.right && y >= limit.top;
                let wanted = match (covers(&first, x, y), covers(&second, x, y)) {
                    (true, false) if is_inside => Some(true),
                    (false, true) if is_inside => Some(false),
                    (both, _) => {
                        assert!(!both || !is_inside);
                        None
                    }
                };
                count += u64::from(wanted.is_some());
                let seen = seen[(y - tile.top) as usize][(x - tile.left) as usize];
                assert_eq!(seen, wanted, "{corners:?} {limit:?} {x} {y}");
            }
        }
        assert_eq!(found.area(), count);
    }
}

#[test]
fn others_are_no_rectangles() {
    let bounds = Bounds {
        left: 0,
        top: 0,
        right: 64,
        bottom: 64,
    };
    let pairs = halves([256, 512], [2560, 5120], true);
    let is_rectangle = |corners: [[[i32; 2]; 3]; 2]| {
        let [first, second] = corners.map(edges);
        Rectangle::of(&first, &second, &bounds).is_some()
    };
    assert!(is_rectangle(pairs));
    assert!(!is_rectangle([pairs[0], pairs[0]]));
    // Of the other diagonal.
    assert!(!is_rectangle([
        pairs[0],
        halves([256, 512], [2560, 5120], false)[1]
    ]));
    for triangle in 0..2 {
        for corner in 0..3 {
            for axis in 0..2 {
                let mut moved = pairs;
                moved[triangle][corner][axis] += 1;
                assert!(!is_rectangle(moved), "{moved:?}");
            }
        }
    }
    // Along the diagonal.
    let mut moved = pairs;
    for corner in &mut moved[1] {
        corner[0] += 256;
        corner[1] += 512;
    }
    assert!(!is_rectangle(moved));
}
