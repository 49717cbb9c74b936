//! Which instructions are performed together with the one that uses their result
//! ([`kernels::fused`](super::kernels)): pairs, and the derivatives of the coordinates that a
//! sample takes its level of detail from.

use foldhash::HashMap;
use images::{LodMode, fast};
use lanes::Tier as TierKind;

use super::kernels::{Side, fused};
use crate::ir::{Body, Function, Inst, Node, Op, Type, Value};
use crate::plan::Liveness;

/// How many instructions a first operation may be put off: its operands live on for as long.
const REACH: usize = 24;

/// Two instructions that are performed as one.
#[derive(Clone, Debug)]
pub(super) struct Fused {
    pub first: Op,
    /// Type of the first one's result.
    pub ty: Type,
    pub side: Side,
    /// `a`, `b`, `c` of the kernel; `None` where an operation has one operand.
    pub operands: [Option<Value>; 3],
}

/// A function's pairs.
#[derive(Default)]
pub(super) struct Fusion {
    /// By the second one's result.
    pairs: HashMap<Value, Fused>,
    /// By value: the result of a first one, which exists nowhere.
    absorbed: Vec<bool>,
}

/// Of a sample, the operands that hold coordinates, and those that hold their derivatives: in x,
/// then in y.
fn of_sample(inst: &Inst) -> Option<(&[Value], &[Value])> {
    let Op::Image(op) = inst.op else {
        return None;
    };
    if op.lod != LodMode::Grad || !fast::may_apply(&op) {
        return None;
    }
    let operands = inst.args.get(2..)?;
    let slopes = operands.get(op.rows_before_lod()..)?;
    let spatial = op.spatial_count();
    Some((operands.get(..spatial)?, slopes.get(..2 * spatial)?))
}

impl Fusion {
    /// Makes live ranges those of the pairs: what a first instruction takes lives until the second,
    /// and what it gives is nowhere.
    pub fn stretch(&self, liveness: &mut Liveness) {
        for (result, pair) in &self.pairs {
            let Some((start, _)) = liveness.ranges[result.index()] else {
                continue;
            };
            // Operands are used a half-step before the result is there.
            let at = start - 1;
            for value in pair.operands.iter().flatten() {
                if let Some((_, end)) = &mut liveness.ranges[value.index()] {
                    *end = at.max(*end);
                }
                let last = &mut liveness.last_use[value.index()];
                *last = at.max(*last);
            }
        }
        let absorbed = |value: &Value| self.absorbed[value.index()];
        for value in liveness.by_start.iter().filter(|value| absorbed(value)) {
            liveness.ranges[value.index()] = None;
        }
        liveness.by_start.retain(|value| !absorbed(value));
    }

    /// The pair that ends in this instruction.
    pub fn of(&self, inst: &Inst) -> Option<&Fused> {
        self.pairs.get(inst.results.first()?)
    }

    /// The instruction is performed with a later one.
    pub fn absorbs(&self, inst: &Inst) -> bool {
        inst.results
            .first()
            .is_some_and(|v| self.absorbed[v.index()])
    }

    /// The instruction is a sample at derivatives that it finds by itself.
    pub fn derives(&self, inst: &Inst) -> bool {
        of_sample(inst).is_some_and(|(_, slopes)| self.absorbed[slopes[0].index()])
    }

    /// Finds the pairs of a function.
    pub fn find(function: &Function, uniform: &[bool]) -> Fusion {
        let mut search = PairSearch {
            function,
            uniform,
            uses: vec![0; function.value_types.len()],
            fusion: Fusion {
                pairs: HashMap::default(),
                absorbed: vec![false; function.value_types.len()],
            },
        };
        (function.body).visit_operands(&mut |value| search.uses[value.index()] += 1);
        (function.body).visit_bodies(&mut |body| search.look_at(body));
        search.fusion
    }
}

/// A walk over a function that collects its pairs.
struct PairSearch<'f> {
    function: &'f Function,
    uniform: &'f [bool],
    uses: Vec<u32>,
    fusion: Fusion,
}

impl<'f> PairSearch<'f> {
    /// Pairs stand in one body.
    fn look_at(&mut self, body: &'f Body) {
        // Instructions since the last node of another kind, by their results.
        let mut run: HashMap<Value, (usize, &Inst)> = HashMap::default();
        for (at, node) in body.nodes.iter().enumerate() {
            let Node::Inst(inst) = node else {
                run.clear();
                continue;
            };
            // Across a suspension operands would have to be saved instead of the result.
            if inst.op.is_yield() || matches!(inst.op, Op::Call(_)) {
                run.clear();
            } else if matches!(inst.op, Op::Image(_)) {
                self.absorb_slopes(inst, at, &run);
            } else if let [result] = inst.results[..]
                && !self.uniform[result.index()]
                && !self.fuse(inst, result, at, &run)
                && self.uses[result.index()] == 1
            {
                run.insert(result, (at, inst));
            }
        }
    }

    /// Leaves the derivatives of a sample's own coordinates to the sample, if nothing else uses
    /// them.
    fn absorb_slopes(&mut self, inst: &Inst, at: usize, run: &HashMap<Value, (usize, &Inst)>) {
        let Some((coordinates, slopes)) = of_sample(inst) else {
            return;
        };
        let axes = [Op::DerivativeX, Op::DerivativeY];
        let all = slopes.iter().enumerate().all(|(k, slope)| {
            let coordinate = coordinates[k % coordinates.len()];
            run.get(slope).is_some_and(|&(first_at, first)| {
                first.op == axes[k / coordinates.len()]
                    && first.args[..] == [coordinate]
                    && self.function.ty(coordinate) == Type::F32
                    && at - first_at <= REACH
            })
        });
        if all {
            for slope in slopes {
                self.fusion.absorbed[slope.index()] = true;
            }
        }
    }

    /// Whether the instruction was made the second of a pair.
    fn fuse(
        &mut self,
        second: &Inst,
        result: Value,
        at: usize,
        run: &HashMap<Value, (usize, &Inst)>,
    ) -> bool {
        if second.args.len() > 2 {
            return false;
        }
        for (k, arg) in second.args.iter().enumerate() {
            let Some(&(first_at, first)) = run.get(arg) else {
                continue;
            };
            let ty = self.function.ty(*arg);
            let side = if k == 0 { Side::Left } else { Side::Right };
            let result_ty = self.function.ty(result);
            let gives_float = matches!(second.op, Op::UToF | Op::SToF);
            let types_fit = result_ty == ty || gives_float && result_ty == Type::F32;
            let takes_words = matches!(first.op, Op::UToF | Op::UConvert);
            let from_fits = (first.args.iter()).all(|&v| {
                self.function.ty(v) == ty || takes_words && self.function.ty(v) == Type::I32
            });
            if at - first_at > REACH
                || !types_fit
                || !from_fits
                || fused(TierKind::Portable, &first.op, &second.op, side, ty).is_none()
            {
                continue;
            }
            self.fusion.absorbed[arg.index()] = true;
            let pair = Fused {
                first: first.op,
                ty,
                side,
                operands: [
                    first.args.first().copied(),
                    first.args.get(1).copied(),
                    second.args.get(1 - k).copied(),
                ],
            };
            self.fusion.pairs.insert(result, pair);
            return true;
        }
        false
    }
}
