//! Rays in a top level of several instances.

use lanes::LaneMask;

use super::leaf::{Bottom, comes_to};
use super::lists::{List, Stream};
use super::octant_stacks::LeafVisitor;
use super::rays;
use crate::layout::{child, instance_state};
use crate::ray::{Hit, Ray};
use crate::structure::{Kind, Structure};
use crate::walk::PACKET;
use crate::walk::children::LARGE;
use crate::walk::entry::{Entry, STACK};
use crate::walk::facts::InstanceFacts;
use crate::walk::group_hits::GroupHits;
use crate::walk::level::Level;
use crate::walk::level_rays::LevelRays;
use crate::walk::opaque::Nearest;

/// Fewer rays are not worth streams of their own.
const FEW: usize = 8;

/// A top level, and what walks through its instances need.
pub(super) struct Top<'a> {
    pub stack: &'a mut [Entry; STACK],
    pub top: &'a Level,
    pub bottom: &'a mut Level,
    pub instance: &'a mut InstanceFacts,
    pub hits: &'a mut GroupHits,
    pub level_rays: &'a mut LevelRays,
    /// The rays in an instance.
    pub inner: &'a mut Stream,
    /// Where rays have found something.
    pub instances: &'a mut [u32],
    /// One of them, for what they have in common.
    pub ray: &'a Ray,
    pub fetches_ahead: bool,
}

impl LeafVisitor for Top<'_> {
    fn structure(&self) -> &Structure {
        &self.top.structure
    }

    fn fetches_ahead(&self) -> bool {
        false
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    unsafe fn visit<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        fuel: &mut u64,
    ) {
        let index = list.word & child::INDEX;
        // SAFETY: the contract of `Walk::new`, for every ray.
        if !unsafe { (self.bottom).admit(self.instance, self.top, index, self.ray) } {
            return;
        }
        let Some(record) = self.top.structure.instance(index) else {
            return;
        };
        if !self.instance.suits_streams()
            || self.bottom.structure.kind() != Kind::Triangles
            || record.words.state & instance_state::MOVING != 0
        {
            return stream.split(list);
        }
        let inner = &mut *self.inner;
        inner.clear();
        let listed = list.first as usize..(list.first + list.count) as usize;
        for offsets in stream.words[listed].chunks(PACKET) {
            let (world_rays, t_far, names) = rays::world_rays(&stream.rays, offsets);
            let sound = self.level_rays.set_up(&world_rays, &record);
            let mut going = LaneMask::NONE;
            for (lane, &offset) in offsets.iter().enumerate() {
                let ray = &mut stream.rays[rays::index(offset)];
                let is_on_its_way = comes_to(ray, list.planes());
                going.set(lane, is_on_its_way);
                if is_on_its_way && !sound.contains(lane) {
                    ray.leave();
                }
            }
            let put = |places: &mut _| rays::put(self.level_rays, &t_far, &names, places);
            inner.add(sound & going, put, |lane| {
                let index = rays::index(offsets[lane]);
                let best = &stream.best[index];
                let before = match best.slot {
                    Hit::UNKNOWN_SLOT => 0,
                    _ => self.instances[index],
                };
                (Nearest::none_in(best.t_min, best.t), before)
            });
        }
        if inner.rays.is_empty() {
            return;
        }
        let mut place = Bottom {
            stack: self.stack,
            bottom: self.bottom,
            instance: self.instance,
            hits: self.hits,
            level_rays: self.level_rays,
            fetches_ahead: self.fetches_ahead && self.bottom.structure.node_count() > LARGE,
        };
        // SAFETY: the caller guarantees that the machine has the instruction set; the list is one
        // of the stream's.
        unsafe {
            if inner.rays.len() < FEW && place.instance.all_opaque {
                let all = inner.all();
                place.go_singly::<ANY, WIDE>(inner, &all, fuel);
            } else {
                inner.run(&mut place, ANY, WIDE, fuel);
            }
        }
        for (ray, best) in inner.rays.iter().zip(&inner.best) {
            let place = rays::index(ray.name);
            stream.rays[place].follow(ray);
            if best.slot != Hit::UNKNOWN_SLOT {
                stream.best[place] = *best;
                self.instances[place] = index;
            }
        }
    }

    #[cold]
    unsafe fn go_singly<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        _: &mut u64,
    ) {
        stream.split(list);
    }
}
