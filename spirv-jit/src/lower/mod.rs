//! Lowers a parsed SPIR-V module to the IR.
//!
//! ```text
//! types, constants ([`types`], [`constants`], [`fold`])  specialized, in order
//!   └─ the entry's variables ([`interface`])
//!        └─ functions: a tree of bodies ([`structure`], [`join_points`]), emitted along it
//!           ([`function`])
//!             └─ instructions by group: a table ([`instruction`]) and a file a group
//! ```
//!
//! Vectors, matrices and aggregates are taken apart into scalars. A logical pointer is known at
//! compile time except its computed parts ([`values`]). An id with uses after the construct that
//! defines it, and every phi, goes through a variable, which promotion turns into SSA again.

#![forbid(unsafe_code)]

mod abort;
mod arithmetic;
mod atomic;
mod barrier;
mod bfloat16;
mod buffer;
mod builder;
mod builtin;
mod call;
mod capability;
mod composite;
mod constants;
mod convert;
mod cooperative_matrix;
mod cooperative_vector;
mod debug_printf;
mod define_constant;
mod denormals;
mod derivative;
mod descriptor_heap;
mod emission;
mod entry;
mod facts;
mod flow;
mod fold;
mod fragment;
mod frame;
mod function;
mod glsl;
mod hit_object;
mod id_table;
mod image;
mod instruction;
mod interface;
mod interpolate;
mod join_points;
mod large;
mod layout;
mod matrix;
mod memory;
mod mesh;
mod opaque;
mod patch;
mod phi;
mod pointer;
mod ray;
mod ray_query;
mod stage_interface;
mod structure;
mod subgroup;
mod transform_feedback;
mod types;
mod values;

pub use self::capability::SUPPORTED as SUPPORTED_CAPABILITIES;
pub use self::types::MAX_COMPONENTS as MAX_VECTOR_COMPONENTS;

use foldhash::HashMap;
use std::rc::Rc;

use rspirv::spirv::{Capability, Op, StorageClass};

use self::builder::Builder;
use self::call::{Outlined, Summary};
use self::constants::Constants;
use self::emission::Emission;
use self::frame::{FunctionFrame, OpenBody};
use self::id_table::IdTable;
use self::layout::TypeLayout;
use self::phi::PhiSources;
use self::stage_interface::{Evaluation, InterfaceWord};
use self::structure::Plan;
use self::types::{FEW_COMPONENTS, Types, UNTYPED};
use self::values::{Local, MemoryLocation, Val};
use crate::error::ErrorKind;
use crate::ir::InputRow;
use crate::ir::interface::OutputRow;
use crate::ir::mesh::MeshFacts;
use crate::ir::op::VectorProduct;
use crate::ir::tessellation::TessellationFacts;
use crate::parse::{EntryPoint, Id, ParsedModule};
use crate::query::QueryWord;
use crate::request::CompileRequest;
use crate::{Error, ir};

/// Lowers the code that the entry point reaches.
///
/// # Errors
/// A request of the module that the IR cannot express, or an ill-typed module.
pub fn lower_module(
    parsed: &ParsedModule,
    request: &CompileRequest<'_>,
) -> Result<ir::Module, Error> {
    capability::check_capabilities(parsed, request)?;
    let entry = entry::find_entry(parsed, request)?;
    let mut lowerer = Lowerer::new(parsed, request, entry)?;
    lowerer.check_calls(entry.function)?;
    let end = lowerer
        .lower_entry(entry.function)
        .map_err(|error| lowerer.locate(error))?;
    lowerer.finish(end)
}

/// An error for code that is well-formed but too large.
fn budget(message: &str) -> Error {
    Error {
        kind: ErrorKind::Budget,
        word_offset: None,
        message: message.to_owned(),
    }
}

/// A variable of the module.
#[derive(Clone, Copy, Debug)]
struct ModuleVariable {
    class: StorageClass,
    pointee: Id,
    initializer: Option<Id>,
}

