//! Filled triangles that need no clipping, sixteen at a time: a sieve leaves those that are seen,
//! which then get edges and planes.
//!
//! Loops over lanes become vectors by themselves. Their bits are those of
//! [`SetUp::whole_triangle`]: near the screen's origin f64 holds each product and each sum of
//! positions exactly, so that it does not matter whether integers or numbers compute them.

#![forbid(unsafe_code)]

use lanes::Tier;

use super::facts::{Facts, View};
use super::screen::{PIXEL, ScreenVertex, pixels};
use super::set_up::{Primitive, SetUp};
use crate::raster::primitive::{Bounds, Coverage, Edge, Plane, Record, Shape};

/// Triangles of a batch.
const LANES: usize = 16;

/// Fixed-point units from the origin within which f64 is exact: products of two positions have 50
/// bits at most.
const NEAR: i32 = 1 << 24;

type Words = [i32; LANES];
type Numbers = [f64; LANES];

/// Corners of triangles in fixed point: x, y of the first, second and third vertices.
type Places = [[Words; 2]; 3];

/// Triangles of one draw that wait to be set up together, in order.
pub struct Batch {
    tier: Tier,
    /// Triangles to be looked at, and those that are seen.
    candidates: Candidates,
    seen: Seen,
}

#[derive(Default)]
struct Candidates {
    count: usize,
    /// Which vertices they have, and which primitives they are.
    vertices: [[u32; 3]; LANES],
    numbers: [u32; LANES],
    places: Places,
}

#[derive(Default)]
struct Seen {
    count: usize,
    numbers: [u32; LANES],
    places: Places,
    depths: [Numbers; 3],
    inverse_ws: [Numbers; 3],
    bounds: [Bounds; LANES],
    origins: [Words; 2],
    /// All ones where the area is positive.
    is_positive: Words,
}

/// The state that decides which triangles are seen.
struct Sieve {
    centers_only: bool,
    cull_positive: bool,
    cull_negative: bool,
    clipped: Bounds,
    /// Of planes' origins, at least.
    least: [i32; 2],
}

/// Results of a sieve.
#[derive(Default)]
struct Sieved {
    /// Left, top, right, bottom.
    bounds: [Words; 4],
    origins: [Words; 2],
    is_positive: Words,
    /// All ones where there is something to see.
    is_seen: Words,
}

/// Results of set-up.
#[derive(Default)]
struct Made {
    /// a and b, and c, of the edges.
    edges: [[Words; 2]; 3],
    edges_c: [[i64; LANES]; 3],
    depth: [Numbers; 3],
    perspective: [[[f32; LANES]; 3]; 3],
    linear: [[[f32; LANES]; 3]; 3],
    is_affine: Words,
}

/// A pixel's centre in fixed point.
#[inline(always)]
fn center(pixel: i32) -> f64 {
    f64::from(pixel.wrapping_mul(PIXEL).wrapping_add(PIXEL / 2))
}

/// All ones, or zero.
#[inline(always)]
fn mask(holds: bool) -> i32 {
    -i32::from(holds)
}

/// An edge of a triangle: its direction into the inside, and its value at the origin.
#[inline(always)]
fn edge(from: [i32; 2], to: [i32; 2], is_positive: i32) -> (i32, i32, f64) {
    let sign = -(is_positive | 1);
    let a = (from[1] - to[1]) * sign;
    let b = (to[0] - from[0]) * sign;
    let at = f64::from(a) * f64::from(from[0]) + f64::from(b) * f64::from(from[1]);
    let owns = (a > 0) | (a == 0) & (b > 0);
    (a, b, -at - f64::from(u8::from(!owns)))
}

