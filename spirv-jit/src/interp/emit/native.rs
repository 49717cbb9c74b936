//! Stretches of operations as native code.

use super::{Emitter, instr};
use crate::Error;
use crate::interp::machine::Instr;
use crate::interp::native;
use crate::interp::operand::Operand;
use crate::ir::{Inst, Value};
use crate::native::{Encoding, Executable, Place, Row, Stretch};

/// Fewer operations are left to the interpreter: one call costs as much as another.
const LEAST_OPERATIONS: usize = 2;

/// Code starts at multiples of this.
const ALIGNMENT: usize = 64;

/// A program's native code while it is emitted.
pub(super) struct Native<'m> {
    encoding: Encoding,
    /// The stretch that may go on, and what it is made of.
    open: Option<(Stretch, Vec<&'m Inst>)>,
    bytes: Vec<u8>,
    /// Instructions that run a stretch, whose `x` is where its code begins, and how many operations it has.
    calls: Vec<(usize, usize)>,
}

impl Native<'_> {
    pub fn new(encoding: Encoding) -> Self {
        Native {
            encoding,
            open: None,
            bytes: Vec::new(),
            calls: Vec::new(),
        }
    }
}

impl<'m> Emitter<'m> {
    /// Takes an instruction into a stretch; false if it has no native code.
    pub(super) fn extend_stretch(&mut self, inst: &'m Inst) -> bool {
        let Some(native) = &mut self.native else {
            return false;
        };
        let encoding = native.encoding;
        let open = native.open.take();
        let (mut stretch, mut insts) = open.unwrap_or_else(|| (Stretch::new(encoding), Vec::new()));
        let performed = self.perform(&mut stretch, inst);
        if performed {
            insts.push(inst);
        }
        if let Some(native) = &mut self.native {
            native.open = (!insts.is_empty()).then_some((stretch, insts));
        }
        performed
    }

    fn perform(&self, stretch: &mut Stretch, inst: &Inst) -> bool {
        let places = |values: &[Value]| values.iter().map(|&v| self.place(v)).collect::<Vec<_>>();
        let mark = stretch.mark();
        if let Some(pair) = self.placed().fusion.of(inst) {
            let taken = inst.args[pair.side as usize];
            let operands: Vec<Value> = pair.operands[..2].iter().flatten().copied().collect();
            let result = Place {
                value: taken,
                ty: pair.ty,
                row: Row::Nowhere,
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

    fn place(&self, value: Value) -> Place {
        let operand = self.operand(value);
        let (row, constant) = match operand {
            Operand::NONE => (Row::Nowhere, None),
            _ if operand.is_uniform() => {
                let constant = self.code.constants.get(operand.index()).map(|row| {
                    let [low, high, ..] = row.0;
                    match self.body_function().ty(value).rows() {
                        2 => low as u64 | (high as u64) << 32,
                        _ => low as u64,
                    }
                });
                (Row::Uniform(operand.index()), constant)
            }
            _ => (Row::Frame(operand.index()), None),
        };
        Place {
            value,
            ty: self.body_function().ty(value),
            row,
            constant,
        }
    }

    /// Emits the stretch that is open, if one is.
    pub(super) fn end_stretch(&mut self) -> Result<(), Error> {
        let Some((stretch, insts)) = self.native.as_mut().and_then(|native| native.open.take())
        else {
            return Ok(());
        };
        let ranges = &self.placed().ranges;
        let range = |value: Value| ranges[value.index()];
        let results = insts.iter().flat_map(|inst| &inst.results);
        let last = results
            .filter_map(|&value| range(value))
            .map(|(start, _)| start)
            .max();
        let is_kept = |value| range(value).is_some_and(|(_, end)| Some(end) > last);
        let operations = stretch.operations();
        let code = match operations {
            LEAST_OPERATIONS.. => stretch.assemble(is_kept),
            _ => None,
        };
        let (Some(code), Some(native)) = (code, &mut self.native) else {
            return insts.into_iter().try_for_each(|inst| self.interpret(inst));
        };
        let start = native.bytes.len().next_multiple_of(ALIGNMENT);
        native.bytes.resize(start, 0);
        native.bytes.extend(code);
        native.calls.push((self.code.instrs.len(), operations));
        self.push(Instr {
            x: start as u32,
            ..instr(native::run)
        });
        Ok(())
    }

    /// Operations of stretches from an instruction on, each stretch's first left out: it counts as the instruction that runs it.
    pub(super) fn native_operations_since(&self, instr: usize) -> usize {
        let calls = self
            .native
            .iter()
            .flat_map(|native| native.calls.iter().rev());
        let later = calls.take_while(|&&(call, _)| call >= instr);
        later.map(|&(_, operations)| operations - 1).sum()
    }

    /// Puts the code where it can be run; false if the system refuses that.
    pub(super) fn finish_native(&mut self) -> bool {
        let Some(native) = self.native.take().filter(|native| !native.calls.is_empty()) else {
            return true;
        };
        let Some(executable) = Executable::new(&native.bytes) else {
            return false;
        };
        for (call, _) in native.calls {
            let i = &mut self.code.instrs[call];
            let address = executable.start() as u64 + i.x as u64;
            (i.x, i.y) = native::words(address);
        }
        self.code.native = Some(executable);
        true
    }
}
