//! Sixteen rays at once, where they go the same way: what rays of one picture tile do.
//!
//! Each lane computes what a walk by itself would, with the same operations in the same order, and
//! the hit does not depend on the order of the walk: so the hits are the same bits. A first test
//! of all eight children, against the interval of all rays, leaves one or two of them for the
//! test of each ray.
//!
//! Anything unusual ends the attempt, and every walk goes by itself.

use std::arch::x86_64::*;

use super::facts::InstanceFacts;
use super::level::{Level, turn};
use super::space::{MARGIN, MODEST, Space};
use super::triangle::{ORDINARY, REACH, Rim, SLACK, intersect};
use super::walker::{Entry, STACK, is_sound};
use super::{PACKET, State, Walk, Walker, descend};
use crate::layout::{GROUP, Node, TriangleGroup, WIDTH, child, geometry_word};
use crate::ray::{Hit, Ray, ray_flags};
use crate::structure::{Kind, Structure};

/// Fewer rays are not worth it.
const ENOUGH: usize = 6;

/// Steps after which an attempt is given up: only a corrupt structure takes so many.
const PATIENCE: u32 = 1 << 16;

/// Directions differ by at most this, relative to the longest component.
const SPREAD: f32 = 0.125;

/// Inverses of directions that are not along a plane.
const STEEP: f32 = 1.0e30;

/// A number of each ray.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Lanes([f32; PACKET]);

impl Lanes {
    const ZERO: Lanes = Lanes([0.0; PACKET]);

    #[target_feature(enable = "avx512f")]
    fn load(&self) -> __m512 {
        // SAFETY: sixteen numbers, aligned.
        unsafe { _mm512_load_ps(self.0.as_ptr()) }
    }

    #[target_feature(enable = "avx512f")]
    fn store(&mut self, value: __m512) {
        // SAFETY: as above.
        unsafe { _mm512_store_ps(self.0.as_mut_ptr(), value) }
    }
}

/// What [`Space`] is for one ray.
struct Spaces {
    origin: [Lanes; 3],
    direction: [Lanes; 3],
    near_inverse: [Lanes; 3],
    far_inverse: [Lanes; 3],
    shear: [Lanes; 2],
    inverse_z: Lanes,
    axes: [usize; 3],
    /// Whether directions are negative.
    signs: [bool; 3],
    t_min: Lanes,
    interval: Interval,
}

/// What all rays have in common, for a test of eight boxes: lower and upper ends.
struct Interval {
    /// The origin for near planes and for far planes.
    near_origin: [f32; 3],
    far_origin: [f32; 3],
    near_inverse: [[f32; 2]; 3],
    far_inverse: [[f32; 2]; 3],
    t_min: f32,
}

/// The nearest hits so far.
struct Found {
    t: Lanes,
    barycentrics: [Lanes; 2],
    slots: [u32; PACKET],
    front: u16,
    hit: u16,
}

/// Walks `walks` to their ends together, if they have not started and their rays cohere. Otherwise
/// returns false, and nothing has happened.
pub(crate) fn run(walks: &mut [&mut Walk], walker: &mut Walker) -> bool {
    if walks.len() < ENOUGH || walks.len() > PACKET || !cohere(walks) {
        return false;
    }
    // SAFETY: packets are for walkers with this instruction set.
    unsafe { run_avx512(walks, walker) }
}

/// Whether rays start near each other (by the size of their distances from the origin of space), go
/// the same way, and want the same.
fn cohere(walks: &[&mut Walk]) -> bool {
    let first = &walks[0].ray;
    let longest = first
        .direction
        .iter()
        .fold(0f32, |most, c| most.max(c.abs()));
    let far = first.origin.iter().fold(0f32, |most, c| most.max(c.abs()));
    first.flags & ray_flags::TERMINATE_ON_FIRST_HIT == 0
        && walks.iter().all(|walk| {
            let ray = &walk.ray;
            let near = (0..3).all(|i| {
                (ray.direction[i] - first.direction[i]).abs() <= SPREAD * longest
                    && (ray.origin[i] - first.origin[i]).abs() <= far / 1024.0
            });
            near && walk.state == State::Fresh
                && walk.top_level == walks[0].top_level
                && (ray.flags, ray.cull_mask) == (first.flags, first.cull_mask)
                && is_sound(ray)
        })
}

