//! The verifier: the rules for every module between passes. A verified module can be printed,
//! parsed, optimized and run without further checks.

use super::interface::{GeometryFacts, VaryingMode, VaryingPlace};
use super::signature::check_operation;
use super::tessellation::MAX_PATCH_VERTICES;
use super::{
    Body, Function, FunctionId, InputRow, Inst, Label, Module, Node, Op, Space, Step, Terminator,
    Type, Value,
};
use crate::ir::stage::Stage;
use crate::query::QueryWord;

/// Largest number of invocations of a workgroup.
pub const MAX_INVOCATIONS: u64 = 1 << 10;

/// Largest workgroup memory in bytes, above the devices' limits.
pub const MAX_SHARED_BYTES: u32 = 1 << 24;

/// Largest number of words of a location: a vertex attribute with four components of 64 bits.
const MAX_LOCATION_WORDS: u8 = 8;

/// Largest number of output words of an invocation.
const MAX_OUTPUT_ROWS: u32 = 1 << 15;

/// Rows of emitted vertices.
const MAX_EMITTED_ROWS: u64 = 1 << 15;

/// Largest number of geometry shader invocations for each primitive.
pub const MAX_GEOMETRY_INVOCATIONS: u32 = 127;

/// Checks a module against the rules of the [module's prose](super): types of operations, uses of
/// descriptors, visibility of values, labels that enclose their `br`, terminators, bounds of
/// variables, features of the stage, and no recursion.
///
/// # Errors
/// One sentence with the function, the position and the rule.
pub fn verify(module: &Module) -> Result<(), String> {
    let Some(entry) = module.functions.first() else {
        return Err("a module without an entry function".into());
    };
    if !entry.params.is_empty() || !entry.results.is_empty() {
        return Err("f0: the entry function has parameters or results".into());
    }
    if !has_shared(module.stage) && module.shared_size_bytes != 0 {
        return Err("only stages with workgroups have workgroup memory".into());
    }
    let invocations = module.local_size.iter().map(|&size| u64::from(size));
    let invocations = invocations.fold(1u64, |product, size| product.saturating_mul(size));
    if !(1..=MAX_INVOCATIONS).contains(&invocations)
        || module.shared_size_bytes > MAX_SHARED_BYTES
        || module.output_rows > MAX_OUTPUT_ROWS
    {
        return Err("the module's head is out of range".into());
    }
    let fits = match module.stage {
        Stage::Vertex | Stage::TessellationEvaluation | Stage::Fragment => {
            module.outputs.len() == module.output_rows as usize
        }
        Stage::Geometry => module.output_rows == 1,
        _ => module.outputs.is_empty(),
    };
    let is_control = module.stage == Stage::TessellationControl;
    let is_evaluation = module.stage == Stage::TessellationEvaluation;
    if !fits
        || module.fragment.is_some() != (module.stage == Stage::Fragment)
        || module.geometry.is_some() != (module.stage == Stage::Geometry)
        || module.tessellation.is_some() != (is_control || is_evaluation)
        || module.mesh.is_some() != matches!(module.stage, Stage::Task | Stage::Mesh)
    {
        return Err("outputs and facts do not fit the stage".into());
    }
    if let Some(facts) = &module.tessellation {
        let fits = match &facts.control {
            Some(control) => is_control && control.fits(module.shared_size_bytes),
            None => is_evaluation,
        };
        if !fits {
            return Err("a patch's values are out of range".into());
        }
    }
    if let Some(facts) = &module.geometry {
        check_geometry(facts, module.outputs.len())?;
    }
    if let Some(facts) = &module.mesh
        && !facts.fits(module.stage == Stage::Mesh, module.shared_size_bytes)
    {
        return Err("the values of a workgroup's primitives are out of range".into());
    }
    if let Some(facts) = &module.feedback {
        let has_stage = is_evaluation || matches!(module.stage, Stage::Vertex | Stage::Geometry);
        if !has_stage || !facts.fits() {
            return Err("what is captured does not fit".into());
        }
    }
    check_inputs(module)?;
    for (index, function) in module.functions.iter().enumerate() {
        let mut verifier = Verifier {
            module,
            function,
            is_entry: index == 0,
            visible: vec![false; function.value_types.len()],
            defined: vec![false; function.value_types.len()],
            scope: Vec::new(),
            labels: vec![Target::Unused; function.labels as usize],
        };
        verifier
            .check_function()
            .map_err(|message| format!("f{index}: {message}"))?;
    }
    check_call_graph(module)
}

