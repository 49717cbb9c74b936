//! A packet's rays and a triangle, a register of rays at a time.

use lanes::LaneMask;

use super::rays::Rays;
use super::register::{Register, lanes_of, rays_of};
use crate::layout::{GROUP, LEAF_TRIANGLES, MARGIN_RISE, TriangleGroup, child};
use crate::structure::Structure;
use crate::walk::PACKET;
use crate::walk::block;
use crate::walk::edge_side::Rim;
use crate::walk::found::Found;
use crate::walk::group;
use crate::walk::group_hits::GroupHits;
use crate::walk::level_rays::AXIS;
use crate::walk::triangle::{Intersection, ORDINARY, intersect, rounding};
use crate::walk::triangle_ray::LaneOf;

/// Tests the triangles of a leaf: those whose boxes any ray might meet, or all for each ray where
/// that takes less.
///
/// # Safety
/// The machine has the register's instruction set, here and below.
#[inline(always)]
pub(super) unsafe fn test_leaf<R: Register>(
    rays: &Rays,
    structure: &Structure,
    (word, lanes): (u32, LaneMask),
    t_far: f32,
    found: &mut Found,
) {
    let mut room = None;
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let Some((groups, there)) = block::leaf_groups(structure, word, &mut room) else {
            return;
        };
        let first_slot = structure.first_slot(word & child::INDEX);
        let mut rest = there;
        if rays.has_bounds {
            rest &= rays.test_triangles(groups, t_far);
        }
        if rays.has_bounds && !R::is_by_triangles(rest.count_ones(), lanes.count()) {
            return test_singly(rays, structure, groups, there, first_slot, lanes, found);
        }
        while rest != 0 {
            let i = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
            rest &= rest - 1;
            let place = (groups[i / GROUP], i % GROUP);
            test_triangle::<R>(rays, structure, place, first_slot + i as u32, lanes, found);
        }
    }
}

/// All triangles of a leaf at once, one ray after the other.
///
/// # Safety
/// The machine has the instruction set.
#[inline(always)]
unsafe fn test_singly(
    rays: &Rays,
    structure: &Structure,
    groups: [&TriangleGroup; 2],
    there: u32,
    first_slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    let mut hits = GroupHits::NONE;
    for lane in lanes {
        let level_rays = &rays.level_rays;
        let interval = [level_rays.t_min[lane], found.t[lane]];
        let ray = LaneOf { level_rays, lane };
        // SAFETY: the caller guarantees that the machine has the instruction set.
        let mut mask = unsafe { group::intersect(ray, groups, there, interval, &mut hits) };
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
            mask &= mask - 1;
            let hit = Intersection {
                t: hits.t[i],
                barycentrics: [hits.barycentrics[0][i], hits.barycentrics[1][i]],
                front: hits.front >> i & 1 != 0,
            };
            found.offer(structure, lane, first_slot + i as u32, &hit);
        }
    }
}

/// A vertex as rays see it: moved and sheared.
#[derive(Clone, Copy)]
struct Sheared<R> {
    x: R,
    y: R,
    z: R,
}

/// Where rays of a part meet a triangle: after the lower ends of their intervals, and not surely
/// after the upper ones.
pub(super) struct TriangleHits<R> {
    /// Those that meet it inside, for sure.
    pub rays: u32,
    /// Those for which that is to be found out one by one.
    pub undecided: u32,
    pub t: R,
    /// Of the second and the third vertex.
    pub weights: [R; 2],
    pub front: u32,
}

/// Tests an opaque triangle.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
pub(super) unsafe fn test_triangle<R: Register>(
    rays: &Rays,
    structure: &Structure,
    place: (&TriangleGroup, usize),
    slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    let mut undecided = LaneMask::NONE;
    for part in 0..PACKET / R::RAYS {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            let here = (part, rays_of::<R>(lanes, part));
            let t_far = R::load(&found.t, part);
            let Some(meeting) = intersect_triangle(rays, place, here, t_far) else {
                continue;
            };
            take_hits(structure, slot, &meeting, (part, t_far), found);
            undecided |= lanes_of::<R>(meeting.undecided, part);
        }
    }
    if !undecided.is_empty() {
        let triangle = place.0.triangle(place.1);
        test_exactly(rays, structure, &triangle, slot, undecided, found);
    }
}

