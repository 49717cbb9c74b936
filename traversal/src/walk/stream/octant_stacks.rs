//! Lists of rays, and whose turn it is.

use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use lanes::{LaneMask, prefetch_lines};

use super::lists::{List, Stream};
use super::nodes::{intersect_node, intersect_node_wide, put_chosen};
use super::rays::{self, StreamRay};
use crate::layout::{WIDTH, child};
use crate::structure::Structure;
use crate::walk::PACKET;
use crate::walk::entry::STACK;
use crate::walk::opaque::Nearest;
use crate::walk::rows::Words;

/// Words of an octant's lists for each of its rays: enough unless rays meet nearly all children.
/// Where they do, they go on singly.
const WORDS: usize = 24;

/// Lanes that a vector may write beyond the end of a list.
const SLACK: usize = 16;

/// Words that each octant has besides, so that few rays find room too.
const REST: usize = 8 * SLACK;

/// A structure with what is needed at its leaves.
pub(super) trait LeafVisitor {
    fn structure(&self) -> &Structure;

    /// Whether nodes and leaves are fetched ahead.
    fn fetches_ahead(&self) -> bool;

    /// Takes a list to a leaf.
    ///
    /// # Safety
    /// The machine has the instruction set; the list is one of the stream's.
    unsafe fn visit<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        fuel: &mut u64,
    );

    /// Takes a list on, each ray by itself.
    ///
    /// # Safety
    /// As above.
    unsafe fn go_singly<const ANY: bool, const WIDE: bool>(
        &mut self,
        stream: &mut Stream,
        list: &List,
        fuel: &mut u64,
    );
}

impl Stream {
    /// Forgets all rays.
    pub fn clear(&mut self) {
        self.rays.clear();
        self.best.clear();
        self.before.clear();
        self.octants.clear();
        self.present = 0;
    }

    /// Adds rays, with what they have found before. `rays` puts all sixteen down, and returns their
    /// octants.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub fn add(
        &mut self,
        lanes: LaneMask,
        rays: impl FnOnce(&mut [MaybeUninit<StreamRay>; PACKET]) -> Words,
        found: impl Fn(usize) -> (Nearest, u32),
    ) {
        let first = self.rays.len();
        self.rays.reserve(PACKET);
        self.octants.reserve(PACKET);
        self.best.reserve(PACKET);
        self.before.reserve(PACKET);
        let places = self.rays.spare_capacity_mut();
        let Some(places) = places.first_chunk_mut() else {
            return;
        };
        let octants = rays(places);
        let mut count = 0;
        for lane in lanes {
            if count != lane {
                places[count] = places[lane];
            }
            count += 1;
            let octant = octants[lane] % 8;
            self.octants.push(octant);
            self.present |= 1 << octant;
            let (best, before) = found(lane);
            self.best.push(best);
            self.before.push(before);
        }
        // SAFETY: so many were put down.
        unsafe { self.rays.set_len(first + count) };
    }

    /// Leaves the rays of a list to single walks, except finished ones.
    #[cold]
    pub fn split(&mut self, list: &List) {
        for i in 0..list.count as usize {
            self.rays[rays::index(self.words[list.first as usize + i])].leave();
        }
    }

    /// All rays at the root.
    pub fn all(&mut self) -> List {
        let count = self.rays.len();
        if self.words.len() < count {
            self.words.resize(count, 0);
        }
        for (i, word) in self.words[..count].iter_mut().enumerate() {
            *word = rays::offset(i);
        }
        List {
            word: 0,
            first: 0,
            count: count as u32,
            planes: [f32::NAN; 3],
        }
    }

    /// Takes all rays through a structure, as far as fuel lasts. `wide`: with AVX-512.
    ///
    /// # Safety
    /// The machine has the instruction set.
    pub unsafe fn run<P: LeafVisitor>(
        &mut self,
        place: &mut P,
        any: bool,
        wide: bool,
        fuel: &mut u64,
    ) {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            let going = self.start();
            match (any, wide) {
                (false, false) => run::<P, false>(self, place, going, fuel),
                (true, false) => run::<P, true>(self, place, going, fuel),
                (false, true) => run_wide::<P, false>(self, place, going, fuel),
                (true, true) => run_wide::<P, true>(self, place, going, fuel),
            }
        }
    }

    /// Puts the rays of each octant down at the root; returns which stacks are not empty.
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn start(&mut self) -> u32 {
        let count = self.rays.len();
        if self.here.len() < count + SLACK {
            self.here.resize(count + SLACK, 0);
            self.masks.resize(count + SLACK, 0);
        }
        let words = WORDS * count + 8 * REST;
        if self.words.len() < words {
            self.words.resize(words, 0);
        }
        self.octants
            .resize(count.next_multiple_of(PACKET), u32::MAX);
        let size = rays::offset(1) as i32;
        let lanes = _mm256_mullo_epi32(
            _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
            _mm256_set1_epi32(size),
        );
        let (mut active, mut end, present) = (0, 0, self.present);
        for octant in (0..8).filter(|octant| present >> octant & 1 != 0) {
            let first = end;
            let mut top = first;
            for (block, octants) in self.octants.chunks_exact(PACKET).enumerate() {
                let base = (block * PACKET) as i32 * size;
                let offsets = [base, base + 8 * size]
                    .map(|base| _mm256_add_epi32(lanes, _mm256_set1_epi32(base)));
                let ours = octants.iter().enumerate().fold(0, |ours, (lane, &own)| {
                    ours | u32::from(own as usize == octant) << lane
                });
                // SAFETY: a list has no more words than there are rays in its octant, and there is
                // slack.
                unsafe {
                    top += put_chosen::<false>(self.words.as_mut_ptr().add(top), offsets, ours)
                        as usize;
                }
            }
            end = first + WORDS * (top - first) + REST;
            let octant_stack = &mut self.octant_stacks[active];
            (octant_stack.octant, octant_stack.end) = (octant, end);
            octant_stack.lists.clear();
            octant_stack.lists.push(List {
                word: 0,
                first: first as u32,
                count: (top - first) as u32,
                planes: [f32::NAN; 3],
            });
            active += 1;
        }
        (1 << active) - 1
    }
}

