//! Emits a function along its plan, and keeps what its ids are.

use foldhash::HashMap;
use std::rc::Rc;

use rspirv::spirv::Op;
use smallvec::SmallVec;

use super::frame::{Escaped, Frame, ReturnTo};
use super::structure::{BodyIndex, Condition, End, Plan, Step, plan_function};
use super::values::{Local, Pointer, Scalars, Val};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::stage::Stage;
use crate::ir::{self, Label, Node, Terminator, Type, Value, VariableId};
use crate::parse::{Block, Function, Id, opcode_name};

/// Rows of private memory that one invocation may have.
const MAX_ROWS: u64 = 1 << 18;

impl<'a> Lowerer<'a> {
    /// Lowers the entry; returns the outermost body's terminator.
    pub(super) fn lower_entry(&mut self, entry: Id) -> Result<Terminator, Error> {
        self.declare_interface()?;
        let index = self.module.function_index[&entry];
        let plan = self.plan(entry)?;
        self.lower_body(index, plan, ReturnTo::End, Vec::new())
    }

    /// Emits a function's body into the open one; returns its terminator.
    pub(super) fn lower_body(
        &mut self,
        index: usize,
        plan: Rc<Plan>,
        return_to: ReturnTo,
        arguments: Vec<Val>,
    ) -> Result<Terminator, Error> {
        let params = &self.module.functions[index].params;
        if params.len() != arguments.len() {
            return Err(self.b.invalid("a call has the wrong number of arguments"));
        }
        let first_value = self.values.len();
        for (&param, argument) in params.iter().zip(arguments) {
            self.values.insert(param, argument);
        }
        self.frames.push(Frame {
            function: index,
            body: 0,
            labels: vec![None; plan.labels],
            plan,
            first_value,
            escaped: HashMap::default(),
            phis: HashMap::default(),
            return_to,
        });
        let end = self.emit_plan_body(0)?;
        self.frames.pop();
        self.values.truncate(first_value);
        Ok(end)
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

    /// Lowers a callee in place: its returns leave a block whose results are the returned scalars.
    pub(super) fn lower_inline(
        &mut self,
        function: Id,
        arguments: Vec<Val>,
    ) -> Result<Vec<Value>, Error> {
        let plan = self.plan(function)?;
        let index = self.module.function_index[&function];
        let callee = &self.module.functions[index];
        let label = self.b.new_label();
        let outer = self.b.open();
        let end = self.lower_body(index, plan, ReturnTo::Block(label), arguments)?;
        let body = self.b.close(outer, end);
        let types = self.types.leaves(callee.result_type)?;
        let results: Vec<Value> = types
            .iter()
            .map(|&ty| self.b.function.new_value(ty))
            .collect();
        self.b.push(Node::Block {
            label,
            results: results.clone(),
            body,
        });
        Ok(results)
    }

    fn frame(&self) -> &Frame {
        &self.frames[self.frames.len() - 1]
    }

    fn frame_mut(&mut self) -> &mut Frame {
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

    /// Emits a body of the plan into the open body of the IR.
    fn emit_plan_body(&mut self, index: BodyIndex) -> Result<Terminator, Error> {
        let plan = self.frame().plan.clone();
        let outer = std::mem::replace(&mut self.frame_mut().body, index);
        let body = &plan.bodies[index];
        for step in &body.steps {
            match step {
                Step::Code(block) => self.emit_code(*block)?,
                Step::Edge(from, to) => self.emit_edge(*from, *to)?,
                Step::Block { label, body } => {
                    let body = self.emit_nested(*body)?;
                    let label = self.label(*label);
                    self.b.push(Node::Block {
                        label,
                        results: Vec::new(),
                        body,
                    });
                }
                Step::Loop { label, body } => {
                    let body = self.emit_nested(*body)?;
                    let label = self.label(*label);
                    self.b.push(Node::Loop {
                        label,
                        params: Vec::new(),
                        init: Vec::new(),
                        body,
                    });
                }
                Step::If {
                    at,
                    condition,
                    label,
                    then_body,
                    else_body,
                } => {
                    let condition = self.emit_condition(*at, condition)?;
                    let then_body = self.emit_nested(*then_body)?;
                    let else_body = self.emit_nested(*else_body)?;
                    let label = self.label(*label);
                    self.b.push(Node::If {
                        condition,
                        label,
                        results: Vec::new(),
                        then_body,
                        else_body,
                    });
                }
            }
        }
        let end = match body.end {
            End::Br(label) => Terminator::Br(self.label(label), Vec::new()),
            End::Unreachable => Terminator::Unreachable,
            End::Exit(block) => self.emit_exit(block)?,
        };
        self.frame_mut().body = outer;
        Ok(end)
    }

    fn emit_nested(&mut self, index: BodyIndex) -> Result<Box<ir::Body>, Error> {
        let outer = self.b.open();
        let end = self.emit_plan_body(index)?;
        Ok(self.b.close(outer, end))
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

    fn emit_code(&mut self, index: usize) -> Result<(), Error> {
        let block = self.block(index);
        for &index in &block.instructions {
            let instruction = self.module.instruction(index);
            self.b.source = instruction.offset;
            if instruction.opcode == Op::Phi {
                self.check_opaque_result(instruction)?;
                let types = self.types.leaves(instruction.result_type)?;
                let variable = self.phi_variable(instruction.result, instruction.result_type)?;
                let values = self.load_rows(variable, &types)?;
                self.define(instruction.result, Self::scalars(values))?;
            } else {
                self.lower_instruction(instruction)?;
            }
        }
        Ok(())
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
            let mut pairs = self.module.operands(instruction).chunks_exact(2);
            let source = pairs.find(|pair| pair[1] == from).map(|pair| pair[0]);
            let Some(source) = source else {
                return Err(self.b.invalid("a phi lacks a predecessor"));
            };
            let values = self.scalars_as(source, instruction.result_type)?;
            let variable = self.phi_variable(instruction.result, instruction.result_type)?;
            moves.push((variable, values));
        }
        for (variable, values) in moves {
            self.store_rows(variable, &values)?;
        }
        Ok(())
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

    /// A variable of some rows, counted against what an invocation may have.
    pub(super) fn new_rows(&mut self, name: &str, rows: u32) -> Result<VariableId, Error> {
        self.rows += rows as u64;
        if self.rows > MAX_ROWS {
            return Err(budget("the shader's variables are too large"));
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
                    ReturnTo::Block(label) => Ok(Terminator::Br(label, values)),
                    ReturnTo::Caller(given) => {
                        values.extend(self.given_back(&given)?);
                        Ok(Terminator::Return(values))
                    }
                    ReturnTo::End => Ok(Terminator::Unreachable),
                }
            }
            Op::Unreachable => Ok(Terminator::Unreachable),
            Op::Kill | Op::TerminateInvocation => {
                if self.request.stage == Stage::Fragment {
                    self.b.emit_effect(ir::Op::Demote, &[])?;
                    // The outputs of a helper are unused.
                    return Ok(Terminator::Unreachable);
                }
                self.end_invocation(super::interface::Verdict::Accept)
            }
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

    /// Gives an id its value.
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
        })
    }

