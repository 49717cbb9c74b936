//! From instance to instance, and where a suspended packet keeps the rays.

use lanes::LaneMask;

use super::kernel::PacketKernel;
use super::{Packet, PacketSpace};
use crate::layout::{child, geometry_word};
use crate::ray::Hit;
use crate::structure::{Kind, Structure};
use crate::walk::Walker;
use crate::walk::entry::Entry;
use crate::walk::rows::HitRows;
use crate::walk::suspended::{Progress, SuspendedLeaf};

/// The outcome of entering an instance.
pub(super) enum Entering {
    /// There is nothing for these rays.
    Nothing,
    Inside(Way),
    /// The rays do not go the same way there: these do, if any.
    Apart(LaneMask),
    /// It holds something that a packet does not do.
    Unusual,
}

/// The contents of a bottom level.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// Triangles that all count.
    Opaque,
    /// Triangles, some of which are candidates, or in part.
    Mixed,
    Boxes,
}

/// The leaf of a structure that holds but one group of triangles.
#[inline(always)]
fn only_group(structure: &Structure) -> Option<u32> {
    let (_, groups) = structure.groups();
    if groups == 0 || structure.node_count() != 1 {
        return None;
    }
    let [first, second, ..] = structure.node(0)?.children();
    let is_leaf = first & child::LEAF != 0 && first & child::TWO_GROUPS == 0;
    (is_leaf && second == child::NONE).then_some(first)
}