/// Takes hits that are certainly inside a triangle, where they win over the hits so far. `t_far`:
/// the distances of that.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
pub(super) unsafe fn take_hits<R: Register>(
    structure: &Structure,
    slot: u32,
    meeting: &TriangleHits<R>,
    (part, t_far): (usize, R),
    found: &mut Found,
) {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let (accepted, t) = (meeting.rays, meeting.t);
        let mut nearer = accepted & t.lt(t_far);
        let ties = accepted & t.eq(t_far) & rays_of::<R>(found.hit, part);
        if ties != 0 {
            let won = found.won_ties(structure, slot, lanes_of::<R>(ties, part));
            nearer |= rays_of::<R>(won, part);
        }
        if nearer != 0 {
            t.pick(t_far, nearer).store(&mut found.t, part);
            for (row, weight) in found.barycentrics.iter_mut().zip(meeting.weights) {
                let weights = weight.pick(R::load(row, part), nearer);
                weights.store(row, part);
            }
            R::put_word(&mut found.slots, slot, part, nearer);
            R::put_word(&mut found.instances, found.instance, part, nearer);
            let front = lanes_of::<R>(meeting.front, part);
            found.mark(lanes_of::<R>(nearer, part), front);
        }
    }
}

/// A coordinate of a vertex, as seen from the rays' origins.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn moved<R: Register>(
    rays: &Rays,
    k: usize,
    vertex: &[[f32; GROUP]; 3],
    i: usize,
    part: usize,
) -> R {
    let axis = rays.axes[k] / AXIS as usize % 3;
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { R::load(&rays.level_rays.origin[k], part).sub(R::splat(vertex[axis][i])) }
}

/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn sheared<R: Register>(
    rays: &Rays,
    vertex: &[[f32; GROUP]; 3],
    i: usize,
    part: usize,
) -> Sheared<R> {
    let [shear_x, shear_y] = &rays.level_rays.shear;
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let z: R = moved(rays, 2, vertex, i, part);
        let (x, y): (R, R) = (
            moved(rays, 0, vertex, i, part),
            moved(rays, 1, vertex, i, part),
        );
        Sheared {
            x: x.sub(R::load(shear_x, part).mul(z)),
            y: y.sub(R::load(shear_y, part).mul(z)),
            z,
        }
    }
}

/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn edge<R: Register>(p: Sheared<R>, q: Sheared<R>) -> R {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { p.x.mul(q.y).sub(p.y.mul(q.x)) }
}

/// From the least to the greatest of three.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn extent<R: Register>(a: R, b: R, c: R) -> R {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { a.max(b).max(c).sub(a.min(b).min(c)) }
}

/// How far off weights and distances along the rays' own axis may be, where weights and one over
/// the sum of edge functions are these; see [`rounding`].
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn errors<R: Register>(
    rays: &Rays,
    [a, b, c]: [Sheared<R>; 3],
    [u, v, w]: [R; 3],
    size: R,
    part: usize,
) -> [R; 2] {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let z_mean = u.mul(a.z.abs()).add(v.mul(b.z.abs())).add(w.mul(c.z.abs()));
        let (width, height) = (extent(a.x, b.x, c.x), extent(a.y, b.y, c.y));
        let tiny = R::splat(rounding::LEAST);
        let [shear_x, shear_y] = &rays.level_rays.shear;
        let per_shear = R::splat(rounding::SHEAR);
        let factor_x = R::load(shear_x, part).abs().mul(per_shear).add(tiny);
        let factor_y = R::load(shear_y, part).abs().mul(per_shear).add(tiny);
        let move_x = z_mean.mul(factor_x).add(tiny);
        let move_y = z_mean.mul(factor_y).add(tiny);
        let sheared = height.mul(move_x).add(width.mul(move_y));
        let moved = width
            .mul(height)
            .mul(R::splat(rounding::WIDTH))
            .add(sheared);
        let weight_error = size.mul(moved).add(R::splat(rounding::WEIGHTS));
        let far = z_mean.mul(R::splat(rounding::DISTANCE)).add(tiny);
        let z_error = extent(a.z, b.z, c.z).mul(weight_error).add(far);
        [weight_error, z_error]
    }
}

