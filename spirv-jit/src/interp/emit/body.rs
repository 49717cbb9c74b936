//! Bodies, constructs, copies at `br`, calls, and the places where a wave can be suspended.

use foldhash::HashMap;
use smallvec::SmallVec;

use super::{Emitter, Move, Target, instr};
use crate::Error;
use crate::interp::code::{ResumeTarget, Return};
use crate::interp::kernels::{Copy, MaskedCopy};
use crate::interp::machine::{Handler, Instr};
use crate::interp::operand::Operand;
use crate::interp::{control, memory, yields};
use crate::ir::{Body, Inst, Node, Op, Step, Terminator, Value};
use crate::plan::{self, masks_of};
use crate::state::SiteKind;

/// Long code takes more fuel than short code: as much as this many instructions together.
const INSTRS_PER_FUEL: u32 = 256;

/// A construct whose bodies are being emitted.
struct Construct {
    /// Where the body around it is left to.
    exit: Target,
    /// Its first mask, that of its label.
    mask: u32,
    /// Where its first body is left to: its end, or the second body.
    first_exit: Target,
    end: Target,
    /// Where a loop starts again.
    head: Target,
}

impl<'m> Emitter<'m> {
    pub(super) fn emit_function(&mut self, f: usize) -> Result<(), Error> {
        self.function = f;
        self.labels.clear();
        let entry = self.entries[f];
        let exit = self.new_target();
        let return_mask = self.plan().mask_base as u32;
        self.masks = return_mask as usize + 1;
        self.bind(entry);
        if f == 0 {
            self.new_point(entry);
            self.jump(control::jump_if_empty, exit);
        }
        self.push(Instr {
            x: return_mask,
            ..instr(control::enter)
        });
        let mut burns = None;
        if f != 0 {
            burns = Some(self.emit_burning(exit));
            self.zero_variables();
        }
        self.emit_body(&self.body_function().body, exit)?;
        self.bind(exit);
        if let Some(at) = burns {
            self.code.instrs[at].b = self.fuel_since(entry);
        }
        if f == 0 {
            self.emit_plain(control::finish);
        } else {
            self.push(Instr {
                x: f as u32,
                y: return_mask,
                ..instr(control::ret)
            });
        }
        Ok(())
    }

    /// Every call takes fuel, and a wave without any is suspended where the function begins.
    fn emit_burning(&mut self, exit: Target) -> usize {
        let resumed = self.new_target();
        let point = self.new_point(resumed);
        let at = self.code.instrs.len();
        self.push(Instr {
            a: Operand::number(point),
            ..instr(control::burn)
        });
        self.bind(resumed);
        self.jump(control::jump_if_empty, exit);
        at
    }

    /// The fuel of a pass through the code since a place.
    fn fuel_since(&self, start: Target) -> Operand {
        let start = self.targets[start.0] as usize;
        let length = self.code.instrs.len() - start + self.native_operations_since(start);
        Operand::number(Self::fuel_of(length))
    }

    /// The fuel for code of a length.
    pub(super) fn fuel_of(length: usize) -> u32 {
        1 + length as u32 / INSTRS_PER_FUEL
    }

    /// The entry's variables are zero from `Program::start` on.
    fn zero_variables(&mut self) {
        let rows = &self.plan().variables;
        for (variable, &row) in self.body_function().variables.iter().zip(rows) {
            if variable.zero {
                self.code.instrs.push(Instr {
                    x: row as u32,
                    y: row as u32 + variable.rows,
                    ..instr(memory::zero_private)
                });
            }
        }
    }

    /// Emits a jump of some kind, with its target in `y`.
    fn jump(&mut self, handler: Handler, target: Target) {
        self.push_jump(Instr { ..instr(handler) }, target);
    }

    fn push_jump(&mut self, i: Instr, target: Target) {
        self.jumps.push(self.code.instrs.len());
        self.push(Instr {
            y: target.0 as u32,
            ..i
        });
    }