/// The requirements for a `br` to a label.
#[derive(Clone)]
enum Target<'a> {
    Unused,
    /// Inside the construct: the values that the `br` defines.
    Open(&'a [Value]),
    Closed,
}

struct Verifier<'a> {
    module: &'a Module,
    function: &'a Function,
    is_entry: bool,
    /// Values that may be used here.
    visible: Vec<bool>,
    /// Values with an earlier definition.
    defined: Vec<bool>,
    /// The visible values in order of definition, truncated at a body's end.
    scope: Vec<Value>,
    labels: Vec<Target<'a>>,
}

impl<'a> Verifier<'a> {
    fn check_function(&mut self) -> Result<(), String> {
        let function = self.function;
        if function.results.contains(&Type::Descriptor) {
            return Err("a function cannot give a descriptor".into());
        }
        self.define_passed(&function.params)?;
        self.check_body(&function.body)
    }

    fn define(&mut self, value: Value) -> Result<(), String> {
        match self.defined.get_mut(value.index()) {
            None => return Err(format!("{value} is not in the table of types")),
            Some(defined) if *defined => return Err(format!("{value} is defined twice")),
            Some(defined) => *defined = true,
        }
        self.visible[value.index()] = true;
        self.scope.push(value);
        Ok(())
    }

    fn define_all(&mut self, values: &[Value]) -> Result<(), String> {
        values.iter().try_for_each(|&value| self.define(value))
    }

    /// Parameters and results of constructs, which may be anything except descriptors.
    fn define_passed(&mut self, values: &[Value]) -> Result<(), String> {
        self.define_all(values)?;
        match values.iter().find(|&&v| self.ty(v) == Type::Descriptor) {
            Some(value) => Err(format!("the descriptor {value} cannot be passed on")),
            None => Ok(()),
        }
    }

    fn check_use(&self, value: Value) -> Result<(), String> {
        match self.visible.get(value.index()) {
            Some(true) => Ok(()),
            Some(false) if self.defined[value.index()] => Err(format!(
                "{value} is used outside the construct that defines it"
            )),
            Some(false) => Err(format!("{value} is used before its definition")),
            None => Err(format!("{value} is not in the table of types")),
        }
    }

    fn ty(&self, value: Value) -> Type {
        self.function.ty(value)
    }

    fn open(&mut self, label: Label, values: &'a [Value]) -> Result<(), String> {
        match self.labels.get_mut(label.index()) {
            Some(target @ Target::Unused) => {
                *target = Target::Open(values);
                Ok(())
            }
            Some(_) => Err(format!("{label} names two constructs")),
            None => Err(format!("{label} is past the function's count of labels")),
        }
    }

    fn close(&mut self, label: Label) {
        self.labels[label.index()] = Target::Closed;
    }

