//! The two tests of the inner loop, one set for each instruction set. All give the same bits.

use super::Walk;
use super::entry::Entry;
use super::group_hits::GroupHits;
use super::leaf::{Leaf, Triangles};
use super::level_ray::LevelRay;
use super::level_rays::LevelRays;
use super::meter::Meter;
use super::opaque::{End, Nearest, Opaque, Pending};
use super::slabs::Slabs;
use crate::layout::{Block, NodeAt, TriangleGroup, WIDTH};

/// Inner tests with one instruction set.
///
/// Methods are inlined into a function that has the instruction set enabled.
pub(crate) trait Kernel {
    /// A ray and where its interval ends, ready for tests of boxes.
    type BoxRay: Copy;
    /// A ray, ready for tests of triangles.
    type Shear: Copy;
    /// Where a ray enters the boxes of a node.
    type Near: Copy;

    /// Prepares a ray for boxes, whose interval ends at `t_far`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_level_ray(level_ray: &LevelRay, t_far: f32) -> Self::BoxRay;

    /// The same for a ray of a list.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_lane(level_rays: &LevelRays, lane: usize, t_far: f32) -> Self::BoxRay;

    /// The same for a ray of a group in a bottom level of boxes.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_slabs(slabs: &Slabs, lane: usize, t_far: f32) -> Self::BoxRay;

    /// Prepares a ray for triangles.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn load_shear(level_ray: &LevelRay) -> Self::Shear;

    /// Which lanes [`intersect`](super::triangle::intersect) might report in `[t_min, t_far]`:
    /// none of those that it would is missing.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_group(ray: &Self::Shear, group: &TriangleGroup, t_far: f32) -> u32;

    /// Ends the ray's interval sooner.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn shorten(box_ray: &mut Self::BoxRay, t_far: f32);

    /// Which children's boxes the ray meets in its interval, as bits, and where it enters all
    /// eight. `CLOSED`: for a ray of [`Self::load_level_ray`] or of
    /// [`Self::load_slabs`]. One of [`Self::load_lane`] may miss
    /// boxes that it leaves where it starts, since its interval is open.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn intersect_node<const CLOSED: bool>(
        box_ray: &Self::BoxRay,
        node: NodeAt<'_>,
    ) -> (u32, Self::Near);

    /// Pushes the two or more children of a node in `mask` down from `place` on, farthest first,
    /// except the nearest. Returns the nearest child's word and the number of pushed children. With
    /// `ANY`, in an order that does not depend on the ray.
    ///
    /// # Safety
    /// The machine has the instruction set; there is room for eight entries.
    unsafe fn push<const ANY: bool>(
        near: Self::Near,
        mask: u32,
        node: NodeAt<'_>,
        place: *mut Entry,
    ) -> (u32, usize);

    /// Which of eight numbers are at most those of the other eight, as bits.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn at_most(these: &[f32; WIDTH], those: &[f32; WIDTH]) -> u32;

    /// Writes the vertices of a block's triangles into two groups. Returns which of their lanes
    /// there are.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32;

    /// Which of some lanes of one or two groups (then the same twice) an opaque triangle is hit in,
    /// in the interval `t_min < t <= t_far`: what [`intersect`](super::triangle::intersect) says of
    /// each, its edges included. The ray's distances are not scaled.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn intersect_leaf(
        level_rays: &LevelRays,
        lane: usize,
        box_ray: &Self::BoxRay,
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

    /// The same with a meter.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn walk_opaque_metered<M: Meter, const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
        meter: &mut M,
    ) -> End;

    /// [`Triangles::test`] with this kernel, as a function of its own: the loop over nodes needs
    /// the registers.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf;
}

/// How far distances of triangles are widened before they are compared.
pub(crate) const T_MARGIN: f32 = 1.0 / (1 << 18) as f32;
