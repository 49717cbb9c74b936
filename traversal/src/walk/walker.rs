//! A thread's working state for the walk that it is running, and the loop itself.

use super::kernel::{Kernel, Portable};
use super::space::Space;
use super::triangle::{Rim, intersect};
use super::{Event, Walk};
use crate::layout::{MAX_DEPTH, WIDTH, child, features, geometry_word, instance_flags};
use crate::ray::{
    HIT_KIND_BACK_FACING_TRIANGLE, HIT_KIND_FRONT_FACING_TRIANGLE, Hit, Ray, ray_flags,
};
use crate::structure::{Kind, Structure};

/// A child still to be visited.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(crate) struct Entry {
    /// A [`child`] word.
    pub word: u32,
    /// Scaled distance to its box.
    pub near: f32,
}

/// Each level of a structure leaves seven siblings at most; two structures, and the eight of the
/// node at hand.
const STACK: usize = 2 * MAX_DEPTH as usize * (WIDTH - 1) + WIDTH + 1;

/// What a thread needs to run walks: the stack and the set-up of the ray being walked. Large
/// (some kilobytes), reused for every walk of the thread; holds nothing between calls that a
/// suspended walk needs.
pub struct Walker {
    stack: [Entry; STACK],
    tier: Tier,
}

/// An instruction set to walk with. The hits are the same bits in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// What every machine has.
    Portable,
    /// AVX2.
    Avx2,
    /// AVX-512 with 256-bit vectors.
    Avx512,
}

impl Tier {
    /// All tiers, the fastest last.
    pub const ALL: [Tier; 3] = [Tier::Portable, Tier::Avx2, Tier::Avx512];

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        match self {
            Tier::Portable => true,
            Tier::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
            }
            Tier::Avx512 => {
                Tier::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        return self == Tier::Portable;
    }

    /// The fastest that this machine has.
    pub fn best() -> Tier {
        *Tier::ALL
            .iter()
            .rev()
            .find(|tier| tier.is_available())
            .unwrap_or(&Tier::Portable)
    }
}

impl Walker {
    /// A walker for one thread, as fast as the machine allows.
    pub fn new() -> Box<Walker> {
        Walker::with_tier(Tier::best()).expect("the best tier is available")
    }

    /// A walker with a certain instruction set; `None` if the machine does not have it.
    pub fn with_tier(tier: Tier) -> Option<Box<Walker>> {
        tier.is_available().then(|| {
            Box::new(Walker {
                stack: [Entry::default(); STACK],
                tier,
            })
        })
    }
}

/// A structure and the ray in its space.
#[derive(Clone, Copy)]
struct Level {
    structure: Structure,
    space: Space,
}

/// The bottom level that a walk is in.
#[derive(Clone, Copy)]
struct Bottom {
    level: Level,
    instance: InstanceFacts,
    /// Entries of the stack that belong to the top level.
    floor: usize,
}

/// What an instance's record and the ray's flags say about candidates.
#[derive(Clone, Copy)]
struct InstanceFacts {
    index: u32,
    custom_index: u32,
    sbt_offset: u32,
    /// `Some`: every geometry is, or is not, opaque.
    opaque: Option<bool>,
    flip_facing: bool,
    cull_front: bool,
    cull_back: bool,
    cull_opaque: bool,
    cull_no_opaque: bool,
}

impl InstanceFacts {
    fn new(index: u32, record: &crate::layout::InstanceRecord, ray: &Ray) -> InstanceFacts {
        let flags = record.sbt_offset_and_flags >> 24;
        let instance = |bit: u32| flags & bit != 0;
        let ray = |bit: u32| ray.flags & bit != 0;
        let opaque = if ray(ray_flags::OPAQUE) {
            Some(true)
        } else if ray(ray_flags::NO_OPAQUE) {
            Some(false)
        } else if instance(instance_flags::FORCE_OPAQUE) {
            Some(true)
        } else if instance(instance_flags::FORCE_NO_OPAQUE) {
            Some(false)
        } else {
            None
        };
        let culls = !instance(instance_flags::TRIANGLE_FACING_CULL_DISABLE);
        InstanceFacts {
            index,
            custom_index: record.custom_index_and_mask & 0xFF_FFFF,
            sbt_offset: record.sbt_offset_and_flags & 0xFF_FFFF,
            opaque,
            flip_facing: instance(instance_flags::TRIANGLE_FLIP_FACING),
            cull_front: culls && ray(ray_flags::CULL_FRONT_FACING_TRIANGLES),
            cull_back: culls && ray(ray_flags::CULL_BACK_FACING_TRIANGLES),
            cull_opaque: ray(ray_flags::CULL_OPAQUE),
            cull_no_opaque: ray(ray_flags::CULL_NO_OPAQUE),
        }
    }

