//! Where a set of primitives is split: binned planes by the surface area heuristic (Wald 2007).

use super::corners::Corners;
use super::primitive::Primitive;

/// How splits are chosen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplitRules {
    /// Primitives that one step of the walk tests at once.
    pub block: u32,
    /// Fewer primitives than this are not split.
    pub stop: usize,
    /// One over the extent of everything, so that areas neither over- nor underflow.
    pub scale: f32,
    /// Planes across the longest axis are all that is looked at.
    pub hurry: bool,
}

impl SplitRules {
    pub fn new(block: u32, stop: usize, hurry: bool, extent: &Extent) -> SplitRules {
        let [x, y, z, _] = extent.corners.edges();
        let size = x.max(y).max(z);
        let scale = if size > TINY { 1.0 / size } else { 1.0 };
        SplitRules {
            block,
            stop,
            scale,
            hurry,
        }
    }
}

/// An extent below this is none: its reciprocal could overflow.
const TINY: f32 = 1.0e-36;

/// The box of some primitives and the box of their centers.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    pub corners: Corners,
    pub centers: Corners,
}

impl Extent {
    const EMPTY: Extent = Extent {
        corners: Corners::EMPTY,
        centers: Corners::EMPTY,
    };

    #[inline(always)]
    pub fn of(primitives: &[Primitive]) -> Extent {
        let mut extent = Extent::EMPTY;
        for primitive in primitives {
            let corners = primitive.corners();
            extent.corners = extent.corners.join(&corners);
            extent.centers = (extent.centers).join(&Corners::point(corners.center()));
        }
        extent
    }
}

/// A plane between two bins.
pub(crate) struct Split {
    axis: usize,
    /// First bin of the right side.
    plane: f32,
    binning: Binning,
    /// The boxes of both sides.
    sides: [Corners; 2],
}

/// Maps centers to bins.
#[derive(Clone, Copy)]
struct Binning {
    base: [f32; 4],
    factor: [f32; 4],
}

impl Binning {
    #[inline(always)]
    fn new(extent: &Extent, bins: usize) -> Binning {
        let [a, b, c, ..] = extent.centers.0;
        let mut factor = [0.0; 4];
        let size = extent.centers.edges();
        for axis in 0..3 {
            // Just below the number of bins, so that the last center is inside the last bin.
            // An axis without extent maps to bin 0.
            if size[axis] > TINY {
                factor[axis] = bins as f32 * 0.99999 / size[axis];
            }
        }
        Binning {
            base: [a, b, c, 0.0],
            factor,
        }
    }

    #[inline(always)]
    fn bins<const BINS: usize>(&self, center: [f32; 4]) -> [usize; 3] {
        let mut bins = [0i32; 4];
        for i in 0..4 {
            let bin = (center[i] - self.base[i]) * self.factor[i];
            // SAFETY: centers are inside the extent and everything is finite, so this is between 0
            // and `BINS`; the fourth number is multiplied by 0, and NaN only if it is not finite.
            bins[i] = unsafe { (if i < 3 { bin } else { 0.0 }).to_int_unchecked() };
        }
        let [x, y, z, _] = bins;
        [x as usize % BINS, y as usize % BINS, z as usize % BINS]
    }
}