lanes::vectors! {
    /// Finds the triangles that have area, face the right way, and have samples in their bounds.
    fn sieve<V>(_v, sieve: &Sieve, places: &Places, out: &mut Sieved) {
        let [[ax, ay], [bx, by], [cx, cy]] = places;
        for lane in 0..LANES {
            let number = |word: &Words| f64::from(word[lane]);
            let area = (number(bx) - number(ax)) * (number(cy) - number(ay))
                - (number(cx) - number(ax)) * (number(by) - number(ay));
            let is_culled = (area == 0.0)
                | (area > 0.0) & sieve.cull_positive
                | (area < 0.0) & sieve.cull_negative;
            let (x, y) = ([ax[lane], bx[lane], cx[lane]], [ay[lane], by[lane], cy[lane]]);
            let least = |of: [i32; 3]| of[0].min(of[1]).min(of[2]);
            let greatest = |of: [i32; 3]| of[0].max(of[1]).max(of[2]);
            let (left, right) = pixels(least(x), greatest(x), sieve.centers_only);
            let (top, bottom) = pixels(least(y), greatest(y), sieve.centers_only);
            out.origins[0][lane] = left.max(sieve.least[0]);
            out.origins[1][lane] = top.max(sieve.least[1]);
            let (left, right) = (left.max(sieve.clipped.left), right.min(sieve.clipped.right));
            let (top, bottom) = (top.max(sieve.clipped.top), bottom.min(sieve.clipped.bottom));
            out.bounds[0][lane] = left;
            out.bounds[1][lane] = top;
            out.bounds[2][lane] = right;
            out.bounds[3][lane] = bottom;
            out.is_positive[lane] = mask(area > 0.0);
            out.is_seen[lane] = mask(!is_culled & (left < right) & (top < bottom));
        }
        if !sieve.centers_only {
            return;
        }
        // Of a pixel or two, whether the triangle has a centre.
        for lane in 0..LANES {
            let [left, top, right, bottom] = [0, 1, 2, 3].map(|side: usize| out.bounds[side][lane]);
            let (width, height) = (right.wrapping_sub(left), bottom.wrapping_sub(top));
            let is_small = (width == 1) & ((height == 1) | (height == 2)) | (width == 2) & (height == 1);
            let (first, last) = ([center(left), center(top)], [center(right - 1), center(bottom - 1)]);
            let corner = |k: usize| [places[k][0][lane], places[k][1][lane]];
            let mut inside = [true; 2];
            for (from, to) in [(0, 1), (1, 2), (2, 0)] {
                let (a, b, c) = edge(corner(from), corner(to), out.is_positive[lane]);
                let at = |[x, y]: [f64; 2]| f64::from(a) * x + f64::from(b) * y + c;
                inside[0] &= at(first) >= 0.0;
                inside[1] &= at(last) >= 0.0;
            }
            out.is_seen[lane] &= mask(!is_small | inside[0] | inside[1]);
        }
    }
}

lanes::vectors! {
    /// Edges and planes.
    fn make<V>(_v, seen: &Seen, out: &mut Made) {
        const NEXT: [usize; 3] = [1, 2, 0];
        for k in 0..3 {
            let (from, to) = (&seen.places[k], &seen.places[NEXT[k]]);
            for lane in 0..LANES {
                let place = |of: &[Words; 2]| [of[0][lane], of[1][lane]];
                let (a, b, c) = edge(place(from), place(to), seen.is_positive[lane]);
                out.edges[k][0][lane] = a;
                out.edges[k][1][lane] = b;
                // Where one unit in the last place is 1, the low bits of a sum are the integer.
                const ROUNDER: f64 = 6_755_399_441_055_744.0;
                out.edges_c[k][lane] =
                    ((c + ROUNDER).to_bits() as i64).wrapping_sub(ROUNDER.to_bits() as i64);
            }
        }
        let mut linear = [[[0.0; LANES]; 3]; 3];
        let mut inverse = [0.0; LANES];
        let [[ax, ay], [bx, by], [cx, cy]] = &seen.places;
        for lane in 0..LANES {
            let number = |word: &Words| f64::from(word[lane]);
            let area = (number(bx) - number(ax)) * (number(cy) - number(ay))
                - (number(cx) - number(ax)) * (number(by) - number(ay));
            inverse[lane] = 1.0 / area;
        }
        for k in 0..3 {
            let (from, to) = (&seen.places[NEXT[k]], &seen.places[NEXT[NEXT[k]]]);
            for lane in 0..LANES {
                let number = |word: &Words| f64::from(word[lane]);
                let a = number(&from[1]) - number(&to[1]);
                let b = number(&to[0]) - number(&from[0]);
                let x = center(seen.origins[0][lane]) - number(&from[0]);
                let y = center(seen.origins[1][lane]) - number(&from[1]);
                let step = inverse[lane] * f64::from(PIXEL);
                linear[k][0][lane] = (a * x + b * y) * inverse[lane];
                linear[k][1][lane] = a * step;
                linear[k][2][lane] = b * step;
            }
        }
        for part in 0..3 {
            for lane in 0..LANES {
                let depth = |k: usize| seen.depths[k][lane];
                let constant = if part == 0 { depth(0) } else { 0.0 };
                out.depth[part][lane] = constant
                    + linear[1][part][lane] * (depth(1) - depth(0))
                    + linear[2][part][lane] * (depth(2) - depth(0));
            }
        }
        out.is_affine = [-1; LANES];
        for k in 0..3 {
            for part in 0..3 {
                for lane in 0..LANES {
                    let value = linear[k][part][lane];
                    let perspective = value * seen.inverse_ws[k][lane];
                    out.linear[k][part][lane] = value as f32;
                    out.perspective[k][part][lane] = perspective as f32;
                    out.is_affine[lane] &= mask(value == perspective);
                }
            }
        }
    }
}

