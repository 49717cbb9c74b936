//! Depth bounds, stencil and depth tests of sixteen pixels (spec, "Fragment Operations").
//!
//! Depths are compared as the attachment holds them: what comes in is rounded to the format first. An integer of up to 24 bits is exact in an f32,
//! so that all formats are compared as numbers.

use ash::vk::{CompareOp, StencilOp};
use spirv_jit::interp::TierKind;

use super::lanes::{Floats, Row, lanes_where, tiered};
use super::texels::{Places, load, store};
use crate::object::graphics_state::{DepthStencil, StencilFace};
use crate::raster::{Target, Targets};

/// How a plane holds depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// Integers from 0 to this.
    Unorm(u32),
    Float,
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
    tier: TierKind,
    depth: Option<Depth>,
    stencil: Option<Stencil>,
}

/// What the tests need of sixteen fragments.
pub struct Tested<'a> {
    pub places: &'a Places,
    /// Lanes of primitives that face front.
    pub front: u16,
    /// At the sample, before the format's rounding.
    pub depths: &'a Floats,
    /// In the place of the references, where the shader says so.
    pub references: Option<&'a Row>,
}

tiered! {
    /// Depths as the attachment would hold them.
    fn unorm_codes(depths: &Floats, most: u32) -> Floats {
        /// 1.5 · 2⁵²: the last place of a sum with it is worth 1.
        const ROUNDER: f64 = 6_755_399_441_055_744.0;
        let mut codes = [0.0; 16];
        for lane in 0..16 {
            let depth = depths[lane];
            // A NaN is not greater than zero.
            let depth = if depth > 0.0 { depth } else { 0.0 };
            let depth = if depth < 1.0 { depth } else { 1.0 };
            let scaled = f64::from(depth) * f64::from(most) + ROUNDER;
            codes[lane] = (scaled.to_bits() as u32 as i32) as f32;
        }
        codes
    }
}

tiered! {
    fn compare_depths(op: CompareOp, new: &Floats, old: &Floats) -> u16 {
        match op {
            CompareOp::NEVER => 0,
            CompareOp::LESS => lanes_where(|lane| new[lane] < old[lane]),
            CompareOp::EQUAL => lanes_where(|lane| new[lane] == old[lane]),
            CompareOp::LESS_OR_EQUAL => lanes_where(|lane| new[lane] <= old[lane]),
            CompareOp::GREATER => lanes_where(|lane| new[lane] > old[lane]),
            CompareOp::NOT_EQUAL => lanes_where(|lane| new[lane] != old[lane]),
            CompareOp::GREATER_OR_EQUAL => lanes_where(|lane| new[lane] >= old[lane]),
            _ => u16::MAX,
        }
    }
}

/// The reference against the stencil values.
fn compare_stencils(op: CompareOp, reference: &Row, old: &Row) -> u16 {
    match op {
        CompareOp::NEVER => 0,
        CompareOp::LESS => lanes_where(|lane| reference[lane] < old[lane]),
        CompareOp::EQUAL => lanes_where(|lane| reference[lane] == old[lane]),
        CompareOp::LESS_OR_EQUAL => lanes_where(|lane| reference[lane] <= old[lane]),
        CompareOp::GREATER => lanes_where(|lane| reference[lane] > old[lane]),
        CompareOp::NOT_EQUAL => lanes_where(|lane| reference[lane] != old[lane]),
        CompareOp::GREATER_OR_EQUAL => lanes_where(|lane| reference[lane] >= old[lane]),
        _ => u16::MAX,
    }
}

/// A stencil operation on 8 bits.
pub fn operate(op: StencilOp, old: u32, reference: u32) -> u32 {
    let new = match op {
        StencilOp::ZERO => 0,
        StencilOp::REPLACE => reference,
        StencilOp::INCREMENT_AND_CLAMP => (old + 1).min(0xff),
        StencilOp::DECREMENT_AND_CLAMP => old.saturating_sub(1),
        StencilOp::INVERT => !old,
        StencilOp::INCREMENT_AND_WRAP => old + 1,
        StencilOp::DECREMENT_AND_WRAP => old.wrapping_sub(1),
        _ => old,
    };
    new & 0xff
}

