//! The tree to linear code.
//!
//! Bodies become straight code with an *exit*: where control goes when no lane is active any more,
//! which is the body's end. There the enclosing construct goes on with its pending or parked lanes.

use foldhash::HashMap;
use lanes::Tier as TierKind;

mod alike;
mod body;
mod inst;
mod loop_facts;
mod native;
mod prologue;
mod turns;
mod ways;

use super::code::{DescriptorSource, Remade, Saved};
use super::fusion::Fusion;
use super::machine::Code;
use super::machine::{Handler, Instr};
use super::operand::Operand;
use super::slots::{Slots, allocate};
use super::tier::{Kernel, Portable, Tier};
use crate::Error;
use crate::ir::{Function, Label, Module, Value};
use crate::native::Encoding;
use crate::plan::{self, FunctionPlan, Planned, budget, callees};

/// A code address that is not known yet.
#[derive(Clone, Copy)]
struct Target(usize);

/// Where a function's things lie; all of them absolute.
struct Placed {
    slots: Slots,
    fusion: Fusion,
    /// By value, with pairs: as [`Liveness`](crate::plan::Liveness) has them.
    ranges: Vec<Option<(u32, u32)>>,
    /// Vector rows of results, after the values'.
    results: Vec<Operand>,
    /// Two vector rows for breaking cycles of copies.
    scratch: Operand,
}

struct Emitter<'m> {
    planned: &'m Planned<'m>,
    module: &'m Module,
    tier: TierKind,
    code: Code,
    placed: Vec<Option<Placed>>,
    /// `None` where all is interpreted.
    native: Option<native::Native<'m>>,
    /// Operand of each value, by function.
    operands: Vec<Vec<Operand>>,
    targets: Vec<u32>,
    /// Instructions whose `y` is a target.
    jumps: Vec<usize>,
    /// Entry of each function.
    entries: Vec<Target>,
    constants: HashMap<(u64, bool), Operand>,
    /// Number in the code of each function's tables.
    tables: HashMap<(usize, u32), u32>,
    // The function that is being emitted.
    function: usize,
    /// The next mask.
    masks: usize,
    /// Parked mask and argument destinations of open labels.
    labels: HashMap<Label, (u32, Vec<Value>)>,
}

/// Emits a module for a tier, whose native code is in this encoding; `None`: all is interpreted.
///
/// # Errors
/// Budget; operations on types that have none.
pub(crate) fn emit(
    planned: &Planned<'_>,
    tier: TierKind,
    encoding: Option<Encoding>,
) -> Result<Code, Error> {
    if encoding.is_some()
        && let Some(code) = emit_as(planned, tier, encoding)?
    {
        return Ok(code);
    }
    emit_as(planned, tier, None).map(|code| code.expect("needs no executable memory"))
}

/// Emits a module with native code, or without. `None`: the system refused memory for native code.
fn emit_as(
    planned: &Planned<'_>,
    tier: TierKind,
    encoding: Option<Encoding>,
) -> Result<Option<Code>, Error> {
    let module = planned.module;
    let count = module.functions.len();
    let mut e = Emitter {
        planned,
        module,
        tier,
        code: Code::default(),
        placed: (0..count).map(|_| None).collect(),
        native: encoding.map(native::Native::new),
        operands: vec![Vec::new(); count],
        targets: Vec::new(),
        jumps: Vec::new(),
        entries: Vec::new(),
        constants: HashMap::default(),
        tables: HashMap::default(),
        function: 0,
        masks: 0,
        labels: HashMap::default(),
    };
    e.place_functions()?;
    e.emit_prologue()?;
    for &f in &planned.order {
        e.emit_function(f)?;
    }
    e.place_kept();
    // Odd, so that a row's places in the frames of a wave fall to different sets of the cache.
    e.code.vector_rows |= 1;
    e.patch();
    Ok(e.finish_native().then_some(e.code))
}