/// # Safety
/// The machine has the instruction set.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
unsafe fn run_avx512(walks: &mut [&mut Walk], walker: &mut Walker) -> bool {
    let Walker {
        stack,
        top,
        bottom,
        instance,
        ..
    } = walker;
    let ray = walks[0].ray;
    // SAFETY: the contract of `Walk::new`, here and below.
    if !unsafe { top.enter_top(walks[0].top_level) } {
        return false;
    }
    if top.structure.kind() != Kind::Instances {
        return false;
    }
    let Some(index) = descend::only_instance(top) else {
        return false;
    };
    // SAFETY: as above.
    if !unsafe { bottom.enter_bottom(instance, top, false, index, &ray, 0.0) }
        || !instance.takes_all
        || bottom.structure.kind() != Kind::Triangles
        || bottom.space.scale != 1.0
    {
        return false;
    }
    let Some(spaces) = set_up(walks, top, index, bottom) else {
        return false;
    };
    let lanes = u16::MAX >> (PACKET - walks.len());
    let mut found = Found {
        t: Lanes::ZERO,
        barycentrics: [Lanes::ZERO; 2],
        slots: [0; PACKET],
        front: 0,
        hit: 0,
    };
    for (lane, walk) in walks.iter().enumerate() {
        found.t.0[lane] = walk.ray.t_max;
    }
    if !descend(&spaces, &bottom.structure, stack, lanes, &mut found) {
        return false;
    }
    for (lane, walk) in walks.iter_mut().enumerate() {
        walk.state = State::Done;
        if found.hit >> lane & 1 != 0 {
            walk.hit = found.hit(lane, &bottom.structure, instance);
            walk.has_hit = true;
        }
    }
    true
}

impl Found {
    /// The hit of a lane that has one.
    fn hit(&self, lane: usize, structure: &Structure, instance: &InstanceFacts) -> Hit {
        let slot = self.slots[lane];
        let (geometry, primitive) = identity(structure, slot);
        Hit {
            t: self.t.0[lane],
            barycentrics: [self.barycentrics[0].0[lane], self.barycentrics[1].0[lane]],
            geometry_index: geometry,
            primitive_index: primitive,
            slot,
            hit_kind: instance.hit_kind(self.front >> lane & 1 != 0),
            opaque: true,
            triangle: true,
            ..instance.hit()
        }
    }
}

/// Geometry and primitive in a slot.
fn identity(structure: &Structure, slot: u32) -> (u32, u32) {
    let lane = slot as usize % GROUP;
    structure
        .group(slot / GROUP as u32)
        .map_or((0, 0), |group| {
            (
                group.geometries[lane] & geometry_word::INDEX,
                group.primitives[lane],
            )
        })
}

/// As [`Space::set`] does it for one ray; `None` if a ray is unlike the first one, whose space is
/// `first`.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn set_up(walks: &[&mut Walk], top: &Level, index: u32, first: &Level) -> Option<Spaces> {
    let record = top.structure.instance(index)?;
    let moves = record.state & crate::layout::instance_state::IDENTITY == 0;
    let mut origin = [Lanes::ZERO; 3];
    let mut direction = [Lanes::ZERO; 3];
    let mut t_min = Lanes::ZERO;
    for lane in 0..PACKET {
        // Places that no ray is in repeat the first.
        let ray: &Ray = &walks.get(lane).unwrap_or(&walks[0]).ray;
        let (mut o, mut d) = (ray.origin, ray.direction);
        if moves {
            let m = &record.object_to_world;
            let from = [o[0] - m[3], o[1] - m[7], o[2] - m[11]];
            (o, d) = (
                turn(&record.world_to_object, &from),
                turn(&record.world_to_object, &d),
            );
        }
        for axis in 0..3 {
            origin[axis].0[lane] = o[axis];
            direction[axis].0[lane] = d[axis];
        }
        t_min.0[lane] = super::space::max(ray.t_min, 0.0);
    }
    let axes = first.space.axes();
    let absolute = |v: __m512| _mm512_abs_ps(v);
    let size = [
        absolute(direction[0].load()),
        absolute(direction[1].load()),
        absolute(direction[2].load()),
    ];
    let [x, y, z] = axes;
    let one = _mm512_set1_ps(1.0);
    let mut alike = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(size[z], _mm512_set1_ps(*MODEST.start()))
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(size[z], _mm512_set1_ps(*MODEST.end()));
    // The longest component is that of `Space::set`: the first of equals is not taken.
    for axis in [x, y] {
        alike &= if z > axis {
            _mm512_cmp_ps_mask::<_CMP_GE_OQ>(size[z], size[axis])
        } else {
            _mm512_cmp_ps_mask::<_CMP_GT_OQ>(size[z], size[axis])
        };
    }
    let mut spaces = Spaces {
        origin,
        direction,
        near_inverse: [Lanes::ZERO; 3],
        far_inverse: [Lanes::ZERO; 3],
        shear: [Lanes::ZERO; 2],
        inverse_z: Lanes::ZERO,
        axes,
        signs: [false; 3],
        t_min,
        interval: Interval {
            near_origin: [0.0; 3],
            far_origin: [0.0; 3],
            near_inverse: [[0.0; 2]; 3],
            far_inverse: [[0.0; 2]; 3],
            t_min: _mm512_reduce_min_ps(t_min.load()),
        },
    };
    for axis in 0..3 {
        let d = direction[axis].load();
        let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(d, _mm512_setzero_ps());
        if negative != 0 && negative != u16::MAX {
            return None;
        }
        let sign = negative != 0;
        let inverse = _mm512_div_ps(one, d);
        let near = _mm512_mul_ps(inverse, _mm512_set1_ps(1.0 - MARGIN));
        let far = _mm512_mul_ps(inverse, _mm512_set1_ps(1.0 + MARGIN));
        alike &= _mm512_cmp_ps_mask::<_CMP_LT_OQ>(absolute(far), _mm512_set1_ps(STEEP));
        spaces.near_inverse[axis].store(near);
        spaces.far_inverse[axis].store(far);
        spaces.signs[axis] = sign;
        let o = origin[axis].load();
        let ends = |v: __m512| [_mm512_reduce_min_ps(v), _mm512_reduce_max_ps(v)];
        let [low, high] = ends(o);
        let interval = &mut spaces.interval;
        (interval.near_origin[axis], interval.far_origin[axis]) =
            if sign { (low, high) } else { (high, low) };
        interval.near_inverse[axis] = ends(near);
        interval.far_inverse[axis] = ends(far);
        if axis == z {
            spaces.inverse_z.store(inverse);
        }
    }
    let inverse_z = spaces.inverse_z.load();
    for (place, axis) in spaces.shear.iter_mut().zip([x, y]) {
        place.store(_mm512_mul_ps(direction[axis].load(), inverse_z));
    }
    (alike == u16::MAX).then_some(spaces)
}

