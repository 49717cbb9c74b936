//! A module's instructions by section, function and block.

use foldhash::HashMap;

use rspirv::spirv::{Capability, ExecutionModel, Op};

use super::annotations::Annotations;
use super::framing;
use super::grammar::opcode_name;
use super::instruction::{Id, Instruction, InstructionTable, decode_string};
use super::newer::NewerCapability;
use crate::Error;

/// `OpEntryPoint`.
#[derive(Clone, Debug)]
pub struct EntryPoint {
    pub model: ExecutionModel,
    pub function: Id,
    pub name: String,
    /// The interface variables.
    pub interface: Vec<Id>,
    pub offset: u32,
}

/// A merge instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merge {
    /// Merge block.
    Selection(Id),
    /// Merge block and continue target.
    Loop(Id, Id),
}

/// A basic block, without debug instructions.
#[derive(Clone, Debug)]
pub struct Block {
    pub label: Id,
    pub offset: u32,
    /// Indices of its instructions, without label, merge and terminator.
    pub instructions: Vec<u32>,
    pub merge: Option<Merge>,
    /// Index of its last instruction.
    pub terminator: u32,
}

/// A function definition.
#[derive(Clone, Debug)]
pub struct Function {
    pub id: Id,
    pub result_type: Id,
    pub function_type: Id,
    pub params: Vec<Id>,
    pub blocks: Vec<Block>,
    /// Index in `blocks` by label.
    pub block_index: HashMap<Id, usize>,
    pub offset: u32,
}

impl Block {
    /// An empty block of a label.
    fn new(label: &Instruction) -> Block {
        Block {
            label: label.result,
            offset: label.offset,
            instructions: Vec::new(),
            merge: None,
            terminator: 0,
        }
    }
}

impl Function {
    /// A function without parameters and blocks.
    fn new(instruction: &Instruction, function_type: Id) -> Function {
        Function {
            id: instruction.result,
            result_type: instruction.result_type,
            function_type,
            params: Vec::new(),
            blocks: Vec::new(),
            block_index: HashMap::default(),
            offset: instruction.offset,
        }
    }

    fn push(&mut self, block: Block) {
        self.block_index.insert(block.label, self.blocks.len());
        self.blocks.push(block);
    }
}

/// A parsed module. Grammar, sections and blocks are checked; types are not.
pub struct ParsedModule {
    pub words: Vec<u32>,
    pub version: (u8, u8),
    pub bound: u32,
    /// With the word offset of the declaration.
    pub capabilities: Vec<(Capability, u32)>,
    /// Capabilities that the bindings lack.
    pub newer_capabilities: Vec<(NewerCapability, u32)>,
    /// With the word offset of the declaration.
    pub extensions: Vec<(String, u32)>,
    /// Imported sets of extended instructions, by id.
    pub instruction_sets: HashMap<Id, String>,
    pub entry_points: Vec<EntryPoint>,
    /// Indices of `OpExecutionMode` and `OpExecutionModeId`.
    pub execution_modes: Vec<u32>,
    pub annotations: Annotations,
    /// Indices of types, constants and module-scope variables, in order.
    pub globals: Vec<u32>,
    pub functions: Vec<Function>,
    /// Index in `functions` by id.
    pub function_index: HashMap<Id, usize>,
    table: InstructionTable,
    /// Index of the defining instruction by id; `u32::MAX` = none.
    definitions: Vec<u32>,
}

impl ParsedModule {
    /// An instruction by index.
    pub fn instruction(&self, index: u32) -> &Instruction {
        &self.table.instructions[index as usize]
    }

    /// An instruction's operand words after result type and result.
    pub fn operands(&self, instruction: &Instruction) -> &[u32] {
        instruction.operands(&self.words)
    }

    /// The opcode in the module's words. [`Instruction::opcode`] is a substitute for instructions
    /// that the bindings lack.
    pub(crate) fn written_opcode(&self, instruction: &Instruction) -> u32 {
        self.words[instruction.offset as usize] & 0xffff
    }

    /// Ids among an instruction's operands.
    pub fn uses(&self, instruction: &Instruction) -> &[Id] {
        &self.table.uses[instruction.first_use as usize..instruction.end_use as usize]
    }