    fn check_body(&mut self, body: &'a Body) -> Result<(), String> {
        // The number of visible values before each open body.
        let mut outside = vec![self.scope.len()];
        for step in body.steps() {
            match step {
                Step::Inst(inst) => self.check_inst(inst)?,
                Step::Open(node) => {
                    outside.push(self.scope.len());
                    self.open_construct(node)?;
                }
                Step::Else(_) => outside.push(self.scope.len()),
                Step::End(body) => {
                    self.check_terminator(&body.end)?;
                    self.leave(outside.pop().unwrap_or(0));
                }
                Step::Close(node) => {
                    node.label().into_iter().for_each(|label| self.close(label));
                    if let Node::Block { results, .. } | Node::If { results, .. } = node {
                        self.define_passed(results)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn open_construct(&mut self, node: &'a Node) -> Result<(), String> {
        match node {
            Node::Inst(_) => Ok(()),
            Node::Block { label, results, .. } => {
                self.check_declared(results)?;
                self.open(*label, results)
            }
            Node::If {
                condition,
                label,
                results,
                ..
            } => {
                self.check_condition(*condition)?;
                self.check_declared(results)?;
                self.open(*label, results)
            }
            Node::Loop {
                label,
                params,
                init,
                ..
            } => {
                self.check_declared(params)?;
                self.check_passed(*label, init, params)?;
                self.open(*label, params)?;
                self.define_passed(params)
            }
        }
    }

    /// Hides the values defined since the scope had this length.
    fn leave(&mut self, length: usize) {
        for value in self.scope.drain(length..) {
            self.visible[value.index()] = false;
        }
    }

    fn check_declared(&self, values: &[Value]) -> Result<(), String> {
        match values
            .iter()
            .find(|value| value.index() >= self.defined.len())
        {
            Some(value) => Err(format!("{value} is not in the table of types")),
            None => Ok(()),
        }
    }

    fn check_condition(&self, condition: Value) -> Result<(), String> {
        self.check_use(condition)?;
        match self.ty(condition) {
            Type::I1 => Ok(()),
            ty => Err(format!("the condition {condition} is {ty}")),
        }
    }

    /// Checks the operands of a `br`, or a loop's initial values, against the values they define.
    fn check_passed(&self, label: Label, passed: &[Value], taken: &[Value]) -> Result<(), String> {
        if passed.len() != taken.len() {
            return Err(format!(
                "{label} takes {} values and is given {}",
                taken.len(),
                passed.len()
            ));
        }
        for (&from, &to) in passed.iter().zip(taken) {
            self.check_use(from)?;
            if self.ty(from) != self.ty(to) {
                return Err(format!(
                    "{label}: {from} is {} and {to} is {}",
                    self.ty(from),
                    self.ty(to)
                ));
            }
        }
        Ok(())
    }

    fn check_terminator(&self, end: &Terminator) -> Result<(), String> {
        match end {
            Terminator::Br(label, args) => match self.labels.get(label.index()) {
                Some(Target::Open(values)) => self.check_passed(*label, args, values),
                _ => Err(format!("br {label} outside its construct")),
            },
            Terminator::Return(args) => {
                if self.is_entry {
                    return Err("the entry function returns instead of ending".into());
                }
                for &arg in args {
                    self.check_use(arg)?;
                }
                let types = args.iter().map(|&arg| self.ty(arg));
                if !types.eq(self.function.results.iter().copied()) {
                    return Err("return does not match the function's results".into());
                }
                Ok(())
            }
            Terminator::End(args) => {
                for &arg in args {
                    self.check_use(arg)?;
                    if !matches!(self.ty(arg), Type::I32 | Type::F32) {
                        return Err(format!("end: {arg} is {}, not a word", self.ty(arg)));
                    }
                }
                if args.len() != self.module.output_rows as usize {
                    return Err(format!(
                        "end has {} operands, the module {} output rows",
                        args.len(),
                        self.module.output_rows
                    ));
                }
                Ok(())
            }
            Terminator::Unreachable => Ok(()),
        }
    }

    fn check_inst(&mut self, inst: &Inst) -> Result<(), String> {
        for &arg in &inst.args {
            self.check_use(arg)
                .map_err(|message| format!("{}: {message}", inst.op.text()))?;
        }
        self.check_declared(&inst.results)?;
        check_stage(self.module.stage, &inst.op)
            .and_then(|()| check_operation(self.module, self.function, inst))
            .map_err(|message| describe(self.function, inst, &message))?;
        self.define_all(&inst.results)
    }
}

/// A geometry shader must take existing primitives, and its vertices must fit in memory.
fn check_geometry(facts: &GeometryFacts, outputs: usize) -> Result<(), String> {
    let rows = (u64::from(facts.max_vertices) + 1).saturating_mul(outputs as u64 + 1);
    let fits = matches!(facts.vertices, 1 | 2 | 3 | 4 | 6)
        && (1..=MAX_GEOMETRY_INVOCATIONS).contains(&facts.invocations)
        && rows <= MAX_EMITTED_ROWS;
    match fits {
        true => Ok(()),
        false => Err("a geometry shader's primitives are out of range".into()),
    }
}

/// Input rows and words of ray queries must exist; rows from the rasterizer are allowed only in its
/// stages.
fn check_inputs(module: &Module) -> Result<(), String> {
    let fits = module.inputs.iter().all(|row| match row {
        InputRow::Builtin(builtin, word) => *word < builtin.words(),
        InputRow::Attribute { component, .. } => {
            module.stage == Stage::Vertex && *component < MAX_LOCATION_WORDS
        }
        InputRow::Varying(varying) => {
            let is_at_location = matches!(
                varying.place,
                VaryingPlace::Location(_) | VaryingPlace::Patch(_) | VaryingPlace::Primitive(_)
            );
            let is_of_patch = matches!(
                varying.place,
                VaryingPlace::Patch(_)
                    | VaryingPlace::TessLevelOuter
                    | VaryingPlace::TessLevelInner
            );
            let is_of_primitive = matches!(varying.place, VaryingPlace::Primitive(_));
            let is_known = match (module.geometry, varying.mode) {
                (_, mode) if is_of_primitive => {
                    module.stage == Stage::Fragment && mode == VaryingMode::Flat
                }
                (Some(facts), VaryingMode::PerVertex(vertex)) => {
                    !is_of_patch && u32::from(vertex) < facts.vertices
                }
                (Some(_), _) => false,
                (None, mode) if module.stage == Stage::TessellationEvaluation => match mode {
                    VaryingMode::PerVertex(vertex) => {
                        !is_of_patch && u32::from(vertex) < MAX_PATCH_VERTICES
                    }
                    _ => is_of_patch,
                },
                (None, mode) => {
                    let is_seen = !is_of_patch
                        && !matches!(
                            varying.place,
                            VaryingPlace::Position | VaryingPlace::PointSize
                        );
                    let is_corner = !matches!(mode, VaryingMode::PerVertex(3..));
                    module.stage == Stage::Fragment && is_seen && is_corner
                }
            };
            is_known && (!is_at_location || varying.component < MAX_LOCATION_WORDS)
        }
        InputRow::Barycentric(it) => module.stage == Stage::Fragment && it.vertex < 3,
        // Words past the caller's end are zero.
        InputRow::Payload(_) | InputRow::HitAttribute(_) | InputRow::CallableData(_) => true,
    });
    if !fits {
        return Err("an input row that the stage does not have".into());
    }
    let known = |word: &QueryWord| usize::from(word.component) < word.fact.words();
    match module.query_words.iter().all(known) {
        true => Ok(()),
        false => Err("a word of a ray query that its fact does not have".into()),
    }
}

/// Whether invocations of the stage form a workgroup, with memory and barriers.
fn has_shared(stage: Stage) -> bool {
    stage.has_workgroups() || stage == Stage::TessellationControl
}

/// Checks that the stage's scheduler can answer the operation, and that the stage has its memory.
fn check_stage(stage: Stage, op: &Op) -> Result<(), String> {
    let traces = matches!(
        stage,
        Stage::RayGeneration | Stage::ClosestHit | Stage::Miss
    );
    let fits = match op {
        Op::Load(access) | Op::Store(access) | Op::Atomic(_, access) => {
            access.space != Space::Shared || has_shared(stage)
        }
        Op::Barrier => has_shared(stage),
        Op::BarrierArrive | Op::BarrierWait => stage == Stage::Compute,
        Op::Demote | Op::IsHelper => stage == Stage::Fragment,
        Op::Emit => stage == Stage::Geometry,
        Op::RayQueryProceed => true,
        Op::ReportIntersection => stage == Stage::Intersection,
        Op::ExecuteCallable => traces || stage == Stage::Callable,
        Op::ReorderThread => stage == Stage::RayGeneration,
        op if op.is_yield() => traces,
        _ => true,
    };
    if fits {
        return Ok(());
    }
    Err("not in this stage".into())
}

/// Adds the instruction, with types, to a message.
fn describe(function: &Function, inst: &Inst, message: &str) -> String {
    let list = |values: &[Value]| -> String {
        let parts: Vec<String> = values
            .iter()
            .map(|&value| format!("{value}: {}", function.ty(value)))
            .collect();
        parts.join(", ")
    };
    format!(
        "{} ({}) -> ({}): {message}",
        inst.op.text(),
        list(&inst.args),
        list(&inst.results)
    )
}

/// Shaders cannot recurse, because frames are static.
fn check_call_graph(module: &Module) -> Result<(), String> {
    let callees: Vec<Vec<FunctionId>> = module.functions.iter().map(called_functions).collect();
    #[derive(Clone, Copy, PartialEq)]
    enum VisitState {
        New,
        Open,
        Done,
    }
    let mut states = vec![VisitState::New; callees.len()];
    for root in 0..callees.len() {
        if states[root] != VisitState::New {
            continue;
        }
        states[root] = VisitState::Open;
        let mut stack = vec![(root, 0)];
        while let Some((function, next)) = stack.last_mut() {
            match callees[*function].get(*next) {
                Some(callee) => {
                    *next += 1;
                    match states[callee.index()] {
                        VisitState::New => {
                            states[callee.index()] = VisitState::Open;
                            stack.push((callee.index(), 0));
                        }
                        VisitState::Open => return Err(format!("{callee} calls itself")),
                        VisitState::Done => {}
                    }
                }
                None => {
                    states[*function] = VisitState::Done;
                    stack.pop();
                }
            }
        }
    }
    Ok(())
}

/// The functions that a function calls, once each call.
fn called_functions(function: &Function) -> Vec<FunctionId> {
    let mut calls = Vec::new();
    function.body.visit_insts(&mut |inst| {
        if let Op::Call(callee) = inst.op {
            calls.push(callee);
        }
    });
    calls
}
