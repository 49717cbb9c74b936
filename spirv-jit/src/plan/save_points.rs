//! The points at which a subgroup can be suspended: yields, and back-edges and function starts when
//! fuel runs out. And the contents of its state there.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use foldhash::HashMap;

use super::live_lists::{Changing, List, Lists};
use super::live_rows::LiveRows;
use super::liveness::{HalfSteps, Liveness};
use super::{Planned, budget, masks_of};
use crate::Error;
use crate::ir::op::DescriptorBinding;
use crate::ir::{Body, Inst, Node, Op, Step, Type, Value};
use crate::state::{IO_DATA_ROW, SiteId, SiteKind};

/// A value in a state, with its row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Saved {
    pub value: Value,
    /// Row of the state.
    pub row: u32,
    /// 64 bits: two rows of the state.
    pub wide: bool,
}

/// The origin of descriptors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum DescriptorSource {
    /// Of an index, in a binding of the program's.
    Binding(DescriptorBinding),
    /// Of a reference.
    Reference,
}

/// A descriptor that is recomputed instead of saved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Remade {
    pub value: Value,
    pub source: DescriptorSource,
    /// A saved or uniform value.
    pub from: Value,
}

/// The values that live across a save point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Live {
    /// Of [`Kept::values`].
    pub saved: List,
    /// Of [`Kept::values`], too: values that are rows of the input record, so a state holds them
    /// anyway.
    pub inputs: List,
    /// Of [`Kept::descriptors`].
    pub remade: List,
}

impl Live {
    pub const NOTHING: Live = Live {
        saved: List::EMPTY,
        inputs: List::EMPTY,
        remade: List::EMPTY,
    };
}

/// The values that live across all save points, function by function.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Kept {
    pub values: Lists<Saved>,
    pub descriptors: Lists<Remade>,
}

/// A save point.
#[derive(Debug, PartialEq)]
pub(crate) struct SavePoint {
    pub function: u32,
    /// Position in the function as in [`Liveness`](super::Liveness); 0 at its start.
    pub position: u32,
    /// Parked and pending masks that are in use, from the program's first.
    pub masks: u32,
    pub live: Live,
    /// The event; `None` for the entry, back-edges and function starts.
    pub site: Option<SiteId>,
    /// Word offset of the SPIR-V instruction at or near this point; 0 if unknown.
    pub source: u32,
}

/// A call: its part of a call path's number, and the values that its function needs afterwards.
#[derive(Debug, PartialEq)]
pub(crate) struct CallSite {
    pub caller: u32,
    pub callee: u32,
    /// Added to the caller's path number to give the callee's.
    pub context: u32,
    pub live: Live,
}

/// The form of a yield's results in the `io` rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Answer {
    /// One word for each result, from this row.
    Rows(usize),
    /// Row 0 is a verdict (see [`SiteKind::ReportIntersection`]).
    Verdict,
}

/// The operands of a yielding instruction.
pub(crate) struct Site {
    pub kind: SiteKind,
    /// The number of operands in rows from 0; the others start at [`IO_DATA_ROW`].
    pub fixed: usize,
    pub answer: Answer,
}

impl Site {
    /// Of a yield.
    pub fn of(inst: &Inst) -> Site {
        let payload_words = inst.results.len() as u32;
        let data = Answer::Rows(IO_DATA_ROW);
        let (fixed, kind, answer) = match inst.op {
            Op::TraceRay(trace) => {
                let payload_words = (inst.args.len() - trace.words()) as u32;
                let kind = SiteKind::TraceRay {
                    trace,
                    payload_words,
                };
                let answer = if trace.to_hit_object {
                    Answer::Rows(0)
                } else {
                    data
                };
                (trace.words(), kind, answer)
            }
            Op::HitObjectExecute => (16, SiteKind::HitObjectExecute { payload_words }, data),
            Op::HitObjectGet(fact) => (9, SiteKind::HitObjectGet { fact }, Answer::Rows(0)),
            Op::ExecuteCallable => {
                let data_words = payload_words;
                (1, SiteKind::ExecuteCallable { data_words }, data)
            }
            Op::ReportIntersection => {
                let attribute_words = inst.args.len().saturating_sub(2) as u32;
                let kind = SiteKind::ReportIntersection { attribute_words };
                (2, kind, Answer::Verdict)
            }
            Op::RayQueryProceed => (1, SiteKind::RayQueryProceed, Answer::Verdict),
            Op::ReorderThread => (4, SiteKind::ReorderThread, data),
            Op::BarrierArrive => (0, SiteKind::BarrierArrive, data),
            Op::BarrierWait => (0, SiteKind::BarrierWait, data),
            _ => (0, SiteKind::Barrier, data),
        };
        Site {
            kind,
            fixed,
            answer,
        }
    }

