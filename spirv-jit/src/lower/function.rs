//! Emits a function along its plan, and tracks the values of its ids.

use foldhash::HashMap;
use std::rc::Rc;

use rspirv::spirv::Op;
use smallvec::SmallVec;

use super::frame::{After, Escaped, FunctionFrame, OpenBody, ReturnTo};
use super::large::ContentsSource;
use super::structure::{BodyIndex, Condition, ControlStep, End, Plan, plan_function};
use super::types::{MAX_LEAVES, MAX_ROWS, TypeKind, too_many_rows};
use super::values::{Local, Pointer, Scalars, Val};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::stage::Stage;
use crate::ir::{self, Label, Node, Terminator, Type, Value, VariableId};
use crate::parse::{Block, Function, Id, newer, opcode_name};

impl<'a> Lowerer<'a> {
    /// Lowers the entry; returns the outermost body's terminator.
    pub(super) fn lower_entry(&mut self, entry: Id) -> Result<Terminator, Error> {
        self.declare_interface()?;
        let plan = self.plan(entry)?;
        self.open_function(entry, plan, ReturnTo::End, Vec::new(), After::Entry)?;
        loop {
            if let Some(end) = self.emit_steps()? {
                return Ok(end);
            }
        }
    }

    /// Begins a function in the open body, or in a builder of its own.
    pub(super) fn open_function(
        &mut self,
        function: Id,
        plan: Rc<Plan>,
        return_to: ReturnTo,
        arguments: Vec<Val>,
        after: After,
    ) -> Result<(), Error> {
        let index = self.module.function_index[&function];
        let params = &self.module.functions[index].params;
        if params.len() != arguments.len() {
            return Err(self.b.invalid("a call has the wrong number of arguments"));
        }
        let first_value = self.values.len();
        for (&param, argument) in params.iter().zip(arguments) {
            self.values.insert(param, argument);
        }
        self.frames.push(FunctionFrame {
            function: index,
            body: 0,
            labels: vec![None; plan.labels],
            plan,
            first_value,
            escaped: HashMap::default(),
            phis: HashMap::default(),
            large_phis: HashMap::default(),
            return_to,
        });
        self.open_body(0, after);
        Ok(())
    }

    pub(super) fn plan(&mut self, function: Id) -> Result<Rc<Plan>, Error> {
        if let Some(plan) = self.plans.get(&function) {
            return Ok(plan.clone());
        }
        let Some(&index) = self.module.function_index.get(&function) else {
            return Err(self.b.invalid(format!("{function} is not a function")));
        };
        let plan = plan_function(self.module, &self.module.functions[index])?;
        let plan = Rc::new(plan);
        self.plans.insert(function, plan.clone());
        Ok(plan)
    }

    fn frame(&self) -> &FunctionFrame {
        &self.frames[self.frames.len() - 1]
    }

    fn frame_mut(&mut self) -> &mut FunctionFrame {
        let last = self.frames.len() - 1;
        &mut self.frames[last]
    }

