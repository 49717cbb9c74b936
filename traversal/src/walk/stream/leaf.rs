//! Rays in a bottom level of triangles that all count, or by their micromaps.

use std::arch::x86_64::*;

use super::lists::{List, Stream};
use super::octant_stacks::LeafVisitor;
use super::rays::{self, StreamRay, View};
use crate::layout::{GROUP, LEAF_TRIANGLES, MARGIN_RISE, Margin, TriangleGroup, child};
use crate::ray::Hit;
use crate::structure::Structure;
use crate::walk::avx::Avx;
use crate::walk::entry::{Entry, STACK};
use crate::walk::facts::InstanceFacts;
use crate::walk::group_hits::GroupHits;
use crate::walk::kernel::Kernel;
use crate::walk::level::Level;
use crate::walk::level_rays::LevelRays;
use crate::walk::micromap::{Seen, opacity_at};
use crate::walk::opaque::{End, Nearest, Opaque, Pending};
use crate::walk::{block, group};

/// A bottom level, and what walks in it need.
pub(super) struct Bottom<'a> {
    pub stack: &'a mut [Entry; STACK],
    pub bottom: &'a Level,
    pub instance: &'a InstanceFacts,
    pub hits: &'a mut GroupHits,
    pub level_rays: &'a mut LevelRays,
    pub fetches_ahead: bool,
}

impl LeafVisitor for Bottom<'_> {
    #[inline(always)]
    fn structure(&self) -> &Structure {
        &self.bottom.structure
    }

    #[inline(always)]
    fn fetches_ahead(&self) -> bool {
        self.fetches_ahead
    }

    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    unsafe fn visit<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        _: &mut u64,
    ) {
        let Bottom {
            bottom,
            instance,
            hits: found,
            level_rays,
            ..
        } = self;
        let word = list.word;
        let structure = &bottom.structure;
        let all_rays = stream.rays.as_mut_ptr();
        // SAFETY: the list is among the words.
        let listed = unsafe { stream.words.as_ptr().add(list.first as usize) };
        let here = stream.here.as_mut_ptr();

        // Those that still come so far.
        let mut count = 0;
        // SAFETY: as many places as in the longest list.
        unsafe {
            let planes = list.planes();
            keep(listed, list.count as usize, here, &mut count, |word| {
                let ray: &StreamRay = &*all_rays.byte_add(word as usize);
                comes_to(ray, planes)
            });
        }
        if count == 0 {
            return;
        }
        let mut room = None;
        let Some((groups, lanes)) = block::leaf_groups(structure, word, &mut room) else {
            return;
        };
        if count > 1 {
            let leaf = side_by_side(groups);
            let listed = count;
            count = 0;
            // SAFETY: as above; what is kept lies before what is looked at.
            unsafe {
                keep(here, listed, here, &mut count, |word| {
                    passes_inside(&*all_rays.byte_add(word as usize), &leaf, lanes)
                });
            }
        }
        let first_slot = structure.first_slot(word & child::INDEX);
        for i in 0..count {
            // SAFETY: words of lists are offsets of rays.
            let (offset, ray) = unsafe {
                let offset = *here.add(i);
                (offset, &mut *all_rays.byte_add(offset as usize))
            };
            // SAFETY: as many as rays.
            let (best, before) = unsafe {
                let index = rays::index(offset);
                (
                    stream.best.get_unchecked_mut(index),
                    *stream.before.get_unchecked(index),
                )
            };
            let interval = [best.t_min, best.t];
            // SAFETY: the machine has AVX2.
            let mut mask = unsafe {
                group::intersect(
                    View(ray, level_rays.tolerance),
                    groups,
                    lanes,
                    interval,
                    found,
                )
            };
            while mask != 0 {
                let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
                mask &= mask - 1;
                let t = found.t[i];
                let slot = first_slot + i as u32;
                if t > best.t {
                    continue;
                }
                if t == best.t && !wins_tie(structure, instance, best, before, slot) {
                    continue;
                }
                let [second, third] = &found.barycentrics;
                if instance.has_micromaps {
                    match opacity(bottom, instance, groups, i, [second[i], third[i]]) {
                        Some(true) => {}
                        None => continue,
                        Some(false) => {
                            ray.leave();
                            break;
                        }
                    }
                }
                *best = Nearest {
                    t_min: best.t_min,
                    t,
                    slot,
                    barycentrics: [second[i], third[i]],
                    front: found.front >> i & 1 != 0,
                };
                if ANY {
                    ray.end();
                    break;
                }
                ray.shorten(t);
            }
        }
    }

    #[cold]
    unsafe fn go_singly<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        fuel: &mut u64,
    ) {
        if !self.instance.all_opaque {
            return stream.split(list);
        }
        for i in 0..list.count as usize {
            let index = rays::index(stream.words[list.first as usize + i]);
            let (ray, best) = (&mut stream.rays[index], &mut stream.best[index]);
            if !ray.is_on_its_way() {
                continue;
            }
            ray.put(self.level_rays, 0);
            self.stack[0] = Entry::new(list.word, 0.0);
            let mut pending = Pending {
                stack: self.stack,
                floor: 0,
                length: 1,
            };
            let committed = committed(best.t, stream.before[index]);
            let way = Opaque {
                structure: &self.bottom.structure,
                instance: self.instance,
                level_rays: self.level_rays,
                lane: 0,
                committed: Some(&committed),
                fetches_ahead: self.fetches_ahead,
            };
            // SAFETY: the caller keeps the contract of this function.
            let end = unsafe {
                Avx::<WIDE>::walk_opaque::<ANY>(&way, best, &mut pending, self.hits, fuel)
            };
            match end {
                End::OutOfFuel => ray.leave(),
                End::Over => ray.end(),
                End::Finished => ray.shorten(best.t),
            }
        }
    }
}

