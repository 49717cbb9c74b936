//! Stretches of operations as native code.

use super::{Emitter, Move, instr};
use crate::Error;
use crate::interp::machine::Instr;
use crate::interp::native;
use crate::interp::operand::Operand;
use crate::ir::{Inst, Value};
use crate::native::{Encoding, Executable, IrOperand, Listed, ListedTurns, Stretch, ValueRow};

/// Fewer operations are left to the interpreter: one call costs as much as another.
const LEAST_OPERATIONS: usize = 2;

/// Code starts at multiples of this.
pub(super) const ALIGNMENT: usize = 64;

/// A program's native code while it is emitted.
pub(super) struct Native<'m> {
    encoding: Encoding,
    /// The stretch that may go on.
    open: Option<Open<'m>>,
    bytes: Vec<u8>,
    /// Instructions that run a stretch or a loop, and that code.
    calls: Vec<(usize, Listed)>,
}

/// A stretch, and what it is made of.
struct Open<'m> {
    stretch: Stretch,
    insts: Vec<&'m Inst>,
    /// Instructions behind those, which need no code.
    behind: u32,
    /// Copies at the stretch's end.
    moves: Vec<Move>,
    /// Values that are where those would copy them to.
    in_place: Vec<Value>,
}

impl Native<'_> {
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    pub fn new(encoding: Encoding) -> Self {
        Native {
            encoding,
            open: None,
            bytes: Vec::new(),
            calls: Vec::new(),
        }
    }
}

impl<'m> Native<'m> {
    /// Appends code; gives where it begins.
    fn append(&mut self, code: &[u8]) -> usize {
        let start = self.bytes.len().next_multiple_of(ALIGNMENT);
        self.bytes.resize(start, 0);
        self.bytes.extend(code);
        start
    }

    /// The stretch that may go on, or a new one.
    fn take_open(&mut self) -> Open<'m> {
        self.open.take().unwrap_or_else(|| Open {
            stretch: Stretch::new(self.encoding),
            insts: Vec::new(),
            behind: 0,
            moves: Vec::new(),
            in_place: Vec::new(),
        })
    }
}

impl<'m> Emitter<'m> {
    /// Takes an instruction into a stretch; false if it has no native code.
    pub(super) fn extend_stretch(&mut self, inst: &'m Inst) -> bool {
        let Some(native) = &mut self.native else {
            return false;
        };
        let mut open = native.take_open();
        let performed = self.perform(&mut open.stretch, inst);
        if performed {
            open.insts.push(inst);
            open.behind = 0;
        }
        if let Some(native) = &mut self.native {
            native.open = (!open.insts.is_empty()).then_some(open);
        }
        performed
    }

    /// An instruction needs no code: a stretch goes on behind it.
    pub(super) fn pass_over(&mut self) {
        if let Some(open) = self.native.as_mut().and_then(|native| native.open.as_mut()) {
            open.behind += 1;
        }
    }

    /// Takes copies into a stretch, behind which it ends; false if they have no native code. Those
    /// `in_place` are of a row to itself.
    pub(super) fn extend_stretch_by_moves(&mut self, moves: &[Move], in_place: &[Move]) -> bool {
        let has_code = |m: &Move| m.value.is_some() && !m.wide;
        if moves.is_empty() || !moves.iter().all(has_code) {
            return false;
        }
        let Some(native) = &mut self.native else {
            return false;
        };
        let mut open = native.take_open();
        for m in moves {
            let from = self.place(m.value.expect("has code"));
            (open.stretch).copy_to(&from, ValueRow::Frame(m.to.index()), m.masked);
        }
        open.moves = moves.to_vec();
        open.in_place = in_place.iter().filter_map(|m| m.value).collect();
        if let Some(native) = &mut self.native {
            native.open = Some(open);
        }
        true
    }

    pub(super) fn perform(&self, stretch: &mut Stretch, inst: &Inst) -> bool {
        let places = |values: &[Value]| values.iter().map(|&v| self.place(v)).collect::<Vec<_>>();
        let mark = stretch.mark();
        if let Some(pair) = self.placed().fusion.of(inst) {
            let taken = inst.args[pair.side as usize];
            let operands: Vec<Value> = pair.operands[..2].iter().flatten().copied().collect();
            let result = IrOperand {
                value: taken,
                ty: pair.ty,
                row: ValueRow::Forwarded,
                constant: None,
            };
            if !stretch.perform(&pair.first, &places(&operands), &[result]) {
                return false;
            }
        }
        let performed = stretch.perform(&inst.op, &places(&inst.args), &places(&inst.results));
        match performed {
            true => stretch.end_operation(),
            false => stretch.take_back(mark),
        }
        performed
    }

