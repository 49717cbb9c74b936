//! Finds the cheapest cuts of primitives in curve order.
//!
//! Large ranges are swept block by block, then between the two blocks around the best plane. Boxes
//! of 16, 256, … neighbors are computed before.

use std::mem::MaybeUninit;

use super::corners::Corners;
use super::primitive::Primitive;
use super::split::SplitRules;
use super::vector::Vector;

/// log₂ of the number of neighbors in a block with a precomputed box, and of blocks in a larger
/// block.
const BLOCK: u32 = 4;
/// Sizes of blocks.
const LEVELS: usize = 6;
/// Largest number of blocks of a sweep.
const SWEPT: usize = 64;

/// The number of boxes for a tree over `count` primitives.
pub(crate) fn block_count(count: u64) -> u64 {
    (1..=LEVELS as u32)
        .map(|level| count >> (BLOCK * level))
        .sum()
}

/// Boxes of full blocks, from the smallest to the largest.
pub(crate) struct Blocks<'a>([&'a [Corners]; LEVELS]);

impl<'a> Blocks<'a> {
    #[inline(always)]
    pub fn new<V: Vector>(primitives: &[Primitive], mut memory: &'a mut [Corners]) -> Blocks<'a> {
        let mut levels: [&[Corners]; LEVELS] = [&[]; LEVELS];
        let mut length = primitives.len() >> BLOCK;
        for level in 0..LEVELS {
            let (own, rest) = memory.split_at_mut(length);
            for (i, place) in own.iter_mut().enumerate() {
                let mut sum = V::of(&Corners::EMPTY);
                for k in i << BLOCK..(i + 1) << BLOCK {
                    sum = sum.join(match level {
                        0 => V::of_primitive(&primitives[k]),
                        _ => V::of(&levels[level - 1][k]),
                    });
                }
                *place = sum.corners();
            }
            levels[level] = own;
            memory = rest;
            length >>= BLOCK;
        }
        Blocks(levels)
    }
}

/// A range of the curve.
pub(crate) struct Stretch<'a> {
    pub blocks: &'a Blocks<'a>,
    pub primitives: &'a [Primitive],
    /// The curve index of the first element.
    pub first: usize,
}

/// A cut of a range, its cost, and the boxes of both sides.
#[derive(Clone, Copy)]
pub(crate) struct Cut<V> {
    cost: f32,
    /// On the curve.
    pub at: usize,
    pub sides: [V; 2],
}