    fn function(&self) -> &'a Function {
        &self.module.functions[self.frame().function]
    }

    fn block(&self, index: usize) -> &'a Block {
        &self.function().blocks[index]
    }

    fn label(&mut self, index: usize) -> Label {
        if let Some(label) = self.frame().labels[index] {
            return label;
        }
        let label = self.b.new_label();
        self.frame_mut().labels[index] = Some(label);
        label
    }

    /// Opens a body of the plan.
    fn open_body(&mut self, index: BodyIndex, after: After) {
        let nodes = match after {
            After::Entry | After::Outlined(_) => Vec::new(),
            _ => self.b.open(),
        };
        let outer = std::mem::replace(&mut self.frame_mut().body, index);
        self.open.push(OpenBody {
            outer,
            step: 0,
            instruction: 0,
            nodes,
            after,
        });
    }

    /// Emits steps of the innermost open body up to one that opens another body, or to its end.
    /// Returns the entry's terminator.
    fn emit_steps(&mut self) -> Result<Option<Terminator>, Error> {
        let frame = self.frame();
        let (plan, index) = (frame.plan.clone(), frame.body);
        let body = &plan.bodies[index];
        let top = self.open.len() - 1;
        while let Some(step) = body.steps.get(self.open[top].step) {
            if let ControlStep::Code(block) = step {
                if !self.emit_code(*block)? {
                    return Ok(None);
                }
                self.open[top].step += 1;
                continue;
            }
            self.open[top].step += 1;
            match step {
                ControlStep::Code(_) => {}
                ControlStep::Edge(from, to) => {
                    self.emit_edge(*from, *to)?;
                    continue;
                }
                ControlStep::Block { label, body } => self.open_body(*body, After::Block(*label)),
                ControlStep::Loop { label, body } => self.open_body(*body, After::Loop(*label)),
                ControlStep::If {
                    at,
                    condition,
                    label,
                    then_body,
                    else_body,
                } => {
                    let condition = self.emit_condition(*at, condition)?;
                    let after = After::Then {
                        condition,
                        label: *label,
                        else_body: *else_body,
                    };
                    self.open_body(*then_body, after);
                }
            }
            return Ok(None);
        }
        let end = match body.end {
            End::Br(label) => Terminator::Br(self.label(label), Vec::new()),
            End::Unreachable => Terminator::Unreachable,
            End::Exit(block) => self.emit_exit(block)?,
        };
        self.close_body(end)
    }

    /// Ends the innermost open body. Returns the entry's terminator.
    fn close_body(&mut self, end: Terminator) -> Result<Option<Terminator>, Error> {
        let Some(open) = self.open.pop() else {
            return Ok(Some(end));
        };
        self.frame_mut().body = open.outer;
        match open.after {
            After::Entry => {
                self.close_function();
                return Ok(Some(end));
            }
            After::Outlined(outlining) => {
                self.close_function();
                self.finish_outlined(*outlining, end)?;
            }
            After::Inlined {
                label,
                result,
                call,
            } => {
                self.close_function();
                let body = self.b.close(open.nodes, end);
                self.finish_inlined(label, body, result, &call)?;
            }
            After::Block(label) => {
                let body = self.b.close(open.nodes, end);
                let label = self.label(label);
                self.b.push(Node::Block {
                    label,
                    results: Vec::new(),
                    body,
                });
            }
            After::Loop(label) => {
                let body = self.b.close(open.nodes, end);
                let label = self.label(label);
                self.b.push(Node::Loop {
                    label,
                    params: Vec::new(),
                    init: Vec::new(),
                    body,
                });
            }
            After::Then {
                condition,
                label,
                else_body,
            } => {
                let then_body = self.b.close(open.nodes, end);
                let after = After::Else {
                    condition,
                    label,
                    then_body,
                };
                self.open_body(else_body, after);
            }
            After::Else {
                condition,
                label,
                then_body,
            } => {
                let else_body = self.b.close(open.nodes, end);
                let label = self.label(label);
                self.b.push(Node::If {
                    condition,
                    label,
                    results: Vec::new(),
                    then_body,
                    else_body,
                });
            }
        }
        Ok(None)
    }

    fn close_function(&mut self) {
        if let Some(frame) = self.frames.pop() {
            self.values.truncate(frame.first_value);
        }
    }

    fn emit_condition(&mut self, at: usize, condition: &Condition) -> Result<Value, Error> {
        let terminator = self.module.instruction(self.block(at).terminator);
        self.b.source = terminator.offset;
        match condition {
            Condition::Id(id) => self.bool_scalar(*id),
            Condition::Cases(literals) => {
                let selector = self.scalar(self.module.operands(terminator)[0])?;
                let ty = self.b.ty(selector);
                let mut any = None;
                for &literal in literals {
                    let literal = self.b.constant(ty, literal);
                    let equal = self.b.compare(ir::Op::IEq, selector, literal)?;
                    any = Some(match any {
                        Some(any) => self.b.binary(ir::Op::Or, any, equal)?,
                        None => equal,
                    });
                }
                Ok(any.unwrap_or_else(|| self.b.bool(false)))
            }
        }
    }

    /// Emits instructions of a block, from the next one. Returns false if a call has opened another
    /// body first.
    fn emit_code(&mut self, index: usize) -> Result<bool, Error> {
        let block = self.block(index);
        let top = self.open.len() - 1;
        while let Some(&index) = block.instructions.get(self.open[top].instruction) {
            let instruction = self.module.instruction(index);
            self.b.source = instruction.offset;
            self.open[top].instruction += 1;
            if instruction.opcode == Op::Phi && self.is_large(instruction.result_type) {
                let ty = instruction.result_type;
                let place = self.new_place("", ty)?;
                let phi = self.large_phi(instruction.result, ty)?;
                self.fill(place.clone(), ContentsSource::Memory(phi))?;
                self.define(instruction.result, Val::Kept(place))?;
            } else if instruction.opcode == Op::Phi {
                self.check_opaque_result(instruction)?;
                let types = self.types.leaves(instruction.result_type)?;
                let variable = self.phi_variable(instruction.result, instruction.result_type)?;
                let values = self.load_rows(variable, &types)?;
                self.define(instruction.result, Self::scalars(values))?;
            } else if instruction.opcode == Op::FunctionCall {
                self.check_opaque_result(instruction)?;
                if self.outline(self.module.operands(instruction)[0])? {
                    // The call is emitted once its function exists.
                    self.open[top].instruction -= 1;
                    return Ok(false);
                }
                if self.lower_call(instruction)? {
                    return Ok(false);
                }
            } else {
                self.lower_instruction(instruction)?;
            }
        }
        self.open[top].instruction = 0;
        Ok(true)
    }

    /// All phis of a block take their values at once: every source is read before any is written.
    fn emit_edge(&mut self, from: usize, to: usize) -> Result<(), Error> {
        let from = self.block(from).label;
        let mut moves = Vec::new();
        for &index in &self.block(to).instructions {
            let instruction = self.module.instruction(index);
            if instruction.opcode != Op::Phi {
                break;
            }
            self.b.source = instruction.offset;
            let pairs = self.module.operands(instruction);
            let Some(source) = self.phi_sources.find(index, pairs, from) else {
                return Err(self.b.invalid("a phi lacks a predecessor"));
            };
            if self.is_large(instruction.result_type) {
                // Reading a phi's result copies it, so a later write cannot change another phi's
                // source.
                let phi = self.large_phi(instruction.result, instruction.result_type)?;
                self.fill_from(phi, source)?;
                continue;
            }
            let values = self.scalars_as(source, instruction.result_type)?;
            let variable = self.phi_variable(instruction.result, instruction.result_type)?;
            moves.push((variable, values));
        }
        for (variable, values) in moves {
            self.store_rows(variable, &values)?;
        }
        Ok(())
    }

    /// The memory of a phi of large values.
    fn large_phi(&mut self, id: Id, ty: Id) -> Result<Pointer, Error> {
        if let Some(pointer) = self.frame().large_phis.get(&id) {
            return Ok(pointer.clone());
        }
        let pointer = self.new_place("", ty)?;
        self.frame_mut().large_phis.insert(id, pointer.clone());
        Ok(pointer)
    }

    fn phi_variable(&mut self, id: Id, ty: Id) -> Result<VariableId, Error> {
        if let Some(&variable) = self.frame().phis.get(&id) {
            return Ok(variable);
        }
        let types = self.types.leaves(ty)?;
        let variable = self.temporary(&types)?;
        self.frame_mut().phis.insert(id, variable);
        Ok(variable)
    }

    /// A variable with room for scalars of these types.
    pub(super) fn temporary(&mut self, types: &[Type]) -> Result<VariableId, Error> {
        let rows = types.iter().map(|ty| ty.rows()).sum();
        self.new_rows("", rows)
    }

    /// A variable of some rows, counted against the limit of an invocation.
    pub(super) fn new_rows(&mut self, name: &str, rows: u32) -> Result<VariableId, Error> {
        self.private.rows += rows as u64;
        if self.private.rows > MAX_ROWS {
            return Err(too_many_rows());
        }
        Ok(self.b.new_variable(name, rows))
    }

    pub(super) fn store_rows(
        &mut self,
        variable: VariableId,
        values: &[Value],
    ) -> Result<(), Error> {
        let mut row = 0;
        for &value in values {
            self.b
                .emit_effect(ir::Op::VarStore(variable, row), &[value])?;
            row += self.b.ty(value).rows();
        }
        Ok(())
    }

    pub(super) fn load_rows(
        &mut self,
        variable: VariableId,
        types: &[Type],
    ) -> Result<Vec<Value>, Error> {
        let mut row = 0;
        let mut values = Vec::with_capacity(types.len());
        for &ty in types {
            let op = ir::Op::VarLoad(variable, row);
            values.push(self.b.emit_one(op, &[], ty)?);
            row += ty.rows();
        }
        Ok(values)
    }

    fn emit_exit(&mut self, block: usize) -> Result<Terminator, Error> {
        let terminator = self.module.instruction(self.block(block).terminator);
        self.b.source = terminator.offset;
        let operands = self.module.operands(terminator);
        match terminator.opcode {
            Op::Return | Op::ReturnValue => {
                let return_to = self.frame().return_to.clone();
                if let ReturnTo::End = return_to {
                    return self.end_invocation(super::interface::Verdict::Accept);
                }
                let ty = self.function().result_type;
                if let ReturnTo::Block(label, Some(place)) = return_to {
                    let Some(&id) = operands.first() else {
                        return Err(self.b.invalid("the function returns nothing"));
                    };
                    self.check_opaque(id, ty)?;
                    self.fill_from(place, id)?;
                    return Ok(Terminator::Br(label, Vec::new()));
                }
                let mut values = match operands.first() {
                    Some(&id) => {
                        self.check_opaque(id, ty)?;
                        self.scalars_as(id, ty)?.to_vec()
                    }
                    None => Vec::new(),
                };
                if values.len() != self.types.leaves(ty)?.len() {
                    return Err(self.b.invalid("the function returns nothing"));
                }
                match return_to {
                    ReturnTo::Block(label, _) => Ok(Terminator::Br(label, values)),
                    ReturnTo::Caller(given) => {
                        values.extend(self.extra_results(&given)?);
                        Ok(Terminator::Return(values))
                    }
                    ReturnTo::End => Ok(Terminator::Unreachable),
                }
            }
            Op::Unreachable => Ok(Terminator::Unreachable),
            Op::TerminateInvocation if self.module.written_opcode(terminator) == newer::ABORT => {
                self.lower_abort(operands)
            }
            Op::Kill | Op::TerminateInvocation => {
                if self.request.stage == Stage::Fragment {
                    self.b.emit_effect(ir::Op::Demote, &[])?;
                    // The outputs of a helper are unused.
                    return Ok(Terminator::Unreachable);
                }
                self.end_invocation(super::interface::Verdict::Accept)
            }
            Op::EmitMeshTasksEXT => self.emit_mesh_tasks(&operands[..3]),
            Op::IgnoreIntersectionKHR | Op::IgnoreIntersectionNV => {
                self.end_invocation(super::interface::Verdict::Ignore)
            }
            Op::TerminateRayKHR | Op::TerminateRayNV => {
                self.end_invocation(super::interface::Verdict::Terminate)
            }
            other => Err(Error::unsupported(
                terminator.offset,
                format!("Op{} is not supported", opcode_name(other)),
            )),
        }
    }

    /// Sets the value of an id.
    pub(super) fn define(&mut self, id: Id, value: Val) -> Result<(), Error> {
        if !self.frame().plan.escapes.contains(&id) {
            self.values.insert(id, value);
            return Ok(());
        }
        let kept = self.computed_parts(&value);
        if kept.is_empty() {
            self.values.insert(id, value);
            return Ok(());
        }
        let types: SmallVec<[Type; 8]> = kept.iter().map(|&value| self.b.ty(value)).collect();
        let variable = self.temporary(&types)?;
        self.store_rows(variable, &kept)?;
        let body = self.frame().body;
        let escaped = Escaped {
            value,
            body,
            variable,
        };
        self.frame_mut().escaped.insert(id, escaped);
        Ok(())
    }

    /// The values of an id that are not visible in the whole function.
    fn computed_parts(&self, value: &Val) -> SmallVec<[Value; 8]> {
        let all: SmallVec<[Value; 8]> = match value {
            Val::Scalars(values) => values.iter().copied().collect(),
            Val::Pointer(pointer) => pointer.values(),
            Val::Kept(_) => SmallVec::new(),
        };
        let computed = all.into_iter().filter(|&value| !self.b.is_global(value));
        computed.collect()
    }

    /// The value of an id, visible here.
    pub(super) fn value(&mut self, id: Id) -> Result<Val, Error> {
        let frame = self.frame();
        if let Some(value) = self.values.get_since(id, frame.first_value) {
            return Ok(value.clone());
        }
        if let Some(escaped) = frame.escaped.get(&id) {
            let value = escaped.value.clone();
            if frame.plan.encloses(escaped.body, frame.body) {
                return Ok(value);
            }
            return self.reload(value, escaped.variable);
        }
        if let Some(constant) = self.constants.find(id) {
            let ty = constant.ty;
            if self.is_large(ty) {
                return self.keep_constant(id, ty);
            }
            let bits = self.constants.bits(&self.types, id)?;
            let types = self.types.leaves(ty)?;
            let values: Scalars = types
                .iter()
                .zip(bits.iter())
                .map(|(&ty, &bits)| self.b.constant(ty, bits))
                .collect();
            return Ok(Val::Scalars(values));
        }
        if self.variables.contains_key(&id) {
            return Ok(Val::Pointer(self.module_pointer(id)?));
        }
        Err(self.b.invalid(format!("id {id} has no value here")))
    }

    /// An escaped value with its computed parts loaded back.
    fn reload(&mut self, value: Val, variable: VariableId) -> Result<Val, Error> {
        let kept = self.computed_parts(&value);
        let types: SmallVec<[Type; 8]> = kept.iter().map(|&value| self.b.ty(value)).collect();
        let mut loaded = self.load_rows(variable, &types)?.into_iter();
        let all: SmallVec<[Value; 8]> = match &value {
            Val::Scalars(values) => values.iter().copied().collect(),
            Val::Pointer(pointer) => pointer.values(),
            Val::Kept(_) => SmallVec::new(),
        };
        let mut fresh = Vec::with_capacity(all.len());
        for value in all {
            let computed = !self.b.is_global(value);
            fresh.push(if computed {
                loaded.next().unwrap_or(value)
            } else {
                value
            });
        }
        Ok(match value {
            Val::Scalars(_) => Self::scalars(fresh),
            Val::Pointer(pointer) => Val::Pointer(pointer.with_values(&fresh)),
            kept => kept,
        })
    }

    /// The scalars of an id; pointers are converted to their value form.
    pub(super) fn leaves(&mut self, id: Id) -> Result<Scalars, Error> {
        match self.value(id)? {
            Val::Scalars(values) => Ok(values),
            Val::Pointer(pointer) => Ok(self.pointer_scalars(&pointer)?[..].into()),
            Val::Kept(_) => Err(budget(&format!(
                "id {id} has more than {MAX_LEAVES} scalars, which cannot be taken apart here"
            ))),
        }
    }

    /// The scalars of an id, which must be those of a type.
    pub(super) fn scalars_as(&mut self, id: Id, ty: Id) -> Result<Scalars, Error> {
        let values = self.leaves(id)?;
        let types = self.types.leaves(ty)?;
        let same = values.len() == types.len()
            && values
                .iter()
                .zip(types.iter())
                .all(|(&v, &ty)| self.b.ty(v) == ty);
        if same {
            return Ok(values);
        }
        Err(self.b.invalid(format!("id {id} does not have type {ty}")))
    }

    /// The only scalar of an id.
    pub(super) fn scalar(&mut self, id: Id) -> Result<Value, Error> {
        match self.leaves(id)?[..] {
            [value] => Ok(value),
            _ => Err(self.b.invalid(format!("id {id} is not a scalar"))),
        }
    }

    /// A boolean id.
    pub(super) fn bool_scalar(&mut self, id: Id) -> Result<Value, Error> {
        let value = self.scalar(id)?;
        match self.b.ty(value) {
            Type::I1 => Ok(value),
            _ => Err(self.b.invalid(format!("id {id} is not a boolean"))),
        }
    }

    /// A logical or physical pointer.
    pub(super) fn pointer(&mut self, id: Id) -> Result<Pointer, Error> {
        match self.value(id)? {
            Val::Pointer(pointer) => Ok(pointer),
            Val::Kept(_) => Err(self.b.invalid(format!("id {id} is not a pointer"))),
            Val::Scalars(values) => {
                let ty = self.type_of(id)?;
                self.pointer_from_scalars(ty, &values)
            }
        }
    }

    /// The type of an id.
    pub(super) fn type_of(&self, id: Id) -> Result<Id, Error> {
        let index = self.module.definition(id);
        let ty = index.map_or(0, |index| self.module.instruction(index).result_type);
        if ty == 0 {
            return Err(self.b.invalid(format!("id {id} has no type")));
        }
        Ok(ty)
    }

    /// Per-lane memory for a variable of a type: structures are split by member, so that a computed
    /// index into one pins only that one.
    pub(super) fn new_local(&mut self, name: &str, ty: Id) -> Result<usize, Error> {
        let mut parts = Vec::new();
        let rows = self.types.info(ty)?.rows;
        if rows > MAX_ROWS {
            return Err(too_many_rows());
        }
        let mut work = vec![(ty, 0)];
        while let Some((ty, first)) = work.pop() {
            let rows = self.types.info(ty)?.rows as u32;
            if let TypeKind::Struct { members } = self.types.kind(ty)?
                && rows > 1
            {
                let (begin, mut at) = (work.len(), first);
                for &member in members.iter() {
                    work.push((member, at));
                    at += self.types.info(member)?.rows as u32;
                }
                work[begin..].reverse();
            } else if rows > 0 {
                parts.push((first, self.new_rows(name, rows)?));
            }
        }
        if parts.is_empty() {
            parts.push((0, self.new_rows(name, 1)?));
        }
        self.private.locals.push(Local { parts });
        Ok(self.private.locals.len() - 1)
    }
}
