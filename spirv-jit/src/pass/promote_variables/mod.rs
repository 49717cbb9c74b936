//! Promotes variables to values: fixed rows of variables without a taken address become SSA values,
//! which arguments of `br` and loop parameters pass on. A row that was never stored reads as zero.

mod cells;
mod liveness;

pub(super) use self::cells::one_type;

use smallvec::{SmallVec, smallvec};

use self::cells::{Cells, Promotion, find_cells};
use self::liveness::{Candidates, find_candidates};
use super::edit::{Edit, Fate, edit_body};
use super::substitution::Substitution;
use crate::ir::{Body, Function, Inst, Node, Op, Terminator, Type, Value};

/// Limit of bodies times cells. Above it a function's variables stay in memory.
const BUDGET: usize = 1 << 32;

/// Promotes all possible rows.
pub fn promote_variables(function: &mut Function) {
    let cells = find_cells(function);
    if cells.types.is_empty() || cells.types.len() * (function.labels as usize + 1) > BUDGET {
        return;
    }
    let candidates = find_candidates(&function.body, function.labels, &cells);
    let mut body = std::mem::take(&mut function.body);
    let mut promoter = Promoter {
        substitution: Substitution::identity(function),
        current: vec![None; cells.types.len()],
        log: Vec::new(),
        begins: Vec::new(),
        around: vec![0; cells.types.len()],
        handed_on: vec![Vec::new(); candidates.len()],
        zeros: [None; 8],
        next_access: 0,
        function,
        cells,
        candidates,
    };
    edit_body(&mut body, &mut promoter);
    promoter.define_zeros(&mut body);
    promoter.function.body = body;
}

struct Promoter<'a> {
    function: &'a mut Function,
    cells: Cells,
    candidates: Vec<Candidates>,
    substitution: Substitution,
    /// The current value of each cell; `None` is zero.
    current: Vec<Option<Value>>,
    /// Former contents of `current`, to be restored at the end of a construct.
    log: Vec<(u32, Option<Value>)>,
    /// Length of the log where each open construct begins.
    begins: Vec<usize>,
    /// The number of enclosing loops that have the cell as a parameter.
    around: Vec<u32>,
    /// Cells that a `br` to the label passes on.
    handed_on: Vec<Vec<u32>>,
    /// The zero constant of each type, created on demand.
    zeros: [Option<Value>; 8],
    next_access: usize,
}

impl Edit for Promoter<'_> {
    fn inst(&mut self, inst: &mut Inst, before: &mut Vec<Node>) -> bool {
        if matches!(inst.op, Op::VarLoad(..) | Op::VarStore(..)) {
            return self.promote_access(inst, before);
        }
        self.substitution.resolve_all(&mut inst.args);
        true
    }

    fn open(&mut self, construct: &mut Node) {
        self.substitution.resolve_all(construct.operands_mut());
        let Some(label) = construct.label() else {
            return;
        };
        self.hand_on(label.index());
        self.begins.push(self.log.len());
        if let Node::Loop { params, init, .. } = construct {
            self.enter_loop(label.index(), params, init);
        }
    }

    /// Stores of a body end with it.
    fn end(&mut self, body: &mut Body) {
        self.substitution.resolve_terminator(&mut body.end);
        if let Terminator::Br(label, args) = &mut body.end {
            for index in 0..self.handed_on[label.index()].len() {
                let cell = self.handed_on[label.index()][index];
                args.push(self.content(cell));
            }
        }
        if let Some(&begin) = self.begins.last() {
            self.go_back(begin);
        }
    }

    fn close(&mut self, construct: &mut Node, _: &mut Vec<Node>) -> Fate {
        self.begins.pop();
        match construct {
            Node::Inst(_) => {}
            Node::Block { label, results, .. } | Node::If { label, results, .. } => {
                self.take_results(label.index(), results);
            }
            Node::Loop { label, .. } => self.leave_loop(label.index()),
        }
        Fate::Stays
    }
}