impl Stretch<'_> {
    /// The box of block `index` of some size; of a primitive at level 0.
    #[inline(always)]
    fn block<V: Vector>(&self, level: usize, index: usize) -> V {
        match level {
            0 => V::of_primitive(&self.primitives[index - self.first]),
            _ => V::of(&self.blocks.0[level - 1][index]),
        }
    }

    /// The box of a part.
    #[inline(always)]
    fn bounds<V: Vector>(&self, mut start: usize, mut end: usize) -> V {
        let mut sum = V::of(&Corners::EMPTY);
        let mut level = 0;
        while start < end {
            let aligned = |index: usize| level < LEVELS && index.trailing_zeros() >= BLOCK;
            while start < end && !aligned(start) {
                sum = sum.join(self.block(level, start));
                start += 1;
            }
            while start < end && !aligned(end) {
                end -= 1;
                sum = sum.join(self.block(level, end));
            }
            (start, end) = (start >> BLOCK, end >> BLOCK);
            level += 1;
        }
        sum
    }

    /// The cheapest of all cuts through at most [`SWEPT`] primitives.
    #[inline(always)]
    fn sweep_each<V: Vector>(&self, rules: &SplitRules) -> Cut<V> {
        let count = self.primitives.len();
        let mut rights = [const { MaybeUninit::<V>::uninit() }; SWEPT + 1];
        let rights = &mut rights[..count];
        let mut right = V::of(&Corners::EMPTY);
        for (place, primitive) in rights.iter_mut().zip(self.primitives).rev() {
            right = right.join(V::of_primitive(primitive));
            place.write(right);
        }
        // SAFETY: all of them are written.
        let rights = unsafe { rights.assume_init_ref() };
        let mut left = V::of(&Corners::EMPTY);
        let mut best = (f32::INFINITY, 1);
        for (i, primitive) in (1..count).zip(self.primitives) {
            left = left.join(V::of_primitive(primitive));
            let counts = V::counts(&[i as u32, (count - i) as u32, 0, 0]);
            let costs = V::costs([left, rights[i], left], rules.scale, counts, rules.shift());
            let [one, other, ..] = V::numbers(costs);
            let cost = one + other;
            if cost < best.0 {
                best = (cost, i);
            }
        }
        let mut left = V::of(&Corners::EMPTY);
        for primitive in &self.primitives[..best.1] {
            left = left.join(V::of_primitive(primitive));
        }
        Cut {
            cost: best.0,
            at: self.first + best.1,
            sides: [left, rights[best.1]],
        }
    }

    /// The cheapest of the cuts between blocks from `low` to `high`.
    #[inline(always)]
    fn sweep<V: Vector>(
        &self,
        low: usize,
        high: usize,
        level: usize,
        rules: &SplitRules,
    ) -> Cut<V> {
        let shift = BLOCK * level as u32;
        let end = self.first + self.primitives.len();
        let (low_block, count) = (low >> shift, (high - low) >> shift);
        let mut rights = [const { MaybeUninit::<V>::uninit() }; SWEPT + 1];
        let rights = &mut rights[..=count];
        let mut right = self.bounds::<V>(high, end);
        rights[count].write(right);
        for i in (0..count).rev() {
            right = right.join(self.block(level, low_block + i));
            rights[i].write(right);
        }
        // SAFETY: all of them are written.
        let rights = unsafe { rights.assume_init_ref() };
        let mut left = self.bounds::<V>(self.first, low);
        let mut best = Cut {
            cost: f32::INFINITY,
            at: low,
            sides: [left, rights[0]],
        };
        for (i, &right) in rights.iter().enumerate() {
            if i > 0 {
                left = left.join(self.block(level, low_block + i - 1));
            }
            let at = low + (i << shift);
            let counts = V::counts(&[(at - self.first) as u32, (end - at) as u32, 0, 0]);
            let costs = V::costs([left, right, left], rules.scale, counts, rules.shift());
            let [one, other, ..] = V::numbers(costs);
            let cost = one + other;
            if cost < best.cost {
                best = Cut {
                    cost,
                    at,
                    sides: [left, right],
                };
            }
        }
        best
    }

    /// An almost cheapest cut.
    #[inline(always)]
    pub fn cut<V: Vector>(&self, rules: &SplitRules) -> Cut<V> {
        if self.primitives.len() < SWEPT {
            return self.sweep_each(rules);
        }
        let (start, end) = (self.first, self.first + self.primitives.len());
        let mut level = 0;
        while self.primitives.len() >> (BLOCK * level as u32) >= SWEPT && level < LEVELS {
            level += 1;
        }
        let mut shift = BLOCK * level as u32;
        // The first and the last block boundary with elements on both sides.
        let low = |shift: u32| ((start >> shift) + 1) << shift;
        let high = |shift: u32| ((end - 1) >> shift) << shift;
        let mut cut = self.sweep(low(shift), high(shift), level, rules);
        while level > 0 {
            let reach = 1 << shift;
            (level, shift) = (level - 1, shift - BLOCK);
            let low = low(shift).max(cut.at.saturating_sub(reach));
            let high = high(shift).min(cut.at + reach);
            cut = self.sweep(low, high, level, rules);
        }
        cut
    }

    /// The cut in the middle.
    #[inline(always)]
    pub fn halves<V: Vector>(&self) -> Cut<V> {
        let (start, end) = (self.first, self.first + self.primitives.len());
        let at = start + self.primitives.len() / 2;
        Cut {
            cost: 0.0,
            at,
            sides: [self.bounds(start, at), self.bounds(at, end)],
        }
    }
}
