//! Splits of a set of primitives: binned planes by the surface area heuristic (Wald 2007).

use super::corners::Corners;
use super::primitive::Primitive;
use super::vector::{PortableBounds, Vector};

/// The rules for splits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplitRules {
    /// Number of primitives that one step of the walk tests.
    pub block: u32,
    /// Fewer primitives than this are not split.
    pub stop: usize,
    /// The reciprocal of the total extent, so that areas neither overflow nor underflow.
    pub scale: f32,
    /// Only planes across the longest axis are tested.
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

impl SplitRules {
    /// log₂ of the block size.
    #[inline(always)]
    pub fn shift(&self) -> u32 {
        self.block.trailing_zeros()
    }
}

/// A smaller extent counts as zero, since its reciprocal could overflow.
const TINY: f32 = 1.0e-36;

/// The box of some primitives and the box of their centers.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    pub corners: Corners,
    pub centers: Corners,
}

impl Extent {
    #[inline(always)]
    pub fn of<V: Vector>(primitives: &[Primitive]) -> Extent {
        let (mut corners, mut centers) = (V::of(&Corners::EMPTY), V::of(&Corners::EMPTY));
        for primitive in primitives {
            let own = V::of_primitive(primitive);
            corners = corners.join(own);
            centers = centers.join(own.center());
        }
        Extent {
            corners: corners.corners(),
            centers: centers.corners(),
        }
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

    /// On each axis. Centers are inside the extent and everything is finite, so this is between 0
    /// and `BINS`.
    #[inline(always)]
    fn bins<V: Vector, const BINS: usize>(&self, center: V) -> [usize; 3] {
        let [x, y, z, _] = center.places(&self.base, &self.factor);
        [x as usize % BINS, y as usize % BINS, z as usize % BINS]
    }
}

/// The contents of each bin of each axis.
struct Bins<const BINS: usize> {
    boxes: [[Corners; 3]; BINS],
    counts: [[u32; 4]; BINS],
}

impl<const BINS: usize> Bins<BINS> {
    #[inline(always)]
    fn empty<V: Vector>() -> Bins<BINS> {
        let mut bins = Bins {
            boxes: [[Corners([0.0; 8]); 3]; BINS],
            counts: [[0; 4]; BINS],
        };
        for place in bins.boxes.as_flattened_mut() {
            *place = V::of(&Corners::EMPTY).corners();
        }
        bins
    }

    #[inline(always)]
    fn add<V: Vector>(&mut self, binning: &Binning, primitive: &Primitive) {
        let own = V::of_primitive(primitive);
        let bins = binning.bins::<V, BINS>(own.center());
        for (axis, bin) in bins.into_iter().enumerate() {
            let place = &mut self.boxes[bin][axis];
            *place = V::of(place).join(own).corners();
            self.counts[bin][axis] += 1;
        }
    }

    #[inline(always)]
    fn add_all<V: Vector>(&mut self, other: &Bins<BINS>) {
        for i in 0..BINS {
            for axis in 0..3 {
                let place = &mut self.boxes[i][axis];
                *place = V::of(place).join(V::of(&other.boxes[i][axis])).corners();
            }
            for axis in 0..4 {
                self.counts[i][axis] += other.counts[i][axis];
            }
        }
    }

    /// The box around some bins of an axis.
    #[inline(always)]
    fn side<V: Vector>(&self, bins: std::ops::Range<usize>, axis: usize) -> Corners {
        // A closure would not inherit the instruction set.
        let mut sum = V::of(&Corners::EMPTY);
        for bin in &self.boxes[bins] {
            sum = sum.join(V::of(&bin[axis]));
        }
        sum.corners()
    }
}

/// More primitives than this are binned in two rows, because neighbors often fall into the same bin
/// and would wait for each other.
const TWO_ROWS: usize = 240;

/// The cheapest plane; `None` if all centers fall into one bin.
#[inline(always)]
pub(crate) fn choose<V: Vector, const BINS: usize>(
    primitives: &[Primitive],
    rules: &SplitRules,
    extent: &Extent,
) -> Option<Split> {
    let binning = Binning::new(extent, BINS);
    let mut bins = Bins::<BINS>::empty::<V>();
    if primitives.len() > TWO_ROWS {
        let mut others = Bins::<BINS>::empty::<V>();
        let (pairs, rest) = primitives.as_chunks::<2>();
        for [one, other] in pairs {
            bins.add::<V>(&binning, one);
            others.add::<V>(&binning, other);
        }
        for primitive in rest {
            bins.add::<V>(&binning, primitive);
        }
        bins.add_all::<V>(&others);
    } else {
        for primitive in primitives {
            bins.add::<V>(&binning, primitive);
        }
    }
    // The cost of the right side of each plane, on each axis; then of both sides.
    let mut right_cost = [V::four(0.0); BINS];
    let mut side = Side::<V>::new();
    for i in (1..BINS).rev() {
        right_cost[i] = side.add(&bins.boxes[i], &bins.counts[i], rules);
    }
    let mut best = [V::four(f32::INFINITY), V::four(0.0)];
    let mut side = Side::<V>::new();
    for (i, &right_cost) in right_cost.iter().enumerate().skip(1) {
        let cost = side.add(&bins.boxes[i - 1], &bins.counts[i - 1], rules);
        // An empty side's cost is NaN or infinite.
        V::lower(&mut best, V::add(cost, right_cost), i as f32);
    }
    let [costs, planes] = best.map(V::numbers);
    let axis = longest([-costs[0], -costs[1], -costs[2], 0.0]);
    if costs[axis] == f32::INFINITY {
        return None;
    }
    let plane = planes[axis];
    let bin = plane as usize % BINS;
    Some(Split {
        axis,
        plane,
        binning,
        sides: [
            bins.side::<V>(0..bin, axis),
            bins.side::<V>(bin..BINS, axis),
        ],
    })
}

/// One side of a plane across each axis.
struct Side<V: Vector> {
    boxes: [V; 3],
    counts: V::Counts,
}

impl<V: Vector> Side<V> {
    #[inline(always)]
    fn new() -> Side<V> {
        Side {
            boxes: [V::of(&Corners::EMPTY); 3],
            counts: V::counts(&[0; 4]),
        }
    }

