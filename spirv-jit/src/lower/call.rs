//! Function calls: inlined, or lowered to a function of the IR.
//!
//! Functions that are small or called once are inlined: logical pointers stay known, and memory of
//! the caller stays promotable. A large function with several call sites becomes a function of the
//! IR, because otherwise code could double with each call level. It takes and returns by value all
//! memory that it may access: the pointees of pointers to per-lane memory, and module variables of
//! it and its callees. If two of those could be the same memory, the call is inlined, too.

use foldhash::HashMap;
use std::collections::BTreeSet;
use std::rc::Rc;

use rspirv::spirv::{Op, StorageClass};

use super::builder::Builder;
use super::frame::{After, ExtraResults, Outlining, ReturnTo, Scope};
use super::hit_object::is_hit_object;
use super::types::TypeKind;
use super::values::{MemoryLocation, Pointer, Val};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::{self, Body, FunctionId, Label, Node, Type, Value};
use crate::parse::{Id, Instruction, newer};

/// Instruction count from which a function with several call sites is not inlined.
const LARGE: usize = 400;

/// Largest number of scalars that a call takes or returns.
const MAX_CARRIED: u64 = 128;

/// The effects of a function and its callees.
#[derive(Clone, Debug, Default)]
pub(super) struct Summary {
    /// Number of instructions if inlined.
    size: usize,
    /// Per-lane variables of the module.
    variables: BTreeSet<Id>,
    /// Suspends the wave, or emits vertices or workgroups. Such a function is always inlined.
    yields: bool,
}

/// A function of the IR, and the module variables that it takes and returns.
#[derive(Clone)]
pub(super) struct Outlined {
    id: FunctionId,
    carried: Rc<[Id]>,
}

/// Storage classes of per-lane memory.
fn is_per_lane(class: StorageClass) -> bool {
    matches!(
        class,
        StorageClass::Function
            | StorageClass::Private
            | StorageClass::Output
            | StorageClass::RayPayloadKHR
            | StorageClass::IncomingRayPayloadKHR
            | StorageClass::HitAttributeKHR
            | StorageClass::HitObjectAttributeNV
            | StorageClass::HitObjectAttributeEXT
            | StorageClass::CallableDataKHR
            | StorageClass::IncomingCallableDataKHR
    )
}

