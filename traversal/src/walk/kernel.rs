//! The two tests of the inner loop, one set for each instruction set. All give the same bits.

use super::Walk;
use super::leaf::{Leaf, Triangles};
use super::space::{Space, max, min};
use crate::layout::{GROUP, Node, TriangleGroup, WIDTH};

/// Inner tests with one instruction set.
///
/// Methods are inlined into a function that has the instruction set enabled.
pub(crate) trait Kernel {
    /// A ray, ready for tests of boxes.
    type Boxes: Copy;
    /// A ray, ready for tests of triangles.
    type Shear: Copy;

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
    unsafe fn test_node(ray: &Self::Boxes, node: &Node, t_far: f32, near: &mut [f32; WIDTH])
    -> u32;

    /// Which lanes [`intersect`](super::triangle::intersect) might report in `[t_min, t_far]`:
    /// none of those that it would is missing.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_group(ray: &Self::Shear, group: &TriangleGroup, t_far: f32) -> u32;

    /// [`Triangles::test`] with this kernel, as a function of its own: the loop over nodes needs
    /// the registers.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf;
}

/// How far distances of triangles are widened before they are compared.
pub(crate) const T_MARGIN: f32 = 1.0 / (1 << 18) as f32;

/// Plain Rust, which compilers vectorise as far as the target allows.
pub(crate) struct Portable;

impl Kernel for Portable {
    type Boxes = Space;
    type Shear = Space;

    #[inline(always)]
    unsafe fn load_boxes(space: &Space) -> Space {
        *space
    }

    #[inline(always)]
    unsafe fn load_shear(space: &Space) -> Space {
        *space
    }

    #[inline(always)]
    unsafe fn test_node(ray: &Space, node: &Node, t_far: f32, near: &mut [f32; WIDTH]) -> u32 {
        let mut far = [t_far; WIDTH];
        *near = [ray.t_min; WIDTH];
        for axis in (0..3).rev() {
            let row = ray.near_rows[axis];
            let (near_planes, far_planes) = (&node.bounds[row], &node.bounds[row ^ 1]);
            for i in 0..WIDTH {
                near[i] = max(
                    (near_planes[i] - ray.near_origin[axis]) * ray.near_inverse[axis],
                    near[i],
                );
                far[i] = min(
                    (far_planes[i] - ray.far_origin[axis]) * ray.far_inverse[axis],
                    far[i],
                );
            }
        }
        (0..WIDTH).fold(0, |mask, i| mask | u32::from(near[i] <= far[i]) << i)
    }

    #[inline(always)]
    unsafe fn test_group(ray: &Space, group: &TriangleGroup, t_far: f32) -> u32 {
        let [x_axis, y_axis, z_axis] = ray.axes;
        let mut flat = [[[0f32; GROUP]; 2]; 3];
        let mut t = [[0f32; GROUP]; 3];
        for vertex in 0..3 {
            let coordinates = &group.vertices[vertex];
            for i in 0..GROUP {
                let z = coordinates[z_axis][i] - ray.origin[z_axis];
                flat[vertex][0][i] = coordinates[x_axis][i] - ray.origin[x_axis] - ray.shear[0] * z;
                flat[vertex][1][i] = coordinates[y_axis][i] - ray.origin[y_axis] - ray.shear[1] * z;
                t[vertex][i] = z * ray.inverse_z;
            }
        }
        let mut mask = 0;
        for i in 0..GROUP {
            let edge =
                |p: usize, q: usize| flat[p][0][i] * flat[q][1][i] - flat[p][1][i] * flat[q][0][i];
            let (u, v, w) = (edge(2, 1), edge(0, 2), edge(1, 0));
            let outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
            let first = min(t[0][i], min(t[1][i], t[2][i]));
            let last = max(t[0][i], max(t[1][i], t[2][i]));
            let beyond = first * (1.0 - T_MARGIN) > t_far;
            let before = last * (1.0 + T_MARGIN) < ray.t_min;
            mask |= u32::from(!(outside || beyond || before)) << i;
        }
        mask & group.lanes
    }

    #[inline(never)]
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf {
        // SAFETY: every machine has plain Rust.
        unsafe { leaf.test::<Portable>(walk, t_far) }
    }
}
