//! The inner tests in plain Rust.

use super::Walk;
use super::children::push_children;
use super::entry::Entry;
use super::group_hits::GroupHits;
use super::kernel::{Kernel, T_MARGIN};
use super::leaf::{Leaf, Triangles};
use super::level_ray::{LevelRay, max, min};
use super::level_rays::{LevelRays, ROW};
use super::meter::{Meter, Unmetered};
use super::opaque::{End, Nearest, Opaque, Pending};
use super::slabs::Slabs;
use crate::layout::{Block, GROUP, NodeAt, TriangleGroup, WIDTH};

/// Plain Rust, which compilers vectorise as far as the target allows.
pub(crate) struct PortableKernel;

impl Kernel for PortableKernel {
    type BoxRay = (LevelRay, f32);
    type Shear = LevelRay;
    type Near = [f32; WIDTH];

    #[inline(always)]
    unsafe fn load_level_ray(level_ray: &LevelRay, t_far: f32) -> (LevelRay, f32) {
        (*level_ray, t_far)
    }

    #[inline(always)]
    unsafe fn load_lane(level_rays: &LevelRays, lane: usize, t_far: f32) -> (LevelRay, f32) {
        (level_rays.of_lane(lane), t_far)
    }

    #[inline(always)]
    unsafe fn load_slabs(slabs: &Slabs, lane: usize, t_far: f32) -> (LevelRay, f32) {
        let mut level_ray = LevelRay::EMPTY;
        for axis in 0..3 {
            level_ray.near_origin[axis] = slabs.near_origin[axis][lane];
            level_ray.far_origin[axis] = slabs.far_origin[axis][lane];
            level_ray.near_inverse[axis] = slabs.near_inverse[axis][lane];
            level_ray.far_inverse[axis] = slabs.far_inverse[axis][lane];
            level_ray.signs[axis] = -i32::from(slabs.near_rows[axis][lane] & ROW != 0);
        }
        level_ray.t_min = slabs.t_min[lane];
        (level_ray, t_far)
    }

    #[inline(always)]
    unsafe fn load_shear(level_ray: &LevelRay) -> LevelRay {
        *level_ray
    }

    #[inline(always)]
    unsafe fn test_group(ray: &LevelRay, group: &TriangleGroup, t_far: f32) -> u32 {
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
    unsafe fn shorten(box_ray: &mut (LevelRay, f32), t_far: f32) {
        box_ray.1 = t_far;
    }

    #[inline(always)]
    unsafe fn intersect_node<const CLOSED: bool>(
        (ray, t_far): &(LevelRay, f32),
        node: NodeAt<'_>,
    ) -> (u32, [f32; WIDTH]) {
        let (mut near, mut far) = ([0.0; WIDTH], [0.0; WIDTH]);
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
            far[i] = min(min(x.1, y.1), min(z.1, *t_far));
        }
        let mask = (0..WIDTH).fold(0, |mask, i| mask | u32::from(near[i] <= far[i]) << i);
        (mask, near)
    }

    #[inline(always)]
    unsafe fn push<const ANY: bool>(
        near: [f32; WIDTH],
        mask: u32,
        node: NodeAt<'_>,
        place: *mut Entry,
    ) -> (u32, usize) {
        // SAFETY: the caller guarantees that the machine has the instruction set; there is room for
        // eight entries.
        unsafe { push_children::<ANY>(mask, node, &near, place) }
    }

    #[inline(always)]
    unsafe fn at_most(these: &[f32; WIDTH], those: &[f32; WIDTH]) -> u32 {
        (0..WIDTH).fold(0, |mask, i| mask | u32::from(these[i] <= those[i]) << i)
    }

    #[inline(always)]
    unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
        block.expand(groups)
    }

    #[inline(always)]
    unsafe fn intersect_leaf(
        _: &LevelRays,
        _: usize,
        (level_ray, _): &(LevelRay, f32),
        groups: [&TriangleGroup; 2],
        lanes: u32,
        interval: [f32; 2],
        found: &mut GroupHits,
    ) -> u32 {
        let mut mask = 0;
        for (i, group) in groups.into_iter().enumerate() {
            // SAFETY: every machine has plain Rust.
            mask |= unsafe { PortableKernel::test_group(level_ray, group, interval[1]) & 0xF }
                << (GROUP * i);
        }
        found.intersect_each(level_ray, groups, mask & lanes, interval)
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
        unsafe { way.run::<PortableKernel, _, ANY>(best, pending, found, fuel, &mut Unmetered) }
    }

    #[inline(never)]
    unsafe fn walk_opaque_metered<M: Meter, const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
        meter: &mut M,
    ) -> End {
        // SAFETY: every machine has plain Rust.
        unsafe { way.run::<PortableKernel, M, ANY>(best, pending, found, fuel, meter) }
    }

    #[inline(never)]
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf {
        // SAFETY: every machine has plain Rust.
        unsafe { leaf.test::<PortableKernel>(walk, t_far) }
    }
}
