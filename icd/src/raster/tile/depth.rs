//! Depth bounds, stencil and depth tests of sixteen pixels (spec, "Fragment Operations").
//!
//! Depths are compared in the attachment's format: new depths are rounded to it first. An integer
//! of up to 24 bits is exact in an f32, so that all formats are compared as numbers.

use ash::vk::{CompareOp, StencilOp};
use lanes::vector::{Task, Vector};

use super::bytes::{load_bytes, store_bytes};
use super::lanes::Row;
use super::places::{Pattern, Places};
use super::texels::{load, load_sized, load_word, store, store_sized, store_word};
use crate::object::graphics_state::{DepthStencil, StencilFace};
use crate::raster::{Target, Targets};

/// How a plane holds depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// Integers from 0 to this.
    Unorm(u32),
    Float,
    /// Floats from 0 to 1.
    Unit,
}

/// A depth attachment and what a draw does with it.
#[derive(Clone, Copy)]
struct Depth {
    target: Target,
    coding: Coding,
    test: bool,
    write: bool,
    compare: CompareOp,
    bounds: Option<[f32; 2]>,
}

/// A stencil attachment and what a draw does with it.
#[derive(Clone, Copy)]
struct Stencil {
    target: Target,
    /// Front, back.
    faces: [StencilFace; 2],
}

/// The tests of a draw.
#[derive(Clone, Copy)]
pub struct Tests {
    depth: Option<Depth>,
    stencil: Option<Stencil>,
}

/// Inputs of the tests of sixteen fragments.
pub struct Tested<'a, V: Vector> {
    pub places: &'a Places,
    /// Lanes of primitives that face front.
    pub front: u16,
    /// At the sample, before the format's rounding.
    pub depths: V::F,
    /// In the place of the references, where the shader says so.
    pub references: Option<&'a Row>,
}

/// The greatest code of 16 bits, and of 24.
const MOST_16: u32 = 0xffff;
const MOST_24: u32 = 0xff_ffff;

/// Depths as an attachment of 16 or 24 bits would hold them, up to `most`: the nearest codes.
#[inline(always)]
fn unorm_codes<V: Vector>(v: V, depths: V::F, most: u32) -> V::I {
    // A NaN is not greater than zero.
    let depths = v.min(v.max(depths, v.splat(0.0)), v.splat(1.0));
    if most <= MOST_16 {
        return v.scaled(depths, most as f32);
    }
    // The greatest code is 2²⁴ - 1. So the exact product is `scaled - depth`, where `scaled` is
    // exact in 32 bits. It rounds to one less than `scaled` does if it lies below
    // `nearest - 0.5`. A test of all floats from 0 to 1 against f64 found no difference.
    let scaled = v.mul(depths, v.splat((MOST_24 + 1) as f32));
    let nearest = v.round_ties_even(scaled);
    let above = v.add(v.sub(scaled, nearest), v.splat(0.5));
    let codes = v.to_i(nearest);
    v.add_i(
        codes,
        v.select(v.gt(depths, above), v.splat_i(-1), v.splat_i(0)),
    )
}

#[inline(always)]
fn compare_depths<V: Vector>(v: V, op: CompareOp, new: V::F, old: V::F) -> u16 {
    match op {
        CompareOp::NEVER => 0,
        CompareOp::LESS => v.gt(old, new),
        CompareOp::EQUAL => v.eq(new, old),
        CompareOp::LESS_OR_EQUAL => v.ge(old, new),
        CompareOp::GREATER => v.gt(new, old),
        CompareOp::NOT_EQUAL => !v.eq(new, old),
        CompareOp::GREATER_OR_EQUAL => v.ge(new, old),
        _ => u16::MAX,
    }
}

/// The reference against the stencil values: numbers of 8 bits.
#[inline(always)]
fn compare_stencils<V: Vector>(v: V, op: CompareOp, reference: V::I, old: V::I) -> u16 {
    match op {
        CompareOp::NEVER => 0,
        CompareOp::LESS => v.lt_u(reference, old),
        CompareOp::EQUAL => !v.ne_i(reference, old),
        CompareOp::LESS_OR_EQUAL => !v.lt_u(old, reference),
        CompareOp::GREATER => v.lt_u(old, reference),
        CompareOp::NOT_EQUAL => v.ne_i(reference, old),
        CompareOp::GREATER_OR_EQUAL => !v.lt_u(reference, old),
        _ => u16::MAX,
    }
}