    /// Emits a body and those inside; lanes that leave the body go on at `exit`.
    fn emit_body(&mut self, body: &'m Body, exit: Target) -> Result<(), Error> {
        let mut exit = exit;
        let mut open: Vec<Construct> = Vec::new();
        let mut steps = body.steps();
        while let Some(step) = steps.next() {
            match step {
                Step::Inst(inst) => self.emit_inst(inst, exit)?,
                Step::Open(node) => {
                    let construct = self.open_construct(node, exit)?;
                    if self.emit_turns(node, construct.mask) {
                        self.close_construct(node, construct);
                        steps.skip_construct();
                        steps.skip_rest();
                        continue;
                    }
                    exit = construct.first_exit;
                    open.push(construct);
                }
                Step::Else(_) => {
                    if let Some(construct) = open.last() {
                        exit = construct.end;
                        self.bind(construct.first_exit);
                        let pending = Instr {
                            x: construct.mask + 1,
                            ..instr(control::join)
                        };
                        self.push_jump(pending, exit);
                    }
                }
                Step::End(body) => self.emit_terminator(&body.end, exit)?,
                Step::Close(node) => {
                    let construct = open.pop().expect("a construct that was opened");
                    exit = construct.exit;
                    self.close_construct(node, construct);
                    if let Node::Loop { .. } = node {
                        // The code behind is not reached.
                        steps.skip_rest();
                    }
                }
            }
        }
        Ok(())
    }

    fn emit_terminator(&mut self, end: &'m Terminator, exit: Target) -> Result<(), Error> {
        match end {
            Terminator::Br(label, args) => {
                let (mask, to) = self.labels[label].clone();
                let moves = self.moves(&to, args, true);
                self.emit_moves(moves)?;
                let park = Instr {
                    x: mask,
                    ..instr(control::park)
                };
                self.push_jump(park, exit);
            }
            Terminator::Return(args) if self.function != 0 => {
                let results = self.placed().results.clone();
                let moves = results
                    .into_iter()
                    .zip(args)
                    .map(|(to, &arg)| self.move_to(to, arg, true))
                    .collect();
                self.emit_moves(moves)?;
                let park = Instr {
                    x: self.plan().mask_base as u32,
                    ..instr(control::park)
                };
                self.push_jump(park, exit);
            }
            Terminator::End(args) => {
                self.end_stretch()?;
                self.emit_end(args, exit);
            }
            Terminator::Return(_) | Terminator::Unreachable => {
                self.end_stretch()?;
                self.emit_end(&[], exit);
            }
        }
        Ok(())
    }

    fn emit_end(&mut self, args: &[Value], exit: Target) {
        let first = self.list(args);
        self.push(Instr {
            x: first,
            b: Operand::number(args.len() as u32),
            c: Operand::number(self.module.output_rows),
            ..instr(self.kernel::<yields::WriteOutputs>())
        });
        self.jump(control::kill, exit);
    }

    /// The beginning of a construct in a body that is left to `exit`.
    fn open_construct(&mut self, node: &'m Node, exit: Target) -> Result<Construct, Error> {
        match node {
            // The copies of a loop's first parameters may end a stretch.
            Node::Loop { params, init, .. } => {
                let moves = self.moves(params, init, false);
                self.emit_moves(moves)?;
            }
            _ => self.end_stretch()?,
        }
        let mask = self.masks as u32;
        self.masks += masks_of(node);
        if let Some(label) = node.label() {
            let taken = node.definitions().to_vec();
            self.labels.insert(label, (mask, taken));
        }
        let end = self.new_target();
        let mut construct = Construct {
            exit,
            mask,
            first_exit: end,
            end,
            head: end,
        };
        match node {
            Node::If { condition, .. } => {
                construct.first_exit = self.new_target();
                let branch = Instr {
                    a: self.operand(*condition),
                    x: mask,
                    ..instr(self.kernel::<control::Branch>())
                };
                self.push_jump(branch, construct.first_exit);
            }
            _ => {
                construct.head = self.new_target();
                self.bind(construct.head);
                self.push(Instr {
                    x: mask,
                    ..instr(control::enter)
                });
            }
        }
        Ok(construct)
    }

    fn close_construct(&mut self, node: &Node, construct: Construct) {
        let Construct {
            exit,
            mask,
            end,
            head,
            ..
        } = construct;
        self.bind(end);
        if let Node::Loop { .. } = node {
            let resumed = self.new_target();
            let point = self.new_point(resumed);
            let back = Instr {
                a: Operand::number(point),
                b: self.fuel_since(head),
                x: mask,
                ..instr(control::back_edge)
            };
            self.push_jump(back, head);
            self.jump(control::jump, exit);
            self.bind(resumed);
            self.jump(control::jump_if_empty, exit);
            self.jump(control::jump, head);
        } else {
            // Parked lanes go on.
            let join = Instr {
                x: mask,
                ..instr(control::join)
            };
            self.push_jump(join, exit);
        }
        self.masks -= masks_of(node);
        node.label().map(|label| self.labels.remove(&label));
    }