/// Down from the root and back. False if it takes too long.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn descend(
    spaces: &Spaces,
    structure: &Structure,
    stack: &mut [Entry; STACK],
    lanes: u16,
    found: &mut Found,
) -> bool {
    let mut length = 1;
    stack[0] = Entry::new(0, 0.0);
    let farthest = |found: &Found| _mm512_mask_reduce_max_ps(lanes, found.t.load());
    let mut t_far = farthest(found);
    let mut patience = PATIENCE;
    while length > 0 {
        length -= 1;
        let entry = stack[length];
        if entry.near() > t_far {
            continue;
        }
        patience -= 1;
        if patience == 0 {
            return false;
        }
        let word = entry.word();
        if word & child::LEAF != 0 {
            if word != child::NONE {
                test_leaf(spaces, structure, word, lanes, found);
                t_far = farthest(found);
            }
            continue;
        }
        let Some(node) = structure.node(word) else {
            continue;
        };
        if length > STACK - WIDTH {
            continue;
        }
        let base = length;
        let mut rest = test_interval(&spaces.interval, spaces.signs, node, t_far);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % WIDTH;
            rest &= rest - 1;
            let (mask, near) = test_box(spaces, node, lane, found);
            let mask = mask & lanes;
            if mask == 0 {
                continue;
            }
            let entry = Entry::new(node.children[lane], _mm512_mask_reduce_min_ps(mask, near));
            // The nearest goes last.
            let mut place = length;
            while place > base && stack[place - 1] < entry {
                stack[place] = stack[place - 1];
                place -= 1;
            }
            stack[place] = entry;
            length += 1;
        }
    }
    true
}

/// Which children's boxes any of the rays might meet.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn test_interval(interval: &Interval, signs: [bool; 3], node: &Node, t_far: f32) -> u32 {
    let mut near = _mm256_set1_ps(interval.t_min);
    let mut far = _mm256_set1_ps(t_far);
    for axis in 0..3 {
        let sign = usize::from(signs[axis]);
        // SAFETY: eight numbers each.
        let (first, last) = unsafe {
            (
                _mm256_loadu_ps(node.bounds[2 * axis + sign].as_ptr()),
                _mm256_loadu_ps(node.bounds[2 * axis + 1 - sign].as_ptr()),
            )
        };
        let enter = _mm256_sub_ps(first, _mm256_set1_ps(interval.near_origin[axis]));
        let leave = _mm256_sub_ps(last, _mm256_set1_ps(interval.far_origin[axis]));
        let [low, high] = interval.near_inverse[axis];
        let enter = _mm256_min_ps(
            _mm256_mul_ps(enter, _mm256_set1_ps(low)),
            _mm256_mul_ps(enter, _mm256_set1_ps(high)),
        );
        let [low, high] = interval.far_inverse[axis];
        let leave = _mm256_max_ps(
            _mm256_mul_ps(leave, _mm256_set1_ps(low)),
            _mm256_mul_ps(leave, _mm256_set1_ps(high)),
        );
        near = _mm256_max_ps(enter, near);
        far = _mm256_min_ps(leave, far);
    }
    u32::from(_mm256_cmp_ps_mask::<_CMP_LE_OQ>(near, far))
}