impl<'m> Emitter<'m> {
    fn body_function(&self) -> &'m Function {
        &self.module.functions[self.function]
    }

    /// Rows of each function: behind those of all its callers.
    fn place_functions(&mut self) -> Result<(), Error> {
        let count = self.module.functions.len();
        let mut rows = vec![0; count];
        for &f in &self.planned.order {
            let function = &self.module.functions[f];
            let planned = self.planned.function(f);
            let fusion = Fusion::find(function, &planned.uniform);
            let mut liveness = planned.liveness.clone();
            fusion.stretch(&mut liveness);
            debug_assert!(
                self.planned.agrees(f, &liveness),
                "pairs across a save point"
            );
            let slots = allocate(function, &liveness);
            let row_base = rows[f];
            let mut next = row_base + slots.rows as usize;
            let mut results = Vec::new();
            for ty in &function.results {
                results.push(Operand::vector(next));
                next += ty.rows() as usize;
            }
            let scratch = Operand::vector(next);
            next += 2;
            if next > 1 << 20 {
                return Err(budget("too much per-lane memory"));
            }
            self.operands[f] = slots
                .row
                .iter()
                .map(|&row| match row {
                    u32::MAX => Operand::NONE,
                    row => Operand::vector(row_base + row as usize),
                })
                .collect();
            for g in callees(function) {
                rows[g] = next.max(rows[g]);
            }
            self.code.vector_rows = self.code.vector_rows.max(next);
            self.placed[f] = Some(Placed {
                slots,
                fusion,
                ranges: liveness.ranges,
                results,
                scratch,
            });
        }
        self.entries = (0..count).map(|_| self.new_target()).collect();
        Ok(())
    }

    /// The plan of the function that is being emitted.
    fn plan(&self) -> &'m FunctionPlan {
        self.planned.function(self.function)
    }

    fn placed(&self) -> &Placed {
        self.placed[self.function].as_ref().expect("placed")
    }

    fn new_target(&mut self) -> Target {
        self.targets.push(u32::MAX);
        Target(self.targets.len() - 1)
    }

    fn bind(&mut self, target: Target) {
        self.targets[target.0] = self.code.instrs.len() as u32;
    }

    fn push(&mut self, instr: Instr) {
        self.code.instrs.push(instr);
    }

    /// A kernel in the program's tier.
    fn kernel<K: Kernel>(&self) -> Handler {
        match self.tier {
            TierKind::Portable => Portable::handler::<K>(),
            #[cfg(target_arch = "x86_64")]
            TierKind::Avx2 => super::tier::Avx2::handler::<K>(),
            #[cfg(target_arch = "x86_64")]
            TierKind::Avx512 => super::tier::Avx512::handler::<K>(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => Portable::handler::<K>(),
        }
    }

    /// The operands of what the plan keeps.
    fn place_kept(&mut self) {
        let planned = self.planned;
        let kept = &planned.plan.kept;
        let (mut values, mut descriptors) = (0, 0);
        let mut bindings = HashMap::default();
        for &f in &planned.order {
            self.function = f;
            let (values_end, descriptors_end) = planned.function(f).kept_ends;
            for saved in &kept.values.entries()[values..values_end] {
                let operand = self.operand(saved.value);
                self.code.saved.push(Saved {
                    operand,
                    row: saved.row,
                    wide: saved.wide,
                });
            }
            for remade in &kept.descriptors.entries()[descriptors..descriptors_end] {
                let source = match remade.source {
                    plan::DescriptorSource::Binding(binding) => {
                        let all = &mut self.code.bindings;
                        let number = bindings.entry((f, remade.value)).or_insert_with(|| {
                            all.push(binding);
                            all.len() as u32 - 1
                        });
                        DescriptorSource::Binding(*number)
                    }
                    plan::DescriptorSource::Reference => DescriptorSource::Reference,
                };
                let (to, from) = (self.operand(remade.value), self.operand(remade.from));
                self.code.remade.push(Remade { to, source, from });
            }
            (values, descriptors) = (values_end, descriptors_end);
        }
    }

    fn operand(&self, value: Value) -> Operand {
        self.operands[self.function][value.index()]
    }

    fn list(&mut self, values: &[Value]) -> u32 {
        let first = self.code.operands.len() as u32;
        let operands: Vec<_> = values.iter().map(|&v| self.operand(v)).collect();
        self.code.operands.extend(operands);
        first
    }

    /// Code addresses instead of target numbers.
    fn patch(&mut self) {
        let targets = &self.targets;
        for &jump in &self.jumps {
            let instr = &mut self.code.instrs[jump];
            instr.y = targets[instr.y as usize];
        }
        for point in &mut self.code.points {
            point.pc = targets[point.pc as usize];
        }
        for call in &mut self.code.calls {
            call.pc = targets[call.pc as usize];
        }
    }
}

/// A copy of one row, or of the two of a 64-bit value.
#[derive(Clone, Copy)]
struct Move {
    to: Operand,
    from: Operand,
    /// The copied value; `None` for copies from and to the scratch row.
    value: Option<Value>,
    wide: bool,
    /// In active lanes alone.
    masked: bool,
}

/// An instruction with nothing but its handler.
fn instr(handler: Handler) -> Instr {
    Instr {
        handler,
        d: Operand::NONE,
        a: Operand::NONE,
        b: Operand::NONE,
        c: Operand::NONE,
        x: 0,
        y: 0,
    }
}
