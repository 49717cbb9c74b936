//! Facts about a program that every tier needs, from the IR alone.
//!
//! ```text
//! ir ──> uniformity ──> liveness ──> state layout ──> save points
//! ```
//!
//! ** [`uniformity`]: values computed once for a dispatch; [`liveness`]: live ranges; [`coalesce`]:
//!   values that may share a row;
//! ** [`save_points`]: points at which a subgroup can be suspended, and the contents of its state;
//!   [`state`]: initial states, and moves of lanes between states.
//!
//! Any tier can resume a state of any other, because the plan defines ids, masks and rows. No tier
//! may fuse instructions across a save point, back-edges included.

mod coalesce;
mod live_lists;
mod live_rows;
mod liveness;
mod save_points;
mod state;
#[cfg(test)]
mod tests;
mod uniformity;

pub(crate) use coalesce::{Candidate, candidates};
pub(crate) use live_lists::List;
pub(crate) use liveness::Liveness;
pub(crate) use save_points::{Answer, CallSite, DescriptorSource, Kept, Live, SavePoint, Site};
pub(crate) use state::{CONTROL_WORDS, HeldOperands};

use crate::Error;
use crate::error::ErrorKind;
use crate::ir::op::SubgroupOp;
use crate::ir::{Body, Function, Module, Node, Op, Step, Value};
use crate::state::{SiteKind, StateLayout};

/// The plan of a program, for every tier.
#[derive(Debug, PartialEq)]
pub(crate) struct Plan {
    pub layout: StateLayout,
    /// `io` rows of the outputs: the first ones.
    output_rows: usize,
    /// First row of emitted vertices, and rows for each of their words: one more than vertices, for
    /// those past the last.
    pub emitted: usize,
    pub emitted_slots: usize,
    /// First private row of the state, and their count.
    pub private: usize,
    pub private_rows: usize,
    /// Rows of the state for live values: the last ones.
    pub live_rows: usize,
    /// Parked and pending masks.
    pub masks: usize,
    /// By [`SiteId`](crate::state::SiteId).
    pub sites: Vec<SiteKind>,
    /// The values that live across points and calls.
    pub kept: Kept,
    /// In the order of functions, and of the text in each.
    pub points: Vec<SavePoint>,
    /// Id of each point for call path 0; path `c` is `base + c`. Ascending.
    pub bases: Vec<u32>,
    /// In the same order.
    pub calls: Vec<CallSite>,
    /// By function: its call sites, ascending by `context`.
    callers: Vec<Vec<u32>>,
    end_of_points: u32,
}

/// The plan of a function, for emitters.
#[derive(Debug, PartialEq)]
pub(crate) struct FunctionPlan {
    /// By value: whether it is uniform in the dispatch.
    pub uniform: Vec<bool>,
    pub liveness: Liveness,
    /// First private row of each variable.
    pub variables: Vec<usize>,
    /// The function's first mask, that of its return.
    pub mask_base: usize,
    /// The start of the function's state rows for live values, relative to the first such row.
    live_base: usize,
    /// The ends of its values and of its descriptors in [`Kept`]; they begin where those of the
    /// function before end.
    pub kept_ends: (usize, usize),
    /// Number of call paths to the function.
    contexts: u64,
}

/// A module with its plan.
pub(crate) struct Planned<'m> {
    pub module: &'m Module,
    /// Functions that the entry reaches, callers before callees: what is emitted, in this order.
    pub order: Vec<usize>,
    /// By function; `None` for unreached ones.
    pub functions: Vec<Option<FunctionPlan>>,
    pub plan: Plan,
}

/// Plans a verified, optimised module.
///
/// # Errors
/// Budget.
pub(crate) fn plan(module: &Module) -> Result<Planned<'_>, Error> {
    let order = call_order(module)?;
    let mut planned = Planned {
        module,
        functions: (0..module.functions.len()).map(|_| None).collect(),
        plan: Plan {
            layout: StateLayout::default(),
            output_rows: module.output_rows as usize,
            emitted: 0,
            emitted_slots: 0,
            private: 0,
            private_rows: 0,
            live_rows: 0,
            masks: 0,
            sites: Vec::new(),
            kept: Kept::default(),
            points: Vec::new(),
            bases: Vec::new(),
            calls: Vec::new(),
            callers: vec![Vec::new(); module.functions.len()],
            end_of_points: 0,
        },
        order,
    };
    planned.place_functions()?;
    planned.lay_out_state();
    save_points::find(&mut planned)?;
    let plan = &mut planned.plan;
    plan.layout.rows = plan.private + plan.private_rows + plan.live_rows;
    Ok(planned)
}