/// A stencil operation on the 8 bits of each lane; results have other bits, too.
#[inline(always)]
fn operated<V: Vector>(v: V, op: StencilOp, old: V::I, reference: V::I) -> V::I {
    let (none, one) = (v.splat_i(0), v.splat_i(1));
    match op {
        StencilOp::ZERO => none,
        StencilOp::REPLACE => reference,
        StencilOp::INCREMENT_AND_CLAMP => v.min_i(v.add_i(old, one), v.splat_i(0xff)),
        StencilOp::DECREMENT_AND_CLAMP => v.max_i(v.sub_i(old, one), none),
        StencilOp::INVERT => v.xor_i(old, v.splat_i(-1)),
        StencilOp::INCREMENT_AND_WRAP => v.add_i(old, one),
        StencilOp::DECREMENT_AND_WRAP => v.sub_i(old, one),
        _ => old,
    }
}

impl Depth {
    fn new(target: Target, clamps_to_one: bool, state: &DepthStencil) -> Self {
        let bits = target.surface.format.channels[0].bits;
        let coding = match bits {
            32 if clamps_to_one => Coding::Unit,
            32 => Coding::Float,
            bits => Coding::Unorm((1 << bits) - 1),
        };
        Self {
            target,
            coding,
            test: state.depth_test,
            write: state.depth_test && state.depth_write,
            compare: state.depth_compare,
            bounds: state.depth_bounds_test.then_some(state.depth_bounds),
        }
    }

    /// The attachment's words. Its texels have two bytes or four.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    unsafe fn load<V: Vector>(&self, v: V, places: &Places, sample: u32, mask: u16) -> V::I {
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            match self.coding {
                Coding::Unorm(MOST_16) => load_sized(v, &self.target, places, sample, mask, 2)[0],
                _ => load_word(v, &self.target, places, sample, mask),
            }
        }
    }

    /// Stores words of the mask's lanes.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    unsafe fn store<V: Vector>(&self, v: V, places: &Places, sample: u32, mask: u16, words: V::I) {
        let target = &self.target;
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            if self.coding == Coding::Unorm(MOST_16) {
                let words = [words; 4];
                return store_sized(v, target, places, sample, mask, &words, 2);
            }
            store_word(v, target, places, sample, mask, words);
        }
    }

    /// The attachment's depths as numbers to compare.
    #[inline(always)]
    fn numbers<V: Vector>(&self, v: V, words: V::I) -> V::F {
        match self.coding {
            Coding::Float | Coding::Unit => v.bits_to_f(words),
            Coding::Unorm(most) => v.to_f(v.and_i(words, v.splat_i(most as i32))),
        }
    }

    /// Depths as the attachment would hold them, and as numbers to compare.
    #[inline(always)]
    fn codes<V: Vector>(&self, v: V, depths: V::F) -> (V::I, V::F) {
        match self.coding {
            Coding::Float => (v.bits_of(depths), depths),
            Coding::Unit => {
                let depths = v.min(v.max(depths, v.splat(0.0)), v.splat(1.0));
                (v.bits_of(depths), depths)
            }
            Coding::Unorm(most) => {
                let codes = unorm_codes(v, depths, most);
                (codes, v.to_f(codes))
            }
        }
    }

    /// Lanes whose depth in the attachment lies in the bounds.
    #[inline(always)]
    fn in_bounds<V: Vector>(&self, v: V, numbers: V::F, [least, most]: [f32; 2]) -> u16 {
        let units = match self.coding {
            Coding::Float | Coding::Unit => 1.0,
            Coding::Unorm(most) => most as f32,
        };
        let depths = v.div(numbers, v.splat(units));
        v.ge(depths, v.splat(least)) & v.ge(v.splat(most), depths)
    }
}

/// A depth test, and no other test.
#[derive(Clone, Copy)]
pub struct Plain<'a>(&'a Depth);