    /// Rows of `io` that the yield needs.
    pub fn io_rows(&self, inst: &Inst) -> usize {
        match self.kind {
            SiteKind::Barrier | SiteKind::BarrierArrive | SiteKind::BarrierWait => 0,
            SiteKind::RayQueryProceed => 1,
            _ => IO_DATA_ROW + inst.args.len().max(inst.results.len()),
        }
    }
}

/// The source of a body's first instruction.
fn first_source(body: &Body) -> Option<u32> {
    body.steps().find_map(|step| match step {
        Step::Inst(inst) => (inst.source != 0).then_some(inst.source),
        _ => None,
    })
}

/// Finds the save points and call sites of all functions, after their state layout.
pub(super) fn find(planned: &mut Planned<'_>) -> Result<(), Error> {
    let mut next_point = 0;
    for f in planned.order.clone() {
        let function = &planned.module.functions[f];
        let mut builder = SavePointBuilder {
            masks: planned.function(f).mask_base + 1,
            planned,
            function: f,
            next_point,
            position: 1,
            source: first_source(&function.body).unwrap_or(0),
            sources: HashMap::default(),
            inputs: HashMap::default(),
            living: Living::default(),
        };
        // Each function uses fuel at its start, except the entry, where states begin.
        let live = match f {
            0 => Live::NOTHING,
            _ => builder.live(Liveness::START)?,
        };
        builder.point(0, None, live)?;
        builder.body(&function.body)?;
        next_point = builder.next_point;
        let kept = &planned.plan.kept;
        let ends = (
            kept.values.entries().len(),
            kept.descriptors.entries().len(),
        );
        planned.functions[f].as_mut().expect("reached").kept_ends = ends;
    }
    planned.plan.end_of_points = next_point as u32;
    Ok(())
}

struct SavePointBuilder<'p, 'm> {
    planned: &'p mut Planned<'m>,
    function: usize,
    next_point: u64,
    /// Masks that are in use.
    masks: usize,
    position: u32,
    /// Word offset of the last visited SPIR-V instruction.
    source: u32,
    /// The operands of descriptors.
    sources: HashMap<Value, (DescriptorSource, Value)>,
    /// Values that are rows of the input record: a state holds them anyway.
    inputs: HashMap<Value, u32>,
    living: Living,
}

/// The live values at the last visited save point.
#[derive(Default)]
struct Living {
    /// The number of values, in the order of their starts, that have begun.
    begun: usize,
    /// The live values, by the half-steps of their ends.
    ends: BinaryHeap<Reverse<(u32, Value, ListEntry)>>,
    rows: LiveRows,
    /// The values without a row of their own.
    input_slots: LiveRows,
    descriptor_slots: LiveRows,
    saved: Changing<Saved>,
    inputs: Changing<Saved>,
    remade: Changing<Remade>,
}

/// The index of a value in its list.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ListEntry {
    Saved(u32),
    Input(u32),
    Remade(u32),
}

impl SavePointBuilder<'_, '_> {
    fn body(&mut self, body: &Body) -> Result<(), Error> {
        let mut steps = body.steps();
        while let Some(step) = steps.next() {
            match step {
                Step::Inst(inst) => self.inst(inst, self.position)?,
                Step::Open(node) => self.masks += masks_of(node),
                Step::Else(_) | Step::End(_) => {}
                Step::Close(node) => {
                    if let Node::Loop { body, .. } = node {
                        let live = self.live(Liveness::across(self.position))?;
                        // A loop's save point is its start.
                        self.source = first_source(body).unwrap_or(self.source);
                        self.point(self.position, None, live)?;
                        steps.skip_rest();
                    }
                    self.masks -= masks_of(node);
                }
            }
            self.position += 1;
        }
        Ok(())
    }

