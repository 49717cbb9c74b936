//! The tree to linear code.
//!
//! Bodies become straight code with an *exit*: where control goes when no lane is active any more, which is the body's end. There the
//! enclosing construct takes up its pending or parked lanes.

use foldhash::HashMap;

mod body;
mod inst;
mod prologue;

use super::code::{Code, Remade};
use super::fusion::Fusion;
use super::machine::{Handler, Instr, Operand};
use super::slots::{Slots, allocate};
use super::tier::{Kernel, Portable, Tier};
use super::uniformity::find_uniform_values;
use super::yields;
use crate::Error;
use crate::error::ErrorKind;
use crate::ir::{Body, Function, Inst, Label, Module, Node, Op, Value};
use crate::state::{IO_DATA_ROW, SiteKind, StateLayout};
use crate::tier::TierKind;

/// A code address that is not known yet.
#[derive(Clone, Copy)]
struct Target(usize);

/// Where a function's things lie; all of them absolute.
struct Placed {
    slots: Slots,
    fusion: Fusion,
    /// Vector rows of results, after the values'.
    results: Vec<Operand>,
    /// First private row of each variable, absolute.
    variables: Vec<usize>,
    mask_base: usize,
    /// State rows for live values start here, relative to the first such row.
    live_base: usize,
    /// Two vector rows for breaking cycles of copies.
    scratch: Operand,
    /// Values that are rows of the input record: a state holds them anyway.
    inputs: HashMap<Value, u32>,
    /// Call paths that lead here.
    contexts: u64,
}

/// What the emitter makes besides code.
pub(super) struct Emitted {
    pub code: Code,
    pub sites: Vec<SiteKind>,
    pub layout: StateLayout,
    /// First private row and their count.
    pub private: usize,
    pub private_rows: usize,
    /// Rows for live values.
    pub live_rows: usize,
}

struct Emitter<'m> {
    module: &'m Module,
    tier: TierKind,
    code: Code,
    sites: Vec<SiteKind>,
    placed: Vec<Option<Placed>>,
    /// Operand of each value, by function.
    operands: Vec<Vec<Operand>>,
    uniform: Vec<Vec<bool>>,
    targets: Vec<u32>,
    /// Instructions whose `y` is a target.
    jumps: Vec<usize>,
    /// Entry of each function.
    entries: Vec<Target>,
    constants: HashMap<(u64, bool), Operand>,
    layout: StateLayout,
    private_rows: usize,
    next_point: u64,
    /// First state row of live values.
    live: usize,
    live_rows: usize,
    masks: usize,
    // The function that is being emitted.
    function: usize,
    position: u32,
    depth: usize,
    /// Parked mask and argument destinations of open labels.
    labels: HashMap<Label, (u32, Vec<Value>)>,
    /// How descriptors are made.
    remade: HashMap<Value, Remade>,
}

fn budget(message: &str) -> Error {
    Error {
        kind: ErrorKind::Budget,
        word_offset: None,
        message: message.to_owned(),
    }
}

/// Emits a module for a tier.
///
/// # Errors
/// Budget; operations on types that have none.
pub(super) fn emit(module: &Module, tier: TierKind) -> Result<Emitted, Error> {
    let count = module.functions.len();
    let mut e = Emitter {
        module,
        tier,
        code: Code::default(),
        sites: Vec::new(),
        placed: (0..count).map(|_| None).collect(),
        operands: vec![Vec::new(); count],
        uniform: vec![Vec::new(); count],
        targets: Vec::new(),
        jumps: Vec::new(),
        entries: Vec::new(),
        constants: HashMap::default(),
        layout: StateLayout::default(),
        private_rows: 0,
        next_point: 0,
        live: 0,
        live_rows: 0,
        masks: 0,
        function: 0,
        position: 0,
        depth: 0,
        labels: HashMap::default(),
        remade: HashMap::default(),
    };
    let order = call_order(module)?;
    e.place_functions(&order)?;
    e.lay_out_state();
    e.emit_prologue(&order)?;
    for &f in &order {
        e.emit_function(f)?;
    }
    e.patch();
    e.code.end_of_points = e.next_point as u32;
    e.layout.rows = e.live + e.live_rows;
    Ok(Emitted {
        code: e.code,
        sites: e.sites,
        layout: e.layout,
        private: e.live - e.private_rows,
        private_rows: e.private_rows,
        live_rows: e.live_rows,
    })
}

