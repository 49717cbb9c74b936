//! SPIR-V written instruction by instruction: a compute shader, mostly of one invocation, that
//! reads a word and writes one.

use rspirv::spirv::{
    AddressingModel, Capability, Decoration, ExecutionMode, ExecutionModel, FunctionControl,
    MemoryModel, Op, StorageClass,
};

/// A module that is being written.
pub struct Assembler {
    next_id: u32,
    capabilities: Vec<u32>,
    imports: Vec<u32>,
    annotations: Vec<u32>,
    globals: Vec<u32>,
    functions: Vec<u32>,
    /// Of the main function, which comes last.
    pub body: Vec<u32>,
    pub void: u32,
    pub bool: u32,
    pub word: u32,
    /// Constants 0 to 9.
    pub numbers: Vec<u32>,
    /// The buffer of words to write.
    pub result: u32,
    /// Variables of the module beside the two buffers.
    pub interface: Vec<u32>,
    main: u32,
    /// The buffer of words to read.
    pub input: u32,
    /// The word that was read.
    pub given: u32,
    /// Invocations: one at first.
    pub invocations: u32,
    /// Execution modes and their operands.
    pub modes: Vec<(ExecutionMode, &'static [u32])>,
}

/// One instruction.
pub fn put(words: &mut Vec<u32>, op: Op, operands: &[u32]) {
    words.push((operands.len() as u32 + 1) << 16 | op as u32);
    words.extend_from_slice(operands);
}

impl Assembler {
    pub fn new() -> Self {
        let mut new = Self {
            next_id: 1,
            capabilities: vec![Capability::Shader as u32],
            imports: Vec::new(),
            annotations: Vec::new(),
            globals: Vec::new(),
            functions: Vec::new(),
            body: Vec::new(),
            void: 0,
            bool: 0,
            word: 0,
            numbers: Vec::new(),
            result: 0,
            interface: Vec::new(),
            main: 0,
            input: 0,
            given: 0,
            invocations: 1,
            modes: Vec::new(),
        };
        new.void = new.global(Op::TypeVoid, &[]);
        new.bool = new.global(Op::TypeBool, &[]);
        new.word = new.global(Op::TypeInt, &[32, 0]);
        new.numbers = (0..10).map(|number| new.number(number)).collect();
        let words = new.open_array(new.word, 4);
        let block = new.block(&[(words, 0)]);
        let class = StorageClass::StorageBuffer as u32;
        let pointer = new.global(Op::TypePointer, &[class, block]);
        new.input = new.value(pointer, Op::Variable, &[class]);
        new.result = new.value(pointer, Op::Variable, &[class]);
        for (binding, variable) in [(0, new.input), (1, new.result)] {
            new.decorate(variable, Decoration::DescriptorSet, &[0]);
            new.decorate(variable, Decoration::Binding, &[binding]);
        }

        new.main = new.id();
        let ty = new.global(Op::TypeFunction, &[new.void]);
        let control = FunctionControl::NONE.bits();
        let head = [new.void, new.main, control, ty];
        put(&mut new.body, Op::Function, &head);
        let label = new.id();
        new.label(label);
        new
    }

    pub fn id(&mut self) -> u32 {
        self.next_id += 1;
        self.next_id - 1
    }

    /// A type, whose result comes first.
    pub fn global(&mut self, op: Op, operands: &[u32]) -> u32 {
        let id = self.id();
        put(&mut self.globals, op, &[&[id], operands].concat());
        id
    }

    pub fn capability(&mut self, capability: Capability) {
        self.newer_capability(capability as u32);
    }

    /// A capability that is newer than the bindings.
    pub fn newer_capability(&mut self, number: u32) {
        self.capabilities.push(number);
    }

    pub fn decorate(&mut self, id: u32, decoration: Decoration, operands: &[u32]) {
        let head = [id, decoration as u32];
        let annotations = &mut self.annotations;
        put(annotations, Op::Decorate, &[&head, operands].concat());
    }

    pub fn decorate_member(
        &mut self,
        block: u32,
        member: u32,
        decoration: Decoration,
        operands: &[u32],
    ) {
        let head = [block, member, decoration as u32];
        let annotations = &mut self.annotations;
        put(annotations, Op::MemberDecorate, &[&head, operands].concat());
    }

    /// A block whose members start at these offsets in bytes.
    pub fn block(&mut self, members: &[(u32, u32)]) -> u32 {
        let types: Vec<u32> = members.iter().map(|member| member.0).collect();
        let block = self.global(Op::TypeStruct, &types);
        for (index, &(_, at)) in (0..).zip(members) {
            self.decorate_member(block, index, Decoration::Offset, &[at]);
        }
        self.decorate(block, Decoration::Block, &[]);
        block
    }

    /// An array of unknown length.
    pub fn open_array(&mut self, element: u32, stride: u32) -> u32 {
        let array = self.global(Op::TypeRuntimeArray, &[element]);
        self.decorate(array, Decoration::ArrayStride, &[stride]);
        array
    }

    /// A set of extended instructions.
    pub fn import(&mut self, name: &str) -> u32 {
        let id = self.id();
        let mut bytes = name.as_bytes().to_vec();
        bytes.resize(name.len() / 4 * 4 + 4, 0);
        let text = bytes.chunks_exact(4).map(|word| {
            let [a, b, c, d] = [word[0], word[1], word[2], word[3]];
            u32::from_le_bytes([a, b, c, d])
        });
        let operands: Vec<u32> = std::iter::once(id).chain(text).collect();
        put(&mut self.imports, Op::ExtInstImport, &operands);
        id
    }