    fn move_to(&self, to: Operand, value: Value, masked: bool) -> Move {
        Move {
            to,
            from: self.operand(value),
            value: Some(value),
            wide: self.body_function().ty(value).rows() == 2,
            masked,
        }
    }

    fn moves(&self, to: &[Value], from: &[Value], masked: bool) -> Vec<Move> {
        to.iter()
            .zip(from)
            .map(|(&to, &from)| self.move_to(self.operand(to), from, masked))
            .collect()
    }

    /// Copies as if all at once, behind the stretch that is open, or in it.
    fn emit_moves(&mut self, moves: Vec<Move>) -> Result<(), Error> {
        let (in_place, moves): (Vec<_>, Vec<_>) = moves.iter().partition(|m| m.to == m.from);
        let moves = self.in_order(moves);
        if !self.extend_stretch_by_moves(&moves, &in_place) {
            self.end_stretch()?;
            for m in &moves {
                self.emit_move(m);
            }
        }
        self.end_stretch()
    }

    /// Copies whose effect, one after the other, is as if all were done at once.
    fn in_order(&self, mut moves: Vec<Move>) -> Vec<Move> {
        if moves.len() < 2 {
            return moves;
        }
        let mut ordered = Vec::with_capacity(moves.len());
        // The reader, the remaining number of readers, and the writer of each row; a row with no
        // readers left can be reused.
        let mut readers: HashMap<Operand, (u32, SmallVec<[u32; 2]>)> = HashMap::default();
        let mut writers: HashMap<Operand, u32> = HashMap::default();
        for (index, m) in moves.iter().enumerate() {
            let (count, who) = readers.entry(m.from).or_default();
            *count += 1;
            who.push(index as u32);
            writers.insert(m.to, index as u32);
        }
        let mut ready: Vec<u32> = (0..moves.len() as u32)
            .rev()
            .filter(|&index| !readers.contains_key(&moves[index as usize].to))
            .collect();
        let mut done = vec![false; moves.len()];
        for first in 0..moves.len() {
            while let Some(index) = ready.pop() {
                if std::mem::replace(&mut done[index as usize], true) {
                    continue;
                }
                let next = moves[index as usize];
                ordered.push(next);
                if let Some((count, _)) = readers.get_mut(&next.from) {
                    *count -= 1;
                    if *count == 0 {
                        ready.extend(writers.get(&next.from));
                    }
                }
            }
            if done[first] {
                continue;
            }
            // Only cycles are left: save one destination's old value.
            let Move { to, wide, .. } = moves[first];
            let scratch = self.placed().scratch;
            ordered.push(Move {
                to: scratch,
                from: to,
                value: None,
                wide,
                masked: false,
            });
            for reader in readers.remove(&to).unwrap_or_default().1 {
                let reader = &mut moves[reader as usize];
                (reader.from, reader.value) = (scratch, None);
            }
            ready.push(first as u32);
        }
        while let Some(index) = ready.pop() {
            if !std::mem::replace(&mut done[index as usize], true) {
                ordered.push(moves[index as usize]);
            }
        }
        ordered
    }

    pub(super) fn emit_move(&mut self, m: &Move) {
        let handler = match (m.masked, m.wide) {
            (true, false) => self.kernel::<MaskedCopy<u32>>(),
            (true, true) => self.kernel::<MaskedCopy<u64>>(),
            (false, false) => self.kernel::<Copy<u32>>(),
            (false, true) => self.kernel::<Copy<u64>>(),
        };
        self.push(Instr {
            d: m.to,
            a: m.from,
            ..instr(handler)
        });
    }

    fn emit_inst(&mut self, inst: &'m Inst, exit: Target) -> Result<(), Error> {
        match inst.op {
            Op::Call(callee) => {
                self.end_stretch()?;
                self.emit_call(callee.index(), inst, exit);
                Ok(())
            }
            ref op if op.is_yield() => {
                self.end_stretch()?;
                self.emit_yield(inst, exit);
                Ok(())
            }
            _ => {
                let uniform = &self.plan().uniform;
                let in_prologue = inst.results.first().is_some_and(|r| uniform[r.index()]);
                if in_prologue || self.placed().fusion.absorbs(inst) {
                    self.pass_over();
                    return Ok(());
                }
                if self.extend_stretch(inst) {
                    return Ok(());
                }
                self.end_stretch()?;
                self.interpret(inst)
            }
        }
    }