/// The state of lowering one entry point.
struct Lowerer<'a> {
    module: &'a ParsedModule,
    request: &'a CompileRequest<'a>,
    entry: &'a EntryPoint,
    types: Types,
    constants: Constants,
    variables: HashMap<Id, ModuleVariable>,
    plans: HashMap<Id, Rc<Plan>>,
    /// The entry function, with inlined calls.
    b: Builder,
    /// The functions in progress, innermost last.
    frames: Vec<FunctionFrame>,
    /// The bodies in progress, innermost last.
    open: Vec<OpenBody>,
    /// The values of ids, of all frames, innermost last.
    values: IdTable<Val>,
    phi_sources: PhiSources,
    /// The contents of ray query objects after their fixed rows, in order.
    query_words: Vec<QueryWord>,
    private: PrivateMemory,
    workgroup: WorkgroupMemory,
    interface: EntryInterface,
    stage: StageState,
    calls: Calls,
}

/// Per-lane memory.
#[derive(Default)]
struct PrivateMemory {
    locals: Vec<Local>,
    /// Memory of module variables, made at their first use.
    module_locals: HashMap<Id, usize>,
    /// Rows so far.
    rows: u64,
}

/// Workgroup memory, or a patch.
#[derive(Default)]
struct WorkgroupMemory {
    /// Byte offset of each variable.
    offsets: HashMap<Id, u32>,
    size_bytes: u32,
    /// Offset of the shader's own variables.
    base: u32,
    /// Variables are blocks with explicit layout (`SPV_KHR_workgroup_memory_explicit_layout`).
    has_layout: bool,
}

/// Inputs and outputs of the entry point.
#[derive(Default)]
struct EntryInterface {
    /// The contents of each row of an input or output variable.
    words: HashMap<Id, Rc<[InterfaceWord]>>,
    inputs: Vec<InputRow>,
    input_index: HashMap<InputRow, u32>,
    /// Copies of inputs in per-lane memory, for computed indices.
    input_locals: HashMap<(Id, Evaluation), usize>,
    /// `HelperInvocation` of a shader that may demote.
    helper_at_start: Option<ir::Value>,
    output_rows: u32,
    /// Drawing stages: each output word, and the output variables in order.
    outputs: Vec<OutputRow>,
    output_variables: Vec<Id>,
    /// Input attachments are read.
    reads_attachments: bool,
}

/// The state of single stages.
#[derive(Default)]
struct StageState {
    tessellation: Option<TessellationFacts>,
    /// Task and mesh stages.
    mesh: Option<MeshFacts>,
    /// Geometry stages.
    emission: Option<Emission>,
    /// `RayTmaxKHR` of an intersection shader that reads it.
    ray_tmax: Option<ir::VariableId>,
}

/// Functions besides the entry, and the calls of them.
#[derive(Default)]
struct Calls {
    functions: Vec<ir::Function>,
    summaries: HashMap<Id, Rc<Summary>>,
    /// Callees with a decision; `None` is inlined.
    outlined: HashMap<Id, Option<Outlined>>,
    /// Call instructions by callee.
    call_sites: HashMap<Id, u32>,
}

impl<'a> Lowerer<'a> {
    /// Operations per instruction of the module that lowering may emit, beyond a fixed allowance.
    const GROWTH: usize = 64;
    /// Extra operations per instruction for each component of the longest vector above four.
    const GROWTH_OF_COMPONENT: usize = 4;
    /// Largest extra budget of operations for long vectors.
    const MAX_LONG_GROWTH: usize = 8_000_000;