impl Plain<'_> {
    /// The test of a row of sixteen pixels, or of a block, with what it writes. Gives the lanes of
    /// the mask that pass.
    ///
    /// # Safety
    /// As [`load`], for all sixteen.
    #[inline(always)]
    pub unsafe fn run<V: Vector>(self, v: V, places: &Places, new: V::F, mask: u16) -> u16 {
        let Plain(depth) = self;
        // SAFETY: the caller keeps the contract of `load`, for all sixteen.
        unsafe {
            let old = depth.load(v, places, 0, mask);
            let (codes, new) = depth.codes(v, new);
            let passed = mask & compare_depths(v, depth.compare, new, depth.numbers(v, old));
            if depth.write && passed != 0 {
                depth.store(v, places, 0, u16::MAX, v.select(passed, codes, old));
            }
            passed
        }
    }
}

impl Tests {
    /// The depth test, if it is [`Plain`].
    pub fn plain(&self) -> Option<Plain<'_>> {
        let depth = self.depth.as_ref()?;
        let is_plain = self.stencil.is_none() && depth.test && depth.bounds.is_none();
        is_plain.then_some(Plain(depth))
    }

    /// Those of a draw's state on a pass's attachments.
    pub fn new(targets: &Targets, state: &DepthStencil) -> Self {
        let depth = (targets.depth.as_ref())
            .filter(|_| state.depth_test || state.depth_bounds_test)
            .map(|target| Depth::new(*target, targets.clamps_to_one, state));
        let stencil = (targets.stencil.as_ref())
            .filter(|_| state.stencil_test)
            .map(|target| Stencil {
                target: *target,
                faces: state.stencil,
            });
        Self { depth, stencil }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.depth.is_none() && self.stencil.is_none()
    }

    /// Whether fragments' depths matter.
    pub fn uses_depths(&self) -> bool {
        self.depth.is_some_and(|depth| depth.test)
    }

    /// Whether lanes that fail now fail later, too, whatever passes in between: tests may look
    /// without writing.
    pub fn is_monotonic(&self) -> bool {
        self.stencil.is_none()
            && self.depth.is_some_and(|depth| {
                depth.test
                    && matches!(
                        depth.compare,
                        CompareOp::LESS
                            | CompareOp::LESS_OR_EQUAL
                            | CompareOp::GREATER
                            | CompareOp::GREATER_OR_EQUAL
                    )
            })
    }

    /// Looks at one sample's depths without writing: the lanes of the mask that may pass. For tests
    /// that are [`Self::is_monotonic`].
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    pub unsafe fn may_pass<V: Vector>(
        &self,
        v: V,
        places: &Places,
        depths: V::F,
        sample: u32,
        mask: u16,
    ) -> u16 {
        let Some(depth) = &self.depth else {
            return mask;
        };
        // SAFETY: the caller keeps the contract of `load`.
        let words = unsafe { depth.load(v, places, sample, mask) };
        let (_, new) = depth.codes(v, depths);
        mask & compare_depths(v, depth.compare, new, depth.numbers(v, words))
    }

    /// Does the tests of one sample for the lanes of a mask, with what they write. Gives the lanes
    /// that pass all.
    ///
    /// # Safety
    /// As [`load`], for both attachments.
    #[inline(always)]
    pub unsafe fn run<V: Vector>(
        &self,
        v: V,
        tested: &Tested<'_, V>,
        sample: u32,
        mask: u16,
    ) -> u16 {
        let places = tested.places;
        let mut mask = mask;
        let mut near = u16::MAX;
        let mut written = None;
        if let Some(depth) = &self.depth {
            // SAFETY: the caller keeps the contract of `load`, for both attachments.
            let words = unsafe { depth.load(v, places, sample, mask) };
            let old = depth.numbers(v, words);
            if let Some(bounds) = depth.bounds {
                mask &= depth.in_bounds(v, old, bounds);
            }
            if depth.test {
                let (codes, new) = depth.codes(v, tested.depths);
                near = compare_depths(v, depth.compare, new, old);
                written = depth.write.then_some((depth, codes));
            }
        }
        let mut passed = mask & near;
        if let Some(stencil) = &self.stencil
            && !stencil.is_idle(tested.front, mask & !near, passed)
        {
            let task = StencilTest {
                stencil,
                places,
                sample,
                front: tested.front,
                references: tested.references,
                mask,
                near,
            };
            // SAFETY: the caller keeps the contract of `load`, for both attachments.
            passed = unsafe { v.apart(task) };
        }
        if let Some((depth, codes)) = written.filter(|_| passed != 0) {
            // SAFETY: the caller keeps the contract of `load`, for both attachments.
            unsafe { depth.store(v, places, sample, passed, codes) };
        }
        passed
    }
}