    /// Whether a geometry is opaque to this ray; `None` if it is culled for that.
    #[inline]
    fn opacity(&self, geometry: u32) -> Option<bool> {
        let opaque = self.opaque.unwrap_or(geometry & geometry_word::OPAQUE != 0);
        let culled = if opaque {
            self.cull_opaque
        } else {
            self.cull_no_opaque
        };
        (!culled).then_some(opaque)
    }

    /// Whether a structure with these features can have a candidate at all.
    fn admits(&self, structure: &Structure) -> bool {
        let has = structure.header().features;
        let (opaque, not_opaque) = match self.opaque {
            Some(opaque) => (opaque, !opaque),
            None => (has & features::OPAQUE != 0, has & features::NOT_OPAQUE != 0),
        };
        opaque && !self.cull_opaque || not_opaque && !self.cull_no_opaque
    }
}

/// Whether a ray can hit anything.
pub(crate) fn is_sound(ray: &Ray) -> bool {
    ray.origin
        .iter()
        .chain(&ray.direction)
        .all(|c| c.is_finite())
        && ray.t_min <= ray.t_max
}

/// The top level as the ray enters it; `None` if there is nothing to walk.
fn top_level(walk: &Walk) -> Option<Level> {
    // SAFETY: the contract of `Walk::new`.
    let structure = unsafe { Structure::at(walk.top_level) }?;
    if structure.kind() != Kind::Instances {
        return None;
    }
    let ray = &walk.ray;
    let reach = ray.origin.iter().fold(0f32, |most, c| most.max(c.abs()));
    let uncertainty = structure.header().origin_error * reach;
    Some(Level {
        structure,
        space: Space::new(ray.origin, ray.direction, ray.t_min, uncertainty),
    })
}

/// The bottom level of an instance as the ray enters it; `None` if it does not.
fn bottom_level(top: &Structure, index: u32, ray: &Ray) -> Option<(Level, InstanceFacts)> {
    let record = top.instance(index)?;
    if record.active == 0 || record.custom_index_and_mask >> 24 & ray.cull_mask & 0xFF == 0 {
        return None;
    }
    // SAFETY: bottom levels are alive by the contract of `Walk::new`.
    let structure = unsafe { Structure::at(top.reference(index)) }?;
    let skip = match structure.kind() {
        Kind::Triangles => ray_flags::SKIP_TRIANGLES,
        Kind::Aabbs => ray_flags::SKIP_AABBS,
        Kind::Instances => return None,
    };
    let facts = InstanceFacts::new(index, record, ray);
    if ray.flags & skip != 0 || !facts.admits(&structure) {
        return None;
    }
    let (to_world, to_object) = (&record.object_to_world, &record.world_to_object);
    // From the instance's position, so that a far one costs no more than its distance from the ray.
    let from: [f32; 3] = std::array::from_fn(|i| ray.origin[i] - to_world[4 * i + 3]);
    let turn = |v: &[f32; 3]| -> [f32; 3] {
        std::array::from_fn(|i| {
            let m = &to_object[4 * i..4 * i + 3];
            m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
        })
    };
    let level = Level {
        structure,
        space: Space::new(turn(&from), turn(&ray.direction), ray.t_min, 0.0),
    };
    Some((level, facts))
}

/// What became of a leaf.
enum Leaf {
    /// All of it is done.
    Finished,
    /// The walk ends.
    Over,
    /// The candidate in this lane (counted over the leaf's groups) is the caller's to decide.
    Ask(Event, u32),
}

