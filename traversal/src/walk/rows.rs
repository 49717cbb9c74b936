//! Rays and hits of up to sixteen lanes, a row for each number: as a subgroup of shader invocations
//! has them.

use lanes::LaneMask;
use lanes::vector::Vector;

use super::PACKET;
use crate::ray::{Hit, Ray, Swept};

/// A number of each lane.
pub type Lanes = [f32; PACKET];

/// A word of each lane.
pub type Words = [u32; PACKET];

/// The bits of a row of numbers.
#[inline(always)]
pub(crate) fn bits_of(numbers: &Lanes) -> &Words {
    // SAFETY: both are sixteen times 32 bits, of the same alignment, and any bits are a word.
    unsafe { &*std::ptr::from_ref(numbers).cast() }
}

/// The same, to be written.
#[inline(always)]
pub(crate) fn bits_of_mut(numbers: &mut Lanes) -> &mut Words {
    // SAFETY: as above, and any bits are a number.
    unsafe { &mut *std::ptr::from_mut(numbers).cast() }
}

/// A row of numbers in registers.
#[inline(always)]
pub(crate) fn load_row<V: Vector>(v: V, row: &Lanes) -> V::F {
    v.load(bits_of(row))
}

/// Rays by rows; see [`Ray`].
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct RayRows {
    pub origin: [Lanes; 3],
    pub t_min: Lanes,
    pub direction: [Lanes; 3],
    pub t_max: Lanes,
    /// When they are cast, in [0, 1].
    pub time: Lanes,
    pub flags: Words,
    pub cull_mask: Words,
    /// Addresses of the top levels; with 0 a ray misses.
    pub top_level: [u64; PACKET],
}

impl RayRows {
    /// Rays that miss.
    pub const NONE: RayRows = RayRows {
        origin: [[0.0; PACKET]; 3],
        t_min: [0.0; PACKET],
        direction: [[0.0; PACKET]; 3],
        t_max: [0.0; PACKET],
        time: [0.0; PACKET],
        flags: [0; PACKET],
        cull_mask: [0; PACKET],
        top_level: [0; PACKET],
    };

    /// Puts a ray into a lane.
    pub fn set(&mut self, lane: usize, top_level: u64, ray: &Ray, time: f32) {
        for axis in 0..3 {
            self.origin[axis][lane] = ray.origin[axis];
            self.direction[axis][lane] = ray.direction[axis];
        }
        self.t_min[lane] = ray.t_min;
        self.t_max[lane] = ray.t_max;
        self.time[lane] = time;
        self.flags[lane] = ray.flags;
        self.cull_mask[lane] = ray.cull_mask;
        self.top_level[lane] = top_level;
    }

    /// Which of some lanes have the structure, the flags and the mask of the first.
    #[inline(always)]
    pub(crate) fn alike(&self, first: usize, lanes: LaneMask) -> LaneMask {
        let (top_level, flags, mask) = (
            self.top_level[first],
            self.flags[first],
            self.cull_mask[first],
        );
        let mut differences = [0u64; PACKET];
        for i in 0..PACKET {
            let words = (self.flags[i] ^ flags) | (self.cull_mask[i] ^ mask);
            differences[i] = (self.top_level[i] ^ top_level) | u64::from(words);
        }
        if differences.iter().fold(0, |all, one| all | one) == 0 {
            return lanes;
        }
        let alike = LaneMask::from_fn(|i| {
            (self.top_level[i] == top_level)
                & (self.flags[i] == flags)
                & (self.cull_mask[i] == mask)
        });
        alike & lanes
    }

    /// The rays of some lanes. Other lanes repeat the first of them, so that they compute no
    /// exceptional values.
    #[inline(always)]
    pub(crate) fn filled(&self, lanes: LaneMask) -> RayRows {
        let (mut filled, first) = (self.clone(), lanes.first());
        for row in [&mut filled.t_min, &mut filled.t_max] {
            blend(row, &[row[first]; PACKET], !lanes);
        }
        for row in filled.origin.iter_mut().chain(&mut filled.direction) {
            blend(row, &[row[first]; PACKET], !lanes);
        }
        for row in [&mut filled.flags, &mut filled.cull_mask] {
            blend(row, &[row[first]; PACKET], !lanes);
        }
        for lane in !lanes {
            filled.top_level[lane] = self.top_level[first];
        }
        filled
    }