/// Which rays meet a child's box, and where they enter it.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn test_box(spaces: &Spaces, node: &Node, lane: usize, found: &Found) -> (u16, __m512) {
    let mut near = spaces.t_min.load();
    let mut far = found.t.load();
    for axis in 0..3 {
        let sign = usize::from(spaces.signs[axis]);
        let first = _mm512_set1_ps(node.bounds[2 * axis + sign][lane]);
        let last = _mm512_set1_ps(node.bounds[2 * axis + 1 - sign][lane]);
        let origin = spaces.origin[axis].load();
        let enter = _mm512_mul_ps(
            _mm512_sub_ps(first, origin),
            spaces.near_inverse[axis].load(),
        );
        let leave = _mm512_mul_ps(_mm512_sub_ps(last, origin), spaces.far_inverse[axis].load());
        near = _mm512_max_ps(enter, near);
        far = _mm512_min_ps(leave, far);
    }
    (_mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far), near)
}

/// Tests the triangles of a leaf.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn test_leaf(spaces: &Spaces, structure: &Structure, word: u32, lanes: u16, found: &mut Found) {
    let index = word & child::INDEX;
    let groups = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
    for index in index..index + groups {
        let Some(group) = structure.group(index) else {
            return;
        };
        for i in 0..GROUP {
            if group.lanes >> i & 1 != 0 {
                let slot = GROUP as u32 * index + i as u32;
                test_triangle(spaces, structure, group, slot, lanes, found);
            }
        }
    }
}

type Flat = (__m512, __m512, __m512);