impl Planned<'_> {
    /// A reached function.
    pub fn function(&self, f: usize) -> &FunctionPlan {
        self.functions[f].as_ref().expect("reached")
    }

    /// Whether a tier's own live ranges of a function have the same live values at every save
    /// point.
    pub fn agrees(&self, f: usize, liveness: &Liveness) -> bool {
        let planned = &self.function(f).liveness;
        let points = (self.plan.points.iter()).filter(|point| point.function as usize == f);
        let places = points.map(|point| match point.position {
            0 => Liveness::START,
            at => Liveness::across(at),
        });
        let places: Vec<_> = places.collect();
        (0..planned.ranges.len() as u32).map(Value).all(|value| {
            let [planned, other] =
                [planned, liveness].map(|liveness| liveness.places(value, &places));
            planned == other || planned.is_empty() && other.is_empty()
        })
    }

    /// Assigns masks and private memory of each function, after those of all its callers.
    fn place_functions(&mut self) -> Result<(), Error> {
        let count = self.module.functions.len();
        let (mut private, mut masks) = (vec![0; count], vec![0; count]);
        for &f in &self.order {
            let function = &self.module.functions[f];
            // Draws share an environment until the next barrier, but an interlock orders fragments
            // without a barrier.
            let fragment = self.module.fragment;
            let interlock = fragment.and_then(|fragment| fragment.interlock);
            let starts = f == 0 && interlock.is_none();
            let uniform = uniformity::find_uniform_values(function, starts);
            let mut private_next: usize = private[f];
            let mut variables = Vec::new();
            for variable in &function.variables {
                variables.push(private_next);
                private_next += variable.rows as usize;
            }
            if private_next > 1 << 24 {
                return Err(budget("too much per-lane memory"));
            }
            let mask_end = masks[f] + 1 + mask_depth(&function.body);
            for g in callees(function) {
                private[g] = private_next.max(private[g]);
                masks[g] = mask_end.max(masks[g]);
            }
            self.plan.masks = self.plan.masks.max(mask_end);
            self.plan.private_rows = self.plan.private_rows.max(private_next);
            self.functions[f] = Some(FunctionPlan {
                liveness: Liveness::of(function, &uniform),
                uniform,
                variables,
                mask_base: masks[f],
                live_base: 0,
                kept_ends: (0, 0),
                contexts: (f == 0) as u64,
            });
        }
        Ok(())
    }

    /// Everything but the rows for live values.
    fn lay_out_state(&mut self) {
        let module = self.module;
        let mut io_rows = module.output_rows as usize;
        for function in &module.functions {
            function.body.visit_insts(&mut |inst| {
                if inst.op.is_yield() {
                    io_rows = io_rows.max(Site::of(inst).io_rows(inst));
                }
            });
        }
        let plan = &mut self.plan;
        let control_words = CONTROL_WORDS + plan.masks.div_ceil(2);
        plan.layout.inputs = control_words.div_ceil(16);
        plan.layout.io = plan.layout.inputs + module.inputs.len();
        plan.emitted = plan.layout.io + io_rows;
        plan.emitted_slots = match &module.geometry {
            Some(facts) => facts.max_vertices as usize + 1,
            None => 0,
        };
        plan.private = plan.emitted + plan.emitted_slots * (module.outputs.len() + 1);
    }
}

/// Whether helper invocations take part in a subgroup operation like all other lanes.
pub(crate) fn takes_helpers(module: &Module, op: SubgroupOp) -> bool {
    let full_quads = module.fragment.as_ref().is_some_and(|f| f.full_quads);
    op == SubgroupOp::QuadShuffle || full_quads
}

pub(crate) fn budget(message: &str) -> Error {
    Error {
        kind: ErrorKind::Budget,
        word_offset: None,
        message: message.to_owned(),
    }
}

/// The functions that a function calls, once for each call.
pub(crate) fn callees(function: &Function) -> Vec<usize> {
    let mut callees = Vec::new();
    function.body.visit_insts(&mut |inst| {
        if let Op::Call(callee) = inst.op {
            callees.push(callee.index());
        }
    });
    callees
}

/// Functions that the entry reaches, callers before callees.
fn call_order(module: &Module) -> Result<Vec<usize>, Error> {
    let callees = |f: usize| callees(&module.functions[f]);
    // Depth first without native recursion: 1 open, 2 done.
    let mut state = vec![0u8; module.functions.len()];
    let mut order = Vec::new();
    let mut stack = vec![(0usize, callees(0))];
    state[0] = 1;
    while let Some((f, rest)) = stack.last_mut() {
        match rest.pop() {
            None => {
                state[*f] = 2;
                order.push(*f);
                stack.pop();
            }
            Some(callee) if state[callee] == 0 => {
                state[callee] = 1;
                stack.push((callee, callees(callee)));
            }
            Some(callee) if state[callee] == 1 => {
                return Err(Error::invalid(0, "recursive call"));
            }
            Some(_) => {}
        }
    }
    order.reverse();
    Ok(order)
}

/// The deepest nesting of masks in a body.
fn mask_depth(body: &Body) -> usize {
    let (mut depth, mut deepest) = (0, 0);
    for step in body.steps() {
        match step {
            Step::Open(node) => {
                depth += masks_of(node);
                deepest = deepest.max(depth);
            }
            Step::Close(node) => depth -= masks_of(node),
            _ => {}
        }
    }
    deepest
}

/// The number of masks of a construct: one for the lanes that wait at its label; an `if` has
/// another for the lanes of its second body.
pub(crate) fn masks_of(node: &Node) -> usize {
    match node {
        Node::Inst(_) => 0,
        Node::Block { .. } | Node::Loop { .. } => 1,
        Node::If { .. } => 2,
    }
}