    pub(super) fn place(&self, value: Value) -> IrOperand {
        let operand = self.operand(value);
        let (row, constant) = match operand {
            Operand::NONE => (ValueRow::Forwarded, None),
            _ if operand.is_uniform() => {
                let constant = self.code.constants.get(operand.index()).map(|row| {
                    let [low, high, ..] = row.0;
                    match self.body_function().ty(value).rows() {
                        2 => low as u64 | (high as u64) << 32,
                        _ => low as u64,
                    }
                });
                (ValueRow::Uniform(operand.index()), constant)
            }
            _ => (ValueRow::Frame(operand.index()), None),
        };
        IrOperand {
            value,
            ty: self.body_function().ty(value),
            row,
            constant,
        }
    }

    /// Emits the stretch that is open, if one is.
    pub(super) fn end_stretch(&mut self) -> Result<(), Error> {
        let open = self.native.as_mut().and_then(|native| native.open.take());
        let Some(open) = open else {
            return Ok(());
        };
        let last = self.last_use(&open);
        let ranges = &self.placed().ranges;
        let is_kept = |value: Value| {
            open.in_place.contains(&value)
                || ranges[value.index()].is_some_and(|(_, end)| Some(end) > last)
        };
        let operations = open.stretch.operations();
        let code = match operations {
            LEAST_OPERATIONS.. => open.stretch.assemble(is_kept),
            _ => None,
        };
        let Some(code) = code else {
            (open.insts.into_iter()).try_for_each(|inst| self.interpret(inst))?;
            open.moves.iter().for_each(|m| self.emit_move(m));
            return Ok(());
        };
        self.push_native(&code, operations, None, instr(native::run));
        Ok(())
    }

    /// Emits the instruction that runs native code of so many operations. `turns`: a loop's.
    pub(super) fn push_native(
        &mut self,
        code: &[u8],
        operations: usize,
        turns: Option<ListedTurns>,
        i: Instr,
    ) {
        if let Some(native) = &mut self.native {
            let listed = Listed {
                start: native.append(code),
                operations,
                turns,
            };
            native.calls.push((self.code.instrs.len(), listed));
            self.push(i);
        }
    }

    /// The half-step of the last use in a stretch: values that are used behind it are used later.
    fn last_use(&self, open: &Open<'_>) -> Option<u32> {
        let ranges = &self.placed().ranges;
        let start = |value: &Value| ranges[value.index()].map(|(start, _)| start);
        let results = open.insts.iter().flat_map(|inst| &inst.results);
        let last = results.filter_map(start).max();
        // Copies have the position behind all instructions (see `plan::liveness`).
        let end = open
            .insts
            .last()
            .and_then(|inst| start(inst.results.first()?));
        match (end, &open.moves[..]) {
            (Some(end), [_, ..]) => last.max(Some(end + 2 * (open.behind + 1))),
            _ => last,
        }
    }

    /// Operations of stretches from an instruction on, each stretch's first left out: it counts as
    /// the instruction that runs it.
    pub(super) fn native_operations_since(&self, instr: usize) -> usize {
        let calls = self
            .native
            .iter()
            .flat_map(|native| native.calls.iter().rev());
        let later = calls.take_while(|(call, _)| *call >= instr);
        later.map(|(_, listed)| listed.operations - 1).sum()
    }

    /// Puts the code where it can be run; false if the system refuses that.
    pub(super) fn finish_native(&mut self) -> bool {
        let Some(native) = self.native.take().filter(|native| !native.calls.is_empty()) else {
            return true;
        };
        let Some(executable) = Executable::new(&native.bytes) else {
            return false;
        };
        for (call, listed) in native.calls {
            let i = &mut self.code.instrs[call];
            (i.x, i.y) = native::words(executable.start() as u64 + listed.start as u64);
            self.code.listed.push(listed);
        }
        self.code.native = Some(executable);
        true
    }
}