    fn inst(&mut self, inst: &Inst, position: u32) -> Result<(), Error> {
        if inst.source != 0 {
            self.source = inst.source;
        }
        match inst.op {
            Op::Call(callee) => return self.call(callee.index(), position),
            Op::Input(row) => {
                self.inputs.insert(inst.results[0], row);
            }
            Op::Descriptor(binding) => {
                let source = DescriptorSource::Binding(binding);
                self.sources.insert(inst.results[0], (source, inst.args[0]));
            }
            Op::DescriptorAt => {
                let source = DescriptorSource::Reference;
                self.sources.insert(inst.results[0], (source, inst.args[0]));
            }
            ref op if op.is_yield() => {
                let site = SiteId(self.planned.plan.sites.len() as u32);
                self.planned.plan.sites.push(Site::of(inst).kind);
                let live = self.live(Liveness::across(position))?;
                self.point(position, Some(site), live)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn call(&mut self, callee: usize, position: u32) -> Result<(), Error> {
        // Any function may be suspended at its start.
        let live = self.live(Liveness::across(position))?;
        let plan = self.planned.function(self.function);
        let live_base = plan.live_base + self.living.rows.end() as usize;
        let contexts = plan.contexts;
        let called = (self.planned.functions[callee].as_mut()).expect("reached");
        called.live_base = called.live_base.max(live_base);
        let context = called.contexts;
        called.contexts += contexts;
        if called.contexts > u32::MAX as u64 {
            return Err(budget("too many call paths"));
        }
        let plan = &mut self.planned.plan;
        plan.callers[callee].push(plan.calls.len() as u32);
        plan.calls.push(CallSite {
            caller: self.function as u32,
            callee: callee as u32,
            context: context as u32,
            live,
        });
        Ok(())
    }

    /// The live values at a save point after the last one. Each keeps its row while it lives.
    fn live(&mut self, place: HalfSteps) -> Result<Live, Error> {
        self.end_values(place);
        self.begin_values(place)?;
        let plan = &mut self.planned.plan;
        let base = self.planned.functions[self.function]
            .as_ref()
            .expect("reached")
            .live_base;
        plan.live_rows = plan.live_rows.max(base + self.living.rows.end() as usize);
        let (living, kept) = (&mut self.living, &mut plan.kept);
        Ok(Live {
            saved: living.saved.list(&mut kept.values),
            inputs: living.inputs.list(&mut kept.values),
            remade: living.remade.list(&mut kept.descriptors),
        })
    }

    /// Frees the slots of values that are dead at a save point.
    fn end_values(&mut self, place: HalfSteps) {
        let function = &self.planned.module.functions[self.function];
        let living = &mut self.living;
        while let Some(&Reverse((end, value, slot))) = living.ends.peek()
            && end <= place.after
        {
            living.ends.pop();
            match slot {
                ListEntry::Saved(row) => {
                    living.rows.release(row, function.ty(value).rows() == 2);
                    living.saved.set(row as usize, None);
                }
                ListEntry::Input(slot) => {
                    living.input_slots.release(slot, false);
                    living.inputs.set(slot as usize, None);
                }
                ListEntry::Remade(slot) => {
                    living.descriptor_slots.release(slot, false);
                    living.remade.set(slot as usize, None);
                }
            }
        }
    }

    /// Assigns slots to values that have begun since the last save point and live at this one.
    fn begin_values(&mut self, place: HalfSteps) -> Result<(), Error> {
        let function = &self.planned.module.functions[self.function];
        let plan = &self.planned.plan;
        let planned = self.planned.function(self.function);
        let first = plan.private + plan.private_rows + planned.live_base;
        let living = &mut self.living;
        while let Some(&value) = planned.liveness.by_start.get(living.begun) {
            let (start, end) = planned.liveness.ranges[value.index()].unwrap_or_default();
            if start > place.before {
                break;
            }
            living.begun += 1;
            if end <= place.after {
                continue;
            }
            let slot = if function.ty(value) == Type::Descriptor {
                let Some(&(source, from)) = self.sources.get(&value) else {
                    return Err(Error::invalid(0, "a descriptor made of nothing"));
                };
                let slot = living.descriptor_slots.take(false);
                let remade = Remade {
                    value,
                    source,
                    from,
                };
                living.remade.set(slot as usize, Some(remade));
                ListEntry::Remade(slot)
            } else {
                let wide = function.ty(value).rows() == 2;
                let saved = |row| Saved { value, row, wide };
                match self.inputs.get(&value) {
                    Some(&input) => {
                        let slot = living.input_slots.take(false);
                        let row = plan.layout.inputs as u32 + input;
                        living.inputs.set(slot as usize, Some(saved(row)));
                        ListEntry::Input(slot)
                    }
                    None => {
                        let row = living.rows.take(wide);
                        let saved = saved(first as u32 + row);
                        living.saved.set(row as usize, Some(saved));
                        ListEntry::Saved(row)
                    }
                }
            };
            living.ends.push(Reverse((end, value, slot)));
        }
        Ok(())
    }

    fn point(&mut self, position: u32, site: Option<SiteId>, live: Live) -> Result<(), Error> {
        let base = self.next_point;
        self.next_point += self.planned.function(self.function).contexts;
        if self.next_point > u32::MAX as u64 {
            return Err(budget("too many call paths"));
        }
        self.planned.plan.bases.push(base as u32);
        self.planned.plan.points.push(SavePoint {
            function: self.function as u32,
            position,
            masks: self.masks as u32,
            live,
            site,
            source: self.source,
        });
        Ok(())
    }
}