/// Whether a triangle of a leaf is opaque at a point, in a structure with micromaps; `None` if it
/// is no candidate there.
#[cold]
#[inline(never)]
fn opacity(
    level: &Level,
    instance: &InstanceFacts,
    groups: [&TriangleGroup; 2],
    i: usize,
    barycentrics: [f32; 2],
) -> Option<bool> {
    let (group, lane) = (groups[i / GROUP], i % GROUP);
    match Seen::of(
        level,
        instance,
        group.geometries[lane],
        group.primitives[lane],
    ) {
        Seen::Not => None,
        Seen::Opaque => Some(true),
        Seen::Candidate => Some(false),
        Seen::ByParts(states) => opacity_at(&states, instance, barycentrics),
    }
}

/// The hit of a ray in an instance, as far as it counts for ties there: no hit and the first
/// instance have the same effect.
fn committed(t: f32, instance_index: u32) -> Hit {
    Hit {
        t,
        instance_index,
        opaque: true,
        triangle: true,
        ..Hit::default()
    }
}

/// Whether a triangle wins a tie with the hit so far; see [`Hit::wins_tie`].
#[cold]
#[inline(never)]
fn wins_tie(
    structure: &Structure,
    instance: &InstanceFacts,
    best: &Nearest,
    before: u32,
    slot: u32,
) -> bool {
    match best.slot {
        Hit::UNKNOWN_SLOT => instance.index < before,
        found => structure.identity(slot) < structure.identity(found),
    }
}

/// The vertices of a leaf: `[vertex][axis][lane]`, and the margin of its groups.
#[repr(C, align(64))]
struct Leaf([[[f32; LEAF_TRIANGLES]; 3]; 3], Margin);

/// Copies those words of a list that are wanted; without branches.
///
/// # Safety
/// There are so many words, and as many places; words may be in their own places.
#[inline(always)]
unsafe fn keep(
    words: *const u32,
    count: usize,
    places: *mut u32,
    kept: &mut usize,
    wanted: impl Fn(u32) -> bool,
) {
    let mut length = 0;
    for i in 0..count {
        // SAFETY: the caller guarantees that there are so many words, and as many places for them.
        unsafe {
            let word = *words.add(i);
            let wanted = wanted(word);
            *places.add(length) = word;
            length += usize::from(wanted);
        }
    }
    *kept = length;
}

