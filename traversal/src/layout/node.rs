//! Nodes in memory that others may write at any time.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;
use std::marker::PhantomData;

use super::{Node, WIDTH, child};

/// A node in a blob. Reads copy: a word is read once, checked, and then used.
#[derive(Clone, Copy)]
pub(crate) struct NodeAt<'a>(*const Node, PhantomData<&'a ()>);

impl NodeAt<'_> {
    /// # Safety
    /// A node is readable there as long as the value is in use, and aligned.
    #[inline(always)]
    pub unsafe fn new(node: *const Node) -> Self {
        NodeAt(node, PhantomData)
    }

    /// The first of the six rows of eight bounds, for vector loads.
    #[inline(always)]
    pub fn bounds(self) -> *const u8 {
        self.0.cast()
    }

    /// A row of bounds; see [`Node::bounds`].
    #[inline(always)]
    pub fn row(self, row: usize) -> *const [f32; WIDTH] {
        // SAFETY: one of the six.
        unsafe { self.bounds().cast::<[f32; WIDTH]>().add(row % 6) }
    }

    /// A child's bound.
    #[inline(always)]
    pub fn bound(self, row: usize, child: usize) -> f32 {
        // SAFETY: one of eight of a row.
        unsafe { self.row(row).cast::<f32>().add(child % WIDTH).read() }
    }

    /// A child's word; see [`Node::children`].
    #[inline(always)]
    pub fn child(self, child: usize) -> u32 {
        // SAFETY: one of eight of a node that is there.
        unsafe {
            let words = (&raw const (*self.0).children).cast::<u32>();
            words.add(child % WIDTH).read()
        }
    }

    /// All words, each of which is read once.
    #[inline(always)]
    pub fn children(self) -> [u32; WIDTH] {
        // SAFETY: the node is there.
        unsafe { (&raw const (*self.0).children).read_volatile() }
    }

    /// How many children there are.
    #[inline(always)]
    pub fn child_count(self) -> u32 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64; eight words of a node that is there.
        unsafe {
            let words = (&raw const (*self.0).children).cast::<__m128i>();
            let none = _mm_set1_epi32(child::NONE as i32);
            let is_none = |half| _mm_cmpeq_epi32(_mm_loadu_si128(words.add(half)), none);
            let missing = _mm_movemask_epi8(_mm_packs_epi32(is_none(0), is_none(1)));
            // Two bits of each.
            WIDTH as u32 - missing.count_ones() / 2
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let words = self.children();
            words.iter().filter(|&&word| word != child::NONE).count() as u32
        }
    }
}

const _: () = assert!(std::mem::offset_of!(Node, bounds) == 0);