/// As [`super::group::intersect`] does it for four triangles and one ray.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn test_triangle(
    spaces: &Spaces,
    structure: &Structure,
    group: &TriangleGroup,
    slot: u32,
    lanes: u16,
    found: &mut Found,
) {
    let i = slot as usize % GROUP;
    let [x_axis, y_axis, z_axis] = spaces.axes;
    let moved = |vertex: usize, axis: usize| {
        _mm512_sub_ps(
            _mm512_set1_ps(group.vertices[vertex][axis][i]),
            spaces.origin[axis].load(),
        )
    };
    let (shear_x, shear_y) = (spaces.shear[0].load(), spaces.shear[1].load());
    let flat = |vertex: usize| -> Flat {
        let z = moved(vertex, z_axis);
        (
            _mm512_sub_ps(moved(vertex, x_axis), _mm512_mul_ps(shear_x, z)),
            _mm512_sub_ps(moved(vertex, y_axis), _mm512_mul_ps(shear_y, z)),
            z,
        )
    };
    let edge = |p: Flat, q: Flat| _mm512_sub_ps(_mm512_mul_ps(p.0, q.1), _mm512_mul_ps(p.1, q.0));
    let (a, b, c) = (flat(0), flat(1), flat(2));
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let zero = _mm512_setzero_ps();
    let least = _mm512_min_ps(u, _mm512_min_ps(v, w));
    let most = _mm512_max_ps(u, _mm512_max_ps(v, w));
    let outside = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(least, zero)
        & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(most, zero);
    let inside = !outside & lanes;
    if inside == 0 {
        return;
    }
    let front = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(least, zero);
    let back = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(most, zero);
    let whole = _mm512_add_ps(_mm512_add_ps(u, v), w);
    let size = _mm512_abs_ps(whole);
    let ordinary = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(size, _mm512_set1_ps(ORDINARY[0]))
        & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(size, _mm512_set1_ps(ORDINARY[1]));
    let decided = (front | back) & ordinary & inside;

    let inverse_whole = _mm512_div_ps(_mm512_set1_ps(1.0), whole);
    let v = _mm512_mul_ps(v, inverse_whole);
    let w = _mm512_mul_ps(w, inverse_whole);
    let t = _mm512_add_ps(
        _mm512_mul_ps(v, _mm512_sub_ps(b.2, a.2)),
        _mm512_mul_ps(w, _mm512_sub_ps(c.2, a.2)),
    );
    let z_hit = _mm512_add_ps(a.2, t);
    let reach = _mm512_max_ps(
        _mm512_max_ps(_mm512_abs_ps(a.2), _mm512_abs_ps(b.2)),
        _mm512_abs_ps(c.2),
    );
    let reach_limit = _mm512_mul_ps(_mm512_abs_ps(z_hit), _mm512_set1_ps(REACH));
    let modest = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(reach, reach_limit);
    let inverse_z = spaces.inverse_z.load();
    let t = _mm512_mul_ps(z_hit, inverse_z);
    let slack = _mm512_mul_ps(
        _mm512_mul_ps(reach, _mm512_abs_ps(inverse_z)),
        _mm512_set1_ps(SLACK),
    );
    let behind = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_add_ps(t, slack), spaces.t_min.load());
    let inside = inside & !(decided & behind);
    let decided = decided & inside & modest;
    let mut near = _mm512_set1_ps(f32::NEG_INFINITY);
    let mut far = _mm512_set1_ps(f32::INFINITY);
    for axis in (0..3).rev() {
        let [a, b, c] = [0, 1, 2].map(|vertex| group.vertices[vertex][axis][i]);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (first, last) = if spaces.signs[axis] {
            (high, low)
        } else {
            (low, high)
        };
        let origin = spaces.origin[axis].load();
        let enter = _mm512_sub_ps(_mm512_set1_ps(first), origin);
        let leave = _mm512_sub_ps(_mm512_set1_ps(last), origin);
        near = _mm512_max_ps(_mm512_mul_ps(enter, spaces.near_inverse[axis].load()), near);
        far = _mm512_min_ps(_mm512_mul_ps(leave, spaces.far_inverse[axis].load()), far);
    }
    let t = _mm512_min_ps(_mm512_max_ps(t, near), far);
    let t_far = found.t.load();
    let accepted = decided
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far)
        & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(t, spaces.t_min.load());
    let mut nearer = accepted & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(t, t_far);
    let ties = accepted & _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(t, t_far) & found.hit;
    if ties != 0 {
        nearer |= won_ties(structure, slot, ties, found);
    }
    if nearer != 0 {
        found.t.store(_mm512_mask_blend_ps(nearer, t_far, t));
        for (place, weight) in found.barycentrics.iter_mut().zip([v, w]) {
            place.store(_mm512_mask_blend_ps(nearer, place.load(), weight));
        }
        // SAFETY: sixteen words.
        unsafe {
            let slots = found.slots.as_mut_ptr().cast();
            _mm512_mask_storeu_epi32(slots, nearer, _mm512_set1_epi32(slot as i32));
        }
        found.front = found.front & !nearer | front & nearer;
        found.hit |= nearer;
    }
    let undecided = inside & !decided;
    if undecided != 0 {
        test_exactly(spaces, structure, group, slot, undecided, found);
    }
}

/// In which lanes a triangle comes before the one that was found at the same distance.
#[cold]
fn won_ties(structure: &Structure, slot: u32, ties: u16, found: &Found) -> u16 {
    let key = identity(structure, slot);
    (0..PACKET)
        .filter(|lane| ties >> lane & 1 != 0)
        .filter(|&lane| key < identity(structure, found.slots[lane]))
        .fold(0, |mask, lane| mask | 1 << lane)
}

/// One ray after the other, where rays meet edges and vertices.
#[cold]
#[inline(never)]
fn test_exactly(
    spaces: &Spaces,
    structure: &Structure,
    group: &TriangleGroup,
    slot: u32,
    lanes: u16,
    found: &mut Found,
) {
    for lane in (0..PACKET).filter(|lane| lanes >> lane & 1 != 0) {
        let mut space = Space::NOWHERE;
        space.set(
            [0, 1, 2].map(|axis| spaces.origin[axis].0[lane]),
            [0, 1, 2].map(|axis| spaces.direction[axis].0[lane]),
            spaces.t_min.0[lane],
            0.0,
        );
        let triangle = group.triangle(slot as usize % GROUP);
        let Some(hit) = intersect(&space, &triangle, Rim::Included) else {
            continue;
        };
        let t_far = found.t.0[lane];
        let wins = hit.t < t_far
            || hit.t == t_far && won_ties(structure, slot, (1 << lane) & found.hit, found) != 0;
        if hit.t > spaces.t_min.0[lane] && wins {
            found.t.0[lane] = hit.t;
            found.barycentrics[0].0[lane] = hit.barycentrics[0];
            found.barycentrics[1].0[lane] = hit.barycentrics[1];
            found.slots[lane] = slot;
            found.front = found.front & !(1 << lane) | u16::from(hit.front) << lane;
            found.hit |= 1 << lane;
        }
    }
}