impl Depth {
    fn new(target: Target, state: &DepthStencil) -> Self {
        let bits = target.surface.format.channels[0].bits;
        let coding = match bits {
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

    /// What the attachment holds, as numbers to compare.
    #[inline(always)]
    fn numbers(&self, words: &Row) -> Floats {
        let mut numbers = [0.0; 16];
        match self.coding {
            Coding::Float => {
                for lane in 0..16 {
                    numbers[lane] = f32::from_bits(words[lane]);
                }
            }
            Coding::Unorm(most) => {
                for lane in 0..16 {
                    numbers[lane] = (words[lane] & most) as i32 as f32;
                }
            }
        }
        numbers
    }

    /// The words of such numbers.
    #[inline(always)]
    fn words(&self, numbers: &Floats) -> Row {
        let mut words = [0; 16];
        for lane in 0..16 {
            words[lane] = match self.coding {
                Coding::Float => numbers[lane].to_bits(),
                Coding::Unorm(_) => numbers[lane] as i32 as u32,
            };
        }
        words
    }

    /// Lanes whose depth in the attachment lies in the bounds.
    fn in_bounds(&self, numbers: &Floats, [least, most]: [f32; 2]) -> u16 {
        let units = match self.coding {
            Coding::Float => 1.0,
            Coding::Unorm(most) => most as f32,
        };
        lanes_where(|lane| {
            let depth = numbers[lane] / units;
            depth >= least && depth <= most
        })
    }
}

impl Tests {
    /// Those of a draw's state on a pass's attachments.
    pub fn new(tier: TierKind, targets: &Targets, state: &DepthStencil) -> Self {
        let depth = (targets.depth.as_ref())
            .filter(|_| state.depth_test || state.depth_bounds_test)
            .map(|target| Depth::new(*target, state));
        let stencil = (targets.stencil.as_ref())
            .filter(|_| state.stencil_test)
            .map(|target| Stencil {
                target: *target,
                faces: state.stencil,
            });
        Self {
            tier,
            depth,
            stencil,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.depth.is_none() && self.stencil.is_none()
    }

    /// Whether fragments' depths matter.
    pub fn uses_depths(&self) -> bool {
        self.depth.is_some_and(|depth| depth.test)
    }

    /// Whether lanes that fail now fail later, too, whatever passes in between: tests may look without writing.
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

    /// Looks at one sample's depths without writing: the lanes of the mask that may pass. For tests that are [`Self::is_monotonic`].
    ///
    /// # Safety
    /// As [`load`].
    pub unsafe fn may_pass(&self, places: &Places, depths: &Floats, sample: u32, mask: u16) -> u16 {
        let Some(depth) = &self.depth else {
            return mask;
        };
        // SAFETY: the caller's promise.
        let words = unsafe { load(&depth.target, places, sample, mask) };
        let new = self.codes(depth, depths);
        mask & compare_depths(self.tier, depth.compare, &new, &depth.numbers(&words[0]))
    }

    fn codes(&self, depth: &Depth, depths: &Floats) -> Floats {
        match depth.coding {
            Coding::Float => *depths,
            Coding::Unorm(most) => unorm_codes(self.tier, depths, most),
        }
    }

    /// Does the tests of one sample for the lanes of a mask, with what they write. Gives the lanes that pass all.
    ///
    /// # Safety
    /// As [`load`], for both attachments.
    pub unsafe fn run(&self, tested: &Tested<'_>, sample: u32, mask: u16) -> u16 {
        let places = tested.places;
        let mut mask = mask;
        let mut stored = None;
        if let Some(depth) = &self.depth {
            // SAFETY: the caller's promise.
            let words = unsafe { load(&depth.target, places, sample, mask) };
            let old = depth.numbers(&words[0]);
            if let Some(bounds) = depth.bounds {
                mask &= depth.in_bounds(&old, bounds);
            }
            stored = depth.test.then_some((depth, old));
        }
        let mut passed = mask;
        let stencils = self.stencil.as_ref().map(|stencil| {
            // SAFETY: the caller's promise.
            let old = unsafe { load(&stencil.target, places, sample, mask) }[0];
            passed &= self.stencil_passes(stencil, tested, &old);
            (stencil, old)
        });
        let stencil_passed = passed;
        if let Some((depth, old)) = stored {
            let new = self.codes(depth, tested.depths);
            passed &= compare_depths(self.tier, depth.compare, &new, &old);
            if depth.write && passed != 0 {
                let new = [depth.words(&new), [0; 16], [0; 16], [0; 16]];
                // SAFETY: the caller's promise.
                unsafe { store(&depth.target, places, sample, passed, &new) };
            }
        }
        if let Some((stencil, old)) = stencils {
            let failed = mask & !stencil_passed;
            let depth_failed = stencil_passed & !passed;
            let new = stencil_writes(stencil, tested, &old, failed, depth_failed);
            // SAFETY: the caller's promise.
            unsafe {
                let words = [new, [0; 16], [0; 16], [0; 16]];
                store(&stencil.target, places, sample, mask, &words);
            }
        }
        passed
    }

    fn stencil_passes(&self, stencil: &Stencil, tested: &Tested<'_>, old: &Row) -> u16 {
        let mut passed = 0;
        for (face, lanes) in stencil.faces.iter().zip([tested.front, !tested.front]) {
            if lanes == 0 {
                continue;
            }
            let masked = face.compare_mask & 0xff;
            let (mut reference, mut stored) = ([0; 16], [0; 16]);
            for lane in 0..16 {
                let given = tested.references.map_or(face.reference, |row| row[lane]);
                reference[lane] = given & masked;
                stored[lane] = old[lane] & masked;
            }
            passed |= lanes & compare_stencils(face.compare, &reference, &stored);
        }
        passed
    }
}

/// What the stencil attachment holds after the tests.
fn stencil_writes(
    stencil: &Stencil,
    tested: &Tested<'_>,
    old: &Row,
    failed: u16,
    depth_failed: u16,
) -> Row {
    let mut new = *old;
    for lane in 0..16 {
        let bit = 1 << lane;
        let face = &stencil.faces[usize::from(tested.front & bit == 0)];
        let op = match (failed & bit != 0, depth_failed & bit != 0) {
            (true, _) => face.fail,
            (_, true) => face.depth_fail,
            _ => face.pass,
        };
        let reference = tested.references.map_or(face.reference, |row| row[lane]);
        let written = operate(op, old[lane], reference & 0xff);
        let mask = face.write_mask & 0xff;
        new[lane] = old[lane] & !mask | written & mask;
    }
    new
}