    /// Emits an instruction that neither branches nor suspends for the interpreter.
    pub(super) fn interpret(&mut self, inst: &Inst) -> Result<(), Error> {
        if let Some(pair) = self.placed().fusion.of(inst) {
            let pair = self.fused(inst, pair);
            self.push(pair);
            return Ok(());
        }
        self.emit_operation(inst)
    }

    /// The plan's next save point, where code goes on at a target: functions are emitted as they
    /// were planned.
    fn new_point(&mut self, at: Target) -> u32 {
        let index = self.code.points.len();
        let point = &self.planned.plan.points[index];
        assert_eq!(
            (point.function as usize, point.masks as usize),
            (self.function, self.masks),
            "emitted in another order than planned"
        );
        let (pc, live) = (at.0 as u32, point.live);
        self.code.points.push(ResumeTarget {
            pc,
            function: point.function,
            masks: point.masks,
            site: point.site,
            uniform_operands: 0,
            live,
        });
        index as u32
    }

    fn emit_call(&mut self, callee: usize, inst: &Inst, exit: Target) {
        let params = &self.module.functions[callee].params;
        let to: Vec<Operand> = params
            .iter()
            .map(|p| self.operands[callee][p.index()])
            .collect();
        let moves = to
            .into_iter()
            .zip(&inst.args)
            .map(|(to, &arg)| self.move_to(to, arg, false))
            .filter(|m| m.to != m.from)
            .collect();
        for m in self.in_order(moves) {
            self.emit_move(&m);
        }

        let results = self.placed[callee]
            .as_ref()
            .expect("placed")
            .results
            .clone();
        let after = self.new_target();
        let site = self.code.calls.len();
        let live = self.planned.plan.calls[site].live;
        let pc = after.0 as u32;
        self.code.calls.push(Return { pc, live });
        let entry = self.entries[callee];
        let call = Instr {
            x: site as u32,
            ..instr(control::call)
        };
        self.push_jump(call, entry);
        self.bind(after);
        self.jump(control::jump_if_empty, exit);
        for (&result, from) in inst.results.iter().zip(results) {
            self.emit_move(&Move {
                to: self.operand(result),
                from,
                value: None,
                wide: self.body_function().ty(result).rows() == 2,
                masked: false,
            });
        }
    }

    fn emit_yield(&mut self, inst: &Inst, exit: Target) {
        let site = plan::Site::of(inst);
        let after = self.new_target();
        let point = self.new_point(after);
        let first = self.list(&inst.args);
        for (row, &arg) in inst.args.iter().take(site.fixed).enumerate() {
            let is_uniform = u16::from(self.operand(arg).is_uniform());
            self.code.points[point as usize].uniform_operands |= is_uniform << row;
        }
        let handler = match site.kind {
            SiteKind::Barrier | SiteKind::BarrierArrive | SiteKind::BarrierWait => {
                self.kernel::<yields::Barrier>()
            }
            // Answered elsewhere than in the rows of the operands.
            SiteKind::TraceRay { trace, .. }
                if !trace.to_hit_object && self.module.output_rows == 0 =>
            {
                self.kernel::<yields::YieldAgain>()
            }
            _ => self.kernel::<yields::Yield>(),
        };
        self.push(Instr {
            x: first,
            y: point,
            b: Operand::number(inst.args.len() as u32),
            c: Operand::number(site.fixed as u32),
            ..instr(handler)
        });
        self.bind(after);
        self.jump(control::jump_if_empty, exit);
        match (site.answer, &inst.results[..]) {
            (_, []) => {}
            (plan::Answer::Verdict, &[accepted, ..]) => {
                self.push(Instr {
                    d: self.operand(accepted),
                    ..instr(self.kernel::<yields::ReadVerdict>())
                });
                self.jump(control::jump_if_empty, exit);
            }
            (plan::Answer::Rows(row), results) => {
                let first = self.list(results);
                self.push(Instr {
                    x: first,
                    b: Operand::number(results.len() as u32),
                    c: Operand::number(row as u32),
                    ..instr(self.kernel::<yields::ReadIo>())
                });
            }
        }
    }
}