    /// Adds a bin; returns what the sides cost now.
    #[inline(always)]
    fn add(&mut self, boxes: &[Corners; 3], counts: &[u32; 4], rules: &SplitRules) -> V::Four {
        for (sum, part) in self.boxes.iter_mut().zip(boxes) {
            *sum = sum.join(V::of(part));
        }
        self.counts = V::add_counts(self.counts, V::counts(counts));
        V::costs(self.boxes, rules.scale, self.counts, rules.shift())
    }
}

/// The cheapest plane across the longest axis; `None` if all centers are in one place.
#[inline(always)]
pub(crate) fn choose_quickly<V: Vector, const BINS: usize>(
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
        let bin = (primitive.center(axis) - binning.base[axis]) * binning.factor[axis];
        // SAFETY: as in `Binning::bins`.
        let bin = unsafe { bin.to_int_unchecked::<i32>() } as usize % BINS;
        let own = V::of_primitive(primitive);
        boxes[bin] = V::of(&boxes[bin]).join(own).corners();
        counts[bin] += 1;
    }
    let mut right_cost = [0f32; BINS];
    let (mut sum, mut count) = (V::of(&Corners::EMPTY), 0);
    for i in (1..BINS).rev() {
        sum = sum.join(V::of(&boxes[i]));
        count += counts[i];
        right_cost[i] = cost(&sum.corners(), count, rules);
    }
    let mut best = (f32::INFINITY, 0);
    let (mut sum, mut count) = (V::of(&Corners::EMPTY), 0);
    for i in 1..BINS {
        sum = sum.join(V::of(&boxes[i - 1]));
        count += counts[i - 1];
        // An empty side's cost is NaN or infinite.
        let cost = cost(&sum.corners(), count, rules) + right_cost[i];
        if cost < best.0 && count > 0 && (count as usize) < primitives.len() {
            best = (cost, i);
        }
    }
    let (cost, bin) = best;
    if cost == f32::INFINITY {
        return None;
    }
    let mut sides = [V::of(&Corners::EMPTY); 2];
    for (i, part) in boxes.iter().enumerate() {
        let side = &mut sides[usize::from(i >= bin)];
        *side = side.join(V::of(part));
    }
    Some(Split {
        axis,
        plane: bin as f32,
        binning,
        sides: [sides[0].corners(), sides[1].corners()],
    })
}

/// The cost of one side of a plane.
#[inline(always)]
fn cost(side: &Corners, count: u32, rules: &SplitRules) -> f32 {
    let blocks = (count + rules.block - 1) >> rules.shift();
    side.half_area(rules.scale) * blocks as i32 as f32
}

/// Moves the primitives left of the plane to the front; returns how many and both extents.
#[inline(always)]
pub(crate) fn partition<V: Vector>(
    primitives: &mut [Primitive],
    split: &Split,
) -> (usize, Extent, Extent) {
    let axis = split.axis;
    let (base, factor) = (split.binning.base[axis], split.binning.factor[axis]);
    // Branch-free: the sides are in random order, so a branch would mispredict often.
    let mut centers = [V::of(&Corners::EMPTY); 2];
    let plane = split.plane;
    let mut middle = 0;
    for i in 0..primitives.len() {
        let is_left = (primitives[i].center(axis) - base) * factor < plane;
        let center = V::of_primitive(&primitives[i]).center();
        centers[0] = centers[0].join(center.only_if(is_left));
        centers[1] = centers[1].join(center.only_if(!is_left));
        primitives.swap(i, middle);
        middle += usize::from(is_left);
    }
    let [left, right] = [0, 1].map(|side| Extent {
        corners: split.sides[side],
        centers: centers[side].corners(),
    });
    (middle, left, right)
}

/// Splits at the median of the longest axis; if centers coincide, in the middle of the current
/// order.
pub(crate) fn halve<V: Vector>(
    primitives: &mut [Primitive],
    extent: &Extent,
) -> (usize, Extent, Extent) {
    let middle = primitives.len() / 2;
    let size = extent.centers.edges();
    if size[..3].iter().any(|&size| size > 0.0) {
        sort_middle(primitives, middle, longest(size));
    }
    let (left, right) = primitives.split_at(middle);
    (middle, Extent::of::<V>(left), Extent::of::<V>(right))
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

/// Moves the first `middle` primitives of the order along `axis` to the front.
fn sort_middle(primitives: &mut [Primitive], middle: usize, axis: usize) {
    primitives.select_nth_unstable_by(middle, |a, b| {
        (a.center(axis).total_cmp(&b.center(axis)))
            .then(a.geometry.cmp(&b.geometry))
            .then(a.index.cmp(&b.index))
    });
}

/// Orders primitives into two halves at `middle` along the longest axis of their centers.
pub(crate) fn divide(primitives: &mut [Primitive], middle: usize) {
    let size = Extent::of::<PortableBounds>(primitives).centers.edges();
    if middle > 0 && middle < primitives.len() && size[..3].iter().any(|&size| size > 0.0) {
        sort_middle(primitives, middle, longest(size));
    }
}