    /// The scalars of an id; pointers become the values that stand for them.
    pub(super) fn leaves(&mut self, id: Id) -> Result<Scalars, Error> {
        match self.value(id)? {
            Val::Scalars(values) => Ok(values),
            Val::Pointer(pointer) => Ok(self.pointer_scalars(&pointer)?[..].into()),
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

    /// Per-lane memory for a variable of a type: structures are split by member, so that a computed index into one pins only that one.
    pub(super) fn new_local(&mut self, name: &str, ty: Id) -> Result<usize, Error> {
        let mut parts = Vec::new();
        let rows = self.types.info(ty)?.rows;
        if rows > MAX_ROWS {
            return Err(budget("the shader's variables are too large"));
        }
        self.split_variable(name, ty, 0, &mut parts)?;
        if parts.is_empty() {
            parts.push((0, self.new_rows(name, 1)?));
        }
        self.locals.push(Local { parts });
        Ok(self.locals.len() - 1)
    }

    fn split_variable(
        &mut self,
        name: &str,
        ty: Id,
        first: u32,
        parts: &mut Vec<(u32, VariableId)>,
    ) -> Result<(), Error> {
        let rows = self.types.info(ty)?.rows as u32;
        if let super::types::TypeKind::Struct { members } = self.types.kind(ty)?
            && rows > 1
        {
            let members = members.clone();
            let mut at = first;
            for &member in members.iter() {
                self.split_variable(name, member, at, parts)?;
                at += self.types.info(member)?.rows as u32;
            }
        } else if rows > 0 {
            parts.push((first, self.new_rows(name, rows)?));
        }
        Ok(())
    }
}
