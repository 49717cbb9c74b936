//! Which rays of a group meet any box: found out for all at once, where they go the same way.
//!
//! Each ray is tested by the operations that its walk does, so exactly those rays are left out that
//! would walk to their ends without a candidate. Shadow rays mostly do.

use lanes::LaneMask;

use super::PACKET;
use super::boxes::BoxLevel;
use super::kernel::Kernel;
use super::level_ray::{max, min};
use super::level_rays::ROW;
use super::rows::Lanes;
use super::slabs::Slabs;
use crate::layout::{NodeAt, WIDTH, child};

/// Nodes and leaves after which rays walk by themselves.
const PATIENCE: u32 = 256;

/// Pending children, at most.
const ROOM: usize = 64;

/// An axis of the boxes of all rays.
#[derive(Clone, Copy)]
struct Axis {
    near_row: usize,
    far_row: usize,
    /// The origins from which near and far planes are nearest and farthest.
    near_origin: f32,
    far_origin: f32,
    /// Least and greatest.
    near_inverse: [f32; 2],
    far_inverse: [f32; 2],
}

/// An interval around all rays.
struct Bundle {
    axes: [Axis; 3],
    t_min: f32,
    t_far: f32,
}

/// The least and the greatest of numbers.
#[inline(always)]
fn range(row: &Lanes) -> [f32; 2] {
    let (mut low, mut high) = (row[0], row[0]);
    for &v in row {
        (low, high) = (min(low, v), max(high, v));
    }
    [low, high]
}

impl Bundle {
    /// Around the rays of all lanes; `None` if they do not go the same way. A test of the interval
    /// loses no ray: sums and products of numbers that are rounded keep their order.
    #[inline(always)]
    fn new(slabs: &Slabs, t_max: &Lanes, lanes: LaneMask) -> Option<Bundle> {
        let first = lanes.first();
        let mut axes = [None; 3];
        for axis in 0..3 {
            let row = slabs.near_rows[axis][first];
            let rows = &slabs.near_rows[axis];
            let is_same = rows.iter().fold(0, |differ, it| differ | (it ^ row)) == 0;
            let [low, high] = range(&slabs.near_origin[axis]);
            let (near_inverse, far_inverse) = (
                range(&slabs.near_inverse[axis]),
                range(&slabs.far_inverse[axis]),
            );
            let sum = low + high + far_inverse[0] + far_inverse[1];
            if !is_same || !sum.is_finite() {
                return None;
            }
            let goes_up = row & ROW == 0;
            let near_row = (row / ROW) as usize;
            axes[axis] = Some(Axis {
                near_row,
                far_row: near_row ^ 1,
                near_origin: if goes_up { high } else { low },
                far_origin: if goes_up { low } else { high },
                near_inverse,
                far_inverse,
            });
        }
        let [Some(x), Some(y), Some(z)] = axes else {
            return None;
        };
        let t_far = lanes
            .iter()
            .fold(f32::NEG_INFINITY, |far, lane| max(t_max[lane], far));
        Some(Bundle {
            axes: [x, y, z],
            t_min: range(&slabs.t_min)[0],
            t_far,
        })
    }

    /// Which children's boxes a ray may meet.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn intersect_node<K: Kernel>(&self, node: NodeAt<'_>) -> u32 {
        let (mut near, mut far) = ([self.t_min; WIDTH], [self.t_far; WIDTH]);
        for axis in &self.axes {
            for i in 0..WIDTH {
                let enter = node.bound(axis.near_row, i) - axis.near_origin;
                let leave = node.bound(axis.far_row, i) - axis.far_origin;
                let [low, high] = axis.near_inverse;
                near[i] = max(min(enter * low, enter * high), near[i]);
                let [low, high] = axis.far_inverse;
                far[i] = min(max(leave * low, leave * high), far[i]);
            }
        }
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe { K::at_most(&near, &far) }
    }
}

/// Which rays meet a child's box, as their walks test it.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn intersect_child<K: Kernel>(
    slabs: &Slabs,
    bundle: &Bundle,
    t_max: &Lanes,
    node: NodeAt<'_>,
    child: usize,
) -> LaneMask {
    let plane = |axis: usize| {
        let Axis {
            near_row, far_row, ..
        } = bundle.axes[axis];
        (node.bound(near_row, child), node.bound(far_row, child))
    };
    let planes = [plane(0), plane(1), plane(2)];
    let (mut near, mut far) = ([0.0; PACKET], [0.0; PACKET]);
    for i in 0..PACKET {
        let enter = |axis: usize| {
            (planes[axis].0 - slabs.near_origin[axis][i]) * slabs.near_inverse[axis][i]
        };
        let leave =
            |axis: usize| (planes[axis].1 - slabs.far_origin[axis][i]) * slabs.far_inverse[axis][i];
        near[i] = max(max(enter(0), enter(1)), max(enter(2), slabs.t_min[i]));
        far[i] = min(min(leave(0), leave(1)), min(leave(2), t_max[i]));
    }
    let (near, far) = (near.as_chunks().0, far.as_chunks().0);
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set. Not by
    // closures, which would be calls.
    let bits = unsafe { K::at_most(&near[0], &far[0]) | K::at_most(&near[1], &far[1]) << WIDTH };
    LaneMask::from_bits(bits as u16)
}

impl BoxLevel<'_> {
    /// Which rays, that start, meet any box; all where that is not found out soon.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn hits_any_box<K: Kernel>(
        &self,
        slabs: &Slabs,
        lanes: LaneMask,
        t_max: &Lanes,
        left: &mut u64,
    ) -> LaneMask {
        let Some(bundle) = Bundle::new(slabs, t_max, lanes) else {
            return lanes;
        };
        let mut stack = [(0, LaneMask::NONE); ROOM];
        stack[0] = (0, lanes);
        let (mut length, mut met) = (1, LaneMask::NONE);
        for _ in 0..PATIENCE {
            if length == 0 || met == lanes {
                return met;
            }
            length -= 1;
            let (word, here) = stack[length];
            let here = here - met;
            if here.is_empty() {
                continue;
            }
            *left = left.saturating_sub(1);
            let Some(node) = self.structure.node(word) else {
                let is_leaf = word & child::LEAF != 0 && word != child::NONE;
                if is_leaf && self.candidate(word).is_some() {
                    met |= here;
                }
                continue;
            };
            if length + WIDTH > ROOM {
                return lanes;
            }
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let mut rest = unsafe { bundle.intersect_node::<K>(node) };
            while rest != 0 {
                let child = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                let inside =
                    here & unsafe { intersect_child::<K>(slabs, &bundle, t_max, node, child) };
                if !inside.is_empty() {
                    stack[length] = (node.child(child), inside);
                    length += 1;
                }
            }
        }
        lanes
    }
}