    fn new(
        module: &'a ParsedModule,
        request: &'a CompileRequest<'a>,
        entry: &'a EntryPoint,
    ) -> Result<Self, Error> {
        let allowance = 200_000 + Self::GROWTH * module.instruction_count();
        let mut lowerer = Self {
            module,
            request,
            entry,
            types: Types::default(),
            constants: Constants::default(),
            variables: HashMap::default(),
            plans: HashMap::default(),
            b: Builder::new(&entry.name, allowance),
            frames: Vec::new(),
            open: Vec::new(),
            values: IdTable::default(),
            phi_sources: PhiSources::default(),
            query_words: ray_query::find_query_words(module),
            private: PrivateMemory::default(),
            workgroup: WorkgroupMemory::default(),
            interface: EntryInterface::default(),
            stage: StageState::default(),
            calls: Calls::default(),
        };
        lowerer.types.query_rows = Self::query_rows(&lowerer.query_words);
        lowerer.types.has_wide_offsets = lowerer.indexes_in_64_bits();
        lowerer.constants.flushes_denormals = lowerer.has_flush_mode();
        let has = |wanted: Capability| module.capabilities.iter().any(|it| it.0 == wanted);
        lowerer.types.components = if has(Capability::LongVectorEXT) {
            [1, MAX_VECTOR_COMPONENTS]
        } else if has(Capability::CooperativeVectorNV) {
            // A cooperative vector is a vector of any number of components.
            [1, VectorProduct::MAX_COMPONENTS as u32]
        } else {
            [2, FEW_COMPONENTS]
        };
        lowerer.declare_globals()?;
        lowerer.allow_long_vectors();
        Ok(lowerer)
    }

    /// Increases the budget for long vectors, since an instruction emits operations for each
    /// component.
    fn allow_long_vectors(&mut self) {
        let components = self.types.longest_vector().saturating_sub(4) as usize;
        let more = self.module.instruction_count().saturating_mul(components);
        let more = more.saturating_mul(Self::GROWTH_OF_COMPONENT);
        self.b.allow(more.min(Self::MAX_LONG_GROWTH));
    }