    /// Whether all have the structure, the flags and the mask of the first.
    #[inline(always)]
    pub(crate) fn are_alike(&self) -> bool {
        let (mut words, mut apart) = (0, 0);
        for i in 0..PACKET {
            words |= self.flags[i] ^ self.flags[0] | self.cull_mask[i] ^ self.cull_mask[0];
            apart |= self.top_level[i] ^ self.top_level[0];
        }
        words == 0 && apart == 0
    }

    /// The ray of a lane.
    #[inline]
    pub fn ray(&self, lane: usize) -> Ray {
        let lane = lane % PACKET;
        let (o, d) = (&self.origin, &self.direction);
        Ray {
            origin: [o[0][lane], o[1][lane], o[2][lane]],
            t_min: self.t_min[lane],
            direction: [d[0][lane], d[1][lane], d[2][lane]],
            t_max: self.t_max[lane],
            flags: self.flags[lane],
            cull_mask: self.cull_mask[lane],
        }
    }
}

/// Hits by rows; see [`Hit`].
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct HitRows {
    /// Where there is no hit: the end of the ray's interval.
    pub t: Lanes,
    pub barycentrics: [Lanes; 2],
    pub instance_index: Words,
    pub instance_custom_index: Words,
    pub instance_sbt_offset: Words,
    pub geometry_index: Words,
    pub primitive_index: Words,
    pub slot: Words,
    /// [`Hit::hit_kind`] in the lowest eight bits, above them what else is said in bits.
    kind: Words,
    /// Lanes with a hit; rows of others but `t` hold anything.
    pub found: LaneMask,
}

impl Default for HitRows {
    fn default() -> HitRows {
        HitRows::NONE
    }
}

const OPAQUE: u32 = 1 << 8;
const TRIANGLE: u32 = 1 << 9;
const SPHERE: u32 = 1 << 10;
const LINEAR_SWEPT_SPHERE: u32 = 1 << 11;

impl HitRows {
    /// No hits.
    pub(crate) const NONE: HitRows = HitRows {
        t: [0.0; PACKET],
        barycentrics: [[0.0; PACKET]; 2],
        instance_index: [0; PACKET],
        instance_custom_index: [0; PACKET],
        instance_sbt_offset: [0; PACKET],
        geometry_index: [0; PACKET],
        primitive_index: [0; PACKET],
        slot: [0; PACKET],
        kind: [0; PACKET],
        found: LaneMask::NONE,
    };

    /// Puts a hit into a lane.
    #[inline]
    pub fn set(&mut self, lane: usize, hit: &Hit) {
        let lane = lane % PACKET;
        let swept = match hit.swept {
            Swept::No => 0,
            Swept::Sphere => SPHERE,
            Swept::LinearSweptSphere => LINEAR_SWEPT_SPHERE,
        };
        self.t[lane] = hit.t;
        self.barycentrics[0][lane] = hit.barycentrics[0];
        self.barycentrics[1][lane] = hit.barycentrics[1];
        self.instance_index[lane] = hit.instance_index;
        self.instance_custom_index[lane] = hit.instance_custom_index;
        self.instance_sbt_offset[lane] = hit.instance_sbt_offset;
        self.geometry_index[lane] = hit.geometry_index;
        self.primitive_index[lane] = hit.primitive_index;
        self.slot[lane] = hit.slot;
        self.kind[lane] = u32::from(hit.hit_kind)
            | if hit.opaque { OPAQUE } else { 0 }
            | if hit.triangle { TRIANGLE } else { 0 }
            | swept;
        self.found.insert(lane);
    }

    /// Puts a box into lanes as their candidate: `t` is the lower end of each ray's interval.
    pub(crate) fn set_box(&mut self, lanes: LaneMask, hit: &Hit, t_min: &Lanes) {
        blend(&mut self.t, t_min, lanes);
        for weights in &mut self.barycentrics {
            blend(weights, &[0.0; PACKET], lanes);
        }
        self.set_place(lanes, hit);
        let kind = if hit.opaque { OPAQUE } else { 0 };
        blend(&mut self.kind, &[kind; PACKET], lanes);
    }