impl Default for Batch {
    fn default() -> Self {
        Self::new(Tier::best())
    }
}

impl Batch {
    /// An empty one, for the instructions of a tier.
    pub fn new(tier: Tier) -> Self {
        Self {
            tier,
            candidates: Candidates::default(),
            seen: Seen::default(),
        }
    }

    /// Adds a triangle, whose number says which primitive it is; true if the batch is full.
    #[inline(always)]
    pub fn add(&mut self, number: u32, vertices: [u32; 3], on_screen: [&ScreenVertex; 3]) -> bool {
        let it = &mut self.candidates;
        let lane = it.count;
        it.numbers[lane] = number;
        it.vertices[lane] = vertices;
        for (place, vertex) in it.places.iter_mut().zip(on_screen) {
            place[0][lane] = vertex.x;
            place[1][lane] = vertex.y;
        }
        it.count += 1;
        it.count == LANES
    }
}

impl SetUp<'_> {
    /// Sets up the triangles of a batch. Those that are seen may stay in it until there are more of
    /// them, unless it `ends`. `primitive` gives a primitive by its number.
    pub fn whole_triangles(
        &mut self,
        batch: &mut Batch,
        on_screen: &[ScreenVertex],
        primitive: &impl Fn(u32) -> Primitive,
        ends: bool,
    ) {
        let facts = self.facts;
        let Some(view) = facts.views.first() else {
            return;
        };
        let Batch {
            tier,
            candidates,
            seen,
        } = batch;
        let count = std::mem::take(&mut candidates.count);
        if count != 0 {
            self.look_at(*tier, candidates, count, seen, (view, on_screen), primitive);
        }
        if ends {
            self.make(*tier, seen, primitive);
        }
    }

    fn look_at(
        &mut self,
        tier: Tier,
        candidates: &Candidates,
        count: usize,
        seen: &mut Seen,
        (view, on_screen): (&View, &[ScreenVertex]),
        primitive: &impl Fn(u32) -> Primitive,
    ) {
        let vertices = |lane: usize| {
            let [a, b, c] = candidates.vertices[lane];
            [
                &on_screen[a as usize],
                &on_screen[b as usize],
                &on_screen[c as usize],
            ]
        };
        if candidates.is_far() {
            self.make(tier, seen, primitive);
            for lane in 0..count {
                self.whole_triangle(&primitive(candidates.numbers[lane]), vertices(lane));
            }
            return;
        }
        let mut sieved = Sieved::default();
        let rules = Sieve::new(self.facts, view);
        sieve(tier, &rules, &candidates.places, &mut sieved);
        for lane in 0..count {
            if sieved.is_seen[lane] != 0 {
                seen.add(candidates, &sieved, lane, vertices(lane));
                if seen.count == LANES {
                    self.make(tier, seen, primitive);
                }
            }
        }
    }

    /// Adds records and shapes of the triangles that are seen.
    fn make(&mut self, tier: Tier, seen: &mut Seen, primitive: &impl Fn(u32) -> Primitive) {
        let count = std::mem::take(&mut seen.count);
        if count == 0 {
            return;
        }
        let mut made = Made::default();
        make(tier, seen, &mut made);
        let range = self.facts.depth_range(&self.facts.views[0]);
        for lane in 0..count {
            let is_positive = seen.is_positive[lane] != 0;
            let primitive = primitive(seen.numbers[lane]);
            let mut depth = [0, 1, 2].map(|part: usize| made.depth[part][lane]);
            depth[0] += self.facts.bias.as_ref().map_or(0.0, |bias| {
                let slope = depth[1].abs().max(depth[2].abs());
                let greatest = seen.depths.iter().map(|depths| depths[lane].abs());
                bias.of(slope, greatest.fold(0.0, f64::max))
            });
            let plane = |parts: &[[f32; LANES]; 3]| Plane {
                at: parts[0][lane],
                dx: parts[1][lane],
                dy: parts[2][lane],
            };
            let planes =
                |of: &[[[f32; LANES]; 3]; 3]| [plane(&of[0]), plane(&of[1]), plane(&of[2])];
            let record = self.chunk.records.len() as u32;
            self.chunk.records.push(Record {
                draw: primitive.draw,
                primitive_id: primitive.primitive_id,
                layer: primitive.layer,
                view_index: primitive.view_index,
                viewport: primitive.viewport,
                front: is_positive == self.facts.positive_is_front,
                vertices: primitive.vertices,
                provoking: primitive.provoking,
                words: primitive.words,
                origin: [seen.origins[0][lane], seen.origins[1][lane]],
                depth: Plane {
                    at: depth[0] as f32,
                    dx: depth[1] as f32,
                    dy: depth[2] as f32,
                },
                depth_range: range,
                perspective: planes(&made.perspective),
                is_affine: made.is_affine[lane] != 0,
                linear: planes(&made.linear),
                point_coord: Default::default(),
                half: [0.0; 2],
            });
            let edge = |k: usize| Edge {
                a: made.edges[k][0][lane],
                b: made.edges[k][1][lane],
                c: made.edges_c[k][lane],
            };
            self.chunk.shapes.push(Shape {
                record,
                coverage: Coverage::Convex {
                    edges: [edge(0), edge(1), edge(2), Edge::default()],
                    count: 3,
                },
                bounds: seen.bounds[lane],
            });
        }
    }
}