    /// Index of the instruction that defines an id.
    pub fn definition(&self, id: Id) -> Option<u32> {
        let index = *self.definitions.get(id as usize)?;
        (index != u32::MAX).then_some(index)
    }

    /// Number of instructions.
    pub fn instruction_count(&self) -> usize {
        self.table.instructions.len()
    }
}

/// Sorts checked instructions into a module.
pub(super) fn sort_module(words: &[u32], table: InstructionTable) -> Result<ParsedModule, Error> {
    let bound = words[3];
    let definitions = index_definitions(&table, bound)?;
    check_uses(&table, &definitions)?;
    let annotations = Annotations::collect(words, &table)?;
    let mut module = ParsedModule {
        words: words.to_vec(),
        version: framing::version(words),
        bound,
        capabilities: Vec::new(),
        newer_capabilities: Vec::new(),
        extensions: Vec::new(),
        instruction_sets: HashMap::default(),
        entry_points: Vec::new(),
        execution_modes: Vec::new(),
        annotations,
        globals: Vec::new(),
        functions: Vec::new(),
        function_index: HashMap::default(),
        definitions,
        table: InstructionTable {
            instructions: Vec::new(),
            uses: Vec::new(),
        },
    };
    let first_function = table
        .instructions
        .iter()
        .position(|i| i.opcode == Op::Function)
        .unwrap_or(table.instructions.len());
    for index in 0..first_function {
        sort_global(&mut module, index as u32, &table.instructions[index]);
    }
    module.table = table;
    sort_functions(&mut module, first_function)?;
    Ok(module)
}

fn index_definitions(table: &InstructionTable, bound: u32) -> Result<Vec<u32>, Error> {
    let mut definitions = vec![u32::MAX; bound as usize];
    for (index, instruction) in table.instructions.iter().enumerate() {
        // Every result has an id in bounds; opcodes without a result have 0.
        if instruction.result == 0 {
            continue;
        }
        let Some(slot) = definitions.get_mut(instruction.result as usize) else {
            let message = format!("id {} is beyond the bound", instruction.result);
            return Err(Error::invalid(instruction.offset, message));
        };
        if *slot != u32::MAX {
            let message = format!("id {} is defined twice", instruction.result);
            return Err(Error::invalid(instruction.offset, message));
        }
        *slot = index as u32;
    }
    Ok(definitions)
}

fn check_uses(table: &InstructionTable, definitions: &[u32]) -> Result<(), Error> {
    for instruction in &table.instructions {
        if is_annotation(instruction.opcode) {
            continue;
        }
        let used = &table.uses[instruction.first_use as usize..instruction.end_use as usize];
        let with_type = used.iter().copied().chain([instruction.result_type]);
        for id in with_type.filter(|&id| id != 0) {
            if definitions
                .get(id as usize)
                .is_none_or(|&at| at == u32::MAX)
            {
                let message = format!("id {id} is not defined");
                return Err(Error::invalid(instruction.offset, message));
            }
        }
    }
    Ok(())
}

/// Debug information and decorations, whose ids need not exist.
fn is_annotation(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::Name
            | Op::MemberName
            | Op::Decorate
            | Op::DecorateId
            | Op::DecorateString
            | Op::MemberDecorate
            | Op::MemberDecorateIdEXT
            | Op::MemberDecorateString
            | Op::GroupDecorate
            | Op::GroupMemberDecorate
            | Op::Line
            | Op::Source
    )
}

fn sort_global(module: &mut ParsedModule, index: u32, instruction: &Instruction) {
    let operands = instruction.operands(&module.words);
    let offset = instruction.offset;
    match instruction.opcode {
        Op::Capability => {
            if let Some(capability) = Capability::from_u32(operands[0]) {
                module.capabilities.push((capability, offset));
            }
            if let Some(capability) = NewerCapability::from_u32(operands[0]) {
                module.newer_capabilities.push((capability, offset));
            }
        }
        Op::Extension => module.extensions.push((decode_string(operands), offset)),
        Op::ExtInstImport => {
            let name = decode_string(operands);
            module.instruction_sets.insert(instruction.result, name);
        }
        Op::EntryPoint => {
            if let Some(model) = ExecutionModel::from_u32(operands[0]) {
                let name = decode_string(&operands[2..]);
                let name_words = name.len() / 4 + 1;
                module.entry_points.push(EntryPoint {
                    model,
                    function: operands[1],
                    interface: operands.get(2 + name_words..).unwrap_or(&[]).to_vec(),
                    name,
                    offset,
                });
            }
        }
        Op::ExecutionMode | Op::ExecutionModeId => module.execution_modes.push(index),
        opcode if is_annotation(opcode) || is_debug(opcode) => {}
        Op::MemoryModel => {}
        _ => module.globals.push(index),
    }
}