    /// Puts a triangle that is not opaque into lanes as their candidate: where each meets it.
    /// `front`: those that see its front, whose kind of hit is the second.
    pub(crate) fn set_triangle(
        &mut self,
        (lanes, front): (LaneMask, LaneMask),
        hit: &Hit,
        t: &Lanes,
        barycentrics: &[Lanes; 2],
        hit_kinds: [u8; 2],
    ) {
        blend(&mut self.t, t, lanes);
        for (weights, found) in self.barycentrics.iter_mut().zip(barycentrics) {
            blend(weights, found, lanes);
        }
        self.set_place(lanes, hit);
        self.set_kinds(lanes, front, hit_kinds, TRIANGLE);
    }

    /// Puts a kind of hit into the lanes that see a triangle's front, the second, and another into
    /// those that do not.
    #[inline(always)]
    fn set_kinds(&mut self, lanes: LaneMask, front: LaneMask, hit_kinds: [u8; 2], bits: u32) {
        for (lanes, kind) in [(lanes - front, hit_kinds[0]), (lanes & front, hit_kinds[1])] {
            blend(&mut self.kind, &[u32::from(kind) | bits; PACKET], lanes);
        }
    }

    /// Puts what and where a primitive is into lanes.
    fn set_place(&mut self, lanes: LaneMask, hit: &Hit) {
        self.set_instance(lanes, hit);
        for (row, word) in [
            (&mut self.instance_index, hit.instance_index),
            (&mut self.geometry_index, hit.geometry_index),
            (&mut self.primitive_index, hit.primitive_index),
            (&mut self.slot, hit.slot),
        ] {
            blend(row, &[word; PACKET], lanes);
        }
        self.found |= lanes;
    }

    /// Takes over the hits of some lanes.
    pub(crate) fn take(&mut self, from: &HitRows, lanes: LaneMask) {
        blend(&mut self.t, &from.t, lanes);
        for (weights, from) in self.barycentrics.iter_mut().zip(&from.barycentrics) {
            blend(weights, from, lanes);
        }
        for (row, from) in [
            (&mut self.instance_index, &from.instance_index),
            (&mut self.instance_custom_index, &from.instance_custom_index),
            (&mut self.instance_sbt_offset, &from.instance_sbt_offset),
            (&mut self.geometry_index, &from.geometry_index),
            (&mut self.primitive_index, &from.primitive_index),
            (&mut self.slot, &from.slot),
            (&mut self.kind, &from.kind),
        ] {
            blend(row, from, lanes);
        }
        self.found |= lanes;
    }

    /// Sets where some lanes hit what they hit, and the kind of hit.
    pub(crate) fn report(&mut self, lanes: LaneMask, t: &Lanes, kinds: &Words) {
        blend(&mut self.t, t, lanes);
        for (lane, kind) in kinds.iter().enumerate() {
            let word = self.kind[lane] & !0xFF | kind & 0xFF;
            self.kind[lane] = if lanes.contains(lane) {
                word
            } else {
                self.kind[lane]
            };
        }
    }

    /// Lanes whose candidate is of an opaque geometry.
    #[inline]
    pub fn opaque(&self) -> LaneMask {
        LaneMask::with_any(&self.kind, OPAQUE)
    }

    /// Which lanes have a hit that [`Hit::is_built_in`].
    #[inline]
    pub fn built_in(&self) -> LaneMask {
        LaneMask::with_any(&self.kind, TRIANGLE | SPHERE | LINEAR_SWEPT_SPHERE) & self.found
    }

    /// The hit of a lane that has one.
    #[inline]
    pub fn hit(&self, lane: usize) -> Hit {
        let lane = lane % PACKET;
        Hit {
            t: self.t[lane],
            barycentrics: [self.barycentrics[0][lane], self.barycentrics[1][lane]],
            instance_index: self.instance_index[lane],
            instance_custom_index: self.instance_custom_index[lane],
            instance_sbt_offset: self.instance_sbt_offset[lane],
            geometry_index: self.geometry_index[lane],
            primitive_index: self.primitive_index[lane],
            slot: self.slot[lane],
            hit_kind: self.hit_kind(lane),
            opaque: self.kind[lane] & OPAQUE != 0,
            triangle: self.kind[lane] & TRIANGLE != 0,
            swept: self.swept(lane),
        }
    }

    /// The hit of a lane, if there is one.
    #[inline]
    pub fn get(&self, lane: usize) -> Option<Hit> {
        (self.found.contains(lane % PACKET)).then(|| self.hit(lane))
    }

    /// [`Hit::hit_kind`].
    #[inline]
    pub fn hit_kind(&self, lane: usize) -> u8 {
        self.kind[lane % PACKET] as u8
    }