impl Lowerer<'_> {
    /// Lowers a call of a function that has a decision. Returns whether it opened the function's
    /// body.
    pub(super) fn lower_call(&mut self, instruction: &Instruction) -> Result<bool, Error> {
        let operands = self.module.operands(instruction);
        let callee = operands[0];
        let arguments: Vec<Val> = operands[1..]
            .iter()
            .map(|&id| self.value(id))
            .collect::<Result<_, _>>()?;
        let types = self.parameter_types(callee)?;
        if types.len() != arguments.len() {
            return Err(self.b.invalid("a call has the wrong number of arguments"));
        }
        for (&argument, ty) in operands[1..].iter().zip(types) {
            self.check_opaque(argument, ty)?;
        }
        self.check_callee_result(instruction, callee)?;
        match self.calls.outlined.get(&callee).cloned().flatten() {
            Some(outlined) if !self.may_alias(&outlined, callee, &arguments)? => {
                let results = self.emit_call(&outlined, callee, &arguments)?;
                self.b.source = instruction.offset;
                self.define_typed(instruction, results)?;
                Ok(false)
            }
            _ => {
                let plan = self.plan(callee)?;
                let label = self.b.new_label();
                let ty = instruction.result_type;
                let result = match self.is_large(ty) {
                    true => Some(self.new_place("", ty)?),
                    false => None,
                };
                let after = After::Inlined {
                    label,
                    result: result.clone(),
                    call: *instruction,
                };
                let return_to = ReturnTo::Block(label, result);
                self.open_function(callee, plan, return_to, arguments, after)?;
                Ok(true)
            }
        }
    }

    /// Ends an inlined callee. Its returns leave a block with the returned scalars as results.
    pub(super) fn finish_inlined(
        &mut self,
        label: Label,
        body: Box<Body>,
        result: Option<Pointer>,
        call: &Instruction,
    ) -> Result<(), Error> {
        if let Some(place) = result {
            self.b.push(Node::Block {
                label,
                results: Vec::new(),
                body,
            });
            return self.define(call.result, Val::Kept(place));
        }
        let callee = self.module.operands(call)[0];
        let index = self.module.function_index[&callee];
        let types = self
            .types
            .leaves(self.module.functions[index].result_type)?;
        let results: Vec<Value> = types
            .iter()
            .map(|&ty| self.b.function.new_value(ty))
            .collect();
        self.b.push(Node::Block {
            label,
            results: results.clone(),
            body,
        });
        self.b.source = call.offset;
        self.define_typed(call, results)
    }

    /// The result must have the function's type.
    fn check_callee_result(&self, instruction: &Instruction, callee: Id) -> Result<(), Error> {
        let index = self.module.function_index[&callee];
        if self.module.functions[index].result_type == instruction.result_type {
            return Ok(());
        }
        self.refuse_opaque(instruction.result_type)
    }

    /// Types of a function's parameters.
    fn parameter_types(&self, function: Id) -> Result<Vec<Id>, Error> {
        let Some(&index) = self.module.function_index.get(&function) else {
            return Err(self.b.invalid(format!("{function} is not a function")));
        };
        let params = &self.module.functions[index].params;
        params.iter().map(|&param| self.type_of(param)).collect()
    }

    /// The pointee of a parameter that points to per-lane memory.
    fn per_lane_pointee(&self, ty: Id) -> Result<Option<Id>, Error> {
        Ok(match *self.types.kind(ty)? {
            TypeKind::Pointer { class, pointee } if is_per_lane(class) => Some(pointee),
            _ => None,
        })
    }

    /// The effects of a function and its callees. The call graph has no cycles.
    fn summary(&mut self, function: Id) -> Result<Rc<Summary>, Error> {
        let mut open = vec![function];
        while let Some(&next) = open.last() {
            if !self.calls.summaries.contains_key(&next) {
                let mut missing = self.callees(next)?;
                missing.retain(|callee| !self.calls.summaries.contains_key(callee));
                if !missing.is_empty() {
                    open.append(&mut missing);
                    continue;
                }
                let summary = self.summarize(next)?;
                self.calls.summaries.insert(next, Rc::new(summary));
            }
            open.pop();
        }
        Ok(self.calls.summaries[&function].clone())
    }

    /// The effects of a function whose callees have summaries.
    fn summarize(&self, function: Id) -> Result<Summary, Error> {
        let module = self.module;
        let Some(&index) = module.function_index.get(&function) else {
            return Err(self.b.invalid(format!("{function} is not a function")));
        };
        let mut summary = Summary::default();
        for block in &module.functions[index].blocks {
            for &index in block.instructions.iter().chain([&block.terminator]) {
                let instruction = module.instruction(index);
                summary.size = summary.size.saturating_add(1);
                match instruction.opcode {
                    Op::FunctionCall => {
                        let callee = &self.calls.summaries[&module.operands(instruction)[0]];
                        summary.size = summary.size.saturating_add(callee.size);
                        summary.yields |= callee.yields;
                        summary.variables.extend(&callee.variables);
                    }
                    Op::TraceRayKHR
                    | Op::TraceNV
                    | Op::TraceRayMotionNV
                    | Op::TraceMotionNV
                    | Op::ExecuteCallableKHR
                    | Op::ExecuteCallableNV
                    | Op::ReportIntersectionKHR
                    | Op::RayQueryProceedKHR
                    | Op::ControlBarrier
                    | Op::ControlBarrierArriveINTEL
                    | Op::ControlBarrierWaitINTEL
                    | Op::EmitVertex
                    | Op::EndPrimitive
                    | Op::EmitStreamVertex
                    | Op::EndStreamPrimitive
                    | Op::EmitMeshTasksEXT => summary.yields = true,
                    opcode if is_hit_object(opcode) => summary.yields = true,
                    Op::IgnoreIntersectionKHR
                    | Op::IgnoreIntersectionNV
                    | Op::TerminateRayKHR
                    | Op::TerminateRayNV
                    | Op::Kill
                    | Op::TerminateInvocation => {
                        // An abort ends the invocation in every stage and stores the outputs.
                        summary.yields |= module.written_opcode(instruction) == newer::ABORT;
                        summary.variables.extend(self.output_variable());
                    }
                    _ => {}
                }
                let used = module.uses(instruction).iter();
                summary.variables.extend(used.filter(|id| {
                    let variable = self.variables.get(id);
                    variable.is_some_and(|variable| is_per_lane(variable.class))
                }));
            }
        }
        Ok(summary)
    }

    /// Decides whether a callee becomes a function of the IR. If so, opens that function's body and
    /// returns true. The call is lowered after that.
    pub(super) fn outline(&mut self, callee: Id) -> Result<bool, Error> {
        if self.calls.outlined.contains_key(&callee) {
            return Ok(false);
        }
        let summary = self.summary(callee)?;
        let sites = self.calls.call_sites.get(&callee).copied().unwrap_or(0);
        let fits = summary.size >= LARGE
            && !self.is_control()
            && !self.is_mesh()
            && sites > 1
            && !summary.yields
            && self.stage.ray_tmax.is_none()
            && self.is_carried_small(callee, &summary)?;
        if fits {
            self.open_outlined(callee, &summary)?;
        } else {
            self.calls.outlined.insert(callee, None);
        }
        Ok(fits)
    }

    fn is_carried_small(&self, callee: Id, summary: &Summary) -> Result<bool, Error> {
        let index = self.module.function_index[&callee];
        if self.is_large(self.module.functions[index].result_type) {
            return Ok(false);
        }
        let mut leaves = 0u64;
        for ty in self.parameter_types(callee)? {
            let counted = match self.types.kind(ty)? {
                TypeKind::Pointer { class, pointee } => match class {
                    StorageClass::Input => return Ok(false),
                    // Arrays of descriptors have no value form.
                    StorageClass::UniformConstant
                        if matches!(
                            self.types.kind(*pointee)?,
                            TypeKind::Array { .. } | TypeKind::RuntimeArray { .. }
                        ) =>
                    {
                        return Ok(false);
                    }
                    _ => self.per_lane_pointee(ty)?.unwrap_or(ty),
                },
                _ => ty,
            };
            leaves = leaves.saturating_add(self.types.info(counted)?.leaf_count);
        }
        for id in &summary.variables {
            let pointee = self.variables[id].pointee;
            leaves = leaves.saturating_add(self.types.info(pointee)?.leaf_count);
        }
        Ok(leaves <= MAX_CARRIED)
    }

    /// Whether two arguments that a call takes by value could be the same memory.
    fn may_alias(
        &mut self,
        outlined: &Outlined,
        callee: Id,
        arguments: &[Val],
    ) -> Result<bool, Error> {
        let mut seen: Vec<usize> = Vec::new();
        for id in outlined.carried.iter() {
            seen.push(self.module_local(*id)?);
        }
        let types = self.parameter_types(callee)?;
        for (argument, ty) in arguments.iter().zip(types) {
            if self.per_lane_pointee(ty)?.is_none() {
                continue;
            }
            match argument {
                Val::Pointer(Pointer {
                    place: MemoryLocation::Local { local, .. },
                    ..
                }) if !seen.contains(local) => seen.push(*local),
                _ => return Ok(true),
            }
        }
        Ok(false)
    }

    fn swap_scope(&mut self, scope: &mut Scope) {
        std::mem::swap(&mut self.b, &mut scope.builder);
        std::mem::swap(&mut self.frames, &mut scope.frames);
        std::mem::swap(&mut self.private.locals, &mut scope.locals);
        std::mem::swap(&mut self.private.module_locals, &mut scope.module_locals);
        std::mem::swap(&mut self.interface.input_locals, &mut scope.input_locals);
        std::mem::swap(
            &mut self.interface.helper_at_start,
            &mut scope.helper_at_start,
        );
        std::mem::swap(&mut self.stage.ray_tmax, &mut scope.ray_tmax);
    }

    /// Begins a callee as a function of its own.
    fn open_outlined(&mut self, callee: Id, summary: &Summary) -> Result<(), Error> {
        let name = self.module.annotations.name(callee).to_owned();
        let mut scope = Scope {
            builder: Builder::new(&name, self.b.remaining()),
            frames: Vec::new(),
            locals: Vec::new(),
            module_locals: HashMap::default(),
            input_locals: HashMap::default(),
            helper_at_start: None,
            ray_tmax: None,
        };
        self.swap_scope(&mut scope);
        let plan = self.plan(callee)?;
        let index = self.module.function_index[&callee];
        let function = &self.module.functions[index];
        let mut results: Vec<Type> = self.types.leaves(function.result_type)?.to_vec();
        let mut arguments = Vec::new();
        let mut pointers = Vec::new();
        for ty in self.parameter_types(callee)? {
            let Some(pointee) = self.per_lane_pointee(ty)? else {
                let values = self.new_params(ty)?;
                arguments.push(Self::scalars(values));
                continue;
            };
            let pointer = self.new_carried(pointee, &mut results)?.1;
            pointers.push(pointer.clone());
            arguments.push(Val::Pointer(pointer));
        }
        let carried: Rc<[Id]> = summary.variables.iter().copied().collect();
        for &id in carried.iter() {
            let pointee = self.variables[&id].pointee;
            let (local, _) = self.new_carried(pointee, &mut results)?;
            self.private.module_locals.insert(id, local);
        }
        self.b.function.results = results;
        let after = After::Outlined(Box::new(Outlining {
            callee,
            carried: carried.clone(),
            scope,
        }));
        let return_to = ReturnTo::Caller(Rc::new(ExtraResults { pointers, carried }));
        self.open_function(callee, plan, return_to, arguments, after)
    }

    /// Ends a function of the IR and returns to the open body of its first caller.
    pub(super) fn finish_outlined(
        &mut self,
        outlining: Outlining,
        end: ir::Terminator,
    ) -> Result<(), Error> {
        let Outlining {
            callee,
            carried,
            mut scope,
        } = outlining;
        self.swap_scope(&mut scope);
        let spent = self.b.remaining() - scope.builder.remaining();
        self.b.spend(spent)?;
        self.calls.functions.push(scope.builder.finish(end));
        // The entry is function 0.
        let id = FunctionId(self.calls.functions.len() as u32);
        self.calls
            .outlined
            .insert(callee, Some(Outlined { id, carried }));
        Ok(())
    }

    /// Per-lane memory that starts with the caller's values.
    fn new_carried(
        &mut self,
        pointee: Id,
        results: &mut Vec<Type>,
    ) -> Result<(usize, Pointer), Error> {
        results.extend_from_slice(&self.types.leaves(pointee)?);
        let values = self.new_params(pointee)?;
        let local = self.new_local("", pointee)?;
        let pointer = Pointer::new(pointee, MemoryLocation::Local { local, row: 0 });
        self.store(&pointer, &values)?;
        Ok((local, pointer))
    }

    fn new_params(&mut self, ty: Id) -> Result<Vec<Value>, Error> {
        let types = self.types.leaves(ty)?;
        let function = &mut self.b.function;
        let values: Vec<Value> = types.iter().map(|&ty| function.new_value(ty)).collect();
        function.params.extend_from_slice(&values);
        Ok(values)
    }

    /// The values that a function of the IR returns after its result.
    pub(super) fn extra_results(&mut self, given: &ExtraResults) -> Result<Vec<Value>, Error> {
        let mut values = Vec::new();
        for pointer in &given.pointers {
            values.extend(self.load(pointer)?);
        }
        for &id in given.carried.iter() {
            let pointer = self.module_pointer(id)?;
            values.extend(self.load(&pointer)?);
        }
        Ok(values)
    }

    fn emit_call(
        &mut self,
        outlined: &Outlined,
        callee: Id,
        arguments: &[Val],
    ) -> Result<Vec<Value>, Error> {
        let index = self.module.function_index[&callee];
        let mut types = self
            .types
            .leaves(self.module.functions[index].result_type)?
            .to_vec();
        let own = types.len();
        let mut operands = Vec::new();
        let mut pointers = Vec::new();
        let parameters = self.parameter_types(callee)?;
        for (argument, &ty) in arguments.iter().zip(&parameters) {
            let given = match argument {
                Val::Pointer(pointer) if self.per_lane_pointee(ty)?.is_some() => {
                    pointers.push(pointer.clone());
                    self.load(pointer)?.into_vec()
                }
                Val::Pointer(pointer) => self.pointer_scalars(pointer)?,
                Val::Scalars(values) => values.to_vec(),
                Val::Kept(_) => return Err(self.b.invalid("an argument has the wrong type")),
            };
            let wanted = self.per_lane_pointee(ty)?.unwrap_or(ty);
            let fits = self.types.leaves(wanted)?;
            let given_types = given.iter().map(|&value| self.b.ty(value));
            if !given_types.eq(fits.iter().copied()) {
                return Err(self.b.invalid("an argument has the wrong type"));
            }
            operands.extend(given);
        }
        for &id in outlined.carried.iter() {
            let pointer = self.module_pointer(id)?;
            operands.extend(self.load(&pointer)?);
            pointers.push(pointer);
        }
        for pointer in &pointers {
            types.extend_from_slice(&self.types.leaves(pointer.pointee)?);
        }
        if operands.len() as u64 > 4 * MAX_CARRIED {
            return Err(budget("a call takes too much"));
        }
        let op = ir::Op::Call(outlined.id);
        let results = self.b.emit_unchecked(op, &operands, &types)?;
        let mut at = own;
        for pointer in &pointers {
            let count = self.types.leaves(pointer.pointee)?.len();
            self.store(pointer, &results[at..at + count])?;
            at += count;
        }
        Ok(results[..own].to_vec())
    }
}