/// The cheapest plane; `None` if all centers fall into one bin.
#[inline(always)]
pub(crate) fn choose<const BINS: usize>(
    primitives: &[Primitive],
    rules: &SplitRules,
    extent: &Extent,
) -> Option<Split> {
    let binning = Binning::new(extent, BINS);
    let mut boxes = [[Corners::EMPTY; 3]; BINS];
    let mut counts = [[0u32; 4]; BINS];
    for primitive in primitives {
        let corners = primitive.corners();
        let bins = binning.bins::<BINS>(corners.center());
        for axis in 0..3 {
            let place = &mut boxes[bins[axis]][axis];
            *place = place.join(&corners);
            counts[bins[axis]][axis] += 1;
        }
    }
    // What the right side of each plane costs, on each axis; then both sides.
    let mut right_cost = [[0f32; 4]; BINS];
    let mut sum = [Corners::EMPTY; 3];
    let mut count = [0; 4];
    for i in (1..BINS).rev() {
        right_cost[i] = add_bin(&mut sum, &mut count, &boxes[i], &counts[i], rules);
    }
    let mut best = (f32::INFINITY, 0, 0);
    let mut sum = [Corners::EMPTY; 3];
    let mut count = [0; 4];
    let total = primitives.len() as u32;
    for i in 1..BINS {
        let cost = add_bin(&mut sum, &mut count, &boxes[i - 1], &counts[i - 1], rules);
        for axis in 0..3 {
            let cost = cost[axis] + right_cost[i][axis];
            // An empty side's cost is not a number, or infinite.
            if cost < best.0 && count[axis] > 0 && count[axis] < total {
                best = (cost, axis, i);
            }
        }
    }
    let (cost, axis, bin) = best;
    if cost == f32::INFINITY {
        return None;
    }
    let side = |bins: &[[Corners; 3]]| {
        bins.iter()
            .fold(Corners::EMPTY, |sum, bin| sum.join(&bin[axis]))
    };
    Some(Split {
        axis,
        plane: bin as f32,
        binning,
        sides: [side(&boxes[..bin]), side(&boxes[bin..])],
    })
}

/// The cheapest plane across the longest axis; `None` if all centers are in one place.
#[inline(always)]
pub(crate) fn choose_quickly<const BINS: usize>(
    primitives: &[Primitive],
    rules: &SplitRules,
    extent: &Extent,
) -> Option<Split> {
    let binning = Binning::new(extent, BINS);
    let axis = longest(extent.centers.edges());
    if binning.factor[axis] == 0.0 {
        return None;
    }
    let mut boxes = [Corners::EMPTY; BINS];
    let mut counts = [0u32; BINS];
    for primitive in primitives {
        let corners = primitive.corners();
        let bin = (corners.center()[axis] - binning.base[axis]) * binning.factor[axis];
        // SAFETY: as in `Binning::bins`.
        let bin = unsafe { bin.to_int_unchecked::<i32>() } as usize % BINS;
        boxes[bin] = boxes[bin].join(&corners);
        counts[bin] += 1;
    }
    let mut right_cost = [0f32; BINS];
    let (mut sum, mut count) = (Corners::EMPTY, 0);
    for i in (1..BINS).rev() {
        sum = sum.join(&boxes[i]);
        count += counts[i];
        right_cost[i] = cost(&sum, count, rules);
    }
    let mut best = (f32::INFINITY, 0);
    let (mut sum, mut count) = (Corners::EMPTY, 0);
    for i in 1..BINS {
        sum = sum.join(&boxes[i - 1]);
        count += counts[i - 1];
        // An empty side's cost is not a number, or infinite.
        let cost = cost(&sum, count, rules) + right_cost[i];
        if cost < best.0 && count > 0 && (count as usize) < primitives.len() {
            best = (cost, i);
        }
    }
    let (cost, bin) = best;
    if cost == f32::INFINITY {
        return None;
    }
    let side = |bins: &[Corners]| {
        bins.iter()
            .fold(Corners::EMPTY, |sum, corners| sum.join(corners))
    };
    Some(Split {
        axis,
        plane: bin as f32,
        binning,
        sides: [side(&boxes[..bin]), side(&boxes[bin..])],
    })
}

/// What one side of a plane costs.
#[inline(always)]
fn cost(side: &Corners, count: u32, rules: &SplitRules) -> f32 {
    let blocks = (count + rules.block - 1) >> rules.block.trailing_zeros();
    side.half_area(rules.scale) * blocks as i32 as f32
}