    /// A decoration whose operand is an id.
    pub fn decorate_with_id(&mut self, id: u32, decoration: Decoration, operand: u32) {
        let operands = [id, decoration as u32, operand];
        put(&mut self.annotations, Op::DecorateId, &operands);
    }

    /// The same of a structure's member.
    pub fn decorate_member_with_id(
        &mut self,
        (structure, member): (u32, u32),
        decoration: Decoration,
        operand: u32,
    ) {
        let operands = [structure, member, decoration as u32, operand];
        put(&mut self.annotations, Op::MemberDecorateIdEXT, &operands);
    }

    /// An extended instruction of the module's scope.
    pub fn inform(&mut self, set: u32, operands: &[u32]) -> u32 {
        self.value(self.void, Op::ExtInst, &[&[set], operands].concat())
    }

    /// A constant or variable of the module.
    pub fn value(&mut self, ty: u32, op: Op, operands: &[u32]) -> u32 {
        let id = self.id();
        put(&mut self.globals, op, &[&[ty, id], operands].concat());
        id
    }

    /// A constant by an opcode that is newer than the bindings.
    pub fn newer_value(&mut self, ty: u32, opcode: u32, operands: &[u32]) -> u32 {
        let id = self.id();
        self.globals
            .push((operands.len() as u32 + 3) << 16 | opcode);
        self.globals.extend([ty, id]);
        self.globals.extend_from_slice(operands);
        id
    }

    pub fn number(&mut self, number: u32) -> u32 {
        self.value(self.word, Op::Constant, &[number])
    }

    pub fn pointer(&mut self, class: StorageClass, pointee: u32) -> u32 {
        self.global(Op::TypePointer, &[class as u32, pointee])
    }

    /// Reads the word, behind the variables.
    pub fn read(&mut self) {
        let pointer = self.pointer(StorageClass::StorageBuffer, self.word);
        let zero = self.numbers[0];
        let at = self.make(pointer, Op::AccessChain, &[self.input, zero, zero]);
        self.given = self.make(self.word, Op::Load, &[at]);
    }

    pub fn label(&mut self, label: u32) {
        put(&mut self.body, Op::Label, &[label]);
    }

    /// An instruction without a result.
    pub fn act(&mut self, op: Op, operands: &[u32]) {
        put(&mut self.body, op, operands);
    }

    /// An instruction without a result that is newer than the bindings.
    pub fn act_newer(&mut self, opcode: u32, operands: &[u32]) {
        (self.body).push((operands.len() as u32 + 1) << 16 | opcode);
        self.body.extend_from_slice(operands);
    }

    /// An instruction with a result.
    pub fn make(&mut self, ty: u32, op: Op, operands: &[u32]) -> u32 {
        let id = self.id();
        put(&mut self.body, op, &[&[ty, id], operands].concat());
        id
    }

    /// A variable of the main function that counts, zero at first.
    pub fn counter(&mut self) -> u32 {
        let class = StorageClass::Function;
        let pointer = self.pointer(class, self.word);
        let zero = self.numbers[0];
        self.make(pointer, Op::Variable, &[class as u32, zero])
    }

    /// Adds one to it.
    pub fn count(&mut self, counter: u32) {
        self.add(counter, self.numbers[1]);
    }

    /// Adds a number to it.
    pub fn add(&mut self, counter: u32, number: u32) {
        let before = self.make(self.word, Op::Load, &[counter]);
        let after = self.make(self.word, Op::IAdd, &[before, number]);
        self.act(Op::Store, &[counter, after]);
    }

    /// Ends the module: its result is what was counted.
    pub fn finish_counter(mut self, counter: u32) -> Vec<u32> {
        let result = self.make(self.word, Op::Load, &[counter]);
        self.finish(result)
    }

    /// Makes the words written since the body was that long a function before the main one.
    pub fn cut_function(&mut self, from: usize) {
        let function = self.body.split_off(from);
        self.functions.extend(function);
    }

    /// Writes the result and ends the module.
    pub fn finish(mut self, result: u32) -> Vec<u32> {
        let pointer = self.pointer(StorageClass::StorageBuffer, self.word);
        let zero = self.numbers[0];
        let at = self.make(pointer, Op::AccessChain, &[self.result, zero, zero]);
        self.act(Op::Store, &[at, result]);
        self.act(Op::Return, &[]);
        self.act(Op::FunctionEnd, &[]);
        let mut words = vec![rspirv::spirv::MAGIC_NUMBER, 0x0001_0600, 0, self.next_id, 0];
        for capability in self.capabilities {
            put(&mut words, Op::Capability, &[capability]);
        }
        words.extend(self.imports);
        let models = [AddressingModel::Logical as u32, MemoryModel::GLSL450 as u32];
        put(&mut words, Op::MemoryModel, &models);
        let name = [u32::from_le_bytes(*b"main"), 0];
        let head = [ExecutionModel::GLCompute as u32, self.main];
        let interface = [&[self.input, self.result], &self.interface[..]].concat();
        put(
            &mut words,
            Op::EntryPoint,
            &[&head[..], &name, &interface].concat(),
        );
        let mode = ExecutionMode::LocalSize as u32;
        let size = [self.invocations, 1, 1];
        put(
            &mut words,
            Op::ExecutionMode,
            &[&[self.main, mode], &size[..]].concat(),
        );
        for (mode, operands) in self.modes {
            let head = [self.main, mode as u32];
            put(&mut words, Op::ExecutionMode, &[&head, operands].concat());
        }
        for part in [self.annotations, self.globals, self.functions, self.body] {
            words.extend(part);
        }
        words
    }
}