impl Promoter<'_> {
    fn go_back(&mut self, begin: usize) {
        for (cell, content) in self.log.drain(begin..).rev() {
            self.current[cell as usize] = content;
        }
    }

    fn set(&mut self, cell: u32, value: Value) {
        let old = self.current[cell as usize].replace(value);
        self.log.push((cell, old));
    }

    fn content(&mut self, cell: u32) -> Value {
        match self.current[cell as usize] {
            Some(value) => value,
            None => self.zero(self.cells.types[cell as usize]),
        }
    }

    fn zero(&mut self, ty: Type) -> Value {
        *self.zeros[ty as usize].get_or_insert_with(|| self.function.new_value(ty))
    }

    /// Decides which cells leave the construct with a `br` to it.
    fn hand_on(&mut self, label: usize) {
        let candidates = std::mem::take(&mut self.candidates[label]);
        let needed = candidates.stored.iter().zip(&candidates.live);
        self.handed_on[label] = needed
            .filter(|&(&cell, &live)| live || self.around[cell as usize] > 0)
            .map(|(&cell, _)| cell)
            .collect();
    }

    fn take_results(&mut self, label: usize, results: &mut Vec<Value>) {
        for cell in std::mem::take(&mut self.handed_on[label]) {
            let result = self.function.new_value(self.cells.types[cell as usize]);
            results.push(result);
            self.set(cell, result);
        }
    }

    fn enter_loop(&mut self, label: usize, params: &mut Vec<Value>, init: &mut Vec<Value>) {
        for index in 0..self.handed_on[label].len() {
            let cell = self.handed_on[label][index];
            init.push(self.content(cell));
            let param = self.function.new_value(self.cells.types[cell as usize]);
            params.push(param);
            self.set(cell, param);
            self.around[cell as usize] += 1;
        }
    }

    fn leave_loop(&mut self, label: usize) {
        for cell in std::mem::take(&mut self.handed_on[label]) {
            self.around[cell as usize] -= 1;
        }
    }

    /// Replaces a load with the cell's value, or sets the cell to a store's operand, with
    /// conversions between different types.
    ///
    /// Returns whether the access stays. Its replacement goes to `nodes`.
    #[inline(never)]
    fn promote_access(&mut self, inst: &mut Inst, nodes: &mut Vec<Node>) -> bool {
        let promotion = self.cells.promotions[self.next_access];
        self.next_access += 1;
        self.substitution.resolve_all(&mut inst.args);
        let is_load = matches!(inst.op, Op::VarLoad(..));
        let mut emit = |op, args: &[Value], results: &[Value]| {
            nodes.push(Node::Inst(Inst {
                op,
                args: SmallVec::from_slice(args),
                results: SmallVec::from_slice(results),
                source: inst.source,
            }));
        };
        match promotion {
            Promotion::Keep => return true,
            Promotion::Cell(cell) if is_load => {
                let result = inst.results[0];
                let content = self.content(cell);
                if self.function.ty(result) == self.cells.types[cell as usize] {
                    self.substitution.replace(result, content);
                } else {
                    emit(Op::Bitcast, &[content], &[result]);
                }
            }
            Promotion::Cell(cell) => {
                let ty = self.cells.types[cell as usize];
                let mut value = inst.args[0];
                if self.function.ty(value) != ty {
                    let cast = self.function.new_value(ty);
                    emit(Op::Bitcast, &[value], &[cast]);
                    value = cast;
                }
                self.set(cell, value);
            }
            Promotion::Pair(cell) if is_load => {
                let (low, high) = (self.content(cell), self.content(cell + 1));
                emit(Op::Pack64, &[low, high], &[inst.results[0]]);
            }
            Promotion::Pair(cell) => {
                let low = self.function.new_value(Type::I32);
                let high = self.function.new_value(Type::I32);
                emit(Op::Unpack64, &[inst.args[0]], &[low, high]);
                self.set(cell, low);
                self.set(cell + 1, high);
            }
        }
        false
    }

    /// Inserts the created zeros at the head of the function.
    fn define_zeros(&self, body: &mut Body) {
        let zeros = self.zeros.iter().flatten().map(|&zero| {
            Node::Inst(Inst {
                op: Op::Const(0),
                args: smallvec![],
                results: smallvec![zero],
                source: 0,
            })
        });
        body.nodes.splice(0..0, zeros);
    }
}