    /// [`Hit::swept`].
    #[inline]
    pub fn swept(&self, lane: usize) -> Swept {
        let kind = self.kind[lane % PACKET];
        match kind & (SPHERE | LINEAR_SWEPT_SPHERE) {
            0 => Swept::No,
            SPHERE => Swept::Sphere,
            _ => Swept::LinearSweptSphere,
        }
    }

    /// [`Hit::is_built_in`].
    #[inline]
    pub fn is_built_in(&self, lane: usize) -> bool {
        self.kind[lane % PACKET] & (TRIANGLE | SPHERE | LINEAR_SWEPT_SPHERE) != 0
    }

    /// Forgets the hits of lanes, whose rays begin now.
    #[inline(always)]
    pub(crate) fn start(&mut self, rays: &RayRows, lanes: LaneMask) {
        blend(&mut self.t, &rays.t_max, lanes);
        self.found -= lanes;
    }

    /// Puts what the triangles of an instance have in common into lanes.
    #[inline(always)]
    pub(crate) fn set_instance(&mut self, lanes: LaneMask, instance: &Hit) {
        blend(
            &mut self.instance_custom_index,
            &[instance.instance_custom_index; PACKET],
            lanes,
        );
        blend(
            &mut self.instance_sbt_offset,
            &[instance.instance_sbt_offset; PACKET],
            lanes,
        );
    }

    /// Puts an opaque triangle into a lane: which, and the kind of hit that it is.
    #[inline(always)]
    pub(crate) fn set_opaque_triangle(
        &mut self,
        lane: usize,
        geometry: u32,
        primitive: u32,
        hit_kind: u8,
    ) {
        let lane = lane % PACKET;
        self.geometry_index[lane] = geometry;
        self.primitive_index[lane] = primitive;
        self.kind[lane] = u32::from(hit_kind) | OPAQUE | TRIANGLE;
    }

    /// Puts one opaque triangle into lanes; `front`: those that see its front, whose kind of hit is
    /// the second.
    #[inline(always)]
    pub(crate) fn set_opaque_triangles(
        &mut self,
        lanes: LaneMask,
        front: LaneMask,
        geometry: u32,
        primitive: u32,
        hit_kinds: [u8; 2],
    ) {
        blend(&mut self.geometry_index, &[geometry; PACKET], lanes);
        blend(&mut self.primitive_index, &[primitive; PACKET], lanes);
        self.set_kinds(lanes, front, hit_kinds, OPAQUE | TRIANGLE);
    }
}

/// Takes over some lanes. `T` has 32 bits.
#[inline(always)]
pub(crate) fn blend<T: Copy>(to: &mut [T; PACKET], from: &[T; PACKET], lanes: LaneMask) {
    const { assert!(size_of::<T>() == size_of::<u32>()) };
    match lanes {
        LaneMask::NONE => {}
        LaneMask::ALL => *to = *from,
        _ => blend_some(to, from, lanes),
    }
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn blend_some<T: Copy>(to: &mut [T; PACKET], from: &[T; PACKET], lanes: LaneMask) {
    use std::arch::x86_64::*;
    // SAFETY: these processors have SSE2, and rows are sixteen words.
    unsafe {
        let (to, from) = (to.as_mut_ptr(), from.as_ptr());
        let given = _mm_set1_epi32(i32::from(lanes.bits()));
        for first in (0..PACKET).step_by(4) {
            let bit = |lane: usize| 1 << (first + lane);
            let bits = _mm_setr_epi32(bit(0), bit(1), bit(2), bit(3));
            let mask = _mm_cmpeq_epi32(_mm_and_si128(given, bits), bits);
            let to = to.add(first).cast::<__m128i>();
            let taken = _mm_and_si128(mask, _mm_loadu_si128(from.add(first).cast()));
            let kept = _mm_andnot_si128(mask, _mm_loadu_si128(to));
            _mm_storeu_si128(to, _mm_or_si128(kept, taken));
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn blend_some<T: Copy>(to: &mut [T; PACKET], from: &[T; PACKET], lanes: LaneMask) {
    // Copies: of a choice between places in memory, compilers make a choice between addresses.
    let (kept, taken) = (*to, *from);
    for lane in 0..PACKET {
        to[lane] = if lanes.contains(lane) {
            taken[lane]
        } else {
            kept[lane]
        };
    }
}