/// Whether a ray does not end before planes, which have the opposite sign.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn comes_to(ray: &StreamRay, planes: __m128) -> bool {
    // SAFETY: four numbers each, the fourth of which does not count.
    let near = unsafe {
        let minus_origin = _mm_loadu_ps(ray.minus_origin.as_ptr());
        let inverse = _mm_loadu_ps(ray.near_inverse.as_ptr());
        _mm_mul_ps(_mm_sub_ps(planes, minus_origin), inverse)
    };
    let t_far = _mm_castps_si128(_mm_set1_ps(ray.t_far()));
    let beyond = _mm_cmpgt_epi32(_mm_castps_si128(near), t_far);
    _mm_movemask_ps(_mm_castsi128_ps(beyond)) & 7 == 0 && ray.is_on_its_way()
}

/// Both groups in one.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn side_by_side(groups: [&TriangleGroup; 2]) -> Leaf {
    let margin = groups[0].margin.max(groups[1].margin);
    let mut leaf = Leaf([[[0.0; LEAF_TRIANGLES]; 3]; 3], margin);
    for vertex in 0..3 {
        for axis in 0..3 {
            let [low, high] = groups.map(|group| &group.vertices[vertex][axis]);
            // SAFETY: four numbers each, and eight.
            unsafe {
                let both = _mm256_set_m128(_mm_load_ps(high.as_ptr()), _mm_load_ps(low.as_ptr()));
                _mm256_store_ps(leaf.0[vertex][axis].as_mut_ptr(), both);
            }
        }
    }
    leaf
}

/// Whether a ray passes inside a triangle, or may do so: as [`group::intersect`] finds out.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn passes_inside(ray: &StreamRay, leaf: &Leaf, lanes: u32) -> bool {
    let rows = ray.axes.map(|axis| 2 * usize::from(axis));
    let base = leaf.0.as_ptr().cast::<u8>();
    let [ox, oy, oz] = ray.own_origin;
    let [sx, sy] = ray.shear;
    macro_rules! flat {
        ($vertex:expr) => {{
            // SAFETY: axes are below three, and a vertex has three rows.
            let row = |k: usize| unsafe { _mm256_load_ps(base.add(96 * $vertex + rows[k]).cast()) };
            let x = _mm256_sub_ps(_mm256_set1_ps(ox), row(0));
            let y = _mm256_sub_ps(_mm256_set1_ps(oy), row(1));
            let z = _mm256_sub_ps(_mm256_set1_ps(oz), row(2));
            (
                _mm256_sub_ps(x, _mm256_mul_ps(_mm256_set1_ps(sx), z)),
                _mm256_sub_ps(y, _mm256_mul_ps(_mm256_set1_ps(sy), z)),
                z,
            )
        }};
    }
    macro_rules! edge {
        ($p:expr, $q:expr) => {
            _mm256_sub_ps(_mm256_mul_ps($p.0, $q.1), _mm256_mul_ps($p.1, $q.0))
        };
    }
    let (a, b, c) = (flat!(0), flat!(1), flat!(2));
    let (u, v, w) = (edge!(c, b), edge!(a, c), edge!(b, a));
    let least = _mm256_min_ps(u, _mm256_min_ps(v, w));
    let most = _mm256_max_ps(u, _mm256_max_ps(v, w));
    let Margin { reach, slope } = leaf.1;
    let distance = _mm256_andnot_ps(_mm256_set1_ps(-0.0), a.2);
    let rise = _mm256_mul_ps(distance, _mm256_set1_ps(MARGIN_RISE));
    let error = _mm256_mul_ps(
        _mm256_add_ps(distance, _mm256_set1_ps(reach)),
        _mm256_add_ps(_mm256_set1_ps(slope), rise),
    );
    // Two of opposite signs.
    let apart = _mm256_min_ps(most, _mm256_xor_ps(least, _mm256_set1_ps(-0.0)));
    let outside = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(apart, error));
    !outside as u32 & lanes != 0
}