/// Adds a bin to one side of each axis; returns what the sides cost now.
#[inline(always)]
fn add_bin(
    sum: &mut [Corners; 3],
    count: &mut [u32; 4],
    boxes: &[Corners; 3],
    counts: &[u32; 4],
    rules: &SplitRules,
) -> [f32; 4] {
    for axis in 0..3 {
        sum[axis] = sum[axis].join(&boxes[axis]);
    }
    let [a, b, c] = [sum[0].edges(), sum[1].edges(), sum[2].edges()];
    let mut cost = [0.0; 4];
    let (x, y, z) = (
        [a[0], b[0], c[0], 0.0],
        [a[1], b[1], c[1], 0.0],
        [a[2], b[2], c[2], 0.0],
    );
    for i in 0..4 {
        count[i] += counts[i];
        let (x, y, z) = (x[i] * rules.scale, y[i] * rules.scale, z[i] * rules.scale);
        let blocks = (count[i] + rules.block - 1) >> rules.block.trailing_zeros();
        cost[i] = (x * y + y * z + z * x) * blocks as i32 as f32;
    }
    cost
}

/// Moves the primitives left of the plane to the front; returns how many and both extents.
#[inline(always)]
pub(crate) fn partition(primitives: &mut [Primitive], split: &Split) -> (usize, Extent, Extent) {
    let axis = split.axis;
    let (base, factor) = (split.binning.base[axis], split.binning.factor[axis]);
    // Half of the primitives are left in no order, so a branch here would be guessed wrong often.
    let mut left = Corners::EMPTY;
    let mut right = Corners::EMPTY;
    let mut middle = 0;
    for i in 0..primitives.len() {
        let primitive = primitives[i];
        let corners = primitive.corners();
        let center = corners.center();
        let is_left = (center[axis] - base) * factor < split.plane;
        let point = Corners::point(center);
        for k in 0..8 {
            let (l, r) = if is_left {
                (point.0[k], f32::INFINITY)
            } else {
                (f32::INFINITY, point.0[k])
            };
            left.0[k] = if l < left.0[k] { l } else { left.0[k] };
            right.0[k] = if r < right.0[k] { r } else { right.0[k] };
        }
        primitives[i] = primitives[middle];
        primitives[middle] = primitive;
        middle += usize::from(is_left);
    }
    let [left_corners, right_corners] = split.sides;
    let extent = |corners, centers| Extent { corners, centers };
    (
        middle,
        extent(left_corners, left),
        extent(right_corners, right),
    )
}

/// Splits in the middle of the longest axis' order; where centers coincide, in the middle of the
/// order there is.
pub(crate) fn halve(primitives: &mut [Primitive], extent: &Extent) -> (usize, Extent, Extent) {
    let middle = primitives.len() / 2;
    let size = extent.centers.edges();
    if size[..3].iter().any(|&size| size > 0.0) {
        sort_middle(primitives, middle, longest(size));
    }
    let (left, right) = primitives.split_at(middle);
    (middle, Extent::of(left), Extent::of(right))
}

fn longest([x, y, z, _]: [f32; 4]) -> usize {
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

/// Puts the primitives before position `middle` of the order along `axis` in front of it.
fn sort_middle(primitives: &mut [Primitive], middle: usize, axis: usize) {
    primitives.select_nth_unstable_by(middle, |a, b| {
        (a.corners().center()[axis].total_cmp(&b.corners().center()[axis]))
            .then(a.geometry.cmp(&b.geometry))
            .then(a.index.cmp(&b.index))
    });
}

/// Orders primitives into two halves at `middle` along the longest axis of their centers.
pub(crate) fn divide(primitives: &mut [Primitive], middle: usize) {
    let size = Extent::of(primitives).centers.edges();
    if middle > 0 && middle < primitives.len() && size[..3].iter().any(|&size| size > 0.0) {
        sort_middle(primitives, middle, longest(size));
    }
}
