//! Everything that lies on a ray's line, with the reason for each primitive that the ray does not
//! take: for reports. No walk needs this.
//!
//! Triangles and round primitives are looked for from the ray's start to infinity, whatever its
//! interval, flags and mask; boxes within the interval, since a box has no distance of its own.

use crate::build::{build, build_sizes};
use crate::input::{
    BuildFlags, BuildInput, Geometries, GeometryFlags, InstanceArray, InstanceSource,
};
use crate::layout::{ALIGNMENT, geometry_word, instance_state};
use crate::live::Live;
use crate::memory::Memory;
use crate::micromap::Opacity;
use crate::ray::{Hit, Ray, ray_flags};
use crate::structure::{Kind, Structure};
use crate::walk::facts::InstanceFacts;
use crate::walk::{Event, Verdict, Walk, Walker};

/// Fuel of the walks of one report.
const FUEL: u64 = 1 << 24;

/// Instances with a mask of 0 that are looked at, at most: no mask of a ray meets them, so they
/// need a structure of their own.
const MAX_UNSEEN: usize = 1 << 12;

/// The reason of a primitive on a ray's line, as far as the structures and the ray decide it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// A candidate: opaque ones are hits, shaders decide on the others.
    Candidate,
    /// Not behind the interval's lower end.
    BeforeStart,
    /// Not before the interval's upper end.
    BeyondEnd,
    /// The instance's mask and the ray's have no common bit.
    Masked,
    /// `SkipTrianglesKHR` or `SkipAABBsKHR`.
    Skipped,
    /// `CullFrontFacingTrianglesKHR`.
    FrontCulled,
    /// `CullBackFacingTrianglesKHR`.
    BackCulled,
    /// `CullOpaqueKHR`.
    OpaqueCulled,
    /// `CullNoOpaqueKHR`.
    NoOpaqueCulled,
    /// The micromap says that it is transparent there.
    MicromapTransparent,
}

/// A primitive on a ray's line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedPrimitive {
    /// Where. Of boxes, `t` means nothing. `opaque` is what it is to this ray.
    pub hit: Hit,
    /// The instance's mask.
    pub mask: u8,
    /// The state of the geometry's micromap at this point, where there is one that counts.
    pub micromap: Option<Opacity>,
    /// Whether it is a candidate, or why not.
    pub reason: Reason,
}

/// All primitives on a ray's line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RayReport {
    /// Boxes, then the others by distance.
    pub met: Vec<ReportedPrimitive>,
    /// There was more than fuel or room allowed.
    pub is_cut: bool,
}

impl RayReport {
    /// Looks at everything on a ray's line, cast at a time in [0, 1]; at most `room` primitives. A
    /// ray with a component that is not finite, or without a structure, meets nothing.
    ///
    /// # Safety
    /// As for [`Walk::new`]; `live` is where the structures may lie.
    pub unsafe fn new(
        walker: &mut Walker,
        top_level: u64,
        ray: &Ray,
        time: f32,
        live: &Live,
        room: usize,
    ) -> RayReport {
        let mut report = RayReport::default();
        // SAFETY: the caller keeps the promises of `Walk::new`, and guarantees that `live` is where
        // the structures may lie.
        unsafe { walker.set_live(live) };
        // SAFETY: the caller keeps the promises of `Walk::new`, and guarantees that `live` is where
        // the structures may lie.
        let Some(top) = (unsafe { Structure::at(top_level, live) }) else {
            return report;
        };
        if !top.kind().is_top() {
            return report;
        }
        let mut look = Look {
            walker,
            top: &top,
            ray,
            time,
            live,
            room,
            fuel: FUEL,
        };
        look.collect(top_level, None, &mut report);
        let unseen = UnreportedPrimitive::of(&top, live);
        report.is_cut |= unseen.is_cut;
        if let Some(lines) = &unseen.lines {
            let address = lines.as_ptr().expose_provenance() as u64;
            look.collect(address, Some(&unseen.indices), &mut report);
        }
        report.met.sort_by(|a, b| {
            let key = |met: &ReportedPrimitive| (met.hit.is_built_in(), met.hit.t);
            let (a_key, b_key) = (key(a), key(b));
            (a_key.0.cmp(&b_key.0)).then(a_key.1.total_cmp(&b_key.1))
        });
        report
    }
}

