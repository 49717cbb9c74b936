//! Lists of rays on their way.

use std::arch::x86_64::*;

use super::rays::StreamRay;
use crate::walk::opaque::Nearest;

/// Rays in one structure.
#[derive(Default)]
pub(super) struct Stream {
    pub rays: Vec<StreamRay>,
    /// Their nearest hits here.
    pub best: Vec<Nearest>,
    /// The instance of each ray's hit so far; also 0 without a hit.
    pub before: Vec<u32>,
    /// Their octants, and which there are.
    pub(super) octants: Vec<u32>,
    pub(super) present: u8,
    pub(super) octant_stacks: [OctantStack; 8],
    /// Lists of rays, those of each octant after the last's.
    pub words: Vec<u32>,
    /// Room for the rays of the list at hand.
    pub here: Vec<u32>,
    /// Which children each meets, one a byte.
    pub masks: Vec<u8>,
}

/// The rays of an octant on their way.
#[derive(Default)]
pub(super) struct OctantStack {
    pub octant: usize,
    /// Lists of rays, and where they go.
    pub lists: Vec<List>,
    /// Where the words of its lists end.
    pub(super) end: usize,
}

/// Rays that enter a child.
#[derive(Clone, Copy)]
pub(super) struct List {
    /// The child's word.
    pub word: u32,
    pub first: u32,
    pub count: u32,
    /// The child's near planes, with the opposite sign.
    pub planes: [f32; 3],
}

impl List {
    /// The near planes of the child in one vector.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub fn planes(&self) -> __m128 {
        let [x, y, z] = self.planes;
        _mm_setr_ps(x, y, z, 0.0)
    }
}
