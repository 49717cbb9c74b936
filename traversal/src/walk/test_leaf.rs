//! Tests the primitives of leaves: from primitives to candidates and hits.

use super::edge_side::Rim;
use super::facts::InstanceFacts;
use super::kernel::Kernel;
use super::leaf::{Leaf, Triangles};
use super::level::Level;
use super::triangle::intersect;
use super::{Event, Walk, micromap, motion, swept_sphere};
use crate::layout::{Block, GROUP, TriangleGroup, child, geometry_word};
use crate::ray::{HIT_KIND_BACK_FACING_TRIANGLE, HIT_KIND_FRONT_FACING_TRIANGLE, Hit};
use crate::structure::Kind;

/// Tests the one primitive of a leaf without triangles; lowers `t_far` to its hit.
#[inline(never)]
pub(crate) fn test_other(
    walk: &mut Walk,
    level: &Level,
    instance: &InstanceFacts,
    word: u32,
    t_far: &mut f32,
) -> Leaf {
    match level.structure.kind() {
        Kind::Swept => return swept_sphere::test_leaf(walk, level, instance, word, t_far),
        Kind::Motion => return motion::test_leaf(walk, level, instance, word, t_far),
        _ => {}
    }
    match ask_about_box(walk, level, instance, word) {
        true => Leaf::Ask(Event::ProceduralCandidate, 0),
        false => Leaf::Finished,
    }
}

/// Makes a leaf's box the candidate; false if there is none.
fn ask_about_box(walk: &mut Walk, level: &Level, instance: &InstanceFacts, word: u32) -> bool {
    let Some(entry) = level.structure.box_entry(word & child::INDEX) else {
        return false;
    };
    let Some(opaque) = instance.opacity(entry.geometry) else {
        return false;
    };
    walk.candidate = Hit {
        t: walk.ray.t_min,
        geometry_index: entry.geometry & geometry_word::INDEX,
        primitive_index: entry.primitive,
        opaque,
        ..instance.hit()
    };
    true
}

/// Goes on with a leaf from `first_lane` on.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(never)]
pub(crate) unsafe fn finish<K: Kernel>(
    walk: &mut Walk,
    level: &Level,
    instance: &InstanceFacts,
    word: u32,
    first_lane: u32,
) -> Leaf {
    // A leaf of anything else has one.
    if level.structure.kind() != Kind::Triangles {
        return Leaf::Finished;
    }
    let mut t_far = level.ray.scaled_up(walk.hit.t);
    let leaf = Triangles {
        level,
        instance,
        word,
        first_lane,
    };
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    unsafe { K::test_leaf(&leaf, walk, &mut t_far) }
}

impl Triangles<'_> {
    /// Tests the triangles; lowers `t_far` to what is found.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn test<K: Kernel>(&self, walk: &mut Walk, t_far: &mut f32) -> Leaf {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let ray = unsafe { K::load_shear(&self.level.ray) };
        let index = self.word & child::INDEX;
        let structure = &self.level.structure;
        let first_slot = structure.first_slot(index);
        let block = structure.block(index).map(Block::groups);
        let groups = match &block {
            Some([_, last]) if last.lanes != 0 => 2,
            None if self.word & child::TWO_GROUPS != 0 => 2,
            _ => 1,
        };
        for group_index in self.first_lane / 4..groups {
            let group = match &block {
                Some(groups) => groups.get(group_index as usize),
                None => structure.group(index + group_index),
            };
            let Some(group) = group else {
                return Leaf::Finished;
            };
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let mut mask = unsafe { K::test_group(&ray, group, *t_far) };
            // A corrupt group may claim to have more lanes.
            mask &= 0xF & u32::MAX << self.first_lane.saturating_sub(4 * group_index);
            while mask != 0 {
                let lane = mask.trailing_zeros();
                mask &= mask - 1;
                let Some(hit) = self.hit(walk, group, first_slot + 4 * group_index + lane) else {
                    continue;
                };
                if !hit.opaque {
                    walk.candidate = hit;
                    return Leaf::Ask(Event::AnyHitCandidate, 4 * group_index + lane);
                }
                if walk.commit(hit) {
                    return Leaf::Over;
                }
                *t_far = self.level.ray.scaled_up(hit.t);
            }
        }
        Leaf::Finished
    }

    /// The hit of one triangle, if it is to be preferred to what there is.
    #[inline(always)]
    fn hit(&self, walk: &Walk, group: &TriangleGroup, slot: u32) -> Option<Hit> {
        let lane = slot as usize % GROUP;
        let geometry = group.geometries[lane];
        let (opaque, found) = if self.instance.uses_micromap(geometry) {
            let (triangle, primitive) = (group.triangle(lane), group.primitives[lane]);
            micromap::intersect_micromap(
                self.level,
                &self.level.ray,
                self.instance,
                &triangle,
                geometry,
                primitive,
            )?
        } else {
            let opaque = self.instance.opacity(geometry)?;
            let rim = if opaque { Rim::Included } else { Rim::Owned };
            (
                opaque,
                intersect(&self.level.ray, &group.triangle(lane), rim)?,
            )
        };
        let front = self.instance.facing(found.front)?;
        let hit = Hit {
            t: found.t,
            barycentrics: found.barycentrics,
            geometry_index: geometry & geometry_word::INDEX,
            primitive_index: group.primitives[lane],
            slot,
            hit_kind: if front {
                HIT_KIND_FRONT_FACING_TRIANGLE
            } else {
                HIT_KIND_BACK_FACING_TRIANGLE
            },
            opaque,
            triangle: true,
            ..self.instance.hit()
        };
        (walk.ray.t_min < hit.t && walk.is_nearer(&hit)).then_some(hit)
    }
}