/// The arguments of a report.
struct Look<'a> {
    walker: &'a mut Walker,
    top: &'a Structure,
    ray: &'a Ray,
    time: f32,
    live: &'a Live,
    room: usize,
    fuel: u64,
}

impl Look<'_> {
    /// Adds what the ray meets in a top level; `indices` says which instances of the surveyed one
    /// are in it, if it is another.
    fn collect(&mut self, top_level: u64, indices: Option<&[u32]>, report: &mut RayReport) {
        let none_opaque = ray_flags::NO_OPAQUE | ray_flags::IGNORE_OPACITY_MICROMAPS;
        let line = Ray {
            t_min: 0.0,
            t_max: f32::INFINITY,
            flags: none_opaque | ray_flags::SKIP_AABBS,
            cull_mask: 0xFF,
            ..*self.ray
        };
        let interval = Ray {
            flags: none_opaque | ray_flags::SKIP_TRIANGLES,
            cull_mask: 0xFF,
            ..*self.ray
        };
        for ray in [line, interval] {
            // SAFETY: the promise of `RayReport::new`.
            let mut walk = unsafe { Walk::new(top_level, &ray) };
            walk.set_time(self.time);
            loop {
                match walk.resume(self.walker, Verdict::Continue, &mut self.fuel) {
                    Event::Done => break,
                    Event::OutOfFuel => {
                        report.is_cut = true;
                        return;
                    }
                    Event::AnyHitCandidate | Event::ProceduralCandidate => {
                        if report.met.len() == self.room {
                            report.is_cut = true;
                            return;
                        }
                        let mut hit = *walk.candidate();
                        if let Some(indices) = indices {
                            let index = indices.get(hit.instance_index as usize);
                            hit.instance_index = index.copied().unwrap_or(hit.instance_index);
                        }
                        report.met.extend(self.candidate(hit));
                    }
                }
            }
        }
    }

    /// The reason of a primitive.
    fn candidate(&self, mut hit: Hit) -> Option<ReportedPrimitive> {
        let words = self.top.instance_words(hit.instance_index)?;
        let mask = (words.custom_index_and_mask >> 24) as u8;
        // SAFETY: the promise of `RayReport::new`.
        let bottom = unsafe { Structure::at(self.top.reference(hit.instance_index), self.live) }?;
        let facts = InstanceFacts::new(hit.instance_index, &words, self.ray);
        let word = geometry_word_of(&bottom, hit.geometry_index);
        let micromap = (hit.triangle && facts.uses_micromap(word)).then(|| {
            bottom
                .micromap_opacity(hit.geometry_index, hit.primitive_index, self.live)
                .at(hit.barycentrics)
        });
        let is_front = hit.hit_kind == facts.hit_kind(true);
        let skips = match bottom.kind() {
            Kind::Aabbs => ray_flags::SKIP_AABBS,
            _ => ray_flags::SKIP_TRIANGLES,
        };
        let opacity = match micromap {
            Some(state) => facts.micromap_opacity(state),
            None => facts.opacity(word),
        };
        hit.opaque = opacity.unwrap_or(false);
        let is_transparent = micromap.is_some_and(|state| facts.is_transparent(state));
        let interval = !hit.is_built_in() || self.ray.t_min < hit.t;
        let reason = match () {
            () if u32::from(mask) & self.ray.cull_mask & 0xFF == 0 => Reason::Masked,
            () if self.ray.flags & skips != 0 => Reason::Skipped,
            () if is_transparent => Reason::MicromapTransparent,
            () if opacity.is_none() => match self.ray.flags & ray_flags::CULL_OPAQUE {
                0 => Reason::NoOpaqueCulled,
                _ => Reason::OpaqueCulled,
            },
            () if hit.triangle && facts.facing(is_front).is_none() => {
                match self.ray.flags & ray_flags::CULL_FRONT_FACING_TRIANGLES {
                    0 => Reason::BackCulled,
                    _ => Reason::FrontCulled,
                }
            }
            () if !interval => Reason::BeforeStart,
            () if hit.is_built_in() && hit.t >= self.ray.t_max => Reason::BeyondEnd,
            () => Reason::Candidate,
        };
        Some(ReportedPrimitive {
            hit,
            mask,
            micromap,
            reason,
        })
    }
}