/// Distances, moved into the intervals in which rays are in the triangle's box.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
unsafe fn clamped<R: Register>(
    rays: &Rays,
    (group, i): (&TriangleGroup, usize),
    t: R,
    part: usize,
) -> R {
    let level_rays = &rays.level_rays;
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let mut near = R::splat(f32::NEG_INFINITY);
        let mut far = R::splat(f32::INFINITY);
        for k in 0..3 {
            let axis = rays.axes[k] / AXIS as usize % 3;
            let [first, second, third] = &group.vertices;
            let (a, b, c) = (first[axis][i], second[axis][i], third[axis][i]);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let (first, last) = match rays.is_backward(k) {
                true => (high, low),
                false => (low, high),
            };
            let origin = R::load(&level_rays.origin[k], part);
            let enter = origin.sub(R::splat(first));
            let leave = origin.sub(R::splat(last));
            near = (enter.mul(R::load(&level_rays.near_inverse[k], part))).max(near);
            far = (leave.mul(R::load(&level_rays.far_inverse[k], part))).min(far);
        }
        t.max(near).min(far)
    }
}

/// As [`intersect`](crate::walk::group::intersect) does it for a leaf's triangles and one ray, for
/// some rays of a part; `None` if no ray meets the triangle.
///
/// # Safety
/// The machine has the register's instruction set.
#[inline(always)]
pub(super) unsafe fn intersect_triangle<R: Register>(
    rays: &Rays,
    (group, i): (&TriangleGroup, usize),
    (part, here): (usize, u32),
    t_far: R,
) -> Option<TriangleHits<R>> {
    if here == 0 {
        return None;
    }
    let level_rays = &rays.level_rays;
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe {
        let [first, second, third] = &group.vertices;
        let a: Sheared<R> = sheared(rays, first, i, part);
        let b: Sheared<R> = sheared(rays, second, i, part);
        let c: Sheared<R> = sheared(rays, third, i, part);
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let (least, most) = (u.min(v.min(w)), u.max(v.max(w)));
        let distance = a.z.abs();
        let slope = R::splat(group.margin.slope).add(distance.mul(R::splat(MARGIN_RISE)));
        let error = distance.add(R::splat(group.margin.reach)).mul(slope);
        let minus_error = error.negated();
        let inside = here & !(least.lt(minus_error) & error.lt(most));
        if inside == 0 {
            return None;
        }
        let (front, back) = (error.lt(least), most.lt(minus_error));
        let whole = u.add(v).add(w);
        let size = whole.abs();
        let ordinary = R::splat(ORDINARY[0]).lt(size) & size.lt(R::splat(ORDINARY[1]));
        let decided = (front | back) & ordinary & inside;

        let inverse_whole = R::splat(1.0).div(whole);
        let size = inverse_whole.abs();
        let (v, w) = (v.mul(inverse_whole), w.mul(inverse_whole));
        let along = v.mul(b.z.sub(a.z)).add(w.mul(c.z.sub(a.z)));
        let z_hit = a.z.add(along);
        let inverse_z = R::load(&level_rays.inverse_z, part);
        let t = z_hit.mul(inverse_z);
        let room = (error.mul(size).mul(inverse_z.abs())).mul(R::splat(1.5 * group.margin.reach));
        let t_min = R::load(&level_rays.t_min, part);
        let apart = t.add(room).le(t_min) | t_far.lt(t.sub(room));
        let inside = inside & !(decided & apart);
        if inside == 0 {
            return None;
        }
        let u = u.mul(inverse_whole);
        let [weight_error, z_error] = errors(rays, [a, b, c], [u, v, w], size, part);
        let limit = R::splat(level_rays.tolerance).mul(z_hit.abs());
        let narrow = weight_error.lt(R::splat(rounding::MOST));
        let precise = decided & inside & z_error.le(limit) & narrow;
        let t = z_hit.div(R::load(&level_rays.direction_z, part));
        let t = clamped(rays, (group, i), t, part);
        Some(TriangleHits {
            rays: precise & t_min.lt(t),
            undecided: inside & !precise,
            t,
            weights: [v, w],
            front,
        })
    }
}

/// One ray after the other, where rays meet edges and vertices.
#[cold]
#[inline(never)]
fn test_exactly(
    rays: &Rays,
    structure: &Structure,
    triangle: &[[f32; 3]; 3],
    slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    for lane in lanes {
        if let Some(hit) = intersect(&rays.level_rays.of_lane(lane), triangle, Rim::Included)
            && hit.t > rays.level_rays.t_min[lane]
        {
            found.offer(structure, lane, slot, &hit);
        }
    }
}