fn is_debug(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::Nop
            | Op::NoLine
            | Op::String
            | Op::SourceContinued
            | Op::SourceExtension
            | Op::ModuleProcessed
            | Op::DecorationGroup
    )
}

fn sort_functions(module: &mut ParsedModule, first: usize) -> Result<(), Error> {
    let mut current: Option<Function> = None;
    let mut open: Option<Block> = None;
    let mut is_dead = false;
    let mut end = 0;
    let count = module.table.instructions.len();
    for index in first..count {
        let instruction = module.table.instructions[index];
        let offset = instruction.offset;
        end = offset;
        let misplaced = || {
            let name = opcode_name(instruction.opcode);
            Error::invalid(offset, format!("misplaced {name}"))
        };
        let operands = instruction.operands(&module.words);
        is_dead &= !matches!(instruction.opcode, Op::Label | Op::FunctionEnd);
        if is_dead {
            continue;
        }
        match instruction.opcode {
            Op::Function if current.is_none() => {
                current = Some(Function::new(&instruction, operands[1]));
            }
            Op::FunctionParameter => match &mut current {
                Some(function) if open.is_none() && function.blocks.is_empty() => {
                    function.params.push(instruction.result);
                }
                _ => return Err(misplaced()),
            },
            Op::FunctionEnd => match current.take() {
                Some(function) if open.is_none() => {
                    let next = module.functions.len();
                    module.function_index.insert(function.id, next);
                    module.functions.push(function);
                }
                _ => return Err(misplaced()),
            },
            Op::Label => match &current {
                Some(_) if open.is_none() => {
                    open = Some(Block::new(&instruction));
                }
                _ => return Err(misplaced()),
            },
            opcode if is_annotation(opcode) || is_debug(opcode) => {}
            opcode => {
                let (Some(function), Some(block)) = (&mut current, &mut open) else {
                    // Non-semantic extended instructions are allowed between functions.
                    if matches!(opcode, Op::ExtInst | Op::ExtInstWithForwardRefsKHR) {
                        continue;
                    }
                    return Err(misplaced());
                };
                if block.merge.is_some() && !is_terminator(opcode) {
                    return Err(misplaced());
                }
                match opcode {
                    Op::SelectionMerge => block.merge = Some(Merge::Selection(operands[0])),
                    Op::LoopMerge => block.merge = Some(Merge::Loop(operands[0], operands[1])),
                    _ if is_terminator(opcode) => {
                        is_dead = ends_invocation(opcode);
                        block.terminator = index as u32;
                        if let Some(block) = open.take() {
                            function.push(block);
                        }
                    }
                    _ => block.instructions.push(index as u32),
                }
            }
        }
    }
    if current.is_some() {
        return Err(Error::invalid(end, "the last function does not end"));
    }
    Ok(())
}

/// Instructions of `SPV_NV_ray_tracing` that end the invocation, but not their block. The rest of
/// the block is unreachable.
fn ends_invocation(opcode: Op) -> bool {
    matches!(opcode, Op::IgnoreIntersectionNV | Op::TerminateRayNV)
}

fn is_terminator(opcode: Op) -> bool {
    ends_invocation(opcode)
        || matches!(
            opcode,
            Op::Branch
                | Op::BranchConditional
                | Op::Switch
                | Op::Return
                | Op::ReturnValue
                | Op::Kill
                | Op::Unreachable
                | Op::TerminateInvocation
                | Op::IgnoreIntersectionKHR
                | Op::TerminateRayKHR
                | Op::EmitMeshTasksEXT
        )
}