/// A geometry as its primitives' words have it.
fn geometry_word_of(bottom: &Structure, geometry: u32) -> u32 {
    let flags = bottom.geometry(geometry).map_or(0, |entry| entry.flags);
    let mut word = geometry & geometry_word::INDEX;
    if flags & GeometryFlags::OPAQUE != 0 {
        word |= geometry_word::OPAQUE;
    }
    if bottom
        .micromap_address(geometry)
        .is_some_and(|address| address != 0)
    {
        word |= geometry_word::MICROMAP;
    }
    word
}

/// Memory at a boundary that structures have.
#[repr(align(256))]
#[derive(Clone, Copy)]
#[expect(dead_code, reason = "the memory is used as bytes")]
struct AlignedBytes([u8; ALIGNMENT as usize]);

/// Instances with a mask of 0, in a top level that rays can see. Those that move are left out.
#[derive(Default)]
struct UnreportedPrimitive {
    lines: Option<Vec<AlignedBytes>>,
    /// Their indices in the surveyed structure.
    indices: Vec<u32>,
    is_cut: bool,
}

impl UnreportedPrimitive {
    fn of(top: &Structure, live: &Live) -> UnreportedPrimitive {
        let mut unseen = UnreportedPrimitive::default();
        let mut records: Vec<u8> = Vec::new();
        for index in 0..top.reference_count() as u32 {
            let Some(words) = top.instance_words(index) else {
                continue;
            };
            let is_still = words.state & instance_state::MOVING == 0;
            if words.custom_index_and_mask >> 24 != 0
                || words.state & instance_state::ACTIVE == 0
                || !is_still
            {
                continue;
            }
            if unseen.indices.len() == MAX_UNSEEN {
                unseen.is_cut = true;
                break;
            }
            unseen.indices.push(index);
            for element in top.object_to_world(index) {
                records.extend(element.to_le_bytes());
            }
            records.extend((words.custom_index_and_mask | 0xFF << 24).to_le_bytes());
            records.extend(words.sbt_offset_and_flags.to_le_bytes());
            records.extend(top.reference(index).to_le_bytes());
        }
        let count = unseen.indices.len() as u32;
        if count == 0 {
            return unseen;
        }
        let sizes = build_sizes(Kind::Instances, BuildFlags(0), &[count]);
        let mut lines =
            vec![AlignedBytes([0; 256]); sizes.structure_bytes.div_ceil(ALIGNMENT) as usize];
        let mut scratch = vec![0; sizes.build_scratch_bytes as usize];
        let input = BuildInput {
            flags: BuildFlags(0),
            geometries: Geometries::Instances(InstanceSource {
                memory: Memory {
                    base: records.as_ptr(),
                    bytes: records.len(),
                },
                array: InstanceArray::Records,
                count,
                flags: GeometryFlags(0),
                live,
            }),
        };
        let bytes = lines.len() * size_of::<AlignedBytes>();
        // SAFETY: lines are plain bytes.
        let blob = unsafe { std::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), bytes) };
        // SAFETY: the records are alive, and name structures in live memory.
        match unsafe { build(&input, blob, &mut scratch) } {
            Ok(_) => unseen.lines = Some(lines),
            Err(_) => unseen.is_cut = true,
        }
        unseen
    }
}
