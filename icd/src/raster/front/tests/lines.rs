//! Lines that are rectangles, against exact arithmetic, and the short way of whole lines against
//! that of all.

use ash::vk;

use super::*;

/// Draws a line in the short way.
fn whole(set_up: &mut SetUp<'_>, primitive: &Primitive, corners: &Corners<'_>) {
    set_up.whole_line(primitive, [corners.screen[0], corners.screen[1]]);
}

#[test]
fn rectangles_cover_what_is_near_the_line() {
    let mut random = Random::with_seed(32);
    for round in 0..400 {
        let mut state = state();
        // Widths in fixed-point units, which are whole.
        let width = [256, 128, 512, 1280, 900][round % 5];
        state.rasterization.line_width = width as f32 / 256.0;
        let facts = facts(&state, 4);
        let mut place = || [(); 2].map(|()| random.i64(0..i64::from(SIDE) * 256));
        let (from, to) = (place(), place());
        let position = |[x, y]: [i64; 2]| at(x as f64, y as f64, 0.5, 1.0);
        let positions = [position(from), position(to), position(to)];
        let chunk = set_up_with(&facts, positions, Default::default(), whole);
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]].map(i128::from);
        let square = dx * dx + dy * dy;
        for y in 0..i64::from(SIDE) {
            for x in 0..i64::from(SIDE) {
                for [sx, sy] in sample_places(4) {
                    let (px, py) = (x * 256 + sx, y * 256 + sy);
                    let [rx, ry] = [px - from[0], py - from[1]].map(i128::from);
                    let (across, along) = (dx * ry - dy * rx, dx * rx + dy * ry);
                    let limit = i128::from(width) * i128::from(width) * square;
                    let beside = (4 * across * across).cmp(&limit);
                    let is_on_edge = beside.is_eq() || along == 0 || along == square;
                    let inside = beside.is_lt() && along > 0 && along < square;
                    if !is_on_edge {
                        let found = coverage(&chunk, px, py);
                        let case = format!("{from:?} to {to:?}, {width} wide, at {px}, {py}");
                        assert_eq!(found, usize::from(inside), "{case}");
                    }
                }
            }
        }
    }
}

#[test]
fn whole_lines_are_lines() {
    let mut random = Random::with_seed(33);
    for round in 0..2000 {
        let mut state = state();
        state.rasterization.line_width = [1.0, 0.5, 3.25, 7.0][round % 4];
        if round % 3 == 0 {
            state.rasterization.line_mode = vk::LineRasterizationModeEXT::BRESENHAM;
        }
        if round % 5 < 2 {
            state.rasterization.line_stipple = true;
            state.rasterization.line_stipple_factor = 1 + round as u32 % 3;
            state.rasterization.line_stipple_pattern = random.u16(..);
        }
        let facts = facts(&state, if round % 2 == 0 { 1 } else { 4 });
        let mut position = || {
            let place = [(); 2].map(|()| random.i64(0..i64::from(SIDE) * 256) as f64);
            at(place[0], place[1], random.f64(), 0.25 + 3.0 * random.f64())
        };
        let (from, to) = (position(), position());
        let drawn = |draw: fn(&mut SetUp<'_>, &Primitive, &Corners<'_>)| {
            let chunk = set_up_with(&facts, [from, to, to], Default::default(), draw);
            let planes = (&chunk.linear, &chunk.extras);
            let shapes = (&chunk.shapes, &chunk.edges, &chunk.pixels);
            format!("{:?} {planes:?} {shapes:?}", chunk.records)
        };
        let slowly = drawn(|set_up, primitive, corners| {
            set_up.line(primitive, corners, [0, 1], true, 0.0);
        });
        assert_eq!(drawn(whole), slowly);
    }
}
