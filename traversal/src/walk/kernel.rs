//! The two tests of the inner loop, one set for each instruction set. All give the same bits.

use super::Walk;
use super::beams::Beams;
use super::descend::push_children;
use super::leaf::{Leaf, Triangles};
use super::opaque::{End, Nearest, Opaque, Pending};
use super::space::{Space, max, min};
use super::triangle::{Intersection, Rim, intersect};
use super::walker::Entry;
use crate::layout::{Block, GROUP, LEAF_TRIANGLES, NodeAt, TriangleGroup, WIDTH};

/// Inner tests with one instruction set.
///
/// Methods are inlined into a function that has the instruction set enabled.
pub(crate) trait Kernel {
    /// A ray, ready for tests of boxes.
    type Boxes: Copy;
    /// A ray, ready for tests of triangles.
    type Shear: Copy;
    /// A ray of a list, ready for tests of boxes.
    type Beam: Copy;
    /// Where a ray enters the boxes of a node.
    type Near: Copy;

    /// Prepares a ray for boxes.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_boxes(space: &Space) -> Self::Boxes;

    /// Prepares a ray for triangles.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_shear(space: &Space) -> Self::Shear;

    /// Which children's boxes the ray meets in `[t_min, t_far]`, as bits, and where it enters all
    /// eight.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_node(
        ray: &Self::Boxes,
        node: NodeAt<'_>,
        t_far: f32,
        near: &mut [f32; WIDTH],
    ) -> u32;

    /// Which lanes [`intersect`](super::triangle::intersect) might report in `[t_min, t_far]`:
    /// none of those that it would is missing.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_group(ray: &Self::Shear, group: &TriangleGroup, t_far: f32) -> u32;

    /// Prepares a ray of a list, whose interval ends at `t_far`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_beam(beams: &Beams, lane: usize, t_far: f32) -> Self::Beam;

    /// Ends the ray's interval sooner.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn shorten(beam: &mut Self::Beam, t_far: f32);

    /// [`Self::test_node`] for a ray of a list.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn meet(beam: &Self::Beam, node: NodeAt<'_>) -> (u32, Self::Near);

    /// Puts the children of a node in `mask`, of which there are two or more, down from `place` on, farthest first, but for the
    /// nearest. Returns that one's word, and how many were put down. With `ANY`, in an order that does not depend on the ray.
    ///
    /// # Safety
    /// The machine has the instruction set; there is room for eight entries.
    unsafe fn push<const ANY: bool>(
        near: Self::Near,
        mask: u32,
        node: NodeAt<'_>,
        place: *mut Entry,
    ) -> (u32, usize);

    /// Writes the vertices of a block's triangles into two groups. Returns which of their lanes there are.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32;

    /// Which of some lanes of one or two groups (then the same twice) an opaque triangle is hit in, in the interval
    /// `t_min < t <= t_far`: what [`intersect`] says of each, its edges included. The ray's distances are not scaled.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn intersect_leaf(
        beams: &Beams,
        lane: usize,
        beam: &Self::Beam,
        groups: [&TriangleGroup; 2],
        lanes: u32,
        interval: [f32; 2],
        found: &mut GroupHits,
    ) -> u32;

    /// [`Opaque::run`] with this kernel, as a function of its own.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn walk_opaque<const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
    ) -> End;

    /// [`Triangles::test`] with this kernel, as a function of its own: the loop over nodes needs
    /// the registers.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf;
}

/// Where a ray meets the triangles of a leaf.
#[repr(C, align(32))]
pub(crate) struct GroupHits {
    pub t: [f32; LEAF_TRIANGLES],
    /// Weights of the second and the third vertex.
    pub barycentrics: [[f32; LEAF_TRIANGLES]; 2],
    /// Bit i: lane i is seen from its front; see [`Intersection::front`].
    pub front: u32,
}

impl GroupHits {
    pub const NONE: GroupHits = GroupHits {
        t: [0.0; LEAF_TRIANGLES],
        barycentrics: [[0.0; LEAF_TRIANGLES]; 2],
        front: 0,
    };

    /// Sets a lane.
    pub fn set(&mut self, lane: usize, hit: &Intersection) {
        self.t[lane] = hit.t;
        for (weights, weight) in self.barycentrics.iter_mut().zip(hit.barycentrics) {
            weights[lane] = weight;
        }
        self.front = self.front & !(1 << lane) | u32::from(hit.front) << lane;
    }

    /// Intersects the lanes in `mask` one by one; returns those that are hit in the interval.
    #[inline(always)]
    pub fn intersect_each(
        &mut self,
        space: &Space,
        groups: [&TriangleGroup; 2],
        mask: u32,
        [t_min, t_far]: [f32; 2],
    ) -> u32 {
        let mut hits = 0;
        let mut rest = mask;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
            rest &= rest - 1;
            let triangle = groups[lane / GROUP].triangle(lane % GROUP);
            if let Some(hit) = intersect(space, &triangle, Rim::Included)
                && t_min < hit.t
                && hit.t <= t_far
            {
                self.set(lane, &hit);
                hits |= 1 << lane;
            }
        }
        hits
    }
}

/// How far distances of triangles are widened before they are compared.
pub(crate) const T_MARGIN: f32 = 1.0 / (1 << 18) as f32;