/// [`run_with`] AVX2.
///
/// # Safety
/// The machine has it.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn run<P: LeafVisitor, const ANY: bool>(
    stream: &mut Stream,
    place: &mut P,
    going: u32,
    fuel: &mut u64,
) {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { run_with::<P, ANY, false>(stream, place, going, fuel) }
}

/// [`run_with`] the 32 registers and the masks of AVX-512.
///
/// # Safety
/// The machine has it.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_wide<P: LeafVisitor, const ANY: bool>(
    stream: &mut Stream,
    place: &mut P,
    going: u32,
    fuel: &mut u64,
) {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { run_with::<P, ANY, true>(stream, place, going, fuel) }
}

/// Takes turns with the stacks of octants until all are at their ends, or fuel is. What is called
/// here has one caller for each instruction set, so that it becomes part of it.
///
/// # Safety
/// The machine has the instruction set.
#[inline(always)]
unsafe fn run_with<P: LeafVisitor, const ANY: bool, const WIDE: bool>(
    stream: &mut Stream,
    place: &mut P,
    mut going: u32,
    fuel: &mut u64,
) {
    let mut octant_stacks = std::mem::take(&mut stream.octant_stacks);
    let mut turn = 0;
    while going != 0 {
        // The next octant in turn whose stack is not empty.
        let rest = going & u32::MAX << turn;
        let next = (if rest != 0 { rest } else { going }).trailing_zeros() as usize % 8;
        turn = next + 1;
        let octant_stack = &mut octant_stacks[next];
        let Some(list) = octant_stack.lists.pop() else {
            going &= !(1 << next);
            continue;
        };
        let count = list.count as usize;
        let Some(left) = fuel.checked_sub(count as u64) else {
            *fuel = 0;
            octant_stack.lists.push(list);
            break;
        };
        let has_room = list.first as usize + WIDTH * count + SLACK <= octant_stack.end;
        // SAFETY: the caller guarantees that the machine has the instruction set; words of nodes
        // are below the count, so inside the part, and parts are aligned.
        unsafe {
            // Words of leaves are above every index of a node.
            if list.word >= place.structure().node_count() {
                *fuel = left;
                if list.word & child::LEAF != 0 && list.word != child::NONE {
                    place.visit::<ANY, WIDE>(stream, &list, fuel);
                }
            } else if !has_room || octant_stack.lists.len() > STACK {
                place.go_singly::<ANY, WIDE>(stream, &list, fuel);
            } else {
                *fuel = left;
                let node = place.structure().node_at(list.word);
                if WIDE {
                    intersect_node_wide::<ANY>(stream, octant_stack, &list, node);
                } else {
                    intersect_node::<ANY>(stream, octant_stack, &list, node);
                }
            }
        }
        if place.fetches_ahead()
            && let Some(next) = octant_stack.lists.last()
        {
            fetch(place.structure(), next.word);
        }
    }
    for octant_stack in &mut octant_stacks {
        for list in octant_stack.lists.drain(..) {
            stream.split(&list);
        }
    }
    stream.octant_stacks = octant_stacks;
}

/// Asks for the memory of a child.
#[inline(always)]
fn fetch(structure: &Structure, word: u32) {
    let lines = if word & child::TWO_GROUPS != 0 { 6 } else { 4 };
    prefetch_lines(structure.child_address(word), lines);
}