impl Packet<'_> {
    /// Continues, first in the given instance, if any, then with the pending nodes of the top
    /// level.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub(super) unsafe fn go<K: PacketKernel>(
        &mut self,
        walker: &mut Walker,
        hits: &mut HitRows,
        only: Option<(u32, LaneMask)>,
    ) -> Progress {
        let mut next = only;
        loop {
            let (index, lanes) = match next.take() {
                Some(instance) => instance,
                None if only.is_some() => break,
                None => {
                    let Walker {
                        packet, top: level, ..
                    } = &mut *walker;
                    let PacketSpace { top, ways, .. } = packet;
                    // SAFETY: the caller guarantees that the machine has the kernel's instruction
                    // set.
                    match unsafe { K::next_leaf(self, ways, &level.structure, top) } {
                        Some((word, lanes, _)) => (word & child::INDEX, lanes),
                        None => break,
                    }
                }
            };
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            match unsafe { self.enter::<K>(walker, index, lanes, false) } {
                Entering::Nothing => {}
                Entering::Inside(way) => {
                    let instance = (index, lanes);
                    let suspended_leaf = SuspendedLeaf::EMPTY;
                    // SAFETY: the caller guarantees that the machine has the kernel's instruction
                    // set.
                    if unsafe { self.walk_instance::<K>(walker, way, instance, suspended_leaf) } {
                        self.open(hits);
                        return Progress::Candidates;
                    }
                    if self.patience == 0 && self.has_asked {
                        // SAFETY: the caller guarantees that the machine has the kernel's
                        // instruction set.
                        return unsafe { self.split::<K>(walker, hits, instance) };
                    }
                }
                Entering::Apart(_) if !self.has_asked && only.is_none() => {
                    if !self.go_singly(walker, index, lanes) {
                        return Progress::Singly;
                    }
                }
                Entering::Apart(alike) if !self.has_asked => return Progress::apart(alike),
                _ if !self.has_asked => return Progress::Singly,
                _ => {
                    walker.packet.bottom.start(lanes);
                    // SAFETY: the caller guarantees that the machine has the kernel's instruction
                    // set.
                    return unsafe { self.split::<K>(walker, hits, (index, lanes)) };
                }
            }
        }
        match self.patience {
            0 if self.has_asked => {
                walker.packet.bottom.start(LaneMask::NONE);
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                unsafe { self.split::<K>(walker, hits, (0, LaneMask::NONE)) }
            }
            0 => Progress::Singly,
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            _ => unsafe { K::finish(self, hits, &walker.top) },
        }
    }

    /// Sets the rays of `lanes` up for an instance; `again` if they were there before.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub(super) unsafe fn enter<K: PacketKernel>(
        &mut self,
        walker: &mut Walker,
        index: u32,
        lanes: LaneMask,
        again: bool,
    ) -> Entering {
        let Walker {
            top,
            bottom,
            instance,
            packet:
                PacketSpace {
                    bottom: stack,
                    rays,
                    ..
                },
            ..
        } = walker;
        // SAFETY: the contract of `Walk::new`.
        if !unsafe { bottom.admit(instance, top, index, &self.first) } {
            return Entering::Nothing;
        }
        let Some(record) = top.structure.instance(index) else {
            return Entering::Nothing;
        };
        let asks = again || self.suspended.is_some();
        let way = match bottom.structure.kind() {
            Kind::Triangles if instance.all_opaque => Way::Opaque,
            Kind::Triangles if instance.is_plain && (asks || instance.is_settled()) => Way::Mixed,
            Kind::Aabbs if asks => Way::Boxes,
            _ => return Entering::Unusual,
        };
        let leaf = only_group(&bottom.structure);
        let setting = (lanes, leaf.is_none());
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let alike = unsafe { K::set_up_instance(rays, self.rays, &record, setting) };
        if alike != lanes {
            return Entering::Apart(alike);
        }
        self.found.instance = index;
        if !again {
            let entry = leaf.map_or(Entry::ROOT, |leaf| Entry::new(leaf, 0.0));
            stack.start_at(entry, lanes);
        }
        Entering::Inside(way)
    }

    /// Takes rays through the instance that they have entered, from the leaf on at which they
    /// stand. Whether they stand at candidates now, and a [`Suspended`](crate::walk::Suspended)
    /// keeps them.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub(super) unsafe fn walk_instance<K: PacketKernel>(
        &mut self,
        walker: &mut Walker,
        way: Way,
        instance: (u32, LaneMask),
        mut suspended_leaf: SuspendedLeaf,
    ) -> bool {
        loop {
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let stands = way == Way::Mixed
                && unsafe { self.stands::<K>(walker, instance, &mut suspended_leaf) };
            if stands {
                return true;
            }
            let Walker {
                packet,
                bottom: level,
                instance: facts,
                ..
            } = &mut *walker;
            let PacketSpace { bottom, rays, .. } = packet;
            let structure = &level.structure;
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let next = unsafe { K::next_leaf(self, rays, structure, bottom) };
            let Some((word, here, t_far)) = next else {
                return false;
            };
            let (leaf, found) = ((word, here), &mut *self.found);
            match way {
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                Way::Opaque => unsafe { K::test_leaf(rays, structure, leaf, t_far, found) },
                Way::Mixed => {
                    suspended_leaf =
                        // SAFETY: the caller guarantees that the machine has the kernel's
                        // instruction set.
                        unsafe { K::test_some(rays, level, facts, leaf, t_far, found) };
                    if self.suspended.is_none() && !suspended_leaf.is_over() {
                        // A geometry without a micromap: the attempt ends.
                        self.patience = 0;
                    }
                }
                Way::Boxes => {
                    if self.stands_at_box(walker, instance, word, here) {
                        return true;
                    }
                }
            }
        }
    }

    /// Whether rays have candidates among the triangles of the leaf where they stand.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn stands<K: PacketKernel>(
        &mut self,
        walker: &Walker,
        instance: (u32, LaneMask),
        suspended_leaf: &mut SuspendedLeaf,
    ) -> bool {
        let (live, structure) = (self.live(), &walker.bottom.structure);
        let Some(suspended) = self.suspended.as_deref_mut() else {
            return false;
        };
        let (rays, candidates) = (&walker.packet.rays, &mut suspended.candidates);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe {
            K::next_candidates(
                rays,
                structure,
                &walker.instance,
                suspended_leaf,
                live,
                self.found,
                candidates,
            );
        }
        if suspended.candidates.found.is_empty() {
            return false;
        }
        suspended.leaf = *suspended_leaf;
        self.keep(walker, instance);
        true
    }

    /// Whether there is a box for rays in a leaf.
    #[inline(always)]
    fn stands_at_box(
        &mut self,
        walker: &Walker,
        instance: (u32, LaneMask),
        word: u32,
        lanes: LaneMask,
    ) -> bool {
        let facts = &walker.instance;
        let entry = walker.bottom.structure.box_entry(word & child::INDEX);
        let (Some(suspended), Some(entry)) = (self.suspended.as_deref_mut(), entry) else {
            return false;
        };
        let Some(opaque) = facts.opacity(entry.geometry) else {
            return false;
        };
        let hit = Hit {
            geometry_index: entry.geometry & geometry_word::INDEX,
            primitive_index: entry.primitive,
            opaque,
            ..facts.hit()
        };
        suspended.candidates.found = LaneMask::NONE;
        suspended.candidates.set_box(lanes, &hit, &self.rays.t_min);
        suspended.leaf = SuspendedLeaf::EMPTY;
        self.keep(walker, instance);
        true
    }

    /// Leaves the rays to the suspended packet.
    fn keep(&mut self, walker: &Walker, instance: (u32, LaneMask)) {
        let live = self.live();
        let Some(suspended) = self.suspended.as_deref_mut() else {
            return;
        };
        if !self.has_asked {
            suspended.started = self.lanes;
        }
        suspended.lanes = self.lanes;
        (suspended.is_single, suspended.ended) = (false, LaneMask::NONE);
        suspended.any = self.any;
        suspended.patience = self.patience;
        suspended.found = self.found.clone();
        suspended.instance = Some(instance);
        match crate::walk::level::only_instance(&walker.top) {
            Some(_) => suspended.top.clear(),
            None => walker.packet.top.save(live, &mut suspended.top),
        }
        walker.packet.bottom.save(live, &mut suspended.bottom);
    }

    /// Walks each ray alone from this point: first its pending nodes in an instance, if it is in
    /// one.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[cold]
    pub(super) unsafe fn split<K: PacketKernel>(
        &mut self,
        walker: &Walker,
        hits: &mut HitRows,
        (index, lanes): (u32, LaneMask),
    ) -> Progress {
        self.keep(walker, (index, lanes & self.live()));
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe { K::finish(self, hits, &walker.top) };
        Progress::Split(self.live())
    }
}