impl Stencil {
    /// Whether all lanes pass the stencil test, and none of those that fail the depth test or pass
    /// all changes its value.
    #[inline(always)]
    fn is_idle(&self, front: u16, depth_failed: u16, passed: u16) -> bool {
        let keeps = |op: StencilOp, lanes: u16| lanes == 0 || op == StencilOp::KEEP;
        let [face, back] = &self.faces;
        let [failed, back_failed] = [depth_failed & front, depth_failed & !front];
        let [passed, back_passed] = [passed & front, passed & !front];
        let is_idle = |face: &StencilFace, failed: u16, passed: u16| {
            failed | passed == 0
                || face.compare == CompareOp::ALWAYS
                    && keeps(face.depth_fail, failed)
                    && keeps(face.pass, passed)
        };
        is_idle(face, failed, passed) && is_idle(back, back_failed, back_passed)
    }
}

/// The stencil test of a sample, out of line: passes of few draws have one.
struct StencilTest<'a> {
    stencil: &'a Stencil,
    places: &'a Places,
    sample: u32,
    /// Lanes of primitives that face front.
    front: u16,
    /// In the place of the faces' references.
    references: Option<&'a Row>,
    mask: u16,
    /// Lanes that pass the depth test.
    near: u16,
}

impl<V: Vector> Task<V> for StencilTest<'_> {
    /// The lanes that pass both tests.
    type Output = u16;

    /// # Safety
    /// As [`load`], for the stencil attachment.
    #[inline(always)]
    unsafe fn run(self, v: V) -> u16 {
        let Self {
            stencil,
            places,
            sample,
            mask,
            ..
        } = self;
        let none = v.splat_i(0);
        let is_whole = matches!(places.pattern, Pattern::Row | Pattern::Block);
        let is_bytes = is_whole && stencil.target.surface.texel_size_bytes == 1;
        // SAFETY: the caller keeps the contract of `load`, for the stencil attachment.
        let old = unsafe {
            match is_bytes {
                true => load_bytes(v, &stencil.target, places, sample),
                false => load(v, &stencil.target, places, sample, mask)[0],
            }
        };
        let (mut new, mut passed) = (old, 0);
        for (face, facing) in stencil.faces.iter().zip([self.front, !self.front]) {
            let lanes = mask & facing;
            if lanes == 0 {
                continue;
            }
            let reference = match self.references {
                Some(row) => v.load_i(row),
                None => v.splat_i(face.reference as i32),
            };
            let compared = v.splat_i((face.compare_mask & 0xff) as i32);
            let (masked, stored) = (v.and_i(reference, compared), v.and_i(old, compared));
            let succeeds = lanes & compare_stencils(v, face.compare, masked, stored);
            passed |= succeeds & self.near;
            let ops = [
                (face.fail, lanes & !succeeds),
                (face.depth_fail, succeeds & !self.near),
                (face.pass, succeeds & self.near),
            ];
            let written = v.splat_i((face.write_mask & 0xff) as i32);
            for (op, lanes) in ops {
                if lanes != 0 && op != StencilOp::KEEP {
                    let changed = v.xor_i(operated(v, op, old, reference), old);
                    let value = v.xor_i(old, v.and_i(changed, written));
                    new = v.select(lanes, value, new);
                }
            }
        }
        if mask & v.ne_i(new, old) != 0 {
            // SAFETY: the caller keeps the contract of `load`, for the stencil attachment. Other
            // lanes keep what was loaded.
            unsafe {
                if is_bytes {
                    store_bytes(v, &stencil.target, places, sample, new);
                } else {
                    let words = [new, none, none, none];
                    store(v, &stencil.target, places, sample, mask, &words);
                }
            }
        }
        passed
    }
}