    fn layout(&self) -> TypeLayout<'_> {
        TypeLayout {
            types: &self.types,
            annotations: &self.module.annotations,
            constants: &self.constants,
            has_strides: true,
        }
    }

    /// The layout of workgroup memory.
    fn shared_layout(&self) -> TypeLayout<'_> {
        TypeLayout {
            has_strides: self.workgroup.has_layout,
            ..self.layout()
        }
    }

    /// The layout of the memory of a location.
    fn layout_in(&self, place: &MemoryLocation) -> TypeLayout<'_> {
        match place {
            MemoryLocation::Shared { .. } => self.shared_layout(),
            _ => self.layout(),
        }
    }

    /// Types, constants and variables, in the module's order.
    fn declare_globals(&mut self) -> Result<(), Error> {
        let module = self.module;
        for &index in &module.globals {
            let instruction = module.instruction(index);
            let at = instruction.offset;
            self.b.source = at;
            let operands = module.operands(instruction);
            let locate = |mut error: Error| {
                error.word_offset = Some(at);
                error
            };
            match instruction.opcode {
                Op::TypeForwardPointer => {
                    self.types.declare_forward(operands[0], operands[1], at)?;
                }
                Op::Variable | Op::UntypedVariableKHR => {
                    let (class, mut pointee) = self
                        .types
                        .pointer(instruction.result_type)
                        .map_err(locate)?;
                    let mut rest = &operands[1..];
                    if instruction.opcode == Op::UntypedVariableKHR {
                        let is_heap = self.heap_of(instruction.result).is_some();
                        (pointee, rest) = match rest.split_first() {
                            Some((&data, after)) => (data, after),
                            None if is_heap => (UNTYPED, rest),
                            None => {
                                let message = "an untyped variable without a data type";
                                return Err(Error::unsupported(at, message));
                            }
                        };
                    }
                    if pointee != UNTYPED {
                        self.types.info(pointee).map_err(locate)?;
                        self.check_variable(class, pointee)?;
                    }
                    let variable = ModuleVariable {
                        class,
                        pointee,
                        initializer: rest.first().copied(),
                    };
                    self.variables.insert(instruction.result, variable);
                }
                // Extended instructions at module scope are non-semantic.
                Op::ExtInst | Op::ExtInstWithForwardRefsKHR => {}
                _ => {
                    let specialization = self.request.specialization;
                    let constants = &mut self.constants;
                    let defined =
                        constants.define(module, &self.types, specialization, instruction);
                    if !defined.map_err(locate)? {
                        let named = match instruction.opcode {
                            Op::TypeArray | Op::TypeVectorIdEXT => &operands[1..2],
                            Op::TypeCooperativeMatrixKHR => &operands[1..],
                            _ => &[],
                        };
                        let sizes: Result<Vec<u32>, Error> = (named.iter())
                            .map(|&id| self.constants.unsigned(&self.types, id))
                            .collect();
                        let sizes = sizes.map_err(locate)?;
                        if instruction.opcode == Op::TypeArray && sizes == [0] {
                            return Err(Error::invalid(at, "an array has no elements"));
                        }
                        let declared = self.types.declare(module, instruction, &sizes);
                        declared.map_err(locate)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Adds the current source position to an error without one.
    fn locate(&self, mut error: Error) -> Error {
        if error.word_offset.is_none_or(|offset| offset == 0) && self.b.source != 0 {
            error.word_offset = Some(self.b.source);
        }
        error
    }

    fn finish(mut self, end: ir::Terminator) -> Result<ir::Module, Error> {
        let (local_size, shared_size_bytes) = (self.local_size()?, self.workgroup.size_bytes);
        let has_workgroups = self.request.stage.has_workgroups();
        let quads = has_workgroups && self.derivative_group() == Some(true);
        let fragment = self.fragment_facts();
        let feedback = self.feedback_facts()?;
        let geometry = self.stage.emission.as_ref().map(|emission| emission.facts);
        let builder = std::mem::replace(&mut self.b, Builder::new("", 0));
        let mut functions = vec![builder.finish(end)];
        functions.append(&mut self.calls.functions);
        Ok(ir::Module {
            stage: self.request.stage,
            functions,
            inputs: self.interface.inputs,
            query_words: self.query_words,
            output_rows: self.interface.output_rows,
            outputs: self.interface.outputs,
            tessellation: self.stage.tessellation,
            geometry,
            mesh: self.stage.mesh,
            feedback,
            fragment,
            local_size,
            quads,
            shared_size_bytes,
        })
    }

    /// Refuses recursion, and counts the call sites of each function.
    fn check_calls(&mut self, entry: Id) -> Result<(), Error> {
        // 1: on the path, 2: done.
        let mut state: HashMap<Id, u8> = HashMap::default();
        let mut path: Vec<(Id, Vec<Id>)> = vec![(entry, self.callees(entry)?)];
        state.insert(entry, 1);
        while let Some((function, rest)) = path.last_mut() {
            let Some(callee) = rest.pop() else {
                state.insert(*function, 2);
                path.pop();
                continue;
            };
            *self.calls.call_sites.entry(callee).or_default() += 1;
            match state.get(&callee) {
                Some(1) => return Err(Error::invalid(0, "a function calls itself")),
                Some(_) => {}
                None => {
                    state.insert(callee, 1);
                    let callees = self.callees(callee)?;
                    path.push((callee, callees));
                }
            }
        }
        Ok(())
    }

    fn callees(&self, function: Id) -> Result<Vec<Id>, Error> {
        let found = self.module.function_index.get(&function);
        let Some(&index) = found else {
            return Err(Error::invalid(0, format!("{function} is not a function")));
        };
        let blocks = &self.module.functions[index].blocks;
        let instructions = blocks.iter().flat_map(|block| &block.instructions);
        Ok(instructions
            .map(|&index| self.module.instruction(index))
            .filter(|instruction| instruction.opcode == Op::FunctionCall)
            .map(|instruction| self.module.operands(instruction)[0])
            .collect())
    }

    /// Scalars as a value.
    fn scalars(values: impl AsRef<[ir::Value]>) -> Val {
        Val::Scalars(values.as_ref().into())
    }
}