/// Runs a walk until something has to be decided outside.
pub(crate) fn run(walk: &mut Walk, walker: &mut Walker, fuel: &mut u64) -> Event {
    match walker.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a walker has this tier only on machines that have the instruction set.
        Tier::Avx512 => unsafe { run_avx512(walk, walker, fuel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: likewise.
        Tier::Avx2 => unsafe { run_avx2(walk, walker, fuel) },
        // SAFETY: every machine has plain Rust.
        _ => unsafe { run_with::<Portable>(walk, walker, fuel) },
    }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
unsafe fn run_avx512(walk: &mut Walk, walker: &mut Walker, fuel: &mut u64) -> Event {
    // SAFETY: the caller's promise.
    unsafe { run_with::<super::avx::Avx>(walk, walker, fuel) }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn run_avx2(walk: &mut Walk, walker: &mut Walker, fuel: &mut u64) -> Event {
    // SAFETY: the caller's promise.
    unsafe { run_with::<super::avx::Avx>(walk, walker, fuel) }
}

/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn run_with<K: Kernel>(walk: &mut Walk, walker: &mut Walker, fuel: &mut u64) -> Event {
    let Some(top) = top_level(walk) else {
        return Event::Done;
    };
    let stack = &mut walker.stack;
    let mut length = walk.pending.len().min(STACK - WIDTH);
    stack[..length].copy_from_slice(&walk.pending[..length]);
    let mut bottom = None;
    if walk.instance != Walk::NO_INSTANCE {
        let Some((level, instance)) = bottom_level(&top.structure, walk.instance, &walk.ray) else {
            return Event::Done;
        };
        bottom = Some(Bottom {
            level,
            instance,
            floor: (walk.floor as usize).min(length),
        });
    }
    // A leaf that a verdict interrupted, and its first lane to look at.
    let mut resumed = walk.leaf.take();
    let mut left = *fuel;

    let event = 'level: loop {
        let Level { structure, space } = match &bottom {
            Some(bottom) => &bottom.level,
            None => &top,
        };
        let floor = bottom.as_ref().map_or(0, |bottom| bottom.floor);
        // SAFETY: the caller's promise.
        let ray = unsafe { K::load(space) };
        let mut t_far = space.scaled_up(walk.hit.t);

        'next: loop {
            let (word, first_lane) = match resumed.take() {
                Some((word, lane)) => (word, lane),
                None => {
                    // The nearest pending child that is still near enough.
                    let mut word = loop {
                        if length == floor {
                            if bottom.take().is_some() {
                                continue 'level;
                            }
                            break 'level Event::Done;
                        }
                        length -= 1;
                        if stack[length].near <= t_far {
                            break stack[length].word;
                        }
                    };
                    // Down to a leaf.
                    loop {
                        if left == 0 {
                            stack[length] = Entry { word, near: 0.0 };
                            length += 1;
                            break 'level Event::OutOfFuel;
                        }
                        left -= 1;
                        if word & child::LEAF != 0 {
                            break;
                        }
                        let Some(node) = structure.node(word) else {
                            continue 'next;
                        };
                        if length > STACK - WIDTH {
                            // Deeper than any structure that was built: corrupt.
                            continue 'next;
                        }
                        let mut near = [0.0; WIDTH];
                        // SAFETY: the caller's promise.
                        let mask = unsafe { K::test_node(&ray, node, t_far, &mut near) };
                        match push_children(mask, &node.children, &near, stack, &mut length) {
                            Some(nearest) => word = nearest,
                            None => continue 'next,
                        }
                    }
                    (word, 0)
                }
            };

            let Some(bottom) = &bottom else {
                let index = word & child::INDEX;
                if word != child::NONE
                    && let Some((level, instance)) = bottom_level(&top.structure, index, &walk.ray)
                {
                    bottom = Some(Bottom {
                        level,
                        instance,
                        floor: length,
                    });
                    stack[length] = Entry { word: 0, near: 0.0 };
                    length += 1;
                    continue 'level;
                }
                continue 'next;
            };
            // SAFETY: the caller's promise.
            let leaf = unsafe { test_leaf::<K>(walk, bottom, &ray, word, first_lane, &mut t_far) };
            match leaf {
                Leaf::Finished => {}
                Leaf::Over => {
                    length = 0;
                    break 'level Event::Done;
                }
                Leaf::Ask(event, lane) => {
                    walk.leaf = Some((word, lane + 1));
                    break 'level event;
                }
            }
        }
    };
    *fuel = left;
    walk.instance = bottom
        .as_ref()
        .map_or(Walk::NO_INSTANCE, |bottom| bottom.instance.index);
    walk.floor = bottom.as_ref().map_or(0, |bottom| bottom.floor) as u32;
    walk.pending.clear();
    if event != Event::Done {
        walk.pending.extend_from_slice(&stack[..length]);
    }
    event
}

/// Pushes the children in `mask`, farthest first, but for the nearest, which it returns.
#[inline(always)]
fn push_children(
    mask: u32,
    children: &[u32; WIDTH],
    near: &[f32; WIDTH],
    stack: &mut [Entry; STACK],
    length: &mut usize,
) -> Option<u32> {
    if mask == 0 {
        return None;
    }
    let entry = |mask: u32| {
        let lane = mask.trailing_zeros() as usize & (WIDTH - 1);
        Entry {
            word: children[lane],
            near: near[lane],
        }
    };
    let first = entry(mask);
    let mut rest = mask & (mask - 1);
    if rest == 0 {
        return Some(first.word);
    }
    let base = *length;
    stack[base] = first;
    let mut end = base + 1;
    while rest != 0 {
        let entry = entry(rest);
        rest &= rest - 1;
        let mut place = end;
        while place > base && stack[place - 1].near < entry.near {
            stack[place] = stack[place - 1];
            place -= 1;
        }
        stack[place] = entry;
        end += 1;
    }
    *length = end - 1;
    Some(stack[end - 1].word)
}

/// Tests the primitives of a leaf from `first_lane` on.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn test_leaf<K: Kernel>(
    walk: &mut Walk,
    bottom: &Bottom,
    ray: &K::Ray,
    word: u32,
    first_lane: u32,
    t_far: &mut f32,
) -> Leaf {
    let structure = &bottom.level.structure;
    let space = &bottom.level.space;
    let index = word & child::INDEX;
    if word == child::NONE {
        return Leaf::Finished;
    }
    if structure.kind() == Kind::Aabbs {
        if first_lane > 0 {
            return Leaf::Finished;
        }
        let Some(entry) = structure.box_entry(index) else {
            return Leaf::Finished;
        };
        let Some(opaque) = bottom.instance.opacity(entry.geometry) else {
            return Leaf::Finished;
        };
        walk.candidate = Hit {
            t: walk.ray.t_min,
            geometry_index: entry.geometry & geometry_word::INDEX,
            primitive_index: entry.primitive,
            opaque,
            ..bottom.instance.hit()
        };
        return Leaf::Ask(Event::ProceduralCandidate, 0);
    }
    let groups = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
    for group_index in first_lane / 4..groups {
        let Some(group) = structure.group(index + group_index) else {
            return Leaf::Finished;
        };
        // SAFETY: the caller's promise.
        let mut mask = unsafe { K::test_group(ray, group, *t_far) };
        // A corrupt group may claim to have more lanes.
        mask &= 0xF & u32::MAX << first_lane.saturating_sub(4 * group_index);
        while mask != 0 {
            let lane = mask.trailing_zeros();
            mask &= mask - 1;
            let geometry = group.geometries[lane as usize];
            let Some(opaque) = bottom.instance.opacity(geometry) else {
                continue;
            };
            let rim = if opaque { Rim::Included } else { Rim::Owned };
            let triangle = group.triangle(lane as usize);
            let Some(found) = intersect(space, &triangle, rim) else {
                continue;
            };
            let front = found.front != bottom.instance.flip_facing;
            let culled = if front {
                bottom.instance.cull_front
            } else {
                bottom.instance.cull_back
            };
            let hit = Hit {
                t: found.t,
                barycentrics: found.barycentrics,
                geometry_index: geometry & geometry_word::INDEX,
                primitive_index: group.primitives[lane as usize],
                slot: 4 * (index + group_index) + lane,
                hit_kind: if front {
                    HIT_KIND_FRONT_FACING_TRIANGLE
                } else {
                    HIT_KIND_BACK_FACING_TRIANGLE
                },
                opaque,
                triangle: true,
                ..bottom.instance.hit()
            };
            if culled || !(walk.ray.t_min < hit.t && walk.is_nearer(&hit)) {
                continue;
            }
            if !opaque {
                walk.candidate = hit;
                return Leaf::Ask(Event::AnyHitCandidate, 4 * group_index + lane);
            }
            if walk.commit(hit) {
                return Leaf::Over;
            }
            *t_far = space.scaled_up(hit.t);
        }
    }
    Leaf::Finished
}

impl InstanceFacts {
    /// A hit with what the instance knows of it.
    fn hit(&self) -> Hit {
        Hit {
            instance_index: self.index,
            instance_custom_index: self.custom_index,
            instance_sbt_offset: self.sbt_offset,
            ..Hit::default()
        }
    }
}