impl Sieve {
    fn new(facts: &Facts, view: &View) -> Self {
        Self {
            centers_only: facts.centers_only,
            cull_positive: facts.cull_positive,
            cull_negative: facts.cull_negative,
            clipped: view.clipped,
            least: [
                view.screen.inside.left.max(0),
                view.screen.inside.top.max(0),
            ],
        }
    }
}

impl Candidates {
    /// Whether a vertex is so far from the origin that f64 might round.
    fn is_far(&self) -> bool {
        let mut far = 0;
        for lanes in self.places.as_flattened() {
            for &place in lanes {
                far |= place.wrapping_add(NEAR) as u32 >> NEAR.ilog2() + 1;
            }
        }
        far != 0
    }
}

impl Seen {
    #[inline(always)]
    fn add(
        &mut self,
        candidates: &Candidates,
        sieved: &Sieved,
        lane: usize,
        vertices: [&ScreenVertex; 3],
    ) {
        let to = self.count;
        self.numbers[to] = candidates.numbers[lane];
        for (k, vertex) in vertices.into_iter().enumerate() {
            self.places[k][0][to] = vertex.x;
            self.places[k][1][to] = vertex.y;
            self.depths[k][to] = vertex.depth;
            self.inverse_ws[k][to] = vertex.inverse_w;
        }
        let [left, top, right, bottom] = &sieved.bounds;
        self.bounds[to] = Bounds {
            left: left[lane],
            top: top[lane],
            right: right[lane],
            bottom: bottom[lane],
        };
        self.origins[0][to] = sieved.origins[0][lane];
        self.origins[1][to] = sieved.origins[1][lane];
        self.is_positive[to] = sieved.is_positive[lane];
        self.count += 1;
    }
}