/// Plain Rust, which compilers vectorise as far as the target allows.
pub(crate) struct Portable;

impl Kernel for Portable {
    type Boxes = Space;
    type Shear = Space;
    type Beam = (Space, f32);
    type Near = [f32; WIDTH];

    #[inline(always)]
    unsafe fn load_boxes(space: &Space) -> Space {
        *space
    }

    #[inline(always)]
    unsafe fn load_shear(space: &Space) -> Space {
        *space
    }

    #[inline(always)]
    unsafe fn test_node(ray: &Space, node: NodeAt<'_>, t_far: f32, near: &mut [f32; WIDTH]) -> u32 {
        let mut far = [0.0; WIDTH];
        for i in 0..WIDTH {
            let plane = |axis: usize| {
                let row = ray.near_row(axis);
                let enter = node.bound(row, i) - ray.near_origin[axis];
                let leave = node.bound(row ^ 1, i) - ray.far_origin[axis];
                (
                    enter * ray.near_inverse[axis],
                    leave * ray.far_inverse[axis],
                )
            };
            let (x, y, z) = (plane(0), plane(1), plane(2));
            near[i] = max(max(x.0, y.0), max(z.0, ray.t_min));
            far[i] = min(min(x.1, y.1), min(z.1, t_far));
        }
        (0..WIDTH).fold(0, |mask, i| mask | u32::from(near[i] <= far[i]) << i)
    }

    #[inline(always)]
    unsafe fn test_group(ray: &Space, group: &TriangleGroup, t_far: f32) -> u32 {
        let [x_axis, y_axis, z_axis] = ray.axes();
        let mut flat = [[[0f32; GROUP]; 2]; 3];
        let mut t = [[0f32; GROUP]; 3];
        let mut distance = [0f32; GROUP];
        for vertex in 0..3 {
            let coordinates = &group.vertices[vertex];
            for i in 0..GROUP {
                let z = coordinates[z_axis][i] - ray.origin[z_axis];
                flat[vertex][0][i] = coordinates[x_axis][i] - ray.origin[x_axis] - ray.shear[0] * z;
                flat[vertex][1][i] = coordinates[y_axis][i] - ray.origin[y_axis] - ray.shear[1] * z;
                t[vertex][i] = z * ray.inverse_z;
                if vertex == 0 {
                    distance[i] = z.abs();
                }
            }
        }
        let mut mask = 0;
        for i in 0..GROUP {
            let edge =
                |p: usize, q: usize| flat[p][0][i] * flat[q][1][i] - flat[p][1][i] * flat[q][0][i];
            let (u, v, w) = (edge(2, 1), edge(0, 2), edge(1, 0));
            let error = group.margin.error(distance[i]);
            let outside =
                (u < -error || v < -error || w < -error) && (u > error || v > error || w > error);
            let first = min(t[0][i], min(t[1][i], t[2][i]));
            let last = max(t[0][i], max(t[1][i], t[2][i]));
            let beyond = first * (1.0 - T_MARGIN) > t_far;
            let before = last * (1.0 + T_MARGIN) < ray.t_min;
            mask |= u32::from(!(outside || beyond || before)) << i;
        }
        mask & group.lanes
    }

    #[inline(always)]
    unsafe fn load_beam(beams: &Beams, lane: usize, t_far: f32) -> (Space, f32) {
        (beams.space(lane), t_far)
    }

    #[inline(always)]
    unsafe fn shorten(beam: &mut (Space, f32), t_far: f32) {
        beam.1 = t_far;
    }

    #[inline(always)]
    unsafe fn meet(beam: &(Space, f32), node: NodeAt<'_>) -> (u32, [f32; WIDTH]) {
        let mut near = [0.0; WIDTH];
        // SAFETY: every machine has plain Rust.
        let mask = unsafe { Portable::test_node(&beam.0, node, beam.1, &mut near) };
        (mask, near)
    }

    #[inline(always)]
    unsafe fn push<const ANY: bool>(
        near: [f32; WIDTH],
        mask: u32,
        node: NodeAt<'_>,
        place: *mut Entry,
    ) -> (u32, usize) {
        // SAFETY: the caller's promise.
        unsafe { push_children::<ANY>(mask, node, &near, place) }
    }

    #[inline(always)]
    unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
        block.expand(groups)
    }

    #[inline(always)]
    unsafe fn intersect_leaf(
        _: &Beams,
        _: usize,
        (space, _): &(Space, f32),
        groups: [&TriangleGroup; 2],
        lanes: u32,
        interval: [f32; 2],
        found: &mut GroupHits,
    ) -> u32 {
        let mut mask = 0;
        for (i, group) in groups.into_iter().enumerate() {
            // SAFETY: every machine has plain Rust.
            mask |= unsafe { Portable::test_group(space, group, interval[1]) & 0xF } << (GROUP * i);
        }
        found.intersect_each(space, groups, mask & lanes, interval)
    }

    #[inline(never)]
    unsafe fn walk_opaque<const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
    ) -> End {
        // SAFETY: every machine has plain Rust.
        unsafe { way.run::<Portable, ANY>(best, pending, found, fuel) }
    }

    #[inline(never)]
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf {
        // SAFETY: every machine has plain Rust.
        unsafe { leaf.test::<Portable>(walk, t_far) }
    }
}