/// The nodes of a body and of the bodies in it, in order.
fn visit<'b>(body: &'b Body, f: &mut impl FnMut(&'b Node)) {
    for node in &body.nodes {
        f(node);
        match node {
            Node::Inst(_) => {}
            Node::Block { body, .. } | Node::Loop { body, .. } => visit(body, f),
            Node::If {
                then_body,
                else_body,
                ..
            } => {
                visit(then_body, f);
                visit(else_body, f);
            }
        }
    }
}

/// Functions that the entry reaches, callers before callees.
fn call_order(module: &Module) -> Result<Vec<usize>, Error> {
    let callees = |f: usize| {
        let mut callees = Vec::new();
        visit(&module.functions[f].body, &mut |node| {
            if let Node::Inst(Inst {
                op: Op::Call(callee),
                ..
            }) = node
            {
                callees.push(callee.index());
            }
        });
        callees
    };
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
                let next = callees(callee);
                stack.push((callee, next));
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

/// Deepest nesting of masks in a body.
fn mask_depth(body: &Body) -> usize {
    body.nodes
        .iter()
        .map(|node| match node {
            Node::Inst(_) => 0,
            Node::Block { body, .. } | Node::Loop { body, .. } => 1 + mask_depth(body),
            Node::If {
                then_body,
                else_body,
                ..
            } => 2 + mask_depth(then_body).max(mask_depth(else_body)),
        })
        .max()
        .unwrap_or(0)
}

impl<'m> Emitter<'m> {
    fn body_function(&self) -> &'m Function {
        &self.module.functions[self.function]
    }

    /// Rows, masks and private memory of each function: behind those of all its callers.
    fn place_functions(&mut self, order: &[usize]) -> Result<(), Error> {
        let count = self.module.functions.len();
        let (mut rows, mut private, mut masks) = (vec![0; count], vec![0; count], vec![0; count]);
        for &f in order {
            let function = &self.module.functions[f];
            let uniform = find_uniform_values(function);
            let fusion = Fusion::find(function, &uniform);
            let slots = allocate(function, &uniform, &fusion);
            let row_base = rows[f];
            let mut next = row_base + slots.rows as usize;
            let mut results = Vec::new();
            for ty in &function.results {
                results.push(Operand::vector(next));
                next += ty.rows() as usize;
            }
            let scratch = Operand::vector(next);
            next += 2;
            let mut private_next: usize = private[f];
            let mut variables = Vec::new();
            for variable in &function.variables {
                variables.push(private_next);
                private_next += variable.rows as usize;
            }
            let mask_end = masks[f] + 1 + mask_depth(&function.body);
            if private_next > 1 << 24 || next > 1 << 20 {
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
            let mut inputs = HashMap::default();
            visit(&function.body, &mut |node| {
                let Node::Inst(inst) = node else {
                    return;
                };
                match inst.op {
                    Op::Call(callee) => {
                        let g = callee.index();
                        rows[g] = next.max(rows[g]);
                        private[g] = private_next.max(private[g]);
                        masks[g] = mask_end.max(masks[g]);
                    }
                    Op::Input(row) => {
                        inputs.insert(inst.results[0], row);
                    }
                    _ => {}
                }
            });
            self.code.vector_rows = self.code.vector_rows.max(next);
            self.masks = self.masks.max(mask_end);
            self.private_rows = self.private_rows.max(private_next);
            self.uniform[f] = uniform;
            self.placed[f] = Some(Placed {
                slots,
                fusion,
                results,
                variables,
                mask_base: masks[f],
                live_base: 0,
                scratch,
                inputs,
                contexts: (f == 0) as u64,
            });
        }
        self.code.masks = self.masks;
        self.code.callers = vec![Vec::new(); count];
        self.entries = (0..count).map(|_| self.new_target()).collect();
        Ok(())
    }

    /// Everything but the live rows' number, which emission finds.
    fn lay_out_state(&mut self) {
        let control_words = yields::CONTROL_WORDS + self.masks.div_ceil(2);
        let mut io_rows = self.module.output_rows as usize;
        for function in &self.module.functions {
            visit(&function.body, &mut |node| {
                if let Node::Inst(inst) = node
                    && inst.op.is_yield()
                    && inst.op != Op::Barrier
                {
                    let words = inst.args.len().max(inst.results.len());
                    io_rows = io_rows.max(match inst.op {
                        Op::RayQueryProceed => 1,
                        _ => IO_DATA_ROW + words,
                    });
                }
            });
        }
        self.layout.inputs = control_words.div_ceil(16);
        self.layout.io = self.layout.inputs + self.module.inputs.len();
        self.live = self.layout.io + io_rows + self.private_rows;
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
            call.return_pc = targets[call.return_pc as usize];
        }
    }
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
